"""Warnings and notes on doubtful parts of a result."""

from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.core.quantities import mm
from netfall.job.values import counted
from netfall.physics.law.limits import REACHED_SHARE
from netfall.results import states

MAX_BALANCE_ERROR = 1e-3  # energy balance error above which a result is doubtful, by either of its shares
MAX_TORSION_SHARE = 0.05  # torsion of a bending chain over the largest bending moment: netfall warns above it
MOST_MARKED = 4096  # elements listed in an attribute of an equilibrium: HDF5 limits an attribute to 64 kB
FAR = 0.2  # static displacement over the net's largest dimension: netfall prints a note above it


BALANCE_COLUMNS = ("energy_balance_error", "balance_error_attached")  # columns of /history


def balance_warnings(history: Any) -> list[str]:
    """Return a warning if the energy balance error of any row is above LARGEST_BALANCE.

    history : datasets of /history by name
    """
    time = history["time"]
    error = np.fmax(*(np.abs(history[name]) for name in BALANCE_COLUMNS))
    off = np.flatnonzero(error > MAX_BALANCE_ERROR)
    if not len(off):
        return []
    until = "on" if off[-1] == len(time) - 1 else f"to {time[off[-1]]:.4g} s"
    smaller = "[dynamics] safety or time_step" + (", or fragment_mass" if history["broken"][-1] else "")
    return [
        f"warning: dynamics: the energy balance is off by up to {balance_text(history)} (limit "
        f"{MAX_BALANCE_ERROR:g}), from t = {time[off[0]]:.4g} s {until}. The step is too long for some of "
        f"what happened. Compare with a run of half the step (a smaller {smaller})"
    ]


def balance_text(history: Any) -> str:
    """Return the largest energy balance errors as text; history : see `balance_warnings`."""
    in_play, attached = (f"{np.nanmax(np.abs(history[name]), initial=0.0):.2g}" for name in BALANCE_COLUMNS)
    return f"{in_play} of the energy that took part, {attached} of the largest that attached parts stored"


def detached_notes_of(f: Any) -> list[str]:
    """Return a warning if a detached part of a result is faster than the largest gust.

    Downward velocity does not count, since it comes from the fall.
    """
    if "detached" not in f:
        return []
    parts = f["detached"]
    velocity, gust = np.array(parts["velocity"]), float(parts["largest_gust"][()])
    velocity[:, 2] = np.maximum(velocity[:, 2], 0.0)
    speed = lengths(velocity)
    over = np.flatnonzero(speed > gust)  # empty if the gust is nan (not known)
    if not len(over):
        return []
    k = over[0]
    return [
        f"warning: dynamics: from t = {parts['time'][k]:.4g} s the centre of mass of a detached part "
        f"({parts['mass'][k]:.4g} kg, node {parts['node_id'][k]} in it) is faster than the largest gust "
        f"({speed[k]:.4g} m/s, {gust:.4g} m/s), its fall left aside. No wind carries a part that fast, so "
        "detached parts do not move as real ones do. Use results of attached parts alone, and [wind] "
        'after_fracture = "detached" if the job has another value'
    ]


def displacement_notes(equilibria: list[tuple[str, float, int]], x: np.ndarray) -> list[str]:
    """Return a note if a node moved by more than FAR of the net's size in any equilibrium under static load.

    equilibria : description of each equilibrium, its largest displacement [m], the id of that node
    x : (n, 3) [m], position from which displacements count
    """
    size = float(np.ptp(x, axis=0).max())
    far = [equilibrium for equilibrium in equilibria if equilibrium[1] > FAR * size]
    if not far:
        return []
    words, distance, node = max(far, key=lambda equilibrium: equilibrium[1])
    share = f" (and so in {len(far)} of {len(equilibria)} equilibria)" if len(equilibria) > 1 else ""
    return [
        f"note: {words}: node {node} moved by {mm(distance)}, by more than a fifth of the net's largest "
        f"dimension, {size:.4g} m{share}. Check its shape, the units of loads, the prestress and the supports"
    ]


def force_balance_warnings(equilibria: list[tuple[str, float]]) -> list[str]:
    """Return a warning if reactions do not balance the loads in any equilibrium.

    equilibria : description of each equilibrium, and `unexplained` of its `statics.reactions.Balance`
    """
    unbalanced = [equilibrium for equilibrium in equilibria if equilibrium[1] > 0.0]
    if not unbalanced:
        return []
    words, share = max(unbalanced, key=lambda equilibrium: equilibrium[1])
    also = f" (and {len(unbalanced) - 1} other equilibria)" if len(unbalanced) > 1 else ""
    return [
        f"warning: {words}{also}: loads, reactions and residual forces are out of balance by {share:.2g} of "
        "the sum of the reactions, more than the tolerance explains. Reactions and tensions may be wrong. Do "
        "not use them, and report the job as a fault of netfall."
    ]


def limit_point_warning(what: str, at: str, node: int | None, jump: float) -> str:
    """Return a warning of a limit point on the path to an equilibrium.

    node : the id of the node that jumps, None if none does; jump : [m]
    """
    if node is None:
        fact = f"no stable equilibrium was found that follows steadily beyond {at}"
    else:
        fact = f"the net snaps through at {at}: node {node} jumps by {mm(jump)}"
    return (
        f"warning: {what}: {fact}. The state found lies beyond this limit load; the net would reach it in "
        "motion, if at all. Keep below it, or brace what is compressed"
    )


def limit_point_warnings_of(f: Any) -> list[str]:
    """Return the warnings of limit points on the paths to the equilibria of a result."""
    return [
        f"warning: {states.group_title(f, place)}: a limit point was passed at load factor "
        f"{f[place].attrs[LIMIT_ATTRIBUTE]:.4g}. The state found lies beyond this limit load"
        for place in states.equilibrium_groups(f)
        if LIMIT_ATTRIBUTE in f[place].attrs
    ]


LIMIT_ATTRIBUTE = "limit_load_factor"  # attribute of the group of an equilibrium


def torsion_warnings(equilibria: list[tuple[str, tuple[float, int]]], node_id: np.ndarray) -> list[str]:
    """Return a warning for the equilibrium with the largest torsion in a bending chain.

    equilibria : description of each equilibrium, and the result of `statics.at_limit.largest_torsion`
    """
    above = [equilibrium for equilibrium in equilibria if equilibrium[1][0] > MAX_TORSION_SHARE]
    if not above:
        return []
    what, (share, p) = max(above, key=lambda equilibrium: equilibrium[1][0])
    others = (
        f" (more than {MAX_TORSION_SHARE:.0%} in {len(above)} of {len(equilibria)} equilibria)"
        if len(equilibria) > 1
        else ""
    )
    return [
        f"warning: {what}: the curved bending chain at node {node_id[p]} bends out of its plane: its "
        f"torsion, {share:.0%} of the largest bending moment{others}, is not modelled. Across its plane it "
        "bends as a straight chain of the same length. Support it across, or compute it as a frame with "
        "torsion"
    ]


def rounding_warnings(equilibria: list[tuple[str, float, float]], tolerance: float) -> list[str]:
    """Return a warning for the equilibrium with the largest error above the tolerance.

    equilibria : description of each equilibrium, its estimated error, the smallest error that rounding allows
    """
    if not equilibria:
        return []
    what, error, least = max(equilibria, key=lambda equilibrium: equilibrium[1])
    remedy = (
        f"Set tolerance to {2.0 * least:.0e} or more"
        if error <= 2.0 * least
        else "Compare with more load steps"
    )
    return [
        f"warning: {what}: estimated error {error:.1e} ([load] tolerance = {tolerance:g}; rounded "
        f"coordinates allow {least:.1e} here). {remedy}"
    ]


def slip_end_notes(equilibria: list[tuple[str, tuple[int, ...]]], element_id: np.ndarray) -> list[str]:
    """Return notes on equilibria in which cables slipped as far as the model allows.

    equilibria : description of each equilibrium, and the rows of the shortened elements
    """
    return [
        f"note: {what}: cables slipped until a fifth of the free segments with "
        f"{counted('element', element_id[list(rows)])} was left, where "
        "their ends stop them; "
        "clamps of more resistance or saddles of more friction hold them before"
        for what, rows in equilibria
        if rows
    ]


INSTABILITY_TEXT = "the tangent stiffness is not positive definite, compressed bars buckle"


def displacement_notes_of(f: Any) -> list[str]:
    """Return the notes of `displacement_notes` for the equilibria of a result."""
    x, node_id, displacements = states.start_position(f), f["net/node_id"][:], []
    for equilibrium in [
        state for state in list(states.equilibria(f))[1:] if not state.name.startswith("stage ")
    ]:
        displacement = lengths(equilibrium.position() - x)
        displacements.append((equilibrium.name, float(displacement.max()), node_id[displacement.argmax()]))
    return displacement_notes(displacements, x)


AT_LIMIT = {  # attribute of an equilibrium: its meaning for the elements listed in it
    "over_strength": "beyond the strength, which breaks nothing here",
    "buckled": "at Euler's load: buckled, and a bar that is not quite straight carries less",
    "beyond_euler": "compressed beyond Euler's load, which buckles none without buckling = true",
    "yielding": "at the yield force",
    "yielded": "yielded by its end; where many yield for long, their plastic strains may be off by some per "
    "cent: compare with a run of a quarter of the step (a smaller [dynamics] safety or time_step)",
}


def limit_notes(what: str, labels: dict[str, Any]) -> list[str]:
    """Return notes on elements at a limit in an equilibrium; labels : its attributes with element ids."""
    listed = [(np.asarray(labels[name]), words) for name, words in AT_LIMIT.items() if name in labels]
    return [
        f"note: {what}: {'at least ' * (len(ids) == MOST_MARKED)}{counted('element', ids)} {words}"
        for ids, words in listed
    ]


def limit_notes_of(f: Any) -> list[str]:
    """Return the notes of `limit_notes` for the equilibria and the dynamic stage of a result."""
    notes = [
        note
        for place in states.equilibrium_groups(f)
        for note in limit_notes(states.group_title(f, place), f[place].attrs)
    ]
    return notes + (dynamic_limit_notes_of(f) if "history" in f else [])


def dynamic_limit_notes_of(f: Any) -> list[str]:
    """Return notes on elements that buckled, exceeded the Euler load, or yielded in the dynamic stage."""
    compression, caps = -f["envelope/tension_min"][:], states.force_caps(f)
    reached = {
        "buckled": compression >= REACHED_SHARE * caps.buckling,
        "beyond_euler": compression > caps.straight,
    }
    labels = {
        name: f["net/element_id"][:][rows][:MOST_MARKED]
        for name, rows in (reached | {"yielded": states.yielded_elements(f)}).items()
        if rows.any()
    }
    return limit_notes(states.DYNAMIC_STAGE, labels)


def error_text(displacement: float, tension: float) -> str:
    """Return estimated relative errors of displacements and tensions as text; nan: not known."""
    known = f"to {displacement:.0e} of displacements, {tension:.0e} of tensions"
    return known if displacement == displacement else "(error not known)"
