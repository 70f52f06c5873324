"""Fractures within the time loop: exact check of the limits of elements, one by one, and their break.

The vector pass only flags the particles with an element near yield or fracture; the check decides.

A broken element leaves an empty slot at the particle it separates from and a new far end at the particle it
stays with. The new particle has one element and belongs to a chunk of such particles.
"""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray, Integer
from netfall.core.kernels import call, inner_kernel, part_of_kernel
from netfall.core.records import is_present
from netfall.core.threads import each
from netfall.core.vectors import LANES
from netfall.explicit.incidence import collect_element, empty_slot, fill_slot, slot_of
from netfall.physics.element_step import (
    engineering_strain,
    grown,
    inverse_length,
    logarithmic_strain,
    shrunk,
)
from netfall.physics.events import FractureStep
from netfall.physics.fields import Elements, Slots
from netfall.physics.fracture import Fractures, choose_ends, lengthen_fragment, owns
from netfall.physics.law.element import strain, yield_energy
from netfall.physics.law.law import LawParameters


@inner_kernel
def particle_distance(p: Integer, o: Integer, x: FloatArray) -> float:
    """Compute the distance [m] of two particles. x : (3, n) [m]"""
    return inverse_length(x[0, o] - x[0, p], x[1, o] - x[1, p], x[2, o] - x[2, p])[1]


@inner_kernel
def check_limits(c: int, count: Integer, x: FloatArray, work: Any) -> int:
    """Apply yield to the elements of chunk c at x(n), and list those that reach their fracture strain.

    count : number of elements that break in this step so far; the updated number is returned
    work : `loop.LoopState`. Particles that are not near a limit by the margin in its scratch are skipped; its
        elements.pending gets the elements from place `count` on
    """
    chunks, elements, slots, margin = work.chunks, work.elements, work.slots, work.scratch.margin
    low, high, n_owned = chunks.low[c], chunks.high[c], chunks.n_owned
    first_split = n_owned + chunks.n_halo
    for p in range(low, high):
        if not margin[p - low] < 0.0:
            continue
        for s in range(chunks.width[c]):
            if breaks_at(s, p, x, n_owned, first_split, elements, slots, work.law):
                elements.pending[count] = slots.element[s, p]
                count += 1
    return count


@inner_kernel
def breaks_at(
    s: int,
    p: int,
    x: FloatArray,
    n_owned: int,
    first_split: int,
    elements: Elements,
    slots: Slots,
    law: LawParameters,
) -> bool:
    """Apply yield to the element in slot s of particle p at x(n); return whether it breaks.

    One end of an element, which `reports`, updates its record: the lower row that is not a halo row.
    """
    if slots.inv_L0[s, p] == 0.0:
        return False
    e: Integer = np.int64(slots.element[s, p])
    far = np.int64(slots.other[s, p])
    L = particle_distance(p, far, x)
    if not law.plastic and not is_present(elements.eps_c):
        reach = slots.check_stretch[s, p] if is_present(slots.check_stretch) else law.check_stretch[0]
        if L * slots.inv_L0[s, p] < reach:
            return False  # nothing yields, and the element is far from fracture
    reports = p < far or (n_owned <= far and far < first_split)
    eps = strain(L, elements.L0[e], law)
    if law.plastic and elements.bar[e]:
        old_eps_p = slots.eps_p[s, p]
        eps_p = yielded(p, far, s, x, slots, law)
        if eps_p != old_eps_p and reports:
            elements.dissipated[e] += yield_energy(elements, e, old_eps_p, eps_p, law)
        slots.eps_p[s, p] = eps_p
    return bool(is_present(elements.eps_u) and reports and exceeds_fracture_strain(e, eps, elements))


@inner_kernel
def exceeds_fracture_strain(e: int, eps: float, elements: Elements) -> bool:
    """Return whether element e breaks at strain eps."""
    if is_present(elements.eps_c) and eps < elements.eps_c[e]:
        return True
    return eps > elements.eps_u[e]


@inner_kernel
def any_exceeds_fracture_strain(x: FloatArray, elements: Elements, law: LawParameters) -> bool:
    """Return whether an element of this thread exceeds its fracture strain at x (3, n) [m]."""
    for e in each(0, elements.ends.shape[0]):
        L = particle_distance(np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1]), x)
        eps = strain(L, elements.L0[e], law)
        if elements.EA[e] != 0.0 and exceeds_fracture_strain(e, eps, elements):
            return True
    return False


@inner_kernel
def yielded(p: Integer, o: Integer, s: Integer, x: FloatArray, slots: Slots, law: LawParameters) -> float:
    """Return the plastic strain of the bar in slot s of particle p at x(n), bitwise as in the vector pass."""
    L, per_L0 = particle_distance(p, o, x), slots.inv_L0[s, p]
    limit, eps_p = law.yield_strain[0], slots.eps_p[s, p]
    if is_present(slots.yield_strain):
        limit = slots.yield_strain[s, p]
    eps = logarithmic_strain(L, per_L0) if law.logarithmic else engineering_strain(L, per_L0)
    new = grown(eps, eps_p, limit)
    if is_present(slots.euler) and slots.euler[s, p] < np.inf:
        return new
    return shrunk(eps, new, limit)


@inner_kernel
def break_elements(
    count: int,
    when: FractureStep,
    x: FloatArray,
    chunks: Any,
    elements: Elements,
    slots: Slots,
    law: LawParameters,
    fractures: Fractures,
) -> None:
    """Break the `count` elements in elements.pending; lengthen fragments that exceed their strength.

    when : `events.FractureStep`
    x : (3, n) [m] present positions, `particles.x` or another array. Fractures read and write `particles.x`:
        the ends of the elements are copied there, and the new particles back.
    """
    pending, particles, rows = elements.pending, fractures.particles, fractures.rows
    first_new = rows[0]
    for k in range(count):
        for end in range(2):
            copy_position(np.int64(elements.ends[pending[k], end]), x, particles.x)
    shell_sort(pending, count)
    for k in range(count):
        choose_ends(np.int64(pending[k]), fractures.rules.zeta, elements, particles)
    for k in range(count):
        e = np.int64(pending[k])
        if elements.broken[e]:
            lengthen_fragment(e, when.dt, elements, particles, law)
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
    for p in range(first_new, rows[0]):
        copy_position(p, particles.x, x)


@part_of_kernel
def copy_position(p: Integer, source: FloatArray, x: FloatArray) -> None:
    """Copy the position of particle p from one array (3, n) [m] to another, which may be the same."""
    for k in range(3):
        x[k, p] = source[k, p]


@inner_kernel
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


@inner_kernel
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
        if is_present(slots.yield_strain):
            slots.yield_force[s, before] = elements.yield_force[e]
            slots.yield_strain[s, before] = elements.yield_strain[e]
        slots.other[s, before] = far
        chunks.in_line[before - before % LANES] = 0
    if not removed and now != before:
        for s in range(slots.other.shape[0]):
            slots.other[s, now] = now
            empty_slot(s, now, slots)
        fill_slot(e, 0, now, far, elements, slots)
        c = chunks.owned + (now - rules.first_split) // chunks.size
        chunks.high[c] = max(chunks.high[c], now + 1)
        if is_present(slots.eps_p):
            chunks.has_yielded[c] = 1
