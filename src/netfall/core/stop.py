"""Stop flag: set by a signal (SIGTERM, SIGINT, SIGUSR1) or by the end of the granted wall time."""

import signal
import time
from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


class StopFlag:
    """Record of stop signals since construction, and of the deadline from a wall time [s], None: no limit."""

    def __init__(self, walltime: float | None = None, catch: bool = True):
        self.deadline = None if walltime is None else time.monotonic() + walltime
        self.signal: str | None = None
        if catch:
            for number in SIGNALS:
                signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.signal = signal.Signals(number).name

    @property
    def wanted(self) -> bool:
        """Whether this rank has been asked to stop."""
        return self.signal is not None or (self.deadline is not None and time.monotonic() >= self.deadline)


NEVER_STOP = StopFlag(catch=False)
