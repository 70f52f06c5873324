"""The first pass over a chunk of particles: forces of the elements at each.

A vector holds LANES particles, one after the other. Each sums over its own elements in the order of their
global numbers, so that the sum has the same bits on any number of ranks; an element is computed at both ends,
from the same bits. Forces wait in a scratch, which stays in the first cache, for the second pass (`motion`).

Three variants are compiled with literals. While no element of a chunk is near a limit, all of them are
elastic; then cables that yield have a variant of their own, and any other kind of element the general one.
The rest of what a scene has is looked up at run time.
"""

import numpy as np

from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.records import Record, f8, f8_2, has, u1
from netfall.core.vectors import (
    LANES,
    any_of,
    are_consecutive,
    fma,
    gather,
    load,
    load_truths,
    maximum,
    minimum,
    nowhere,
    put,
    store,
    store_truths,
    where,
    zeros,
)
from netfall.mechanics.fields import SLOTS
from netfall.physics.targets import element

INFINITE = float("inf")
inverse_length, elastic_density = element.inverse_length, element.elastic_density
logarithmic_density, logarithmic_strain = element.logarithmic_density, element.logarithmic_strain
engineering_strain = element.engineering_strain
grown, shrunk, branch = element.grown, element.shrunk, element.branch


class Scratch(Record):
    """Of the particles of a chunk, (3, c) [N] each.

    f : internal forces; band : of the branches alone, absent: there are none; near : (c,) 1 where an element
    is near its limits; external, total : forces; pull : (c,) of the air's damping (`motion.total_forces`)
    """

    f: f8_2
    band: f8_2
    near: u1
    external: f8_2
    total: f8_2
    pull: f8


@part_of_kernel
def of_slot(array, s, p, alike):
    """Numbers of the elements in slot s of LANES particles from p on; or what is alike for all."""
    value = zeros() + alike
    if has(array):
        value = load(array, s, p)
    return value


@part_of_kernel
def far_ends(s, p, in_line, x, other):
    """Positions [m] of the far ends in slot s of LANES particles from p on, three.

    in_line : whether they stand one after the other; other : their numbers
    """
    if in_line:
        first = np.int64(other[s, p])
        return load(x, 0, first), load(x, 1, first), load(x, 2, first)
    return gather(x, 0, other, s, p), gather(x, 1, other, s, p), gather(x, 2, other, s, p)


@part_of_kernel
def general_density(s, p, per_L, L, per_L0, eps_p, bar, slots, law):
    """N / L [N/m] of elements of any kind; where they are near their limits; their plastic strain.

    eps_p : plastic strain so far; bar : whether they carry compression
    """
    EA = of_slot(slots.EA, s, p, law.EA)
    if law.logarithmic:
        q = logarithmic_density(per_L, L, per_L0, eps_p, EA)
    else:
        q = elastic_density(per_L, per_L0, eps_p, EA)
    highest = of_slot(slots.yield_force, s, p, law.yield_force) * per_L
    reach, past, new = of_slot(slots.reach, s, p, law.reach), nowhere(), eps_p
    if law.plastic:
        limit = of_slot(slots.yield_strain, s, p, law.yield_strain)
        eps = logarithmic_strain(L, per_L0) if law.logarithmic else engineering_strain(L, per_L0)
        new = grown(eps, eps_p, limit)
        if has(slots.bar):  # their heat does not follow from their plastic strain: looked at one by one
            yields = bar & (of_slot(slots.euler, s, p, INFINITE) == INFINITE)
            past = bar & (where(yields, shrunk(eps, new, limit), new) != eps_p)
            new = where(bar, eps_p, new)
    past = past | (fma(reach, per_L, -per_L0) < 0.0)
    lowest = where(bar, -highest, zeros())
    if has(slots.euler):
        past = past | (bar & (fma(reach, per_L0, -per_L) < 0.0))
        buckled = -load(slots.euler, s, p) * per_L
        lowest = where(buckled > lowest, buckled, lowest)
    q = where(q > highest, highest, q)
    return where(q > lowest, q, lowest), past, new


@part_of_kernel
def elastic_forces(s, p, per_L, per_L0, slots, law):
    """Return N / L [N/m] of elements without plastic strain, and where they are near a limit.

    The strain is the engineering strain.
    """
    q = elastic_density(per_L, per_L0, zeros(), of_slot(slots.EA, s, p, law.EA))
    near = of_slot(slots.near, s, p, law.near)
    if has(slots.bar):
        bar = load_truths(slots.bar, s, p)
        q = where(bar | (q > 0.0), q, zeros())
        return q, fma(near, per_L, -abs(q)) < 0.0
    past = fma(near, per_L, -q) < 0.0
    return where(q > 0.0, q, zeros()), past


@part_of_kernel
def yielding_cable(s, p, per_L, L, per_L0, eps_p, slots, law):
    """Return N / L [N/m] of cables that may yield, where they are near fracture, and their plastic strain.

    The strain is the engineering strain.
    """
    q = elastic_density(per_L, per_L0, eps_p, of_slot(slots.EA, s, p, law.EA))
    new = grown(engineering_strain(L, per_L0), eps_p, of_slot(slots.yield_strain, s, p, law.yield_strain))
    past = fma(of_slot(slots.reach, s, p, law.reach), per_L, -per_L0) < 0.0
    highest = of_slot(slots.yield_force, s, p, law.yield_force) * per_L
    q = where(q > highest, highest, q)
    return where(q > 0.0, q, zeros()), past, new


@part_of_kernel
def are_repeated(slots, law):
    """Whether elements near a limit may yield or buckle, so that the elastic pass does not serve them."""
    return law.plastic > 0 or has(slots.euler)


@part_of_kernel
def keep_extremes(N, skipped, s, p, slots):
    """Take in axial forces N [N] of the elements in slot s, but where they are skipped.

    In places beyond those of a chunk too, which nobody reads: there are broken elements, or none.
    """
    most = load(slots.highest, s, p)
    store(slots.highest, s, p, where(skipped, most, maximum(N, most)))
    if has(slots.lowest):
        least = load(slots.lowest, s, p)
        store(slots.lowest, s, p, where(skipped, least, minimum(N, least)))


@part_of_kernel
def with_branches(q, per_L, L, s, p, high, bar, slots, law):
    """N / L [N/m] with the branches of axial damping, without them q; their state goes on to n + 1."""
    of, N = law.branches, q * L
    a, b = load(slots.branch_a, s, p), load(slots.branch_b, s, p)
    held = a + b
    put(p, high, slots.branch_a, s, branch(a, N, of[2, 0], of[3, 0]))
    put(p, high, slots.branch_b, s, branch(b, N, of[2, 1], of[3, 1]))
    if has(slots.branch_c):
        c = load(slots.branch_c, s, p)
        held = held + c
        put(p, high, slots.branch_c, s, branch(c, N, of[2, 2], of[3, 2]))
    total = fma(-held, per_L, of[4, 0] * q)
    return where(bar | (total > 0.0), total, zeros())


@part_of_kernel
def vector_forces(p, high, i, width, in_line, general, yields, x, slots, law, scratch):
    """`add_forces` of LANES particles from p on, into place i; where any element is near a limit."""
    peaks, branches = has(slots.highest), general and has(law.branches)
    px, py, pz = load(x, 0, p), load(x, 1, p), load(x, 2, p)
    fx, fy, fz, near = zeros(), zeros(), zeros(), nowhere()
    bx, by, bz, bar = zeros(), zeros(), zeros(), nowhere()
    repeated = not general and not yields and are_repeated(slots, law)
    for s in range(width):
        ox, oy, oz = far_ends(s, p, in_line, x, slots.other)
        dx, dy, dz = ox - px, oy - py, oz - pz
        per_L, L = inverse_length(dx, dy, dz)
        per_L0, eps_p = load(slots.inv_L0, s, p), zeros()
        if yields:
            eps_p = load(slots.eps_p, s, p)
        if general:
            if has(slots.bar):
                bar = load_truths(slots.bar, s, p)
            q, past, new = general_density(s, p, per_L, L, per_L0, eps_p, bar, slots, law)
        elif yields:
            q, past, new = yielding_cable(s, p, per_L, L, per_L0, eps_p, slots, law)
        else:
            q, past = elastic_forces(s, p, per_L, per_L0, slots, law)
            new = eps_p
        if yields and any_of(new != eps_p):
            put(p, high, slots.eps_p, s, new)
        near = near | past
        if peaks:  # elements near yield are computed again
            keep_extremes(q * L, past if repeated else nowhere(), s, p, slots)
        if branches:
            total = with_branches(q, per_L, L, s, p, high, bar, slots, law)
            alone, q = total - q, total
            bx, by, bz = fma(alone, dx, bx), fma(alone, dy, by), fma(alone, dz, bz)
        fx, fy, fz = fma(q, dx, fx), fma(q, dy, fy), fma(q, dz, fz)
    store(scratch.f, 0, i, fx)
    store(scratch.f, 1, i, fy)
    store(scratch.f, 2, i, fz)
    if branches:
        store(scratch.band, 0, i, bx)
        store(scratch.band, 1, i, by)
        store(scratch.band, 2, i, bz)
    return near


@part_of_kernel
def add_forces(low, high, width, general, yields, x, slots, law, scratch):
    """Sum the forces of the elements at particles low to high into the scratch; whether any is near a limit.

    width : most elements at one of them; general : whether they are not all cables of one section
    yields : whether they may have plastic strains, which go on to x (3, n) [m]
    """
    anywhere = nowhere()
    for p in range(low, high, LANES):
        in_line = not general
        for s in range(width):
            in_line = in_line and are_consecutive(slots.other, s, p)
        if in_line:
            near = vector_forces(p, high, p - low, width, True, general, yields, x, slots, law, scratch)
        else:
            near = vector_forces(p, high, p - low, width, False, general, yields, x, slots, law, scratch)
        store_truths(scratch.near, 0, p - low, near)
        anywhere = anywhere | near
    return any_of(anywhere)


@inner_kernel
def elastic_elements(low, high, width, x, slots, law, scratch):
    """Sum the forces of elements without plastic strain; the result does not hold where one is near yield."""
    if width == SLOTS:  # unrolled
        return add_forces(low, high, SLOTS, False, False, x, slots, law, scratch)
    return add_forces(low, high, width, False, False, x, slots, law, scratch)


@inner_kernel
def yielding_cables(low, high, width, x, slots, law, scratch):
    """Sum the forces of cables that may have plastic strains."""
    if width == SLOTS:
        return add_forces(low, high, SLOTS, False, True, x, slots, law, scratch)
    return add_forces(low, high, width, False, True, x, slots, law, scratch)


@inner_kernel
def elements_of_any_kind(low, high, width, x, slots, law, scratch):
    """Sum the forces of cables and bars that may yield or buckle, by any law."""
    return add_forces(low, high, width, True, has(slots.eps_p), x, slots, law, scratch)


@inner_kernel
def chunk_forces(c, plain, x, chunks, slots, law, scratch):
    """Forces of the elements at the particles of chunk c, with yield; whether any is near a limit.

    plain : whether the law is in the engineering strain, without branches
    """
    low, high, width = chunks.low[c], chunks.high[c], chunks.width[c]
    if not plain:
        chunks.has_yielded[c] = law.plastic
        return elements_of_any_kind(low, high, width, x, slots, law, scratch)
    if not chunks.has_yielded[c]:
        near = elastic_elements(low, high, width, x, slots, law, scratch)
        if not (near and are_repeated(slots, law)):
            return near
    chunks.has_yielded[c] = 1
    if has(slots.bar):
        return elements_of_any_kind(low, high, width, x, slots, law, scratch)
    return yielding_cables(low, high, width, x, slots, law, scratch)
