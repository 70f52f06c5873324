"""Sliding cables in the step: velocity and position update of the slip at each slip point.

With Q of `law`, p the velocity of the slip without friction, and m its inertia:

    p = s'(n-1/2) + dt Q / m,    s'(n+1/2) = sign(p) max(|p| - dt R / m, 0),    s(n+1) = s(n) + dt s'

So a sticking slip has exactly s' = 0. Friction turns m (p - s'(n+1/2)) (s'(n-1/2) + s'(n+1/2)) / 2 into heat;
it may return a little of that in a step in which the slip reverses. m is the mass of cable at the node, half
of either free segment, which also moves with the node. It is larger if the step requires that: m =
INERTIA_FACTOR dt^2 (k_before + k_after), with k = sum w^2 EA / L0 of a segment, adds 1/2 to (omega dt)^2 of a
segment at each of its ends. The automatic step limits the addition to MOST_ADDED of the mass that moves with
the slip.

The owner of a node updates its slips; s' travels with the forces to the ranks that have the node as halo. All
compute unstressed lengths from the same slips. The rank that owns a slip point holds both adjacent segments;
cables with segments of several elements are not split over ranks. A segment with a broken element has no
tension and keeps its length. A removed one pulls with its fading tension (`varying_loads.FadingLoad`). The
pull of the weight that moves with a slip, `slip_load`, keeps its initial value. If too little of a segment
remains (`law.shortest_length`), an end fitting on the cable stops it, and its kinetic energy turns to heat;
it may move back.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arithmetic import exponential
from netfall.core.arrays import Triple
from netfall.core.kernels import inner_kernel, routine
from netfall.core.records import Record, i8, is_present, real
from netfall.physics.element_step import LENGTH2_OFFSET
from netfall.physics.fields import Elements, Particles
from netfall.physics.law.element import axial_force, strain
from netfall.physics.law.law import LawParameters
from netfall.physics.slip.law import angle_between, shortest_length, slip_force, slip_limit

SLIP_STEP_SHARE = 0.75**0.5  # of the limit without slip; leaves three quarters of (omega dt)^2 to the net


class SlipPoints(Record):
    """Slip points at the particles of a rank, and the free segments whose lengths they change.

    node, column : (k,) slip points at owned particles, ascending, and the number of the cable at the node
    before, after : (k,) adjacent elements, along the cable; segment_before, segment_after : (k,) segments
    moving, of : (j,) like node, column, with those of the halo
    element : (q,) of all segments, one after the other; start : (g + 1,) where each segment begins in it
    """

    node: i8
    column: i8
    before: i8
    after: i8
    segment_before: i8
    segment_after: i8
    moving: i8
    of: i8
    element: i8
    start: i8


class SegmentEnd(NamedTuple):
    """One side of a slip point: tension, remaining tension of a removed element [N], and cable direction.

    whole : whether the segment is intact, and so changes its length; pulls : whether it pulls
    along : unit vector along the cable
    """

    tension: float
    fading: float
    whole: bool
    pulls: bool
    along: Triple


def slip_points_of(state: Any, segment: np.ndarray) -> SlipPoints:
    """Return the slip points of a rank; it holds all elements of their segments.

    state : `state.State`, owned particles before those of the halo; segment : (m,) of
        `geometry.slip_points.SlidingCables`
    """
    inside = np.flatnonzero(segment >= 0)
    inside = inside[np.argsort(segment[inside], kind="stable")]
    number, row = np.unique(segment[inside], return_inverse=True)
    begin, end = state.ends.T.astype(np.int64)
    is_reversed = state.slip_along < 0
    begin, end = np.where(is_reversed, end, begin), np.where(is_reversed, begin, end)  # along the cable
    leaves, arrives = (
        inside[(state.slip_place[inside, k] >= 0) & (at[inside] == state.slip_at[inside, k])]
        for k, at in enumerate((begin, end))
    )
    points = [
        np.column_stack([state.slip_at[e, k], state.slip_place[e, k], e])
        for k, e in enumerate((leaves, arrives))
    ]
    after, before = (rows[np.lexsort((rows[:, 1], rows[:, 0]))] for rows in points)
    moving = np.unique(np.concatenate([after, before])[:, :2], axis=0)
    after, before = (rows[rows[:, 0] < state.n_owned] for rows in (after, before))  # it has both if owned
    return SlipPoints(
        node=np.ascontiguousarray(after[:, 0]),
        column=np.ascontiguousarray(after[:, 1]),
        before=np.ascontiguousarray(before[:, 2]),
        after=np.ascontiguousarray(after[:, 2]),
        segment_before=np.searchsorted(number, segment[before[:, 2]]),
        segment_after=np.searchsorted(number, segment[after[:, 2]]),
        moving=np.ascontiguousarray(moving[:, 0]),
        of=np.ascontiguousarray(moving[:, 1]),
        element=inside,
        start=np.append(0, np.cumsum(np.bincount(row, minlength=len(number)))),
    )


def adjacent_sums(points: SlipPoints, values: np.ndarray) -> np.ndarray:
    """Return sums (k,) of values (m,) over both segments adjacent to each slip point."""
    if not len(points.element):
        return np.zeros(0)
    total = np.add.reduceat(values[points.element], points.start[:-1])
    return total[points.segment_before] + total[points.segment_after]


@inner_kernel
def _segment_end(
    e: int, intact: bool, share: float, particles: Particles, elements: Elements, law: LawParameters
) -> SegmentEnd:
    """Return the `SegmentEnd` of element e, adjacent to a slip point, at the present positions.

    intact : whether its segment is; share : position between two samples of a fading tension
    """
    fading = 0.0
    if is_present(elements.fading_before):
        fading = elements.fading_before[e] + share * (elements.fading_after[e] - elements.fading_before[e])
    if not intact and not fading > 0.0:
        return SegmentEnd(0.0, 0.0, False, False, (0.0, 0.0, 0.0))
    a, b, x = elements.ends[e, 0], elements.ends[e, 1], particles.x
    dx, dy, dz = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
    L = max(math.sqrt(dx * dx + dy * dy + dz * dz), LENGTH2_OFFSET)
    direction = elements.slip_along[e] / L
    T = 0.0
    if intact:
        T, _ = axial_force(elements, e, strain(L, elements.L0[e], law), 0.0)
    return SegmentEnd(T, fading, intact, True, (direction * dx, direction * dy, direction * dz))


@inner_kernel
def is_whole(g: int, points: SlipPoints, elements: Elements) -> bool:
    """Return whether no element of segment g is broken or removed."""
    broken = 0
    for j in range(points.start[g], points.start[g + 1]):
        broken += np.int64(elements.broken[points.element[j]] != 0)
    return broken == 0


@inner_kernel
def _segment_force(
    g: int, points: SlipPoints, particles: Particles, elements: Elements, law: LawParameters
) -> float:
    """Return the sum [N] of q(T) times the share over the elements of segment g, which is intact."""
    x, total = particles.x, 0.0
    for j in range(points.start[g], points.start[g + 1]):
        e = points.element[j]
        a, b = elements.ends[e, 0], elements.ends[e, 1]
        dx, dy, dz = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        L = max(math.sqrt(dx * dx + dy * dy + dz * dz), LENGTH2_OFFSET)
        T, _ = axial_force(elements, e, strain(L, elements.L0[e], law), 0.0)
        total += elements.slip_share[e] * slip_force(T, elements.EA[e], law)
    return total


@inner_kernel
def _is_short(g: int, e: int, intact: bool, passed: float, points: SlipPoints, elements: Elements) -> bool:
    """Return whether too little of segment g remains, from which `passed` [m] left next to element e."""
    if intact:
        return elements.L0[e] <= shortest_length(e, elements)
    length = 0.0
    for j in range(points.start[g], points.start[g + 1]):
        e = points.element[j]
        length += elements.strand[e] - shortest_length(e, elements)
    return passed >= length


@inner_kernel
def updated_slip_velocity(
    i: int,
    dt_v: float,
    share: float,
    points: SlipPoints,
    particles: Particles,
    elements: Elements,
    law: LawParameters,
) -> tuple[float, float, float, float, bool]:
    """Return the velocity [m/s] of slip i half a step later, also without friction, and the forces on it.

    The result is: velocity, velocity without friction, Q [N], other forces [N], and whether a
    short segment blocks the slip.
    """
    p, c, b, a = points.node[i], points.column[i], points.before[i], points.after[i]
    segment_b, segment_a = points.segment_before[i], points.segment_after[i]
    old, inertia = particles.slip_v[c, p], particles.slip_mass[c, p]
    before = _segment_end(b, is_whole(segment_b, points, elements), share, particles, elements, law)
    after = _segment_end(a, is_whole(segment_a, points, elements), share, particles, elements, law)
    if not before.whole and not after.whole:
        return 0.0, old, 0.0, 0.0, False
    EA_b = elements.EA[b] if before.whole else elements.EA[a]
    EA_a = elements.EA[a] if after.whole else elements.EA[b]
    Q = 0.0
    if after.whole:
        Q += _segment_force(segment_a, points, particles, elements, law)
    if before.whole:
        Q -= _segment_force(segment_b, points, particles, elements, law)
    other_force = slip_force(after.fading, EA_a, law) - slip_force(before.fading, EA_b, law)
    other_force += particles.slip_load[c, p]
    mu, turn = particles.friction[c, p], 1.0
    if mu > 0.0 and before.pulls and after.pulls:
        u, w = before.along, after.along
        turn = exponential(-mu * angle_between(u[0], u[1], u[2], w[0], w[1], w[2]))
    T_b, T_a = before.tension + before.fading, after.tension + after.fading
    limit = slip_limit(T_b, T_a, EA_b, EA_a, mu, particles.resistance[c, p], turn, law)
    free = old + dt_v * (Q + other_force) / inertia
    speed = abs(free) - dt_v * limit / inertia
    new, passed = 0.0, particles.slip[c, p]
    if speed > 0.0:
        new = speed if free > 0.0 else -speed
    if new > 0.0 and _is_short(segment_b, b, before.whole, passed, points, elements):
        return 0.0, free, Q, other_force, True
    if new < 0.0 and _is_short(segment_a, a, after.whole, -passed, points, elements):
        return 0.0, free, Q, other_force, True
    return new, free, Q, other_force, False


@routine(real, real, real, SlipPoints, Particles, Elements, LawParameters)
def update_slip_velocities(
    time: float,
    dt_v: float,
    share: float,
    points: SlipPoints,
    particles: Particles,
    elements: Elements,
    law: LawParameters,
) -> int:
    """Update all slip velocities of a rank at a time [s] to n + 1/2, with work and heat."""
    for i in range(points.node.shape[0]):
        p, c = points.node[i], points.column[i]
        old = particles.slip_v[c, p]
        new, free, Q, other_force, locked = updated_slip_velocity(
            i, dt_v, share, points, particles, elements, law
        )
        particles.slip_v[c, p] = new
        if locked and particles.slip_locked[c, p] == 0.0:
            particles.slip_locked[c, p] = max(time, LENGTH2_OFFSET)
        if is_present(particles.slip_work):
            work = particles.slip_work
            mean = 0.5 * (old + new)
            work[0, p] += dt_v * mean * other_force
            work[1, p] += dt_v * mean * Q
            work[2, p] += particles.slip_mass[c, p] * (free - new) * mean
    return 0


@inner_kernel
def update_slips(dt: float, points: SlipPoints, particles: Particles) -> None:
    """Update the slips of a rank, halo included, to n + 1."""
    for j in range(points.moving.shape[0]):
        p, c = points.moving[j], points.of[j]
        particles.slip[c, p] += dt * particles.slip_v[c, p]


@inner_kernel
def slip_energies(
    i: int,
    part: float,
    dt_v: float,
    share: float,
    points: SlipPoints,
    particles: Particles,
    elements: Elements,
    law: LawParameters,
) -> tuple[float, ...]:
    """Return the kinetic energy of slip i at time n, and works [J] up to then: external, internal, heat.

    part : share of the velocity update that comes before n
    """
    p, c = points.node[i], points.column[i]
    old, inertia = particles.slip_v[c, p], particles.slip_mass[c, p]
    new, free, Q, other_force, _ = updated_slip_velocity(i, dt_v, share, points, particles, elements, law)
    now, duration = old + part * (new - old), part * dt_v
    mean = 0.5 * (old + now)
    heat = part * inertia * (free - new) * mean
    return 0.5 * inertia * now * now, duration * mean * other_force, duration * mean * Q, heat
