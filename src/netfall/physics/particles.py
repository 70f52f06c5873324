"""The motion of a particle along one axis.

Central difference in half-step velocities; damping is implicit in the mean velocity:

    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a,    dt the mean of the steps before and after n
"""

from types import SimpleNamespace


def make(target) -> SimpleNamespace:
    """The functions, compiled for a target."""
    inline, fma = target.inline, target.fma

    @inline
    def between(before, after, share):
        """The value `share` of the way between two samples."""
        return fma(share, after - before, before)

    @inline
    def kicked(v, a, c_v, c_a):
        """v(n+1/2) [m/s] of v(n-1/2) and the acceleration a [m/s2]; c_v, c_a : factors of the kick."""
        return fma(c_a, a, c_v * v)

    @inline
    def moved(x, v, dt):
        """x(n+1) [m]."""
        return fma(dt, v, x)

    @inline
    def works_of_motion(mass, damped, zeta, ground, old, new, twice, duration):
        """Works [J] on the way where supports move, as factors of what the loop adds up.

        The force of the damping [N], the way against the ground [m], and the change of kinetic energy [J].
        damped : mass on which the damping acts; old, new : velocities [m/s] at the begin and the end of the
        way; twice : the mean one of the whole kick
        """
        pull = zeta * damped * fma(0.5, twice, -ground)
        way = fma(-duration, ground, duration * (0.5 * (old + new)))
        return pull, way, 0.5 * mass * fma(new, new, -(old * old))

    return SimpleNamespace(between=between, kicked=kicked, moved=moved, works_of_motion=works_of_motion)
