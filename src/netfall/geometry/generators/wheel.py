"""Spoked-wheel roof of two layers, in equilibrium under its prestress.

It has a compression ring of bars, two tension rings around the opening, radial cables above and below with
struts between them, and hoops in the upper layer.

A spoke k at level j (0: at the opening) has the radius r_j. By equilibrium of each node, with n spokes:

    in plan, upper      H_(j+1) = H_j + 2 T sin(pi / n)      T the tension of a hoop, none at level 0
    in plan, lower      G_(j+1) = G_j = H_0                  H_0 the force of a spoke at the tension ring
    vertical, both      V_(j+1) = V_j + P = (j + 1) P        all struts push with P (see below)
    slope of a radial   V / H above, V / G below             so P follows from the height of the rings
    rings               H_0 / (2 sin(pi / n)), in compression (H + G) / (2 sin(pi / n))
    diagonals, each q   in plan they pull as the rings do, so the rings' force density is less by q; and each
                        strut between the rings, of the height h, pushes with 2 q h more

The radials of both layers end in the same compression ring, at z = 0, where their vertical forces cancel.
Bars have no bending stiffness. A single ring of bars would ovalise without resistance. The ring is therefore
the inner chord of a flat ring truss, whose outer chord and web have no prestress.

The layers could rotate against each other about the axis, because radials resist sideways motion only by
their tension, and struts in compression tip over. Snow reduces the tension of the upper radials. Roofs of
this kind therefore have crossed, prestressed diagonals between the tension rings.
"""

from math import sqrt
from typing import Any

import numpy as np

from netfall.core.functions import cos, sin
from netfall.geometry.generators.prestressed import closed_rings, prestressed_net
from netfall.geometry.net import Net
from netfall.job.keys.net import Wheel

GROUPS = ["ring_outer", "ring_upper", "ring_lower", "upper", "lower", "hoop", "strut", "ring_truss"]
BRACE = "brace"


def wheel(given: Wheel) -> Net:
    """Generate the net with its prestress from the keys of the job. Without brace_force it has no diagonals.

    The ring truss is held vertically at each spoke. The inner chord is also held tangentially at four spokes,
    a quarter apart, so that it is free to shrink, as on bearings.
    """
    spokes, hoops, radius = given.spokes, given.hoops, 0.5 * given.diameter
    r, upper, lower, H, G, P = profile(given)
    number = np.arange((2 * hoops + 4) * spokes).reshape(-1, spokes)
    outer, chord = number[[1, 0]]
    above, below = number[hoops + 2 : 1 : -1], number[: hoops + 2 : -1]
    angle = 2.0 * np.pi * np.arange(spokes) / spokes
    x = np.zeros((number.size, 3))
    for nodes, distance, height in (
        (chord, radius + given.ring_depth, 0.0),
        (outer, radius, 0.0),
        *zip(above, r, upper),
        *zip(below, r, lower),
    ):
        x[nodes] = np.column_stack([distance * cos(angle), distance * sin(angle), np.full(spokes, height)])
    step, sine = np.diff(np.append(r, radius)), sin(np.pi / spokes)

    def ring_density(force: Any, radius: Any) -> Any:
        return force / (2.0 * radius * sine)

    def radials(nodes: Any) -> Any:
        return np.stack([nodes, np.vstack([nodes[1:], outer])], -1)

    brace = given.brace_force / sqrt((given.opening * sine) ** 2 + given.ring_height**2)
    push = P / (upper - lower)
    push[0] += 2.0 * brace
    # the outer chord, posts, and two diagonals in each bay; the inner chord is a separate group
    sides = [np.column_stack(pair) for pair in ((chord, np.roll(chord, -1)), (outer, chord))]
    truss = np.concatenate([*sides, _crossed(outer, chord)])
    fixed = np.zeros((number.size, 3), bool)  # along the ring at 0, 90, 180 and 270 degrees
    fixed[number[:2], 2] = True
    fixed[number[1, [0, spokes // 2]], 1] = True
    fixed[number[1, [spokes // 4, 3 * spokes // 4]], 0] = True
    kinds = (  # nodes (..., 2) and force density of each group, in the order of GROUPS, then the diagonals
        (closed_rings(outer), -ring_density((H[-1] + G) / (2.0 * sine), radius)),
        (closed_rings(above[0]), ring_density(H[0] / (2.0 * sine), r[0]) - brace),
        (closed_rings(below[0]), ring_density(G / (2.0 * sine), r[0]) - brace),
        (radials(above), (H / step)[:, None]),
        (radials(below), (G / step)[:, None]),
        (closed_rings(above[1:]), ring_density(given.hoop_force, r[1:])[:, None]),
        (np.stack([below, above], -1), -push[:, None]),
        (truss, 0.0),
        *([(_crossed(above[0], below[0]), brace)] if given.brace_force else []),
    )
    return prestressed_net(x, fixed, kinds, [*GROUPS, BRACE][: len(kinds)], given.ring_groups)


def _crossed(one: Any, other: Any) -> np.ndarray:
    """Return two diagonals in each bay between two rings of nodes, (2 n, 2)."""
    pairs = ((one, np.roll(other, -1)), (np.roll(one, -1), other))
    return np.concatenate([np.column_stack(pair) for pair in pairs])


def largest_brace_force(given: Wheel) -> float:
    """Compute the force [N] of the diagonals at which they carry the entire force of the tension rings."""
    sine = sin(np.pi / given.spokes)
    side = given.opening * sine  # of a tension ring
    return float(given.spoke_force / (2.0 * sine * side) * sqrt(side**2 + given.ring_height**2))


def profile(given: Wheel) -> tuple[Any, ...]:
    """Compute radii and heights (h + 1,) [m] of the levels above and below; H (h + 1,), G, P [N] as above."""
    r = np.linspace(0.5 * given.opening, 0.5 * given.diameter, given.hoops + 2)
    step, count, G = np.diff(r), np.arange(given.hoops + 1), given.spoke_force
    H = G + 2.0 * given.hoop_force * sin(np.pi / given.spokes) * count
    fall_above, fall_below = (count + 1) / H * step, (count + 1) / G * step  # for P = 1
    P = given.ring_height / (fall_above + fall_below).sum()

    def heights(falls: Any) -> Any:
        return P * falls[::-1].cumsum()[::-1]

    return r[:-1], heights(fall_above), -heights(fall_below), H, G, P
