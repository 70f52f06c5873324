"""Slips of cables over nodes at given positions, a convex problem that `slip` solves for each trial."""

import math
from typing import Any

import numpy as np

from netfall.core.arithmetic import exponential, exponential_minus_linear, logarithm
from netfall.core.kernels import inner_kernel, kernel, part_of_kernel
from netfall.core.records import Record, f8, f8_2, i8
from netfall.physics.slip.law import angle_between, slip_force, slip_limit
from netfall.statics.bounds import (
    MOST_STEPS,
    NEGLIGIBLE,
    SUBSTITUTE_SHARE,
    SUM_ROUNDING,
)

# share of EA that counts as such a force [-]: the rounding error of lengths scales with EA
LENGTH_ROUNDING = 4e-3
# stiffness of the stop on a cable over that of the segment [-]
STOP_STIFFNESS = 100.0


class SlipChains(Record):
    """Slip points along each cable and the free segments between them; the same on every rank.

    node, column : (k,) global particle, and the index of the cable among its cables
    before, after : (k,) rows of the elements next to a slip point; segment_before, segment_after : (k,)
    friction : (k,); resistance : (k,) [N]; start : (c + 1,) first slip point of each chain
    slip_in, slip_out : (g,) slip point at the begin and the end of a segment along the cable, -1: none
    element : (q,) global numbers of the elements of all segments
    segment : (q,); share : (q,) of the segment's length
    along : (q,) 1, -1; weight : (q,) [N/m] of the elements
    """

    node: i8
    column: i8
    before: i8
    after: i8
    segment_before: i8
    segment_after: i8
    friction: f8
    resistance: f8
    start: i8
    slip_in: i8
    slip_out: i8
    element: i8
    segment: i8
    share: f8
    along: i8
    weight: f8

    def passed(self, s: np.ndarray) -> np.ndarray:
        """Return the changes (q,) [m] of the elements' unstressed lengths due to slips s (k,) [m]."""
        s = np.append(s, 0.0)
        return self.share * (s[self.slip_in] - s[self.slip_out])[self.segment]

    def by_segment(self, values: np.ndarray) -> np.ndarray:
        """Return the sums (g,) over the elements of each segment of values (q,) times their shares."""
        return np.bincount(self.segment, self.share * values, len(self.slip_in))


def build_slip_chains(slides: Any, weight: np.ndarray) -> SlipChains:
    """Build the chains of `geometry.slip_points.SlidingCables`. weight : (m,) [N/m] of each element"""
    element = np.flatnonzero(slides.segment >= 0)
    rows = np.searchsorted(element, [slides.before, slides.after])
    segment = slides.segment[element]
    before, after = segment[rows]
    into, out = np.full((2, segment.max() + 1), -1)
    into[after], out[before] = np.arange(slides.count), np.arange(slides.count)
    start = np.flatnonzero(np.append(True, before[1:] != after[:-1]))  # otherwise the chain continues
    return SlipChains(
        slides.node,
        slides.column,
        rows[0],
        rows[1],
        before,
        after,
        slides.friction,
        slides.resistance,
        start,
        into,
        out,
        element,
        segment,
        slides.share[element],
        slides.along[element].astype(np.int64),
        weight[element],
    )


class SlipElements(Record):
    """Elements of `SlipChains` at given positions (q,), [N] and [m].

    EA : 0 if the element carries nothing; strand : [m] unstressed length without slip; L : [m] length
    stop : [N/m] stiffness of the stop; shortest : [m] unstressed length at which it acts
    height : [m] of the element's middle
    direction : (q, 3) from begin to end along the cable
    """

    EA: f8
    strand: f8
    stop: f8
    shortest: f8
    L: f8
    height: f8
    direction: f8_2


@part_of_kernel
def _force_of(e: Any, L0: Any, elements: Any, law: Any) -> Any:
    """Compute tension [N], q [N], -dT/dL0, -dq/dL0 [N/m] of element e at the unstressed length L0 [m]."""
    EA, L = elements.EA[e], elements.L[e]
    if EA == 0.0 or L <= L0:
        return 0.0, 0.0, 0.0, SUBSTITUTE_SHARE * EA / L0
    if law.logarithmic:
        T = EA * logarithm(L / L0)
        return T, slip_force(T, EA, law), EA / L0, EA * L / (L0 * L0)
    T = EA * ((L - L0) / L0)
    return T, slip_force(T, EA, law), EA * L / (L0 * L0), EA * L * L / (L0 * L0 * L0)


@part_of_kernel
def _stop_overlap(e: Any, L0: Any, elements: Any) -> Any:
    """Compute how much [m] element e is shorter than its stop allows, at unstressed lengths L0 (q,) [m]."""
    return elements.shortest[e] - L0[e]


@kernel
def compute_slip_forces(
    s: Any, old: Any, limit: Any, chains: Any, elements: Any, weights: Any, law: Any, work: Any
) -> Any:
    """Compute the forces of the elements at slips s (k,) [m] into `work`; return the potential W [J].

    L0, T, q, coupling, stiffness : as `_force_of` returns them; q includes the weight and the stop
    drive, k_slip : the sums over each segment of q and of the stiffness against slip

    The potential is inf if a segment is too short. limit : (k,) [N], slip resistances against slips from old
    """
    L0, T, q, drive, k_slip, W = work.L0, work.T, work.q, work.drive, work.k_slip, 0.0
    drive[:] = 0.0
    k_slip[:] = 0.0
    for e in range(L0.shape[0]):
        g, slipped, EA, L = chains.segment[e], 0.0, elements.EA[e], elements.L[e]
        if chains.slip_in[g] >= 0:
            slipped += s[chains.slip_in[g]]
        if chains.slip_out[g] >= 0:
            slipped -= s[chains.slip_out[g]]
        L0[e] = elements.strand[e] + chains.share[e] * slipped
        T[e], q[e], coupling, stiffness = _force_of(e, L0[e], elements, law)
        q[e] -= weights * chains.weight[e] * elements.height[e]
        if EA == 0.0:
            q[e] = 0.0
        short = _stop_overlap(e, L0, elements)
        if short > 0.0:
            q[e] += elements.stop[e] * short
            stiffness += elements.stop[e]
            W += 0.5 * elements.stop[e] * short * short
        work.coupling[e], work.stiffness[e] = coupling, stiffness
        drive[g] += chains.share[e] * q[e]
        k_slip[g] += chains.share[e] * chains.share[e] * stiffness
        if EA > 0.0 and L0[e] < SUBSTITUTE_SHARE * elements.strand[e]:
            W = math.inf
        elif EA > 0.0:
            W += weights * chains.weight[e] * elements.height[e] * (L0[e] - elements.strand[e])
            if L > L0[e] and law.logarithmic:
                W += EA * L * exponential_minus_linear(-T[e] / EA)  # no difference of large terms
            elif L > L0[e]:
                W += 0.5 * EA * (L - L0[e]) * ((L - L0[e]) / L0[e])
    for i in range(s.shape[0]):
        if s[i] != old[i]:
            W += limit[i] * abs(s[i] - old[i])
    return W


@kernel
def compute_slip_limits(chains: Any, elements: Any, T: Any, law: Any, limit: Any) -> None:
    """Fill limit (k,) with the slip resistances R [N] at tensions T (q,) [N]."""
    for i in range(limit.shape[0]):
        b, a = chains.before[i], chains.after[i]
        turn, d = 1.0, elements.direction
        if chains.friction[i] > 0.0:
            theta = angle_between(d[b, 0], d[b, 1], d[b, 2], d[a, 0], d[a, 1], d[a, 2])
            turn = exponential(-chains.friction[i] * theta)
        EA = max(elements.EA[b], elements.EA[a])
        limit[i] = 0.0
        if EA > 0.0:
            EA_b = elements.EA[b] if elements.EA[b] > 0.0 else EA
            EA_a = elements.EA[a] if elements.EA[a] > 0.0 else EA
            limit[i] = slip_limit(T[b], T[a], EA_b, EA_a, chains.friction[i], chains.resistance[i], turn, law)


@inner_kernel
def slip_residuals(s: Any, old: Any, limit: Any, chains: Any, drive: Any, r: Any, direction: Any) -> Any:
    """Fill r (k,) [N] with the residual driving forces; return the largest.

    direction : (k,), filled with 1, -1, 0: the point sticks, and r is 0
    """
    worst = 0.0
    for i in range(s.shape[0]):
        Q = drive[chains.segment_after[i]] - drive[chains.segment_before[i]]
        slip = s[i] - old[i]
        direction[i] = (
            1 if slip > 0.0 else -1 if slip < 0.0 else 1 if Q > limit[i] else -1 if Q < -limit[i] else 0
        )
        r[i] = Q - direction[i] * limit[i] if direction[i] != 0 else 0.0
        worst = max(worst, abs(r[i]))
    return worst


@kernel
def solve_chains(
    chains: Any, way: Any, k_slip: Any, b: Any, pivot: Any, off_diagonal: Any, border: Any, out: Any
) -> None:
    """Solve K_ss out = b, slips (k,) [m] and forces (k,) [N] of the points that slip, chain by chain.

    k_slip : of `compute_slip_forces`. The last slip point of a chain is a border of the matrix, for closed
        chains.
    pivot, off_diagonal, border : (k,), scratch
    """
    for c in range(chains.start.shape[0]):
        first = chains.start[c]
        last = (chains.start[c + 1] if c + 1 < chains.start.shape[0] else way.shape[0]) - 1
        for i in range(first, last + 1):
            pivot[i], off_diagonal[i], border[i], out[i] = 1.0, 0.0, 0.0, 0.0
            if way[i] != 0:
                pivot[i] = k_slip[chains.segment_before[i]] + k_slip[chains.segment_after[i]]
                out[i] = b[i]
        for i in range(first, last + 1):
            g = chains.segment_after[i]
            j = chains.slip_out[g]
            if j >= 0 and j != i and way[i] != 0 and way[j] != 0:
                if j == last or i == last:
                    border[min(i, j)] -= k_slip[g]
                else:
                    off_diagonal[i] -= k_slip[g]
        corner = pivot[last]
        for i in range(first, last):
            pivot[i] = max(pivot[i], SUBSTITUTE_SHARE)
            multiplier = border[i] / pivot[i]
            if i + 1 < last:
                ratio = off_diagonal[i] / pivot[i]
                pivot[i + 1] -= ratio * off_diagonal[i]
                border[i + 1] -= ratio * border[i]
                out[i + 1] -= ratio * out[i]
            pivot[last] -= multiplier * border[i]
            out[last] -= multiplier * out[i]
        pivot[last] = max(pivot[last], SUBSTITUTE_SHARE * corner, SUBSTITUTE_SHARE * SUBSTITUTE_SHARE)
        out[last] /= pivot[last]
        for i in range(last - 1, first - 1, -1):
            out[i] -= border[i] * out[last]
            if i + 1 < last:
                out[i] -= off_diagonal[i] * out[i + 1]
            out[i] /= pivot[i]


@kernel
def solve_slips(
    old: Any, limit: Any, chains: Any, elements: Any, weights: Any, law: Any, work: Any, s: Any
) -> Any:
    """Compute the slips s (k,) [m] at given positions from `old` (k,); return the relative residual force.

    work : `SlipScratch`; its forces are then those at s
    """
    for i in range(s.shape[0]):
        s[i] = old[i]
    w, worst, scale = work, 0.0, 0.0
    old_potential = compute_slip_forces(s, old, limit, chains, elements, weights, law, w)
    for _ in range(MOST_STEPS):
        worst = slip_residuals(s, old, limit, chains, w.drive, w.r, w.way)
        for e in range(w.q.shape[0]):
            scale = max(scale, abs(w.T[e]), LENGTH_ROUNDING * elements.EA[e])
            if _stop_overlap(e, w.L0, elements) > 0.0:
                scale = max(scale, LENGTH_ROUNDING * elements.stop[e] * elements.strand[e])
        if worst <= SUM_ROUNDING * scale:
            return 0.0
        solve_chains(chains, w.way, w.k_slip, w.r, w.pivot, w.off_diagonal, w.border, w.step)
        for i in range(s.shape[0]):
            w.start[i], w.way_before[i] = s[i], w.way[i]
        step_share, new_potential = 1.0, 0.0
        while step_share > NEGLIGIBLE:
            for i in range(s.shape[0]):
                s[i] = w.start[i] + step_share * w.step[i]
                if limit[i] > 0.0 and (s[i] - old[i]) * w.way_before[i] < 0.0:
                    s[i] = old[i]
            new_potential = compute_slip_forces(s, old, limit, chains, elements, weights, law, w)
            if new_potential <= old_potential + SUM_ROUNDING * abs(old_potential):
                break
            step_share *= 0.5
        if not new_potential <= old_potential + SUM_ROUNDING * abs(
            old_potential
        ):  # due to rounding, or positions that are not finite
            for i in range(s.shape[0]):
                s[i] = w.start[i]
            compute_slip_forces(s, old, limit, chains, elements, weights, law, w)
            return worst / scale
        old_potential = new_potential
    return worst / scale


class SlipScratch(Record):
    """Scratch arrays of `solve_slips`.

    Elements (q,) have L0 to stiffness, segments (g,) drive and k_slip, slip points (k,) the others.
    """

    L0: f8
    T: f8
    q: f8
    coupling: f8
    stiffness: f8
    drive: f8
    k_slip: f8
    r: f8
    pivot: f8
    off_diagonal: f8
    border: f8
    step: f8
    start: f8
    way: i8
    way_before: i8


def allocate_slip_scratch(q: int, g: int, k: int) -> SlipScratch:
    """Allocate the arrays for q elements, g segments and k slip points."""
    return SlipScratch(*np.zeros((5, q)), *np.zeros((2, g)), *np.zeros((6, k)), *np.zeros((2, k), np.int64))
