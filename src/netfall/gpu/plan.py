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
from netfall.gpu.kernels import DONE, EVENT_COUNT, LENGTHS, MADE, PENDING, ROW, TABLE_ROWS
from netfall.gpu.memory import EVENTS, REST, TABLE, GpuNet
from netfall.gpu.stepper import Gpu
from netfall.gpu.target import cuda_module
from netfall.physics.fields import Features
from netfall.physics.state import State


def plan_maker(
    device: str,
    features: Features,
    ranks: int,
    say: Callable[[str], None],
    gpu: Gpu | None = None,
) -> Callable[..., StepPlan]:
    """Return the function that makes the `StepPlan` of a problem.

    device : "cpu", "gpu", or "auto": a GPU if possible; say : receives a note
    gpu : that other nets use too; None: none does

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
    return partial(GpuPlan, gpu or Gpu())


class GpuPlan(StepPlan):
    """`StepPlan` with time steps on a GPU.

    Only loads and counters are copied at each launch. `read` copies to the host what the device has changed
    since. After `collect` or `attach` the whole state is copied back before the next steps.
    """

    def __init__(self, gpu: Gpu, state: State, *more: Any, **named: Any):
        """gpu : that steps the state; further arguments as for `StepPlan`"""
        self._gpu, self.net = gpu, GpuNet()
        self._on_device = False  # whether the device has the state
        self._newer: set[int] = set()  # groups of arrays that only the device has
        super().__init__(state, *more, **named)

    def read(self, *arrays: np.ndarray) -> None:
        """Bring the count of rows and arrays of the state, or all arrays, to the host."""
        if REST in self._newer and arrays:
            for array in filter(np.size, (self.state.rows, *arrays)):
                self.net.fetch_array(array)
            return
        self._fetch(EVENTS, TABLE, REST)
        super().read()

    def collect(self) -> None:
        """Bring the state to the host, which may then change it."""
        super().collect()
        self._on_device = False

    def take_rows(self) -> Table:
        """Remove the rows so far from the table, and return them."""
        self._fetch(TABLE)
        return super().take_rows()

    def logged_events(self) -> dict[str, np.ndarray]:
        """Return the entries in the log of fractures, by column."""
        self._fetch(EVENTS)
        return super().logged_events()

    def _fetch(self, *groups: int) -> None:
        """Bring groups of arrays to the host if they are newer on the device."""
        for group in self._newer.intersection(groups):
            self.net.fetch(group)
        self._newer.difference_update(groups)

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
        """Compute an interval on the device; pending fractures, and a row of a state on the host, there."""
        if interval.pending or (interval.row and not self._on_device):
            self.collect()
            return super()._steps(interval, seconds)
        if interval.steps == 0 and not interval.row:
            return 0, 0, 0
        work, net, order = self._works[False], self.net, self.net.order
        if not self._on_device:
            work.chunks.has_yielded[:] = work.law.plastic  # elements follow from slots only where this is set
            self._gpu.upload(net, work)
            self._on_device = True
        made, count = work.rows.made, self.events.count
        order[:] = 0
        order[: ROW + 1] = interval.first, interval.steps, interval.stride, interval.trial, interval.row
        order[LENGTHS:] = np.array(interval[2:7]).view(np.int64)
        self._gpu.advance(net)
        changes = {TABLE: order[MADE] != made[0], EVENTS: order[EVENT_COUNT] != count[0], REST: True}
        self._newer.update(group for group, has_changed in changes.items() if has_changed)
        made[:], count[0] = (order[MADE], order[TABLE_ROWS]), order[EVENT_COUNT]
        return int(order[DONE]), int(order[PENDING]), 0
