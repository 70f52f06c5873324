"""Cable dome after Levy, in equilibrium under its prestress: rings of struts held only by cables.

From the central ring (level 0) to the supports (level h + 1) a level has n nodes at the radius r_j, rotated
by half a sector from level to level. Each strut stands between a ridge node at z_j and a lower node at z_j
- L. From a node of level j two ridge cables (force density q_j) and from its lower node two diagonals (d_j)
run to the ridge nodes, or supports, of level j + 1. With

    fall_j = z_j - z_(j+1)                 climb_j = L - fall_j           vertical parts of ridge, diagonal
    out_j = r_(j+1) cos(pi/n) - r_j        in_j = r_(j+1) - r_j cos(pi/n) radial parts at level j, at j + 1

the equilibrium of ridge and lower nodes is, radially and vertically,

    q_(j+1) out_(j+1) = (q_j + d_j) in_j          P_j = 2 q_j fall_j      P_j the force of a strut
    c_j r_j (1 - cos(2 pi/n)) = d_j out_j         P_j = 2 d_j climb_j     c_j the force density of a hoop

Hence d_j = q_j fall_j / climb_j, and everything follows from q_0. The upper ring of level 0 has q_0 in
place of d_0.
"""

from typing import Any

import numpy as np

from netfall.core.functions import cos, sin
from netfall.geometry import messages
from netfall.geometry.generators.prestressed import closed_rings, prestressed_net
from netfall.geometry.net import Net
from netfall.job.keys.net import Dome

GROUPS = ["ridge", "diagonal", "hoop", "ring_upper", "ring_lower", "strut"]


def dome(given: Dome) -> Net:
    """Generate the net with its prestress from the keys of the job. The outermost nodes are supports."""
    spokes, hoops, strut = given.spokes, given.hoops, given.strut
    r, z, q, d, c, ring, P = profile(given)
    above = np.arange((hoops + 2) * spokes).reshape(-1, spokes)  # the last row has the supports
    below = above.size + np.arange((hoops + 1) * spokes).reshape(-1, spokes)
    angle = 2.0 * np.pi / spokes * (np.arange(spokes) + 0.5 * (np.arange(hoops + 2)[:, None] % 2))
    upper = np.stack([r[:, None] * cos(angle), r[:, None] * sin(angle), 0.0 * angle + z[:, None]], -1)
    x = np.concatenate([upper.reshape(-1, 3), (upper[:-1] - [0.0, 0.0, strut]).reshape(-1, 3)])
    kinds = (  # nodes (..., 2) and force density of each group, in the order of GROUPS
        (_both_ways(above[:-1], above[1:]), q[:, None, None]),
        (_both_ways(below, above[1:]), d[:, None, None]),
        (closed_rings(below[1:]), c[1:, None]),
        (closed_rings(above[0]), ring),
        (closed_rings(below[0]), c[0]),
        (np.stack([below, above[:-1]], -1), (-P / strut)[:, None]),
    )
    fixed = np.zeros((len(x), 3), bool)
    fixed[above[-1]] = True
    net = prestressed_net(x, fixed, kinds, GROUPS, given.ring_groups)
    net.outline = closed_rings(above[-1])
    return net


def _both_ways(inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """Return elements (h + 1, 2, n, 2) from each node (h + 1, n) to its two neighbours of the next level."""
    even = np.arange(len(inner))[:, None] % 2 == 0
    before = np.where(even, np.roll(outer, 1, 1), outer)
    after = np.where(even, outer, np.roll(outer, -1, 1))
    return np.stack([np.stack([inner, before], -1), np.stack([inner, after], -1)], 1)


def profile(given: Dome) -> tuple[Any, ...]:
    """Return radii, heights (h + 2,) [m] of levels; q, d, c (h + 1,) and upper ring [N/m]; P (h + 1,) [N]."""
    r, z = ridge_levels(given)
    cosine = cos(np.pi / given.spokes)
    fall, out, inwards = -np.diff(z), r[1:] * cosine - r[:-1], r[1:] - r[:-1] * cosine
    share = fall / (given.strut - fall)  # d / q
    growth = (1.0 + share[:-1]) * inwards[:-1] / out[1:]
    q = 0.5 * given.spoke_force / out[0] * np.concatenate([[1.0], np.cumprod(growth)])
    d, bend = q * share, r[:-1] * (1.0 - cos(2.0 * np.pi / given.spokes))
    return r, z, q, d, d * out / bend, q[0] * out[0] / bend[0], 2.0 * q * fall


def ridge_levels(given: Dome) -> tuple[np.ndarray, np.ndarray]:
    """Return radii and heights (h + 2,) [m] of ridge nodes on a paraboloid, from the ring to the supports."""
    r = np.linspace(0.5 * given.opening, 0.5 * given.diameter, given.hoops + 2)
    return r, given.dome_height * (r[-1] ** 2 - r**2) / (r[-1] ** 2 - r[0] ** 2)


def dome_error(given: Dome) -> str:
    """Describe the error in the dimensions of a dome, such as a cable in compression; "" if correct."""
    r, z = ridge_levels(given)
    if not (r[1:] * cos(np.pi / given.spokes) > r[:-1]).all():
        return messages.CLOSE_RINGS(value=given.hoops, spokes=given.spokes)
    fall = float(-np.diff(z).max())
    return "" if given.strut > fall else messages.SHORT_STRUT(value=given.strut, fall=fall)
