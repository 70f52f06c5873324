"""Chains that hang: nodes in a row with two cables each, placed in equilibrium between the ends of the row.

A long chain under its own weight is a mechanism until it hangs, so neither the tangent stiffness nor a
relaxation leads there soon. But one chain between two given points is easily solved: with the tension F at
its first end, a vector [N], all others follow from the loads p between, T_j = F - sum of p up to node j, and
so do the lengths. F makes the complementary energy

    sum of L0 (|T_j| + |T_j|^2 / (2 EA)) - F . c,    c: from the first end to the last [m]

smallest, which is convex in its three unknowns: Newton's method with shorter steps finds it from anywhere.
(With many elements that is the elastic catenary; Irvine 1981.) A chain with a free end hangs from the other.
"""

import numpy as np

from netfall.core.kernels import inner_kernel, kernel, part_of_kernel
from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution

MOST_STEPS = 200  # of Newton's method for a chain
CLOSED = 1e-9  # of the length of a chain: how near to its last end it has to come
SMOOTH = 1e-9  # of all loads on a chain: tensions below that have no direction
HALVINGS = 60  # of a step of Newton's method
DESCENT = 1e-4  # of the slope: what a step has to gain (Armijo)
LEFT, MIDDLE, LOOSE = 0, 1, 2  # particles: not of a chain, inside one, a free end with one cable


def hung_positions(
    distribution: Distribution, state: State, load: np.ndarray, left_out: np.ndarray
) -> np.ndarray | None:
    """Positions (n, 3) [m] of owned and halo particles with all chains hung; None: nothing hangs.

    Collective. load : (n, 3) [N]; left_out : global numbers of elements of no chain, on every rank
    """
    d, n = distribution.subdomain, state.n_owned + state.n_halo
    there = (state.EA > 0.0) & (state.broken == 0)
    eps_p = state.eps_p if state.features.plastic else np.zeros(state.m)
    ends = distribution.gather_elements(d.particle_gid[state.ends].astype(np.int64))
    kind = distribution.gather_elements(np.where(there, np.where(state.bar == 0, 1, 2), 0))
    rows = distribution.gather_elements(np.column_stack([state.L0 * (1.0 + eps_p), state.L0, state.EA]))
    free = ~state.is_held()[:n]
    x, acting = (distribution.gather_particles(np.ascontiguousarray(a[:n])) for a in (state.x, load))
    free, hung = distribution.gather_particles(free), None
    if distribution.comm.rank == 0:
        kind[left_out[kind[left_out] == 1]] = 2
        hung = _hung(ends, kind, rows, free, x, acting)
    if not distribution.comm.bcast(hung is not None):
        return None
    return distribution.particles(hung)


def _hung(ends, kind, rows, free, x, load) -> np.ndarray | None:
    """Positions (n, 3) [m] with all chains hung, None: there are none.

    ends : (m, 2); kind : (m,) 1 for cables, 2 for what is there besides, 0 for what is not
    rows : (m, 3) length without tension and of the law [m], stiffness EA [N]; free : (n,) bool
    """
    at, count = np.full((len(x), 2), -1), np.zeros((len(x), 2), np.int64)
    list_elements(ends, kind, at, count)
    cables = count[:, 1] == 0
    place = np.where(free & cables & (count[:, 0] == 2), MIDDLE, LEFT)
    place[free & cables & (count[:, 0] == 1)] = LOOSE
    hung, seen, m = x.copy(), np.zeros(len(ends), np.uint8), len(ends)
    room = np.empty(m + 1, np.int64), np.empty((m, 2)), np.empty((m, 3))
    return hung if hang_chains(ends, kind, rows, load, place, at, seen, hung, *room) else None


@kernel
def list_elements(ends, kind, at, count):
    """Fill at (n, 2), the first two cables at each particle; count (n, 2) cables there, and others."""
    for e in range(ends.shape[0]):
        if kind[e] == 0:
            continue
        for k in range(2):
            p = ends[e, k]
            if kind[e] == 1 and count[p, 0] < 2:
                at[p, count[p, 0]] = e
            count[p, kind[e] - 1] += 1


@kernel
def hang_chains(ends, kind, rows, load, place, at, seen, x, node, laws, p):
    """Move the particles inside chains, x (n, 3) [m], to where the chains hang; how many chains do.

    place : (n,) of `MIDDLE`, ...; at : of `list_elements`; seen : (m,) of zeros; the others are room
    """
    hung = 0
    for first in range(ends.shape[0]):
        for side in range(2):
            if kind[first] != 1 or seen[first] or place[ends[first, side]] != LEFT:
                continue
            k, e, q = 0, first, np.int64(ends[first, side])
            while True:
                node[k], seen[e] = q, 1
                for i in range(3):
                    p[k, i] = load[q, i] if k > 0 else 0.0
                laws[k, 0], laws[k, 1] = rows[e, 0], rows[e, 1] / rows[e, 2]
                q = ends[e, 1] if ends[e, 0] == q else ends[e, 0]
                k += 1
                if place[q] != MIDDLE:
                    break
                e = at[q, 1] if at[q, 0] == e else at[q, 0]
            node[k] = q
            if k > 1 or place[q] == LOOSE:
                hung += hang_chain(k, node, laws, p, place[q] == LOOSE, load, x)
    return hung


@inner_kernel
def hang_chain(k, node, laws, p, loose, load, x):
    """Place the chain of the first k + 1 nodes; 1 if it hangs, 0 if not, and nothing is moved then.

    laws : (k, 2) L0 and L0 / EA; p : (k, 3) [N] at the begin of each element; loose : whether its end is free
    """
    a, b = node[0], node[k]
    c0, c1, c2 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    f0 = f1 = f2 = total = length = 0.0
    for j in range(k):
        f0, f1, f2 = f0 + p[j, 0], f1 + p[j, 1], f2 + p[j, 2]
        total += abs(p[j, 0]) + abs(p[j, 1]) + abs(p[j, 2])
        length += laws[j, 0]
    if loose:
        f0, f1, f2 = f0 + load[b, 0], f1 + load[b, 1], f2 + load[b, 2]
        total += abs(load[b, 0]) + abs(load[b, 1]) + abs(load[b, 2])
    small = SMOOTH * total
    if total == 0.0:
        return 0
    if loose:
        move_chain(k, node, laws, p, f0, f1, f2, small, x)
        return 1
    chord = np.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    pull = total / chord if chord > 0.0 else 0.0
    f0, f1, f2 = 0.5 * f0 + pull * c0, 0.5 * f1 + pull * c1, 0.5 * f2 + pull * c2
    for _ in range(MOST_STEPS):
        energy, g, h = chain_at(k, laws, p, f0, f1, f2, small)
        energy -= f0 * c0 + f1 * c1 + f2 * c2
        g0, g1, g2 = g[0] - c0, g[1] - c1, g[2] - c2
        if g0 * g0 + g1 * g1 + g2 * g2 <= (CLOSED * length) ** 2:
            move_chain(k, node, laws, p, f0, f1, f2, small, x)
            return 1
        d0, d1, d2 = solved(h, g0, g1, g2)
        slope = g0 * d0 + g1 * d1 + g2 * d2
        share = 1.0
        for _ in range(HALVINGS):
            t0, t1, t2 = f0 - share * d0, f1 - share * d1, f2 - share * d2
            there, _, _ = chain_at(k, laws, p, t0, t1, t2, small)
            there -= t0 * c0 + t1 * c1 + t2 * c2
            if there <= energy - DESCENT * share * slope + 1e-15 * abs(energy):
                break
            share *= 0.5
        f0, f1, f2 = f0 - share * d0, f1 - share * d1, f2 - share * d2
    return 0


@inner_kernel
def chain_at(k, laws, p, f0, f1, f2, small):
    """Complementary energy [J] of a chain with the tension f at its first end, its slope, its curvature."""
    energy = g0 = g1 = g2 = 0.0
    h00 = h01 = h02 = h11 = h12 = h22 = 0.0
    for j in range(k):
        f0, f1, f2 = f0 - p[j, 0], f1 - p[j, 1], f2 - p[j, 2]
        square = f0 * f0 + f1 * f1 + f2 * f2
        size = np.sqrt(square + small * small)
        flexible, turns = laws[j, 1], laws[j, 0] / size
        energy += laws[j, 0] * size + 0.5 * flexible * square
        g0, g1, g2 = g0 + (turns + flexible) * f0, g1 + (turns + flexible) * f1, g2 + (turns + flexible) * f2
        t0, t1, t2 = f0 / size, f1 / size, f2 / size
        h00 += turns * (1.0 - t0 * t0) + flexible
        h11 += turns * (1.0 - t1 * t1) + flexible
        h22 += turns * (1.0 - t2 * t2) + flexible
        h01, h02, h12 = h01 - turns * t0 * t1, h02 - turns * t0 * t2, h12 - turns * t1 * t2
    return energy, (g0, g1, g2), (h00, h01, h02, h11, h12, h22)


@part_of_kernel
def solved(h, g0, g1, g2):
    """The solution of a symmetric positive matrix h, six entries by rows, by Cholesky's factors."""
    a = np.sqrt(h[0])
    b, c = h[1] / a, h[2] / a
    d = np.sqrt(max(h[3] - b * b, 1e-30 * h[3]))
    e = (h[4] - b * c) / d
    f = np.sqrt(max(h[5] - c * c - e * e, 1e-30 * h[5]))
    y0 = g0 / a
    y1 = (g1 - b * y0) / d
    y2 = (g2 - c * y0 - e * y1) / f
    z2 = y2 / f
    z1 = (y1 - e * z2) / d
    return (y0 - b * z1 - c * z2) / a, z1, z2


@inner_kernel
def move_chain(k, node, laws, p, f0, f1, f2, small, x):
    """Move the nodes of a chain behind its first to where the tension f at its first end leads them."""
    for j in range(k):
        f0, f1, f2 = f0 - p[j, 0], f1 - p[j, 1], f2 - p[j, 2]
        size = np.sqrt(f0 * f0 + f1 * f1 + f2 * f2 + small * small)
        stretched, a, b = laws[j, 0] / size + laws[j, 1], node[j], node[j + 1]
        x[b, 0], x[b, 1], x[b, 2] = (
            x[a, 0] + stretched * f0,
            x[a, 1] + stretched * f1,
            x[a, 2] + stretched * f2,
        )
