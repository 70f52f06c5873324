"""Slip points of [[slide]] and the free segments between them. Rank 0, global order.

A cable runs through a node if exactly two elements of the group, or of the named cables, meet there. If more
meet, those with the same name in the column `cable` continue each other.

A free segment is a sequence of elements through nodes that belong only to the cable: nodes of `subdivide`,
and nodes of the table without loads, supports or other elements. Between two slip points, cable material
moves through such nodes. Each element of a segment has a constant share of the unstressed length of the
segment, the share in the given geometry. Results therefore depend on the subdivision only in second order.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import BoolArray
from netfall.geometry import messages
from netfall.geometry.cables import meeting_pairs, named_cables
from netfall.geometry.net import Net, connected_parts, elements_of_cables, elements_of_group
from netfall.geometry.zones import Zones, nodes_named
from netfall.job.derived import has_area_loads
from netfall.job.job import Job
from netfall.job.keys.entries import axes_by_name
from netfall.job.values import counted, format_list, format_value

MAX_CABLES_PER_NODE = 3  # largest number of cables that may slip over one node


@dataclass(frozen=True)
class SlidingCables:
    """Slip points, at which a cable may slip over a node, in the order of cables, and along each cable.

    node : (k,) particle; column : (k,) 0, 1, 2: number of the cable over that node
    before, after : (k,) the elements on both sides, in the direction of the cable
    friction : (k,) of a saddle; resistance : (k,) [N] slip resistance of a clamp
    cable : (k,) row of `Net.cable_names`, of the element before
    along : (m,) 1 if an element runs from start to end in the direction of its cable, otherwise -1
    segment : (m,) number of the free segment that contains an element, -1: none
    share : (m,) of the unstressed length of the segment
    place, at : (m, 2) column and particle of the slip points at the start and the end of the element's
        segment, along the cable; -1: no slip point
    """

    node: np.ndarray
    column: np.ndarray
    before: np.ndarray
    after: np.ndarray
    friction: np.ndarray
    resistance: np.ndarray
    cable: np.ndarray
    along: np.ndarray
    segment: np.ndarray
    share: np.ndarray
    place: np.ndarray
    at: np.ndarray

    @property
    def count(self) -> int:
        """Number of slip points."""
        return len(self.node)

    def sides(self, values: np.ndarray, power: int = 1) -> np.ndarray:
        """Return for each slip point the sum (k,) over both segments of values (m,) times shares.

        power : of the shares; 0: plain sums
        """
        inside = self.segment >= 0
        weighted = values[inside] * self.share[inside] ** power
        total = np.bincount(self.segment[inside], weighted)
        return total[self.segment[self.before]] + total[self.segment[self.after]]

    def at_nodes(self, values: np.ndarray, n: int) -> np.ndarray:
        """Return values (k,) of the slip points by particle and column, (n, 3); 0 without a slip point."""
        table = np.zeros((n, MAX_CABLES_PER_NODE))
        table[self.node, self.column] = values
        return table


class _ContinuingPair(NamedTuple):
    """Two elements that continue each other through a node; first < second."""

    node: int
    first: int
    second: int


def find_sliding_cables(
    job: Job, net: Net, zones: Zones, loaded: BoolArray
) -> tuple[SlidingCables | None, list[str]]:
    """Return the slip points of all entries of [[slide]], None without entries, and the errors.

    loaded : (n,) bool, nodes with nodal loads
    """
    if not job.slides:
        return None, []
    errors: list[str] = []
    pairs: dict[Any, Any] = {}
    slips: dict[Any, Any] = {}
    bare = _is_only_cable(job, net, zones, loaded)
    for number, entry in enumerate(job.slides, 1):
        rows, entry_errors = _entry_elements(net, entry)
        # the elements of the group, or of each cable
        number_of = net.cable[rows] if entry.group is None else np.zeros(len(rows), int)
        runs = [] if entry_errors else [rows[number_of == k] for k in np.unique(number_of)]
        through = [pair for run in runs for pair in _continuing_pairs(net, run)]
        pairs |= dict.fromkeys(through)
        slipping = [pair for pair in through if pair.node < net.given]
        if not slipping and not entry_errors:
            entry_errors.append(messages.NOTHING_SLIPS())
        if slipping and entry.nodes is not None:
            chosen = set(np.flatnonzero(np.isin(net.node_id, entry.nodes)).tolist())
            if missing := sorted(chosen - {pair.node for pair in slipping}):
                nodes = counted("node", net.node_id[missing])
                entry_errors.append(messages.NO_CABLE_THROUGH(nodes=nodes))
            slipping = [pair for pair in slipping if pair.node in chosen]
        else:  # nodes that only subdivide a cable are no saddles, unless there are no others
            slipping = [pair for pair in slipping if not bare[pair.node]] or slipping
        for pair in slipping:
            if pair in slips:
                node = net.node_id[pair.node]
                entry_errors.append(messages.ALREADY_SLIPS(node=node, entry=slips[pair][1]))
            slips.setdefault(pair, (entry, number))
        errors += [f"{job.path}: [[slide]] {number}: {line}" for line in entry_errors]
    errors += [f"{job.path}: [[slide]]: {line}" for line in _crowding_errors(net, pairs, slips)]
    return (None if errors else _order_along_cables(net, pairs, slips, bare)), errors


def _is_only_cable(job: Job, net: Net, zones: Zones, loaded: BoolArray) -> np.ndarray:
    """Return whether a node belongs only to the cable, (n,): cable material then moves through it."""
    bare = np.bincount(net.elements.ravel(), minlength=net.n) == 2
    extent = np.zeros((net.n, 3))  # m: largest extent of the elements at a node along each axis
    for end in range(2):
        np.maximum.at(extent, net.elements[:, end], np.abs(np.diff(net.x[net.elements], axis=1)[:, 0]))
    bare &= ~(net.held & (extent > net.tolerance)).any(1)  # a plane net may be held across its plane
    bare &= (net.mass == 0.0) & ~loaded
    bare[: net.given] &= not has_area_loads(job)  # areas are not known yet
    for stage in job.stages:
        for name in (*axes_by_name(stage.hold), *axes_by_name(stage.release), *(stage.move or ())):
            bare &= ~nodes_named(net, zones, name)
    bare[net.given :] = True  # nodes of `subdivide`, held or not
    return bare


def _crowding_errors(net: Net, pairs: dict[Any, Any], slips: dict[Any, Any]) -> Iterator[str]:
    """Yield errors: elements with two continuations, and nodes over which too many cables slip."""
    continuations = Counter((pair.node, e) for pair in pairs for e in pair[1:])
    if twice := sorted({net.element_id[e] for (_, e), count in continuations.items() if count > 1}):
        yield messages.TWO_CONTINUATIONS(elements=format_list(twice))
    crowded = [p for p, count in Counter(pair.node for pair in slips).items() if count > MAX_CABLES_PER_NODE]
    if crowded:
        nodes = counted("node", net.node_id[crowded])
        yield messages.CROWDED_NODE(nodes=nodes, most=MAX_CABLES_PER_NODE)


def _entry_elements(net: Net, entry: Any) -> tuple[np.ndarray, list[str]]:
    """Return the elements of an entry, and errors: wrong names, bars, elements that yield, unknown nodes."""
    if entry.group is None:
        name, source, (rows, errors) = "cables", "cables", elements_of_cables(net, entry.cables)
    else:
        name, source = f"group {format_value(entry.group)}", f"group = {format_value(entry.group)}"
        rows, errors = elements_of_group(net, entry.group)
    if errors:
        return rows, [f"{source}: {line}" for line in errors]
    ids = net.element_id
    bars, soft = rows[net.bar[rows]], rows[np.isfinite(net.yield_stress[rows])]
    unknown = sorted(set(entry.nodes or []) - set(net.node_id[: net.given].tolist()))
    if unknown:
        errors.append(messages.UNKNOWN_NODES(nodes=format_list(unknown)))
    if len(bars):
        errors.append(messages.BARS_SLIP(name=name, elements=counted("element", ids[bars])))
    if len(soft):
        errors.append(messages.YIELDING_SLIPS(name=name, elements=counted("element", ids[soft])))
    return rows, errors


def _continuing_pairs(net: Net, rows: np.ndarray) -> list[_ContinuingPair]:
    """Return all pairs of the elements, ascending, that continue each other through a node."""
    node, name = net.elements.ravel(), named_cables(net)
    ends = 2 * np.repeat(rows, 2) + np.tile([0, 1], len(rows))
    crowded = np.bincount(node[ends], minlength=net.n)[node[ends]] > 2
    named_ends = ends[crowded & (name[ends // 2] >= 0)]
    pairs = [*meeting_pairs(ends, node, np.zeros(net.m, int)), *meeting_pairs(named_ends, node, name)]
    return sorted(_ContinuingPair(int(node[a]), int(a) // 2, int(b) // 2) for a, b in pairs)


def _order_along_cables(
    net: Net, pairs: dict[Any, Any], slips: dict[Any, Any], bare: np.ndarray
) -> SlidingCables:
    """Build the slip points in the order along the cables; bare : (n,) of `_is_only_cable`."""
    label = connected_parts(np.array([pair[1:] for pair in pairs], np.int64), net.m)
    continuation: dict[tuple[int, int], int] = {}  # the next element after (node, element)
    for node, e, f in pairs:
        continuation[node, e], continuation[node, f] = f, e
    along, points = np.ones(net.m, np.int8), []
    for first in sorted({int(label[pair.first]) for pair in pairs}):  # the lowest row of its chain
        for before, node, after in _walk_chain(net, first, continuation, along):
            pair = _ContinuingPair(node, min(before, after), max(before, after))
            if pair in slips:
                entry = slips[pair][0]
                points.append((node, before, after, entry.friction, entry.slip_resistance, net.cable[before]))
    joined = [pair[1:] for pair in pairs if pair not in slips and bare[pair.node]]
    return _make_sliding_cables(
        net, points, along, connected_parts(np.array(joined, np.int64).reshape(-1, 2), net.m)
    )


def _walk_chain(
    net: Net, first: int, continuation: dict[Any, Any], along: np.ndarray
) -> list[tuple[int, int, int]]:
    """Return (element before, node, element after) along a chain, in the direction of its first element."""

    def go(direction: int) -> list[tuple[int, int, int]]:
        e, steps = first, []
        p = int(net.elements[e, 1 if direction > 0 else 0])
        while (p, e) in continuation:
            f = continuation[p, e]
            steps.append((e, p, f) if direction > 0 else (f, p, e))
            if f == first:
                break
            forward = int(net.elements[f, 0]) == p
            along[f] = 1 if forward == (direction > 0) else -1
            e, p = f, int(net.elements[f, 1] if forward else net.elements[f, 0])
        return steps

    steps_ahead = go(1)
    closed = bool(steps_ahead) and steps_ahead[-1][2] == first
    return steps_ahead if closed else go(-1)[::-1] + steps_ahead


def _make_sliding_cables(
    net: Net, points: list[tuple[Any, ...]], along: np.ndarray, run: np.ndarray
) -> SlidingCables:
    """Build the slip points with their columns at the nodes.

    run : (m,) label of the elements of a free segment
    """
    node, before, after, friction, resistance, cable = map(np.array, zip(*points))
    order = np.argsort(node, kind="stable")
    column = np.empty(len(node), np.int64)
    column[order] = np.arange(len(node)) - np.searchsorted(node[order], node[order])
    label = np.unique(run[np.concatenate([before, after])])
    row = np.minimum(np.searchsorted(label, run), len(label) - 1)
    segment = np.where(label[row] == run, row, -1)
    inside = segment >= 0
    length = net.lengths()
    share = np.zeros(net.m)
    share[inside] = length[inside] / np.bincount(segment[inside], length[inside])[segment[inside]]
    places = np.full((2, len(label)), -1)  # slip points at the start and the end of each segment
    places[0, segment[after]] = places[1, segment[before]] = np.arange(len(node))
    of_element = np.where(inside, places[:, segment], -1).T
    slips = of_element >= 0
    place = np.where(slips, column[of_element], -1).astype(np.int8)
    at = np.where(slips, node[of_element], -1)
    of_points = node, column, before, after, friction.astype(float), resistance.astype(float), cable
    return SlidingCables(*of_points, along, segment, share, place, at)


def keep_cables_on_one_rank(part: np.ndarray, slides: SlidingCables | None, net: Net) -> np.ndarray:
    """Return the rank (n,) of each particle, with cables that have segments of several elements on one rank.

    part : (n,) original rank. The owner of a slip point needs the axial forces of both adjacent segments.
    """
    if slides is None:
        return part
    inside = slides.segment >= 0
    count = np.bincount(slides.segment[inside])
    adjacent = np.column_stack([slides.segment[slides.before], slides.segment[slides.after]])
    cable = connected_parts(adjacent, len(count))
    tied = np.isin(cable, cable[count > 1])
    rows = net.elements[inside & tied[slides.segment]]
    label, nodes = connected_parts(rows, net.n), np.unique(rows)
    result = part.copy()
    result[nodes] = part[label[nodes]]
    return result
