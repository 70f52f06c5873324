"""Work control: the load is as large as a given work of it asks for, its factor an unknown beside positions.

Near the largest load that a net bears a little more of it moves the net far, and under more there is no
equilibrium at all. Under a given work of the load, force times displacement of all particles, there is one
for any: the energy of cables is convex in the positions. The factor of the load grows with the work, less and
less.
"""

import numpy as np

from netfall.equilibrium.newton import Newton
from netfall.multigrid.tangent import Tangent


class Work:
    """Of a load (n_owned, 3) [N] that acts besides that of the net, from where the net is.

    factor : of that load; target : of its work [J], `factor` aside
    """

    def __init__(self, newton: Newton, load: np.ndarray):
        self.newton, self.load = newton, newton.not_held(load)
        self.start = newton.net.x[newton.owned].copy()
        self.factor = self.target = 0.0

    def done(self) -> float:
        """The work of the load where the net is [J], `factor` aside. Collective."""
        (work,) = self.newton.dots((self.load, self.newton.net.x[self.newton.owned] - self.start))
        return work

    def solve(self, K: Tangent, cycle, r: np.ndarray, left: float) -> tuple[np.ndarray, float, int]:
        """Correction (n_owned, 3) [m] of a residual r without the load, of `factor`, iterations. Collective.

        left : of the residual, at most. By conjugate gradients among displacements in which the load does no
        work (Gould, Hribar, Nocedal 2001), after one that brings it to `target`. Raises as `Newton.solve`.
        """
        newton, load, more = self.newton, self.load, 0.0
        answer = newton.not_held(cycle(load))
        (compliance,) = newton.dots((load, answer))

        def idle(rows: np.ndarray) -> np.ndarray:
            """As the cycle has it, without work; rows lose the part of the load that this leaves to it."""
            nonlocal more
            z = newton.not_held(cycle(rows))
            (work,) = newton.dots((load, z))
            less = work / compliance
            rows -= less * load
            z -= less * answer
            more -= less
            return z

        first = (self.target - self.done()) / compliance * answer
        r = r + self.factor * load - newton.stiffness_times(K, first)
        s, count = newton.solve(K, idle, r, left)
        return first + s, more, count
