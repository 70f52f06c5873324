"""Tensions that an element cannot have borne, in sentences; no file is opened here.

An element breaks in the step in which its strain passes the limit, and what is left of it grows longer there:
so it has at most what one step adds to its strength, which is much where a light end comes taut at speed.
What has no strength and hangs on such an end rings along, as far as its own mass and the step let it. Such
tensions are no results.
"""

from typing import NamedTuple

import numpy as np

BEYOND = 1.05  # times its strength: in shipped jobs what breaks is less than 1 % above it after its last step
SMALLER = "a smaller [dynamics] safety (0.2, say) or time_step shows how much is the step's"
ONE_STEP = f"no result: a light end that came taut at speed, and what one step added then; {SMALLER}"
RINGS = (
    "no result: it hangs on light ends of what broke, and rings with nothing to hold it back; give it a "
    f"strength; {SMALLER}"
)


class Carried(NamedTuple):
    """What elements (m,) carried in a dynamic stage, and what they can.

    ends : (m, 2) nodes; direction : (m, 3) unit vectors, in the form; strength : [N] at which it breaks or
    yields, inf: never; most : [N] and its time : [s]; broke : [s], nan: did not
    """

    ends: np.ndarray
    direction: np.ndarray
    strength: np.ndarray
    most: np.ndarray
    time: np.ndarray
    broke: np.ndarray


def overloaded(c: Carried) -> np.ndarray:
    """Elements (m,) that had a tension of more than BEYOND times their strength."""
    return c.most > BEYOND * c.strength


def at_ends(c: Carried) -> np.ndarray:
    """The most (m,) [N] that what meets an element at either end can pull it with, inf: not known.

    All of that as it lies in the form, or one of the others in line with it. Of elements without a strength
    that had their largest tension after the first fracture; in compression loads count too.
    """
    n, bound = int(c.ends.max(initial=-1)) + 1, np.full(len(c.ends), np.inf)
    order = np.argsort(c.ends.ravel(), kind="stable")
    start = np.searchsorted(c.ends.ravel()[order], np.arange(n + 1))
    after = c.time >= np.nanmin(c.broke)
    for e in np.flatnonzero(np.isinf(c.strength) & after & (c.most > c.strength.min())):
        for p in c.ends[e]:
            others = order[start[p] : start[p + 1]] // 2
            others = others[others != e]
            carry = c.strength[others]
            if len(others) and np.isfinite(carry).all():
                along = np.abs((c.direction[others] * c.direction[e]).sum(1))
                bound[e] = min(bound[e], max(float((along * carry).sum()), float(carry.max())))
    return bound


def overload_lines(c: Carried, name) -> list[str]:
    """Notes on elements beyond their strength, and on those without one beyond what meets them can bear.

    name : of an element, by its row. Only once something broke.
    """
    if not np.isfinite(c.broke).any():
        return []
    lines, rows = [], np.flatnonzero(overloaded(c))
    if len(rows):
        e = rows[np.argmax(c.most[rows] / c.strength[rows])]
        broke = f", and it broke at t = {c.broke[e]:.4g} s" if np.isfinite(c.broke[e]) else ""
        lines.append(
            f"note: {_count(len(rows))} tensions beyond {'its' if len(rows) == 1 else 'their'} strength, the "
            f"most element {name(e)} with {c.most[e]:.4g} N at t = {c.time[e]:.4g} s, its strength is "
            f"{c.strength[e]:.4g} N{broke}: {ONE_STEP}"
        )
    bound = at_ends(c)
    rows = np.flatnonzero(c.most > BEYOND * bound)
    if len(rows):
        e = rows[np.argmax(c.most[rows] / bound[rows])]
        lines.append(
            f"note: {_count(len(rows))} no strength and carried more than what meets "
            f"{'it' if len(rows) == 1 else 'them'} can bear, the most element {name(e)} with "
            f"{c.most[e]:.4g} N at t = {c.time[e]:.4g} s, for {bound[e]:.4g} N at an end: {RINGS}"
        )
    return lines


def _count(rows: int) -> str:
    return "1 element had" if rows == 1 else f"{rows} elements had"
