"""How much of a load a net bears: what gives way in a state, and the largest share without that.

An element that breaks gives way at its fracture strain. What yields runs away: it has given way where it is
twice as long and nodes have moved by as much as the net is wide. Strain alone does not tell, since ideal
plastic strain gathers in few elements, the finer the net the more.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.mechanics.elements import nodal_stiffness
from netfall.mechanics.state import State
from netfall.mechanics.supports import keep_on_guides
from netfall.numerics.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums

GIVEN_WAY = 1.0  # strain of what yields, if its fracture strain is not larger
WITH_IT = 0.5  # of the largest strain of what yields so far: elements strained more give way together
SHARP = 0.004  # of the share that is borne: how closely it is found
LEAST = 1e-3  # of a load: less is none
BREAKS = "breaks"
RUNS_AWAY = "yields without end, nodes move farther than the net is wide"
INSIDE = 0.45, 0.05  # of `SHARP`, of the interval that is searched: no nearer to its ends
HALF = 0.5  # times: a distance whose end stays, so that the search comes from both sides (Illinois rule)
NEARLY = 2.0  # times `SHARP`: what ran away was then tried from near
SURELY = 1.05  # times the strain at which something gives way: near to equilibrium


class Strained(NamedTuple):
    """How near a net is to giving way.

    most : largest strain, a share of that at which an element gives way; inf: it ran away, or no equilibrium
    elements : global numbers of those that give way, the most strained first; reason : in words, "": none do
    """

    most: float = 0.0
    elements: tuple[int, ...] = ()
    reason: str = ""

    @property
    def is_decided(self) -> bool:
        """Whether it is known that something gives way, or that nothing does; else the search has ended."""
        return self.reason in ("", BREAKS, RUNS_AWAY)


UNSTRAINED = Strained()
NOT_FOUND_AT_ONCE = Strained(np.inf, (), "no equilibrium was found")


class GivesWay(Exception):
    """Something gives way on the way to an equilibrium, to judge by states near to equilibrium.

    low, high : shares of what was missing; at low, where the net now is, it does not; at_high : `Strained`
    """

    def __init__(self, low: float, high: float, at_high: Strained):
        super().__init__(f"something {at_high.reason} at {high:.3g} of the load")
        self.low, self.high, self.at_high = low, high, at_high


def yield_strains(state: State) -> np.ndarray:
    """Strain (m,) of what yields as a share of that at which it may have given way; 0: elastic, or broken."""
    if not state.features.plastic:
        return np.zeros(state.m)
    fracture = np.where(np.isfinite(state.eps_u), state.eps_u, 0.0) if state.features.fracture else 0.0
    yields = np.isfinite(state.yield_force) & (state.broken == 0)
    return np.where(yields, state.elements_now().eps / np.maximum(GIVEN_WAY, fracture), 0.0)


def run_away(comm: MPI.Comm, state: State) -> float:
    """How far what yields has run away: from 1.0 on it has given way, see above. Collective."""
    if not state.features.plastic:
        return 0.0
    start = state.x_start
    moved = lengths(state.x - start)
    mine = [*start.max(0, initial=-np.inf), *(-start).max(0, initial=-np.inf)]
    most = np.array([*mine, moved.max(initial=0.0), yield_strains(state).max(initial=0.0)])
    comm.Allreduce(MPI.IN_PLACE, most, MPI.MAX)
    return float(min(most[7], most[6] / (most[:3] + most[3:6]).max()))


def is_lost(comm: MPI.Comm, state: State, load: np.ndarray, held: np.ndarray, ways, residual: float) -> bool:
    """Whether what yields has run away, and there is no equilibrium to come back to. Collective.

    load : (n, 3) [N]; held : (n,) of particles at springs and joints; ways : displacements (k, n, 3), of any
    size, by which the net moves on; residual : largest [N]

    In an equilibrium, wherever it is, the load does as much work along any displacements as elements take up,
    at most their largest forces times how far their ends are moved apart (the upper bound theorem). If it
    does more along one of the ways, nothing held, there is none. What never yields is taken to bear a strain
    of 1. Nor is there a way back where the net is in equilibrium under nearly that load.
    """
    away = run_away(comm, state)
    if away <= 1.0:
        return False
    largest = comm.allreduce(float(np.abs(load).max(initial=0.0, where=state.free != 0)), MPI.MAX)
    if away > SURELY and residual <= SHARP * largest:
        return True
    moves, limit = (state.free != 0) & ~held[:, None], np.minimum(state.yield_force, state.EA)
    terms, own = [], slice(state.n_owned)
    for way in ways:
        u, taken = np.where(moves, way, 0.0), np.zeros(len(moves))
        if state.turned is not None:
            keep_on_guides(state.turned, u)
        apart = lengths(u[state.ends[:, 1]] - u[state.ends[:, 0]])
        nodal_stiffness(state.ends, 0.5 * limit * apart, taken)  # half at either end
        terms += [(load * u)[own], taken[own]]
    sums = exact_sums(comm, *terms)
    return any(given > most for given, most in zip(sums[::2], sums[1::2]))


def strained(comm: MPI.Comm, distribution: Distribution, state: State, breaks: bool) -> Strained:
    """How near a state is to giving way, the same on every rank. Collective.

    breaks : whether an element gives way at its fracture strain
    """
    away, strain, least = run_away(comm, state), np.zeros(state.m), 1.0
    if breaks and state.features.fracture:
        eps = state.elements_now().eps
        strain = np.where(state.broken == 0, eps / state.eps_u, 0.0)
        if state.features.crushing:
            strain = np.where(state.broken == 0, np.maximum(strain, eps / state.eps_c), strain)
    most = comm.allreduce(float(strain.max(initial=0.0)), MPI.MAX)
    reason = BREAKS if most > 1.0 else RUNS_AWAY if away > 1.0 else ""
    if reason == RUNS_AWAY:
        strain = yield_strains(state)
        least = WITH_IT * comm.allreduce(float(strain.max(initial=0.0)), MPI.MAX)
    subdomain = distribution.subdomain
    over = (strain > (least if reason else np.inf)) & subdomain.element_owned
    parts = comm.allgather((np.round(strain[over], 3), subdomain.element_gid[over]))
    by, element = (np.concatenate(each) for each in zip(*parts))
    order = np.lexsort((element, -by))  # what is strained alike: by number
    return Strained(max(most, away), tuple(element[order].tolist()), reason)


def largest_share(
    trial: Callable[[float], Strained],
    whole: Strained,
    report: Callable[[float, float], None],
    first: tuple[float, ...] = (),
) -> tuple[float, Strained]:
    """The largest share of a load that is borne, to `SHARP`, and what gives way beyond it.

    trial(share) : that share on the net where the largest share borne so far has brought it
    whole : what came of the whole load; report(low, high) : before each trial; first : shares to begin with

    What ran away far from equilibrium is tried again from near: 1.0 if all of the load is borne after all.
    """
    ends = _Ends(0.0, 1.0, UNSTRAINED, whole, 1.0, whole.most - 1.0)
    near = whole.most < np.inf
    while ends.high > LEAST and ends.low < 1.0:
        first = tuple(share for share in first if ends.low < share < ends.high)
        again = ends.high - ends.low <= SHARP * ends.high
        if again and near:
            break
        share = first[0] if first else ends.high if again else _between(ends)
        report(ends.low, ends.high)
        there = trial(share)
        if there.reason:
            near = there.most < np.inf or share - ends.low <= NEARLY * SHARP * share
        elif share == ends.high:
            ends, near = ends._replace(high=1.0, at_high=whole, moved=""), whole.most < np.inf
        ends = _moved(ends, share, there)
    return ends.low, ends.at_high


class _Ends(NamedTuple):
    """Shares between which something begins to give way, and what came of these.

    below, above : how far these are from giving way, less where an end has stayed; slope : of that at the low
    end, from the one before; moved : which of them was found last
    """

    low: float
    high: float
    at_low: Strained
    at_high: Strained
    below: float
    above: float
    slope: float = 0.0
    moved: str = ""


def _moved(ends: _Ends, share: float, there: Strained) -> _Ends:
    """The ends with what came of a share between them."""
    if there.reason:
        stayed = HALF if ends.moved == "high" and ends.above < np.inf else 1.0
        below = stayed * ends.below
        return ends._replace(high=share, at_high=there, below=below, above=there.most - 1.0, moved="high")
    above = (HALF if ends.moved == "low" else 1.0) * ends.above
    slope, below = (there.most - ends.at_low.most) / (share - ends.low), 1.0 - there.most
    return ends._replace(low=share, at_low=there, below=below, above=above, slope=slope, moved="low")


def _between(ends: _Ends) -> float:
    """Where something begins to give way between two loads, well within these.

    By regula falsi. Where the net ran away at the high end no more is known of it than that: as the low end
    foresees, or the nearer that is to giving way the shorter the step.
    """
    low, high, below, above, wide = *ends[:2], ends.below, ends.above, ends.high - ends.low
    if above < np.inf:
        step = wide * below / (below + above)
    elif ends.moved == "low" and ends.slope > 0.0:
        step = min(below / ends.slope, HALF * wide)
    else:
        step = min(below, HALF) * wide
    off = max(INSIDE[0] * SHARP * high, INSIDE[1] * wide)
    return min(max(low + step, low + off), high - off)
