"""Law of one element of `Elements`: strain, axial force, stiffness, energies. See `law.py`."""

from netfall.core.arithmetic import exponential, exponential_minus_one, logarithm
from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.records import is_present


@inner_kernel
def strain(L, L0, law):
    """Return the strain of length L [m] relative to the unstressed length L0 [m]."""
    if law.logarithmic:
        return logarithm(L / L0)
    return (L - L0) / L0


@inner_kernel
def length_at(L, eps, law):
    """Return the unstressed length [m] of an element that has the strain eps at length L [m]."""
    if law.logarithmic:
        return L * exponential(-eps)
    return L / (1.0 + eps)


@inner_kernel
def axial_force(elements, e, eps, eps_p):
    """Return axial force [N] and plastic strain of element e at strain eps after plastic strain eps_p."""
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
def tangent_stiffness(elements, e, N, eps, L, law):
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
def stored_energy(elements, e, N, L, eps_p, law):
    """Return the elastic energy [J] of element e at force N [N] and length L [m]: the integral of N dL."""
    EA, L0 = elements.EA[e], elements.L0[e]
    if EA == 0.0:
        return 0.0
    u, buckling_work = N / EA, 0.0
    if (
        is_present(elements.euler) and N <= -elements.euler[e]
    ):  # work after the buckling length, at constant force
        stretch = exponential(eps_p + u) if law.logarithmic else 1.0 + (eps_p + u)
        buckling_work = N * (L - L0 * stretch)
    if law.logarithmic:
        return EA * L0 * exponential(eps_p) * (exponential(u) * u - exponential_minus_one(u)) + buckling_work
    return 0.5 * N * u * L0 + buckling_work


@inner_kernel
def yield_energy(elements, e, eps_p, eps_p_new, law):
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
def energies_at(elements, e, L, eps_p, law):
    """Return plastic strain, heat of yielding [J] and stored energy [J] of element e at length L [m]."""
    N, new_eps_p = axial_force(elements, e, strain(L, elements.L0[e], law), eps_p)
    heat = 0.0
    if is_present(elements.yield_force) and new_eps_p != eps_p:
        heat = yield_energy(elements, e, eps_p, new_eps_p, law)
    return new_eps_p, heat, stored_energy(elements, e, N, L, new_eps_p, law)
