"""The two energy audits (paper Eq. 8 to 11) at a step n, without changing the state.

Work identity: the kinetic energy is what external work, less the work against internal forces and damping,
leaves; with the half-step velocities this holds to rounding at any step, and so finds bugs. Physical balance:
the same with the elements' own stored and dissipated energy instead of the work against them; it drifts with
the step and is the error that users should see. Both are told as shares of the energy that took part
(`history.energy_in_play`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from netfall.ground.apart import Entry
from netfall.ground.columns import vectors
from netfall.ground.compile import entry_for
from netfall.ground.handed import Laid, laid
from netfall.mechanics.elements import ElementState
from netfall.mechanics.fields import OTHER_WORKS
from netfall.mechanics.state import State
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import LIMBS, adding, rounded_of_all
from netfall.step.audit import Attached, Bodies, Room, Subject, observe, observe_once, observe_particles


@dataclass(frozen=True)
class Energies:
    """Energies [J] at one time, or at several. `internal` is the work done against the elements' forces.

    air, band : work of the air's damping, and against branches; support : of the ground, on what it moves;
    slip : heat of friction where cables slip, whose motion and forces are in kinetic, external and internal;
    0 where there is none
    attached : kinetic, and stored with that of the prestress, of what hangs on a support
    """

    kinetic: float
    strain: float
    plastic: float
    damping: float
    external: float
    internal: float
    air: float = 0.0
    band: float = 0.0
    support: float = 0.0
    slip: float = 0.0
    attached: float = 0.0

    @property
    def given(self) -> float:
        """Work [J] of loads and of the ground, whatever its sign."""
        return np.abs(self.external) + np.abs(self.support)


@dataclass
class Snapshot:
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank.

    laid_room : the room by its address
    observe, observe_particles : what fills it; enter : the way there, once its types are known
    """

    rows: np.ndarray
    room: Room
    laid_room: Laid
    observe: Entry | None = None
    observe_particles: Entry | None = None
    enter: Callable | None = None

    @property
    def velocity(self) -> np.ndarray:
        """(r, 3) [m/s]"""
        return np.stack(self.room.velocity, axis=1)[: len(self.rows)]

    @property
    def N(self) -> np.ndarray:
        """Axial force (m,) [N]"""
        return self.room.now.N

    @property
    def eps(self) -> np.ndarray:
        """Strain (m,)"""
        return self.room.now.eps

    @property
    def eps_p(self) -> np.ndarray:
        """Plastic strain (m,)"""
        return self.room.now.eps_p

    @property
    def heat(self) -> np.ndarray:
        """Dissipated (m,) [J]"""
        return self.room.heat

    @property
    def slack(self) -> int:
        """Cables of this rank that are whole and slack."""
        return int(self.room.slack[0])

    def fits(self, state: State) -> bool:
        """Whether a state has as many rows as this has room for."""
        return self.room.terms.shape[1] == len(state.x)

    @property
    def apart(self) -> list[Entry]:
        """All that fills the room."""
        return [self.observe, self.observe_particles]

    def look_at(self, state: State) -> Entry:
        """What fills the room from a state that it fits, as long as the arrays of the state stay."""
        bodies, none = bodies_of(state), [0.0] * 4
        self.observe_particles = Entry(observe_particles, *none, given=(bodies, self.laid_room))
        subject = subject_of(state, self.observe_particles)
        self.observe = Entry(observe, *none, True, given=(subject, self.laid_room))
        return self.observe

    def take(self, state: State, *step: float) -> "Snapshot":
        """The present step of the state that it looks at; step : as of `take_snapshot`."""
        if len(self.rows) != state.n_local - state.n_halo:
            self.rows = state.owned_rows()
        arguments = self.observe, *step
        (self.enter or observe_once)(*arguments)
        self.enter = self.enter or entry_for(observe_once, *arguments)
        return self


def with_rows(array: np.ndarray | None) -> np.ndarray | None:
    """An array (n, 3) of a state, or two rows in its order where it has none.

    What has no rows has no order either: numba would compile all for it once more.
    """
    return array if array is None or len(array) else vectors(2)


def make_room(state: State) -> Snapshot:
    """A snapshot that is yet to look at a state of this size, and to be taken."""
    n, m, sprung = len(state.x), state.m, None
    if state.features.springs:
        sprung = np.empty(n)
    N, eps, eps_p, L, stored, heat = np.empty((6, m))
    x = with_rows(state.x)
    arrays = np.empty_like(x), tuple(np.empty((3, n))), ElementState(N, eps, eps_p, L), heat
    terms = np.empty((4 if state.other_work is None else 4 + len(OTHER_WORKS), n))
    more = bool(state.features.springs) + bool(state.features.sliding) + bool(state.features.detaches)
    attached = Attached(*(np.zeros(k, np.uint8) for k in (n, m))) if state.features.detaches else None
    sums = np.zeros((len(terms) + 2 + more, LIMBS), np.int64)
    f_band = np.empty_like(x) if state.features.band else None
    slack = np.zeros(1, np.int64)
    room = Room(*arrays, terms, stored, sprung, attached, sums, slack, f_band, adding())
    return Snapshot(np.zeros(0, np.int64), room, laid(room))


def bodies_of(state: State) -> Bodies:
    """The particles that are looked at."""
    particles = state.particles._replace(valence=None, detached=None, drag_size=None, steady_speed=None)
    return Bodies(state.n_owned, state.first_split, state.rows, particles, state.relative_wind())


def subject_of(state: State, particles: Entry) -> Subject:
    """What is looked at; particles : `observe_particles` on them."""
    s = state
    springs = tuple(map(with_rows, (s.x_start, s.spring, s.spring_rest, s.turned)))
    springs = springs if s.features.springs else None
    besides = springs, s.joints, s.places, None if s.places is None else s.particles
    of_net = s.n_owned, s.first_split, s.rows, with_rows(s.x), *besides, s.detached
    return Subject(*of_net, *s.of_a_moment, particles)


def take_snapshot(state: State, before_dt: float, dt: float, zeta: float, share: float) -> Snapshot:
    """Forces, velocities and energies at the present step.

    before_dt, dt : [s] the steps before and after it
    zeta, share : of `motion.Kick`
    """
    snapshot = make_room(state)
    snapshot.look_at(state)
    return snapshot.take(state, before_dt, dt, zeta, share)


def energies_of(state: State, sums: np.ndarray) -> Energies:
    """Energies of sums (..., k) [J], as `step.audit.Room` orders them."""
    kinetic, damping, external, internal, *others = np.moveaxis(sums, -1, 0)
    slip = others.pop() if state.features.sliding else 0.0
    attached = others.pop() if state.features.detaches else None
    sprung = others.pop() if state.features.springs else None
    *others, stored, heat = others
    stored = stored if sprung is None else stored + sprung
    attached = kinetic + stored if attached is None else attached
    if not others and not state.features.energy:
        others = [np.full_like(kinetic, np.nan)] * len(OTHER_WORKS)
    others = dict(zip(OTHER_WORKS, others))
    slip = slip if state.features.energy else np.nan * slip
    of_all = kinetic, stored, heat, damping, external, internal
    return Energies(*of_all, slip=slip, attached=attached, **others)


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Energies of the whole net, the same to the bit on any number of ranks. Collective."""
    return energies_of(state, rounded_of_all(comm, snapshot.room.sums.copy()))


def most_extreme(state: State, element_gid: np.ndarray, snapshot: Snapshot) -> tuple:
    """Speed and number of the fastest particle of this rank, and the largest strain and its element."""
    speed = np.nan_to_num(np.abs(snapshot.velocity).max(1, initial=0.0), nan=np.inf)
    held = ~state.free[snapshot.rows].any(1)
    speed[held] = -1.0  # a support takes over what is no number from its neighbours
    strain = np.nan_to_num(np.abs(snapshot.eps), nan=np.inf)
    return (
        speed.max(initial=-1.0),
        int(state.gid[snapshot.rows[speed.argmax()]]) if len(speed) else -1,
        strain.max(initial=-1.0),
        int(element_gid[strain.argmax()]) if len(strain) else -1,
    )
