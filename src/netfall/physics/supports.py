"""Supports: elastic ones, rotated axes, and moving ones.

An elastic support is a spring along each axis of a particle, in tension and compression:
f = k (d0 - d), with the displacement d, and d0 where the spring carries nothing: its reaction in the
form-found geometry over k; 0 without form finding. Its energy is k (d - d0)^2 / 2.

A support with axes rotated about z has a stiffness term between x and y (`geometry.turned`). If it is held
along a unit vector n in plan, forces lose their component along n, so that n.v stays 0. Both are in `turned`
of the particles, (n, 3): n_x, n_y, and the term between.

A moving support follows its course x(t). Its velocity from n to n + 1 is (x(n+1) - x(n)) / dt, so its
position is exact at each step. Mass-proportional damping acts on the velocity relative to the ground, taken
at the nearest support. With the mean velocity v of a velocity update and the ground velocity g,

    work of the damping     dt zeta M |v - g|^2
    work of the ground      on fixed axes  M (v(n+1/2)^2 - v(n-1/2)^2) / 2 - dt v.f
                            on free axes   - dt zeta M (v - g).g

Courses are cubic between the rows of their records. Several records may move a support, each with a delay.
"""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import lengths
from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import Record, f8, f8_2, f8_3, i8, is_present
from netfall.core.threads import each
from netfall.physics.fields import OTHER_WORKS, Particles


@kernel
def add_spring_forces(
    x: FloatArray,
    x_start: FloatArray,
    spring: FloatArray,
    d0: FloatArray,
    turned: FloatArray,
    f_int: FloatArray,
) -> None:
    """Add the forces of the springs (n, 3) [N/m] at x (n, 3) [m] to f_int (n, 3) [N]; d0 : (n, 3) [m].

    turned : (n, 3), absent if all axes are x, y and z
    """
    for p in each(0, f_int.shape[0]):  # f_int may have fewer rows than the other arrays
        for k in range(3):
            f_int[p, k] += spring[p, k] * (d0[p, k] - (x[p, k] - x_start[p, k]))
        if is_present(turned):
            f_int[p, 0] += turned[p, 2] * (d0[p, 1] - (x[p, 1] - x_start[p, 1]))
            f_int[p, 1] += turned[p, 2] * (d0[p, 0] - (x[p, 0] - x_start[p, 0]))


def project_on_guides(turned: Any, rows: Any) -> None:
    """Remove from vectors (k, 3) the components along the lines that guide the first k particles."""
    n = turned[: len(rows), :2]
    with np.errstate(invalid="ignore"):  # the caller notices forces that are not finite
        rows[:, :2] -= (n[:, 0] * rows[:, 0] + n[:, 1] * rows[:, 1])[:, None] * n


def largest_springs(spring: Any, turned: Any) -> np.ndarray:
    """Return an upper bound (n,) [N/m] of the spring stiffness (n, 3) in any direction; turned : or None."""
    return spring.max(1) if turned is None else spring.max(1) + np.abs(turned[:, 2])


def largest_residual(f: FloatArray, free: IntArray, n_owned: int) -> float:
    """Return the largest norm [N] of the force over free axes of owned particles; inf if nan occurs."""
    with np.errstate(over="ignore"):
        worst = float(lengths(np.where(free[:n_owned], f[:n_owned], 0.0)).max(initial=0.0))
    return worst if worst == worst else np.inf


class Ground(Record):
    """Courses of the ground, and work arrays for its position.

    time : (r,) [s], rows of all records, each from 0 on; first : (records + 1,) first row of each
    place : (r, 4, 3) [m, m/s, ...], coefficients of 1, s, s^2, s^3 from each row on
    parts : (courses + 1,) first part of each course; record, delay : (parts,) record of a part, and its delay
        [s]
    start : (courses, 3) [m/s], velocity before the first step
    held : (h,) local rows of particles with a fixed axis
    before, now, after, half, mean : (courses, 3) work arrays [m], [m/s]
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
def ground_displacements(time: float, ground: Ground, x: FloatArray) -> None:
    """Compute the ground displacement x (courses, 3) [m], out, at a time [s]."""
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
def move_ground(
    time: float, before_dt: float, after: float, zeta: float, ground: Ground, particles: Particles
) -> None:
    """Update `Particles.ground` for the step at a time [s].

    before_dt : [s] length of the step before; after : [s] time of the next one
    """
    dt = after - time
    ground_displacements(time, ground, ground.now)
    ground_displacements(after, ground, ground.after)
    if before_dt > 0.0:
        ground_displacements(time - before_dt, ground, ground.before)
    for c in range(ground.now.shape[0]):
        for k in range(3):
            velocity_after, velocity_before = (ground.after[c, k] - ground.now[c, k]) / dt, ground.start[c, k]
            if before_dt > 0.0:
                velocity_before = (ground.now[c, k] - ground.before[c, k]) / before_dt
            ground.half[c, k], ground.mean[c, k] = velocity_after, 0.5 * (velocity_before + velocity_after)
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


def start_with_ground(state: Any, ground: Ground) -> None:
    """Set the initial velocities: of the ground, if the whole ground has one; on held axes, of their courses.

    state : `state.State`

    The kinetic energy counts as work of the ground before the first step.
    """
    state.v[:] = ground.start[0] if len(ground.start) else 0.0
    for p in ground.held:
        parts = slice(*ground.parts[state.course[p] :][:2])
        first = ground.first[ground.record[parts][ground.delay[parts] == 0.0]]
        state.v[p] = np.where(state.free[p] == 0, ground.place[first, 1].sum(0), state.v[p])
    if state.other_work is not None:
        state.other_work[:, OTHER_WORKS.index("support")] = 0.5 * state.mass * np.sum(state.v**2, axis=1)
