"""The stages of a result for a report: where nodes are and what elements carry in each, and the envelope."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from netfall.mechanics.law import limits
from netfall.mechanics.law.limits import Caps
from netfall.mechanics.law.measures import elastic_forces, warm_length
from netfall.numerics.functions import lengths
from netfall.numerics.rotation import from_own, to_own
from netfall.results.datasets import ORDER
from netfall.results.losses import broken_at, loss_rows, lost_at

MOTION = "dynamics"  # the stage of an envelope
WITHOUT = "no_equilibrium", "undecided"  # states of what was found under less than the load
FORM = "form_finding"  # the group of the form, which has all elements
ALIKE = 1e-6  # of a tension: frames are in single precision, and the earlier stage governs


@dataclass(frozen=True)
class ShownState:
    """An equilibrium, or a moment.

    tension : gives (m,) [N]; position : gives (points, 3) [m]
    ends : (m, 2) rows of these, where elements have split off others than those of the net
    place : its group in the file; reaction : gives (n, 3) [N] on what holds the nodes, None: not in the file
    unloaded : whether no load acts
    moment : gives (m, 2) [N m] of bending at the ends of elements, None: not in the file
    slip : gives (k,) [m] at the places of /slide, likewise
    """

    name: str
    tension: Callable[[], np.ndarray]
    position: Callable[[], np.ndarray]
    ends: np.ndarray | None = None
    place: str = ""
    reaction: Callable[[], np.ndarray] | None = None
    unloaded: bool = False
    moment: Callable[[], np.ndarray] | None = None
    slip: Callable[[], np.ndarray] | None = None


def form_position(f) -> np.ndarray:
    """Nodes (n, 3) [m] in the form that was found, or as given."""
    return f["form_finding/position"][:] if "form_finding" in f else f["net/particles"][:]


def last_stage(f) -> str:
    """The group of the last stage of erection, "": there was none."""
    of_stages = [name for name in state_groups(f) if name.startswith("stages/")]
    return of_stages[-1] if of_stages else ""


def start_position(f) -> np.ndarray:
    """Nodes (n, 3) [m] where displacements count from: in the form, or after the last stage of erection."""
    last = last_stage(f)
    return form_position(f) + (f[last]["displacement"][:] if last else 0.0)


def support_angles(f) -> np.ndarray | None:
    """Angles (n,) [degrees] about z of the axes of supports; None: all stand along x, y and z."""
    return f["net/angle"][:] if "angle" in f["net"] else None


class Springs(NamedTuple):
    """Elastic supports of nodes (k,), rows of the net, out of start (n, 3) [m], where displacements begin.

    stiffness : (k, 3) [N/m]; rest : (k, 3) [m], displacement at which they carry nothing; both in axes at
        angles (k,) [degrees] about z, None: along x, y and z
    """

    nodes: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    start: np.ndarray
    angle: np.ndarray | None = None

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Forces (p, 3) [N] on the points, of which the nodes come first, at x (p, 3) [m]."""
        force = np.zeros_like(x)
        moved = to_own(x[self.nodes] - self.start[self.nodes], self.angle)
        force[self.nodes] = from_own(self.stiffness * (self.rest - moved), self.angle)
        return force


def springs_of(f) -> Springs:
    """The springs of a net; none where it has none."""
    start, none, angle = start_position(f), np.zeros((0, 3)), support_angles(f)
    if "spring" not in f["net"]:
        return Springs(np.zeros(0, int), none, none, start)
    nodes = np.flatnonzero(f["net/spring"][:].any(1))
    rest = np.broadcast_to(f["provenance/net/spring_rest"][:], start.shape)[nodes]
    angle = None if angle is None else angle[nodes]
    return Springs(nodes, f["net/spring"][:][nodes], to_own(rest, angle), start, angle)


def strain_measure(f) -> str:
    """The run's measure of strain."""
    return f["provenance"].attrs["strain"]


def warm_lengths(f) -> np.ndarray:
    """Unstressed lengths (m,) [m] at the temperature of the loads; of form finding where they have none."""
    L0 = f["net/unstressed_length"][:]
    if "load/temperature" not in f:
        return L0
    return warm_length(L0, f["net/expansion"][:], f["load/temperature"][()])


def start_tension(f) -> np.ndarray:
    """Tensions (m,) [N] where displacements count from, see `start_position`."""
    last = last_stage(f)
    return f[last]["tension"][:] if last else form_tension(f)


def form_tension(f) -> np.ndarray:
    """Tensions (m,) [N] in the form that was found, or in the net as given, before any load."""
    if "form_finding" in f:
        return f["form_finding/tension"][:]
    x, elements = f["net/particles"][:], f["net/elements"][:]
    L = lengths(x[elements[:, 1]] - x[elements[:, 0]])
    EA, L0, bar = f["net/axial_stiffness"][:], f["net/unstressed_length"][:], f["net/bar"][:].astype(bool)
    return elastic_forces(L, L0, EA, bar, strain_measure(f))


def absent(f, place: str = "") -> np.ndarray:
    """(m,) bool, elements that are not in the net: in a stage of erection, in the form none, else at last."""
    group = "" if place == FORM else place if place.startswith("stages/") else last_stage(f)
    return f[f"{group}/active"][:] == 0 if group else np.zeros(len(f["net/elements"]), bool)


def state_groups(f) -> list[str]:
    """The groups that hold equilibria besides the form, in the order in which the run found them."""
    names: list[str] = []
    f.visit(names.append)  # without opening them all
    places = [name.removesuffix("/tension") for name in names if name.endswith("/tension")]
    order = {place: f[place].attrs[ORDER] for place in places if ORDER in f[place].attrs}
    return sorted(order, key=order.get)


def equilibria(f) -> Iterator[ShownState]:
    """The form, then what `state_groups` hold."""
    x = form_position(f)
    found = "form_finding" in f
    if found or not last_stage(f):  # lengths of a net that was erected as given are not kept
        name, place = ("form", FORM) if found else ("as given", "")
        there = found and "reaction" in f[FORM]  # not in results of earlier versions
        reaction = (lambda: f[FORM]["reaction"][:]) if there else None
        yield ShownState(name, lambda: form_tension(f), lambda: x, None, place, reaction, unloaded=not there)
    for name in state_groups(f):
        yield from states_of(f, name)


def states_of(f, name: str) -> Iterator[ShownState]:
    """The equilibria of a group: of a load path one for each load increment."""
    x = form_position(f) if name.startswith("stages/") else start_position(f)
    group, words = f[name], state_words(f, name)
    failed = no_equilibrium(group)
    if "load_factor" not in group:
        factor = group.attrs["load_factor"] if failed else np.nan
        reached = f", load factor {factor:.4g}, reached of 1" if factor == factor else ""
        reached = reached or f", {group.attrs['state'].replace('_', ' ')}" * failed
        yield _state(group, words + reached, name, x, ...)
        return
    factors = group["load_factor"][:]
    for row, factor in enumerate(factors):
        more = f"load factor {factor:.4g}" if factor else "permanent loads"
        reached = ", reached of 1" if failed and row == len(factors) - 1 else ""
        yield _state(group, f"{words}, {more}{reached}", name, x, row)


def caps_of(f) -> Caps:
    """Forces (m,) [N] at which elements yield and buckle, as drawn, and beyond which bars should."""
    net, m = f["net"], len(f["net/elements"])
    drawn = net["strength"][:] if "strength" in net else 1.0
    strong = drawn * net["yield_force"][:] if "yield_force" in net else np.full(m, np.inf)
    load = net["euler_load"][:] if "euler_load" in net else np.full(m, np.nan)
    laws = (net[law][:] == 1 if law in net else None for law in ("buckling", "bending"))
    return limits.caps_of(strong, load, *laws)


def yielded_in(f) -> np.ndarray:
    """Which elements (m,) have yielded by the end of the motion."""
    if "final/plastic_strain" not in f:
        return np.zeros(len(f["net/elements"]), bool)
    return f["final/plastic_strain"][:] != 0.0


def no_equilibrium(group) -> bool:
    """Whether a group holds, at its end, what a load reached for which no equilibrium was found."""
    return group.attrs.get("state") in WITHOUT


def is_undecided(group) -> bool:
    """Whether the search for an equilibrium of a group ended before it was decided."""
    return group.attrs.get("state") == WITHOUT[1]


def not_stable(group) -> bool:
    """Whether a group holds an equilibrium in which compressed bars buckle."""
    return group.attrs.get("state") == "unstable"


def shown_name(f, state: ShownState) -> str:
    """The name of a state as pictures show it, which says where it is not stable."""
    return f"{state.name} (not stable)" if state.place and not_stable(f[state.place]) else state.name


def start_words(f) -> str:
    """What displacements count from, in words."""
    if last_stage(f):
        return "the last stage of erection"
    return "the form" if "form_finding" in f else "the net as given"


def state_words(f, name: str) -> str:
    """A group of equilibria in words: "case snow" of cases/snow."""
    case = "combination" if "factors" in f[name].attrs else "case"
    return re.sub("^stages/", "stage ", re.sub("^cases/", f"{case} ", name))


def _state(g, words: str, name: str, x: np.ndarray, row) -> ShownState:
    """A state of a group, a row of its datasets or all of them."""
    position = (lambda: g["position"][row]) if "position" in g else (lambda: x + g["displacement"][row])
    reaction = (lambda: g["reaction"][row]) if "reaction" in g else None
    others = {"moment": "bending_moment", "slip": "slip"}
    more = {key: (lambda of=of: g[of][row]) for key, of in others.items() if of in g}
    return ShownState(words, lambda: g["tension"][row], position, None, name, reaction, **more)


def final(f) -> ShownState | None:
    """The last state of the dynamic stage: the nodes, then the ends that split off, where they are now."""
    if "history" not in f:
        return None
    number = f["final/particle_id"][:]
    order = np.argsort(number, kind="stable")
    ends, n = f["net/elements"][:].copy(), len(f["net/particles"])
    new = f["events/new_particle"][:]
    ends[f["events/element"][:][new >= 0], (new[new >= 0] - n) % 2] = new[new >= 0]
    rows = np.searchsorted(number[order], ends)
    name = f"final, t = {f['history/time'][-1]:.4g} s"
    return ShownState(name, lambda: f["final/tension"][:], lambda: f["final/position"][:][order], rows)


@dataclass
class Envelope:
    """The largest and least tension (m,) [N] of each element, by stage.

    of_most, of_least : (m,) numbers of the stages in `names`; time_most : (m,) [s], nan: not in dynamics
    slack, gone : (stages, m) bool, gone: lost or broken, and so not slack; slack_time : (m,) [s] or None
    most_used : for each stage the largest share of the resistances, and the element; -1: none has any
    high, low : (stages, m) [N], the largest and least tension of each stage
    places : their groups in the file, "": none
    """

    names: list[str]
    most: np.ndarray
    least: np.ndarray
    of_most: np.ndarray
    of_least: np.ndarray
    time_most: np.ndarray
    slack: np.ndarray
    gone: np.ndarray
    slack_time: np.ndarray | None
    most_used: list[tuple[float, int]]
    high: np.ndarray
    low: np.ndarray
    places: list[str]

    def largest(self, stages: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The largest tension (m,) [N] in some stages, (stages,) bool, and which of all has it first."""
        return _largest(np.where(stages[:, None], self.high, np.nan))

    def largest_compression(self, stages: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of compression, which is positive here."""
        return _largest(np.where(stages[:, None], -self.low, np.nan))


def _largest(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest of forces (stages, m) [N] over the stages, and the first that has it; nan: none."""
    most = np.fmax.reduce(force)
    return most, np.argmax(force >= most - ALIKE * np.abs(most), axis=0)


def envelope_of(f, resistance: np.ndarray) -> Envelope:
    """The envelope over all equilibria, losses and the dynamic stage. resistance : (m,) [N], nan: none

    A loss comes before the dynamic stage that it is part of: of equal tensions the loss governs.
    """
    out, bar = absent(f), f["net/bar"][:].astype(bool)
    nan, slack_time = np.full(len(out), np.nan), None
    stages = []  # name, group, largest and least force, time of the largest, what is gone, what has no force
    for each in equilibria(f):
        N, away = each.tension(), absent(f, each.place)
        stages.append((each.name, each.place, N, N, nan, away, away))
    stages += [(name, "", high, low, nan, gone | out, out) for name, high, low, gone in loss_rows(f)]
    if "history" in f:
        high, low, when, slack_time = (
            f[f"envelope/{name}"][:]
            for name in ("tension_max", "tension_min", "tension_max_time", "slack_time")
        )
        gone = ~np.isnan(lost_at(f)) | ~np.isnan(broken_at(f)) | out
        stages.append((MOTION, "", high, np.where(gone & (low == 0.0), np.nan, low), when, gone, out))
    names, places, *columns = map(list, zip(*stages))
    high, low, when, gone, away = map(np.array, columns)
    most, of_most = _largest(np.where(away, np.nan, high))
    least, (_, of_least) = np.fmin.reduce(np.where(away, np.nan, low)), _largest(np.where(away, np.nan, -low))
    time = np.where(np.isnan(most), np.nan, when[of_most, np.arange(len(out))])
    most, least = np.nan_to_num(most), np.nan_to_num(least)  # of what is never there
    slack = (low <= 0.0) & ~bar & ~gone
    used = [_most_used(row / resistance) for row in high]
    numbers = most, least, of_most, of_least, time, slack, gone, slack_time, used, high, low
    return Envelope(names, *numbers, places)


def _most_used(share: np.ndarray) -> tuple[float, int]:
    if np.isnan(share).all():
        return np.nan, -1
    return float(np.nanmax(share)), int(np.nanargmax(share))
