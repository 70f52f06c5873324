"""The external force on a particle: loads that are constant, and loads that vary in time.

A load that varies is known at two samples around the present time, and linear between them; the wind is one,
whose speed is interpolated and then squared (paper Eq. 7).
"""

from netfall.compile import part_of_kernel


@part_of_kernel
def squared_speed(p, particles, share):
    """Square [m2/s2] of the wind speed at particle p, `share` of the way between two samples."""
    speed = particles.speed_before[p] + share * (particles.speed_after[p] - particles.speed_before[p])
    return speed * speed


@part_of_kernel
def external_force(p, zero, load, wind, square):
    """External force [N] on particle p along one axis.

    zero : in the precision of the sum; square : of the wind speed [m2/s2]
    load [N], wind [N s2/m2] : (n,) of the axis, None where there is none
    """
    force = zero
    if load is not None:
        force += load[p]
    if wind is not None:
        force += wind[p] * square
    return force
