"""Fractures within the time loop: elements break, and slots and chunks follow where they are touched.

What an element that breaks leaves is a slot that stays empty, at the particle that it left, a new far end, at
the particle that it stays with, and a particle with one element, which stands in a chunk of such.
"""

import numpy as np

from netfall.core.kernels import inner_kernel
from netfall.core.records import has
from netfall.mechanics.fracture import break_element, decide, lengthen, owns
from netfall.step.slots import collect_element, empty_slot, fill_slot, slot_of


@inner_kernel
def break_elements(count, when, chunks, elements, slots, law, fractures):
    """Break the `count` elements in elements.pending; what is left of a broken one grows longer.

    when : `events.StepDone`
    """
    pending = elements.pending
    sort(pending, count)
    for k in range(count):
        decide(pending[k], elements, fractures.particles)
    for k in range(count):
        e = pending[k]
        if elements.broken[e]:
            lengthen(e, when.dt, elements, fractures.particles, law)
            for end in range(2):
                p = np.int64(elements.ends[e, end])
                if owns(p, fractures.rules):  # one end is the halo's where nothing has split off
                    slots.inv_L0[slot_of(e, p, slots), p] = 1.0 / elements.L0[e]
            continue
        collect_element(e, chunks.n_owned, chunks.n_owned + chunks.n_halo, elements, slots, law)
        a, b = np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1])
        break_element(e, when, elements, law, fractures)
        follow_end(e, 0, a, chunks, elements, slots, fractures)
        follow_end(e, 1, b, chunks, elements, slots, fractures)


@inner_kernel
def sort(numbers, count):
    """Sort the first `count` of some numbers, by Shell's method."""
    gap = 1
    while 3 * gap < count:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(gap, count):
            mine, place = numbers[k], k
            while place >= gap and numbers[place - gap] > mine:
                numbers[place] = numbers[place - gap]
                place -= gap
            numbers[place] = mine
        gap //= 3


@inner_kernel
def follow_end(e, end, before, chunks, elements, slots, fractures):
    """Slots at an end (0, 1) of element e, which has broken. before : the particle there until then"""
    rules = fractures.rules
    there, far = np.int64(elements.ends[e, end]), np.int64(elements.ends[e, 1 - end])
    out = elements.EA[e] == 0.0  # taken out of the net, or kept by another rank
    if owns(before, rules) and (out or there != before):
        empty_slot(slot_of(e, before, slots), before, slots)
    elif owns(before, rules):
        s = slot_of(e, before, slots)
        if has(slots.reach):
            slots.reach[s, before] = elements.reach[e]
        slots.other[s, before] = far
    if not out and there != before:
        for s in range(slots.other.shape[0]):
            slots.other[s, there] = there
            empty_slot(s, there, slots)
        fill_slot(e, 0, there, far, elements, slots)
        c = chunks.owned + (there - rules.first_split) // chunks.size
        chunks.high[c] = max(chunks.high[c], there + 1)
        if has(slots.eps_p):
            chunks.has_yielded[c] = 1
