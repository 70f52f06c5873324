"""Fractures within the time loop: elements break, and the affected slots and chunks are updated.

A broken element leaves an empty slot at the particle it separates from and a new far end at the particle it
stays with. The new particle has one element and belongs to a chunk of such particles.
"""

from typing import Any

import numpy as np

from netfall.core.arrays import IntArray, Integer
from netfall.core.kernels import call, copied_kernel
from netfall.core.records import is_present
from netfall.explicit.incidence import collect_element, empty_slot, fill_slot, slot_of
from netfall.physics.events import FractureStep
from netfall.physics.fields import Elements, Slots
from netfall.physics.fracture import Fractures, choose_ends, lengthen_fragment, owns
from netfall.physics.law.law import LawParameters


@copied_kernel
def break_elements(
    count: int,
    when: FractureStep,
    chunks: Any,
    elements: Elements,
    slots: Slots,
    law: LawParameters,
    fractures: Fractures,
) -> None:
    """Break the `count` elements in elements.pending; lengthen fragments that exceed their strength.

    when : `events.FractureStep`
    """
    pending = elements.pending
    shell_sort(pending, count)
    for k in range(count):
        choose_ends(np.int64(pending[k]), elements, fractures.particles)
    for k in range(count):
        e = np.int64(pending[k])
        if elements.broken[e]:
            lengthen_fragment(e, when.dt, elements, fractures.particles, law)
            for end in range(2):
                p = np.int64(elements.ends[e, end])
                if owns(p, fractures.rules):  # without a split one end may be a halo particle
                    slots.inv_L0[slot_of(e, p, slots), p] = 1.0 / elements.L0[e]
            continue
        collect_element(e, chunks.n_owned, chunks.n_owned + chunks.n_halo, elements, slots, law)
        a, b = np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1])
        call(fractures.break_element, (e, when.time, when.step, when.dt, elements, law, fractures))
        for end in range(2):
            update_end_slots(e, end, b if end else a, chunks, elements, slots, fractures)


@copied_kernel
def shell_sort(numbers: IntArray, count: int) -> None:
    """Sort the first `count` of some numbers in place (Shell sort)."""
    gap = 1
    while 3 * gap < count:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(gap, count):
            value, index = numbers[k], k
            while index >= gap and numbers[index - gap] > value:
                numbers[index] = numbers[index - gap]
                index -= gap
            numbers[index] = value
        gap //= 3


@copied_kernel
def update_end_slots(
    e: Integer,
    end: Integer,
    before: Integer,
    chunks: Any,
    elements: Elements,
    slots: Slots,
    fractures: Fractures,
) -> None:
    """Update the slots at an end (0, 1) of the broken element e. before : the particle there until then"""
    rules = fractures.rules
    now, far = np.int64(elements.ends[e, end]), np.int64(elements.ends[e, 1 - end])
    removed = elements.EA[e] == 0.0  # removed, or held by another rank
    if owns(before, rules) and (removed or now != before):
        empty_slot(slot_of(e, before, slots), before, slots)
    elif owns(before, rules):
        s = slot_of(e, before, slots)
        if is_present(slots.check_stretch):
            slots.check_stretch[s, before] = elements.check_stretch[e]
        slots.other[s, before] = far
    if not removed and now != before:
        for s in range(slots.other.shape[0]):
            slots.other[s, now] = now
            empty_slot(s, now, slots)
        fill_slot(e, 0, now, far, elements, slots)
        c = chunks.owned + (now - rules.first_split) // chunks.size
        chunks.high[c] = max(chunks.high[c], now + 1)
        if is_present(slots.eps_p):
            chunks.has_yielded[c] = 1
