"""Exceptions that end a run early, each with its exit code. A missing optional package raises one."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from netfall.core import messages
from netfall.core.messages import with_sentence

LAST_CHECKPOINT = "The last good checkpoint is {path}: resume with --restart {path}"
NO_SPACE = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # a full disk, a quota, or a limit of the size of files
ON_EVERY_RANK = "raised on every rank"  # note of an error


class InputError(Exception):
    """Error in the job or its input, one line per error, after warnings and notes on it. Exit code 2."""

    exit_code = 2

    def __init__(self, lines: Iterable[str] | str):
        self.lines = [lines] if isinstance(lines, str) else list(lines)
        super().__init__("\n".join(self.lines))


def other_version_error(path: Path, version: str | None, remedy: str) -> InputError:
    """Build the error for a file in the layout of another version of netfall, None: the file names none."""
    version = version or "0.4 or older"
    return InputError(messages.OTHER_VERSION(path=path, version=version, remedy=remedy))


def raise_errors(lines: Iterable[str]) -> None:
    """Raise InputError with all different lines, if there are any."""
    if lines := list(dict.fromkeys(lines)):
        raise InputError(lines)


class RunError(Exception):
    """Failure of a run; checkpoint : path of the last good one, None without one.

    state : of the run, in result files and studies
    """

    exit_code: int
    state = "failed"
    checkpoint: Path | None = None

    def __str__(self) -> str:
        message = super().__str__()
        if self.checkpoint is None:
            return message
        return with_sentence(message, LAST_CHECKPOINT.format(path=self.checkpoint))


class DivergedError(RunError):
    """Stop of a computation that diverged or did not converge. Exit code 3."""

    exit_code = 3
    state = "diverged"


class NoEquilibriumError(DivergedError):
    """No equilibrium exists under a load, in a stage of erection, or with errors of length."""

    state = "no_equilibrium"


class UndecidedError(DivergedError):
    """The search for an equilibrium failed, but one may exist."""

    state = "undecided"


class Interrupted(Exception):
    """Stop of a run at a common step, with a checkpoint. Exit code 4."""

    exit_code = 4


class OutputError(RunError):
    """Failure to write a file: full disk, quota, or missing folder.

    Only the ranks that noticed it raise it. Exit code 1.
    """

    exit_code = 1


def note_on_every_rank(error: Exception) -> None:
    """Mark an error of any class as raised by all ranks together."""
    error.add_note(ON_EVERY_RANK)


def is_on_every_rank(error: BaseException) -> bool:
    """Return whether all ranks raise an error together, as marked by `note_on_every_rank`."""
    return ON_EVERY_RANK in getattr(error, "__notes__", ())


def interruption_error(when: str, path: Path) -> Interrupted:
    """Build the exception for a run that a signal or its time limit stopped."""
    return Interrupted(messages.INTERRUPTED(when=when, path=path))


EXTRAS = {
    "plot": ("matplotlib", "mpl_toolkits", "PIL", "adjustText", "imageio_ffmpeg", "markdown_it"),
    "cad": ("ezdxf", "vtkmodules"),
    "view": ("k3d",),
    "study": ("openturns",),
    "gpu": ("numba_cuda",),
}
EXTRA_OF_PACKAGE = {package: extra for extra, packages in EXTRAS.items() for package in packages}


@contextmanager
def naming_extras() -> Iterator[None]:
    """Name the extra to install if one of its packages is missing. Raises InputError."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRA_OF_PACKAGE:
            raise
        raise InputError(
            messages.MISSING_PACKAGE(package=package, extra=EXTRA_OF_PACKAGE[package])
        ) from error
