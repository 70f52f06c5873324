"""The envelope of a dynamic stage: largest and smallest values, and when; of rows and of steps between them.

Each rank keeps those of its own particles and elements, from what the audit of a row computes anyway, and
where rows are far apart between them too (`step.rows.widen`). Where something can break or is lost, forces
are those of all steps: what breaks lets waves loose that are shorter than the time between two rows.
"""

import numpy as np

from netfall.parallel.subdomain import Distribution
from netfall.step.rows import widen_to_extremes

TENSION = ("tension_max", "tension_max_time", "tension_min", "slack_time")  # (m,), of elements
DISPLACEMENT = ("displacement_max", "displacement_max_time")  # (n,), of particles of the net

MOMENT = "bending_moment_max"  # (m,), where chains bend


class Envelope:
    """Of one rank. tension : (4, m); displacement : (2, n_owned); rows as in TENSION and DISPLACEMENT.

    moment : (m,) [N m] the largest of bending, nan: no bending; None: nothing bends
    """

    def __init__(self, distribution: Distribution, bends: bool = False):
        self.distribution = distribution
        subdomain = distribution.subdomain
        # written, not np.zeros: on pages never written a store that a mask leaves out takes a hundred cycles
        self.tension = np.full((len(TENSION), len(subdomain.element_gid)), 0.0)
        self.tension[0], self.tension[2] = -np.inf, np.inf
        self.displacement = np.full((len(DISPLACEMENT), subdomain.n_owned), 0.0)
        self.displacement[0] = -1.0
        self.moment = np.full(len(subdomain.element_gid), np.nan) if bends else None

    def take_in(self, time: float, state) -> None:
        """The extremes of all steps so far, at a time [s], where the scene has them."""
        if state.highest is not None:
            widen_to_extremes(time, state.highest, state.elements.lowest, self.tension)

    def columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Of elements (m,) and of particles (n_owned,), by name."""
        bends = {} if self.moment is None else {MOMENT: self.moment}
        return dict(zip(TENSION, self.tension)) | bends, dict(zip(DISPLACEMENT, self.displacement))

    def record(self, state) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, by global numbers on rank 0, for `restore`. Collective."""
        mine = state.owned.astype(bool)
        tension = self.distribution.gather_elements(self.tension.T, mine)
        displacement = self.distribution.gather_particles(self.displacement.T)
        bends = {}
        if self.moment is not None:
            bends = {MOMENT: self.distribution.gather_elements(self.moment, mine)}
        return {}, {} if tension is None else {"tension": tension, "displacement": displacement} | bends

    def restore(self, _: dict, arrays: dict[str, np.ndarray] | None) -> None:
        """Take up the record of an earlier run. arrays : on rank 0. Collective."""
        spread, n_owned = self.distribution, self.displacement.shape[1]
        rows = lambda name: arrays and arrays[name]
        self.tension[:] = spread.elements(rows("tension")).T
        self.displacement[:] = spread.particles(rows("displacement"))[:n_owned].T
        if self.moment is not None:
            self.moment[:] = spread.elements(rows(MOMENT))
