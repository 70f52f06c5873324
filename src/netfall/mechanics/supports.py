"""Elastic supports: a spring for each axis of a particle, which acts both ways.

f = k (d0 - d), with the displacement d and d0 where the spring carries nothing: its reaction in the form that
was found, over k; 0 without form finding. Its energy is k (d - d0)^2 / 2.
"""

import numpy as np

from netfall.ground.compile import kernel, part_of_kernel


@part_of_kernel
def spring_force(p, internal, axis):
    """Force [N] of the spring of particle p along an axis, and of the elements [N]; axis : `motion.Axis`."""
    if axis.spring is None:
        return internal
    return internal + axis.spring[p] * (axis.spring_zero[p] - axis.x[p])


@kernel
def add_springs(x, x_start, spring, rest, f_int):
    """Add the forces of the springs (n, 3) [N/m] at x (n, 3) [m] to f_int (n, 3) [N]; rest : (n, 3) [m]."""
    for p in range(x.shape[0]):
        for k in range(3):
            f_int[p, k] += spring[p, k] * (rest[p, k] - (x[p, k] - x_start[p, k]))


def spring_forces(x, x_start, spring, rest) -> np.ndarray:
    """Forces (n, 3) [N] of the springs on their particles, arguments as in `add_springs`."""
    return spring * (rest - (x - x_start))


def spring_energy(x, x_start, spring, rest) -> np.ndarray:
    """Energy (n,) [J] of the springs of each particle, arguments as in `add_springs`."""
    off = (x - x_start) - rest
    return 0.5 * np.sum(spring * off * off, axis=1)
