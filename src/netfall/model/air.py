"""Air on the particles of a roof (`mechanics.air`): what its damping takes hold of, and what moves along.

Damping acts along normals, on vector areas; the air that moves along, and the drag on what is cut free, are
those of the surface.
"""

from typing import NamedTuple

import numpy as np

from netfall.job.asks import air_damps, air_moves, drags
from netfall.job.job import Job
from netfall.mechanics.air import rooted
from netfall.net.net import Net
from netfall.numerics.functions import cos, sin
from netfall.roof.zones import Roof
from netfall.wind.coherence import mean_speed


class Drag(NamedTuple):
    """What the drag on parts that are cut free needs of each node.

    size : (n,) [kg/m] rho A / 2; speed : (n,) [m/s], mean wind speed; along : x, y of the wind's direction
    """

    size: np.ndarray
    speed: np.ndarray
    along: tuple[float, float]


def drag_on(job: Job, x: np.ndarray, roof: Roof) -> Drag | None:
    """Return what the drag needs, at x (n, 3) [m]; None: there is none.

    The mean speed acts where the wind is given as pressures; else the speed of the gusts does.
    """
    if not drags(job):
        return None
    wind = job.wind
    angle = wind.direction * (np.pi / 180.0)
    speed = mean_speed(x[:, 2] + wind.base_height, wind.speed or 0.0, wind.profile_exponent)
    return Drag(0.5 * wind.air_density * roof.area, speed, (float(cos(angle)), float(sin(angle))))


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
