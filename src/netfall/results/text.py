"""Text on the form, from arrays."""

from collections.abc import Iterator

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.functions import lengths
from netfall.core.messages import kN, mm
from netfall.geometry.net import Net
from netfall.job.values import counted
from netfall.results import messages

MAX_LINE_SINE = 1e-4  # sine of the angle up to which elements count as collinear
# of the largest force of a state of self-stress; an element with less does not belong to the state
MIN_FORCE_SHARE = 1e-9
MAX_DRIFT = 0.02  # displacement in plan (facade: in its plane) over the span: netfall warns above it
MAX_PRESTRESS_CHANGE = 0.1  # of a force from the prestress as given [-], beyond which netfall warns
MAX_BAR_CHANGE = 0.1  # relative change of a bar's length by form finding: netfall warns above it
ROUNDED_FORCE = 1e-9  # share of the largest force [-], up to which a cable of the form counts as slack
MAX_AREA_CHANGE = 0.05  # relative change of the roof's area by form finding: netfall warns above it


def form_lines(
    net: Net, x: FloatArray, area_given: float = 0.0, area: float = 0.0, constant: bool = False
) -> Iterator[str]:
    """Describe how far the nodes moved and how the roof area changed, with warnings of large changes.

    x : (n, 3) [m], of the form; area_given, area : [m2], of the roof; 0: not known
    constant : whether the form has constant tension
    """
    free, given, node_id = net.moves, net.x, net.node_id
    moved = np.where(free, lengths(x - given), 0.0)
    if not free.any():
        return
    largest = int(np.argmax(moved))
    line = (
        f"form: nodes moved by up to {mm(moved[largest])} (node {node_id[largest]}), "
        f"{mm(moved[free].mean())} on average"
    )
    area_change = area / area_given - 1.0 if area_given > 0.0 else 0.0
    if area_given > 0.0:
        line += f"; roof area {area_given:.1f} m2 as given, {area:.1f} m2 in the form ({area_change:+.1%})"
    plan = net.in_plan(given)[:, :2]
    in_plan = np.where(free, np.hypot(*(net.in_plan(x)[:, :2] - plan).T), 0.0)
    span, p = float(np.ptp(plan, axis=0).max()), int(np.argmax(in_plan))
    view = "in plan" if net.roof_axes is None else "across [roof] normal"
    yield line
    remedy = messages.KEEP_POSITIONS if constant else messages.CHECK_FORM
    if in_plan[p] > MAX_DRIFT * span:
        count, total = int((in_plan > MAX_DRIFT * span).sum()), len(moved)
        yield messages.FORM_MOVED(
            count=count,
            total=total,
            view=view,
            limit=MAX_DRIFT,
            span=span,
            node=node_id[p],
            distance=in_plan[p],
            remedy=remedy,
        )
    if abs(area_change) > MAX_AREA_CHANGE:
        yield messages.FORM_AREA_CHANGED(change=area_change, limit=MAX_AREA_CHANGE, remedy=remedy)


def form_tensions(N: FloatArray, bar: np.ndarray) -> str:
    """Return the range of the axial forces of a form, and how many cables are slack, if any.

    N : (m,) [N]; bar : (m,), whether an element is a bar
    """
    slack = int(((N <= ROUNDED_FORCE * np.abs(N).max()) & (bar == 0)).sum())
    return f"tensions {kN(N.min(), N.max())}" + (f"; {slack} of {len(N)} elements slack" if slack else "")


def bar_length_warnings(net: Net, x: FloatArray) -> Iterator[str]:
    """Yield a warning if form finding changed the length of a bar. x : (n, 3) [m], of the form"""
    ends, element_id = net.elements, net.element_id
    before, after = (lengths(place[ends[:, 1]] - place[ends[:, 0]]) for place in (net.x, x))
    change = np.where(net.bar & (before > 0.0), after / np.where(before > 0.0, before, 1.0) - 1.0, 0.0)
    count, worst = int((np.abs(change) > MAX_BAR_CHANGE).sum()), int(np.argmax(np.abs(change)))
    if count:
        largest, others = change[worst], f", and {count - 1} more" if count > 1 else ""
        first, last, element, limit = before[worst], after[worst], element_id[worst], MAX_BAR_CHANGE
        yield messages.BAR_LENGTH_CHANGED(
            element=element, before=first, after=last, change=largest, limit=limit, others=others
        )


def prestress_warnings(net: Net, N: FloatArray, is_given: bool = True) -> Iterator[str]:
    """Yield a warning if the forces N (m,) [N] of a form differ much from the given prestress.

    is_given : whether the geometry is given, so that N is its self-stress
    """
    given = net.prestress
    change = np.abs(N - given) / np.where(given == 0.0, np.inf, np.abs(given))
    count, worst = len(np.unique(net.element_id[change > MAX_PRESTRESS_CHANGE])), int(np.argmax(change))
    if count:
        element, limit = net.element_id[worst], MAX_PRESTRESS_CHANGE
        yield messages.PRESTRESS_CHANGED(
            count=count,
            limit=limit,
            element=element,
            found=N[worst],
            given=given[worst],
            remedy=messages.FORCES_OF_GEOMETRY if is_given else messages.FORCES_OF_FPM,
        )


def undetermined_node_notes(net: Net, x: FloatArray, N: FloatArray) -> Iterator[str]:
    """Yield a note on nodes of a constant-tension form whose position along a cable is undetermined.

    x : (n, 3) [m], of the form; N : (m,) [N], constant
    """
    held = net.held
    if net.angle is not None:  # a support with rotated axes counts as fixed along all axes
        held = held | (held.any(1) & (net.angle != 0.0))[:, None]
    rows = undetermined_nodes(x, net.elements[N > 0.0], held)
    if len(rows):
        yield messages.UNDETERMINED_NODES(nodes=counted("node", net.node_id[rows]))


def undetermined_nodes(x: FloatArray, ends: IntArray, held: BoolArray) -> np.ndarray:
    """Find the nodes (k,) whose elements are collinear and that no support holds along this line.

    x : (n, 3) [m]; ends : (m, 2), of elements in tension; held : (n, 3) bool
    """
    direction = x[ends[:, 1]] - x[ends[:, 0]]
    direction /= np.maximum(lengths(direction), 1e-300)[:, None]
    line, deviation = np.zeros_like(x), np.zeros(len(x))
    for k in range(2):
        line[ends[:, k]] = direction  # direction of one element at each node
    for k in range(2):
        np.maximum.at(deviation, ends[:, k], lengths(np.cross(line[ends[:, k]], direction)))
    is_held = (held & (np.abs(line) > MAX_LINE_SINE)).any(1)
    return np.flatnonzero(line.any(1) & (deviation < MAX_LINE_SINE) & ~is_held)


def self_stress_line(states: np.ndarray, group: np.ndarray, names: list[str]) -> str:
    """Describe the number of states of self-stress of a geometry, and the groups that belong to them.

    states : (k, m) axial forces; group : (m,) rows of names
    """
    if not len(states):
        return "self-stress: the geometry has no state; its forces follow from the load alone"
    active = np.unique(group[(np.abs(states) > MIN_FORCE_SHARE).any(0)])
    inactive = np.setdiff1d(np.unique(group), active)
    named_active, named_inactive = (
        ", ".join(names[row] or "without a name" for row in rows) for rows in (active, inactive)
    )
    count = f"{len(states)} states" if len(states) > 1 else "1 state"
    without = f"; no part in {'them' if len(states) > 1 else 'it'}: {named_inactive}" if len(inactive) else ""
    varies = [np.ptp(states[:, group == row], axis=1) > MIN_FORCE_SHARE for row in active]
    equal = "each ring of each group" if np.any(varies) else "each group"
    return f"self-stress: {count} with one force in {equal}, of {named_active}{without}"
