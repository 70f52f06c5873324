"""Air that a roof feels as it moves: damping along its normal, and air that moves with it.

A surface that moves with v_n along its normal n turns the relative wind by v_n / U, so the wind's pressure
changes by kappa rho U v_n, kappa half the slope of the normal force coefficient over the angle of attack.
With a vector area A and c = sqrt(kappa rho |A|) n the force on a particle is

    f = -|U| c (c.v),     v = (v(n-1/2) + v(n+1/2)) / 2

implicit in the mean velocity, and so stable at any step. The size of U counts: a gust may turn the wind
round, and damping never feeds energy. Air that moves with the surface is inertia without weight, on which the
mass-proportional damping does not act.

Both are parts of the total force on a particle, which its owner sends; so halo copies know of neither.

A part of the net that is cut free flies in the wind. With its surface A the force on a particle of it is

    f = 1/2 rho A |w| w,     w = u - v

with the wind velocity u at its place in the net as it starts. It is external, and so is its work.
"""

import math

import numpy as np

from netfall.core.kernels import inner_kernel
from netfall.core.records import Record, f8, has, i8, real
from netfall.mechanics.loads import wind_speed
from netfall.mechanics.motion import inverse_mass


@inner_kernel
def set_air(kick_dt, zeta, particles):
    """Write |U| / (1 + h + a) of `step.motion.add_air_damping`, signed as U, at both samples; kick_dt : [s].

    Between them it is linear in time, as U is: that is the implicit damping of a speed between theirs, and so
    stable too. How far it is off stands in jobs/METHOD.md.
    """
    pull = particles.air_pull
    for p in range(np.uint64(particles.per_mass.shape[0])):
        half = 0.5 * kick_dt * particles.per_mass[p]
        damped = 1.0 + half * zeta * damped_mass(p, particles)
        cx, cy, cz = particles.air[0, p], particles.air[1, p], particles.air[2, p]
        square, first, last = half * (cx * cx + cy * cy + cz * cz), 1.0, 1.0
        if not has(particles.tapped):  # else it is in c
            first, last = particles.speed_before[p], particles.speed_after[p]
        pull[0, p] = first / (damped + square * abs(first))
        pull[1, p] = last / (damped + square * abs(last))


class RelativeWind(Record):
    """The particles on which the relative wind acts, and what it needs of them.

    rows : (k,) local; size : (k,) [kg/m] rho A / 2; steady : (k,) [m/s] mean wind speed, absent: the gusts
    along_x, along_y : horizontal direction of the wind, of length 1
    """

    rows: i8
    size: f8
    steady: f8
    along_x: real
    along_y: real


@inner_kernel
def set_drag(kick_dt, share, relative, particles):
    """Write the drag [N] that acts in a kick; kick_dt [s], share : of `audit.observe`.

    Alone it changes w by M dw/dt = -k |w| w, k = rho A / 2, which turns w into w / (1 + b) in a time dt,
    b = k |w| dt / M. The force k |w| w / (1 + b) does the same in one kick. So the drag carries no particle
    past the wind, however long the step is.
    """
    v, drag = particles.v, particles.drag
    for i in range(relative.rows.shape[0]):
        p = relative.rows[i]
        speed = relative.steady[i] if has(relative.steady) else wind_speed(p, particles, share)
        wx, wy, wz = speed * relative.along_x - v[0, p], speed * relative.along_y - v[1, p], -v[2, p]
        k = relative.size[i] * math.sqrt(wx * wx + wy * wy + wz * wz)
        k /= 1.0 + k * kick_dt * particles.per_mass[p]
        drag[0, p], drag[1, p], drag[2, p] = k * wx, k * wy, k * wz


@inner_kernel
def damped_mass(p, particles):
    """Mass [kg] of particle p on which the mass-proportional damping acts."""
    if not has(particles.air_mass):
        return particles.mass[p]
    return particles.mass[p] - particles.air_mass[p]


@inner_kernel
def lose_air(p, particles):
    """Particle p, which has lost its wind, feels no air any more; what moved with it moves on without it.

    The kinetic energy [J] of that air counts as negative external work.
    """
    if has(particles.air):
        particles.air[0, p] = particles.air[1, p] = particles.air[2, p] = 0.0
    if has(particles.air_mass):
        mass, v = particles.air_mass[p], particles.v
        if has(particles.work):
            square = v[0, p] * v[0, p] + v[1, p] * v[1, p] + v[2, p] * v[2, p]
            particles.work[0, p] -= 0.5 * mass * square
        particles.air_mass[p] = 0.0
        particles.mass[p] -= mass
        if particles.per_mass[p] != 0.0:
            particles.per_mass[p] = inverse_mass(particles.mass[p])


def end_wind(state, rows=slice(None)) -> None:
    """End the wind's pressure on particles, local rows (k,) or all, and take their air; as `lose_air`.

    state : `state.State`
    """
    state.wind[rows] = 0.0
    if state.air is not None:
        state.air[rows] = 0.0
    if state.air_mass is not None:
        if state.work is not None:
            state.work[rows, 0] -= 0.5 * state.air_mass[rows] * np.sum(state.v[rows] ** 2, axis=1)
        state.mass[rows] -= state.air_mass[rows]
        state.air_mass[rows] = 0.0
        state.invert_masses()


def take_air(state, p: int, vector: np.ndarray, mass: float) -> None:
    """Take some of what particle p feels of the air off it, with its kinetic energy; as `lose_air`.

    vector : (3,) [kg/m], kappa rho A; mass : [kg], all that is left if less is there
    """
    if state.air is not None:
        left = squared(state.air[p]) - vector
        state.air[p] = rooted(np.where(state.free[p] != 0, left, 0.0))
    if state.air_mass is not None:
        mass = min(mass, state.air_mass[p])
        if state.work is not None:
            state.work[p, 0] -= 0.5 * mass * float(np.sum(state.v[p] ** 2))
        state.air_mass[p] -= mass
        state.mass[p] -= mass


def rooted(vector: np.ndarray) -> np.ndarray:
    """c (n, 3) of vectors kappa rho A (n, 3) [kg/m], which may be added."""
    size = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    return np.divide(vector, np.sqrt(size), out=np.zeros_like(vector), where=size > 0.0)


def squared(c: np.ndarray) -> np.ndarray:
    """kappa rho A (n, 3) [kg/m] of vectors c (n, 3): the inverse of `rooted`."""
    return c * np.sqrt(np.sum(c * c, axis=-1, keepdims=True))
