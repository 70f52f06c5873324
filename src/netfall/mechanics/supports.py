"""Supports: a spring for each axis of a particle, which acts both ways; and axes that are not x and y.

f = k (d0 - d), with the displacement d and d0 where the spring carries nothing: its reaction in the form that
was found, over k; 0 without form finding. Its energy is k (d - d0)^2 / 2.

A support in axes of its own, turned about z, has a term of stiffness between x and y (`net.turned`). Where it
is held along a unit vector n in plan, forces lose their part along n, so that n.v stays 0. Both stand in
`turned` of the particles, (n, 3): n_x, n_y, and the term between.
"""

import numpy as np

from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import has


@inner_kernel
def spring_back(x, x_start, spring, rest, turned, f_int):
    """Add the forces of the springs (n, 3) [N/m] at x (n, 3) [m] to f_int (n, 3) [N]; rest : (n, 3) [m].

    turned : (n, 3), absent: all stand along x, y and z
    """
    for p in range(f_int.shape[0]):  # the others may have more rows
        for k in range(3):
            f_int[p, k] += spring[p, k] * (rest[p, k] - (x[p, k] - x_start[p, k]))
        if has(turned):
            f_int[p, 0] += turned[p, 2] * (rest[p, 1] - (x[p, 1] - x_start[p, 1]))
            f_int[p, 1] += turned[p, 2] * (rest[p, 0] - (x[p, 0] - x_start[p, 0]))


@kernel
def add_springs(x, x_start, spring, rest, turned, f_int):
    """`spring_back` from Python."""
    spring_back(x, x_start, spring, rest, turned, f_int)


def spring_forces(x, x_start, spring, rest, turned=None) -> np.ndarray:
    """Forces (n, 3) [N] of the springs on their particles, arguments as in `add_springs`."""
    off = rest - (x - x_start)
    force = spring * off
    if turned is not None:
        add_between(turned, off, force)
    return force


def add_between(turned, u, force) -> None:
    """Add to forces (n, 3) [N] what stiffness between x and y makes of displacements u (n, 3) [m]."""
    force[:, :2] += turned[:, 2:] * u[:, 1::-1]


def keep_on_guides(turned, rows) -> None:
    """Take from vectors (k, 3) their parts along the lines on which the first k particles are held."""
    n = turned[: len(rows), :2]
    rows[:, :2] -= (n[:, 0] * rows[:, 0] + n[:, 1] * rows[:, 1])[:, None] * n


def largest_springs(spring, turned) -> np.ndarray:
    """Upper bound (n,) [N/m] of the stiffness of springs (n, 3) in any direction; turned : or None."""
    return spring.max(1) if turned is None else spring.max(1) + np.abs(turned[:, 2])


@kernel
def largest_residual(f, free, n_owned):
    """Largest norm [N] of the force over the free axes of the owned particles; inf if not a number."""
    worst = 0.0
    for p in range(n_owned):
        square = 0.0
        for k in range(3):
            if free[p, k]:
                square += f[p, k] * f[p, k]
        if not square <= worst:
            worst = square if square == square else np.inf
    return np.sqrt(worst)
