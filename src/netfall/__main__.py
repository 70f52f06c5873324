"""The command line: netfall check | partition | run | info | plot | scale | trade."""

import argparse
import os
import signal
import sys
import time
from pathlib import Path

import netfall
from netfall.errors import DivergedError, InputError, Interrupted, OutputError

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy and numba load: a rank is one thread


VERBS = ("check", "partition", "run", "info", "plot", "scale", "trade")


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str):
        raise InputError(f"{self.prog}: {message}; {self.prog} --help shows what it takes")


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = Parser(
        prog="netfall", description="Form finding, load and collapse analysis of cable roofs on MPI ranks."
    )
    top.add_argument("--version", action="store_true", help="print the version and the MPI and HDF5 in use")
    verbs = top.add_subparsers(dest="verb", metavar=" | ".join(VERBS))

    def verb(name, text, about):
        sub = verbs.add_parser(name, help=text, description=text)
        sub.add_argument(about, type=Path, metavar=about.upper())
        if about == "job":
            sub.add_argument(
                "--set",
                action="append",
                default=[],
                metavar="SECTION.KEY=VALUE",
                dest="overrides",
                help="override a key of the job file; may be repeated",
            )
        return sub

    verb("check", "validate a job; print sizes, step limits, memory and expected run time", "job")
    cut = verb("partition", "write partitions/NAME.graph and NAME.graph.part.P", "job")
    cut.add_argument("-n", type=int, required=True, metavar="P", dest="parts", help="number of parts")
    run = verb("run", "run a job; on P ranks: mpirun -n P netfall run JOB", "job")
    run.add_argument(
        "-o",
        type=_file,
        metavar="FILE",
        dest="output",
        help="result file (default: the job's name with .vtkhdf, here)",
    )
    run.add_argument(
        "--restart", type=Path, metavar="CHECKPOINT", help="go on from a checkpoint, on any number of ranks"
    )
    run.add_argument(
        "--walltime",
        type=_duration,
        metavar="HH:MM:SS",
        help="stop with a checkpoint (exit code 4) after this time",
    )
    run.add_argument(
        "--profile",
        action="store_true",
        help="time forces, exchange and drift of every step too (some 0.2 microseconds a step)",
    )
    loud = run.add_mutually_exclusive_group()
    loud.add_argument("--quiet", action="store_true", help="print errors only")
    loud.add_argument("--verbose", action="store_true", help="print residuals and step limits too")
    verb("info", "what ran, how it ended, the energies, the first fractures", "result")
    plot = verb("plot", "pictures from a result file", "result")
    plot.add_argument(
        "-o",
        type=Path,
        default=None,
        metavar="DIR",
        dest="folder",
        help="folder of the pictures (default: beside the result file)",
    )
    scale = verb(
        "scale", "run a job on several numbers of ranks: strong and weak scaling, times of the phases", "job"
    )
    scale.add_argument("--ranks", type=_counts, required=True, metavar="1,2,...", help="numbers of ranks")
    scale.add_argument(
        "--launcher", metavar="COMMAND", help='what starts the ranks (default: "mpirun -n {ranks}")'
    )
    scale.add_argument(
        "--repeats",
        type=_count,
        default=3,
        metavar="N",
        help="runs of each case, of which the best counts (default: 3)",
    )
    scale.add_argument(
        "-o",
        type=Path,
        default=Path("."),
        metavar="DIR",
        dest="folder",
        help="folder of the table and the picture (default: here)",
    )
    trade = verb("trade", "what each saving costs: run time against error over a grid of settings", "job")
    trade.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="SECTION.KEY=V1,V2,...",
        help="key and values; several: every combination (default: one key at a time)",
    )
    trade.add_argument(
        "--reference",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        help="setting of the reference "
        "(default: a tenth of the automatic step, or of the job's if that is shorter)",
    )
    trade.add_argument(
        "--tolerance",
        type=float,
        default=0.05,
        metavar="E",
        help="largest relative error of the setting that is recommended (default: 0.05)",
    )
    trade.add_argument(
        "--repeats",
        type=_count,
        default=2,
        metavar="N",
        help="runs of each setting, of which the fastest counts (default: 2)",
    )
    trade.add_argument("--ranks", type=_count, default=1, metavar="P", help="ranks of each run (default: 1)")
    trade.add_argument(
        "--launcher", metavar="COMMAND", help='what starts the ranks (default: "mpirun -n {ranks}")'
    )
    trade.add_argument(
        "-o",
        type=Path,
        default=Path("."),
        metavar="DIR",
        dest="folder",
        help="folder of the table (HDF5) and the picture (default: here)",
    )
    return top


def _file(text: str) -> Path:
    """The path of a file to write."""
    if text.endswith(os.sep) or not text:
        raise argparse.ArgumentTypeError(f"{text!r}: is a folder; expected the name of a file")
    return Path(text)


def _folder(path: Path) -> Path:
    """A folder to write into, which may still have to be made. Raises InputError where it cannot be one."""
    there = next((place for place in (path, *path.parents) if place.exists()), path)
    if there.exists() and not there.is_dir():
        raise InputError(f"-o {path}: {there} is a file; expected a folder")
    return path


def _count(text: str) -> int:
    """A whole number >= 1."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: expected a whole number >= 1")
    return int(text)


def _counts(text: str) -> list[int]:
    """Different whole numbers >= 1, in ascending order."""
    return sorted({_count(word.strip()) for word in text.split(",")})


def _duration(text: str) -> float:
    """Seconds of HH:MM:SS."""
    parts = text.split(":")
    if len(parts) != 3 or not all(part.isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"{text}: expected HH:MM:SS")
    hours, minutes, seconds = map(int, parts)
    return 3600.0 * hours + 60.0 * minutes + seconds


def check(arguments) -> None:
    """netfall check JOB"""
    from netfall.job.read import read_job
    from netfall.solve.check import check_job

    check_job(read_job(arguments.job, arguments.overrides), print)


def partition(arguments) -> None:
    """netfall partition JOB -n P"""
    from netfall.job.read import read_job
    from netfall.net.build import build_net
    from netfall.parallel import partition as p

    if arguments.parts < 1:
        raise InputError(f"-n {arguments.parts}: expected a number of parts >= 1")
    job = read_job(arguments.job, arguments.overrides)
    net = build_net(job)
    part = p.write_partition(job.name, net.n, net.elements, arguments.parts)
    print(
        f"{p.FOLDER / job.name}.graph.part.{arguments.parts}: "
        f"{net.n} particles, {net.m} elements in {arguments.parts} parts, "
        f"edge cut {p.edge_cut(net.elements, part)}, "
        f"fullest part {p.imbalance(net.elements, part, arguments.parts):.3f} of the mean"
    )


def run(arguments) -> None:
    """mpirun -n P netfall run JOB"""
    from mpi4py import MPI

    from netfall.job.read import read_job
    from netfall.output.progress import Progress
    from netfall.parallel.agree import on_root
    from netfall.solve.run import run_job
    from netfall.stop import StopRequest

    stop = StopRequest(arguments.walltime)
    comm = MPI.COMM_WORLD
    job = comm.bcast(on_root(comm, lambda: read_job(arguments.job, arguments.overrides)))
    progress = Progress(comm.rank == 0 and not arguments.quiet, arguments.verbose)
    run_job(
        comm,
        job,
        arguments.output or Path(f"{job.name}.vtkhdf"),
        progress,
        arguments.restart,
        stop,
        arguments.profile,
    )


def info(arguments) -> None:
    """netfall info RESULT"""
    from netfall.output.info import print_info

    print_info(arguments.result, print)


def plot(arguments) -> None:
    """netfall plot RESULT"""
    from netfall.output.plot import plot_all

    for picture in plot_all(arguments.result, _folder(arguments.folder or arguments.result.parent)):
        print(picture)


def scale(arguments) -> None:
    """netfall scale JOB --ranks 1,2"""
    from netfall.study.launch import default_launcher
    from netfall.study.scale import scale as run_scale

    for path in run_scale(
        arguments.job,
        arguments.overrides,
        arguments.ranks,
        arguments.launcher or default_launcher(),
        arguments.repeats,
        _folder(arguments.folder),
        lambda line: print(line, flush=True),
    ):
        print(path)


def trade(arguments) -> None:
    """netfall trade JOB"""
    from netfall.study.launch import default_launcher
    from netfall.study.trade import trade as run_trade

    for path in run_trade(
        arguments.job,
        arguments.overrides,
        arguments.vary,
        arguments.reference,
        arguments.ranks,
        arguments.launcher or default_launcher(),
        arguments.repeats,
        arguments.tolerance,
        _folder(arguments.folder),
        lambda line: print(line, flush=True),
    ):
        print(path)


def version() -> None:
    """netfall --version"""
    from netfall.solve.run import how_it_writes

    print(f"netfall {netfall.__version__}, {how_it_writes()}")


def check_verb(words: list[str]) -> None:
    """Raise InputError for a first word that is no command: a forgotten one, mostly."""
    if not words or words[0].startswith("-") or words[0] in VERBS:
        return
    meant = {".toml": f"netfall run {words[0]}", ".vtkhdf": f"netfall info {words[0]}"}.get(
        Path(words[0]).suffix
    )
    advice = f"did you mean {meant}?" if meant else f"expected one of {', '.join(VERBS)}"
    raise InputError(f"netfall {words[0]}: is no command; {advice}")


def main() -> None:
    """Entry point: run a command; the exit code says how it ended (jobs/README.md)."""
    top = parser()
    try:
        check_verb(sys.argv[1:])
        arguments = top.parse_args()
        if arguments.verb is None and not arguments.version:
            top.print_help()
            sys.exit(2)
        version() if arguments.version else globals()[arguments.verb](arguments)
    except (InputError, DivergedError, Interrupted) as error:
        if _rank() == 0:
            print(error, file=sys.stderr, flush=True)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        sys.exit(1)
    except BaseException as error:
        _abort(error)


def _rank() -> int:
    """This process's rank; before MPI is in use, what the launcher says; else 0."""
    if "mpi4py.MPI" not in sys.modules:
        names = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")
        return next((int(os.environ[name]) for name in names if os.environ.get(name, "").isdigit()), 0)
    from mpi4py import MPI

    return MPI.COMM_WORLD.rank


def _abort(error: BaseException) -> None:
    """An error on one rank ends all of them: the others would wait for it."""
    if isinstance(error, SystemExit):
        raise error
    if os.environ.get("NETFALL_TRACEBACK"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, OutputError):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        time.sleep(
            min(5.0, 0.5 * _rank())
        )  # what ranks meet at the same moment the lowest of them tells, and ends the others
    common = getattr(error, "on_every_rank", False)
    if not common or _rank() == 0:
        what = (
            str(error)
            if isinstance(error, OutputError)
            else f"rank {_rank()}: {type(error).__name__}: {error} (NETFALL_TRACEBACK=1 shows where)"
        )
        print(f"netfall: {what}", file=sys.stderr, flush=True)
    if "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        if MPI.COMM_WORLD.size > 1 and not MPI.Is_finalized():
            if common:
                MPI.COMM_WORLD.Barrier()  # rank 0 has told
            MPI.COMM_WORLD.Abort(1)
    os._exit(1)  # HDF5 would try again, at exit, to write what it could not


if __name__ == "__main__":
    main()
