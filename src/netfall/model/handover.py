"""What hangs on the nodes inside a cable that is lost goes to the ends of what is lost.

A node between two lost parts of one cable, which nothing else holds, carries cladding, wind, weights. They
are shared by the nodes at the two ends of the lost chain that are held, by the lever rule along its
unstressed length; so a cable leaves what it carried to the same nodes however finely it is divided. An end
that nothing holds takes none. Where lost cables cross at such a node, its share goes on along all of them:
the lever rule is that of a walk along the lost parts, which at each node takes a part with a probability of
1 / L0 and ends at the first node that is held.
"""

from dataclasses import dataclass
from heapq import heapify, heappop

import numpy as np

from netfall.parallel.subdomain import Distribution, rows_of


@dataclass(frozen=True)
class HandOver:
    """What each particle leaves to which others, by global numbers.

    particles : (k,) that hand over all that they carry, ascending
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


def hand_over(net, L0: np.ndarray, elements: np.ndarray, loose: np.ndarray, torn=()) -> HandOver:
    """What the nodes inside lost cables leave to whom.

    L0 : (m,) [m]; elements : (k,) that are lost now; loose : (n,) bool, nodes that nothing holds but these
    torn : elements that had broken before, along which nothing is handed on
    """
    ways = _ways(net, L0, elements, loose, set(torn))
    ends = _ends(ways)
    particles = np.array(sorted(ends), np.int64)
    shares = [(k, taker, share) for k, p in enumerate(particles.tolist()) for taker, share in ends[p].items()]
    source, taker, share = zip(*shares) if shares else ((), (), ())
    return HandOver(particles, np.array(source, np.int64), np.array(taker, np.int64), np.array(share, float))


def _ways(net, L0, elements: np.ndarray, loose: np.ndarray, torn: set) -> dict[int, dict[int, float]]:
    """Of each node inside a lost cable the next nodes along it that lead to one that is held: 1 / L0."""
    at = {}  # (node, cable): lost elements, and the nodes at their other ends
    for e in elements.tolist():
        a, b = net.elements[e].tolist()
        for p, other in ((a, b), (b, a)):
            if loose[p]:
                at.setdefault((p, int(net.cable[e])), []).append((e, other))
    ways = {}
    for (p, _), beside in at.items():
        if len(beside) > 1:
            way = ways.setdefault(p, {})
            for e, other in beside:
                if e not in torn:
                    way[other] = way.get(other, 0.0) + 1.0 / float(L0[e])
    return _leading(ways, loose)


def _leading(ways: dict, loose: np.ndarray) -> dict[int, dict[int, float]]:
    """Those ways that lead to a node that is held, and the nodes that have any."""
    came_from = {}
    for p, way in ways.items():
        for other in way:
            came_from.setdefault(other, []).append(p)
    due = [p for p in came_from if not loose[p]]
    leads = set(due)
    while due:
        for p in came_from.get(due.pop(), ()):
            if p not in leads:
                leads.add(p)
                due.append(p)
    there = ((p, {other: c for other, c in way.items() if other in leads}) for p, way in ways.items())
    return {p: way for p, way in there if way}


def _ends(ways: dict[int, dict[int, float]]) -> dict[int, dict[int, float]]:
    """Where walks along the ways end: for each node its shares of the held ones, which add to 1.

    Nodes are taken out one by one, those with the fewest ways first: who came to one goes where it leads.
    """
    share = {p: _scaled(way) for p, way in ways.items()}
    into = {}
    for p, way in share.items():
        for other in way:
            into.setdefault(other, set()).add(p)
    due, out = [(len(way), p) for p, way in share.items()], {}
    heapify(due)
    while due:
        _, p = heappop(due)
        out[p] = True
        for q in sorted(into.get(p, ())):
            if q in out:
                continue
            through = share[q].pop(p)
            for other, part in share[p].items():
                share[q][other] = share[q].get(other, 0.0) + through * part
                into.setdefault(other, set()).add(q)
            share[q].pop(q, None)  # back again: it sets out anew
            share[q] = _scaled(share[q])
    for p in reversed(out):
        ends = {}
        for other, part in share[p].items():
            for end, rest in share[other].items() if other in share else ((other, 1.0),):
                ends[end] = ends.get(end, 0.0) + part * rest
        share[p] = dict(sorted(ends.items()))
    return share


def _scaled(way: dict[int, float]) -> dict[int, float]:
    """Parts of a whole, in the order of their nodes."""
    total = sum(way[other] for other in sorted(way))
    return {other: way[other] / total for other in sorted(way)}
