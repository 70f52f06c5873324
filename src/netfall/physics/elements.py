"""Loops over all elements of a rank at given positions: forces, stiffness, energies.

Form finding, statics, energy checks, snapshots and history use them. The time step (`netfall.explicit`) does
not.
"""

import math
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import kernel, part_of_kernel
from netfall.core.records import Record, f8, is_present
from netfall.core.threads import each
from netfall.physics.element_step import LENGTH2_OFFSET
from netfall.physics.fields import Elements
from netfall.physics.law.element import axial_force, stored_energy, strain, tangent_stiffness, yield_energy
from netfall.physics.law.law import LawParameters


class ElementState(Record):
    """State of the elements (m,) at one time: axial force [N], strain, plastic strain, length [m]."""

    N: f8
    eps: f8
    eps_p: f8
    L: f8


@part_of_kernel
def element_state_at(x: FloatArray, elements: Elements, law: LawParameters, e: int) -> tuple[Any, ...]:
    """Return force, strain, plastic strain, length and end-to-end vector of element e at x (n, 3) [m]."""
    a, b = elements.ends[e, 0], elements.ends[e, 1]
    dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    L = math.sqrt(dx * dx + dy * dy + dz * dz)
    eps_p = 0.0
    if is_present(elements.eps_p):
        eps_p = elements.eps_p[e]
    N, eps = 0.0, 0.0  # also for a removed element, whose end distance is not a strain
    if elements.EA[e] != 0.0:
        eps = strain(L, elements.L0[e], law)
        N, eps_p = axial_force(elements, e, eps, eps_p)
    return N, eps, eps_p, L, (dx, dy, dz)


@kernel
def compute_element_state(x: FloatArray, elements: Elements, law: LawParameters, now: ElementState) -> None:
    """Compute force, strain, plastic strain and length of each element at x (n, 3) [m]; change nothing else.

    elements : `Elements`; law : `LawParameters`; now : `ElementState`, out
    """
    for e in each(0, elements.ends.shape[0]):
        now.N[e], now.eps[e], now.eps_p[e], now.L[e], _ = element_state_at(x, elements, law, e)


@kernel
def element_tangents(
    x: FloatArray,
    elements: Elements,
    law: LawParameters,
    N: FloatArray,
    direction: FloatArray,
    axial: FloatArray,
    across: FloatArray,
) -> None:
    """Compute axial force [N], axial and transverse stiffness [N/m] (m,) and direction (m, 3) of elements.

    x : (n, 3) [m]; elements : `Elements`; law : `LawParameters`; the others are out
    """
    for e in range(elements.ends.shape[0]):
        N[e], eps, _, L, along = element_state_at(x, elements, law, e)
        length = max(L, LENGTH2_OFFSET)
        for k in range(3):
            direction[e, k] = along[k] / length
        axial[e], across[e] = tangent_stiffness(elements, e, N[e], eps, L, law), N[e] / length


@kernel
def add_element_forces(x: FloatArray, elements: Elements, law: LawParameters, f: FloatArray) -> None:
    """Add the axial forces of all elements at x (n, 3) [m] to the f (n, 3) [N] of their particles."""
    for e in range(elements.ends.shape[0]):
        a, b = elements.ends[e, 0], elements.ends[e, 1]
        N, _, _, L, (dx, dy, dz) = element_state_at(x, elements, law, e)
        q = N / L if L > 0.0 else 0.0
        for k, d in ((0, q * dx), (1, q * dy), (2, q * dz)):
            f[a, k] += d
            f[b, k] -= d


@kernel
def add_axial_forces(x: FloatArray, ends: IntArray, N: FloatArray, L: FloatArray, f_int: FloatArray) -> None:
    """Add given axial forces N (m,) [N] at lengths L (m,) [m] to f_int (n, 3) [N] of the particles."""
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        q = N[e] / L[e] if L[e] > 0.0 else 0.0
        for k in range(3):
            d = q * (x[b, k] - x[a, k])
            f_int[a, k] += d
            f_int[b, k] -= d


@kernel
def add_stiffness(
    u: FloatArray,
    ends: IntArray,
    direction: FloatArray,
    axial: FloatArray,
    transverse: FloatArray,
    force: FloatArray,
) -> None:
    """Add the element stiffness matrix times displacements u (n, 3) to force (n, 3).

    direction : (m, 3), along the elements; axial, transverse : (m,) [N/m], along and across it
    """
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        along = 0.0
        for k in range(3):
            along += (u[b, k] - u[a, k]) * direction[e, k]
        for k in range(3):
            d = transverse[e] * (u[b, k] - u[a, k]) + (axial[e] - transverse[e]) * along * direction[e, k]
            force[b, k] += d
            force[a, k] -= d


def axial_forces(u: FloatArray, ends: IntArray, direction: FloatArray, axial: FloatArray) -> np.ndarray:
    """Compute axial forces (m,) [N] due to displacements u (n, 3) [m]; direction (m, 3), axial (m,) [N/m]."""
    along = (u[ends[:, 1]] - u[ends[:, 0]]) * direction
    return axial * (along[:, 0] + along[:, 1] + along[:, 2])


@part_of_kernel
def element_energies_at(
    e: int, elements: Elements, now: ElementState, law: LawParameters
) -> tuple[float, float]:
    """Return stored and dissipated energy [J] of element e."""
    heat = 0.0
    if is_present(elements.dissipated):
        heat = elements.dissipated[e]
    if is_present(elements.yield_force) and elements.EA[e] > 0.0:
        heat += yield_energy(elements, e, elements.eps_p[e], now.eps_p[e], law)
    return stored_energy(elements, e, now.N[e], now.L[e], now.eps_p[e], law), heat


def nodal_stiffness(ends: IntArray, k: FloatArray, out: FloatArray) -> None:
    """Add element stiffnesses k (m,) [N/m] to both ends, in the order of the elements."""
    np.add.at(out, ends.ravel(), np.repeat(k, 2))  # of 1-D arrays, four times as fast


def geometric_stiffness(N: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Return the transverse stiffness (m,) [N/m] of elements of length L (m,) [m] under N (m,) [N]."""
    return np.abs(N) / np.maximum(L, LENGTH2_OFFSET)
