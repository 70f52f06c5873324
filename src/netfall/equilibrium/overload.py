"""How much of a load a net bears: what gives way in a state, and the largest part without that.

An element that breaks gives way at its fracture strain. What yields runs away: it has given way where it is
twice as long and nodes have moved by as much as the net is wide. Strain alone does not tell, since ideal
plastic strain gathers in few elements, the finer the net the more.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.ground.errors import DivergedError
from netfall.mechanics.elements import nodal_stiffness
from netfall.mechanics.state import State
from netfall.mechanics.supports import keep_on_guides
from netfall.numerics.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums

GIVEN_WAY = 1.0  # strain of what yields, if its fracture strain is not larger: twice as long is of no use
WITH_IT = 0.5  # of the largest strain of what yields [-]: elements strained more give way together
OF_WORK, OF_LOAD = 1.5, 2.0 / 3.0  # power of the work, or of the load, with which strains grow (jobs/bench)
FAR = 2.0  # strain over that at which something gives way, from which on they do
SHARP = 0.004  # of the share that is borne [-]: how closely it is found, and told
LEAST = 1e-3  # of a load [-]: less is none
SURELY = 5.0  # times the strain at which an element breaks: it will, also in the equilibrium that is near
BREAKS = "breaks"
RUNS_AWAY = "yields without end, nodes move farther than the net is wide"


class Strained(NamedTuple):
    """How near a net is to giving way.

    most : largest strain, a share of that at which an element gives way; inf: it ran away, or no equilibrium
    elements : global numbers of those that give way, the most strained first; reason : in words, "": none do
    is_sure : whether that is so in an equilibrium, or where there is none
    """

    most: float = 0.0
    elements: tuple[int, ...] = ()
    reason: str = ""
    is_sure: bool = True

    @property
    def is_decided(self) -> bool:
        """Whether it is known that something gives way, or that nothing does; else the search has ended."""
        return self.reason in ("", BREAKS, RUNS_AWAY)


UNSTRAINED = Strained()


class GivesWay(DivergedError):
    """Something will give way under a load, as is clear before its equilibrium is found."""

    def __init__(self, there: Strained):
        super().__init__(there.reason)
        self.there = there._replace(is_sure=False)


class Trial(NamedTuple):
    """What came of a part of a load.

    at : what was prescribed, that part or the work of the load [J]; factor : the part; there : how near the
    net then is to giving way
    """

    at: float
    factor: float
    there: Strained


NOTHING = Trial(0.0, 0.0, UNSTRAINED)


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
    if residual <= SHARP * largest:
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


def search_limit(
    trial: Callable[[float], Trial],
    low: Trial,
    high: Trial,
    power: float,
    report: Callable[[float, float], None],
) -> tuple[Trial, Trial]:
    """Return the largest part of a load that is borne, to `SHARP`, and one under which something gives way.

    trial(at) : what comes of that, on the net where the largest part borne so far has brought it
    low, high : what is borne, and what is not; power : of `Trial.at`, with which strains grow
    report(low, high) : parts of the load, before each trial

    What is not sure, or ran away far from equilibrium, is tried again from near: the last one of `low` may be
    all of the load.
    """
    whole, near, stays = high, _is_near(high), 0
    while high.factor > LEAST and low.factor < 1.0:
        narrow = high.factor - low.factor <= SHARP * high.factor
        if narrow and near:
            break
        report(low.factor, min(high.factor, 1.0))
        now = trial(high.at if narrow else _between(low, high, power, stays))
        if now.there.reason:
            near, high, stays = narrow or _is_near(now), now, min(stays, 0) - 1
        elif narrow:  # it is borne after all
            low, high, near, stays = now, whole, _is_near(whole), 0
        else:
            low, stays = now, max(stays, 0) + 1
    return low, high


def _is_near(high: Trial) -> bool:
    """Whether it is known how near the net is to giving way, and surely."""
    return high.there.is_sure and high.there.most < np.inf


def _between(low: Trial, high: Trial, power: float, stays: int) -> float:
    """Where something begins to give way between two trials: by regula falsi, half of `SHARP` within these.

    power : with which strains grow, where nothing is borne yet; stays : how often the high end has stayed;
    less than 0: the low end. An end that stays is taken to be nearer by half each time, so that the search
    comes from both sides (Illinois rule)
    """
    below, above = 1.0 - low.there.most, high.there.most - 1.0
    if low.at == 0.0 and FAR < high.there.most < np.inf:
        return high.at * high.there.most ** (-1.0 / power)
    share, inside = 0.5, 0.5 * SHARP * high.factor / (high.factor - low.factor)
    if above < np.inf:
        below, above = below * 0.5 ** max(-stays - 1, 0), above * 0.5 ** max(stays - 1, 0)
        share = min(max(below / (below + above), inside), 1.0 - inside)
    return low.at + share * (high.at - low.at)
