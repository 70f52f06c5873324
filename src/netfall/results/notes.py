"""Warnings and notes on what in a result is doubtful."""

import numpy as np

from netfall.job.values import counted
from netfall.mechanics.law.limits import REACHED
from netfall.numerics.functions import lengths
from netfall.results import states

LARGEST_BALANCE = 1e-3  # energy balance error above which a result is doubtful, by either of its shares
TORSION = 0.05  # of the largest bending moment: a chain with more torsion than that gets a warning
MOST_MARKED = 4096  # elements of an equilibrium by each attribute of it, which may have 64 kB
FAR = 0.2  # of a net's largest dimension: a node that moves farther under static load is told


BALANCE = ("balance_error", "balance_error_attached")  # columns of /history


def balance_notes(history) -> list[str]:
    """Return a warning if the energy balance error of any row is above LARGEST_BALANCE.

    history : datasets of /history by name
    """
    time = history["time"]
    error = np.fmax(*(np.abs(history[name]) for name in BALANCE))
    off = np.flatnonzero(error > LARGEST_BALANCE)
    if not len(off):
        return []
    until = "on" if off[-1] == len(time) - 1 else f"to {time[off[-1]]:.4g} s"
    smaller = "[dynamics] safety or time_step" + (", or fragment_mass" if history["broken"][-1] else "")
    return [
        f"warning: dynamics: the energy balance is off by up to {balance_words(history)} (limit "
        f"{LARGEST_BALANCE:g}), from t = {time[off[0]]:.4g} s {until}. The step is too long for some of "
        f"what happened. Compare with a run of half the step (a smaller {smaller})"
    ]


def balance_words(history) -> str:
    """Return the largest energy balance errors in words; history : as of `balance_notes`."""
    took_part, stored = (f"{np.nanmax(np.abs(history[name]), initial=0.0):.2g}" for name in BALANCE)
    return f"{took_part} of the energy that took part, {stored} of the largest that attached parts stored"


def detached_notes_of(f) -> list[str]:
    """Return a warning if a detached part of a result is faster than the wind.

    The fall does not count: of the vertical velocity only what rises does.
    """
    if "detached" not in f:
        return []
    parts = f["detached"]
    velocity, gust = np.array(parts["velocity"]), float(parts["largest_gust"][()])
    velocity[:, 2] = np.maximum(velocity[:, 2], 0.0)
    speed = lengths(velocity)
    over = np.flatnonzero(speed > gust)  # none where the gust is not known
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


def displacement_notes(found: list[tuple[str, float, int]], x: np.ndarray) -> list[str]:
    """A note if a node moved by more than FAR of the net's size in any equilibrium under static load.

    found : what each equilibrium is, the largest displacement in it [m], the id of its node
    x : (n, 3) [m], from which displacements count
    """
    size = float(np.ptp(x, axis=0).max())
    far = [each for each in found if each[1] > FAR * size]
    if not far:
        return []
    words, moved, node = max(far, key=lambda each: each[1])
    share = f" (and so in {len(far)} of {len(found)} equilibria)" if len(found) > 1 else ""
    return [
        f"note: {words}: node {node} moved by {moved:.4g} m, by more than a fifth of the net's largest "
        f"dimension, {size:.4g} m{share}. Check its shape, the units of loads, the prestress and the supports"
    ]


def force_balance_warnings(found: list[tuple[str, float]]) -> list[str]:
    """Return a warning if reactions do not balance the loads in any equilibrium.

    found : what each equilibrium is, `unexplained` of its `record.balance.Balance`
    """
    off = [each for each in found if each[1] > 0.0]
    if not off:
        return []
    words, share = max(off, key=lambda each: each[1])
    more = f" (and {len(off) - 1} other equilibria)" if len(off) > 1 else ""
    return [
        f"warning: {words}{more}: loads, reactions and residual forces are out of balance by {share:.2g} of "
        "the sum of the reactions, more than the tolerance explains. Reactions and tensions may be wrong. Do "
        "not use them, and report the job as a fault of netfall."
    ]


def limit_point_warning(what: str, at: str, node: int | None, jump: float) -> str:
    """A warning of a limit point on the path to an equilibrium; node : that jumps, None: none does."""
    if node is None:
        fact = f"no stable equilibrium was found that follows steadily beyond {at}"
    else:
        fact = f"the net snaps through at {at}: node {node} jumps by {jump:.4g} m"
    return (
        f"warning: {what}: {fact}. The state found lies beyond this limit load; the net would reach it in "
        "motion, if at all. Keep below it, or brace what is compressed"
    )


def limit_point_warnings_of(f) -> list[str]:
    """Warnings of limit points on the paths to the equilibria of a result."""
    return [
        f"warning: {states.state_words(f, place)}: a limit point was passed at load factor "
        f"{f[place].attrs[LIMIT]:.4g}. The state found lies beyond this limit load"
        for place in states.state_groups(f)
        if LIMIT in f[place].attrs
    ]


LIMIT = "limit_load_factor"  # attribute of an equilibrium


def torsion_warnings(found: list[tuple[str, tuple[float, int]]], node_id: np.ndarray) -> list[str]:
    """A warning of the equilibrium with most torsion in a chain; found : as of `largest_torsion`."""
    above = [each for each in found if each[1][0] > TORSION]
    if not above:
        return []
    what, (share, p) = max(above, key=lambda each: each[1][0])
    others = (
        f" (more than {TORSION:.0%} in {len(above)} of {len(found)} equilibria)" if len(found) > 1 else ""
    )
    return [
        f"warning: {what}: the curved bending chain at node {node_id[p]} bends out of its plane: its "
        f"torsion, {share:.0%} of the largest bending moment{others}, is not modelled. Across its plane it "
        "bends as a straight chain of the same length. Support it across, or compute it as a frame with "
        "torsion"
    ]


def rounding_warnings(found: list[tuple[str, float, float]], tolerance: float) -> list[str]:
    """A warning of the equilibrium with the largest error above the tolerance.

    found : what each is, its estimated error, the least that rounding allows
    """
    if not found:
        return []
    what, error, least = max(found, key=lambda each: each[1])
    remedy = (
        f"Set tolerance to {2.0 * least:.0e} or more"
        if error <= 2.0 * least
        else "Compare with more load steps"
    )
    return [
        f"warning: {what}: estimated error {error:.1e} ([load] tolerance = {tolerance:g}; rounded "
        f"coordinates allow {least:.1e} here). {remedy}"
    ]


def stop_notes(found: list[tuple[str, tuple[int, ...]]], element_id: np.ndarray) -> list[str]:
    """Notes on equilibria in which ends of cables stop them; found : what each is, the rows of elements."""
    ids = lambda rows: counted("element", element_id[list(rows)])
    return [
        f"note: {what}: cables slipped until a fifth of the free segments with {ids(rows)} was left, where "
        "their ends stop them; "
        "clamps of more resistance or saddles of more friction hold them before"
        for what, rows in found
        if rows
    ]


NOT_STABLE = "the tangent stiffness is not positive definite, compressed bars buckle"


def displacement_notes_of(f) -> list[str]:
    """`displacement_notes` on the equilibria of a result."""
    x, node_id, found = states.start_position(f), f["net/node_id"][:], []
    for each in [one for one in list(states.equilibria(f))[1:] if not one.name.startswith("stage ")]:
        moved = lengths(each.position() - x)
        found.append((each.name, float(moved.max()), node_id[moved.argmax()]))
    return displacement_notes(found, x)


AT_LIMIT = {  # attributes of an equilibrium: what it means for the elements that they name
    "over_strength": "beyond the strength, which breaks nothing here",
    "buckled": "at Euler's load: buckled, and a bar that is not quite straight carries less",
    "beyond_euler": "compressed beyond Euler's load, which buckles none without buckling = true",
    "yielding": "at the yield force",
    "yielded": "yielded by its end; where many yield for long, their plastic strains may be off by some per "
    "cent: compare with a run of a quarter of the step (a smaller [dynamics] safety or time_step)",
}


def limit_notes(what: str, labels) -> list[str]:
    """Notes on elements at a limit of theirs in an equilibrium; labels : its attributes, elements by ids."""
    found = [(np.asarray(labels[name]), words) for name, words in AT_LIMIT.items() if name in labels]
    return [
        f"note: {what}: {'at least ' * (len(ids) == MOST_MARKED)}{counted('element', ids)} {words}"
        for ids, words in found
    ]


def limit_notes_of(f) -> list[str]:
    """`limit_notes` on the equilibria of a result, and on its motion."""
    notes = [
        note
        for place in states.state_groups(f)
        for note in limit_notes(states.state_words(f, place), f[place].attrs)
    ]
    return notes + (motion_notes_of(f) if "history" in f else [])


def motion_notes_of(f) -> list[str]:
    """Notes on elements that buckled in the motion of a result, bore more than Euler's load, or yielded."""
    pressed, caps = -f["envelope/tension_min"][:], states.caps_of(f)
    at = {"buckled": pressed >= REACHED * caps.buckling, "beyond_euler": pressed > caps.straight}
    labels = {
        name: f["net/element_id"][:][rows][:MOST_MARKED]
        for name, rows in (at | {"yielded": states.yielded_in(f)}).items()
        if rows.any()
    }
    return limit_notes(states.MOTION, labels)


def error_words(moved: float, tension: float) -> str:
    """Estimated errors in words, nan: not known."""
    known = f"to {moved:.0e} of displacements, {tension:.0e} of tensions"
    return known if moved == moved else "(error not known)"
