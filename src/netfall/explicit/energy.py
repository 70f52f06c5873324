"""Work identity and physical energy balance (paper Eq. 8 to 11) at a step n. The state is not changed.

Work identity: the kinetic energy equals the external work minus the work of internal forces and damping.
With half-step velocities this holds to rounding at any step, so an error indicates a fault of the code.
Physical balance: the stored and dissipated energies of the elements replace the work of their forces. This
error depends on the time step; it is the error that users should see. Both errors are relative to the energy
that takes part (`history.energy_in_play`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.records import empty, f8, f8_2, u1
from netfall.core.vectors import LANES
from netfall.explicit import energy_check
from netfall.explicit.plan import feature_bits, make_scratch
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import LIMBS, round_over_ranks
from netfall.physics.air import RelativeWind, set_air_forces
from netfall.physics.bending import Joints
from netfall.physics.elements import ElementState
from netfall.physics.fields import OTHER_WORKS
from netfall.physics.slip.motion import SlipPoints
from netfall.physics.state import State


@dataclass(frozen=True)
class Energies:
    """Energies [J] at one time, or at several.

    internal : work against all internal forces: elements, damping branches, bending chains, elastic supports
    air, band : work of aerodynamic damping, and against damping branches; internal contains `band`
    support : work of the ground on moving supports
    slip : friction heat of sliding cables, whose motion and forces are in kinetic, external and internal;
        0 without sliding cables
    attached : kinetic energy, and stored energy including prestress, of the parts attached to a support
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
        """Work [J] of loads and of the ground as the sum of absolute values."""
        return np.abs(self.external) + np.abs(self.support)


@dataclass
class Snapshot:
    """The state at a step n for reports: owned particles (rows) and all elements of a rank.

    N : axial force (m,) [N]; eps, eps_p : strain, plastic strain (m,); heat : dissipated energy (m,) [J]
    """

    rows: np.ndarray
    observation: energy_check.ObservationArrays
    observed: Any = None

    def __post_init__(self) -> None:
        now, self.heat = self.observation.now, self.observation.heat
        self.N, self.eps, self.eps_p = now.N, now.eps, now.eps_p

    @property
    def velocity(self) -> np.ndarray:
        """Velocity (r, 3) [m/s]"""
        return self.observation.velocity[:, : len(self.rows)].T

    @property
    def slack(self) -> int:
        """Number of slack unbroken cables of this rank."""
        return int(self.observation.slack[0])

    def fits(self, state: State) -> bool:
        """Return whether the arrays of this snapshot have the size of a state."""
        return self.observation.terms.shape[1] == len(state.x)

    def bind(self, state: State) -> energy_check.ObservedState:
        """Refer to the arrays of a state of fitting size, as long as they stay in place."""
        self.observed = snapshot_input(state)
        return self.observed

    def take(self, state: State, before_dt: float, dt: float, zeta: float, share: float) -> "Snapshot":
        """Compute the present step of the state.

        before_dt, dt : [s] the steps before and after it; zeta, share : see `energy_check.observe`
        """
        if len(self.rows) != state.n_local - state.n_halo:
            self.rows = state.owned_rows()
        energy_check.observe_now(
            float(before_dt), float(dt), float(zeta), float(share), self.observed, self.observation
        )
        return self


def make_snapshot(state: State) -> Snapshot:
    """Allocate a snapshot for a state of this size, without values."""
    f, n, m = state.features, len(state.x), state.m
    N, eps, eps_p, L, stored, heat = (np.zeros(m) for _ in range(6))
    vectors = (3, n + LANES)
    terms = np.zeros((4 if state.other_work is None else 4 + len(OTHER_WORKS), n))
    extra_sums = bool(f.springs) + bool(f.sliding) + bool(f.detaches)
    observation = energy_check.ObservationArrays(
        f_int=np.zeros(vectors),
        velocity=np.zeros(vectors),
        now=ElementState(N, eps, eps_p, L),
        heat=heat,
        terms=terms,
        stored=stored,
        sprung=np.zeros(n) if f.springs else empty(f8),
        attached=np.zeros(n, np.uint8) if f.detaches else empty(u1),
        attached_elements=np.zeros(m, np.uint8) if f.detaches else empty(u1),
        sums=np.zeros((len(terms) + 2 + extra_sums, LIMBS), np.int64),
        slack=np.zeros(3, np.int64),
        f_branches=np.zeros(vectors) if f.band else empty(f8_2),
        scratch=make_scratch(state),
    )
    return Snapshot(np.zeros(0, np.int64), observation)


def snapshot_input(state: State) -> energy_check.ObservedState:
    """Return the arrays of a state that a snapshot reads."""
    f = state.features
    return energy_check.ObservedState(
        state.n_owned,
        state.first_split,
        state.rows,
        feature_bits(state),
        state.particles,
        state.elements,
        state.slots,
        state.law,
        state.joints or Joints.absent(),
        state.slip_points or SlipPoints.absent(),
        state.relative_wind() or RelativeWind.absent(),
        energy_check.observe.address,
        set_air_forces.address_if(f.air or f.drags),
        energy_check.add_rare_forces.address_if(f.band or f.bending or f.springs),
        energy_check.add_rare_energies.address_if(f.bending or f.springs),
        energy_check.add_slip_energies.address_if(f.sliding),
    )


def take_snapshot(state: State) -> Snapshot:
    """Compute forces, velocities and energies of a state in which no step has been made yet."""
    snapshot = make_snapshot(state)
    snapshot.bind(state)
    return snapshot.take(state, before_dt=0.0, dt=1.0, zeta=0.0, share=0.0)


def energies_from_sums(state: State, sums: np.ndarray) -> Energies:
    """Return the energies of sums (..., k) [J] in the order of `explicit.energy_check.ObservationArrays`."""
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
    return Energies(
        kinetic=kinetic,
        strain=stored,
        plastic=heat,
        damping=damping,
        external=external,
        internal=internal,
        slip=slip,
        attached=attached,
        **others,
    )


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Sum the energies over all ranks; the result is bitwise the same on any number of ranks. Collective."""
    return energies_from_sums(state, round_over_ranks(comm, snapshot.observation.sums.copy()))


def rounding_energy(comm: MPI.Comm, state: State, snapshot: Snapshot, steps: int) -> float:
    """Estimate the strain energy [J] that rounding of positions adds over the steps. Collective.

    A step rounds each coordinate x by up to eps |x| / 2. The internal force does work on this, the loads do
    not. Over independent steps and particles the sum is a random walk.
    """
    rows = snapshot.rows
    work = np.abs(snapshot.observation.f_int[:, : len(rows)].T * state.x[rows])[state.free[rows] != 0]
    largest, n = comm.allreduce(work.max(initial=0.0), MPI.MAX), comm.allreduce(len(rows))
    return float(0.5 * np.finfo(float).eps * largest * np.sqrt(n * steps / 3.0))


def local_extremes(state: State, element_gid: np.ndarray, snapshot: Snapshot) -> tuple[Any, ...]:
    """Return speed and number of this rank's fastest particle, and its largest strain and the element."""
    speed = np.nan_to_num(np.abs(snapshot.velocity).max(1, initial=0.0), nan=np.inf)
    held = ~state.free[snapshot.rows].any(1)
    speed[held] = -1.0  # nan of a neighbour would propagate to a support
    strain = np.nan_to_num(np.abs(snapshot.eps), nan=np.inf)
    return (
        speed.max(initial=-1.0),
        int(state.gid[snapshot.rows[speed.argmax()]]) if len(speed) else -1,
        strain.max(initial=-1.0),
        int(element_gid[strain.argmax()]) if len(strain) else -1,
    )
