"""Functions of the commands. Each takes the arguments that `parser` has read.

A command imports its own dependencies. `info`, `plot` and `report` therefore work without MPI, and netfall
reports a wrong word on the command line before it loads anything else.
"""

import os
from argparse import Namespace
from pathlib import Path
from typing import Any

import netfall
from netfall.core.errors import DivergedError, InputError
from netfall.core.progress import print_lines

ANIMATION_OPTIONS = ("format", "fps", "view", "size", "zoom", "until")  # options of `plot` for animations


def init(arguments: Any) -> None:
    """Write a new job file: netfall init JOB"""
    from netfall.job.json_schema import schema_text
    from netfall.job.template import SCHEMA_FILE, new_job
    from netfall.results.locks import whole

    path = arguments.job or Path(f"{arguments.example or 'job'}.toml")
    texts = {path: new_job(path, arguments.example), path.parent / SCHEMA_FILE: schema_text()}
    for file, text in texts.items():
        with whole(file) as place:
            place.write_text(text, encoding="utf-8")
    print_lines(f"{path}: a job to start from; next: netfall check {path}")


def schema(arguments: Namespace) -> None:
    """Print the JSON schema of a job file: netfall schema"""
    from netfall.job.json_schema import schema_text

    print(schema_text(), end="")


def check(arguments: Namespace) -> None:
    """Check a job: netfall check JOB"""
    from netfall.parallel.alone import start_mpi

    start_mpi()
    from netfall.core.plain_values import json_text
    from netfall.driver.check import check_job, check_values
    from netfall.job.read import read_job

    folder = arguments.folder and _output_folder(arguments.folder)
    if arguments.json:
        try:
            print(json_text(check_values(read_job(arguments.job, arguments.overrides), folder)))
        except (InputError, DivergedError) as error:
            print(json_text({"job": str(arguments.job), "valid": False, "errors": str(error).splitlines()}))
            raise SystemExit(error.exit_code) from None
        return
    check_job(read_job(arguments.job, arguments.overrides), print_lines, folder)


def partition(arguments: Any) -> None:
    """Partition a net: netfall partition JOB -n P"""
    from netfall.geometry.build import build_net
    from netfall.job.read import read_job
    from netfall.parallel import partition as p
    from netfall.results.locks import atomic_folder

    if arguments.parts < 1:
        raise InputError(f"-n {arguments.parts}: expected a number of parts >= 1")
    job = read_job(arguments.job, arguments.overrides)
    print_lines(*job.warnings)
    net = build_net(job)
    if arguments.parts > net.n:
        raise InputError(f"-n {arguments.parts}: expected at most as many parts as particles, {net.n}")
    part = p.metis_partition(net.n, net.elements, arguments.parts)
    with atomic_folder(p.FOLDER) as folder:
        p.write_partition(folder, job.name, net.elements, part, arguments.parts)
    print_lines(
        f"{p.FOLDER / job.name}.graph.part.{arguments.parts}: "
        f"{net.n} particles, {net.m} elements in {arguments.parts} parts, "
        f"edge cut {p.edge_cut(net.elements, part)}, "
        f"fullest part {p.imbalance(net.elements, part, arguments.parts):.3f} of the mean"
    )


def run(arguments: Namespace) -> None:
    """Run a job: mpirun -n P netfall run JOB"""
    from netfall.parallel.alone import world_communicator

    comm = world_communicator()
    _check_same_options(comm.allgather(vars(arguments)))
    from netfall.core.progress import Progress
    from netfall.core.stop import StopFlag
    from netfall.driver.compile import compile_missing
    from netfall.driver.run import run_job
    from netfall.job.read import read_job
    from netfall.parallel.agree import on_root

    stop = StopFlag(arguments.walltime)
    job = comm.bcast(on_root(comm, lambda: read_job(arguments.job, arguments.overrides)))
    progress = Progress(comm.rank == 0 and not arguments.quiet, arguments.verbose)
    path = arguments.output or Path(f"{job.name}.vtkhdf")
    if comm.size > 1:
        compile_missing(comm)
    run_job(comm, job, path, progress, arguments.restart, stop, arguments.profile)


def _check_same_options(given: list[dict[str, Any]]) -> None:
    """Raise InputError if a rank was started with other options than rank 0.

    given : the options of each rank
    """
    names = {"job": "JOB", "output": "-o", "overrides": "--set"}
    as_typed = [
        {
            name: " ".join(map(str, item)) if isinstance(item, list) else str(item)
            for name, item in options.items()
        }
        for options in given
    ]
    for rank, options in enumerate(as_typed):
        for name, value in options.items():
            if value != as_typed[0][name]:
                option, first = names.get(name, f"--{name}"), as_typed[0][name]
                raise InputError(
                    f"netfall run: {option}: rank 0 has {first}, rank {rank} has {value}; "
                    "start all ranks of a run with the same options"
                )


def compile(arguments: Any) -> None:
    """Compile the kernels: netfall compile"""
    from netfall.parallel.alone import start_mpi

    start_mpi()
    from netfall.core.cache import CACHE_VARIABLE
    from netfall.driver.compile import compile_all, turn

    with turn():
        compile_all(print_lines)
    print_lines(f"kept in {os.environ[CACHE_VARIABLE]}")


def info(arguments: Namespace) -> None:
    """Print a summary: netfall info RESULT"""
    from netfall.results.file import is_study

    if is_study(arguments.result):
        if arguments.json:
            raise InputError(f"{arguments.result}: --json is for the result of one run, not for a study file")
        from netfall.study.answers.info import print_study

        print_study(arguments.result, print_lines)
    elif arguments.json:
        from netfall.post.report.info_json import print_info_json

        print_info_json(arguments.result, print)
    else:
        from netfall.post.report.info import print_info

        print_info(arguments.result, print_lines)


def plot(arguments: Any) -> None:
    """Draw plots: netfall plot RESULT"""
    from netfall.results.file import is_study

    a = arguments
    if a.animate or any(getattr(a, name) is not None for name in ANIMATION_OPTIONS):
        _animate(a)
        return
    from netfall.post.plots.run import plot_all, plot_state
    from netfall.post.plots.study.study import plot_study

    folder = _output_folder(a.folder or a.result.parent)
    if a.case is None:
        print_lines(*(plot_study if is_study(a.result) else plot_all)(a.result, folder))
    elif is_study(a.result):
        raise InputError(f"--case {a.case}: {a.result} is a study file")
    else:
        print_lines(plot_state(a.result, folder, a.case))


def _animate(arguments: Any) -> None:
    """Draw animations: netfall plot RESULT --animate"""
    from netfall.post.plots.canvas import VIEWS
    from netfall.post.plots.film import FilmView, animate
    from netfall.results.file import is_study

    a = arguments
    if not a.animate:
        names = ", ".join(f"--{name}" for name in ANIMATION_OPTIONS)
        raise InputError(f"netfall plot: {names} are of the animation; add --animate")
    if is_study(a.result):
        raise InputError(f"{a.result}: a study file has no frames; animate the result file of one run")
    settings = {name: getattr(a, name) for name in ANIMATION_OPTIONS[2:] if getattr(a, name) is not None}
    if isinstance(a.view, str):
        settings["view"] = VIEWS[a.view]
    folder = _output_folder(a.folder or a.result.parent)
    for path, words in animate(a.result, folder, a.format, a.fps, FilmView(**settings)):
        print_lines(f"{path}: {words}")


def view(arguments: Any) -> None:
    """Write a page for the browser: netfall view RESULT"""
    from netfall.post.page.page import write_page
    from netfall.post.page.study import write_study_page
    from netfall.results.file import is_study

    a, path = arguments, arguments.result
    page = a.output or path.with_name(f"{path.name.removesuffix('.h5').removesuffix('.vtkhdf')}.html")
    _output_folder(page.parent)
    if is_study(path):
        words = write_study_page(path, page, a.sample)
    elif a.sample is not None:
        raise InputError(f"--sample {a.sample}: {path} is not a study file")
    else:
        words = write_page(path, page)
    print_lines(f"{page}: {words}; open it in a browser")


def report(arguments: Any) -> None:
    """Write a report: netfall report RESULT"""
    from netfall.post.checks.cables import Cutting
    from netfall.post.report.report import Inputs, write_report

    a, default_folder = arguments, arguments.result.with_name(f"{arguments.result.stem}-report")
    inputs = Inputs(a.codes, Cutting(a.temperature, a.load), a.deductions)
    print_lines(*write_report(a.result, _output_folder(a.folder or default_folder), inputs))


def scale(arguments: Any) -> None:
    """Measure scaling: netfall scale JOB --ranks 1,2, netfall scale STUDY --workers 1,2"""
    a = arguments
    if (a.ranks is None) == (a.workers is None):
        raise InputError(
            "netfall scale: expected either --ranks 1,2, for a job, or --workers 1,2, for a study"
        )
    if a.workers:
        from netfall.post.accuracy.throughput import run_throughput

        if a.overrides:
            raise InputError(f"netfall scale: --set {a.overrides[0]}: change the study file instead")
        paths = run_throughput(
            a.job, a.workers, a.launcher, a.repeats, _output_folder(a.folder), _line_printer()
        )
    else:
        from netfall.core.launch import default_launcher
        from netfall.post.accuracy.scale import scale as run_scale

        launcher = a.launcher or default_launcher()
        paths = run_scale(
            a.job, a.overrides, a.ranks, launcher, a.repeats, _output_folder(a.folder), _line_printer()
        )
    print_lines(*paths)


def trade(arguments: Any) -> None:
    """Run an accuracy study: netfall trade JOB"""
    from netfall.core.launch import default_launcher
    from netfall.core.stop import StopFlag
    from netfall.post.accuracy.trade import trade as run_trade

    a = arguments
    paths = run_trade(
        path=a.job,
        overrides=a.overrides,
        vary=a.vary,
        reference=a.reference,
        ranks=a.ranks,
        launcher=a.launcher or default_launcher(),
        repeats=a.repeats,
        tolerance=a.tolerance,
        folder=_output_folder(a.folder),
        say=_line_printer(),
        stop=StopFlag(),
    )
    print_lines(*paths)


def _line_printer() -> Any:
    """Return a function that prints lines, and continues without output if the reader has ended."""
    from netfall.core.progress import Progress

    return Progress(True).say


def study(arguments: Namespace) -> None:
    """Run a study: netfall study STUDY"""
    from netfall.core.launch import SIZES, launcher_variables
    from netfall.core.progress import Progress
    from netfall.core.stop import StopFlag
    from netfall.study.study import study as run_study

    if max(launcher_variables(SIZES).values(), default=1) > 1:
        raise InputError("netfall study: starts ranks itself; run it without mpirun, with [run] ranks = P")
    a, progress = arguments, Progress(not arguments.quiet)
    run_study(a.study, a.output, a.workers, a.shard, a.launcher, a.retry, progress, StopFlag())


def import_(arguments: Namespace) -> None:
    """Import a drawing or mesh: netfall import FILE -o FOLDER"""
    from netfall.exchange.drawings.importing import import_file
    from netfall.exchange.drawings.reading import ImportOptions

    settings = {name: getattr(arguments, name) for name in ImportOptions.__dataclass_fields__}
    import_file(arguments.drawing, arguments.folder, ImportOptions(**settings), print_lines)


def export(arguments: Any) -> None:
    """Export a result: netfall export RESULT -o FILE"""
    from netfall.exchange.export import Wanted
    from netfall.exchange.export import export as write

    wanted = Wanted(arguments.time, arguments.case, arguments.unit)
    write(arguments.result, arguments.output, wanted, print_lines)


def version() -> None:
    """Print versions: netfall --version"""
    from netfall.driver.provenance import library_text

    print_lines(f"netfall {netfall.__version__}, {library_text()}")


def _output_folder(path: Path) -> Path:
    """Return a folder for output, which need not exist yet. Raises InputError if a file is in its place."""
    existing = next((place for place in (path, *path.parents) if place.exists()), path)
    if existing.exists() and not existing.is_dir():
        raise InputError(f"-o {path}: {existing} is a file; expected a folder")
    return path
