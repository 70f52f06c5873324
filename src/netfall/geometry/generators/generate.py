"""Nets from dimensions: saddle (4.1) and stadium (4.2) of the paper; ring, wheel and dome."""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.geometry import messages
from netfall.geometry.generators.dome import dome, dome_error
from netfall.geometry.generators.ellipse import SNAP_DISTANCE, cables_in_ellipse, sort_around_ellipse
from netfall.geometry.generators.prestressed import closed_rings
from netfall.geometry.generators.wheel import largest_brace_force, wheel
from netfall.geometry.net import Net, pair_key
from netfall.job.keys.net import Ring, Saddle, Stadium


def _cable_net(
    x: np.ndarray,
    held: np.ndarray,
    along_x: np.ndarray,
    along_y: np.ndarray,
    outline: np.ndarray,
    corners: Any = (),
) -> Net:
    """Build a net of cables along x and y, elements (k, 2) sorted by their particles; held : (n,) bool."""
    elements, group = np.concatenate([along_x, along_y]), np.repeat([0, 1], [len(along_x), len(along_y)])
    order = np.lexsort((elements[:, 1], elements[:, 0]))
    fixed, names = np.repeat(held[:, None], 3, 1), ["x", "y"]
    return Net(
        x, fixed, elements[order], group[order], names, outline=outline, corners=np.reshape(corners, (-1, 3))
    )


def saddle(given: Saddle) -> Net:
    """Generate a square net on a rigid boundary z = rise ((x/a)^2 - (y/a)^2), a = side / 2.

    Free particles are on z = 0. The corners of the square have no cables and are not particles.
    """
    a, count = 0.5 * given.side, given.cells + 1
    line = np.linspace(-a, a, count)
    X, Y = np.meshgrid(line, line)
    on_edge = np.zeros((count, count), bool)
    on_edge[[0, -1]] = on_edge[:, [0, -1]] = True
    corner = np.zeros_like(on_edge)
    corner[np.ix_([0, -1], [0, -1])] = True
    Z = np.where(on_edge, given.rise * ((X / a) ** 2 - (Y / a) ** 2), 0.0)
    points = np.stack([X, Y, Z], -1)
    number = np.where(corner, -1, np.cumsum(~corner).reshape(corner.shape) - 1)
    n = int((~corner).sum())
    number[corner] = n + np.arange(4)
    ring = np.concatenate([number[0], number[1:, -1], number[-1, -2::-1], number[-2:0:-1, 0]])
    inner = slice(1, -1)
    along_x = np.stack([number[inner, :-1], number[inner, 1:]], -1).reshape(-1, 2)
    along_y = np.stack([number[:-1, inner], number[1:, inner]], -1).reshape(-1, 2)
    held = on_edge[~corner]
    return _cable_net(points[~corner], held, along_x, along_y, closed_rings(ring), points[corner])


def mirror_net(half: Net) -> Net:
    """Join a net on one side of its supports on y = 0 with its mirror image on the other side."""
    away = np.flatnonzero(half.x[:, 1] > 0)
    away = away[np.lexsort((half.x[away, 0], -half.x[away, 1]))]
    k, corners = len(away), len(half.corners)
    own = k + np.arange(half.n + corners)
    image = own.copy()
    image[away] = np.arange(k)
    along_x, along_y = (half.elements[half.group == group] for group in (0, 1))
    outline = np.concatenate([image[half.outline], own[half.outline]])
    # both halves have the arch
    first = np.sort(np.unique(pair_key(outline, len(own) + k), return_index=True)[1])
    held = np.asarray(half.fixed.all(1))
    return _cable_net(
        np.concatenate([half.x[away] * [1.0, -1.0, 1.0], half.x]),
        np.concatenate([held[away], held]),
        np.concatenate([image[along_x], own[along_x]]),
        np.concatenate([image[along_y][:, ::-1], own[along_y]]),
        outline[first],
        half.corners,
    )


def stadium(given: Stadium) -> Net:
    """Generate a stadium roof: one half as in the paper, or two halves with a common arch.

    A half reaches from a rigid parabolic arch (y = 0) to a rigid elliptic edge (z = 0). Cables run along x
    and y at multiples of `spacing` and end on the arch or the ellipse. The start geometry is the ruled
    surface that is straight in the y direction from arch to edge.
    """
    a, b, spacing = 0.5 * given.length, 0.5 * given.width, given.spacing
    xy, support, along_x, along_y = cables_in_ellipse(a, b, spacing, whole=False)
    height = given.arch_rise * (1 - (xy[:, 0] / a) ** 2)
    to_edge = b * np.sqrt(np.maximum(0.0, 1 - (xy[:, 0] / a) ** 2))
    z = np.where(
        support & (xy[:, 1] > 0), 0.0, height * (1 - xy[:, 1] / np.maximum(to_edge, SNAP_DISTANCE * spacing))
    )
    n = len(xy)
    arch = np.flatnonzero(support & (xy[:, 1] == 0))
    edge = sort_around_ellipse(np.flatnonzero(support & (xy[:, 1] > 0)), xy, a, b)
    ring = np.concatenate([[n], arch, [n + 1], edge])  # from (-a, 0) to (a, 0), then back along the ellipse
    corners = [[-a, 0.0, 0.0], [a, 0.0, 0.0]]
    half = _cable_net(np.column_stack([xy, z]), support, along_x, along_y, closed_rings(ring), corners)
    return half if given.halves == 1 else mirror_net(half)


def ring(given: Ring) -> Net:
    """Generate cables along x and y at multiples of `spacing` inside an elliptic ring, z = rise (u^2 - v^2).

    u = x / a, v = y / b, with a and b half of length and width. The ring is `rise` above the middle at
    the ends of the long axis, and `rise` below it at the ends of the short axis.
    """
    a, b = 0.5 * given.length, 0.5 * given.width
    plan, held, along_x, along_y = cables_in_ellipse(a, b, given.spacing)
    x = np.column_stack([plan, given.rise * ((plan[:, 0] / a) ** 2 - (plan[:, 1] / b) ** 2)])
    edge = sort_around_ellipse(np.flatnonzero(held), plan, a, b)
    return _cable_net(x, held, along_x, along_y, closed_rings(edge))


def generate(net: Any) -> Net:
    """Generate the net of a section [net] with a generator."""
    makers: dict[str, Callable[[Any], Net]] = dict(
        saddle=saddle, stadium=stadium, ring=ring, wheel=wheel, dome=dome
    )
    return makers[net.generator](getattr(net, net.generator))


def dimension_error(generator: str, net: Any, most: int) -> str:
    """Describe the error in the dimensions of a generator: too many elements, or no roof; "" if correct."""
    key = {"saddle": "cells", "stadium": "spacing", "ring": "spacing"}.get(generator, "spokes")
    if generator == "saddle":
        size = 2.0 * net.cells**2
    elif generator in ("stadium", "ring"):
        halves = net.halves if generator == "stadium" else 2
        size = halves * 2.0 * (np.pi / 8) * (net.length / net.spacing) * (net.width / net.spacing)
    else:
        size = net.spokes * (4.0 * net.hoops + 12.0 if generator == "wheel" else 6.0 * net.hoops + 7.0)
    value = getattr(net, key)
    if not size <= most:
        return messages.TOO_MANY_GENERATED(key=key, value=value, number=size, most=most)
    if generator in ("stadium", "ring") and net.spacing > 0.25 * min(net.length, net.width):
        return messages.WIDE_SPACING(value=value, most=0.25 * min(net.length, net.width))
    if generator == "wheel" and net.spokes % 4:
        return messages.SPOKES_NOT_BY_FOUR(value=value)
    if generator in ("wheel", "dome") and not net.opening < net.diameter:
        return messages.LARGE_OPENING(value=net.opening, diameter=net.diameter)
    if generator == "wheel":
        most = largest_brace_force(net)
        if not net.brace_force < most:
            return messages.LARGE_BRACE_FORCE(value=net.brace_force, most=most)
    return dome_error(net) if generator == "dome" else ""
