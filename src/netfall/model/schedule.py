"""Time step of the dynamic stage, its limits, and the step numbers of output and checkpoints."""

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from netfall.core.arrays import FloatArray, IntArray, padded_copy
from netfall.core.errors import InputError
from netfall.core.messages import count_of
from netfall.job.job import Job
from netfall.model import messages
from netfall.model.model import Model
from netfall.physics.bending import add_joint_bounds
from netfall.physics.fields import Features
from netfall.physics.law.branches import branch_stiffening
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.slip.law import SlipFollowers, slip_followers, slip_step_limit
from netfall.physics.stability import Limit, after_fracture_limit, any_shape_limits

STEP_ROUNDING = 1e-9  # in steps: a time this close to a step counts as this step
# relative rounding of time / step; exceeds STEP_ROUNDING in long runs
QUOTIENT_ROUNDING = 4.0 * np.finfo(float).eps
# factor on the joint bounds of the initial state that covers angles up to half a radian
JOINT_ROTATION_FACTOR = 1.5
# Smallest number of short steps per long step if elements can break. A fracture excites the highest
# frequencies of the net. Their energy grows by 5e-3 with the long step, and by 5e-4 with a third of it.
MIN_FRACTURE_SUBSTEPS = 3
MOST_STEPS = 1e12  # more steps take weeks even for the smallest net


def step_at(times: FloatArray | float, dt: float) -> Any:
    """Return the numbers of the first steps of length dt [s] at or after the times [s], as whole floats."""
    steps = times / dt
    return np.ceil(steps - np.maximum(STEP_ROUNDING, QUOTIENT_ROUNDING * steps))


@final
@dataclass(frozen=True)
class Schedule:
    """Steps, counted in short steps of dt [s], and the numbers of the steps of output and checkpoints.

    stride : number of short steps in one long step, which the net takes until an element breaks; output and
    checkpoints are at multiples of it
    stable_dt : [s], step that fragments need, divided by the safety factor
    margin : share of the step limit in the current state of the net that the long step may use
    """

    dt: float
    steps: int
    stride: int
    history: np.ndarray
    frames: np.ndarray
    checkpoints: np.ndarray
    stable_dt: float
    margin: float

    @property
    def long_dt(self) -> float:
        """[s], step until an element breaks."""
        return self.stride * self.dt

    def step_at(self, time: float) -> Any:
        """Return the first step at or after a time [s] at which output is possible."""
        return self.stride * int(step_at(time, self.long_dt))


def make_schedule(limit: float, intact: float, breaks: bool, dynamics: Any, output: Any) -> Schedule:
    """Build the schedule of a job, with the given step or, for "auto", the largest step that fits.

    The interval of the history rows is a multiple of the largest step. If the duration is not a multiple of
    the interval, the duration is a multiple of the step, and rows are up to one step late.

    limit, intact : [s], limit of the step in any state, and until an element breaks
    breaks : whether any element can break
    """
    stride = needed = 1
    if dynamics.time_step == "auto":
        most_short_steps = choose_stride(intact / limit)
        every = min(output.history_interval, dynamics.duration)
        longest = dynamics.safety * min(intact, most_short_steps * limit)
        rows = dynamics.duration / every
        if abs(rows - round(rows)) > STEP_ROUNDING * rows:
            every, longest = dynamics.duration, min(every, longest)
        long = every / max(1.0, np.ceil(every / longest - STEP_ROUNDING))
        needed = max(1, int(np.ceil(long / (dynamics.safety * limit) - STEP_ROUNDING)))
        stride = max(needed, MIN_FRACTURE_SUBSTEPS) if breaks else needed
    else:
        long = dynamics.time_step
    steps = max(1, int(step_at(dynamics.duration, long)))
    row_count = int(np.floor(steps * long / output.history_interval + STEP_ROUNDING)) + 1
    rows = np.arange(row_count) * output.history_interval
    frames = np.linspace(0.0, steps * long, output.frames + 1)

    def steps_of(times: FloatArray) -> IntArray:
        return np.unique(np.append(np.minimum(step_at(times, long), steps), steps)).astype(np.int64)

    every = output.checkpoint_interval
    checkpoints = np.arange(1, int(np.floor(steps * long / every)) + 1) * every if every > 0 else np.zeros(0)
    checkpoints, dt = step_at(checkpoints, long).astype(np.int64), float(long) / stride
    history, shown, saved = (
        stride * numbers for numbers in (steps_of(rows), steps_of(frames), checkpoints[checkpoints < steps])
    )
    stable_dt, margin = float(min(long / needed / dynamics.safety, limit)), 0.5 * (1.0 + dynamics.safety)
    return Schedule(dt, stride * steps, stride, history, shown, saved, stable_dt, margin)


def describe_steps(schedule: Schedule) -> str:
    """Describe the number of steps and their length in a message."""
    line = f"{count_of(schedule.steps // schedule.stride, 'step')} of {schedule.long_dt:.4g} s"
    return line + (f", of {schedule.dt:.4g} s where elements break" if schedule.stride > 1 else "")


def choose_stride(ratio: float) -> int:
    """Return the number of fragment steps in one step of the intact net, whose limit is `ratio` times theirs.

    At least one of the two steps is shorter than its limit. The choice keeps both as long as possible.
    """
    if not np.isfinite(ratio):
        return 1
    whole = max(1, int(ratio + STEP_ROUNDING))
    return whole if ratio * ratio <= whole * (whole + 1) else whole + 1


def step_limits(model: Model, features: Features, fragment_mass: float) -> dict[str, Limit]:
    """Compute the limits of the explicit step that hold in any state of the net, by name. Rank 0."""
    present, mass = model.net.is_there, model.own_mass
    elements, L0, EA = (column[present] for column in (model.net.elements, model.L0, model.net.EA))
    EA = EA * branch_stiffening(features.band) if features.band else EA
    moves, support = model.net.moves, model.net.support
    rows, chains = np.flatnonzero(present), None
    if model.joints is not None:
        joint_bounds = np.zeros(model.net.n)  # with a margin for growing angles
        add_joint_bounds(padded_copy(model.x), model.joints, JOINT_ROTATION_FACTOR, joint_bounds)
        support = support + joint_bounds
        chains = model.joints.particles, np.searchsorted(rows, model.layout.chains.elements[:, 0])
    limits = any_shape_limits(elements, EA, L0, mass, moves, model.net.bar[present], support, chains)
    if features.fracture and features.fragments:
        k, half, eps_u = largest_stiffness(EA, L0), model.half_mass + model.half_ice, model.eps_u[present]
        limits.append(
            after_fracture_limit(elements, k, half[present], mass, ~moves, eps_u, support, fragment_mass)
        )
    if features.sliding:  # step up to which the inertia added for slip is a small share of the moving mass
        movers = slip_movers(model)
        fastest = int(np.argmax(movers.stiffness / movers.own))
        limits.append(Limit("slip", slip_step_limit(movers), int(model.layout.slides.before[fastest])))
    return {
        limit.name: replace(limit, element=int(rows[limit.element]) if limit.element >= 0 else -1)
        for limit in limits
    }


def slip_movers(model: Model) -> SlipFollowers:
    """Return the masses and stiffnesses that move with the slips of a model."""
    slides, net = model.layout.slides, model.net
    EA = np.where(net.is_there, net.EA, 0.0)
    own, stiffness = slides.sides(model.half_mass, 0), slides.sides(largest_stiffness(EA, model.L0), 2)
    # elements removed in an erection stage do not move, so their mass is irrelevant
    own, mass = (np.where(values > 0.0, values, 1.0) for values in (own, model.own_mass))
    return slip_followers(slides, net.elements, model.x, net.fixed, mass, own, stiffness)


def governing_limit(limits: dict[str, Limit], automatic: bool, intact: bool = False) -> Limit:
    """Return the limit that governs the step in any state; intact : until an element breaks

    The limits for slack cables and for slips count only if netfall chooses the step.
    """
    excluded = ["after_fracture"] * intact + ["slackening", "slip"] * (not automatic)
    return min((limit for limit in limits.values() if limit.name not in excluded), key=lambda limit: limit.dt)


def schedule_job(job: Job, limits: dict[str, Limit], model: Model) -> Schedule:
    """Build the schedule of the dynamic stage. Raises InputError for an unstable fixed step. Rank 0."""
    path, given_dt, duration = job.path, job.dynamics.time_step, job.dynamics.duration
    automatic = not isinstance(given_dt, float)
    limit = governing_limit(limits, automatic)
    dt = given_dt if isinstance(given_dt, float) else job.dynamics.safety * limit.dt
    if not automatic and dt > limit.dt:
        raise unstable_step_error(job, dt, limit, model)
    if not automatic and dt > duration:
        raise InputError(messages.STEP_ABOVE_DURATION(path=path, step=dt, duration=duration))
    if not np.isfinite(limit.dt):
        raise InputError(messages.NOTHING_MOVES(path=path))
    if (steps := duration / dt) > MOST_STEPS:
        raise InputError(
            messages.TOO_MANY_STEPS(path=path, duration=duration, steps=steps, step=dt, most=MOST_STEPS)
        )
    intact, breaks = governing_limit(limits, automatic, True).dt, bool(np.isfinite(model.eps_u).any())
    return make_schedule(limit.dt, intact, breaks, job.dynamics, job.output)


def unstable_step_error(job: Job, dt: float, limit: Limit, model: Model) -> InputError:
    """Return the error for a fixed step above its limit."""
    is_intact = limit.name == "any_shape"
    message = messages.UNSTABLE_STEP if is_intact else messages.UNSTABLE_STEP_AFTER_FRACTURE
    element = model.element_name(limit.element)
    return InputError(message(path=job.path, step=dt, limit=limit.dt, element=element))
