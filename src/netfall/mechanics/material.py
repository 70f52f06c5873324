"""The law of one element: strain, axial force, energy. Scalar formulas; theory: paper 2.2 and 2.3, Fig. 3.

Ideal elastic-plastic with slack, in total form. With the trial force s = EA (eps - eps_p):
    s > N_y             flows: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, whatever the length; a bar takes compression, down to -N_y
The paper writes increments, whose sum is the logarithmic strain; both measures are offered.
"""

import math

import numpy as np

from netfall.mechanics.compile import kernel


@kernel
def strain(L, L0, logarithmic):
    """Strain of length L [m] against the unstressed length L0 [m]."""
    if logarithmic:
        return math.log(L / L0)
    return (L - L0) / L0


@kernel
def elastic_force(eps, EA, bar):
    """Axial force [N] of an elastic element, zero when a cable is slack."""
    N = EA * eps
    if N < 0.0 and not bar:
        return 0.0  # slack
    return N


@kernel
def plastic_force(eps, eps_p, EA, yield_force, bar):
    """Axial force [N] and plastic strain of an ideal elastic-plastic element (paper Fig. 3)."""
    N = EA * (eps - eps_p)
    if N > yield_force:
        return yield_force, eps_p + (N - yield_force) / EA
    if N < 0.0:
        if not bar:
            return 0.0, eps_p  # slack
        if N < -yield_force:
            return -yield_force, eps_p + (N + yield_force) / EA
    return N, eps_p


@kernel
def dissipated_by_flow(eps_p, eps_p_new, L0, EA, yield_force, logarithmic):
    """Energy [J] that plastic flow from eps_p to eps_p_new turns into heat."""
    if logarithmic:
        flow = abs(math.exp(eps_p_new) - math.exp(eps_p))
        tension = eps_p_new > eps_p
        return EA * abs(math.expm1(yield_force / EA if tension else -yield_force / EA)) * L0 * flow
    return yield_force * L0 * abs(eps_p_new - eps_p)


@kernel
def stored_energy(N, eps_p, L0, EA, logarithmic):
    """Elastic energy [J]: the integral of N dL from the unstressed state."""
    if EA == 0.0:
        return 0.0
    u = N / EA
    if logarithmic:
        return EA * L0 * math.exp(eps_p) * (math.exp(u) * u - math.expm1(u))
    return 0.5 * N * u * L0


def unstressed_length(L, N, EA, logarithmic):
    """Unstressed length [m] of elements of length L (m,) [m] that carry N (m,) [N], in closed form."""
    return L * np.exp(-N / EA) if logarithmic else L / (1.0 + N / EA)
