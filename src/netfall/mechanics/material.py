"""The law of one element: strain, axial force, energy. Scalar formulas; theory: paper 2.2 and 2.3, Fig. 3.

Ideal elastic-plastic with slack, in total form. With the trial force s = EA (eps - eps_p):
    s > N_y             flows: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, whatever the length; a bar takes compression, down to -N_y
The paper writes increments, whose sum is the logarithmic strain; both measures are offered.
"""

import math

import numpy as np

from netfall.mechanics.arithmetic import fused, inverse_root, like, logarithm, shortening
from netfall.mechanics.compile import kernel, part_of_kernel

NEARLY = 1.0 - 1e-9  # a force or a strain this close to its limit is looked at again, exactly
NEARLY_SINGLE = 1.0 - 1e-5  # the same where it was computed in single precision
TINY = 1e-300  # keeps an element without length from dividing zero by zero


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


@part_of_kernel
def force_density(
    dx,
    dy,
    dz,
    excess,
    s,
    p,
    inv_L0,
    EA,
    slot_EA,
    measure,
    slot_bar,
    yield_force,
    slot_yield,
    slot_eps_p,
    reach,
):
    """N / L [N/m] of the element in slot s of particle p, and whether it is near flow or fracture.

    `plastic_force` over the length, arranged for one inverse root: EA (L / L0 - 1 - eps_p) / L = EA (1 / L0 - (1 + eps_p) / L).
    excess : (L / L0)^2 - 1 where forces are in single precision, for which 1 / L0 and 1 / L are too close; else None
    The others as in `kernels.kick_rows`. An empty slot, 1 / L0 = 0, gives zero.
    """
    per_L0 = inv_L0[s, p]
    stiffness = like(per_L0, EA) if slot_EA is None else slot_EA[s, p]
    eps_p = like(per_L0, 0.0) if slot_eps_p is None else slot_eps_p[s, p]
    nearly = like(per_L0, NEARLY if excess is None else NEARLY_SINGLE)
    if excess is None:
        square = fused(dz, dz, fused(dy, dy, fused(dx, dx, TINY)))
        per_length = like(per_L0, inverse_root(square))
        if measure is not None:
            q = like(
                per_L0, stiffness * (logarithm(max(square * per_length * per_L0, TINY)) - eps_p) * per_length
            )
        else:
            q = like(per_L0, stiffness * fused(-1.0 - eps_p, per_length, per_L0))
    else:
        shorter = shortening(excess)
        per_length = fused(-shorter, per_L0, per_L0)
        if measure is not None:
            q = stiffness * (like(per_L0, 0.5 * logarithm(max(1.0 + excess, TINY))) - eps_p) * per_length
        else:
            q = stiffness * fused(-eps_p, per_length, shorter * per_L0)
    near = False
    slack = like(per_L0, 0.0)
    lowest = slack
    if slot_bar is not None:
        lowest = like(per_L0, -np.inf) if slot_bar[s, p] else slack
    if yield_force is not None:
        highest = (like(per_L0, yield_force) if slot_yield is None else slot_yield[s, p]) * per_length
        near = q > highest * nearly
        q = highest if q > highest else q
        if slot_bar is not None:
            lowest = -highest if slot_bar[s, p] else slack
            near |= (q < lowest * nearly) & (lowest < slack)
    if reach is not None:
        near |= per_L0 > like(per_L0, reach) * per_length
    return q if q > lowest else lowest, near


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
