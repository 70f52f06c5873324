"""How much of a load a net bears: what gives way in a state, and the largest share without that.

An element that breaks gives way at its fracture strain. One that yields and has none gives way where it is
`GIVEN_WAY` longer than it was: no cable stretches so far, and a net that runs away passes any strain.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution

GIVEN_WAY = 1.0  # strain of what yields without a fracture strain
WITH_IT = 0.5  # of the largest strain of what yields so far: elements strained more give way together
SHARP = 0.004  # of the share that is borne: how closely it is found
LEAST = 1e-3  # of a load: less is none
BREAKS = "breaks"
INSIDE = 0.45, 0.05  # of `SHARP`, of the interval that is searched: no nearer to its ends
HALF = 0.5  # times: a distance whose end stays, so that the search comes from both sides (Illinois rule)
NEARLY = 2.0  # times `SHARP`: what gave way was then tried from near


class Strained(NamedTuple):
    """How near a net is to giving way.

    most : largest strain, a share of that at which an element gives way; inf: it ran away, or no equilibrium
    elements : global numbers of those that give way, the most strained first; reason : in words, "": none do
    """

    most: float = 0.0
    elements: tuple[int, ...] = ()
    reason: str = ""


UNSTRAINED = Strained()


def limits_of_yield(state: State) -> np.ndarray:
    """Strain (m,) at which what yields has given way, the fracture strain if that is more; inf: elastic."""
    yields = np.isfinite(state.yield_force) & (state.broken == 0)
    fracture = np.where(np.isfinite(state.eps_u), state.eps_u, 0.0) if state.features.fracture else 0.0
    return np.where(yields, np.maximum(GIVEN_WAY, fracture), np.inf)


def stretch_of(state: State) -> Callable[[], float]:
    """What gives the largest strain of what yields on this rank, as a share of `limits_of_yield`."""
    limits = limits_of_yield(state)
    return lambda: float((state.elements_now().eps / limits).max(initial=0.0))


def strained(comm: MPI.Comm, distribution: Distribution, state: State, breaks: bool) -> Strained:
    """How near a state is to giving way, the same on every rank. Collective.

    breaks : whether an element gives way at its fracture strain
    """
    eps, there = state.elements_now().eps, state.broken == 0
    torn = eps / state.eps_u if breaks and state.features.fracture else np.zeros(state.m)
    long = eps / limits_of_yield(state) if state.features.plastic else np.zeros(state.m)
    torn, long = np.where(there, torn, 0.0), np.where(there, long, 0.0)
    most = np.array([torn.max(initial=0.0), long.max(initial=0.0)])
    comm.Allreduce(MPI.IN_PLACE, most, MPI.MAX)
    breaking, stretched = most > 1.0
    over = torn > 1.0 if breaking else long > (WITH_IT * most[1] if stretched else np.inf)
    share = np.round(np.maximum(torn, long)[over], 3)  # alike: by number
    gid = distribution.subdomain.element_gid[over]
    found = sorted(set().union(*comm.allgather(list(zip((-share).tolist(), gid.tolist())))))
    reason = BREAKS if breaking else f"yields beyond a strain of {GIVEN_WAY:.0%}" if stretched else ""
    return Strained(float(most.max()), tuple(element for _, element in found), reason)


def largest_share(
    trial: Callable[[float], Strained], whole: Strained, report: Callable[[float, float], None]
) -> tuple[float, Strained]:
    """The largest share of a load that is borne, to `SHARP`, and what gives way beyond it.

    trial(share) : that share on the net where the largest share borne so far has brought it
    whole : what came of the whole load; report(low, high) : before each trial

    What gave way far from equilibrium is tried again from near: 1.0 if all of the load is borne after all.
    """
    low, high, at_high, near = 0.0, 1.0, whole, False
    below, above, moved = 1.0, whole.most - 1.0, ""  # how far from giving way, less where an end has stayed
    while high > LEAST and low < 1.0:
        again = high - low <= SHARP * high
        if again and near:
            break
        share = high if again else _between(low, high, below, above)
        report(low, high)
        there = trial(share)
        side = "high" if there.reason else "low"
        stayed, moved = HALF if side == moved else 1.0, side
        if there.reason:
            near = share - low <= NEARLY * SHARP * share
            high, at_high, below, above = share, there, stayed * below, there.most - 1.0
            continue
        low, below, above = share, 1.0 - there.most, stayed * above
        if again:
            high, at_high, above, near = 1.0, whole, whole.most - 1.0, False
    return low, at_high


def _between(low: float, high: float, below: float, above: float) -> float:
    """Where something begins to give way between two loads, well within these.

    By regula falsi; of what ran away no more is known than that.
    """
    share = below / (below + above) if above < np.inf else 0.5
    off = max(INSIDE[0] * SHARP * high, INSIDE[1] * (high - low))
    return min(max(low + share * (high - low), low + off), high - off)
