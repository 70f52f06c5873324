"""Member removals of [[remove]]: elements and particles removed at each step, and load redistribution.

A node inside a removed cable may have no other element or support, and yet carry cladding, wind and weights.
These are redistributed to the two ends of the removed part of the cable, in inverse proportion to their
distance along the unstressed cable. The shares therefore do not depend on the subdivision of the cable. An
end that is not held receives no share. If it lies inside another removed cable, the ends of that cable
receive the share. If removed cables cross at a node, the ends of all of them receive shares by the same rule.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, rows_of
from netfall.core.errors import raise_errors
from netfall.geometry.net import Net, connected_parts, elements_of_cables, elements_of_group, part_contains
from netfall.geometry.turned import reaction_axes
from netfall.job.derived import has_growing_pressure, load_steps, moves_supports
from netfall.job.job import Job
from netfall.job.keys.entries import REMOVED_MEMBER_KEYS
from netfall.job.values import MOST_NAMED, counted, format_list, format_value
from netfall.loads import messages


@dataclass(frozen=True)
class Redistribution:
    """Transfer of loads from particles to others, in global numbers.

    particles : (k,) that lose all their loads, ascending
    source : (s,) rows of these; receiver : (s,) particles; share : (s,), the shares of one source add to 1
    """

    particles: np.ndarray
    source: np.ndarray
    receiver: np.ndarray
    share: np.ndarray

    def move(self, values: np.ndarray, gid: np.ndarray, given: np.ndarray | None = None) -> None:
        """Move values from removed particles to receivers, in place.

        values : (rows, ...), of the particles gid (rows,)
        given : (k, ...) values of `particles`, if this rank lacks some of their rows
        """
        leaving = rows_of(gid, self.particles)
        given = values[leaving] if given is None else given
        row = rows_of(gid, self.receiver)
        local = np.flatnonzero(row >= 0)
        share = self.share[local].reshape(-1, *[1] * (values.ndim - 1))
        np.add.at(values, row[local], (share * given[self.source[local]]).astype(values.dtype))
        values[leaving[leaving >= 0]] = 0.0


def redistribute(
    net: Net, L0: np.ndarray, elements: np.ndarray, loose: np.ndarray, torn: Iterable[int] = ()
) -> Redistribution:
    """Return the redistribution of the loads of nodes inside removed cables.

    L0 : (m,) [m]; elements : (k,) removed now; loose : (n,) bool, nodes without other elements or supports
    torn : elements that broke before, along which no load is passed on
    """
    ends = _ends_of_cables(net, L0, elements, loose, set(torn))
    shares = {p: _shares(p, ends, loose, {p}) for p in sorted(ends)}
    particles = [p for p in shares if shares[p]]
    rows = [
        (k, receiver, share) for k, p in enumerate(particles) for receiver, share in sorted(shares[p].items())
    ]
    source, receiver, share = np.array(rows, float).reshape(-1, 3).T.copy()
    return Redistribution(np.array(particles, np.int64), source.astype(int), receiver.astype(int), share)


def _ends_of_cables(
    net: Net, L0: FloatArray, elements: np.ndarray, loose: np.ndarray, torn: set[Any]
) -> dict[Any, Any]:
    """Return, for each node inside a removed cable, the ends of the removed part with 1 / distance [1/m]."""
    # by (loose node, cable): removed elements and the node at the other end of each
    neighbours: dict[Any, Any] = {}
    for e in elements.tolist():
        a, b = net.elements[e].tolist()
        for p, other in ((a, b), (b, a)):
            if loose[p]:
                neighbours.setdefault((p, int(net.cable[e])), []).append((e, other))
    ends: dict[Any, Any] = {}
    done: set[Any] = set()
    for (p, cable), pair in neighbours.items():
        if len(pair) != 2 or (p, cable) in done:
            continue
        walks = [_walk(neighbours, cable, p, step, L0, torn) for step in pair]
        # nodes with their positions along the cable [m]
        path = [*((q, -s) for q, s in reversed(walks[0])), (p, 0.0), *walks[1]]
        for q, position in path:
            if len(neighbours.get((q, cable), ())) != 2:
                continue
            done.add((q, cable))
            of_node = ends.setdefault(q, {})
            for end, end_position in (path[0], path[-1]):
                if len(neighbours.get((end, cable), ())) != 2:
                    of_node[end] = of_node.get(end, 0.0) + 1.0 / abs(end_position - position)
    return ends


def _walk(
    neighbours: dict[Any, Any], cable: int, start: int, step: tuple[Any, ...], L0: Any, torn: set[Any]
) -> list[tuple[int, float]]:
    """Return the nodes after a node along a removed cable, up to its end, with their distances [m].

    step : the first element, and the node at its other end. The walk ends before a torn element.
    """
    nodes, distance, (e, node) = [], 0.0, step
    while e not in torn and node != start:
        distance += float(L0[e])
        nodes.append((node, distance))
        pair = neighbours.get((node, cable), ())
        if len(pair) != 2:
            break
        e, node = pair[0] if pair[1][0] == e else pair[1]
    return nodes


def _shares(p: int, ends: dict[Any, Any], loose: np.ndarray, on_way: set[Any]) -> dict[int, float]:
    """Return the shares of the held nodes that receive the load of node p; their sum is 1, if any."""
    shares: dict[Any, Any] = {}
    for end, weight in ends[p].items():
        if not loose[end]:
            receivers = {end: 1.0}
        elif end in ends and end not in on_way:
            receivers = _shares(end, ends, loose, on_way | {end})
        else:
            continue
        for receiver, share in receivers.items():
            shares[receiver] = shares.get(receiver, 0.0) + weight * share
    total = sum(shares[receiver] for receiver in sorted(shares))
    return {receiver: part / total for receiver, part in shares.items()}


@dataclass(frozen=True)
class RemovalStep:
    """Members removed before one step, in global numbers.

    step : number of the step, the removal happens at x(step); entries : of [[remove]], from 0
    elements : (k,) ascending; entry : (k,) first of the entries that names each; ends : (k, 2) particles
    particles : also removed, because nothing holds them and they carry no load or pass it on
    redistribution : of the loads of these particles
    """

    step: int
    entries: tuple[int, ...]
    elements: np.ndarray
    entry: np.ndarray
    ends: np.ndarray
    particles: np.ndarray
    redistribution: Redistribution


def find_removed_elements(job: Job, net: Net) -> list[np.ndarray]:
    """Return the rows of the elements that each entry of [[remove]] names. Raises InputError."""
    errors, named = [], []
    by_name: dict[str, Callable[..., Any]] = {
        "elements": _elements_by_id,
        "group": elements_of_group,
        "cables": elements_of_cables,
    }
    for number, entry in enumerate(job.removes, 1):
        key = next(key for key in REMOVED_MEMBER_KEYS if getattr(entry, key) is not None)
        rows, problems = by_name[key](net, getattr(entry, key))
        if not problems and net.bending is not None and net.bending[rows].any():
            bars = counted("bar", net.element_id[rows[net.bending[rows]]])
            problems = [messages.BENDING_BARS_REMOVED(bars=bars)]
        value = f" = {format_value(entry.group)}" if key == "group" else ""  # messages name ids and cables
        label = f"{job.path}: [[remove]] {number}: {key}{value}"
        errors += [f"{label}: {problem}" for problem in problems[:MOST_NAMED]]
        named.append(rows)
    raise_errors(errors)
    return named


def _elements_by_id(net: Net, wanted_ids: list[int]) -> tuple[np.ndarray, list[str]]:
    """Return the rows of elements by their ids, and the errors."""
    ids, unknown = net.element_id, sorted(set(wanted_ids) - set(net.element_id.tolist()))
    problem = messages.UNKNOWN_ELEMENTS(ids=format_list(unknown), first=ids.min(), last=ids.max())
    return np.flatnonzero(np.isin(ids, wanted_ids)), [problem] if unknown else []


def absent_member_notes(job: Job, net: Net) -> Iterator[str]:
    """Yield notes on removals of elements that are absent by then; net : after the last stage of erection."""
    lost, is_removed, causes = find_removed_elements(job, net), np.zeros(net.m, bool), {}
    for k in sorted(range(len(lost)), key=lambda k: job.removes[k].time):
        rows = lost[k]
        causes["a stage of erection"] = rows[~net.is_there[rows]]
        causes["an earlier removal"] = rows[net.is_there[rows] & is_removed[rows]]
        for cause, absent in causes.items():
            if len(ids := net.element_id[absent]):
                yield messages.ALREADY_ABSENT(number=k + 1, elements=counted("element", ids), cause=cause)
        is_removed[rows] = True


def superposed_excitation_notes(job: Job, varies: bool) -> Iterator[str]:
    """Yield notes on causes other than the removal that contribute to dynamic factors.

    varies : whether the wind has gusts
    """
    if job.removes and varies:
        key = "surface_drag" if job.wind.turbulence_intensity is None else "turbulence_intensity"
        table = job.wind.file or job.wind.pressures
        remedy = f"replace {table} by a table that stays at its mean" if table else f"set [wind] {key} = 0"
        yield messages.GUSTS_WITH_REMOVAL(remedy=remedy)
    if job.removes and job.wind and job.wind.onset == "sudden":
        loads = "the wind acts" if load_steps(job) else "all loads act"
        yield messages.SUDDEN_WIND_WITH_REMOVAL(loads=loads)
    if job.removes and moves_supports(job):
        yield messages.MOTION_WITH_REMOVAL()
    first = min((entry.time for entry in job.removes), default=np.inf)
    if has_growing_pressure(job) and first < job.load.ramp:
        yield messages.RAMP_WITH_REMOVAL(time=first, ramp=job.load.ramp)


def make_removals(job: Job, model: Any, schedule: Any) -> list[RemovalStep]:
    """Return the removals of the dynamic stage, step by step, up to its end. Rank 0.

    model : `model.Model`; schedule : `schedule.Schedule`. An element is removed once, by the first entry.
    """
    last = schedule.steps - schedule.stride  # for a removal within the last step
    end, times = job.dynamics.duration, [entry.time for entry in job.removes]
    steps = [min(schedule.step_at(time), last) if time < end else schedule.steps for time in times]
    present = model.net.is_there
    removals = []
    for step in sorted(s for s in set(steps) if s < schedule.steps):
        entries = tuple(k for k, s in enumerate(steps) if s == step)
        entry = np.full(model.net.m, -1)
        for k in reversed(entries):
            entry[model.layout.lost[k]] = k
        elements = np.flatnonzero((entry >= 0) & present)
        if not len(elements):  # an earlier entry removed all of them
            continue
        present[elements] = False
        particles, redistribution = particles_removed_with(model, elements, present)
        ends = model.net.elements[elements]
        removals.append(
            RemovalStep(step, entries, elements, entry[elements], ends, particles, redistribution)
        )
    return removals


def particles_removed_with(
    model: Any, elements: np.ndarray, there: np.ndarray, torn: Iterable[int] = ()
) -> tuple[np.ndarray, Redistribution]:
    """Return the particles that only the removed elements (k,) hold, and the redistribution of their loads.

    Particles inside a removed cable pass on all their loads. Others are removed only if they have no load.
    there : (m,) bool, elements that remain; torn : as in `redistribute`
    """
    net = model.net
    held = (np.bincount(net.elements[there].ravel(), minlength=net.n) > 0) | net.held.any(1)
    carries = (net.mass > 0) | (model.loading.carried > 0) | model.layout.loads.nodes.any(1)
    unheld = np.zeros(net.n, bool)
    unheld[net.elements[elements]] = True
    unheld &= ~held
    redistribution = redistribute(net, model.L0, elements, unheld, torn)
    return np.union1d(np.flatnonzero(unheld & ~carries), redistribution.particles), redistribution


def particles_removed_after_breaks(
    model: Any, removals: list[RemovalStep], k: int, torn: Any
) -> tuple[np.ndarray, Redistribution]:
    """Return `particles_removed_with` for removal k, before which the elements `torn` broke. Rank 0."""
    present = model.net.is_there
    for removed in removals[: k + 1]:
        present[removed.elements] = False
    return particles_removed_with(model, removals[k].elements, present, torn)


def is_unsupported(net: Net, there: np.ndarray, load: np.ndarray, gone: np.ndarray) -> bool:
    """Return whether a force acts on a part of the net along an axis that none of its supports holds.

    Such a part has no equilibrium. there : (m,) bool, elements that remain; load : (n, 3) [N]
    gone : (n,) bool, removed particles
    """
    label = connected_parts(net.elements[there], net.n)
    supported = np.column_stack([part_contains(label, held) for held in reaction_axes(net).T])
    return bool(((load != 0.0) & ~gone[:, None] & ~supported).any())
