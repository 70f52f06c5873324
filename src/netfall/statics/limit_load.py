"""Limit criteria of a net under load, and the search for the limit load factor between trials.

An element that can break reaches its limit at its fracture strain. A net that yields reaches its limit when
displacements become unbounded. The criterion is that an element is twice as long and nodes have moved by the
width of the net. Strain alone is not a criterion, because ideal plastic strain localises in few elements,
more so in finer nets.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums
from netfall.physics.elements import nodal_stiffness
from netfall.physics.state import State
from netfall.physics.supports import project_on_guides

# strain of yielding elements at the limit [-], if the fracture strain is not larger: a cable of twice the
# length is useless
LIMIT_STRAIN = 1.0
BRACKET_WIDTH = 0.004  # relative width of the bracket of the limit load factor at the end of the search [-]
MIN_LOAD_FACTOR = 1e-3  # load factor [-], below which the load counts as not carried at all
BREAKS = "breaks"
UNBOUNDED = "yields without bound, nodes move farther than the net is wide"


class LimitUtilisation(NamedTuple):
    """Utilisation of a net: how close it is to its limit.

    most : largest strain over the limit strain; inf: displacements are unbounded, or there is no equilibrium
    elements : global numbers of the elements beyond the limit, the most strained first
    reason : why the limit is exceeded, as text; "": it is not
    """

    most: float = 0.0
    elements: tuple[int, ...] = ()
    reason: str = ""

    @property
    def is_decided(self) -> bool:
        """Return whether it is known that the limit is exceeded or not; otherwise nothing was found."""
        return self.reason in ("", BREAKS, UNBOUNDED)


NO_UTILISATION = LimitUtilisation()


class Trial(NamedTuple):
    """Result of a trial of the search for the limit: load factor, and utilisation of the net."""

    factor: float
    utilisation: LimitUtilisation

    @property
    def is_confirmed(self) -> bool:
        """Return whether the utilisation is finite, so that of an equilibrium."""
        return self.utilisation.most < np.inf


def yield_strains(state: State) -> np.ndarray:
    """Compute the strain (m,) of yielding elements over their limit strain; 0: elastic, or broken."""
    if not state.features.plastic:
        return np.zeros(state.m)
    fracture = np.where(np.isfinite(state.eps_u), state.eps_u, 0.0) if state.features.fracture else 0.0
    yields = np.isfinite(state.yield_force) & (state.broken == 0)
    return np.where(yields, state.present_element_state().eps / np.maximum(LIMIT_STRAIN, fracture), 0.0)


def unbounded_share(comm: MPI.Comm, state: State) -> float:
    """Return how close displacements are to unbounded; from 1 on they count as unbounded. Collective.

    Both criteria of the module docstring must hold, so the result is the smaller of the two.
    """
    if not state.features.plastic:
        return 0.0
    start = state.x_start
    displacements = lengths(state.x - start)
    local_bounds = [*start.max(0, initial=-np.inf), *(-start).max(0, initial=-np.inf)]
    maxima = np.array([*local_bounds, displacements.max(initial=0.0), yield_strains(state).max(initial=0.0)])
    comm.Allreduce(MPI.IN_PLACE, maxima, MPI.MAX)
    return float(min(maxima[7], maxima[6] / (maxima[:3] + maxima[3:6]).max()))


def is_unbounded(
    comm: MPI.Comm,
    state: State,
    load: np.ndarray,
    held: np.ndarray,
    fields: tuple[FloatArray, FloatArray],
    residual: float,
) -> bool:
    """Return whether displacements are unbounded and no equilibrium exists to return to. Collective.

    load : (n, 3) [N]; held : (n,) of particles at springs and joints
    fields : displacements (k, n, 3) of any size, along which the net continues to move
    residual : largest [N]

    In any equilibrium the elements absorb the work of the load along a displacement field. They absorb at
    most their largest forces times the relative displacement of their ends (upper bound theorem). If the load
    does more work along one of the fields, with held particles fixed, there is no equilibrium. An element
    that never yields is taken to carry a strain of 1. The result is also true if the net is in equilibrium
    under nearly that load.
    """
    excess = unbounded_share(comm, state)
    if excess <= 1.0:
        return False
    largest = comm.allreduce(float(np.abs(load).max(initial=0.0, where=state.free != 0)), MPI.MAX)
    if residual <= BRACKET_WIDTH * largest:
        return True
    moves, limit = (state.free != 0) & ~held[:, None], np.minimum(state.yield_force, state.EA)
    terms, owned = [], slice(state.n_owned)
    for field in fields:
        u, absorbed = np.where(moves, field, 0.0), np.zeros(len(moves))
        if state.turned is not None:
            project_on_guides(state.turned, u)
        elongations = lengths(u[state.ends[:, 1]] - u[state.ends[:, 0]])
        nodal_stiffness(state.ends, 0.5 * limit * elongations, absorbed)  # half at either end
        terms += [(load * u)[owned], absorbed[owned]]
    sums = exact_sums(comm, *terms)
    return any(work > capacity for work, capacity in zip(sums[::2], sums[1::2]))


def limit_utilisation_of(
    comm: MPI.Comm, distribution: Distribution, state: State, breaks: bool
) -> LimitUtilisation:
    """Return the utilisation of a state, the same on every rank. Collective.

    breaks : whether an element fails at its fracture strain
    """
    excess, strain = unbounded_share(comm, state), np.zeros(state.m)
    if breaks and state.features.fracture:
        eps = state.present_element_state().eps
        strain = np.where(state.broken == 0, eps / state.eps_u, 0.0)
        if state.features.crushing:
            strain = np.where(state.broken == 0, np.maximum(strain, eps / state.eps_c), strain)
    largest = comm.allreduce(float(strain.max(initial=0.0)), MPI.MAX)
    reason = BREAKS if largest > 1.0 else UNBOUNDED if excess > 1.0 else ""
    if reason == UNBOUNDED:
        strain = yield_strains(state)
    subdomain = distribution.subdomain
    is_over = (strain > (1.0 if reason else np.inf)) & subdomain.element_owned
    gathered = comm.allgather((np.round(strain[is_over], 3), subdomain.element_gid[is_over]))
    strains, elements = (np.concatenate(values) for values in zip(*gathered))
    order = np.lexsort((elements, -strains))  # elements of equal strain by number
    return LimitUtilisation(max(largest, excess), tuple(elements[order].tolist()), reason)


def search_limit(
    trial: Callable[[float], Trial],
    low: Trial,
    high: Trial,
    report: Callable[[float, float], None],
) -> tuple[Trial, Trial]:
    """Return the trials below and above the limit load factor, no more than `BRACKET_WIDTH` apart.

    trial(factor) : solves a trial, from the state of the largest load carried so far
    low, high : trials below and above the limit
    report(low, high) : receives the bracket of the factor before each trial

    If `high` was unbounded far from equilibrium, it is tried again from nearby. So the last `low` may
    carry the whole load.
    """
    first_high, is_confirmed, repeats = high, high.is_confirmed, 0
    while high.factor > MIN_LOAD_FACTOR and low.factor < 1.0:
        is_narrow = high.factor - low.factor <= BRACKET_WIDTH * high.factor
        if is_narrow and is_confirmed:
            break
        report(low.factor, high.factor)
        result = trial(high.factor if is_narrow else _next_trial(low, high, repeats))
        if result.utilisation.reason:
            is_confirmed = is_narrow or result.is_confirmed
            high, repeats = result, min(repeats, 0) - 1
        elif is_narrow:  # the load is carried after all
            low, high, is_confirmed, repeats = result, first_high, first_high.is_confirmed, 0
        else:
            low, repeats = result, max(repeats, 0) + 1
    return low, high


def _next_trial(low: Trial, high: Trial, repeats: int) -> float:
    """Return the next trial between two, by regula falsi, half of `BRACKET_WIDTH` or more inside the two.

    repeats : how often the high end has stayed; less than 0: the low end

    The Illinois rule halves the residual of an end that stays, so the search approaches the limit from both
    sides. A utilisation far above 1 says little on the factor, except in proportion from the unloaded net.
    """
    reserve, excess = max(1.0 - low.utilisation.most, 0.0), high.utilisation.most - 1.0
    if low.factor > 0.0 or excess == np.inf:
        excess = min(excess, 1.0)
    margin = 0.5 * BRACKET_WIDTH * high.factor / (high.factor - low.factor)
    reserve, excess = reserve * 0.5 ** max(-repeats - 1, 0), excess * 0.5 ** max(repeats - 1, 0)
    share = min(max(reserve / (reserve + excess), margin), 1.0 - margin)
    return low.factor + share * (high.factor - low.factor)
