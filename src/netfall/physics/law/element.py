"""Law of an element in two forms: for one element of `Elements`, and for vectors of slots. See `law.py`.

Statics and energy checks use the form for one element: strain, axial force, stiffness, energies. The time
step uses the form for slots: axial force over length, the margin to the limits and the new plastic strain.
"""

from typing import Any

from netfall.core.arithmetic import exponential, exponential_minus_one, logarithm
from netfall.core.arrays import Triple
from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.records import is_present
from netfall.core.vectors import (
    fma,
    index_in,
    load,
    load_mask_at,
    load_or_repeat,
    maximum,
    minimum,
    where,
    zeros,
)
from netfall.physics.element_step import (
    elastic_density,
    engineering_strain,
    grown,
    logarithmic_density,
    logarithmic_strain,
    shrunk,
)
from netfall.physics.fields import Elements
from netfall.physics.law.law import LawParameters

INFINITE = float("inf")


@inner_kernel
def strain(L: float, L0: float, law: LawParameters) -> float:
    """Return the strain of length L [m] relative to the unstressed length L0 [m]."""
    if law.logarithmic:
        return logarithm(L / L0)
    return (L - L0) / L0


@inner_kernel
def unstressed_length_at(L: float, eps: float, law: LawParameters) -> float:
    """Return the unstressed length [m] of an element that has the strain eps at length L [m]."""
    if law.logarithmic:
        return L * exponential(-eps)
    return L / (1.0 + eps)


@inner_kernel
def axial_force(elements: Elements, e: int, eps: float, eps_p: float) -> tuple[float, float]:
    """Return axial force [N] and plastic strain of element e at strain eps after plastic strain eps_p.

    The step uses the vector forms below; this serves energies, statics and slips.
    """
    N = elements.EA[e] * (eps - eps_p)
    if is_present(elements.euler) and N < -elements.euler[e]:
        return -elements.euler[e], eps_p
    if is_present(elements.yield_force):
        if N > elements.yield_force[e]:
            return elements.yield_force[e], eps_p + (N - elements.yield_force[e]) / elements.EA[e]
        if N < -elements.yield_force[e] and elements.bar[e]:
            return -elements.yield_force[e], eps_p + (N + elements.yield_force[e]) / elements.EA[e]
    if N < 0.0 and not elements.bar[e]:
        return 0.0, eps_p  # slack
    return N, eps_p


@part_of_kernel
def tangent_stiffness(
    elements: Elements, e: int, N: float, eps: float, L: float, law: LawParameters
) -> float:
    """Return dN/dL [N/m] of element e, of length L [m], at strain eps; 0 if slack, yielding or buckled.

    N : [N] at that strain, equal to the limit on the yield plateau
    """
    eps_p = 0.0
    if is_present(elements.eps_p):
        eps_p = elements.eps_p[e]
    if not (elements.EA[e] * (eps - eps_p) >= 0.0 or elements.bar[e]):
        return 0.0
    if is_present(elements.yield_force) and not abs(N) < elements.yield_force[e]:
        return 0.0
    if is_present(elements.euler) and not N > -elements.euler[e]:
        return 0.0
    if law.logarithmic:
        return elements.EA[e] / L
    return elements.EA[e] / elements.L0[e]


@inner_kernel
def stored_energy(elements: Elements, e: int, N: float, L: float, eps_p: float, law: LawParameters) -> float:
    """Return the elastic energy [J] of element e at force N [N] and length L [m]: the integral of N dL."""
    EA, L0 = elements.EA[e], elements.L0[e]
    if EA == 0.0:
        return 0.0
    u, buckling_work = N / EA, 0.0
    if is_present(elements.euler) and N <= -elements.euler[e]:
        # work after the buckling length, at constant force
        stretch = exponential(eps_p + u) if law.logarithmic else 1.0 + (eps_p + u)
        buckling_work = N * (L - L0 * stretch)
    if law.logarithmic:
        return EA * L0 * exponential(eps_p) * (exponential(u) * u - exponential_minus_one(u)) + buckling_work
    return 0.5 * N * u * L0 + buckling_work


@inner_kernel
def yield_energy(elements: Elements, e: int, eps_p: float, eps_p_new: float, law: LawParameters) -> float:
    """Return the energy [J] that element e dissipates by yielding from plastic strain eps_p to eps_p_new."""
    if eps_p_new == eps_p:
        return 0.0  # also avoids inf * 0 for an element that never yields
    EA, L0, limit = elements.EA[e], elements.L0[e], elements.yield_force[e]
    if law.logarithmic:
        change = abs(exponential(eps_p_new) - exponential(eps_p))
        tension = eps_p_new > eps_p
        return EA * abs(exponential_minus_one(limit / EA if tension else -limit / EA)) * L0 * change
    return limit * L0 * abs(eps_p_new - eps_p)


@inner_kernel
def energies_at(elements: Elements, e: int, L: float, eps_p: float, law: LawParameters) -> Triple:
    """Return plastic strain, heat of yielding [J] and stored energy [J] of element e at length L [m]."""
    N, new_eps_p = axial_force(elements, e, strain(L, elements.L0[e], law), eps_p)
    heat = 0.0
    if is_present(elements.yield_force) and new_eps_p != eps_p:
        heat = yield_energy(elements, e, eps_p, new_eps_p, law)
    return new_eps_p, heat, stored_energy(elements, e, N, L, new_eps_p, law)


# --- vectors of slots


@inner_kernel
def fill_law_fields(e: Any, s: Any, p: Any, elements: Any, slots: Any) -> None:
    """Write the fields of the law of element e to slot s of particle p."""
    if is_present(slots.EA):
        slots.EA[s, p] = elements.EA[e]
    if is_present(slots.bar):
        slots.bar[s, p] = elements.bar[e]
    if is_present(slots.euler):
        slots.euler[s, p] = elements.euler[e]
    if is_present(slots.yield_force):
        slots.yield_force[s, p] = elements.yield_force[e]
    if is_present(slots.yield_strain):
        slots.yield_strain[s, p] = elements.yield_strain[e]
    if is_present(slots.eps_p):
        slots.eps_p[s, p] = elements.eps_p[e]


@part_of_kernel
def general_force_density(
    s: Any, p: Any, per_L: Any, L: Any, per_L0: Any, eps_p: Any, bar: Any, slots: Any, law: Any
) -> Any:
    """Return N / L [N/m] of elements of any kind, their margins and their new plastic strain.

    eps_p : plastic strain before; bar : whether they carry compression
    margin : negative if the element is near a limit
    """
    EA = load_or_repeat(slots.EA, s, p, law.EA)
    if law.logarithmic:
        q = logarithmic_density(per_L, L, per_L0, eps_p, EA)
    else:
        q = elastic_density(per_L, per_L0, eps_p, EA)
    highest = load_or_repeat(slots.yield_force, s, p, law.yield_force) * per_L
    stretch_limit = load_or_repeat(slots.check_stretch, s, p, law.check_stretch)
    margin, new_eps_p = fma(stretch_limit, per_L, -per_L0), eps_p
    if law.plastic:
        yield_strain = load_or_repeat(slots.yield_strain, s, p, law.yield_strain)
        eps = logarithmic_strain(L, per_L0) if law.logarithmic else engineering_strain(L, per_L0)
        new_eps_p = grown(eps, eps_p, yield_strain)
        if is_present(slots.bar):  # the heat of bars does not follow from eps_p: `check_limits` treats them
            yields = bar & (load_or_repeat(slots.euler, s, p, law.infinite) == INFINITE)
            changes = bar & (where(yields, shrunk(eps, new_eps_p, yield_strain), new_eps_p) != eps_p)
            margin = where(changes, zeros() - 1.0, margin)
            new_eps_p = where(bar, eps_p, new_eps_p)
    lowest = where(bar, -highest, zeros())
    if is_present(slots.euler):
        margin = where(bar, minimum(fma(stretch_limit, per_L0, -per_L), margin), margin)
        buckling_density = -load(slots.euler, s, p) * per_L
        lowest = where(buckling_density > lowest, buckling_density, lowest)
    q = minimum(highest, q)
    return maximum(q, lowest), margin, new_eps_p


@part_of_kernel
def elastic_force_density(s: Any, p: Any, per_L: Any, per_L0: Any, slots: Any, law: Any) -> Any:
    """Return N / L [N/m] of elements without plastic strain, and their margins, negative near a limit.

    The strain is the engineering strain.
    """
    q = elastic_density(per_L, per_L0, zeros(), load_or_repeat(slots.EA, s, p, law.EA))
    force_limit = load_or_repeat(slots.near, s, p, law.near)
    if is_present(slots.bar):
        bar = load_mask_at(slots.bar, index_in(slots.other, s, p))
        q = where(bar | (q > 0.0), q, zeros())
        return q, fma(force_limit, per_L, -abs(q))
    return maximum(q, 0.0), fma(force_limit, per_L, -q)


@part_of_kernel
def yielding_force_density(
    s: Any, p: Any, per_L: Any, L: Any, per_L0: Any, eps_p: Any, slots: Any, law: Any
) -> Any:
    """Return N / L [N/m] of cables that may yield, their margins and their new plastic strain.

    A margin is negative near fracture. The strain is the engineering strain.
    """
    q = elastic_density(per_L, per_L0, eps_p, load_or_repeat(slots.EA, s, p, law.EA))
    new_eps_p = grown(
        engineering_strain(L, per_L0), eps_p, load_or_repeat(slots.yield_strain, s, p, law.yield_strain)
    )
    margin = fma(load_or_repeat(slots.check_stretch, s, p, law.check_stretch), per_L, -per_L0)
    highest = load_or_repeat(slots.yield_force, s, p, law.yield_force) * per_L
    q = minimum(highest, q)
    return maximum(q, 0.0), margin, new_eps_p
