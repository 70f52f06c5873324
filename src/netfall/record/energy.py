"""The two energy audits (paper Eq. 8 to 11) at a step n, without changing the state.

Work identity: the kinetic energy is what external work, less the work against internal forces and damping,
leaves; with the half-step velocities this holds to rounding at any step, and so finds bugs. Physical balance:
the same with the elements' own stored and dissipated energy instead of the work against them; it drifts with
the step and is the error that users should see. Both are told as shares of the energy that took part
(`history.energy_in_play`).
"""

from dataclasses import dataclass

import numpy as np

from netfall.core.records import empty, f8, f8_2, u1
from netfall.core.vectors import LANES
from netfall.mechanics.air import RelativeWind
from netfall.mechanics.bending import Joints
from netfall.mechanics.elements import ElementState
from netfall.mechanics.fields import OTHER_WORKS
from netfall.mechanics.slip.motion import Places
from netfall.mechanics.state import State
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import LIMBS, rounded_of_all
from netfall.step.audit import Room, Subject, observe
from netfall.step.plan import make_scratch, traits_of


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
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank."""

    rows: np.ndarray
    room: Room
    subject: Subject | None = None

    @property
    def velocity(self) -> np.ndarray:
        """(r, 3) [m/s]"""
        return self.room.velocity[:, : len(self.rows)].T

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

    def look_at(self, state: State) -> Subject:
        """Look at a state that it fits, as long as the arrays of the state stay."""
        self.subject = subject_of(state)
        return self.subject

    def take(self, state: State, *step: float) -> "Snapshot":
        """The present step of the state that it looks at; step : as of `take_snapshot`."""
        if len(self.rows) != state.n_local - state.n_halo:
            self.rows = state.owned_rows()
        observe(*map(float, step), True, self.subject, self.room)
        return self


def make_room(state: State) -> Snapshot:
    """A snapshot that is yet to look at a state of this size, and to be taken."""
    f, n, m = state.features, len(state.x), state.m
    N, eps, eps_p, L, stored, heat = (np.zeros(m) for _ in range(6))
    of_particles = lambda rows=3: np.zeros((rows, n + LANES))
    terms = np.zeros((4 if state.other_work is None else 4 + len(OTHER_WORKS), n))
    more = bool(f.springs) + bool(f.sliding) + bool(f.detaches)
    room = Room(
        f_int=of_particles(),
        velocity=of_particles(),
        now=ElementState(N, eps, eps_p, L),
        heat=heat,
        terms=terms,
        stored=stored,
        sprung=np.zeros(n) if f.springs else empty(f8),
        attached=np.zeros(n, np.uint8) if f.detaches else empty(u1),
        attached_elements=np.zeros(m, np.uint8) if f.detaches else empty(u1),
        sums=np.zeros((len(terms) + 2 + more, LIMBS), np.int64),
        slack=np.zeros(1, np.int64),
        f_band=of_particles() if f.band else empty(f8_2),
        scratch=make_scratch(state),
    )
    return Snapshot(np.zeros(0, np.int64), room)


def subject_of(state: State) -> Subject:
    """What is looked at."""
    return Subject(
        state.n_owned,
        state.first_split,
        state.rows,
        traits_of(state),
        state.particles,
        *state.of_a_moment,
        state.joints or Joints.absent(),
        state.places or Places.absent(),
        state.relative_wind() or RelativeWind.absent(),
    )


def take_snapshot(state: State, before_dt: float, dt: float, zeta: float, share: float) -> Snapshot:
    """Forces, velocities and energies at the present step.

    before_dt, dt : [s] the steps before and after it
    zeta, share : of `audit.observe`
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
