"""Progress on rank 0: a bar on a terminal (tqdm), sparse plain lines otherwise, nothing if quiet."""

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from netfall.core.errors import InputError
from netfall.core.launch import RANKS, launcher_variables
from netfall.core.messages import is_warning, warning_count

LINE_EVERY = 10.0  # [s] minimum time between plain lines
DRAW_EVERY = 0.2  # [s] minimum time between updates of the bar

# All control characters except tabs and new lines; also line, paragraph and text direction marks.
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def plain(text: InputError | str) -> str:
    """Return a text with control characters and text direction marks escaped."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), str(text))


def one_line(text: str) -> str:
    """Return a text escaped as by `plain`, in one line."""
    return plain(" ".join(str(text).split()))


def print_lines(*lines: Any, stream: Any = None) -> None:
    """Print lines, escaped as by `plain`, since they may contain names from jobs and tables."""
    for line in lines:
        print(plain(line), file=stream or sys.stdout, flush=True)


class Progress:
    """Messages and progress of a run. Ranks other than 0, and quiet runs, print nothing.

    If the reader disappears (closed pipe, lost terminal), it becomes quiet and the run continues.
    """

    def __init__(self, shown: bool, verbose: bool = False, stream: Any = None):
        self.shown, self.verbose = shown, verbose
        self.stream = stream or sys.stdout
        self.warnings: list[str] = []  # all warnings, printed or not
        self._terminal = _is_terminal(self.stream)
        self._bar: Any = None
        self.start()

    def say(self, *lines: str) -> None:
        """Print lines, and store the warnings among them."""
        self.warnings += filter(is_warning, lines)
        for line in lines if self.shown else ():
            self.end()
            self._print(line)

    def restore_warnings(self, warnings: list[str]) -> None:
        """Restore the warnings of an interrupted run, before the new warnings of this run."""
        self.warnings = list(dict.fromkeys([*warnings, *self.warnings]))

    def say_warning_count(self) -> None:
        """Print the number of warnings so far, with their codes."""
        self.say(warning_count(self.warnings))

    def verbose_message(self, text: str) -> None:
        """Print a line if the run is verbose."""
        if self.verbose:
            self.say(text)

    def start(self, share: float = 0.0, count: int = 0) -> None:
        """Start or resume a stage at a share and a count, from which rate and remaining time are computed."""
        self.end()
        self._begun = (share, count)
        self._started = self._last = time.perf_counter()
        self._percent = -100.0

    def at(self, share: float, done: str, count: int, unit: str, note: str, even: bool = True) -> None:
        """Show the progress of a stage.

        share : of the stage, 0 to 1; done : "t = 1.2 s"; count : of `unit` so far, for the rate
        note : slack and broken; even : whether the time per share is constant, so that the remaining time can
        be estimated
        """
        if not self.shown:
            return
        now = time.perf_counter()
        passed = now - self._started
        done_share, done_count = share - self._begun[0], count - self._begun[1]
        remaining = passed * (1 - share) / done_share if done_share > 0 else float("nan")
        rate = f"{done_count / max(passed, 1e-9):.3g} {unit}/s"
        text = f"{done}  {rate}  {f'left {_duration(remaining)}  ' if even else ''}{note}"
        if self._terminal:
            with self._quiet_on_error():
                self._draw(now, share, text)
        elif (now - self._last >= LINE_EVERY and 100 * share - self._percent >= 5) or share >= 1.0:
            self._print(f"{100 * share:3.0f} %  {text}")
            self._last, self._percent = now, 100 * share

    def show_task(self, text: str) -> None:
        """Show the present task, whose duration is unknown."""
        if not self.shown:
            return
        now = time.perf_counter()
        if self._terminal:
            with self._quiet_on_error():
                self._draw(now, self._bar.n / 100.0 if self._bar else 0.0, text)
        elif now - self._last >= LINE_EVERY:
            self._print(text)
            self._last = now

    def end(self) -> None:
        """Close the bar, if there is one."""
        if self._bar is not None:
            with self._quiet_on_error():
                self._bar.close()
            self._bar = None

    def _print(self, text: str) -> None:
        with self._quiet_on_error():
            print_lines(text, stream=self.stream)

    def _draw(self, now: float, share: float, text: str) -> None:
        """Update the bar if DRAW_EVERY has passed."""
        if self._bar is None:
            from tqdm import tqdm  # imported here: it takes 0.04 s, which runs without a terminal save

            how = "{percentage:3.0f} % |{bar}| {desc}"
            self._bar = tqdm(total=100, file=self.stream, bar_format=how, leave=True)
        if now - self._last >= DRAW_EVERY or share >= 1.0:
            self._bar.n = 100 * share
            self._bar.set_description_str(plain(text))
            self._last = now

    @contextmanager
    def _quiet_on_error(self) -> Iterator[None]:
        """Become quiet if writing fails because the reader has gone."""
        try:
            yield
        except OSError:
            self.shown, self.verbose, self._bar = False, False, None
            redirect_to_null(self.stream)


def redirect_to_null(stream: Any) -> None:
    """Redirect a stream to the null device, so that a flush at exit cannot fail."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _is_terminal(stream: Any) -> bool:
    """Return whether the stream is a terminal with a user.

    Under mpirun every rank's stream is a pseudo-terminal of mpirun, so the stream of mpirun itself is
    checked.
    """
    if not stream.isatty():
        return False
    if not launcher_variables(RANKS):
        return True
    try:
        return os.readlink(f"/proc/{os.getppid()}/fd/1").startswith(("/dev/pts/", "/dev/tty"))
    except OSError:
        return False


def _duration(seconds: float) -> str:
    if not seconds < 1e9:
        return "?"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
