"""Redistribution of loads to the ends of removed cables.

A node inside a removed cable that nothing else holds carries cladding, wind, weights. They go to the two ends
of the removed part of the cable, in inverse proportion to their distance along the unstressed cable. So a
cable leaves its loads to the same nodes by the same shares, however finely it is divided. An end that nothing
holds takes no share; if it lies inside another removed cable, that one passes the share on to its own ends.
If removed cables cross at a node, the ends of all of them take a share by the same rule.
"""

from dataclasses import dataclass

import numpy as np

from netfall.parallel.subdomain import Distribution, rows_of


@dataclass(frozen=True)
class Redistribution:
    """What each particle gives to which others, by global numbers.

    particles : (k,) that give all that they carry, ascending
    source : (s,) rows of these; taker : (s,) particles; share : (s,), those of a source add to 1
    """

    particles: np.ndarray
    source: np.ndarray
    taker: np.ndarray
    share: np.ndarray

    def move(self, values: np.ndarray, gid: np.ndarray, given: np.ndarray | None = None) -> None:
        """Move what particles carry, in place. values : (rows, ...), of the particles gid (rows,)

        given : (k, ...) of `particles`, where not all of their rows are here
        """
        leaving = rows_of(gid, self.particles)
        given = values[leaving] if given is None else given
        row = rows_of(gid, self.taker)
        here = np.flatnonzero(row >= 0)
        share = self.share[here].reshape(-1, *[1] * (values.ndim - 1))
        np.add.at(values, row[here], (share * given[self.source[here]]).astype(values.dtype))
        values[leaving[leaving >= 0]] = 0.0

    def given(self, distribution: Distribution, rows: np.ndarray) -> np.ndarray:
        """What `particles` carry (k, ...), on every rank; rows : of this rank's. Collective."""
        return distribution.from_owners(self.particles, rows)


def redistribute(net, L0: np.ndarray, elements: np.ndarray, loose: np.ndarray, torn=()) -> Redistribution:
    """Return what the nodes inside removed cables give to which nodes.

    L0 : (m,) [m]; elements : (k,) that are removed now; loose : (n,) bool, nodes that nothing else holds
    torn : elements that had broken before, along which nothing is passed on
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


def _ends_of_cables(net, L0, elements: np.ndarray, loose: np.ndarray, torn: set) -> dict:
    """Return for each node inside a removed cable the ends of that part, each with 1 / distance [1/m]."""
    beside = {}  # of a loose node in a cable: its removed elements, each with the node at the other end
    for e in elements.tolist():
        a, b = net.elements[e].tolist()
        for p, other in ((a, b), (b, a)):
            if loose[p]:
                beside.setdefault((p, int(net.cable[e])), []).append((e, other))
    ends, seen = {}, set()
    for (p, cable), around in beside.items():
        if len(around) != 2 or (p, cable) in seen:
            continue
        walks = [_walk(beside, cable, p, step, L0, torn) for step in around]
        line = [*((q, -s) for q, s in reversed(walks[0])), (p, 0.0), *walks[1]]  # places along the cable [m]
        for q, at in line:
            if len(beside.get((q, cable), ())) != 2:
                continue
            seen.add((q, cable))
            of_node = ends.setdefault(q, {})
            for end, there in (line[0], line[-1]):
                if len(beside.get((end, cable), ())) != 2:
                    of_node[end] = of_node.get(end, 0.0) + 1.0 / abs(there - at)
    return ends


def _walk(beside: dict, cable: int, start: int, step: tuple, L0, torn: set) -> list[tuple[int, float]]:
    """Return the nodes that follow a node along a removed cable, up to its end, with their distances [m].

    step : the first element, and the node at its other end. The walk ends before a torn element.
    """
    found, distance, (e, node) = [], 0.0, step
    while e not in torn and node != start:
        distance += float(L0[e])
        found.append((node, distance))
        around = beside.get((node, cable), ())
        if len(around) != 2:
            break
        e, node = around[0] if around[1][0] == e else around[1]
    return found


def _shares(p: int, ends: dict, loose: np.ndarray, on_way: set) -> dict[int, float]:
    """Return the shares of the held nodes that take what node p carries; they add to 1, if there are any."""
    found = {}
    for end, weight in ends[p].items():
        if not loose[end]:
            takers = {end: 1.0}
        elif end in ends and end not in on_way:
            takers = _shares(end, ends, loose, on_way | {end})
        else:
            continue
        for taker, share in takers.items():
            found[taker] = found.get(taker, 0.0) + weight * share
    total = sum(found[taker] for taker in sorted(found))
    return {taker: part / total for taker, part in found.items()}
