"""Redistribution of loads to the ends of removed cables.

A node inside a removed cable that nothing else holds carries cladding, wind and weights. These go to the
two ends of the removed part of the cable, in inverse proportion to their distance along the unstressed
cable. So a cable leaves its loads to the same nodes by the same shares, however finely it is divided. An
end that nothing holds takes no share. If it lies inside another removed cable, that cable passes the share
on to its own ends. If removed cables cross at a node, the ends of all of them take a share by the same
rule.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.geometry.net import Net
from netfall.parallel.subdomain import Distribution, rows_of


@dataclass(frozen=True)
class Redistribution:
    """Transfer of loads from particles to others, in global numbers.

    particles : (k,) that give all that they carry, ascending
    source : (s,) rows of these; taker : (s,) particles; share : (s,), the shares of one source add to 1
    """

    particles: np.ndarray
    source: np.ndarray
    taker: np.ndarray
    share: np.ndarray

    def move(self, values: np.ndarray, gid: np.ndarray, given: np.ndarray | None = None) -> None:
        """Move the values that particles carry, in place.

        values : (rows, ...), of the particles gid (rows,); given : (k, ...) values of `particles`, if this
        rank lacks
        some of their rows
        """
        leaving = rows_of(gid, self.particles)
        given = values[leaving] if given is None else given
        row = rows_of(gid, self.taker)
        local = np.flatnonzero(row >= 0)
        share = self.share[local].reshape(-1, *[1] * (values.ndim - 1))
        np.add.at(values, row[local], (share * given[self.source[local]]).astype(values.dtype))
        values[leaving[leaving >= 0]] = 0.0

    def given(self, distribution: Distribution, rows: np.ndarray) -> np.ndarray:
        """Return the values of `particles` (k, ...) on every rank; rows : local values. Collective."""
        return distribution.broadcast_rows(self.particles, rows)


def redistribute(
    net: Net, L0: np.ndarray, elements: np.ndarray, loose: np.ndarray, torn: Iterable[int] = ()
) -> Redistribution:
    """Return the redistribution of the loads of nodes inside removed cables.

    L0 : (m,) [m]; elements : (k,) removed now; loose : (n,) bool, nodes that nothing else holds
    torn : elements that broke before, along which nothing is passed on
    """
    ends = _ends_of_cables(net, L0, elements, loose, set(torn))
    shares = {p: _shares(p, ends, loose, {p}) for p in sorted(ends)}
    particles = [p for p in shares if shares[p]]
    rows = [(k, taker, share) for k, p in enumerate(particles) for taker, share in sorted(shares[p].items())]
    source, taker, share = zip(*rows) if rows else ((), (), ())
    return Redistribution(
        np.array(particles, np.int64),
        np.array(source, np.int64),
        np.array(taker, np.int64),
        np.array(share, float),
    )


def _ends_of_cables(
    net: Net, L0: FloatArray, elements: np.ndarray, loose: np.ndarray, torn: set[Any]
) -> dict[Any, Any]:
    """Return, for each node inside a removed cable, the ends of the removed part with 1 / distance [1/m]."""
    neighbours: dict[
        Any, Any
    ] = {}  # (loose node, cable): removed elements and the node at the other end of each
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
        path = [
            *((q, -s) for q, s in reversed(walks[0])),
            (p, 0.0),
            *walks[1],
        ]  # positions along the cable [m]
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
    """Return the shares of the held nodes that take the load of node p; they add to 1 if there are any."""
    shares: dict[Any, Any] = {}
    for end, weight in ends[p].items():
        if not loose[end]:
            takers = {end: 1.0}
        elif end in ends and end not in on_way:
            takers = _shares(end, ends, loose, on_way | {end})
        else:
            continue
        for taker, share in takers.items():
            shares[taker] = shares.get(taker, 0.0) + weight * share
    total = sum(shares[taker] for taker in sorted(shares))
    return {taker: part / total for taker, part in shares.items()}
