"""Dynamic relaxation: the particles move under their residual forces until these vanish.

Kinetic damping (Barnes 1999): whenever the kinetic energy has passed a peak, the particles are put back to where
it peaked, at rest. (Without going back, rests can fall into step with a mode that is then never damped.) The
virtual mass M = dt^2/2 sum(k) of the attached elements' stiffness lets every particle take its largest stable
step dt = 1. Serves form finding and statics alike; only the forces differ.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.compile import kernel
from netfall.errors import DivergedError
from netfall.mechanics.elements import add_tensions
from netfall.mechanics.state import State
from netfall.parallel.exact import LIMBS, add_exactly, rounded
from netfall.parallel.halo import Halo
from netfall.solve.stop import NEVER, StopRequest

MARGIN = 1.2  # on the virtual mass: the stiffness grows a little between two peaks
LOOK_EVERY = 10  # iterations between looks at the residual, which take a reduction


@dataclass
class Relaxation:
    """Where a relaxation stands before an iteration: arrays (n, 3) of owned and halo particles."""

    iteration: int
    previous: float
    rested: bool
    x: np.ndarray
    v: np.ndarray
    mass: np.ndarray


class Paused(Exception):
    """A relaxation was asked to stop, at the same iteration on every rank."""

    def __init__(self, at: Relaxation):
        self.at = at


@kernel
def relax_step(x, v, f, mass, free, first, n_owned, kinetic):
    """One step of all particles (n, 3); `kinetic` (n_owned,) gets their energy. `first`: the step after a rest, half a kick."""
    share = 0.5 if first else 1.0
    for p in range(mass.shape[0]):
        energy = 0.0
        for k in range(3):
            if free[p, k]:
                v[p, k] += share * f[p, k] / mass[p, k]
                x[p, k] += v[p, k]
                energy += v[p, k] * v[p, k]
        if p < n_owned:
            kinetic[p] = 0.5 * mass[p, 0] * energy


@kernel
def return_to_peak(x, v, f, mass, free):
    """Put the particles back where the kinetic energy peaked, half a step before the last but one, and at rest.

    x* = x - 3/2 v + 1/2 f / M, dt = 1 (Barnes 1999)
    """
    for p in range(mass.shape[0]):
        for k in range(3):
            if free[p, k]:
                x[p, k] += 0.5 * f[p, k] / mass[p, k] - 1.5 * v[p, k]
            v[p, k] = 0.0


@kernel
def largest_residual(f, free, n_owned):
    """Largest norm [N] of the force over the free axes of the owned particles; inf if not a number."""
    worst = 0.0
    for p in range(n_owned):
        square = 0.0
        for k in range(3):
            if free[p, k]:
                square += f[p, k] * f[p, k]
        if not square <= worst:
            worst = square if square == square else np.inf
    return np.sqrt(worst)


@kernel
def nodal_stiffness(ends, k, out):
    """Add element stiffnesses k (m,) [N/m] to both ends."""
    for e in range(ends.shape[0]):
        out[ends[e, 0]] += k[e]
        out[ends[e, 1]] += k[e]


def relax(
    comm: MPI.Comm,
    halo: Halo,
    x: np.ndarray,
    free: np.ndarray,
    ends: np.ndarray,
    forces: Callable[[np.ndarray, np.ndarray], None],
    stiffness: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
    max_iterations: int,
    what: str,
    report: Callable[[int, float], None] = lambda iteration, residual: None,
    stop: StopRequest = NEVER,
    resume: Relaxation | None = None,
) -> tuple[int, float]:
    """Move x (n, 3) [m], owned and halo, to equilibrium; the iterations and the largest residual [N]. Collective.

    forces(x, f) : writes the total force f (n, 3) [N] of the owned particles
    stiffness(x) : upper bound (m,) [N/m] of the elements' stiffness at x
    tolerance : [N] of the largest residual; stop : a wish to pause; resume : where an earlier relaxation was paused

    Raises DivergedError when the iterations run out or the residual is no number, Paused if asked to stop.
    """
    n_owned = halo.n_owned
    f, v = np.zeros_like(x), np.zeros_like(x)
    kinetic, limbs = np.zeros(n_owned), np.zeros(LIMBS, np.int64)
    mass = np.ones_like(x)  # a column for each axis, all equal, to travel like a force
    previous, rested, first = 0.0, True, 0
    if resume:
        previous, rested, first = resume.previous, resume.rested, resume.iteration
        x[:], v[:], mass[:] = resume.x, resume.v, resume.mass
    for iteration in range(first, max_iterations + 1):
        forces(x, f)
        if iteration % LOOK_EVERY == 0 or rested:
            look = np.array([largest_residual(f, free, n_owned), stop.wanted])
            comm.Allreduce(MPI.IN_PLACE, look, MPI.MAX)
            residual, stopping = look.tolist()
            if residual <= tolerance:
                return iteration, residual
            if not np.isfinite(residual):
                raise DivergedError(
                    f"{what}: the residual is no number after {iteration} iterations; check the net's geometry and sections"
                )
            report(iteration, residual)
            if stopping:
                raise Paused(Relaxation(iteration, previous, rested, x, v, mass))
        halo.update(f)
        if rested:
            total = np.zeros(len(x))
            nodal_stiffness(ends, stiffness(x), total)
            mass[:] = np.where(total > 0.0, 0.5 * MARGIN * total, 1.0)[:, None]
            halo.update(mass)
        relax_step(x, v, f, mass, free, rested, n_owned, kinetic)
        limbs[:] = 0
        add_exactly(kinetic, limbs)
        comm.Allreduce(MPI.IN_PLACE, limbs, MPI.SUM)
        energy = rounded(limbs)
        rested = not energy > previous
        previous = energy
        if rested:
            return_to_peak(x, v, f, mass, free)
            previous = 0.0
    raise DivergedError(
        f"{what}: not in equilibrium after {max_iterations} iterations: largest residual {residual:.3g} N, "
        f"asked {tolerance:.3g} N; raise max_iterations or tolerance, or look for a mechanism"
    )


def net_forces(state: State, share: float):
    """Function (x, f) that writes the total forces f (n, 3) [N] under a share of the load, plastic state unchanged."""

    def forces(x, f):
        N, _, _, L = state.elements_now()
        f[:] = 0.0
        add_tensions(x, state.ends, N, L, f)
        f += share * state.load

    return forces


def state_residual(comm: MPI.Comm, state: State, share: float) -> float:
    """Largest residual force [N] on a free axis at the present positions. Collective."""
    f = np.zeros_like(state.x)
    net_forces(state, share)(state.x, f)
    return comm.allreduce(largest_residual(f, state.free, state.n_owned), MPI.MAX)
