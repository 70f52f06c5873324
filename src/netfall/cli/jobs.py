"""Commands on jobs: write, check, partition and run them.

A command imports what it needs when it is called. netfall therefore reports a wrong word on the command line
before it loads anything else.
"""

import os
from pathlib import Path

from netfall.cli import messages
from netfall.cli import options as take
from netfall.cli.options import JOB, JSON, QUIET, SET, VERBOSE, command, flag, option, to_file, to_folder
from netfall.core.errors import DivergedError, InputError
from netfall.core.progress import print_lines

EXAMPLES = ("saddle", "dome", "wheel", "facade", "edge-cables")


@command(
    option("job", "JOB", "file to write (default: the name of the example)", take.file, nargs="?"),
    option("--example", None, "which short job (default: saddle)", choices=EXAMPLES),
)
def init(job: Path | None, example: str | None) -> None:
    """Write a short job that runs as it is, and the schema that lets editors complete keys.

    examples:
      netfall init roof.toml
      netfall init --example dome
    """
    from netfall.job.keys.schema import schema_text
    from netfall.job.toml_text import SCHEMA_FILE, example_tables, new_job
    from netfall.results.locks import whole

    example = example or EXAMPLES[0]
    path = job or Path(f"{example}.toml")
    texts = {path: new_job(path, example), path.parent / SCHEMA_FILE: schema_text()}
    texts |= example_tables(path.parent, example)
    for target, text in texts.items():
        with whole(target) as place:
            place.write_text(text, encoding="utf-8")
    print_lines(f"{path}: written; next: netfall check {path}")


@command()
def schema() -> None:
    """Print the JSON schema of a job file, which lets editors complete and check keys.

    example:
      netfall schema
    """
    from netfall.job.keys.schema import schema_text

    print(schema_text(), end="")


@command(JOB, SET, to_folder("folder for a picture of the net (default: none is drawn)"), JSON)
def check(job: Path, overrides: list[str], folder: Path | None, json: bool) -> None:
    """Validate a job; print sizes, step limits, memory and expected run time; draw its net.

    examples:
      netfall check jobs/stadium.toml -o pictures
      netfall check roof.toml --set wind.speed=45 --set cable.prestress=80e3
    """
    from netfall.parallel.alone import start_mpi

    start_mpi()
    from netfall.core.messages import is_error, is_warning
    from netfall.core.text import json_text
    from netfall.driver.check import check_job, check_values
    from netfall.job.read import read_job

    folder = folder and take.output_folder(folder)
    if not json:
        check_job(read_job(job, overrides), print_lines, folder)
        return
    lines: list[str] = []
    try:
        print(json_text(check_values(read_job(job, overrides), lines, folder)))
    except (InputError, DivergedError) as error:
        of_error = str(error).splitlines()
        warnings = [line for line in [*lines, *of_error] if is_warning(line)]
        errors = [*filter(is_error, of_error)]
        print(json_text({"job": str(job), "valid": False, "errors": errors, "warnings": warnings}))
        raise SystemExit(error.exit_code) from None


@command(JOB, SET, option("-n", "P", "number of parts", int, dest="parts", required=True))
def partition(job: Path, overrides: list[str], parts: int) -> None:
    """Partition the net of a job for P ranks; write partitions/NAME.graph and NAME.graph.part.P.

    example:
      netfall partition jobs/stadium.toml -n 8
    """
    from netfall.geometry.build import build_net
    from netfall.job.read import read_job
    from netfall.parallel import partition as p
    from netfall.results.locks import atomic_folder

    if parts < 1:
        raise InputError(messages.NO_PARTS(parts=parts))
    definition = read_job(job, overrides)
    net = build_net(definition)
    if parts > net.n:
        raise InputError(messages.TOO_MANY_PARTS(parts=parts, particles=net.n))
    part = p.metis_partition(net.n, net.elements, parts)
    with atomic_folder(p.FOLDER) as folder:
        p.write_partition(folder, definition.name, net.elements, part, parts)
    print_lines(
        f"{p.FOLDER / definition.name}.graph.part.{parts}: "
        f"{net.n} particles, {net.m} elements in {parts} parts, "
        f"edge cut {p.edge_cut(net.elements, part)}, "
        f"fullest part {p.imbalance(net.elements, part, parts):.3f} of the mean"
    )


@command(
    JOB,
    SET,
    to_file("result file (default: name of the job with .vtkhdf, in this folder)"),
    option("--restart", "CHECKPOINT", "continue from a checkpoint, on any number of ranks", Path),
    option("--walltime", "HH:MM:SS", "stop with a checkpoint (exit code 4) after this time", take.duration),
    option(
        "--device",
        None,
        "device for the dynamic stage; auto: a GPU if possible",
        choices=("cpu", "gpu", "auto"),
        default="cpu",
    ),
    flag(
        "--profile",
        help="also time forces, exchange and motion in each step, on a CPU (some 0.2 us per step)",
    ),
    QUIET,
    VERBOSE,
)
def run(
    job: Path,
    overrides: list[str],
    output: Path | None,
    restart: Path | None,
    walltime: float | None,
    device: str,
    profile: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Run a job; on P ranks: mpirun -n P netfall run JOB.

    examples:
      netfall run roof.toml
      mpirun -n 2 netfall run jobs/stadium.toml -o results/stadium.vtkhdf
      netfall run roof.toml -o gust.vtkhdf --set wind.seed=7 --set output.checkpoint_interval=1
      netfall run roof.toml --restart roof.checkpoint-5-00004000.h5 --walltime 02:00:00
    """
    from signal import SIGINT, SIGTERM, SIGUSR1

    from netfall.core.timings import StopFlag

    stop = StopFlag(walltime, (SIGTERM, SIGUSR1))  # before the other imports, which may take seconds
    from netfall.parallel.alone import world_communicator

    comm = world_communicator()  # before any import of MPI, which starts it
    from netfall.parallel.agree import check_same_options, on_root

    given = {"JOB": job, "--set": " ".join(overrides), "-o": output, "--restart": restart}
    given |= {
        "--walltime": walltime,
        "--device": device,
        "--profile": profile,
        "--quiet": quiet,
        "--verbose": verbose,
    }
    check_same_options(comm, given)
    from netfall.core.progress import Progress
    from netfall.driver.compile import compile_missing
    from netfall.driver.run import run_job
    from netfall.job.read import read_job

    stop.catch(SIGINT)  # Ctrl-C ends a run that has not begun at once
    definition = comm.bcast(on_root(comm, lambda: read_job(job, overrides)))
    progress = Progress(comm.rank == 0 and not quiet, verbose)
    if comm.size > 1:
        compile_missing(comm, stop)
    path = output or Path(f"{definition.name}.vtkhdf")
    run_job(comm, definition, path, progress, restart, stop, profile, device)


@command()
def compile() -> None:
    """Compile the kernels in advance (a minute); otherwise the first run compiles them.

    example:
      netfall compile
    """
    from netfall.parallel.alone import start_mpi

    start_mpi()
    from netfall.core.cache import CACHE_VARIABLE
    from netfall.driver.compile import compile_all, one_process_at_a_time

    folder = os.environ.get(CACHE_VARIABLE, "")
    if not os.access(folder, os.W_OK):
        raise InputError(messages.NO_CACHE_FOLDER(variable=CACHE_VARIABLE))
    with one_process_at_a_time():
        compile_all(print_lines)
    print_lines(f"kept in {folder}")
