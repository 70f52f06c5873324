"""Elements that yield or reach their fracture strain, looked at one by one where one is near.

The pass over vectors only points at particles that have such an element; here it is decided, exactly.
"""

import numpy as np

from netfall.core.kernels import inner_kernel
from netfall.core.records import has
from netfall.mechanics.law.element import strain, yield_energy
from netfall.physics.targets import element

inverse_length, grown, shrunk = element.inverse_length, element.grown, element.shrunk
logarithmic_strain, engineering_strain = element.logarithmic_strain, element.engineering_strain


@inner_kernel
def length_of(p, o, x):
    """Distance [m] of two particles. x : (3, n) [m]"""
    return inverse_length(x[0, o] - x[0, p], x[1, o] - x[1, p], x[2, o] - x[2, p])[1]


@inner_kernel
def look_closer(c, count, x, near, chunks, elements, slots, law):
    """Yield of the elements of chunk c at x(n), and those that reach their fracture strain.

    count : elements that are to break in this step, so far; how many there are then
    near : (particles of the chunk,); only those where it is not 0 are looked at
    elements.pending : out, elements from place `count` on

    The end that `reports` keeps the element's record: the first in number that is not the halo's.
    """
    low, high, first_split = chunks.low[c], chunks.high[c], chunks.n_owned + chunks.n_halo
    for p in range(low, high):
        if near[p - low] == 0:
            continue
        for s in range(chunks.width[c]):
            if slots.inv_L0[s, p] == 0.0:
                continue
            e, o = slots.element[s, p], np.int64(slots.other[s, p])
            L = length_of(p, o, x)
            if not law.plastic and not has(elements.eps_c):
                reach = slots.reach[s, p] if has(slots.reach) else law.reach
                if L * slots.inv_L0[s, p] < reach:
                    continue  # far from fracture, which is all that is looked for
            reports = p < o or (chunks.n_owned <= o and o < first_split)
            eps = strain(L, elements.L0[e], law)
            if law.plastic and elements.bar[e]:
                before = slots.eps_p[s, p]
                eps_p = yielded(p, o, s, x, slots, law)
                if eps_p != before and reports:
                    elements.dissipated[e] += yield_energy(elements, e, before, eps_p, law)
                slots.eps_p[s, p] = eps_p
            if has(elements.eps_u) and reports and is_over(e, eps, elements):
                elements.pending[count] = e
                count += 1
    return count


@inner_kernel
def is_over(e, eps, elements):
    """Whether element e breaks at strain eps."""
    if has(elements.eps_c) and eps < elements.eps_c[e]:
        return True
    return eps > elements.eps_u[e]


@inner_kernel
def is_any_over(x, elements, law):
    """Whether an element has passed its fracture strain at x (3, n) [m]."""
    for e in range(elements.ends.shape[0]):
        L = length_of(np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1]), x)
        if elements.EA[e] != 0.0 and is_over(e, strain(L, elements.L0[e], law), elements):
            return True
    return False


@inner_kernel
def yielded(p, o, s, x, slots, law):
    """Plastic strain of the bar in slot s of particle p at x(n), to the bits of the pass over vectors."""
    L, per_L0 = length_of(p, o, x), slots.inv_L0[s, p]
    limit, eps_p = law.yield_strain, slots.eps_p[s, p]
    if has(slots.yield_strain):
        limit = slots.yield_strain[s, p]
    eps = logarithmic_strain(L, per_L0) if law.logarithmic else engineering_strain(L, per_L0)
    new = grown(eps, eps_p, limit)
    if has(slots.euler) and slots.euler[s, p] < np.inf:
        return new
    return shrunk(eps, new, limit)
