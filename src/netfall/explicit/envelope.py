"""Envelope of a dynamic stage: largest and smallest values with their times.

Each rank records its own particles and elements from values that the energy check of a row computes anyway.
If rows are far apart, the envelope also includes steps between them (`explicit.sampling.update_envelope`). If
elements can break or are removed, forces are recorded at every step, since a fracture starts waves that are
shorter than the time between two rows.
"""

from typing import Any

import numpy as np

from netfall.explicit.sampling import update_tension_envelope
from netfall.parallel.subdomain import Distribution
from netfall.physics.state import State

TENSION = ("tension_max", "tension_max_time", "tension_min", "slack_time")  # (m,), of elements
DISPLACEMENT = ("displacement_max", "displacement_max_time")  # (n,), of particles of the net

MOMENT = "bending_moment_max"  # (m,), only with bending chains


class DynamicEnvelope:
    """The envelope of one rank. Its rows have the order of TENSION and DISPLACEMENT.

    tension : (4, m); displacement : (2, n_owned)
    moment : (m,) [N m] the largest bending moment, nan: no bending; None: no bending chains
    """

    def __init__(self, distribution: Distribution, bends: bool = False):
        self.distribution = distribution
        subdomain = distribution.subdomain
        # Not np.zeros: on untouched pages a masked store costs some hundred cycles.
        self.tension = np.full((len(TENSION), len(subdomain.element_gid)), 0.0)
        self.tension[0], self.tension[2] = -np.inf, np.inf
        self.displacement = np.full((len(DISPLACEMENT), subdomain.n_owned), 0.0)
        self.displacement[0] = -1.0
        self.moment = np.full(len(subdomain.element_gid), np.nan) if bends else None

    def take_in(self, time: float, state: State) -> None:
        """Include the extremes of all steps so far, at a time [s], if the state records them."""
        if state.highest is not None:
            update_tension_envelope(time, state.highest, state.elements.lowest, self.tension)

    def columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return the columns of elements (m,) and of particles (n_owned,), by name."""
        bends = {} if self.moment is None else {MOMENT: self.moment}
        return dict(zip(TENSION, self.tension)) | bends, dict(zip(DISPLACEMENT, self.displacement))

    def record(self, state: State) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the data for `restore`, by global numbers on rank 0. Collective."""
        owned = state.owned.astype(bool)
        tension = self.distribution.gather_elements(self.tension.T, owned)
        displacement: Any = self.distribution.gather_particles(self.displacement.T)
        bends: dict[str, Any] = {}
        if self.moment is not None:
            bends = {MOMENT: self.distribution.gather_elements(self.moment, owned)}
        if tension is None:
            return {}, {}
        return {}, {"tension": tension, "displacement": displacement} | bends

    def restore(self, _: dict[str, Any], arrays: dict[str, np.ndarray] | None) -> None:
        """Restore the record of an earlier run. arrays : on rank 0. Collective."""
        distribution, n_owned = self.distribution, self.displacement.shape[1]
        tension, displacement = (arrays["tension"], arrays["displacement"]) if arrays else (None, None)
        self.tension[:] = distribution.elements(tension).T
        self.displacement[:] = distribution.particles(displacement)[:n_owned].T
        if self.moment is not None:
            self.moment[:] = distribution.elements(arrays[MOMENT] if arrays else None)
