"""The law of an element: strain, axial force, stiffness, energies, unstressed length.

Everything that knows the law stands here; the step, statics, form finding, the limits of the step and the
audit take it from here. Theory: paper 2.2 and 2.3, Fig. 3. Ideal elastic-plastic with slack, in total form.
With the trial force s = EA (eps - eps_p):

    s > N_y             yields: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, whatever the length; a bar takes compression, down to -N_y
    s < -N_E, a bar     buckles, where its Euler's load N_E is less than N_y: s = -N_E, elastic

The paper writes increments, whose sum is the logarithmic strain; both measures are offered. Another one is a
row of MEASURES, a branch where `law.logarithmic` has one, and a choice of [cable] strain.

Two forms of the same law: for one element of `Elements` (`axial_force` and what follows), and for a slot of
the vector loop of the step (`force_density`), arranged for whole registers.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.ground.compile import inner_kernel, kernel, part_of_kernel
from netfall.numerics.arithmetic import (
    bits_of,
    exponential,
    exponential_less_one,
    fused,
    inverse_root,
    logarithm,
)
from netfall.numerics.functions import exp, log

NEARLY, REACHED = 1.0 - 1e-9, 1.0 - 1e-12  # of a limit: looked at again, exactly; as good as it
TINY = 1e-300  # keeps an element without length from dividing zero by zero


class Law(NamedTuple):
    """What of the law is the same for all elements of a rank.

    logarithmic : True for the logarithmic strain, None for the engineering strain
    plastic : True where elements yield, None where all are elastic
    EA : [N] axial stiffness, None: differs, in the slots; yield_force, yield_strain = yield_force / EA : the
        same
    reach : L / L0 from which an element is looked at for fracture (the least, where they differ), None:
        nothing breaks
    near : [N] elastic axial force from which one is looked at for either, None: differs, or nothing happens
    branches : (5, 2 or 3) alpha, tau [s], and of `set_branches`; None: there are none
    """

    logarithmic: bool | None
    plastic: bool | None
    EA: float | None
    yield_force: float | None
    yield_strain: float | None
    reach: float | None
    near: float | None = None
    branches: np.ndarray | None = None


def law_of(
    measure: str, plastic: bool, EA: float | None, yield_force: float | None, least: float | None, alike: bool
) -> Law:
    """The law of a rank. measure : a key of MEASURES; least : fracture strain of all, None: nothing breaks

    alike : whether all have that fracture strain
    """
    reach = None if least is None else float(reaches(least, measure))
    yield_strain = None if EA is None or yield_force is None else yield_force / EA if EA > 0.0 else np.inf
    near = None
    if alike and EA is not None and (plastic or least is not None):
        near = min(
            EA * float(strains(reach, 1.0, measure)) if reach and reach < np.inf else np.inf,
            NEARLY * yield_force if plastic else np.inf,
        )
    return Law(measure == "logarithmic" or None, plastic or None, EA, yield_force, yield_strain, reach, near)


def reaches(eps_u: np.ndarray, measure: str) -> np.ndarray:
    """L / L0 (m,) from which elements of fracture strains (m,) are looked at; inf: never"""
    return np.where(np.isinf(eps_u), np.inf, MEASURES[measure].stretch(eps_u) * NEARLY)


# --- one element


@kernel
def strain(L, L0, law):
    """Strain of length L [m] against the unstressed length L0 [m]."""
    if law.logarithmic is not None:
        return logarithm(L / L0)
    return (L - L0) / L0


@kernel
def length_at(L, eps, law):
    """Unstressed length [m] of an element that has the strain eps at length L [m]."""
    if law.logarithmic is not None:
        return L * exponential(-eps)
    return L / (1.0 + eps)


@kernel
def axial_force(elements, e, eps, eps_p):
    """Axial force [N] and plastic strain of element e at strain eps after plastic strain eps_p."""
    N = elements.EA[e] * (eps - eps_p)
    if elements.euler is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if N < -elements.euler[e]:
            return -elements.euler[e], eps_p
    if elements.yield_force is not None:
        if N > elements.yield_force[e]:
            return elements.yield_force[e], eps_p + (N - elements.yield_force[e]) / elements.EA[e]
        if N < -elements.yield_force[e] and elements.bar[e]:
            return -elements.yield_force[e], eps_p + (N + elements.yield_force[e]) / elements.EA[e]
    if N < 0.0 and not elements.bar[e]:
        return 0.0, eps_p  # slack
    return N, eps_p


@part_of_kernel
def tangent_stiffness(elements, e, N, eps, L, law):
    """Axial stiffness dN/dL [N/m] of element e, of length L [m], at strain eps; 0: slack, yields, buckled.

    N : [N] there, on the yield plateau at its limit
    """
    eps_p = 0.0
    if elements.eps_p is not None:
        eps_p = elements.eps_p[e]
    if not (elements.EA[e] * (eps - eps_p) >= 0.0 or elements.bar[e]):
        return 0.0
    if elements.yield_force is not None and not abs(N) < elements.yield_force[e]:
        return 0.0
    if elements.euler is not None and not N > -elements.euler[e]:
        return 0.0
    if law.logarithmic is not None:
        return elements.EA[e] / L
    return elements.EA[e] / elements.L0[e]


@kernel
def stored_energy(elements, e, N, L, eps_p, law):
    """Elastic energy [J] of element e at axial force N [N], length L [m]: the integral of N dL from L0 on."""
    EA, L0 = elements.EA[e], elements.L0[e]
    if EA == 0.0:
        return 0.0
    u, further = N / EA, 0.0
    if elements.euler is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if N <= -elements.euler[e]:  # on from the length at which it buckled
            stretch = exponential(eps_p + u) if law.logarithmic is not None else 1.0 + (eps_p + u)
            further = N * (L - L0 * stretch)
    if law.logarithmic is not None:
        return EA * L0 * exponential(eps_p) * (exponential(u) * u - exponential_less_one(u)) + further
    return 0.5 * N * u * L0 + further


@kernel
def yield_energy(elements, e, eps_p, eps_p_new, law):
    """Energy [J] that yield of element e from plastic strain eps_p to eps_p_new turns into heat."""
    if eps_p_new == eps_p:
        return 0.0  # also of an element that never yields, whose limit is infinite
    EA, L0, limit = elements.EA[e], elements.L0[e], elements.yield_force[e]
    if law.logarithmic is not None:
        grown = abs(exponential(eps_p_new) - exponential(eps_p))
        tension = eps_p_new > eps_p
        return EA * abs(exponential_less_one(limit / EA if tension else -limit / EA)) * L0 * grown
    return limit * L0 * abs(eps_p_new - eps_p)


@kernel
def energies_at(elements, e, L, eps_p, law):
    """Plastic strain of element e at length L [m]; what yield to it turns to heat, and what is stored [J]."""
    N, now = axial_force(elements, e, strain(L, elements.L0[e], law), eps_p)
    heat = 0.0
    if elements.yield_force is not None and now != eps_p:
        heat = yield_energy(elements, e, eps_p, now, law)
    return now, heat, stored_energy(elements, e, N, L, now, law)


# --- damping over a band: Maxwell branches beside an element, each a spring and a dashpot
#
# Of the axial force N a branch holds V, which follows it: V' = (N - V) / tau. It adds alpha (N - V), so a
# cable carries max(0, N + sum alpha (N - V)). N(n) holds from n - 1/2 to n + 1/2: second order, for steps of
# any length. Kept is what of alpha V(n-1/2) is left at n, H = alpha exp(-dt / 2 tau) V(n-1/2):
#     force at n   N (1 + sum alpha exp(-dt / 2 tau)) - sum H,    dt of the step before n
#     to n + 1     H <- exp(-dt / tau) H + alpha exp(-dt / 2 tau) (1 - exp(-kick / tau)) N,    of that after

NARROW = 1.14  # largest over smallest ratio within a band for which two branches will do


def band_branches(ratio: float, low: float, high: float) -> tuple[float, ...]:
    """alpha, tau [s] of two or three branches for a damping ratio over a band [Hz]: as many of each.

    A branch with the largest ratio e, at f, has alpha = 8 e^2 + 4 e sqrt(4 e^2 + 1) and
    tau = 1 / (sqrt(1 + alpha) 2 pi f). With C = cosh(ln(high / low) / 2) two alike at
    sqrt(low high) (sqrt(1 + C) + sqrt(C))^(+-1) have one ratio at low, high and the middle, and between them
    (1 + C) / (2 sqrt(C)) times as much at most: 1.14 where high is 30 times low. There the least and the
    largest have the ratio asked in the mean, with e such that both ends are equal (alike for small ratios).
    Three, in wider bands, stand at low, the middle and high, and have the ratio asked there.
    """
    middle, C = np.sqrt(low * high), 0.5 * (np.sqrt(high / low) + np.sqrt(low / high))
    largest, apart = (1.0 + C) / (2.0 * np.sqrt(C)), np.sqrt(1.0 + C) + np.sqrt(C)
    at, where, target = [middle / apart, middle * apart], [low, high], ratio * 2.0 / (1.0 + largest)
    if largest > NARROW:
        at, where, target = [low, middle, high], [low, middle, high], ratio
    e = np.full(len(at), 0.5 * ratio)
    for _ in range(100):
        alpha = 8.0 * e * e + 4.0 * e * np.sqrt(4.0 * e * e + 1.0)
        tau = 1.0 / (np.sqrt(1.0 + alpha) * 2.0 * np.pi * np.array(at))
        e *= target / _ratio(alpha, tau, np.array(where))
    return (*alpha.tolist(), *tau.tolist())


def _ratio(alpha: np.ndarray, tau: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Damping ratio (n,) by branches alpha, tau (k,) [s] of what swings at frequencies (n,) [Hz] without."""
    phase = 2.0 * np.pi * frequency[:, None] * tau
    stiffness = 1.0 + (alpha * phase * phase / (1.0 + phase * phase)).sum(1)
    phase *= np.sqrt(stiffness)[:, None]  # it swings faster with them
    share = alpha / (1.0 + phase * phase)
    return 0.5 * (share * phase).sum(1) / (1.0 + (share * phase * phase).sum(1))


def stiffening(branches: tuple[float, ...]) -> float:
    """By how much branches make an element stiffer at most: 1 + sum alpha."""
    return 1.0 + sum(branches[: len(branches) // 2])


@inner_kernel
def set_branches(before_dt, dt, law):
    """What branches do at a step: rows 2 and 3 of their table, and the first number of row 4.

    What stays of H to n + 1, what joins it of N; 1 + sum alpha exp(-dt / 2 tau). before_dt, dt : [s]
    """
    b, kick_dt, law.branches[4, 0] = law.branches, 0.5 * (before_dt + dt), 1.0
    for k in range(b.shape[1]):
        alpha, rate = b[0, k], 1.0 / b[1, k]
        b[2, k] = exponential(-dt * rate)
        b[3, k] = -alpha * exponential(-0.5 * dt * rate) * exponential_less_one(-kick_dt * rate)
        b[4, 0] += alpha * exponential(-0.5 * before_dt * rate)


@part_of_kernel
def density_with_branches(q, d, s, p, slots, law):
    """N / L [N/m] with branches of the element in slot s of particle p, without them q; H goes on to n + 1.

    d : three [m], from the particle to the far end
    """
    square, of = squared_length(d), law.branches
    per_length = inverse_root(square)
    N, a, b = q * (square * per_length), slots.branch_a[s, p], slots.branch_b[s, p]
    held = a + b
    slots.branch_a[s, p] = fused(of[2, 0], a, of[3, 0] * N)
    slots.branch_b[s, p] = fused(of[2, 1], b, of[3, 1] * N)
    if slots.branch_c is not None:
        c = slots.branch_c[s, p]
        held += c
        slots.branch_c[s, p] = fused(of[2, 2], c, of[3, 2] * N)
    total = fused(-held, per_length, of[4, 0] * q)
    bar = False if slots.bar is None else slots.bar[s, p] != 0
    return total if bar or total > 0.0 else 0.0


@kernel
def add_branches(x, elements, now, law, f_int, f_band):
    """Add the forces of the branches at x (n, 3) [m] to f_int (n, 3) [N]; alone to f_band (n, 3) [N]."""
    f_band[:] = 0.0
    for e in range(elements.ends.shape[0]):
        if elements.EA[e] == 0.0:
            continue
        held = elements.branch_a[e] + elements.branch_b[e]
        if elements.branch_c is not None:
            held += elements.branch_c[e]
        total = law.branches[4, 0] * now.N[e] - held
        q = ((total if elements.bar[e] or total > 0.0 else 0.0) - now.N[e]) / now.L[e]
        start, end = elements.ends[e, 0], elements.ends[e, 1]
        for k in range(3):
            pull = q * (x[end, k] - x[start, k])
            f_band[start, k] += pull
            f_band[end, k] -= pull
            f_int[start, k] += pull
            f_int[end, k] -= pull


# --- arrays of elements


class Measure(NamedTuple):
    """A measure of strain, in closed form.

    strain(L, L0) : of a length [m]; stretch(eps) : L / L0 there; unstressed(L, eps) : L0 [m]
    over(L, L0) : [m], dN/dL is EA over it; largest : N / EA of which something is known
    """

    strain: Callable
    stretch: Callable
    unstressed: Callable
    over: Callable
    largest: float


MEASURES = {  # by [cable] strain
    "engineering": Measure(
        strain=lambda L, L0: (L - L0) / L0,
        stretch=lambda eps: 1.0 + eps,
        unstressed=lambda L, eps: L / (1.0 + eps),
        over=lambda L, L0: L0,
        largest=np.inf,
    ),
    "logarithmic": Measure(
        strain=lambda L, L0: log(L / L0),
        stretch=exp,
        unstressed=lambda L, eps: L * exp(-eps),
        over=lambda L, L0: L,
        largest=500.0,  # exp of much more is no number
    ),
}


def largest_stiffness(EA: np.ndarray, L0: np.ndarray) -> np.ndarray:
    """Axial stiffness dN/dL (m,) [N/m] that an element has at most, for the limits of the step."""
    return EA / L0


def unstressed_length(L: np.ndarray, N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Unstressed length (m,) [m] of elements of length L (m,) [m] that carry N (m,) [N], in closed form."""
    return MEASURES[strain].unstressed(L, N / EA)


def stretched_length(L0: np.ndarray, N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Length (m,) [m] under N (m,) [N] of elements of unstressed length L0 (m,) [m]: the inverse of that."""
    return L0 * MEASURES[strain].stretch(N / EA)


def exceeds_stiffness(N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Whether there is no unstressed length at which an element carries N (m,) [N]."""
    return (1.0 + N / EA <= 0) | (np.abs(N) > MEASURES[strain].largest * EA)


def warm_length(L0: np.ndarray, expansion: np.ndarray, temperature: float) -> np.ndarray:
    """Unstressed length (m,) [m] at a temperature [K] above that at which it is L0 (m,) [m]."""
    return L0 * (1.0 + expansion * temperature)


def elastic_stiffness(EA: np.ndarray, L0: np.ndarray, L: np.ndarray, strain: str) -> np.ndarray:
    """Axial stiffness dN/dL (m,) [N/m] at lengths L (m,) [m] of elements that carry and do not yield."""
    return EA / MEASURES[strain].over(L, L0)


def strains(L: np.ndarray, L0: np.ndarray, strain: str) -> np.ndarray:
    """Strains (m,) of lengths L (m,) [m] against the unstressed lengths L0 (m,) [m]."""
    return MEASURES[strain].strain(L, L0)


def elastic_forces(L, L0, EA, bar, strain: str) -> np.ndarray:
    """Axial forces (m,) [N] before any yield at lengths L (m,) [m]; bar : (m,) bool."""
    N = EA * strains(L, L0, strain)
    return np.where(bar, N, np.maximum(N, 0.0))


def strength_of(EA, fracture_strain, yield_force) -> np.ndarray:
    """Axial force (m,) [N] that an element never passes before it breaks, inf: none."""
    return np.minimum(EA * fracture_strain, yield_force)


# --- a slot of the vector loop


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


@part_of_kernel
def squared_length(d):
    """Square [m2] of the length of a vector, three [m]; not zero."""
    return fused(d[2], d[2], fused(d[1], d[1], fused(d[0], d[0], TINY)))
