"""The law in a slot of the vector loop of the step, arranged for whole registers. See `law.py`."""

import numpy as np

from netfall.ground.compile import part_of_kernel
from netfall.mechanics.law.limits import NEARLY
from netfall.numerics.arithmetic import bits_of, fused, inverse_root, logarithm

TINY = 1e-300  # keeps an element without length from dividing zero by zero


@part_of_kernel
def squared_length(d):
    """Square [m2] of the length of a vector, three [m]; not zero."""
    return fused(d[2], d[2], fused(d[1], d[1], fused(d[0], d[0], TINY)))


@part_of_kernel
def force_density(d, s, p, past, slots, law):
    """N / L [N/m] of the element in slot s of particle p, whether any is past its limits, its plastic strain.

    Where the slots hold plastic strains, cables yield here. A bar is only pointed at, as past its limits,
    since its heat does not follow from its plastic strain.

    `axial_force` over the length, arranged for one inverse root:
    EA (L / L0 - 1 - eps_p) / L = EA (1 / L0 - (1 + eps_p) / L).

    d : three [m], from the particle to the far end; past : below 0 if an element in another slot is past
        its limits
    slots : `Slots`. An empty slot, 1 / L0 = 0, gives zero.
    """
    per_L0 = slots.inv_L0[s, p]
    stiffness = law.EA if slots.EA is None else slots.EA[s, p]
    eps_p = 0.0 if slots.eps_p is None else slots.eps_p[s, p]
    square = squared_length(d)
    per_length = inverse_root(square)
    if law.logarithmic is not None:
        stretch = max(square * per_length * per_L0, TINY)
        q = stiffness * (logarithm(stretch) - eps_p) * per_length
    else:
        q = stiffness * fused(-1.0 - eps_p, per_length, per_L0)
    force = q
    lowest = 0.0  # slack
    yielded = 0.0
    if slots.eps_p is not None:
        yielded = plastic_strain(square * per_length * per_L0, eps_p, s, p, slots, law)
        if slots.bar is not None:
            past |= -1 if (yielded != eps_p) & (slots.bar[s, p] != 0) else 0
            yielded = eps_p if slots.bar[s, p] else yielded
    if slots.bar is not None:
        lowest = -np.inf if slots.bar[s, p] else 0.0
    if law.plastic is not None:
        limit = law.yield_force if slots.yield_force is None else slots.yield_force[s, p]
        highest = limit * per_length
        if slots.eps_p is None and law.near is None:
            past |= bits_of(fused(NEARLY, highest, -q))
        if slots.bar is not None:
            lowest = -highest if slots.bar[s, p] else 0.0
            if slots.eps_p is None:
                past |= bits_of(fused(-NEARLY, lowest, q)) if slots.bar[s, p] else 0
        force = highest if q > highest else q
    if slots.eps_p is None and law.near is not None:
        past |= bits_of(fused(law.near, per_length, -q))
    elif law.reach is not None:
        reach = law.reach if slots.reach is None else slots.reach[s, p]
        past |= bits_of(fused(reach, per_length, -per_L0))
    if slots.euler is not None:
        buckled = -slots.euler[s, p] * per_length
        lowest = buckled if buckled > lowest else lowest
        if law.reach is not None:
            reach = law.reach if slots.reach is None else slots.reach[s, p]
            past |= bits_of(fused(reach, per_L0, -per_length)) if slots.bar[s, p] else 0
    return force if force > lowest else lowest, past, yielded


@part_of_kernel
def plastic_strain(stretch, eps_p, s, p, slots, law):
    """Plastic strain after L / L0 = stretch of the element in slot s of particle p, which had eps_p before.

    A cable's only grows: to what is left of the strain at the yield force.
    """
    limit = law.yield_strain if slots.yield_strain is None else slots.yield_strain[s, p]
    eps = stretch - 1.0
    if law.logarithmic is not None:
        eps = logarithm(max(stretch, TINY))
    new = max(eps_p, eps - limit)
    if slots.bar is not None:
        yields = slots.bar[s, p] != 0
        if slots.euler is not None:
            yields &= slots.euler[s, p] == np.inf
        new = min(new, eps + limit) if yields else new
    return new
