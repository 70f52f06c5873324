"""Steps of a state on a GPU: the interface of `explicit.plan.StepPlan`.

The GPU computes steps and history rows. Everything else stays on the CPU: loads, snapshots, removals, output.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan
from netfall.explicit.sampling import Table
from netfall.gpu import messages
from netfall.gpu.kernels import DONE, EVENT_COUNT, MADE, PENDING, TABLE_ROWS, TRIAL
from netfall.gpu.memory import EVENTS, REST, TABLE
from netfall.gpu.stepper import Advance, Gpu, GpuNet
from netfall.gpu.target import cuda_module
from netfall.physics.fields import Features
from netfall.physics.state import State


def plan_maker(
    device: str,
    features: Features,
    ranks: int,
    say: Callable[[str], None],
    gpu: Gpu | None = None,
    advance: Advance | None = None,
) -> Callable[..., StepPlan]:
    """Return the function that makes the `StepPlan` of a problem.

    device : "cpu", "gpu", or "auto": a GPU if possible; say : receives a note
    gpu, advance : as in `GpuPlan`; None: a separate GPU

    Raises InputError if the GPU cannot step the problem.
    """
    if device == "cpu":
        return StepPlan
    present = {
        "more than one rank": ranks > 1,
        "cables that slide": features.sliding > 0,
        "chains that bend": features.bending,
        "moving supports": features.motion,
        "axial damping": bool(features.band),
    }
    lacking = ", ".join(name for name, is_present in present.items() if is_present)
    try:
        if lacking:
            raise InputError(messages.UNSUPPORTED(features=lacking))
        cuda_module()
    except InputError:
        if device == "gpu":
            raise
        say(messages.ON_CPU(reason=lacking or "no GPU can be used"))
        return StepPlan
    return partial(GpuPlan, gpu or Gpu(), advance)


class GpuPlan(StepPlan):
    """`StepPlan` with time steps on a GPU.

    The state is on the device or on the host. `collect` copies it to the host; it is copied back before the
    next steps. Only loads and counters are copied every time.
    """

    def __init__(self, gpu: Gpu, advance: Advance | None, state: State, *more: Any, **named: Any):
        """advance : advances the net by its order, together with others; None: immediately"""
        self._gpu, self.net = gpu, GpuNet()
        self._advance = advance or (lambda net: gpu.advance([net] if net else []))
        self._on_host = True
        super().__init__(state, *more, **named)

    def collect(self) -> None:
        """Bring the state to the host."""
        if not self._on_host:
            self.net.fetch(EVENTS, REST)
            work = self._works[False]
            work.chunks.has_yielded[:] = work.law.plastic  # elements follow from slots only where this is set
            self._on_host = True
        super().collect()

    def take_rows(self) -> Table:
        """Remove the rows so far from the table, and return them."""
        if not self._on_host:
            self.net.fetch(TABLE, TABLE)
        return super().take_rows()

    def logged_events(self) -> dict[str, np.ndarray]:
        """Return the entries in the log of fractures, by column."""
        if not self._on_host:
            self.net.fetch(EVENTS, EVENTS)
        return super().logged_events()

    def run_trial(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Run a trial, see `StepPlan.run_trial`; the device keeps the state before it."""
        self._made = self._works[False].rows.made.copy()
        done, tried, _ = self._steps(interval, seconds)
        return max(0, tried - 2) if tried else done

    def revert_trial(self) -> None:
        """Return to the start of the last trial."""
        self.net.revert()
        self._works[False].rows.made[:] = self._made

    def _steps(self, interval: Interval, seconds: np.ndarray | None) -> tuple[int, int, int]:
        """Compute an interval on the device, but a single row, and pending fractures, on the host."""
        if interval.row or interval.pending:
            self.collect()
            return super()._steps(interval, seconds)
        if interval.steps == 0:
            return 0, 0, 0
        work, net, order = self._works[False], self.net, self.net.order
        if self._on_host:
            while not self._gpu.upload(net, work):
                self._advance(None)
            self._on_host = False
        made, count = work.rows.made, self.events.count
        order[:] = 0
        order[: TRIAL + 1] = int(interval.first), int(interval.steps), interval.stride, interval.trial
        net.lengths = interval[2:7]
        self._advance(net)
        made[:], count[0] = (order[MADE], order[TABLE_ROWS]), order[EVENT_COUNT]
        return int(order[DONE]), int(order[PENDING]), 0
