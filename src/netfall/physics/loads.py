"""Wind at a particle between two samples.

Time-dependent loads are known at two samples around the present time and linear between them. Forces are in
`load_before` and `load_after`. The wind speed is interpolated and then squared (paper Eq. 7). The samples
come from `driver.varying_loads`. `physics.air` has the drag on detached parts.
"""

from netfall.core.kernels import inner_kernel
from netfall.physics.fields import Particles


@inner_kernel
def wind_speed(p: int, particles: Particles, share: float) -> float:
    """Return the wind speed [m/s] at particle p, interpolated by `share`; or the pressure [N/m2]."""
    return particles.speed_before[p] + share * (particles.speed_after[p] - particles.speed_before[p])
