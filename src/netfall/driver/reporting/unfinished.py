"""Warnings of events that have not ended, or not begun, at the end of the dynamic stage."""

from collections.abc import Iterator

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import lengths
from netfall.core.messages import count_of
from netfall.driver import messages
from netfall.job.derived import dynamic_settings, gust_ramp, has_growing_pressure, load_settings
from netfall.job.job import Job
from netfall.loads.base_motion import Motion
from netfall.loads.wind.field import gust_growth
from netfall.model.model import Model

WEAK_MOTION = 0.1  # share of the largest acceleration or velocity below which the rest of a record is weak
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
            delay, (ends, share) = motion.delay[reached].max(), _strong_motion(motion, record)
            to_come = share[ends + delay > duration].max(initial=0.0)
            words = f"up to {to_come:.0%} of its largest acceleration or velocity is still to come"
            words += f", and {count_of(late, 'support')} did not move yet" if late else ""
            yield f"[[motion]] {record + 1}", delay + ends.max(initial=0.0), words


def _strong_motion(motion: Motion, record: int) -> tuple[FloatArray, FloatArray]:
    """Return the ends (k,) [s] of the strong intervals of a record, and their shares (k,) of its peak.

    The value is the acceleration, or the velocity if the record is a table of displacements.
    """
    rows = slice(motion.first[record], motion.first[record + 1])
    time, place = motion.time[rows], motion.place[rows][:-1]
    start = 2.0 * place[:, 2]
    end = start + 6.0 * place[:, 3] * np.diff(time)[:, None]
    rate = np.maximum(lengths(start), lengths(end))
    rate = rate if rate.any() else lengths(place[:, 1])
    share = rate / (rate.max(initial=0.0) or 1.0)
    return time[1:][share > WEAK_MOTION], share[share > WEAK_MOTION]
