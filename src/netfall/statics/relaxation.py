"""Dynamic relaxation: particles move under their residual forces until the forces vanish.

Kinetic damping (Barnes 1999): when the kinetic energy has passed a peak, the particles return to their
positions at the peak, with zero velocity. Without the return, the stops can synchronise with a mode that is
then never damped. The virtual mass is M = dt^2/2 sum(k), with the stiffness of the attached elements. So dt =
1 is the largest stable step of every particle. Form finding and statics use the same code with different
forces.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.errors import DivergedError
from netfall.core.timings import NEVER_STOP, StopFlag, StopRequested
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.physics.bending import add_bending_forces, add_joint_bounds
from netfall.physics.elements import add_element_forces, geometric_stiffness, nodal_stiffness
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.state import State
from netfall.physics.supports import (
    add_spring_forces,
    largest_residual,
    largest_springs,
    project_on_guides,
)
from netfall.statics import messages
from netfall.statics.limit_load import is_unbounded
from netfall.statics.multigrid.distributed import dot_rows

MASS_MARGIN = 1.2  # factor on the virtual mass [-]: the stiffness grows a little between two peaks
CHECK_EVERY = 10  # iterations between checks of the residual, which need a reduction


class UnboundedDisplacement(DivergedError):
    """Unbounded displacements of yielding elements."""


class StaticNet(NamedTuple):
    """Net whose equilibrium is sought: positions x (n, 3) [m], owned and halo, and the forces on them.

    free : (n, 3), 1 if the axis can move; ends : (m, 2)
    forces(x, f) : writes the total force f (n, 3) [N] of the owned particles
    stiffness(x) : returns an upper bound (m,) [N/m] of the elements' stiffness at x
    support : (n,) [N/m] of elastic supports, the stiffest axis, None: none
    bound(x, out) : adds to out (n,) the stiffness of bending joints, None: there are none
    is_unbounded(comm, u, residual) : as of `limit_load`, for displacements u (n, 3); None: nothing yields
    turned : (n, 3) of supports with axes of their own, None: there are none; `forces` leaves no component
        along the lines that they hold
    """

    x: np.ndarray
    free: IntArray
    ends: np.ndarray
    forces: Callable[[np.ndarray, np.ndarray], None]
    stiffness: Callable[[np.ndarray], np.ndarray]
    support: np.ndarray | None = None
    bound: Callable[[np.ndarray, np.ndarray], None] | None = None
    is_unbounded: Callable[..., bool] | None = None
    turned: np.ndarray | None = None


@np.errstate(over="ignore", invalid="ignore")  # a residual that is not finite ends it
def relax(
    halo: Halo,
    net: StaticNet,
    tolerance: float,
    max_iterations: int,
    name: str,
    report: Callable[[int, float], None] = lambda iteration, residual: None,
    stop: StopFlag = NEVER_STOP,
) -> tuple[int, float]:
    """Move net.x to equilibrium; return the iterations and the largest residual [N]. Collective.

    tolerance : [N] of the largest residual; stop : stop flag

    Raises DivergedError if the iterations run out or the residual is not finite, UnboundedDisplacement,
    StopRequested if the stop flag is set.
    """
    comm, x, free, n_owned, moves = halo.comm, net.x, net.free, halo.n_owned, net.free != 0
    f, v = np.zeros_like(x), np.zeros_like(x)
    mass = np.ones_like(x)  # three equal columns, so that the halo exchange is that of a force
    previous, rested = 0.0, True
    for iteration in range(max_iterations + 1):
        net.forces(x, f)
        if iteration % CHECK_EVERY == 0 or rested:
            checked = np.array([largest_residual(f, free, n_owned), stop.is_set])
            comm.Allreduce(MPI.IN_PLACE, checked, MPI.MAX)
            residual, stopping = checked.tolist()
            if residual <= tolerance:
                return iteration, residual
            if not np.isfinite(residual):
                raise DivergedError(messages.RESIDUAL_NOT_FINITE(name=name, iterations=iteration))
            report(iteration, residual)
            if stopping:
                raise StopRequested
        if (
            net.is_unbounded is not None
            and iteration % (10 * CHECK_EVERY) == 0
            and net.is_unbounded(comm, v, residual)
        ):
            raise UnboundedDisplacement(messages.UNBOUNDED_YIELDING())
        halo.update(f)
        if rested:
            total = np.zeros(len(x)) if net.support is None else net.support.copy()
            nodal_stiffness(net.ends, net.stiffness(x), total)
            if net.bound is not None:
                net.bound(x, total)
            mass[:] = np.where(total > 0.0, 0.5 * MASS_MARGIN * total, 1.0)[:, None]
            halo.update(mass)
        np.add(v, (0.5 if rested else 1.0) * f / mass, out=v, where=moves)  # first half an update, from 0
        np.add(x, v, out=x, where=moves)
        (energy,) = exact_sums(comm, 0.5 * mass[:n_owned, 0] * dot_rows(v, v)[:n_owned])
        rested = not energy > previous
        previous = energy
        if rested:  # back to the peak, half a step before the last but one (Barnes 1999), with zero velocity
            np.add(x, 0.5 * f / mass - 1.5 * v, out=x, where=moves)
            v[:] = previous = 0.0
    net.forces(x, f)
    residual = comm.allreduce(largest_residual(f, free, n_owned), MPI.MAX)
    if residual <= tolerance:
        return max_iterations, residual
    raise DivergedError(
        messages.NOT_CONVERGED(name=name, iterations=max_iterations, residual=residual, tolerance=tolerance)
    )


def largest_force(
    comm: MPI.Comm, N: np.ndarray, ends: np.ndarray, free: IntArray, load: FloatArray | None = None
) -> float:
    """Return the largest force [N] on anything that can move, the reference of tolerances. Collective.

    N : (m,) [N]; ends : (m, 2); free : (n, 3); load : (n_owned, 3) [N], None: tensions alone

    Loads directly on supports and backstays between them are left out, because they act on no free axis.
    """
    local_maximum = np.abs(N[np.asarray(free.any(1))[ends].any(1)]).max(initial=0.0)
    if load is not None:
        local_maximum = max(local_maximum, np.abs(load[free[: len(load)] != 0]).max(initial=0.0))
    return float(comm.allreduce(local_maximum, MPI.MAX))


def static_net(state: State, load: np.ndarray, slips: Any = None) -> StaticNet:
    """Build the net of a state under a load (n, 3) [N] of owned and halo particles, plastic strain fixed.

    slips : `slip.Slips`, None: no cable slides
    """
    load = np.asfortranarray(load)  # the layout of positions and forces
    turned = np.zeros((0, 3)) if state.turned is None else state.turned

    def forces(x: FloatArray, f: FloatArray) -> None:
        f[:] = 0.0
        if slips is not None:
            slips.forces(x, f)
        add_element_forces(x, *state.elements_and_law, f)
        if state.joints is not None:
            add_bending_forces(x, state.joints, f)
        if state.features.springs:
            add_spring_forces(x, state.x_start, state.spring, state.spring_rest, turned, f)
        f += load
        if state.turned is not None:
            project_on_guides(state.turned, f)

    def stiffness(x: Any) -> Any:
        elements = state.present_element_state()
        return largest_stiffness(state.EA, state.L0) + geometric_stiffness(elements.N, elements.L)

    support = largest_springs(state.spring, state.turned) if state.features.springs else None

    joints = state.joints

    def joint_bound(x: FloatArray, out: FloatArray) -> None:
        # eigenvalues grow with the particles of a part: a joint has three, an element two
        assert joints is not None
        add_joint_bounds(x, joints, joints.particles.shape[1] / state.ends.shape[1], out)

    bound = None if joints is None else joint_bound

    def has_no_equilibrium(comm: MPI.Comm, u: FloatArray, residual: float = np.inf) -> bool:
        stiffness = np.zeros(len(u)) if support is None else support.copy()
        if bound is not None:
            bound(state.x, stiffness)
        return is_unbounded(comm, state, load, stiffness > 0.0, (u, state.x - state.x_start), residual)

    return StaticNet(
        state.x,
        state.free,
        state.ends,
        forces,
        stiffness,
        support,
        bound,
        has_no_equilibrium if state.features.plastic else None,
        state.turned,
    )


def state_residual(comm: MPI.Comm, state: State, load: np.ndarray) -> float:
    """Return the largest residual force [N] on a free axis at the present positions. Collective.

    load : (n, 3) [N]
    """
    f = np.zeros_like(state.x)
    static_net(state, load).forces(state.x, f)
    return comm.allreduce(largest_residual(f, state.free, state.n_owned), MPI.MAX)
