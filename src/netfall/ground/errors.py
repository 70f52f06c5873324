"""The ways in which a run ends early, each with its exit code."""

from collections.abc import Iterable
from pathlib import Path

BUSY = "another run is writing it at this moment"  # why a name is refused for the time being


class InputError(Exception):
    """The job or its input is wrong: one line for each error. Exit code 2."""

    exit_code = 2

    def __init__(self, lines: list[str] | str):
        self.lines = [lines] if isinstance(lines, str) else list(lines)
        super().__init__("\n".join(self.lines))


def refuse(lines: Iterable[str]) -> None:
    """Raise InputError with all lines, if there are any."""
    if lines := list(lines):
        raise InputError(lines)


class DivergedError(Exception):
    """The computation left all proportion, or did not converge, and was stopped. Exit code 3."""

    exit_code = 3


class NoRest(DivergedError):
    """There is no equilibrium under the mean wind."""


class Undecided(DivergedError):
    """No equilibrium was found, but there may be one: the search ended before it was decided."""


class Interrupted(Exception):
    """The run stopped at a common step with a checkpoint. Exit code 4."""

    exit_code = 4


class OutputError(Exception):
    """A file could not be written: a full disk, a quota, a folder that went away.

    Raised on the ranks that saw it. Exit code 1.
    """

    exit_code = 1


def interrupted(when: str, path: Path) -> Interrupted:
    """The end of a run that was asked to stop."""
    return Interrupted(f"interrupted {when}; resume with --restart {path}")
