"""Running a job from Python: here on one rank or on those there are, else on ranks started for it."""

import os
import shlex
import subprocess
import tempfile
from contextlib import nullcontext
from pathlib import Path

from netfall.api.net import Net
from netfall.ground.errors import DivergedError, InputError, Interrupted
from netfall.ground.launch import default_launcher, run_command
from netfall.job.toml_text import toml_text, toml_value
from netfall.results.result import Result

ENDS = {2: InputError, 3: DivergedError, 4: Interrupted}  # by exit code
OF_LAUNCHERS = ("OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK")  # what mpirun and srun leave for a rank


def run(job, overrides: dict | None, ranks: int | None, output, quiet: bool) -> Result:
    """What `netfall.run` does."""
    settings = [f"{name}={toml_value(value)}" for name, value in (overrides or {}).items()]
    if ranks is not None and (isinstance(ranks, bool) or not isinstance(ranks, int) or ranks < 1):
        raise InputError(f"ranks = {ranks!r}: expected a whole number >= 1")
    if under_mpirun() or (ranks or 1) == 1:
        return _run_on_these_ranks(job, settings, ranks, output, quiet)
    with _Place(job, output) as place:
        _run_on_new_ranks(place, settings, ranks, quiet)
        return place.result()


def under_mpirun() -> bool:
    """Whether a launcher of MPI ranks started this process. (MPI at its start does not alter os.environ.)"""
    return any(name in os.environ for name in OF_LAUNCHERS)


class _Place:
    """The files of a run: a folder that goes with its result, or at once if there is none.

    job : path of the job file; output : path of the result file
    """

    def __init__(self, job, output):
        """job : a path, or a dict that becomes a file; output : None for a result that is kept no longer than
        it is used
        """
        self.folder = None
        if output is None or isinstance(job, dict):
            self.folder = _temporary_folder()
        try:
            self.job = _job_file(job, Path(self.folder.name)) if isinstance(job, dict) else Path(job)
        except BaseException:
            self.folder.cleanup()
            raise
        self.keep = output is not None
        self.output = Path(output) if self.keep else Path(self.folder.name) / f"{self.job.stem}.vtkhdf"

    def __enter__(self):
        return self

    def __exit__(self, kind, error, _):
        if self.folder is not None and (self.keep or kind is not None):
            self.folder.cleanup()

    def result(self) -> Result:
        """The result, which takes the folder along if the file stands in it."""
        found = Result(self.output)
        found._keeps = None if self.keep else self.folder
        return found

    @property
    def prefix(self) -> str:
        """What names of files in the folder begin with."""
        return f"{self.folder.name}{os.sep}" if self.folder else ""


def _without(prefix: str, lines: list[str]) -> list[str]:
    """Messages without the name of a temporary folder."""
    return [line.replace(prefix, "") if prefix else line for line in lines]


def _temporary_folder() -> tempfile.TemporaryDirectory:
    """Here, where other nodes see it too and there is room; else where the system keeps such things."""
    try:
        return tempfile.TemporaryDirectory(prefix=".netfall-", dir=os.getcwd(), ignore_cleanup_errors=True)
    except OSError:
        return tempfile.TemporaryDirectory(prefix="netfall-", ignore_cleanup_errors=True)


def _job_file(job: dict, folder: Path) -> Path:
    """Write a job, and the tables of its net; paths in it are relative to the working directory."""
    job = {name: _absolute(value) if name != "title" else value for name, value in job.items()}
    net = job.get("net")
    own = net.get("nodes") if isinstance(net, dict) else net
    if isinstance(net, dict) and not isinstance(own, str) and own is not None:
        if "elements" not in net:
            raise InputError("net: nodes without elements: expected both, arrays or names of tables")
        given = [name for name in Net.__dataclass_fields__ if name in net]
        rest = {name: value for name, value in net.items() if name not in given}
        job["net"] = rest | Net(**{name: net[name] for name in given}).write(folder)
    elif isinstance(net, Net):
        job["net"] = net.write(folder)
    path = folder / "job.toml"
    path.write_text(toml_text(job), encoding="utf-8")
    return path


def _absolute(value):
    """Names of files that there are, as whole paths: the job file stands elsewhere."""
    if isinstance(value, dict):
        return {name: _absolute(item) for name, item in value.items()}
    if isinstance(value, (str, os.PathLike)) and os.path.isfile(value):
        return os.path.abspath(value)
    return value


def _run_on_new_ranks(place: _Place, settings: list[str], ranks: int, quiet: bool) -> None:
    options = ["--quiet"] if quiet else []
    command = run_command(default_launcher(), ranks, place.job, place.output, settings, *options)
    # os.environ is as it was before any start-up of MPI in this process, with which mpirun would fail
    ended = subprocess.run(
        command,
        env=dict(os.environ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL if quiet else None,
        stderr=subprocess.PIPE,
        text=True,
    )
    if ended.returncode:
        lines = [line for line in ended.stderr.splitlines() if line.strip()] or ["no message"]
        raise _error(ended.returncode, _without(place.prefix, lines), command)


def _error(code: int, lines: list[str], command: list[str]) -> Exception:
    if code == InputError.exit_code:
        return InputError(lines)
    if code in ENDS:
        return ENDS[code]("\n".join(lines))
    return RuntimeError("\n".join([f"{shlex.join(command)} ended with exit code {code}", *lines]))


def _run_on_these_ranks(job, settings: list[str], ranks: int | None, output, quiet: bool) -> Result:
    """Collective over the ranks of mpirun, each of which gets the result; without mpirun on this one."""
    from mpi4py import MPI

    from netfall.ground.progress import Progress
    from netfall.job.read import read_job
    from netfall.parallel.agree import on_root
    from netfall.program.run import run_job

    comm = MPI.COMM_WORLD if under_mpirun() else MPI.COMM_SELF
    if ranks not in (None, comm.size):
        raise InputError(
            f"ranks = {ranks}: this script runs on {comm.size} ranks of mpirun already, and so does the job; "
            "leave ranks out"
        )
    place = on_root(comm, lambda: _Place(job, output))
    path, told = comm.bcast(place and (place.output, place.prefix))
    with place or nullcontext():
        try:
            read = comm.bcast(on_root(comm, lambda: read_job(place.job, settings)))
            run_job(comm, read, path, Progress(comm.rank == 0 and not quiet))
        except InputError as error:
            raise InputError(_without(told, error.lines)) from None
    comm.Barrier()  # the file has its name
    return on_root(comm, lambda: place.result()) or Result(path)
