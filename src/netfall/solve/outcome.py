"""What Newton's method ends with, and how it fails."""

from typing import NamedTuple

import numpy as np

from netfall.solve.multilevel import Cycle


class Corrected(NamedTuple):
    """An equilibrium that was found: gradients : iterations of all corrections; residual : largest [N]

    moved, tension : estimated errors, shares of the largest displacement from the start and largest tension
    """

    gradients: int
    residual: float
    moved: float
    tension: float


class Begun(NamedTuple):
    """How far a net has come: gradients : iterations; size : of the last correction, as the larger of
    `moved` and `tension` of `Corrected`; cycle : approximate inverse in use, None: to be made
    """

    gradients: int = 0
    size: float = np.inf
    cycle: Cycle | None = None


AT_START = Begun()


class Stopped(Exception):
    """Newton's method was asked to stop."""


class NotFound(Exception):
    """Newton's method did not find the equilibrium."""


class Slow(NotFound):
    """Conjugate gradients did not converge: the tangent is nearly singular."""


class Falling(NotFound):
    """There are displacements (n_owned, 3), `shape`, against which the tangent has no stiffness."""

    def __init__(self, shape: np.ndarray):
        super().__init__("the tangent is not positive")
        self.shape = shape
