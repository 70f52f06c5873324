"""Stages of a result for reports and plots: positions and tensions of each, and the envelope over all."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from netfall.core.functions import from_rotated_axes, lengths, to_rotated_axes
from netfall.core.messages import mm
from netfall.geometry.net import GRAVITY
from netfall.physics.law import measures
from netfall.physics.law.measures import ForceLimits, elastic_forces, heated_length
from netfall.results.datasets import NO_EQUILIBRIUM, ORDER_ATTRIBUTE, UNDECIDED, UNSTABLE
from netfall.results.removals import (
    REMOVAL,
    fracture_times,
    removal_lines,
    removal_stages,
    removal_times,
    removals_by_time,
)

DYNAMIC_STAGE = "dynamics"  # name of the dynamic stage in an envelope
# states of an equilibrium group that did not reach the full load
FAILED_STATES = NO_EQUILIBRIUM, UNDECIDED
MOST_MARKED = 4096  # elements listed in an attribute of an equilibrium: HDF5 limits an attribute to 64 kB
PERMANENT = "permanent"  # group of the permanent state, if there are static cases
LIMIT_POINT = "limit_load_factor"  # attribute of a group if the load path passes a limit point
FORM_GROUP = "form_finding"  # group of the form, in which all elements are present
TENSION_TOLERANCE = 1e-6  # relative difference of tensions that count as equal: frames have single precision


@dataclass(frozen=True)
class StateView:
    """An equilibrium, or the state at one time.

    tension : returns (m,) [N]; position : returns (points, 3) [m]
    ends : (m, 2) rows of the points at the ends of the elements, None: those of the net (no fragment ends)
    place : its group in the file
    unloaded : whether no load acts
    live : share of the loads other than the permanent ones that acts
    read : returns another dataset of its group by name, None: not in the file
    """

    name: str
    tension: Callable[[], np.ndarray]
    position: Callable[[], np.ndarray]
    ends: np.ndarray | None = None
    place: str = ""
    unloaded: bool = False
    live: float = 1.0
    read: Callable[[str], np.ndarray | None] = lambda name: None


def form_position(f: Any) -> np.ndarray:
    """Return the nodes (n, 3) [m] in the form-found geometry, or as given."""
    return f["form_finding/position"][:] if "form_finding" in f else f["net/particles"][:]


def last_stage(f: Any) -> str:
    """Return the group of the last stage of erection, "" if there was none."""
    places = equilibrium_groups(f) if "stages" in f else []
    return next((place for place in reversed(places) if place.startswith("stages/")), "")


def start_position(f: Any) -> np.ndarray:
    """Return the nodes (n, 3) [m] to which displacements refer.

    They are in the geometry after the last stage of erection, or in the form without erection.
    """
    last = last_stage(f)
    return form_position(f) + (f[last]["displacement"][:] if last else 0.0)


def modes_equilibrium(f: Any) -> tuple[np.ndarray, str]:
    """Return the positions (n, 3) [m] of the equilibrium to which the modes refer, and its name."""
    x = start_position(f)
    if "initial_state" in f:
        return f["initial_state/position"][:], "in the initial state"
    if "statics" in f:  # without wind, modes refer to the end of the static steps
        return x + f["statics/displacement"][-1], "under the static loads"
    return x, "before any static load"


def support_angles(f: Any) -> np.ndarray | None:
    """Return the angles (n,) [degrees] of the support axes about z, None if all are along x, y and z."""
    return f["net/angle"][:] if "angle" in f["net"] else None


class Springs(NamedTuple):
    """Elastic supports at nodes (k,), which are rows of the net.

    start : (n, 3) [m], geometry without displacement; stiffness : (k, 3) [N/m]
    rest : (k, 3) [m], displacement without force; both in axes rotated by angles (k,) [degrees] about z,
    None: along x, y and z
    """

    nodes: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    start: np.ndarray
    angle: np.ndarray | None = None

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Compute the forces (p, 3) [N] on the points at x (p, 3) [m], first the nodes of the net."""
        force = np.zeros_like(x)
        displacement = to_rotated_axes(x[self.nodes] - self.start[self.nodes], self.angle)
        force[self.nodes] = from_rotated_axes(self.stiffness * (self.rest - displacement), self.angle)
        return force


def read_springs(f: Any) -> Springs:
    """Return the springs of a net; k = 0 if it has none."""
    start, angle = start_position(f), support_angles(f)
    stiffness = f["net/spring"][:] if "spring" in f["net"] else np.zeros_like(start)
    nodes = np.flatnonzero(stiffness.any(1))
    rest = np.broadcast_to(f["provenance/net/spring_rest"][:], start.shape)[nodes]
    angle = None if angle is None else angle[nodes]
    return Springs(nodes, stiffness[nodes], to_rotated_axes(rest, angle), start, angle)


def strain_measure(f: Any) -> str:
    """Return the strain measure of the run."""
    return f["provenance"].attrs["strain"]


def warm_lengths(f: Any) -> np.ndarray:
    """Return the unstressed lengths (m,) [m] at the load temperature, if one is given, or at form finding."""
    L0 = f["net/unstressed_length"][:]
    if "load/temperature" not in f:
        return L0
    return heated_length(L0, f["net/expansion"][:], f["load/temperature"][()])


def permanent_position(f: Any) -> np.ndarray | None:
    """Return the nodes (n, 3) [m] in equilibrium under the permanent loads, None if it is not in the file."""
    if PERMANENT in f:
        return start_position(f) + f[PERMANENT]["displacement"][:]
    has_steps = "statics" in f and f["statics/load_factor"][0] == 0.0
    return start_position(f) + f["statics/displacement"][0] if has_steps else None


def start_tension(f: Any) -> np.ndarray:
    """Return the tensions (m,) [N] in the geometry of `start_position`."""
    last = last_stage(f)
    return f[last]["tension"][:] if last else form_tension(f)


def form_tension(f: Any) -> np.ndarray:
    """Return the tensions (m,) [N] in the form, or in the net as given, before any load."""
    if "form_finding" in f:
        return f["form_finding/tension"][:]
    x, elements = f["net/particles"][:], f["net/elements"][:]
    L = lengths(x[elements[:, 1]] - x[elements[:, 0]])
    EA, L0, bar = f["net/axial_stiffness"][:], f["net/unstressed_length"][:], f["net/bar"][:].astype(bool)
    return elastic_forces(L, L0, EA, bar, strain_measure(f))


def absent(f: Any, place: str = "") -> np.ndarray:
    """Return which elements (m,) are absent in a stage of erection or after the last. The form has all."""
    group = "" if place == FORM_GROUP else place if place.startswith("stages/") else last_stage(f)
    return f[f"{group}/active"][:] == 0 if group else np.zeros(len(f["net/elements"]), bool)


def slack_elements(f: Any, N: np.ndarray) -> np.ndarray:
    """Return which elements (..., m) are slack cables, by their forces N (..., m) [N].

    The parts of a slack subdivided element hang from each other. So the element counts as slack if one part
    carries no more than the weight of all parts.
    """
    _, element, parts = np.unique(f["net/element_id"][:], return_inverse=True, return_counts=True)
    weight = GRAVITY * np.bincount(element, f["net/mass_per_length"][:] * f["net/unstressed_length"][:])
    least = np.full((len(parts), *N.shape[:-1]), np.inf)
    np.fmin.at(least, element, N.T)
    slack = least.T <= np.where(parts > 1, weight, 0.0)
    return np.asarray(slack[..., element] & (f["net/bar"][:] == 0))


def count_elements(f: Any, rows: np.ndarray) -> int:
    """Count the elements of which any row (m,) bool is true; a subdivided element counts as one."""
    return len(np.unique(f["net/element_id"][:][rows]))


def count_slack(f: Any, N: np.ndarray, among: np.ndarray) -> int:
    """Count the slack elements at forces N (m,) [N] among some, rows (m,) bool, as `count_elements` does."""
    return count_elements(f, slack_elements(f, N) & among)


def equilibrium_groups(f: Any) -> list[str]:
    """Return the groups of all equilibria other than the form, in the order of computation."""
    names: list[str] = []
    f.visit(names.append)  # faster than visititems, which opens each object
    places = [name.removesuffix("/tension") for name in names if name.endswith("/tension")]
    places = [place for place in places if place not in ("cases", "stages")]  # of one named "tension"
    order = {place: f[place].attrs[ORDER_ATTRIBUTE] for place in places if ORDER_ATTRIBUTE in f[place].attrs}
    return sorted(order, key=lambda place: order[place])


def equilibria(f: Any) -> Iterator[StateView]:
    """Yield the form, then the equilibria of all `equilibrium_groups`."""
    x = form_position(f)
    if FORM_GROUP in f:
        read = _reader(f[FORM_GROUP])
        yield StateView("form", lambda: form_tension(f), lambda: x, place=FORM_GROUP, read=read)
    elif not last_stage(f):  # if the given net is erected, the file lacks its first lengths
        yield StateView("as given", lambda: form_tension(f), lambda: x, unloaded=True)
    for name in equilibrium_groups(f):
        yield from group_equilibria(f, name)


def group_equilibria(f: Any, name: str) -> Iterator[StateView]:
    """Yield the equilibria of a group; a load path has one per load increment."""
    x = form_position(f) if name.startswith("stages/") else start_position(f)
    group, words = f[name], group_title(f, name)
    failed = no_equilibrium(group)
    ended = f", {group.attrs['state'].replace('_', ' ')}" if failed else ""
    if "load_factor" not in group:
        factor = group.attrs["load_factor"] if failed else np.nan
        reached = f", load factor {factor:.4g}, reached of 1" if factor == factor else ended
        yield _state(group, words + reached, name, x, ...)
        return
    factors = group["load_factor"][:]
    for row, factor in enumerate(factors):
        load = f"load factor {factor:.4g}" if factor else "permanent loads"
        reached = (", reached of 1" * failed if factor else ended) if row == len(factors) - 1 else ""
        yield _state(group, f"{words}, {load}{reached}", name, x, row)


def element_property(f: Any, name: str, default: float) -> np.ndarray:
    """Return a property (m,) of the elements in /net; default : its value if the file lacks it."""
    return f["net"][name][:] if name in f["net"] else np.full(len(f["net/elements"]), default)


def force_caps(f: Any) -> ForceLimits:
    """Return the yield and buckling forces (m,) [N] with random strengths, and Euler loads of other bars."""
    yield_force = element_property(f, "strength", 1.0) * element_property(f, "yield_force", np.inf)
    load = element_property(f, "euler_load", np.nan)
    buckling, bending = (element_property(f, law, 0) == 1 for law in ("buckling", "bending"))
    return measures.caps_of(yield_force, load, buckling, bending)


def breaking_forces(f: Any) -> np.ndarray:
    """Return the axial forces (m,) [N] at which elastic elements break, with random strengths; inf: none."""
    strain = element_property(f, "fracture_strain", np.inf)
    return f["net/axial_stiffness"][:] * strain * element_property(f, "strength", 1.0)


def yielded_elements(f: Any) -> np.ndarray:
    """Return which elements (m,) have yielded by the end of the dynamic stage."""
    if "final/plastic_strain" not in f:
        return np.zeros(len(f["net/elements"]), bool)
    return f["final/plastic_strain"][:] != 0.0


def at_limit_in_permanent_state(f: Any) -> np.ndarray:
    """Return which elements (m,) yield, buckle or pass their strength under the permanent loads.

    If more do than an attribute lists, all elements count.
    """
    attrs = f[PERMANENT].attrs if PERMANENT in f else {}
    ids = [attrs[name] for name in ("over_strength", "buckled", "yielding") if name in attrs]
    is_cut = any(len(listed) >= MOST_MARKED for listed in ids)
    return np.isin(f["net/element_id"][:], np.concatenate([[], *ids])) | is_cut


def no_equilibrium(group: Any) -> bool:
    """Return whether no equilibrium was found for the last state of a group."""
    return group.attrs.get("state") in FAILED_STATES


def is_unstable(group: Any) -> bool:
    """Return whether the equilibrium of a group is unstable, so that compressed bars buckle."""
    return group.attrs.get("state") == UNSTABLE


def passes_limit_point(f: Any, place: str) -> bool:
    """Return whether the path from the form to a group passes a limit point, where the net snaps through.

    Every path contains the targets and the errors of length. The path to a group other than a stage of
    erection also contains all stages and the permanent loads. An unstable equilibrium under the permanent
    loads implies a limit point too.
    """
    stages = [f"stages/{name}" for name in f.get("stages", ())]
    path = [FORM_GROUP, "deviation", *([place] if place in stages else [*stages, PERMANENT, place])]
    is_unstable_start = place not in stages and PERMANENT in f and is_unstable(f[PERMANENT])
    return is_unstable_start or any(group in f and LIMIT_POINT in f[group].attrs for group in path)


def state_title(f: Any, state: StateView) -> str:
    """Return the name of a state for plots, marked if the state is unstable or cannot be reached."""
    if not state.place:
        return state.name
    marks = " (not stable)" * is_unstable(f[state.place])
    return state.name + (marks or " (limit point on the path)" * passes_limit_point(f, state.place))


def start_name(f: Any) -> str:
    """Return the name of the geometry to which displacements refer."""
    if last_stage(f):
        return "the last stage of erection"
    return "the form" if "form_finding" in f else "the net as given"


def group_title(f: Any, name: str) -> str:
    """Return the name of an equilibrium group for messages: "case snow" for cases/snow."""
    titles = {"initial_state": "initial state", PERMANENT: "permanent loads"}
    titles |= {FORM_GROUP: "form finding", "deviation": "errors of length"}
    if name in titles:
        return titles[name]
    case = "combination" if "factors" in f[name].attrs else "case"
    return re.sub("^stages/", "stage ", re.sub("^cases/", f"{case} ", name))


def _state(g: Any, words: str, name: str, x: np.ndarray, row: Any) -> StateView:
    """Return a state of a group from one row of its datasets, or from all rows (row : ...)."""
    position = (lambda: g["position"][row]) if "position" in g else (lambda: x + g["displacement"][row])
    live = float(g["load_factor"][row]) if "load_factor" in g else 1.0
    return StateView(words, lambda: g["tension"][row], position, place=name, live=live, read=_reader(g, row))


def _reader(g: Any, row: Any = ...) -> Callable[[str], np.ndarray | None]:
    """Return a function that reads a row, or all rows, of a dataset of a group; None: no such dataset."""
    return lambda name: g[name][row] if name in g else None


def removal_equilibria(f: Any) -> Iterator[StateView]:
    """Yield the equilibrium after each member removal, also if none was found: all values are then nan."""
    x, g = start_position(f), f[REMOVAL]
    datasets = {name: g[f"{name}_after"] for name in ("tension", "displacement")}
    for _, entry, name in removals_by_time(g):
        yield _state(datasets, f"equilibrium after {name}", REMOVAL, x, entry)


def described_removals(f: Any) -> list[str]:
    """Describe each member removal, see `removal_lines`, and the largest displacements in its equilibrium."""
    g, node_id, texts = f[REMOVAL], f["net/node_id"][:], []
    before = f["initial_state/position"][:] - start_position(f) if "initial_state/position" in f else np.nan
    for displacement in g.get("displacement_after", ()):  # earlier versions do not write it
        words, text = ("largest displacement in that equilibrium", "by removals so far"), []
        for what, distance in zip(words, map(lengths, (displacement, displacement - before))):
            if not np.isnan(distance).all():
                text.append(f"{what} {mm(np.nanmax(distance))} (node {node_id[np.nanargmax(distance)]})")
        texts.append([", ".join(text)] if text else [])
    return removal_lines(g, f["events"], f["net/element_id"][:], texts)


def all_states(f: Any) -> Iterator[StateView]:
    """Yield the equilibria, then the last state of the dynamic stage. Fragment ends follow the nodes."""
    yield from equilibria(f)
    if "history" not in f:
        return
    number = f["final/particle_id"][:]
    order = np.argsort(number, kind="stable")
    ends, n = f["net/elements"][:].copy(), len(f["net/particles"])
    new_gid = f["events/new_particle"][:]
    ends[f["events/element"][:][new_gid >= 0], (new_gid[new_gid >= 0] - n) % 2] = new_gid[new_gid >= 0]
    rows = np.searchsorted(number[order], ends)
    name, g = f"final, t = {f['history/time'][-1]:.4g} s", f["final"]
    read = _reader({**g, "slip": f["slide/slip"][-1]} if "slide" in f else g)
    yield StateView(name, lambda: g["tension"][:], lambda: g["position"][:][order], rows, read=read)


@dataclass
class Envelope:
    """The largest and least tension (m,) [N] of each element, and the stages in which they occur.

    Tensions are nan where an element is absent.

    of_most, of_least : (m,) numbers of the stages in `names`; time_of_max : (m,) [s], nan: not in dynamics
    slack, gone : (stages, m) bool; removed or broken elements are gone, not slack; slack_time : (m,) [s]
    high, low : (stages, m) [N], the largest and least tension of each stage
    moment : (stages, m) [N m], the larger bending moment of both ends, in motion the largest; nan: none
    places : their groups in the file, "" without one
    """

    names: list[str]
    most: np.ndarray
    least: np.ndarray
    of_most: np.ndarray
    of_least: np.ndarray
    time_of_max: np.ndarray
    slack: np.ndarray
    gone: np.ndarray
    slack_time: np.ndarray | None
    high: np.ndarray
    low: np.ndarray
    moment: np.ndarray
    places: list[str]


def largest_over_stages(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest of forces (stages, m) [N] over the stages, and its first stage; nan: none."""
    most = np.fmax.reduce(force)
    return most, np.argmax(force >= most - TENSION_TOLERANCE * np.abs(most), axis=0)


def compute_envelope(
    f: Any, end_weight: Callable[[str, np.ndarray, float], np.ndarray] | None = None
) -> Envelope:
    """Compute the envelope over all equilibria, member removals and the dynamic stage.

    It excludes a form that stages of erection follow, because the structure is never in that state.
    end_weight : of `checks.ends.end_weights`, for the forces at the ends of elements; None: in their middle
    A removal precedes the dynamic stage that contains it: if tensions are equal, the removal governs.
    """
    is_absent = absent(f)
    unknown, slack_time = np.full(len(is_absent), np.nan), None
    in_motion = f["envelope/bending_moment_max"][:] if "envelope/bending_moment_max" in f else unknown
    stages = []  # name, group, largest and least force, moment, time of the largest, failed, without force
    added: list[np.ndarray] = []
    for state in equilibria(f):
        if state.place == FORM_GROUP and last_stage(f):
            continue
        N, forceless = state.tension(), absent(f, state.place)
        at_ends = None if state.unloaded else end_weight
        weight = 0.0 if at_ends is None else at_ends(state.place, state.position(), state.live)
        added.append(np.where(forceless, 0.0, weight))
        moment = unknown if (both := state.read("bending_moment")) is None else both.max(axis=1)
        stages.append((state.name, state.place, N, N, moment, unknown, forceless, forceless))
    stages += [
        (name, REMOVAL, high, low, moment, unknown, failed | is_absent, is_absent)
        for name, high, low, moment, failed in removal_stages(f)
    ]
    if "history" in f:
        high, low, when, slack_time = (
            f[f"envelope/{name}"][:]
            for name in ("tension_max", "tension_min", "tension_max_time", "slack_time")
        )
        failed = ~np.isnan(removal_times(f)) | ~np.isnan(fracture_times(f)) | is_absent
        stages.append(
            (DYNAMIC_STAGE, "", high, np.where(failed & (low == 0.0), np.nan, low), in_motion, when)
            + (failed, is_absent)
        )
    names, places, *columns = map(list, zip(*stages))
    high, low, moment, when, failed, forceless = map(np.array, columns)
    if end_weight is not None:
        of_motion = end_weight("", start_position(f), 1.0) * ~is_absent
        added += [of_motion] * (len(names) - len(added))
        high = high + added
        low = low - np.where(f["net/bar"][:] == 1, added, 0.0)
    high, low = (np.where(forceless, np.nan, N) for N in (high, low))
    most, of_most = largest_over_stages(high)
    least, of_least = np.fmin.reduce(low), largest_over_stages(-low)[1]
    time = np.where(np.isnan(most), np.nan, when[of_most, np.arange(len(is_absent))])
    slack = slack_elements(f, low) & ~failed
    return Envelope(
        names=names,
        most=most,
        least=least,
        of_most=of_most,
        of_least=of_least,
        time_of_max=time,
        slack=slack,
        gone=failed,
        slack_time=slack_time,
        high=high,
        low=low,
        moment=moment,
        places=places,
    )
