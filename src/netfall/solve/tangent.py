"""The tangent stiffness of a net at its positions, for Newton's method."""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.elements import element_tangents
from netfall.mechanics.material import largest_stiffness
from netfall.mechanics.state import State
from netfall.solve.relaxation import nodal_stiffness


class Tangent(NamedTuple):
    """Stiffness of a net at its positions.

    N : (m,) [N]; direction : (m, 3) along the elements; axial, across : (m,) [N/m], of compression negative
    support : (n, 3) [N/m] or None
    nodal : (n,) [N/m], the elements' and supports' largest stiffness at each particle
    """

    N: np.ndarray
    direction: np.ndarray
    axial: np.ndarray
    across: np.ndarray
    support: np.ndarray | None
    nodal: np.ndarray


def tangent_of(state: State) -> Tangent:
    """The tangent stiffness of a state's elements and supports at its positions."""
    N, axial, across = np.empty((3, state.m))
    direction = np.empty((state.m, 3))
    element_tangents(state.x, state.elements, state.law, N, direction, axial, across)
    nodal = state.spring.max(1).astype(float) if state.scene.springs else np.zeros(state.n_local)
    nodal_stiffness(state.ends, largest_stiffness(state.EA, state.L0) + np.abs(across), nodal)
    support = np.ascontiguousarray(state.spring, float) if state.scene.springs else None
    return Tangent(N, direction, axial, across, support, nodal)


def without_compression(K: Tangent) -> Tangent:
    """The tangent without what compression takes from it."""
    return K._replace(across=np.maximum(K.across, 0.0))


def scattered(number: np.ndarray) -> np.ndarray:
    """Numbers from -0.5 to 0.5, as if by chance, that depend on the given integers alone (SplitMix64)."""
    bits = number.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (bits ^ (bits >> np.uint64(31))) / 2.0**64 - 0.5
