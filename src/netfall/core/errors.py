"""Exceptions that end a run early, each with its exit code."""

from collections.abc import Iterable
from pathlib import Path

OUTPUT_IN_USE = (
    "another run is writing it at this moment"  # reason in the message if an output name is refused
)


class InputError(Exception):
    """Error in the job or its input, one line per error. Exit code 2."""

    exit_code = 2

    def __init__(self, lines: list[str] | str):
        self.lines = [lines] if isinstance(lines, str) else list(lines)
        super().__init__("\n".join(self.lines))


def raise_errors(lines: Iterable[str]) -> None:
    """Raise InputError with all lines, if there are any."""
    if lines := list(lines):
        raise InputError(lines)


class DivergedError(Exception):
    """Stop of a computation that diverged or did not converge. Exit code 3."""

    exit_code = 3


class NoEquilibriumError(DivergedError):
    """Absence of an equilibrium under the mean wind."""


class UndecidedError(DivergedError):
    """End of the search for an equilibrium without a decision: none was found, but one may exist."""


class Interrupted(Exception):
    """Stop of a run at a common step, with a checkpoint. Exit code 4."""

    exit_code = 4


class OutputError(Exception):
    """Failure to write a file: full disk, quota, or missing folder.

    Only the ranks that noticed it raise it. Exit code 1.
    """

    exit_code = 1


def interruption_error(when: str, path: Path) -> Interrupted:
    """Build the exception for a run that was asked to stop."""
    return Interrupted(f"interrupted {when}; resume with --restart {path}")
