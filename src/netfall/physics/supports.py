"""Elastic supports: a spring along each axis of a particle, in tension and compression; rotated axes.

f = k (d0 - d), with the displacement d, and d0 where the spring carries nothing: its reaction in the
form-found geometry over k; 0 without form finding. Its energy is k (d - d0)^2 / 2.

A support with axes rotated about z has a stiffness term between x and y (`geometry.turned`). If it is held
along a unit vector n in plan, forces lose their component along n, so that n.v stays 0. Both are in `turned`
of the particles, (n, 3): n_x, n_y, and the term between.
"""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import is_present


@inner_kernel
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
    for p in range(f_int.shape[0]):  # f_int may have fewer rows than the other arrays
        for k in range(3):
            f_int[p, k] += spring[p, k] * (d0[p, k] - (x[p, k] - x_start[p, k]))
        if is_present(turned):
            f_int[p, 0] += turned[p, 2] * (d0[p, 1] - (x[p, 1] - x_start[p, 1]))
            f_int[p, 1] += turned[p, 2] * (d0[p, 0] - (x[p, 0] - x_start[p, 0]))


@kernel
def add_spring_forces_now(x: Any, x_start: Any, spring: Any, d0: Any, turned: Any, f_int: Any) -> None:
    """Call `add_spring_forces` from Python."""
    add_spring_forces(x, x_start, spring, d0, turned, f_int)


def spring_forces(x: Any, x_start: Any, spring: Any, d0: Any, turned: Any = None) -> np.ndarray:
    """Return the forces (n, 3) [N] of the springs on their particles; arguments as in
    `add_spring_forces_now`."""
    elongation = d0 - (x - x_start)
    force = spring * elongation
    if turned is not None:
        add_coupling(turned, elongation, force)
    return force


def add_coupling(turned: Any, u: Any, force: Any) -> None:
    """Add the x-y coupling stiffness times displacements u (n, 3) [m] to forces (n, 3) [N]."""
    force[:, :2] += turned[:, 2:] * u[:, 1::-1]


def project_on_guides(turned: Any, rows: Any) -> None:
    """Remove from vectors (k, 3) the components along the lines that guide the first k particles."""
    n = turned[: len(rows), :2]
    rows[:, :2] -= (n[:, 0] * rows[:, 0] + n[:, 1] * rows[:, 1])[:, None] * n


def largest_springs(spring: Any, turned: Any) -> np.ndarray:
    """Return an upper bound (n,) [N/m] of the spring stiffness (n, 3) in any direction; turned : or None."""
    return spring.max(1) if turned is None else spring.max(1) + np.abs(turned[:, 2])


@kernel
def largest_residual(f: FloatArray, free: IntArray, n_owned: int) -> float:
    """Return the largest norm [N] of the force over free axes of owned particles; inf if nan occurs."""
    worst = 0.0
    for p in range(n_owned):
        square = 0.0
        for k in range(3):
            if free[p, k]:
                square += f[p, k] * f[p, k]
        if not square <= worst:
            worst = square if square == square else np.inf
    return np.sqrt(worst)
