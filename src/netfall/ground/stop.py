"""The wish to stop early: a signal (SIGTERM, SIGINT, SIGUSR1) or the end of the wall time granted."""

import signal
import time

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


class StopRequest:
    """Notes signals from here on, and the wall time [s] that is left, None for no limit."""

    def __init__(self, walltime: float | None = None, catch: bool = True):
        self.deadline = None if walltime is None else time.monotonic() + walltime
        self.signal = None
        if catch:
            for number in SIGNALS:
                signal.signal(number, self._note)

    def _note(self, number, frame):
        self.signal = signal.Signals(number).name

    @property
    def wanted(self) -> bool:
        """Whether this rank has been asked to stop."""
        return self.signal is not None or (self.deadline is not None and time.monotonic() >= self.deadline)


NEVER = StopRequest(catch=False)
