"""What form finding did to the geometry that was given, in sentences; no file is opened here."""

import numpy as np

from netfall.job.values import counted
from netfall.numerics.functions import lengths

STRAIGHT = 1e-4  # sine of the angle up to which elements lie on one line
NO_PART = 1e-9  # of the largest force of a state: an element with less takes no part
FAR = 0.02  # of the span in plan: netfall warns if a node moved farther in plan
LARGER = 0.05  # of the roof's area as given: netfall warns if the form changes it by more


def form_lines(
    given, found, free, node_id, area_given: float, area: float, constant: bool = False
) -> list[str]:
    """How far the nodes moved, what became of the roof, and a warning if either is much.

    given, found : (n, 3) [m]; free : (n,) bool, nodes that can move on some axis; area_given, area : [m2]
    constant : whether the form has constant tension
    """
    moved = np.where(free, lengths(found - given), 0.0)
    if not free.any():
        return []
    most = int(np.argmax(moved))
    line = (
        f"form: nodes moved by up to {moved[most]:.4g} m (node {node_id[most]}), "
        f"{moved[free].mean():.4g} m on the mean"
    )
    larger = area / area_given - 1.0 if area_given > 0.0 else 0.0
    if area_given > 0.0:
        line += f"; roof {area_given:.1f} m2 as given, {area:.1f} m2 in the form ({larger:+.1%})"
    in_plan = np.where(free, np.hypot(*(found - given)[:, :2].T), 0.0)
    span, p = float(np.ptp(given[:, :2], axis=0).max()), int(np.argmax(in_plan))
    facts = []
    if in_plan[p] > FAR * span:
        count = int((in_plan > FAR * span).sum())
        facts.append(
            f"{count} of {len(moved)} nodes moved in plan by more than {FAR:.0%} of the span of {span:.4g} "
            f"m, node {node_id[p]} most, by {in_plan[p]:.4g} m"
        )
    if abs(larger) > LARGER:
        facts.append(f"the roof's area changed by {larger:+.1%} (limit {LARGER:.0%})")
    if not facts:
        return [line]
    remedy = "Check supports, prestress and force densities"
    if constant:
        remedy = (
            "Constant tension moves nodes along cables; to keep them near their places, use [form_finding] "
            'modulus_factor = 1e-3 or method = "force_density", or keep the geometry with method = "keep"'
        )
    return [
        line,
        f"warning: form finding: {'; '.join(facts)}. The form that is built and loaded is not the geometry "
        f"given. {remedy}",
    ]


def loose_notes(x, ends, N, held, angle, node_id) -> list[str]:
    """A note on nodes of a form at constant tension that may stand anywhere along a cable.

    x : (n, 3) [m], of the form; ends : (m, 2); N : (m,) [N], constant
    held : (n, 3) bool, axes with a support; angle : (n,) [degrees], of these axes, None: x and y
    """
    if angle is not None:  # what is held along a line of its own is left out
        held = held | (held.any(1) & (angle != 0.0))[:, None]
    rows = loose_along(x, ends[N > 0.0], held)
    if not len(rows):
        return []
    one = len(rows) == 1
    return [
        f"note: form finding at constant tension: nothing holds {counted('node', node_id[rows])} along the "
        f"straight {'cable on which it stands' if one else 'cables on which they stand'}: any place there is "
        f"in equilibrium, and {'it is' if one else 'they are'} about where {'it' if one else 'they'} began; "
        'with [form_finding] modulus_factor = 1e-3 or method = "force_density" places follow'
    ]


def loose_along(x, ends, held) -> np.ndarray:
    """Nodes (k,) all of whose elements lie on one line, along which no support holds them.

    x : (n, 3) [m]; ends : (m, 2), of elements that pull; held : (n, 3) bool
    """
    along = x[ends[:, 1]] - x[ends[:, 0]]
    along /= np.maximum(lengths(along), 1e-300)[:, None]
    line, off = np.zeros_like(x), np.zeros(len(x))
    for k in range(2):
        line[ends[:, k]] = along  # of one element of each node
    for k in range(2):
        np.maximum.at(off, ends[:, k], lengths(np.cross(line[ends[:, k]], along)))
    holds = (held & (np.abs(line) > STRAIGHT)).any(1)
    return np.flatnonzero(line.any(1) & (off < STRAIGHT) & ~holds)


def self_stress_lines(states: np.ndarray, group: np.ndarray, names: list[str]) -> list[str]:
    """How many states of self-stress a geometry has, and which groups take part in them.

    states : (k, m) axial forces; group : (m,) rows of names
    """
    if not len(states):
        return ["self-stress: the geometry has no state; its forces follow from the load alone"]
    taking = np.unique(group[(np.abs(states) > NO_PART).any(0)])
    of = lambda rows: ", ".join(names[row] or "without a name" for row in rows)
    others = np.setdiff1d(np.unique(group), taking)
    count = f"{len(states)} states" if len(states) > 1 else "1 state"
    without = f"; no part in {'them' if len(states) > 1 else 'it'}: {of(others)}" if len(others) else ""
    spread = [np.ptp(states[:, group == row], axis=1) > NO_PART for row in taking]
    equal = "each ring of each group" if np.any(spread) else "each group"
    return [f"self-stress: {count} with one force in {equal}, of {of(taking)}{without}"]
