"""Steps of a state on a GPU: the interface of `explicit.plan.StepPlan`.

Everything but the steps stays on the CPU: history rows, snapshots, removals, output. So the arrays of the
state go to the device before the steps to the next history row, and come back after them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan
from netfall.explicit.sampling import Rows
from netfall.gpu import messages
from netfall.gpu.stepper import Stepper
from netfall.gpu.target import cuda_module
from netfall.physics.fields import Features

NEVER = 1 << 62  # steps


def unsupported(features: Features, ranks: int) -> list[str]:
    """Return what of a problem a GPU does not step, as text for a message."""
    features_present = {
        "more than one rank": ranks > 1,
        "cables that slide": features.sliding > 0,
        "chains that bend": features.bending,
        "moving supports": features.motion,
        "axial damping": bool(features.band),
    }
    return [name for name, is_present in features_present.items() if is_present]


def steps_on_gpu(device: str, features: Features, ranks: int, say: Callable[[str], None]) -> bool:
    """Return whether a GPU steps a problem; device : "gpu", or "auto": if it can. say : takes a note

    Raises InputError if it cannot.
    """
    reasons, lacking = [], unsupported(features, ranks)
    if lacking:
        reasons.append(messages.UNSUPPORTED(features=", ".join(lacking)))
    else:
        try:
            cuda_module()
        except InputError as error:
            reasons += error.lines
    if reasons and device == "gpu":
        raise InputError(reasons)
    if reasons:
        say(messages.ON_CPU(reason=", ".join(lacking) or "no GPU can be used"))
    return not reasons


class GpuPlan(StepPlan):
    """`StepPlan` whose steps a GPU computes."""

    def __init__(self, *arguments: Any, **named: Any):
        self._stepper = Stepper()
        super().__init__(*arguments, **named)

    def _steps(self, interval: Interval, seconds: np.ndarray | None) -> tuple[int, int, int]:
        """Compute an interval on the device, and its history rows on the CPU between the steps."""
        if interval.row or interval.pending:
            return super()._steps(interval, seconds)
        work, done, pending = self._works[False], 0, 0
        while done < interval.steps and not pending:
            first = interval.first + done
            rest = interval._replace(first=first, before_dt=interval.dt if done else interval.before_dt)
            super()._steps(rest._replace(steps=0, trial=False, row=True), seconds)
            steps = min(interval.steps - done, steps_to_row(first, interval.stride, work.rows))
            advanced, pending = self._stepper.run(rest._replace(steps=steps), work)
            if pending and interval.trial:
                return interval.steps, done + pending, 0  # the state is reverted, whatever follows
            done += advanced
        return done, pending, 0


def steps_to_row(first: int, stride: int, rows: Rows) -> int:
    """Return the number of steps from step `first` to the next at which a row or the envelope is due."""
    number, made = first * stride, int(rows.made[0])
    to_envelope = -(-(int(rows.last[0]) + rows.every - number) // stride)
    to_row = NEVER
    if made < len(rows.due) and (int(rows.due[made]) - number) % stride == 0:
        to_row = (int(rows.due[made]) - number) // stride
    return max(1, min(to_row, to_envelope))
