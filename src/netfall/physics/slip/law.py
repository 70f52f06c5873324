"""Law of a slip point (clamp, saddle or pulley at a node), for the step and for equilibria.

Each node and sliding cable has a coordinate s: the length that has passed, positive in the direction of the
cable. The free segment from slip point a to b has L0 = L0(0) + s_a - s_b, and each of its elements a constant
share w of that (`geometry.slip_points`). The force on s is minus the derivative of the strain energy:

    Q = sum w q(T) after it - sum w q(T) before it,   q = T + T^2 / (2 EA),
    or EA (exp(T / EA) - 1) in logarithmic strain

Without friction, q less the potential of the weight is constant along a cable that hangs freely, so the sums
equal the values at the slip point itself. A slip point sticks while |Q| is within its limit R, and slips at
R. With the larger tension T and the smaller tension t of both sides:

    saddle:  R = q(T) - q(T exp(-mu theta))      theta: angle between both directions (Euler, Eytelwein)
    clamp:   R = q(t + resistance) - q(t)        both: the sum

A segment with a broken or removed element carries nothing, and its unstressed length stays constant.
"""

import math
from typing import Any

import numpy as np

from netfall.core.arithmetic import exponential
from netfall.core.arrays import FloatArray
from netfall.core.kernels import inner_kernel, kernel
from netfall.physics.fields import Elements
from netfall.physics.law.law import LawParameters
from netfall.physics.state import State

MIN_SEGMENT_SHARE = 0.2  # of the initial unstressed length; a shorter segment is locked


@inner_kernel
def slip_force(T: float, EA: float, law: LawParameters) -> float:
    """Return q [N] at tension T [N]: minus the derivative of the strain energy by the unstressed length."""
    if law.logarithmic:
        return EA * (exponential(T / EA) - 1.0)
    return T + T * T / (2.0 * EA)


@inner_kernel
def slip_limit(
    before: float,
    after: float,
    EA_before: float,
    EA_after: float,
    friction: float,
    resistance: float,
    turn: float,
    law: LawParameters,
) -> float:
    """Return R [N], the force up to which a slip point sticks.

    before, after : [N] tensions; turn : exp(-mu theta)
    """
    larger, smaller, EA_larger, EA_smaller = before, after, EA_before, EA_after
    if after > before:
        larger, smaller, EA_larger, EA_smaller = after, before, EA_after, EA_before
    limit = 0.0
    if friction > 0.0:
        limit += slip_force(larger, EA_larger, law) - slip_force(larger * turn, EA_larger, law)
    if resistance > 0.0:
        limit += slip_force(smaller + resistance, EA_smaller, law) - slip_force(smaller, EA_smaller, law)
    return limit


@inner_kernel
def angle_between(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Return the angle [rad] between two unit vectors, with the same bits on any processor.

    The tangent of half of it is |a - b| / |a + b|. After three more bisections the arc tangent is a short
    series.
    """
    y = math.sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz))
    x = math.sqrt((ax + bx) * (ax + bx) + (ay + by) * (ay + by) + (az + bz) * (az + bz))
    t = y / (x + math.sqrt(x * x + y * y))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    square, arc = t * t, 0.0
    for k in range(10, -1, -1):
        arc = 1.0 / (2 * k + 1) - square * arc
    return 16.0 * t * arc


def set_slipless_lengths(state: State, L0: np.ndarray) -> None:
    """Set the unstressed lengths (m,) [m] of the elements without slip; slips stay as they are."""
    state.L0[:] = L0
    if state.features.slip:
        state.strand[:] = L0
        update_slipped_lengths(state.particles.slip, state.elements)


@inner_kernel
def slipped_length(e: int, slip: FloatArray, elements: Elements) -> float:
    """Return the unstressed length [m] of element e including slip; slip : (3, n) [m]."""
    return elements.strand[e] + elements.slip_share[e] * passed_length(e, slip, elements)


@inner_kernel
def passed_length(e: int, slip: FloatArray, elements: Elements) -> float:
    """Return the length [m] passed into the segment of element e, from slips (3, n) or slip velocities."""
    i, j, passed = elements.slip_place[e, 0], elements.slip_place[e, 1], 0.0
    if i >= 0:
        passed += slip[i, elements.slip_at[e, 0]]
    if j >= 0:
        passed -= slip[j, elements.slip_at[e, 1]]
    return passed


@kernel
def update_slipped_lengths(slip: Any, elements: Elements) -> None:
    """Update the unstressed lengths to the slips (3, n) [m]."""
    for e in range(elements.ends.shape[0]):
        moves = elements.slip_place[e, 0] >= 0 or elements.slip_place[e, 1] >= 0
        if moves and elements.broken[e] == 0:
            elements.L0[e] = slipped_length(e, slip, elements)
