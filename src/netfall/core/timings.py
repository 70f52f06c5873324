"""Time of a run: the stop flag, and the wall time of its phases."""

import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


class StopFlag:
    """Record of stop signals since construction, and of the deadline from a wall time [s], None: no limit."""

    def __init__(self, walltime: float | None = None, signals: Iterable[signal.Signals] = SIGNALS):
        self.deadline = None if walltime is None else time.monotonic() + walltime
        self.signal: str | None = None
        self.catch(*signals)

    def catch(self, *signals: signal.Signals) -> None:
        """Set the flag at these signals from now on."""
        for number in signals:
            signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.signal = signal.Signals(number).name

    @property
    def is_set(self) -> bool:
        """Whether this rank has received a stop signal or passed its deadline."""
        return self.signal is not None or (self.deadline is not None and time.monotonic() >= self.deadline)


NEVER_STOP = StopFlag(signals=())


class StopRequested(Exception):
    """Stop of the search for an equilibrium or a form because the flag is set, on every rank."""


STEP_PHASES = tuple(f"dynamics: {part}" for part in ("forces", "exchange", "positions", "rows"))


class PhaseTimes:
    """Wall time [s] of each phase of a run on this rank."""

    def __init__(self, steps: bool = False):
        """Start without times; steps : whether to time the parts of a step, at about 0.2 us per step."""
        self.seconds: dict[str, float] = {}
        self.of_steps = np.zeros(len(STEP_PHASES)) if steps else None  # filled by `explicit.loop.time_loop`

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the duration of a block to a named phase."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def over_ranks(self, comm: Any) -> dict[str, np.ndarray]:
        """Return the least, mean and largest time [s] over the ranks of each phase. Collective."""
        seconds = dict(self.seconds)
        if self.of_steps is not None:
            seconds |= dict(zip(STEP_PHASES, self.of_steps.tolist()))
        all_seconds = comm.allgather(seconds)
        return {
            name: np.array([f([other.get(name, 0.0) for other in all_seconds]) for f in (min, np.mean, max)])
            for name in seconds
        }
