"""First pass over a chunk of particles: element forces at each particle.

A vector holds LANES consecutive particles. Each particle sums over its incident elements in ascending global
number, so the sum has the same bits on any number of ranks. An element is computed at both ends, from the
same bits. The forces stay in a scratch array, in the first-level cache, for the second pass (`motion`).

There are three variants, which differ in the function for the force density. The elastic one is for a chunk
while none of its elements is near a limit. A second one is for cables that yield, and a general one for every
other kind of element. All other features are checked at run time.
"""

from collections.abc import Callable
from typing import Any

from netfall.core.arrays import FloatArray, Index, IntArray, Lanes
from netfall.core.kernels import copied_kernel, part_of_kernel
from netfall.core.records import Record, f8, f8_2, is_present
from netfall.core.vectors import (
    LANES,
    any_of,
    fma,
    gather,
    index_in,
    load,
    load_at,
    load_mask_at,
    maximum,
    minimum,
    nowhere,
    particle_at,
    store,
    store_at,
    store_below,
    where,
    zeros,
)
from netfall.physics.element_step import branch, inverse_length
from netfall.physics.fields import Slots
from netfall.physics.law.element import (
    elastic_force_density,
    general_force_density,
    yielding_force_density,
)
from netfall.physics.law.law import LawParameters

NAN = float("nan")


class Scratch(Record):
    """Forces on the particles of a chunk, (3, c) [N] each.

    f : internal forces; band : of the Maxwell branches alone, absent if there are none
    margin : (c,) negative if an element of the particle is near a limit
    external, total : forces; pull : (c,) of the aerodynamic damping (`motion.total_forces`)
    """

    f: f8_2
    band: f8_2
    margin: f8
    external: f8_2
    total: f8_2
    pull: f8


@part_of_kernel
def far_ends(at: Index, in_line: bool, x: FloatArray, other: IntArray) -> tuple[Lanes, Lanes, Lanes]:
    """Return the x, y and z [m] of the far ends in LANES slots.

    at : index of the slots; in_line : whether the far ends are consecutive rows; other : their rows
    """
    if in_line:
        first = particle_at(other, at)
        return load(x, 0, first), load(x, 1, first), load(x, 2, first)
    return gather(x, 0, other, at), gather(x, 1, other, at), gather(x, 2, other, at)


@part_of_kernel
def needs_inelastic_pass(slots: Slots, law: LawParameters) -> bool:
    """Return whether elements near a limit may yield or buckle, so that the elastic result is discarded."""
    return law.plastic > 0 or is_present(slots.euler)


@part_of_kernel
def update_extremes(N: Lanes, at: Index, slots: Slots) -> None:
    """Update the extremes of the axial forces N [N] of the elements in LANES slots; nan changes nothing.

    It also writes lanes beyond the end of the chunk. They hold broken elements or none, and nothing reads
    them. Extremes are seldom exceeded, so most steps write nothing.
    """
    highest = load_at(slots.highest, at)
    if any_of(N > highest):
        store_at(slots.highest, at, maximum(N, highest))
    if is_present(slots.lowest):
        lowest = load_at(slots.lowest, at)
        if any_of(N < lowest):
            store_at(slots.lowest, at, minimum(N, lowest))


@part_of_kernel
def with_branches(
    q: Lanes, per_L: Lanes, L: Lanes, s: int, p: int, high: int, bar: Lanes, slots: Slots, law: LawParameters
) -> Lanes:
    """Add the Maxwell branches of axial damping to q = N / L [N/m], and advance their state to n + 1."""
    factors, N, at = law.branches, q * L, index_in(slots.other, s, p)
    a, b = load_at(slots.branch_a, at), load_at(slots.branch_b, at)
    state_sum = a + b
    store_below(p, high, slots.branch_a, s, branch(a, N, factors[2, 0], factors[3, 0]))
    store_below(p, high, slots.branch_b, s, branch(b, N, factors[2, 1], factors[3, 1]))
    if is_present(slots.branch_c):
        c = load_at(slots.branch_c, at)
        state_sum = state_sum + c
        store_below(p, high, slots.branch_c, s, branch(c, N, factors[2, 2], factors[3, 2]))
    total = fma(-state_sum, per_L, factors[4, 0] * q)
    return where(bar | (total > 0.0), total, zeros())


# Functions for the force densities N / L [N/m] of the elements in slot s of LANES particles from p on. They
# return densities without and with branches, and the margins. They advance the state of the elements.


@part_of_kernel
def elastic_density_of(
    s: int, p: int, high: int, per_L: Lanes, L: Lanes, per_L0: Lanes, slots: Slots, law: LawParameters
) -> tuple[Lanes, Lanes, Lanes]:
    """Return densities of elements without plastic strain, in the engineering strain."""
    q, margin = elastic_force_density(s, p, per_L, per_L0, slots, law)
    return q, q, margin


@part_of_kernel
def yielding_density_of(
    s: int, p: int, high: int, per_L: Lanes, L: Lanes, per_L0: Lanes, slots: Slots, law: LawParameters
) -> tuple[Lanes, Lanes, Lanes]:
    """Return densities of cables that may yield, in the engineering strain.

    Only those near fracture count as near a limit.
    """
    eps_p = load_at(slots.eps_p, index_in(slots.other, s, p))
    q, margin, new_eps_p = yielding_force_density(s, p, per_L, L, per_L0, eps_p, slots, law)
    if any_of(new_eps_p != eps_p):
        store_below(p, high, slots.eps_p, s, new_eps_p)
    return q, q, margin


@part_of_kernel
def general_density_of(
    s: int, p: int, high: int, per_L: Lanes, L: Lanes, per_L0: Lanes, slots: Slots, law: LawParameters
) -> tuple[Lanes, Lanes, Lanes]:
    """Return densities of elements of any kind."""
    bar, eps_p, at = nowhere(), zeros(), index_in(slots.other, s, p)
    if is_present(slots.bar):
        bar = load_mask_at(slots.bar, at)
    if is_present(slots.eps_p):
        eps_p = load_at(slots.eps_p, at)
    q, margin, new_eps_p = general_force_density(s, p, per_L, L, per_L0, eps_p, bar, slots, law)
    if is_present(slots.eps_p) and any_of(new_eps_p != eps_p):
        store_below(p, high, slots.eps_p, s, new_eps_p)
    total = q
    if is_present(law.branches):
        total = with_branches(q, per_L, L, s, p, high, bar, slots, law)
    return q, total, margin


@part_of_kernel
def vector_forces(
    p: int,
    high: int,
    i: int,
    width: int,
    in_line: bool,
    elastic: bool,
    general: bool,
    density_of: Callable[..., Any],
    x: FloatArray,
    slots: Slots,
    law: LawParameters,
    scratch: Scratch,
) -> Lanes:
    """Compute `add_forces` for LANES particles from p on into place i, and return their margins."""
    peaks, branches = is_present(slots.highest), general and is_present(law.branches)
    px, py, pz = load(x, 0, p), load(x, 1, p), load(x, 2, p)
    fx, fy, fz, least_margin = zeros(), zeros(), zeros(), zeros()
    bx, by, bz, repeated = zeros(), zeros(), zeros(), elastic and needs_inelastic_pass(slots, law)
    for s in range(width):
        at = index_in(slots.other, s, p)
        ox, oy, oz = far_ends(at, in_line, x, slots.other)
        dx, dy, dz = ox - px, oy - py, oz - pz
        per_L, L = inverse_length(dx, dy, dz)
        per_L0 = load_at(slots.inv_L0, at)
        q, total, margin = density_of(s, p, high, per_L, L, per_L0, slots, law)
        least_margin = minimum(margin, least_margin)
        # The end with the lower row records the extremes (`incidence.record_slot`).
        if peaks and not (in_line and particle_at(slots.other, at) < p):
            N = q * L
            if repeated:  # elements near a limit are computed again, and update their extremes then
                N = where(margin < 0.0, NAN, N)
            update_extremes(N, at, slots)
        if branches:
            branch_density = total - q
            bx, by, bz = fma(branch_density, dx, bx), fma(branch_density, dy, by), fma(branch_density, dz, bz)
        fx, fy, fz = fma(total, dx, fx), fma(total, dy, fy), fma(total, dz, fz)
    store(scratch.f, 0, i, fx)
    store(scratch.f, 1, i, fy)
    store(scratch.f, 2, i, fz)
    if branches:
        store(scratch.band, 0, i, bx)
        store(scratch.band, 1, i, by)
        store(scratch.band, 2, i, bz)
    store(scratch.margin, 0, i, least_margin)
    return least_margin


@copied_kernel
def add_forces(
    low: int,
    high: int,
    width: int,
    in_line: IntArray,
    elastic: bool,
    general: bool,
    density_of: Callable[..., Any],
    x: FloatArray,
    slots: Slots,
    law: LawParameters,
    scratch: Scratch,
) -> bool:
    """Sum the element forces on particles low to high into the scratch; return whether one is near a limit.

    width : largest number of elements at one particle; in_line : `loop.Chunks`
    elastic : whether elements near yield are computed again; general : whether they are not all cables in the
        engineering strain
    density_of : one of the functions above, which advances plastic strains to x (3, n) [m]
    """
    least_margin = zeros()
    for p in range(low, high, LANES):
        if not general and in_line[p] != 0:
            margin = vector_forces(
                p, high, p - low, width, True, elastic, general, density_of, x, slots, law, scratch
            )
        else:
            margin = vector_forces(
                p, high, p - low, width, False, elastic, general, density_of, x, slots, law, scratch
            )
        least_margin = minimum(margin, least_margin)
    return any_of(least_margin < 0.0)
