"""Supports that move: the place and the velocity of the ground in time, and what it does to particles.

A support follows its course x(t): its velocity from n to n + 1 is (x(n+1) - x(n)) / dt, so it is where it has
to be at each step. Mass-proportional damping acts on the velocity against the ground below, that of the
nearest support. With the mean velocity v of a kick and that of the ground, g,

    work of the damping     dt zeta M |v - g|^2
    work of the ground      M (v(n+1/2)^2 - v(n-1/2)^2) / 2 - dt v.f  where held;  - dt zeta M (v - g).g  else

Courses are cubic between the rows of their records; several records may move a support, each with a delay.
"""

import numpy as np

from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import Record, f8, f8_2, f8_3, i8
from netfall.mechanics.fields import OTHER_WORKS


class Ground(Record):
    """The courses of the ground, and room for where they are.

    time : (r,) [s], rows of all records, each from 0 on; first : (records + 1,) first row of each
    place : (r, 4, 3) [m, m/s, ...], coefficients of 1, s, s^2, s^3 from each row on
    parts : (courses + 1,) first part of each course; record, delay : (parts,) what moves it, and when [s]
    start : (courses, 3) [m/s], velocity before the first step
    held : (h,) local rows of particles with an axis that is held
    before, now, after, half, mean : (courses, 3) room [m], [m/s]
    """

    time: f8
    first: i8
    place: f8_3
    parts: i8
    record: i8
    delay: f8
    start: f8_2
    held: i8
    before: f8_2
    now: f8_2
    after: f8_2
    half: f8_2
    mean: f8_2


@inner_kernel
def find_places(time, ground, x):
    """Displacement x (courses, 3) [m], out, of the ground at a time [s]."""
    for c in range(x.shape[0]):
        x[c, 0] = x[c, 1] = x[c, 2] = 0.0
        for part in range(ground.parts[c], ground.parts[c + 1]):
            s = time - ground.delay[part]
            if s <= 0.0:
                continue
            low, high = ground.first[ground.record[part]], ground.first[ground.record[part] + 1]
            while high - low > 1:  # time[low] <= s < time[high]
                middle = (low + high) // 2
                if ground.time[middle] <= s:
                    low = middle
                else:
                    high = middle
            s -= ground.time[low]
            for k in range(3):
                a = ground.place[low]
                x[c, k] += ((a[3, k] * s + a[2, k]) * s + a[1, k]) * s + a[0, k]


@kernel
def move_ground(time, before_dt, after, zeta, ground, particles):
    """Bring `particles.ground` to the step at a time [s].

    before_dt : [s] length of the step before; after : [s] time of the next one
    """
    dt = after - time
    find_places(time, ground, ground.now)
    find_places(after, ground, ground.after)
    if before_dt > 0.0:
        find_places(time - before_dt, ground, ground.before)
    for c in range(ground.now.shape[0]):
        for k in range(3):
            half, before = (ground.after[c, k] - ground.now[c, k]) / dt, ground.start[c, k]
            if before_dt > 0.0:
                before = (ground.now[c, k] - ground.before[c, k]) / before_dt
            ground.half[c, k], ground.mean[c, k] = half, 0.5 * (before + half)
    if zeta > 0.0:
        for p in range(particles.course.shape[0]):
            c = particles.course[p]
            if c >= 0:
                for k in range(3):
                    particles.ground[k, p] = ground.mean[c, k]
    for i in range(ground.held.shape[0]):
        p = ground.held[i]
        for k in range(3):
            if particles.free[k, p] == 0:
                particles.ground[k, p] = ground.half[particles.course[p], k]


def begin_with_ground(state, ground: Ground) -> None:
    """The net begins with the velocity of the ground, where all of that has one. state : `state.State`

    The kinetic energy is work of the ground before the first step.
    """
    state.v[:] = ground.start[0] if len(ground.start) else 0.0
    if state.other_work is not None:
        state.other_work[:, OTHER_WORKS.index("support")] = 0.5 * state.mass * np.sum(state.v**2, axis=1)
