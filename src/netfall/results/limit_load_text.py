"""Text on tensions that exceed what an element can carry. Takes arrays; opens no file.

An element breaks in the step in which its strain exceeds the limit, and its remnant gets longer in the same
step. Its tension thus exceeds the strength by at most the increment of one step. This increment is large if
a fragment end of small mass becomes taut at high speed. An element without a strength that is attached to
such an end rings numerically; only its own mass and the time step limit its force. Such tensions are not
results.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.results import messages

BEYOND = 1.05  # tension over strength; breaking elements of the shipped jobs exceed 1 by less than 0.01


class Carried(NamedTuple):
    """Largest tensions, strengths and fracture times of elements (m,) in a dynamic stage.

    ends : (m, 2) nodes; direction : (m, 3) unit vectors, in the form
    strength : [N] at which the element breaks or yields, inf: never
    most : [N] largest tension; time : [s] of the largest tension; broke : [s] of fracture, nan: none
    """

    ends: np.ndarray
    direction: np.ndarray
    strength: np.ndarray
    most: np.ndarray
    time: np.ndarray
    broke: np.ndarray


def exceeds_strength(c: Carried) -> np.ndarray:
    """Find the elements (m,) with a tension of more than BEYOND times their strength."""
    return c.most > BEYOND * c.strength


def neighbour_strength(c: Carried) -> np.ndarray:
    """Compute an upper bound (m,) [N] of tensions from the strengths of the neighbours, inf if unknown.

    At each node it is the larger of two values: the sum of the neighbours' strengths projected on the element
    in the form, and the strength of one neighbour in line with it. The bound applies only to elements that
    have no strength and reach their largest tension after the first fracture. It covers tension only, since
    loads contribute to compression.
    """
    n, bound = int(c.ends.max(initial=-1)) + 1, np.full(len(c.ends), np.inf)
    by_node = np.argsort(c.ends.ravel(), kind="stable")
    start = np.searchsorted(c.ends.ravel()[by_node], np.arange(n + 1))
    after = c.time >= np.nanmin(c.broke)
    for e in np.flatnonzero(np.isinf(c.strength) & after & (c.most > c.strength.min())):
        for p in c.ends[e]:
            others = by_node[start[p] : start[p + 1]] // 2
            others = others[others != e]
            strength = c.strength[others]
            if len(others) and np.isfinite(strength).all():
                cosine = np.abs((c.direction[others] * c.direction[e]).sum(1))
                bound[e] = min(bound[e], max(float((cosine * strength).sum()), float(strength.max())))
    return bound


def overload_warnings(c: Carried, name: Callable[..., Any]) -> list[str]:
    """Return warnings of elements above their strength, and of those without one above the bound of
    `neighbour_strength`.

    name : returns the name of an element from its row. Empty unless something broke.
    """
    if not np.isfinite(c.broke).any():
        return []
    lines, rows = [], np.flatnonzero(exceeds_strength(c))
    if len(rows):
        e = rows[np.argmax(c.most[rows] / c.strength[rows])]
        fracture = f", fracture at t = {c.broke[e]:.4g} s" if np.isfinite(c.broke[e]) else ""
        count, element, tension, strength = _count(rows), name(e), c.most[e], c.strength[e]
        lines.append(
            messages.OVERSHOOT(
                count=count,
                element=element,
                tension=tension,
                time=c.time[e],
                strength=strength,
                fracture=fracture,
            )
        )
    bound = neighbour_strength(c)
    rows = np.flatnonzero(c.most > BEYOND * bound)
    if len(rows):
        e = rows[np.argmax(c.most[rows] / bound[rows])]
        count, tension = _count(rows), c.most[e]
        lines.append(
            messages.RINGING(count=count, element=name(e), tension=tension, time=c.time[e], bound=bound[e])
        )
    return lines


def _count(rows: np.ndarray) -> str:
    return f"{len(rows)} element{'s' * (len(rows) > 1)}"
