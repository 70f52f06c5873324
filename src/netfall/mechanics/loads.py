"""The external force on a particle: loads that are constant, and loads that vary in time.

What varies is known at two samples around the present time and linear between them: forces, of whatever loads
vary, as `load_before` and `load_after`; and the speed of the wind, which is squared after that (paper Eq. 7).
The samples come from `stages.varying`. The drag of parts that are cut free is that of `mechanics.air`.
"""

from netfall.ground.compile import part_of_kernel


@part_of_kernel
def wind_speed(p, particles, share):
    """Wind speed [m/s] at particle p, `share` of the way between two samples; or the pressure [N/m2]."""
    return particles.speed_before[p] + share * (particles.speed_after[p] - particles.speed_before[p])


@part_of_kernel
def squared_speed(speed, particles):
    """Square [m2/s2] of the wind speed; of pressures in time [N/m2] the pressure itself."""
    if particles.tapped is not None:
        return speed
    return speed * speed


@part_of_kernel
def external_force(p, axis, square, share):
    """External force [N] on particle p along an axis.

    axis : `motion.Axis`; square : of the wind speed [m2/s2]
    share : of the way between two samples
    """
    force = None  # no zero that costs an addition
    if axis.load is not None:
        force = axis.load[p]
    if axis.load_before is not None:
        force = plus(force, axis.load_before[p] + share * (axis.load_after[p] - axis.load_before[p]))
    if axis.wind is not None:
        force = plus(force, axis.wind[p] * square)
    if axis.drag is not None:
        force = plus(force, axis.drag[p])
    return plus(force, None)


@part_of_kernel
def plus(force, more):
    """The sum of two forces [N], of which one may be None; of none, 0."""
    if more is None:
        return 0.0 if force is None else force
    return more if force is None else force + more
