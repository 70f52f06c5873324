"""Warnings of doubtful parts of a result.

An element breaks in the step in which its strain exceeds the limit, and its remnant gets longer in the same
step. Its tension thus exceeds the strength by at most the increment of one step. This increment is large if
a fragment end of small mass becomes taut at high speed. An element without a strength that is attached to
such an end rings numerically; only its own mass and the time step limit its force. Such tensions are not
results.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.core.messages import count_of
from netfall.job.values import counted
from netfall.physics.law.measures import REACHED_SHARE
from netfall.physics.slip.law import MIN_SEGMENT_SHARE
from netfall.results import messages, states
from netfall.results.file import element_name
from netfall.results.removals import fracture_times

MAX_BALANCE_ERROR = 1e-3  # energy balance error above which a result is doubtful, for either of its measures
MAX_WORK_IDENTITY_ERROR = 1e-6  # above which netfall warns; rounding gives 1e-16 to 1e-11 in the shipped jobs
MAX_TORSION_SHARE = 0.05  # torsion of a bending chain over the largest bending moment: netfall warns above it
LARGE_DISPLACEMENT = 0.2  # static displacement over the net's largest dimension: netfall warns above it
# tension over strength; breaking elements of the shipped jobs exceed 1 by less than 0.01
OVERLOADED_TENSION = 1.05

BALANCE_COLUMNS = ("energy_balance_error", "balance_error_attached")  # columns of /history


def balance_warnings(history: Any) -> Iterator[str]:
    """Yield warnings if the energy balance error or the work identity error of any row is above its limit.

    history : datasets of /history by name
    """
    time = history["time"]
    error = np.fmax(*(np.abs(history[name]) for name in BALANCE_COLUMNS))
    off = np.flatnonzero(error > MAX_BALANCE_ERROR)
    if len(off):
        until = "on" if off[-1] == len(time) - 1 else f"to {time[off[-1]]:.4g} s"
        yield messages.ENERGY_UNBALANCED(
            errors=balance_text(history), limit=MAX_BALANCE_ERROR, first=time[off[0]], until=until
        )
    work_error = np.nanmax(np.abs(history["work_identity_error"]), initial=0.0)  # nan without energy check
    if work_error > MAX_WORK_IDENTITY_ERROR:
        yield messages.WORK_IDENTITY_BROKEN(error=work_error, limit=MAX_WORK_IDENTITY_ERROR)


def balance_text(history: Any) -> str:
    """Return the largest energy balance errors as text; history : see `balance_warnings`."""
    in_play, attached = (f"{np.nanmax(np.abs(history[name]), initial=0.0):.2g}" for name in BALANCE_COLUMNS)
    return f"{in_play} of the energy that took part, {attached} of the largest stored in attached parts"


def detached_warnings_of(f: Any) -> Iterator[str]:
    """Yield a warning if a detached part of a result is faster than the largest gust.

    Downward velocity does not count, because it is due to the fall.
    """
    if "detached" not in f:
        return
    parts = f["detached"]
    velocity, gust = np.array(parts["velocity"]), float(parts["largest_gust"][()])
    velocity[:, 2] = np.maximum(velocity[:, 2], 0.0)
    speed = lengths(velocity)
    over = np.flatnonzero(speed > gust)  # empty if the gust is nan (not known)
    if len(over):
        k = over[0]
        yield messages.DETACHED_TOO_FAST(
            time=parts["time"][k], mass=parts["mass"][k], node=parts["node_id"][k], speed=speed[k], gust=gust
        )


def displacement_warnings(equilibria: list[tuple[str, float, int]], x: np.ndarray) -> Iterator[str]:
    """Yield a warning if a node moved by more than LARGE_DISPLACEMENT of the net's size in an equilibrium.

    equilibria : description of each equilibrium, its largest displacement [m], the id of that node
    x : (n, 3) [m], position from which displacements count
    """
    size = float(np.ptp(x, axis=0).max())
    far = [equilibrium for equilibrium in equilibria if equilibrium[1] > LARGE_DISPLACEMENT * size]
    if far:
        what, distance, node = max(far, key=lambda equilibrium: equilibrium[1])
        others = f" (exceeded in {len(far)} of {len(equilibria)} equilibria)" if len(equilibria) > 1 else ""
        yield messages.LARGE_DISPLACEMENT(
            what=what, node=node, distance=distance, limit=LARGE_DISPLACEMENT, size=size, others=others
        )


def force_balance_warnings(equilibria: list[tuple[str, float]]) -> Iterator[str]:
    """Yield a warning if reactions do not balance the loads in any equilibrium.

    equilibria : description of each equilibrium, and `unexplained` of its `statics.reactions.Balance`
    """
    unbalanced = [equilibrium for equilibrium in equilibria if equilibrium[1] > 0.0]
    if unbalanced:
        what, share = max(unbalanced, key=lambda equilibrium: equilibrium[1])
        others = f" (and {len(unbalanced) - 1} other equilibria)" if len(unbalanced) > 1 else ""
        yield messages.FORCES_UNBALANCED(what=what, others=others, share=share)


def torsion_warnings(equilibria: list[tuple[str, tuple[float, int]]], node_id: np.ndarray) -> Iterator[str]:
    """Yield a warning for the equilibrium with the largest torsion in a bending chain.

    equilibria : description of each equilibrium, and the result of `statics.at_limit.largest_torsion`
    """
    above = [equilibrium for equilibrium in equilibria if equilibrium[1][0] > MAX_TORSION_SHARE]
    if above:
        what, (share, p) = max(above, key=lambda equilibrium: equilibrium[1][0])
        others = ""
        if len(equilibria) > 1:
            others = f" (more than {MAX_TORSION_SHARE:.0%} in {len(above)} of {len(equilibria)} equilibria)"
        yield messages.TORSION_NOT_MODELLED(what=what, node=node_id[p], share=share, others=others)


def rounding_warnings(equilibria: list[tuple[str, float, float]], tolerance: float) -> Iterator[str]:
    """Yield a warning for the equilibrium with the largest error above the tolerance.

    equilibria : description of each equilibrium, its estimated error, the smallest error that rounding allows
    """
    equilibria = [entry for entry in equilibria if entry[2] < 1.0]  # otherwise all forces are rounding errors
    if not equilibria:
        return
    what, error, least = max(equilibria, key=lambda equilibrium: equilibrium[1])
    below = error <= 2.0 * least
    message = messages.TOLERANCE_BELOW_ROUNDING if below else messages.TOLERANCE_MISSED
    yield message(what=what, error=error, tolerance=tolerance, least=least, possible=2.0 * least)


def slip_end_warnings(equilibria: list[tuple[str, tuple[int, ...]]], element_id: np.ndarray) -> Iterator[str]:
    """Yield warnings of equilibria in which cables slipped to the limit of the model.

    equilibria : description of each equilibrium, and the rows of the shortened elements
    """
    for what, rows in equilibria:
        if rows:
            elements = counted("element", element_id[list(rows)])
            yield messages.SLIP_AT_END(what=what, share=MIN_SEGMENT_SHARE, elements=elements)


INSTABILITY_TEXT = "compressed bars buckle (the tangent stiffness is not positive definite)"


AT_LIMIT = {  # attribute of an equilibrium: the warning of the elements listed in it
    "over_strength": messages.STRENGTH_EXCEEDED,
    "buckled": messages.BUCKLED,
    "beyond_euler": messages.EULER_LOAD_EXCEEDED,
    "yielding": messages.YIELDING,
    "yielded": messages.YIELDED,
}


def limit_warnings(*equilibria: tuple[str, dict[str, Any]]) -> Iterator[str]:
    """Yield a warning for each limit that elements reach, with a table if several equilibria reach it.

    equilibria : description of each, and its attributes with element ids
    """
    for name, warning in AT_LIMIT.items():
        rows = [(what, np.asarray(labels[name])) for what, labels in equilibria if name in labels]
        if len(rows) == 1:
            yield warning(what=rows[0][0], elements=element_list(rows[0][1]))
        elif rows:
            elements = element_list(np.unique(np.concatenate([ids for _, ids in rows])))
            yield warning(what=f"{len(rows)} of {len(equilibria)} equilibria", elements=elements)
            width = max(len(what) for what, _ in rows)
            yield from (f"    {what:{width}}  {element_list(ids)}" for what, ids in rows)


def element_list(ids: np.ndarray) -> str:
    """Return the number of elements and the first ids."""
    return f"{'at least ' * (len(ids) >= states.MOST_MARKED)}{counted('element', ids)}"


def dynamic_limit_warnings_of(f: Any) -> Iterator[str]:
    """Yield warnings of elements that buckled, exceeded the Euler load, or yielded in the dynamic stage."""
    compression, caps, ids = -f["envelope/tension_min"][:], states.force_caps(f), f["net/element_id"][:]
    reached = {
        "buckled": compression >= REACHED_SHARE * caps.buckling,
        "beyond_euler": compression > caps.straight,
        "yielded": states.yielded_elements(f),
    }
    labels = {name: ids[rows][: states.MOST_MARKED] for name, rows in reached.items() if rows.any()}
    yield from limit_warnings((states.DYNAMIC_STAGE, labels))


def exceeds_strength(f: Any) -> np.ndarray:
    """Find the elements (m,) with a tension of more than OVERLOADED_TENSION times their strength."""
    return np.asarray(f["envelope/tension_max"][:] > OVERLOADED_TENSION * _strengths(f))


def _strengths(f: Any) -> np.ndarray:
    """Return the tensions (m,) [N] at which the elements break or yield; inf: never."""
    return np.minimum(states.force_caps(f).yielding, states.breaking_forces(f))


def neighbour_strength(f: Any) -> np.ndarray:
    """Compute an upper bound (m,) [N] of tensions from the strengths of the neighbours, inf if unknown.

    At each node it is the larger of two values: the sum of the neighbours' strengths projected on the element
    in the form, and the strength of a collinear neighbour. The bound applies only to elements that have no
    strength and reach their largest tension after the first fracture. It covers only tension, because loads
    contribute to compression.
    """
    ends, x, strengths = f["net/elements"][:], states.start_position(f), _strengths(f)
    chord = x[ends[:, 1]] - x[ends[:, 0]]
    direction = chord / lengths(chord)[:, None]
    n, bound = int(ends.max(initial=-1)) + 1, np.full(len(ends), np.inf)
    by_node = np.argsort(ends.ravel(), kind="stable")
    start = np.searchsorted(ends.ravel()[by_node], np.arange(n + 1))
    after = f["envelope/tension_max_time"][:] >= np.nanmin(fracture_times(f))
    is_large = f["envelope/tension_max"][:] > strengths.min()
    for e in np.flatnonzero(np.isinf(strengths) & after & is_large):
        for p in ends[e]:
            others = by_node[start[p] : start[p + 1]] // 2
            others = others[others != e]
            strength = strengths[others]
            if len(others) and np.isfinite(strength).all():
                cosine = np.abs((direction[others] * direction[e]).sum(1))
                bound[e] = min(bound[e], max(float((cosine * strength).sum()), float(strength.max())))
    return bound


def overload_warnings_of(f: Any) -> Iterator[str]:
    """Yield warnings of elements above their strength, or without one above `neighbour_strength`.

    There are no warnings without a fracture.
    """
    most, times, broke = f["envelope/tension_max"][:], f["envelope/tension_max_time"][:], fracture_times(f)
    if not np.isfinite(broke).any():
        return
    for message, bound in (messages.OVERSHOOT, _strengths(f)), (messages.RINGING, neighbour_strength(f)):
        rows = np.flatnonzero(most > OVERLOADED_TENSION * bound)
        if len(rows):
            e = rows[np.argmax(most[rows] / bound[rows])]
            count, name = count_of(len(rows), "element"), element_name(f["net"], e)
            fracture = f", fracture at t = {broke[e]:.4g} s" if np.isfinite(broke[e]) else ""
            yield message(
                count=count, element=name, tension=most[e], time=times[e], bound=bound[e], fracture=fracture
            )


def error_text(displacement: float, tension: float) -> str:
    """Return estimated relative errors of displacements and tensions as text; nan: not known."""
    known = f"estimated error {displacement:.0e} (displacement), {tension:.0e} (force)"
    return known if displacement == displacement else "estimated error unknown"
