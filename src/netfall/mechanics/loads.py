"""The wind at a particle between two samples.

What varies is known at two samples around the present time and linear between them: forces, of whatever loads
vary, as `load_before` and `load_after`; and the speed of the wind, which is squared after that (paper Eq. 7).
The samples come from `stages.varying`. The drag of parts that are cut free is that of `mechanics.air`.
"""

from netfall.core.kernels import inner_kernel


@inner_kernel
def wind_speed(p, particles, share):
    """Wind speed [m/s] at particle p, `share` of the way between two samples; or the pressure [N/m2]."""
    return particles.speed_before[p] + share * (particles.speed_after[p] - particles.speed_before[p])
