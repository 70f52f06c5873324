"""Elements that yield or reach their fracture strain, looked at one by one where one is near.

The vector loop only points at particles that have such an element; here it is decided, exactly.
"""

import math

import numpy as np

from netfall.ground.compile import inner_kernel, kernel_apart, part_of_kernel, vector_kernel
from netfall.mechanics.fields import SLOTS
from netfall.mechanics.law.element import strain, yield_energy
from netfall.mechanics.law.slot import plastic_strain, squared_length
from netfall.numerics.arithmetic import inverse_root

BLOCK = 64  # particles that are passed over at once


@vector_kernel
def count_near(near, particles):
    """How many of the first so many particles of a chunk have an element near yield or fracture."""
    count = np.int64(0)
    for i in range(np.uint64(particles)):
        count += near[i]
    return count


@inner_kernel
def length_of(p, o, moved):
    """Distance [m] of two particles."""
    x = moved.x
    dx, dy, dz = x[0][o] - x[0][p], x[1][o] - x[1][p], x[2][o] - x[2][p]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel_apart
def look_closer(c, chunks, moved, elements, slots, law, found):
    """Yield of the elements of chunk c at x(n), and those that reach their fracture strain.

    moved, found : of `loop`; only particles where found.near is not 0 are looked at, and their forces kept

    The end that `reports` keeps the element's record: the first in number that is not the halo's
    (`slots.own_slot`), whose slot is up to date where the other end borrows.
    elements.pending : out, elements from place found.count[0] on
    """
    near, f, count = found.near, found.f, found.count[0]
    low, high, first_split = chunks.low[c], chunks.high[c], chunks.n_owned + chunks.n_halo
    any_yield = False
    for begin in range(low, high, BLOCK):
        end = min(begin + BLOCK, high)
        if count_near(near[begin - low :], end - begin) == 0:
            continue
        for p in range(begin, end):
            if near[p - low] == 0:
                continue
            for k in range(3):
                moved.f[k][p] = f[k][p - low]
            for s in range(max(chunks.width[c], SLOTS)):
                if slots.inv_L0[s, p] == 0.0:
                    continue
                e, o = slots.element[s, p], slots.other[s, p]
                L = length_of(p, o, moved)
                if elements.yield_force is None:  # noqa: SIM102 (the compiler drops a branch on this alone)
                    if elements.eps_c is None:
                        reach = law.reach if slots.reach is None else slots.reach[s, p]
                        if L * slots.inv_L0[s, p] < reach:
                            continue  # far from fracture, which is all that is looked for
                reports = p < o or (chunks.n_owned <= o and o < first_split)
                eps = strain(L, elements.L0[e], law)
                if elements.yield_force is not None:
                    before = slots.eps_p[s, p]
                    eps_p = yielded(p, o, s, moved, slots, law)
                    if eps_p != before:
                        any_yield = True
                        if reports and elements.bar[e]:
                            elements.dissipated[e] += yield_energy(elements, e, before, eps_p, law)
                        slots.eps_p[s, p] = eps_p
                if elements.eps_u is not None and reports and is_over(e, eps, elements):
                    elements.pending[count] = e
                    count += 1
    found.count[0] = count
    chunks.has_yielded[c] |= any_yield


@part_of_kernel
def is_over(e, eps, elements):
    """Whether element e breaks at strain eps."""
    if elements.eps_c is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if eps < elements.eps_c[e]:
            return True
    return eps > elements.eps_u[e]


@kernel_apart
def find_over(moved, elements, law, found):
    """Whether an element has passed its fracture strain at the present positions: into found.count."""
    for e in range(elements.ends.shape[0]):
        L = length_of(elements.ends[e, 0], elements.ends[e, 1], moved)
        if elements.EA[e] != 0.0 and is_over(e, strain(L, elements.L0[e], law), elements):
            found.count[0] = 1
            return


@inner_kernel
def yielded(p, o, s, moved, slots, law):
    """Plastic strain of the element in slot s of particle p at x(n), to the bits of the vector loop."""
    x = moved.x
    square = squared_length((x[0][o] - x[0][p], x[1][o] - x[1][p], x[2][o] - x[2][p]))
    stretch = square * inverse_root(square) * slots.inv_L0[s, p]
    return plastic_strain(stretch, slots.eps_p[s, p], s, p, slots, law)
