"""Effects of the air on a moving roof: aerodynamic damping, added mass, and drag on detached parts.

A surface that moves with v_n along its normal n turns the relative wind by v_n / U. So the wind pressure
changes by kappa rho U v_n, where kappa is half the slope of the normal force coefficient over the angle of
attack. With a vector area A and c = sqrt(kappa rho |A|) n the force on a particle is

    f = -|U| c (c.v),     v = (v(n-1/2) + v(n+1/2)) / 2

It is implicit in the mean velocity, and so stable at any step. It uses the size of U, since a gust may
reverse the wind and damping never adds energy. The added mass of the air is inertia without weight; the
mass-proportional damping does not act on it.

Both are parts of the total force on a particle, which its owner sends; so halo copies do not store them.

A part of the net that is cut free flies in the wind. With its surface A the drag on one of its particles is

    f = 1/2 rho A |w| w,     w = u - v

with the wind velocity u at its initial position in the net. Drag is an external force and does external work.
"""

import math
from typing import Any

import numpy as np

from netfall.core.arrays import Integer
from netfall.core.kernels import inner_kernel, part_of_kernel, routine
from netfall.core.records import Record, f8, i8, is_present, real, whole
from netfall.core.threads import each, meet
from netfall.physics.fields import Particles
from netfall.physics.particle_step import inverse_mass


@inner_kernel
def wind_speed(p: Integer, particles: Particles, share: float) -> float:
    """Return the wind speed [m/s] at particle p, or the pressure [N/m2].

    share : position between the two samples that `driver.dynamics.varying_loads` gives, 0 to 1
    """
    return particles.speed_before[p] + share * (particles.speed_after[p] - particles.speed_before[p])


@part_of_kernel
def set_air_damping_at(p: Integer, dt_v: float, zeta: float, particles: Particles) -> None:
    """Write the factors U / (1 + h + a) of `explicit.motion.add_air_damping` at both samples.

    Between the samples it is linear in time, as U is. This equals implicit damping for some speed between
    those of the samples, and so is stable too. Its relative error is at most b (dU / U)^2 / 4, with
    b = kappa rho U A dt / 2M. dt_v : [s] length of the velocity update
    """
    damping = particles.air_pull
    half_dt_per_mass = 0.5 * dt_v * particles.per_mass[p]
    damped = 1.0 + half_dt_per_mass * zeta * damped_mass(p, particles)
    square, speed_before, speed_after = 0.0, 1.0, 1.0
    for k in range(3):
        if particles.free[k, p]:
            square += particles.air[k, p] * particles.air[k, p]
    square = half_dt_per_mass * square
    if not is_present(particles.tapped):  # with pressures, c includes the speed
        speed_before, speed_after = particles.speed_before[p], particles.speed_after[p]
    damping[0, p] = speed_before / (damped + square * abs(speed_before))
    damping[1, p] = speed_after / (damped + square * abs(speed_after))


class RelativeWind(Record):
    """Particles on which the relative wind acts, and the data for their drag.

    rows : (k,) local; size : (k,) [kg/m] rho A / 2; steady : (k,) [m/s] mean wind speed, absent: the gusts
    along_x, along_y : horizontal direction of the wind, of length 1
    """

    rows: i8
    size: f8
    steady: f8
    along_x: real
    along_y: real


@part_of_kernel
def set_drag_at(i: Integer, dt_v: float, share: float, relative: RelativeWind, particles: Particles) -> None:
    """Write the drag [N] of a velocity update for a row of `relative`.

    dt_v : [s] length of the velocity update; share : as in `energy_check.observe`

    Drag alone changes w by M dw/dt = -k |w| w, k = rho A / 2. In a time dt this turns w into w / (1 + b) with
    b = k |w| dt / M. The force k |w| w / (1 + b) has the same effect in one velocity update. So drag never
    accelerates a particle beyond the wind, however long the step is.
    """
    v, drag = particles.v, particles.drag
    p = relative.rows[i]
    speed = relative.steady[i] if is_present(relative.steady) else wind_speed(p, particles, share)
    wx, wy, wz = speed * relative.along_x - v[0, p], speed * relative.along_y - v[1, p], -v[2, p]
    factor = relative.size[i] * math.sqrt(wx * wx + wy * wy + wz * wz)
    factor /= 1.0 + factor * dt_v * particles.per_mass[p]
    drag[0, p], drag[1, p], drag[2, p] = factor * wx, factor * wy, factor * wz


@routine(real, real, real, whole, RelativeWind, Particles)
def set_air_forces(
    dt_v: float, zeta: float, share: float, changed: int, relative: RelativeWind, particles: Particles
) -> int:
    """Write the drag, and the factors of the aerodynamic damping if the step or a mass has changed."""
    if is_present(particles.air) and changed:
        for p in each(np.uint64(0), np.uint64(particles.per_mass.shape[0])):
            set_air_damping_at(p, dt_v, zeta, particles)
    if is_present(particles.drag):
        for i in each(0, relative.rows.shape[0]):
            set_drag_at(i, dt_v, share, relative, particles)
    meet()
    return 0


@inner_kernel
def damped_mass(p: int, particles: Particles) -> float:
    """Return the mass [kg] of particle p on which the mass-proportional damping acts."""
    if not is_present(particles.air_mass):
        return particles.mass[p]
    return particles.mass[p] - particles.air_mass[p]


@inner_kernel
def remove_air(p: int, particles: Particles) -> None:
    """Remove aerodynamic damping and added mass from particle p, which has lost its wind load.

    The kinetic energy [J] of the added mass counts as negative external work.
    """
    if is_present(particles.air):
        particles.air[0, p] = particles.air[1, p] = particles.air[2, p] = 0.0
    if is_present(particles.air_mass):
        mass, v = particles.air_mass[p], particles.v
        if is_present(particles.work):
            square = v[0, p] * v[0, p] + v[1, p] * v[1, p] + v[2, p] * v[2, p]
            particles.work[0, p] -= 0.5 * mass * square
        particles.air_mass[p] = 0.0
        particles.mass[p] -= mass
        if particles.per_mass[p] != 0.0:
            particles.per_mass[p] = inverse_mass(particles.mass[p])


def remove_wind(state: Any, rows: Any = slice(None)) -> None:
    """Remove wind, aerodynamic damping and added mass of particles: local rows (k,) or all.

    Works count as in `remove_air`. state : `state.State`
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


def subtract_air(state: Any, p: int, vector: np.ndarray, mass: np.ndarray | float) -> None:
    """Subtract part of the aerodynamic damping and added mass of particle p; works as in `remove_air`.

    vector : (3,) [kg/m], kappa rho A; mass : [kg], at most all of the remaining added mass is taken
    """
    if state.air is not None:
        state.air[p] = damping_vectors(damping_areas(state.air[p]) - vector)
    if state.air_mass is not None:
        mass = min(mass, state.air_mass[p])
        if state.work is not None:
            state.work[p, 0] -= 0.5 * mass * float(np.sum(state.v[p] ** 2))
        state.air_mass[p] -= mass
        state.mass[p] -= mass


def damping_vectors(vector: np.ndarray) -> np.ndarray:
    """Return c (n, 3) of vectors kappa rho A (n, 3) [kg/m]; only the latter may be added."""
    size = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    return np.divide(vector, np.sqrt(size), out=np.zeros_like(vector), where=size > 0.0)


def damping_areas(c: np.ndarray) -> np.ndarray:
    """Return kappa rho A (n, 3) [kg/m] of vectors c (n, 3): the inverse of `damping_vectors`."""
    return c * np.sqrt(np.sum(c * c, axis=-1, keepdims=True))
