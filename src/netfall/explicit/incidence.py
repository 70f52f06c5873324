"""Incident element ends (slots): each particle lists its own elements and sums over them.

The slots of a particle are in ascending global element number. So the sum has the same order, and the same
bits, on any number of ranks. Each element is computed at both ends, from the same bits: this doubles the
arithmetic but avoids scattered writes.
"""

import math

import numpy as np

from netfall.core.arrays import AnyArray, IntArray, Integer
from netfall.core.kernels import copied_kernel, inner_kernel, kernel
from netfall.core.records import is_present
from netfall.core.threads import each
from netfall.core.vectors import LANES
from netfall.physics.fields import EMPTY, Elements, Particles, Slots, fields_of
from netfall.physics.law.element import fill_law_fields, yield_energy
from netfall.physics.law.law import LawParameters
from netfall.physics.slip.law import slipped_length
from netfall.physics.slip.motion import SlipPoints, is_whole
from netfall.physics.state import State


def fill_slots(state: State) -> None:
    """Fill the slots of the particles that this rank steps from the present connectivity."""
    s = state
    element = s.slot_element[:, : s.n_local]
    element[:], s.other[:, : s.n_local] = EMPTY, np.arange(s.n_local)
    present = np.flatnonzero(s.EA != 0.0)  # not held by another rank since it broke, and not removed
    p, far = s.ends[present].ravel(), s.ends[present, ::-1].ravel()
    stepped = np.flatnonzero((p < s.n_owned) | (p >= s.first_split))
    stepped = stepped[np.argsort(p[stepped], kind="stable")]  # by particle, then by element
    p = p[stepped]
    number = np.arange(len(p)) - np.searchsorted(p, p)  # of the slot
    s.other[number, p], element[number, p] = far[stepped], present[stepped // 2]
    copy_to_slots(element, 1.0 / s.L0, s.inv_L0)
    if s.slot_highest is not None:
        s.slot_highest[:] = -np.inf
    if s.slot_lowest is not None:
        s.slot_lowest[:] = np.inf
    for field in fields_of("slot"):
        slot = getattr(s, field.name)
        if field.slot_of and slot is not None:
            copy_to_slots(element, getattr(s, field.slot_of), slot)


def particles_in_line(state: State) -> IntArray:
    """Return `loop.Chunks.in_line`: which vectors of owned particles load their far ends at once."""
    vectors = state.n_owned // LANES
    other = state.other[:, : vectors * LANES].reshape(len(state.other), vectors, LANES)
    consecutive = (other == other[:, :, :1] + np.arange(LANES, dtype=other.dtype)).all(axis=(0, 2))
    in_line = np.zeros(len(state.x), np.uint8)
    in_line[: vectors * LANES] = np.repeat(consecutive, LANES)
    return in_line


def copy_to_slots(element: IntArray, values: AnyArray, slot: AnyArray) -> None:
    """Copy a field (m,) to slots (slots, n or more) of elements (slots, n); empty slots get 0."""
    filled, slot = element != EMPTY, slot[:, : element.shape[1]]
    slot[:] = 0
    slot[filled] = values[element[filled]]


@copied_kernel
def update_slip_lengths(
    points: SlipPoints, n_owned: int, first_split: int, particles: Particles, elements: Elements, slots: Slots
) -> None:
    """Update unstressed lengths, also in slots, after slips moved. points : `slip.motion.SlipPoints`"""
    for g in range(points.start.shape[0] - 1):
        first = points.element[points.start[g]]
        if not has_moved(first, particles, elements) or not is_whole(g, points, elements):
            continue
        for j in range(points.start[g], points.start[g + 1]):
            e = points.element[j]
            elements.L0[e] = slipped_length(e, particles.slip, elements)
            for end in range(2):
                p = np.int64(elements.ends[e, end])
                if p < n_owned or p >= first_split:
                    slots.inv_L0[slot_of(e, p, slots), p] = 1.0 / elements.L0[e]


@inner_kernel
def has_moved(e: int, particles: Particles, elements: Elements) -> bool:
    """Return whether a slip point at an end of the segment of element e moved in this step."""
    for end in range(2):
        c = elements.slip_place[e, end]
        if c >= 0 and particles.slip_v[c, elements.slip_at[e, end]] != 0.0:
            return True
    return False


@inner_kernel
def slot_of(e: Integer, p: Integer, slots: Slots) -> int:
    """Return the slot of element e at particle p; the particle must have the element."""
    s = 0
    while slots.element[s, p] != np.uint32(e):
        s += 1
    return s


@inner_kernel
def record_slot(
    e: Integer, n_owned: int, first_split: int, elements: Elements, slots: Slots
) -> tuple[int, Integer]:
    """Return the slot, and its particle, that holds the extremes of element e until it breaks.

    It is the end with the lower row. If that is a halo row, it is the other end, which may be a fragment.
    """
    a, b = np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1])
    p = min(a, b)
    if n_owned <= p and p < first_split:
        p = max(a, b)
    return slot_of(e, p, slots), p


@inner_kernel
def collect_element(
    e: Integer, n_owned: int, first_split: int, elements: Elements, slots: Slots, law: LawParameters
) -> None:
    """Update element e from its slots: plastic strain and heat, extremes, branches.

    The heat of a cable follows from its plastic strain, which only grows; that of a bar is already up to
    date, and that of what never yields (`fracture.keep_first_limit`) too. Extremes count until the element
    breaks: its fragments ring numerically at light ends.
    """
    s, p = record_slot(e, n_owned, first_split, elements, slots)
    if is_present(slots.eps_p) and elements.yield_force[e] < math.inf:
        elements.eps_p[e] = slots.eps_p[s, p]
        if not elements.bar[e] and elements.eps_p[e] != 0.0:
            elements.dissipated[e] = yield_energy(elements, e, 0.0, elements.eps_p[e], law)
    if is_present(slots.highest) and elements.broken[e] == 0:
        elements.highest[e] = max(elements.highest[e], slots.highest[s, p])
        if is_present(elements.lowest):
            elements.lowest[e] = min(elements.lowest[e], slots.lowest[s, p])
    if is_present(slots.branch_a):
        elements.branch_a[e], elements.branch_b[e] = slots.branch_a[s, p], slots.branch_b[s, p]
        if is_present(elements.branch_c):
            elements.branch_c[e] = slots.branch_c[s, p]


@kernel
def collect_elements(
    n_owned: int, first_split: int, elements: Elements, slots: Slots, law: LawParameters
) -> None:
    """Update all elements that this rank steps from their slots."""
    for e in each(0, elements.ends.shape[0]):
        if elements.EA[e] != 0.0:
            collect_element(e, n_owned, first_split, elements, slots, law)


@inner_kernel
def empty_slot(s: Integer, p: Integer, slots: Slots) -> None:
    """Empty a slot of particle p, so that it adds no force."""
    slots.element[s, p], slots.inv_L0[s, p] = EMPTY, 0.0
    if is_present(slots.bar):
        slots.bar[s, p] = 0


@copied_kernel
def fill_slot(e: Integer, s: Integer, p: Integer, far: Integer, elements: Elements, slots: Slots) -> None:
    """Put element e, whose far end is particle `far`, into a slot of particle p."""
    slots.other[s, p], slots.element[s, p], slots.inv_L0[s, p] = far, e, 1.0 / elements.L0[e]
    fill_law_fields(e, s, p, elements, slots)
    if is_present(slots.check_stretch):
        slots.check_stretch[s, p] = elements.check_stretch[e]
    if is_present(slots.near):
        slots.near[s, p] = elements.near[e]
    if is_present(slots.highest):
        slots.highest[s, p] = -math.inf
    if is_present(slots.lowest):
        slots.lowest[s, p] = math.inf
    if is_present(slots.branch_a):
        slots.branch_a[s, p], slots.branch_b[s, p] = elements.branch_a[e], elements.branch_b[e]
    if is_present(slots.branch_c):
        slots.branch_c[s, p] = elements.branch_c[e]
