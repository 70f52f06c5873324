"""Equilibrium by Newton's method with the tangent stiffness.

Conjugate gradients with a multigrid cycle as preconditioner solve for each correction. The displacement of a
full correction estimates the error before it, in displacement and in tension, at any refinement. If the
tangent is not positive definite, the geometric stiffness of compressed elements is left out. If it is
singular even so (no prestress, all slack), inertia is added until it is not.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import lengths
from netfall.core.timings import NEVER_STOP, StopFlag, StopRequested
from netfall.parallel.agree import largest_of_ranks
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums
from netfall.physics.bending import add_joint_stiffness
from netfall.physics.elements import add_stiffness, axial_forces
from netfall.physics.supports import project_on_guides
from netfall.statics.bounds import LARGE_SHARE, MOST_STEPS, NEGLIGIBLE, SUBSTITUTE_SHARE, SUM_ROUNDING
from netfall.statics.multigrid.cycle import CycleStructure, VCycle
from netfall.statics.multigrid.distributed import dot_rows
from netfall.statics.multigrid.tangent import Tangent, pseudo_random, without_compression
from netfall.statics.relaxation import StaticNet

# iterations of a search that converges slowly or not at all: of corrections it takes 3 to 15, of conjugate
# gradients with a cycle that fits the tangent some 10
MANY_ITERATIONS = 25
# share of the residual left after a correction [-]: three corrections reach the default tolerance
CG_TOLERANCE = 1e-2
# times the tolerance [-]: largest accepted error if rounding or a singular tangent ends a search
NEAR_TOLERANCE = 10.0
# rounding error of lengths in units in the last place of coordinates: two ends, two roundings
ROUNDING_ULPS = 4.0

STABLE, UNKNOWN = -1, -2  # values of `unstable_at` that are not the number of a particle


class Solution(NamedTuple):
    """Equilibrium found by one of the methods.

    iterations : of conjugate gradients, or of the relaxation
    residual : largest residual force [N]
    displacement_error, tension_error : estimated errors, shares of the largest value, nan: no estimate. If
        the tangent gives no estimate, they are the change caused by the last tenth of the residual.
    relaxed : whether dynamic relaxation found it
    unstable_at : global number of the particle that moves most in the unstable shape; `STABLE`; or `UNKNOWN`
        if stability could not be decided
    """

    iterations: int
    residual: float
    displacement_error: float
    tension_error: float
    relaxed: bool = False
    unstable_at: int = UNKNOWN

    @property
    def error(self) -> float:
        """Return the larger of the two errors."""
        return max(self.displacement_error, self.tension_error)


class NoConvergence(Exception):
    """Failure of a method to find the equilibrium."""


class SlowConvergence(NoConvergence):
    """Failure of conjugate gradients to converge, because the tangent is nearly singular."""


class NotPositiveDefinite(NoConvergence):
    """Tangent without stiffness against the displacements `shape` (n_owned, 3)."""

    def __init__(self, shape: np.ndarray):
        super().__init__("the tangent is not positive")
        self.shape = shape


class Newton:
    """Newton's method for one net, distributed over the ranks."""

    def __init__(
        self,
        comm: MPI.Comm,
        halo: Halo,
        distribution: Distribution,
        net: StaticNet,
        tangent: Callable[..., Any],
        structure: CycleStructure,
    ):
        """tangent() : returns the `Tangent` at its positions. Collective."""
        self.comm, self.halo, self.distribution = comm, halo, distribution
        self.net, self.tangent, self.structure = net, tangent, structure
        self.owned = slice(halo.n_owned)
        self.moves = np.ascontiguousarray(net.free[self.owned]) != 0
        self.held = np.nonzero(~self.moves)
        # without elements between supports
        self.moved_elements = np.asarray(net.free.any(1))[net.ends].any(1)
        self.u = np.zeros_like(np.ascontiguousarray(net.x))
        self.force = np.zeros_like(self.u)
        self.f = np.zeros_like(net.x)
        self.inertia = self.extent = self.rounded = 0.0

    def begin(self) -> None:
        """Reset the inertia; measure the extent of the net and its rounding error [m]. Collective."""
        x = self.net.x[self.owned]
        low, high = x.min(0, initial=np.inf), x.max(0, initial=-np.inf)
        self.comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
        self.comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
        self.extent, self.inertia = float((high - low).max()), 0.0
        self.rounded = ROUNDING_ULPS * np.finfo(float).eps * float(np.abs((low, high)).max())

    def inner_products(self, *pairs: tuple[FloatArray, FloatArray]) -> list[float]:
        """Compute inner products over all ranks, correctly rounded, of pairs of arrays (n_owned, 3).

        Collective. The result is nan if a term is not finite: the cycle of a singular tangent overflows in
        single precision.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # `solve` notices a sum that is not finite
            return exact_sums(self.comm, *(dot_rows(a, b) for a, b in pairs))

    def largest(self, *values: Any) -> list[float]:
        """Return the largest absolute value of each array over all ranks. Collective."""
        maxima = np.array([np.abs(array).max(initial=0.0) for array in values])
        self.comm.Allreduce(MPI.IN_PLACE, maxima, MPI.MAX)
        return maxima.tolist()

    def residual(self) -> np.ndarray:
        """Compute the residual forces (n_owned, 3) [N] on the free axes."""
        self.net.forces(self.net.x, self.f)
        return self.without_held(self.f[self.owned])

    def set_displacement(self, u: np.ndarray) -> None:
        """Copy displacements u (n_owned, 3) [m] to `u` (n, 3) and update its halo. Collective."""
        self.u[self.owned] = u
        self.halo.update(self.u)

    def stiffness_times(self, K: Tangent, u: np.ndarray) -> np.ndarray:
        """Multiply the tangent stiffness by displacements u (n_owned, 3) [m]; [N], a view. Collective."""
        self.set_displacement(u)
        self.force[:] = 0.0
        add_stiffness(self.u, self.net.ends, K.direction, K.axial, K.across, self.force)
        if K.joints is not None:
            add_joint_stiffness(self.u, K.joints.particles, K.joints.stiffness, self.force)
        if K.support is not None:
            self.force += K.support * self.u
        if K.between is not None:
            self.force[:, :2] += K.between[:, None] * self.u[:, 1::-1]
        out = self.force[self.owned]
        if K.slip is not None:
            K.slip.subtract_slip(self.u, self.force)
        if self.inertia:
            out += self.inertia * K.nodal[self.owned, None] * u
        return self._zero_held(out)

    def without_held(self, rows: np.ndarray) -> np.ndarray:
        """Return a copy of rows (n_owned, 3) without the components along held directions."""
        return self._zero_held(np.where(self.moves, rows, 0.0))

    def _zero_held(self, rows: np.ndarray) -> np.ndarray:
        """Set rows (n_owned, 3) to 0 on held axes and along lines held by supports, in place; return them."""
        rows[self.held] = 0.0
        if self.net.turned is not None:
            project_on_guides(self.net.turned, rows)
        return rows

    def solve(
        self,
        K: Tangent,
        cycle: Callable[[np.ndarray], np.ndarray],
        r: np.ndarray,
        residual_share: float = CG_TOLERANCE,
    ) -> tuple[np.ndarray, int]:
        """Return the correction (n_owned, 3) [m] of a residual and the iterations. Collective.

        residual_share : of the residual that may be left

        Raises NoConvergence if the tangent is singular in the direction of the residual.
        """
        s, remainder = np.zeros_like(r), r
        p = z = self._zero_held(cycle(remainder))
        rz, rr = self.inner_products((remainder, z), (remainder, remainder))
        if rr == 0.0:
            return s, 0
        if not (0.0 < rz < np.inf and rr < np.inf):
            raise NoConvergence("the preconditioner is not positive")
        first = rz
        for iteration in range(1, MOST_STEPS + 1):
            q = self.stiffness_times(K, p)
            (pq,) = self.inner_products((p, q))
            if not pq > 0.0:
                raise NotPositiveDefinite(p)
            step = rz / pq
            s += step * p
            previous_remainder, remainder = remainder, remainder - step * q
            z = self._zero_held(cycle(remainder))
            size, new, mixed_product = self.inner_products(
                (remainder, remainder), (remainder, z), (previous_remainder, z)
            )
            if (
                size <= residual_share * residual_share * rr
                and new <= residual_share * residual_share * first
            ):
                return s, iteration
            p = z + (new - mixed_product) / rz * p
            rz = new
            if not 0.0 < rz < np.inf:
                raise NoConvergence("the preconditioner is not positive")
        raise SlowConvergence(f"{MOST_STEPS} iterations of conjugate gradients were not enough")

    def cycle(self, K: Tangent) -> VCycle:
        """Set up the multigrid cycle, the approximate inverse of a tangent. Collective."""
        return VCycle(self.distribution, self.net, K, self.inertia, self.structure)

    def find(
        self,
        tolerance: float,
        start: np.ndarray,
        stop: StopFlag = NEVER_STOP,
        before: tuple[int, float] | None = None,
        quick: bool = False,
    ) -> Solution:
        """Move the net to equilibrium. Collective.

        tolerance : of the remaining error after the last correction, a share of the largest displacement from
            `start` (n, 3) and of the largest tension
        stop : stop flag
        before : iterations of another method that has brought the net close to an equilibrium, and size of
            its last correction, the larger share of `step_sizes`; no correction is then too expensive
        quick : whether to give up if a correction is too large, because another method is better

        Raises NoConvergence, StopRequested if the stop flag is set; the positions are then those of the last
        correction.
        """
        self.begin()
        K, (total, previous_size) = self.tangent(), before or (0, np.inf)
        cycle, r = None, self.residual()
        exact = True  # whether the tangent includes compression
        for _ in range(MANY_ITERATIONS):
            if self.comm.allreduce(int(stop.is_set), MPI.MAX):
                raise StopRequested
            cycle = cycle or self.cycle(K)
            try:
                s, count = self.solve(K, cycle, r)
            except NoConvergence as error:
                if quick or (isinstance(error, SlowConvergence) and not before):
                    raise
                if exact and self.comm.allreduce(K.is_softened, MPI.LOR):
                    K, exact = without_compression(K), False
                else:
                    self._increase_inertia()
                    cycle = None
                previous_size = np.inf
                continue
            total += count
            displacement, change, predicted = self.step_sizes(K, s, start)
            step_share = self.move_along(s, r)
            old_tangent, r, K = K, self.residual(), self.tangent()
            unpredicted = self.tension_share(K.N - old_tangent.N - predicted, K.N)
            is_full, change = step_share == 1.0 and not self.inertia, max(change, unpredicted)
            if quick and (step_share < LARGE_SHARE or unpredicted > LARGE_SHARE):
                raise NoConvergence("it is not near")
            size, differs = max(displacement, change), (old_tangent.axial == 0.0) != (K.axial == 0.0)
            changed = self.comm.allreduce(bool(differs.any()), MPI.LOR)
            if changed:  # elements became slack or taut, or began or ceased to yield or buckle
                previous_size = np.inf
            if changed or count > MANY_ITERATIONS:
                cycle = None
            # after many iterations slow modes may hold more of the error than the residual shows
            is_known = 0.0 < previous_size < np.inf and count <= MANY_ITERATIONS
            remaining_share = max(CG_TOLERANCE, min(1.0, size / previous_size)) if is_known else 1.0
            done = remaining_share * size <= tolerance or remaining_share * size <= self.rounding(K)
            if is_full and exact and done:
                return self.solution(total, (remaining_share * displacement, remaining_share * change))
            previous_size, exact = size if is_full else np.inf, True
            if step_share < LARGE_SHARE:
                self._increase_inertia()
            elif step_share == 1.0:
                self.inertia = 0.0 if self.inertia <= SUBSTITUTE_SHARE else 0.1 * self.inertia
        raise NoConvergence(f"{MANY_ITERATIONS} corrections were not enough")

    def solution(self, iterations: int, errors: tuple[float, float]) -> Solution:
        """Return the present positions as a `Solution`. Collective."""
        (residual,) = self.largest(lengths(self.residual()))
        return Solution(iterations, residual, *errors, unstable_at=self.unstable_at())

    def rounding(self, K: Tangent) -> float:
        """Estimate the change of tensions by rounded coordinates, over the largest tension. Collective."""
        return self.tension_share(self._rounded_forces(K), K.N)

    def _rounded_forces(self, K: Tangent) -> np.ndarray:
        """Estimate the change of forces (m,) [N] by rounded coordinates."""
        size = np.abs(self.net.x).max(1, initial=0.0)[self.net.ends].max(1, initial=0.0)
        return np.asarray(ROUNDING_ULPS * np.finfo(float).eps * (K.axial + np.abs(K.across)) * size)

    def relative_changes(
        self, moved: np.ndarray, distance: np.ndarray, change: np.ndarray, N: np.ndarray
    ) -> tuple[float, float]:
        """Compare displacements and changes of tension with the largest ones; 0 if rounded. Collective.

        moved : (n_owned, 3) [m]; distance : (n_owned, 3) [m] from the start; change : (m,) [N]; N : (m,) [N]

        Returns shares of displacement and tension. Call `begin` first.
        """
        movement, farthest = self.largest(lengths(moved), lengths(distance))
        if movement <= ROUNDING_ULPS * np.finfo(float).eps * self.extent:
            return 0.0, 0.0
        if movement <= self.rounded:  # far from the origin it may change tensions
            movement = 0.0
        return movement / max(farthest, SUBSTITUTE_SHARE * self.extent), self.tension_share(change, N)

    def tension_share(self, change: np.ndarray, N: np.ndarray) -> float:
        """Return the largest of changes (m,) [N] over the largest of tensions N (m,) [N]. Collective."""
        largest, tension = self.largest(change[self.moved_elements], N[self.moved_elements])
        return largest / tension if tension > 0.0 else 0.0

    def _increase_inertia(self) -> None:
        self.inertia = 10.0 * self.inertia or SUBSTITUTE_SHARE
        if self.inertia > CG_TOLERANCE:  # it would falsify a correction more than conjugate gradients do
            raise NoConvergence("the tangent is singular")

    def step_sizes(self, K: Tangent, s: np.ndarray, start: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Return `relative_changes` due to a correction, and its changes of tension (m,) [N]. Collective."""
        self.set_displacement(s)
        change = axial_forces(self.u, self.net.ends, K.direction, K.axial)
        if K.slip is not None:
            K.slip.add_changes(self.u, change)
        distance = self.net.x[self.owned] - start[self.owned] + s
        displacement, tension = self.relative_changes(s, distance, change, K.N)
        (farthest,) = self.largest(lengths(distance))
        # rounded forces alone move a net so far: relative to such a distance no displacement is meaningful
        if farthest <= SUBSTITUTE_SHARE * self.extent and farthest <= self.rounding(K) * self.extent:
            displacement = 0.0
        return displacement, tension, change

    def _without_rounded_compression(self, K: Tangent) -> Tangent:
        """Return the tangent without compression below the accuracy of the forces. Collective."""
        (largest,) = self.largest(K.N[self.moved_elements])
        accuracy = np.maximum(NEGLIGIBLE * largest, self._rounded_forces(K))
        return K._replace(across=np.where((K.N < 0.0) & (K.N >= -accuracy), 0.0, K.across))

    def unstable_shape(self) -> np.ndarray | None:
        """Return displacements (n_owned, 3) against which the net has no stiffness, None if stable.

        Conjugate gradients with a right-hand side that contains every shape meet such displacements, if there
        are any, before little of the residual is left. Only compression and moments cause them. Collective.
        Raises NoConvergence if the search does not decide.
        """
        K = self._without_rounded_compression(self.tangent())
        if not self.comm.allreduce(K.is_softened, MPI.LOR):
            return None
        number = 3 * self.distribution.subdomain.particle_gid[self.owned, None] + np.arange(3)
        present = self.moves & (K.nodal[self.owned, None] > 0.0)  # without nodes that have left the net
        r = self.without_held(np.where(present, pseudo_random(number), 0.0))
        shape = None
        # the second pair decides if nodes of slack cables or of a mechanism have no stiffness
        for matrix_inertia, cycle_inertia in ((0.0, 0.0), (SUM_ROUNDING, SUBSTITUTE_SHARE)):
            try:
                self.inertia = cycle_inertia
                cycle = self.cycle(K)
                self.inertia = matrix_inertia
                self.solve(K, cycle, r, CG_TOLERANCE**2)
                return None
            except NotPositiveDefinite as error:
                shape = error.shape if shape is None else shape
            except NoConvergence:
                if matrix_inertia and shape is None:
                    raise
            finally:
                self.inertia = 0.0
        return shape

    def unstable_at(self) -> int:
        """Return the global number of the particle that moves most in the unstable shape. Collective.

        `STABLE` or `UNKNOWN` otherwise.
        """
        try:
            shape = self.unstable_shape()
        except NoConvergence:
            return UNKNOWN
        if shape is None:
            return STABLE
        return self.largest_at(lengths(shape))[1]

    def largest_at(self, size: np.ndarray) -> tuple[float, int]:
        """Return the largest of sizes (n_owned,), and the global number of its particle. Collective."""
        return largest_of_ranks(self.comm, size, self.distribution.subdomain.particle_gid[self.owned])

    def allowed_share(self, s: np.ndarray) -> float:
        """Return the share of a correction that moves nothing too far. Collective."""
        return min(1.0, LARGE_SHARE * self.extent / max(self.largest(s)[0], 1e-300))

    def move_along(self, s: np.ndarray, r: np.ndarray) -> float:
        """Move the net along a correction until the residual changes sign; return the share moved.

        Collective.
        """
        step_share = self.allowed_share(s)
        start = self.net.x.copy()
        (slope,) = self.inner_products((r, s))
        self.set_displacement(s)
        while True:
            self.net.x[:] = start + step_share * self.u
            (new_slope,) = self.inner_products((self.residual(), s))
            is_good = np.isfinite(new_slope) and new_slope >= -0.5 * slope
            if is_good or not step_share > NEGLIGIBLE:
                return step_share
            fraction = slope / (slope - new_slope) if np.isfinite(new_slope) else 0.1
            step_share *= min(max(fraction, 0.1), 0.5)
