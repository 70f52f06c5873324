"""An orthogonal cable net in a rigid elliptic ring that rises and falls like a saddle."""

import numpy as np

from netfall.net.generators.ellipse import around, cables_in_ellipse, in_order
from netfall.net.net import Net


def ring(length: float, width: float, rise: float, spacing: float) -> Net:
    """Cables along x and y at multiples of `spacing`, each from the ring to the ring, z = rise (u^2 - v^2).

    u = x / a, v = y / b, with a and b half of length and width: so the ring stands `rise` above the middle at
    the ends of the long axis, and as far below it at those of the short one.
    """
    a, b = 0.5 * length, 0.5 * width
    plan, held, along_x, along_y = cables_in_ellipse(a, b, spacing)
    elements, group = in_order(along_x, along_y)
    x = np.column_stack([plan, rise * ((plan[:, 0] / a) ** 2 - (plan[:, 1] / b) ** 2)])
    edge = around(np.flatnonzero(held), plan, a, b)
    fixed = np.repeat(held[:, None], 3, 1)
    outline = np.column_stack([edge, np.roll(edge, -1)])
    return Net(x, fixed, elements, group, ["x", "y"], outline=outline)
