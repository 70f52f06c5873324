"""The motion of a particle along one axis: kick from v(n-1/2) to v(n+1/2) by central difference.

Damping is implicit in the mean velocity:
    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a,    dt the mean of the steps before and after n
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.compile import inner_kernel, part_of_kernel


class Kick(NamedTuple):
    """What is the same for all particles at a step n.

    dt : [s] length of the kick; c_v, c_a : its factors of velocity and acceleration; zeta : [1/s] damping
    share : place of the time between the two samples of the loads that vary
    """

    dt: float
    c_v: float
    c_a: float
    zeta: float
    share: float


@part_of_kernel
def make_kick(dt, zeta, share):
    """The kick of length dt [s]."""
    h = 0.5 * zeta * dt
    return Kick(dt, (1.0 - h) / (1.0 + h), dt / (1.0 + h), zeta, share)


@part_of_kernel
def kicked(v, a, kick):
    """Velocity v(n+1/2) [m/s] of v(n-1/2) and acceleration a [m/s2]."""
    return kick.c_v * v + kick.c_a * a


@inner_kernel
def inverse_mass(mass):
    """1 / mass [1/kg]; 0 for a particle left without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0


class Axis(NamedTuple):
    """One axis of the particles, as in the table of fields: each (n,), None where there is no such thing."""

    v: np.ndarray
    free: np.ndarray | None
    load: np.ndarray | None
    load_before: np.ndarray | None
    load_after: np.ndarray | None
    wind: np.ndarray | None
    drag: np.ndarray | None
    x: np.ndarray
    spring: np.ndarray | None
    spring_zero: np.ndarray | None
    ground: np.ndarray | None


def _along(k: int):
    """Function of `Particles` that gives their `Axis` k."""

    @part_of_kernel
    def axis(particles):
        return Axis(
            particles.v[k],
            None if particles.free is None else particles.free[k],
            particles.load[k],
            None if particles.load_before is None else particles.load_before[k],
            None if particles.load_after is None else particles.load_after[k],
            None if particles.wind is None else particles.wind[k],
            None if particles.drag is None else particles.drag[k],
            particles.x[k],
            None if particles.spring is None else particles.spring[k],
            None if particles.spring_zero is None else particles.spring_zero[k],
            None if particles.ground is None else particles.ground[k],
        )

    return axis


along_x, along_y, along_z = (_along(k) for k in range(3))
