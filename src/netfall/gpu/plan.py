"""Steps of a state on a GPU: the interface of `explicit.plan.StepPlan`.

The GPU computes steps and history rows. Everything else stays on the CPU: loads, snapshots, removals, output.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan
from netfall.explicit.sampling import Table
from netfall.gpu import messages
from netfall.gpu.kernels import DONE, MADE, PENDING, TABLE_ROWS
from netfall.gpu.kernels import EVENTS as EVENT_COUNT
from netfall.gpu.layout import EVENTS, TABLE
from netfall.gpu.stepper import Advance, Gpu, GpuNet
from netfall.gpu.target import cuda_module
from netfall.physics.fields import Features
from netfall.physics.state import State


def unsupported(features: Features, ranks: int) -> list[str]:
    """Return the features of a problem that a GPU does not support, as text for a message."""
    features_present = {
        "more than one rank": ranks > 1,
        "cables that slide": features.sliding > 0,
        "chains that bend": features.bending,
        "moving supports": features.motion,
        "axial damping": bool(features.band),
    }
    return [name for name, is_present in features_present.items() if is_present]


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
    lacking = ", ".join(unsupported(features, ranks))
    try:
        if lacking:
            raise InputError(messages.UNSUPPORTED(features=lacking))
        cuda_module()
    except InputError:
        if device == "gpu":
            raise
        say(messages.ON_CPU(reason=lacking or "no GPU can be used"))
        return StepPlan
    own_or_shared = gpu or Gpu()

    def make_plan(*given: Any, **named: Any) -> StepPlan:
        plan = GpuPlan(own_or_shared, advance, *given, **named)
        if device == "gpu" or plan.fits:
            return plan
        say(messages.ON_CPU(reason="the net does not fit the memory of the GPU"))
        return StepPlan(*given, **named)

    return make_plan


class GpuPlan(StepPlan):
    """`StepPlan` with time steps on a GPU.

    The state is on the device or on the host. `collect` copies it to the host; it is copied back before the
    next steps. Only loads, and counters that the host needs after each launch, are copied every time.
    """

    def __init__(self, gpu: Gpu, advance: Advance | None, state: State, *more: Any, **named: Any):
        """advance : advances the net by its order, together with others; None: immediately"""
        self._gpu, self.net = gpu, GpuNet()
        self._advance = advance or (lambda net: gpu.advance([net] if net else []))
        self._on_host, self._reverts = True, False
        state.number_slots()
        if gpu.count > 1:  # nets can share arrays if all need the same memory
            named["capacity"] = state.m
        super().__init__(state, *more, **named)

    @property
    def fits(self) -> bool:
        """Whether the net fits the memory of the GPU, at least without other nets."""
        return self._gpu.could_hold(self._works[False])

    def collect(self) -> None:
        """Bring the state to the host."""
        if not self._on_host:
            if self._reverts:
                self._launch(Interval(0, 0, 0.0, 0.0, 0.0, 0.0, 1.0))
            self._fetch()
            work = self._works[False]
            work.chunks.has_yielded[:] = work.law.plastic  # elements follow from slots only where this is set
            self._on_host = True
        super().collect()

    def take_rows(self) -> Table:
        """Remove the rows so far from the table, and return them."""
        self._fetch(TABLE)
        return super().take_rows()

    def logged_events(self) -> dict[str, np.ndarray]:
        """Return the entries in the log of fractures, by column."""
        self._fetch(EVENTS)
        return super().logged_events()

    def _fetch(self, prefix: str = "") -> None:
        """Copy arrays with paths that start with `prefix` from the device, if the state is there."""
        if not self._on_host and self.net.arrays is not None:
            self.net.arrays.fetch(self.net.place, self._works[False], prefix)

    def run_trial(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Run a trial, see `StepPlan.run_trial`; the device keeps the state before it."""
        self._made = self._works[False].rows.made.copy()
        done, tried, _ = self._steps(interval, seconds)
        return max(0, tried - 2) if tried else done

    def revert_trial(self) -> None:
        """Return to the start of the last trial, in the next launch."""
        self._reverts = True
        self._works[False].rows.made[:] = self._made

    def _steps(self, interval: Interval, seconds: np.ndarray | None) -> tuple[int, int, int]:
        """Compute an interval on the device, but a single row, and pending fractures, on the host."""
        if interval.row or interval.pending:
            self.collect()
            return super()._steps(interval, seconds)
        if interval.steps == 0:
            return 0, 0, 0
        order = self._launch(interval)
        return int(order[DONE]), int(order[PENDING]), 0

    def _launch(self, interval: Interval) -> np.ndarray:
        """Send an order to the device, and copy the counters."""
        work, order = self._works[False], self.net.order
        if self._on_host:
            while not self._gpu.upload(self.net, work):
                self._advance(None)
            self._on_host = False
        made, count = work.rows.made, self.events.count
        steps = int(interval.first), int(interval.steps), interval.stride, interval.trial
        order[:] = self.net.place, self._reverts, *made, self.event_count, *steps, 0, 0
        self.net.lengths = interval[2:7]
        self._advance(self.net)
        self._reverts = False
        made[:], count[0] = (order[MADE], order[TABLE_ROWS]), order[EVENT_COUNT]
        return order
