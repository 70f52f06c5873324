"""Slots: each element stands at both of its ends, so that a particle sums over its own elements.

They stand in ascending global number; so the sum has the same order, and the same bits, on any number of
ranks. An element is computed at both ends, from the same bits: twice the arithmetic, but nothing is
scattered.
"""

import math

import numpy as np

from netfall.core.kernels import inner_kernel, kernel, part_of_kernel
from netfall.core.records import has
from netfall.mechanics.fields import EMPTY, fields_of
from netfall.mechanics.law.element import yield_energy
from netfall.mechanics.slip.law import slipped_length
from netfall.mechanics.slip.motion import is_whole
from netfall.mechanics.state import State


def fill_slots(state: State) -> None:
    """Put the elements, as they are attached now, into the slots of the particles that this rank steps."""
    s = state
    filled = np.zeros(s.n_local, np.int32)
    element = np.empty_like(s.other) if s.slot_element is None else s.slot_element
    attach_elements(s.n_owned, s.first_split, s.n_local, s.ends, s.EA, s.other, element, filled)
    fill_lengths(s.n_local, element, s.L0, s.inv_L0)
    if s.slot_highest is not None:
        s.slot_highest[:] = -np.inf
    if s.slot_lowest is not None:
        s.slot_lowest[:] = np.inf
    for field in fields_of("slot"):
        slot = getattr(s, field.name)
        if field.slot_of and slot is not None:
            copy = copy_marks_to_slots if slot.dtype == np.uint8 else copy_to_slots
            copy(s.n_local, element, getattr(s, field.slot_of), slot)


@kernel
def attach_elements(n_owned, first_split, n_local, ends, EA, other, slot_element, filled):
    """Put every element into a slot of each of its ends that this rank steps, in ascending order.

    ends, EA : of the elements
    other : (slots, n), out, far ends, the particle's own in an empty slot; slot_element : (slots, n), out,
        EMPTY there; filled : (n,), out, slots in use, the first ones
    """
    for s in range(other.shape[0]):
        for p in range(n_local):
            other[s, p], slot_element[s, p] = p, EMPTY
    filled[:n_local] = 0
    for e in range(ends.shape[0]):
        if EA[e] == 0.0:
            continue  # another rank has kept it, or it is out of the net
        for end in range(2):
            p = ends[e, end]
            if n_owned <= p and p < first_split:
                continue
            other[filled[p], p], slot_element[filled[p], p] = ends[e, 1 - end], e
            filled[p] += 1


@kernel
def fill_lengths(n_local, slot_element, L0, inv_L0):
    """1 / L0 of the elements, L0 (m,) [m], into the slots, inv_L0 (slots, n) [1/m]; 0 in an empty one."""
    for s in range(inv_L0.shape[0]):
        for p in range(n_local):
            e = slot_element[s, p]
            inv_L0[s, p] = 0.0 if e == EMPTY else 1.0 / L0[e]


@part_of_kernel
def _copy_to_slots(n_local, slot_element, values, slot):
    for s in range(slot.shape[0]):
        for p in range(n_local):
            e = slot_element[s, p]
            if e == EMPTY:
                slot[s, p] = 0
            else:
                slot[s, p] = values[e]


@kernel
def copy_to_slots(n_local, slot_element, values, slot):
    """A field of the elements (m,) into a field of the slots (slots, n); nothing of use in an empty slot."""
    _copy_to_slots(n_local, slot_element, values, slot)


@kernel
def copy_marks_to_slots(n_local, slot_element, values, slot):
    """The same of a field of bytes: of a kernel kept on disk there is one version."""
    _copy_to_slots(n_local, slot_element, values, slot)


@inner_kernel
def follow_slips(places, n_owned, first_split, particles, elements, slots):
    """Bring unstressed lengths, in slots too, to slips that have moved. places : `slip.motion.Places`"""
    for g in range(places.start.shape[0] - 1):
        first = places.element[places.start[g]]
        if not has_moved(first, particles, elements) or not is_whole(g, places, elements):
            continue
        for j in range(places.start[g], places.start[g + 1]):
            e = places.element[j]
            elements.L0[e] = slipped_length(e, particles.slip, elements)
            for end in range(2):
                p = np.int64(elements.ends[e, end])
                if p < n_owned or p >= first_split:
                    slots.inv_L0[slot_of(e, p, slots), p] = 1.0 / elements.L0[e]


@inner_kernel
def has_moved(e, particles, elements):
    """Whether a slip point at an end of the segment of element e has moved in this step."""
    for end in range(2):
        c = elements.slip_place[e, end]
        if c >= 0 and particles.slip_v[c, elements.slip_at[e, end]] != 0.0:
            return True
    return False


@inner_kernel
def slot_of(e, p, slots):
    """The slot of element e at particle p, which has one."""
    s = 0
    while slots.element[s, p] != np.uint32(e):
        s += 1
    return s


@inner_kernel
def own_slot(e, n_owned, first_split, elements, slots):
    """The slot of element e that keeps its extremes until it breaks, and the particle: the lower in number.

    At the other end if this one is the halo's, as what is left of a broken one may have it.
    """
    a, b = elements.ends[e, 0], elements.ends[e, 1]
    p = min(a, b)
    if n_owned <= p and p < first_split:
        p = max(a, b)
    return slot_of(e, p, slots), p


@inner_kernel
def collect_element(e, n_owned, first_split, elements, slots, law):
    """Bring element e up to date with its slots: plastic strain and heat, extremes, branches.

    The heat of a cable, whose plastic strain only grows, follows from that; a bar's stands already. Extremes
    until it breaks: what is left of it then has no strength, and rings on a light end.
    """
    s, p = own_slot(e, n_owned, first_split, elements, slots)
    if has(slots.eps_p):
        elements.eps_p[e] = slots.eps_p[s, p]
        if not elements.bar[e] and elements.eps_p[e] != 0.0:
            elements.dissipated[e] = yield_energy(elements, e, 0.0, elements.eps_p[e], law)
    if has(slots.highest) and elements.broken[e] == 0:
        elements.highest[e] = max(elements.highest[e], slots.highest[s, p])
        if has(elements.lowest):
            elements.lowest[e] = min(elements.lowest[e], slots.lowest[s, p])
    if has(slots.branch_a):
        elements.branch_a[e], elements.branch_b[e] = slots.branch_a[s, p], slots.branch_b[s, p]
        if has(elements.branch_c):
            elements.branch_c[e] = slots.branch_c[s, p]


@kernel
def collect_elements(n_owned, first_split, elements, slots, law):
    """`collect_element` of all elements that this rank steps."""
    for e in range(elements.ends.shape[0]):
        if elements.EA[e] != 0.0:
            collect_element(e, n_owned, first_split, elements, slots, law)


@inner_kernel
def empty_slot(s, p, slots):
    """Leave a slot of particle p empty: it adds nothing."""
    slots.element[s, p], slots.inv_L0[s, p] = EMPTY, 0.0
    if has(slots.bar):
        slots.bar[s, p] = 0


@inner_kernel
def fill_slot(e, s, p, far, elements, slots):
    """Put element e, whose far end is particle `far`, into a slot of particle p."""
    slots.other[s, p], slots.element[s, p], slots.inv_L0[s, p] = far, e, 1.0 / elements.L0[e]
    if has(slots.EA):
        slots.EA[s, p] = elements.EA[e]
    if has(slots.bar):
        slots.bar[s, p] = elements.bar[e]
    if has(slots.euler):
        slots.euler[s, p] = elements.euler[e]
    if has(slots.yield_force):
        slots.yield_force[s, p] = elements.yield_force[e]
    if has(slots.yield_strain):
        slots.yield_strain[s, p] = elements.yield_strain[e]
    if has(slots.eps_p):
        slots.eps_p[s, p] = elements.eps_p[e]
    if has(slots.reach):
        slots.reach[s, p] = elements.reach[e]
    if has(slots.near):
        slots.near[s, p] = elements.near[e]
    if has(slots.highest):
        slots.highest[s, p] = -math.inf
    if has(slots.lowest):
        slots.lowest[s, p] = math.inf
    if has(slots.branch_a):
        slots.branch_a[s, p], slots.branch_b[s, p] = elements.branch_a[e], elements.branch_b[e]
    if has(slots.branch_c):
        slots.branch_c[s, p] = elements.branch_c[e]
