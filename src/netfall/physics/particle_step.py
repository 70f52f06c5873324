"""Motion of a particle along one axis.

Central difference in half-step velocities; damping is implicit in the mean velocity:

    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a,    dt the mean of the steps before and after n
"""

from typing import Any

from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.vectors import fma


@part_of_kernel
def between(before: Any, after: Any, share: Any) -> Any:
    """Interpolate linearly between two samples; share : 0 at the first, 1 at the second."""
    return fma(share, after - before, before)


@part_of_kernel
def next_v(v: Any, a: Any, c_v: Any, c_a: Any) -> Any:
    """Return v(n+1/2) [m/s] from v(n-1/2) and the acceleration a [m/s2]; c_v, c_a : update factors."""
    return fma(c_a, a, c_v * v)


@part_of_kernel
def next_x(x: Any, v: Any, dt: Any) -> Any:
    """Return x(n+1) [m]."""
    return fma(dt, v, x)


@part_of_kernel
def works_of_motion(
    mass: Any, damped: Any, zeta: Any, ground: Any, old: Any, new: Any, twice: Any, duration: Any
) -> Any:
    """Return the factors of the works [J] during an interval in which supports move.

    They are the damping force [N], the displacement relative to the ground [m], and the change of kinetic
    energy [J].
    damped : mass on which the damping acts; old, new : velocities [m/s] at the start and the end of the
        interval
    twice : sum of the velocities before and after the whole velocity update; duration : [s] of the
        interval
    """
    f_damp = zeta * damped * fma(0.5, twice, -ground)
    path_rel = fma(-duration, ground, duration * (0.5 * (old + new)))
    return f_damp, path_rel, 0.5 * mass * fma(new, new, -(old * old))


@inner_kernel
def inverse_mass(mass: float) -> float:
    """Return 1 / mass [1/kg]; 0 for a particle without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
