"""The motion of a particle and the forces on it, along one axis or as three numbers.

Central difference in half-step velocities; damping is implicit in the mean velocity:

    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a,    dt the mean of the steps before and after n
"""

from types import SimpleNamespace


def make(target) -> SimpleNamespace:
    """The functions, compiled for a target."""
    inline, fma, madd = target.inline, target.fma, target.madd

    @inline
    def dot(ax, ay, az, bx, by, bz):
        """Product of two vectors."""
        return fma(az, bz, fma(ay, by, ax * bx))

    @inline
    def between(before, after, share):
        """The value `share` of the way between two samples."""
        return madd(share, after - before, before)

    @inline
    def kicked(v, a, c_v, c_a):
        """v(n+1/2) [m/s] of v(n-1/2) and the acceleration a [m/s2]; c_v, c_a : factors of the kick."""
        return madd(c_v, v, c_a * a)

    @inline
    def off_guide(nx, ny, fx, fy):
        """Of a force in plan [N] what is across a unit vector (nx, ny), along which a support holds."""
        along = madd(nx, fx, ny * fy)
        return madd(-along, nx, fx), madd(-along, ny, fy)

    @inline
    def air_pull(size, half, cx, cy, cz, fx, fy, fz, vx, vy, vz):
        """Force of the air's damping over -c; half : kick dt / 2 mass; (fx, ..) [N] all other forces."""
        return size * fma(half, dot(cx, cy, cz, fx, fy, fz), dot(cx, cy, cz, vx, vy, vz))

    return SimpleNamespace(
        dot=dot, between=between, kicked=kicked, off_guide=off_guide, air_pull=air_pull
    )
