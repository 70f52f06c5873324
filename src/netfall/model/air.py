"""Air on the particles of a roof (`mechanics.air`): what its damping takes hold of, and what moves along.

Damping acts along normals, on vector areas; the air that moves along is that of the surface.
"""

import numpy as np

from netfall.job.asks import air_damps, air_moves
from netfall.job.job import Job
from netfall.mechanics.air import rooted
from netfall.net.net import Net
from netfall.roof.zones import Roof
from netfall.wind.coherence import mean_speed


def kappa_area(job: Job, roof: Roof) -> np.ndarray:
    """kappa rho A (n, 3) [kg/m] of upward vector areas A."""
    kappa = roof.zones.spread(job.wind, "air_damping")
    return (kappa * job.wind.air_density)[:, None] * roof.vector


def damping_air(job: Job, net: Net, x: np.ndarray, roof: Roof) -> np.ndarray | None:
    """c (n, 3) of `mechanics.air` at x (n, 3) [m]; none along axes that are held. None: no air damping.

    Where the wind is given as pressures, it is for the mean speed, which is steady.
    """
    if not air_damps(job):
        return None
    vector, wind = kappa_area(job, roof), job.wind
    if wind.pressures:
        vector *= mean_speed(x[:, 2] + wind.base_height, wind.speed, wind.profile_exponent)[:, None]
    return np.where(net.fixed, 0.0, rooted(vector))


def moving_air(job: Job, roof: Roof) -> np.ndarray | None:
    """Mass (n,) [kg] of the air that moves with the surface; None: there is none."""
    return roof.zones.spread(job.load, "air_mass") * roof.area if air_moves(job) else None
