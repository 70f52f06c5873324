"""Warnings of events that have not ended, or not begun, at the end of the dynamic stage."""

from collections.abc import Iterator

import numpy as np

from netfall.driver import messages
from netfall.job.derived import dynamic_settings, gust_ramp, has_growing_pressure, load_settings
from netfall.job.job import Job
from netfall.loads.wind.field import gust_growth
from netfall.model.model import Model

DURATION_ROUNDING = 1e-9  # share of the duration by which an event may end later without a warning


def unfinished_warnings(job: Job, model: Model) -> Iterator[str]:
    """Yield a warning for each event that ends after the dynamic stage."""
    duration = dynamic_settings(job).duration
    for place, end, state in _events(job, model, duration):
        if end > (1.0 + DURATION_ROUNDING) * duration:
            yield messages.EVENT_UNFINISHED(place=place, end=end, duration=duration, state=state)


def _events(job: Job, model: Model, duration: float) -> Iterator[tuple[str, float, str]]:
    """Yield the place in the job, end [s], state at the end of the stage, duration [s], of each event."""
    if model.wind_field and model.wind_field.varies:
        ramp = gust_ramp(job)
        yield "[wind] ramp", ramp, f"gusts have {gust_growth(duration, ramp):.1%} of their full size"
    if has_growing_pressure(job):
        ramp = load_settings(job).ramp
        yield "[load] ramp", ramp, f"{duration / ramp:.1%} of the pressure acts"
    for number, entry in enumerate(job.removes, 1):
        if entry.time < duration and entry.duration:
            end = entry.time + entry.duration
            share = (end - duration) / entry.duration
            yield f"[[remove]] {number}", end, f"{share:.1%} of the removed tension still acts"
    if (motion := model.motion) is not None:
        supports = motion.course[model.net.fixed.any(1)]
        course = np.repeat(np.arange(len(motion.start)), np.diff(motion.parts))
        for record in np.unique(motion.record):
            reached = motion.record == record
            late = np.isin(supports, course[reached & (motion.delay >= duration)]).sum()
            yield (
                f"[[motion]] {record + 1}, travelling wave",
                motion.delay[reached].max(),
                f"supports that do not move yet: {late}",
            )
