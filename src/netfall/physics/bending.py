"""Bending chains without rotational degrees of freedom: joints of three consecutive particles h, i, j.

With a = x_i - x_h and b = x_j - x_i, and the rotation R about a x b that turns a to the direction of b in the
state without moment (by the angle phi0):

    psi = angle from R a to b, from 0 to pi, about the axis e = R a x b / |R a x b|
    U = k psi^2 / 2,   m = k psi e        k = EI / l, l the mean of both unstressed lengths

In the plane of a chain psi = |phi - phi0|, with phi the angle from a to b, for any phi0, corners included.
|m| is the bending moment at i. The forces of the joint are -dU/db = b x m / |b|^2 at j, and likewise at h.
The section has one second moment of area.

R is fixed in space. That is exact for motion in the plane of a chain, and for chains that are straight
without moment (R = 1). Out of its plane a curved chain bends like a straight one of the same length, because
its sections cannot turn about its axis. The moments m - R^T m, which hold them, stand for the missing
torsion.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arithmetic import angle_per_sine
from netfall.core.arrays import FloatArray, IntArray, Triple
from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import Record, empty, f8, f8_2, u1, u4_2

MIN_COSINE_SUM = 1e-12  # lower bound of 1 + cos phi; it keeps the angle below pi


class Joints(Record):
    """Bending joints (k,) in ascending number: particles (k, 3) h, i, j; stiffness k (k,) [N m].

    rest : (k, 3) R, from `curvatures` of the state without moment
    owned : (k,) uint8, 1 on the one rank that counts its energy: the owner of i
    """

    particles: u4_2
    stiffness: f8
    rest: f8_2
    owned: u1

    def __init__(
        self, particles: IntArray, stiffness: FloatArray, rest: FloatArray, owned: IntArray | None = None
    ):
        """Convert the arrays to the types of the record; owned : None if unused."""
        owned = empty(u1) if owned is None else owned
        rows = np.ascontiguousarray(particles, np.uint32)
        super().__init__(rows, np.ascontiguousarray(stiffness), np.ascontiguousarray(rest), owned)


class JointTangent(NamedTuple):
    """Stiffness (k, 6, 6) [N/m] of joints against changes of (a, b); positive : without the moment terms."""

    particles: np.ndarray
    stiffness: np.ndarray
    positive: np.ndarray


@inner_kernel
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner_kernel
def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner_kernel
def _turn(g: Triple, v: Triple) -> Triple:
    """Rotate v about g by the angle whose half has the tangent |g|."""
    u = _cross(g, v)
    w, f = _cross(g, u), 2.0 / (1.0 + _dot(g, g))
    return v[0] + f * (u[0] + w[0]), v[1] + f * (u[1] + w[1]), v[2] + f * (u[2] + w[2])


@inner_kernel
def _sides(x: FloatArray, joints: Joints, k: int) -> tuple[Any, ...]:
    """Return a and b [m] of joint k at x (n, 3) [m], and the rotation vector g of its moment-free state."""
    h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
    a = (x[i, 0] - x[h, 0], x[i, 1] - x[h, 1], x[i, 2] - x[h, 2])
    b = (x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2])
    rest = joints.rest
    return a, b, (0.5 * rest[k, 0], 0.5 * rest[k, 1], 0.5 * rest[k, 2])


@inner_kernel
def _back(g: Triple) -> Triple:
    return -g[0], -g[1], -g[2]


@inner_kernel
def _half_turn(a: Triple, b: Triple) -> tuple[Triple, float]:
    """Return tan(phi / 2) n of the angle phi from a to b, with n along a x b, and |a||b| + a.b [m2]."""
    c, AB = _cross(a, b), math.sqrt(_dot(a, a)) * math.sqrt(_dot(b, b))
    d = max(AB + _dot(a, b), MIN_COSINE_SUM * AB)
    return (c[0] / d, c[1] / d, c[2] / d), d


@inner_kernel
def _turned_cross(a: Triple, b: Triple, g: Triple) -> Triple:
    """Return R a x b [m2]; it is exactly zero if g equals h = tan(phi / 2) n of a and b.

    (1 + g^2) R a x b = d [(1 - g^2) h - (1 - h^2) g] + 2 [(g.b) a + (g.a) g x b]. Both parts are linear in
    D = h - g, as h.a = h.b = 0, so no rounding error remains where terms cancel.
    """
    h, d = _half_turn(a, b)
    D = (h[0] - g[0], h[1] - g[1], h[2] - g[2])
    square, u, to_a, to_b = _dot(g, g), _cross(g, b), 2.0 * _dot(D, a), 2.0 * _dot(D, b)
    by_D, by_g = d * (1.0 - square), d * (2.0 * _dot(g, D) + _dot(D, D))
    f = 1.0 / (1.0 + square)
    return (
        f * (by_D * D[0] + by_g * g[0] - to_b * a[0] - to_a * u[0]),
        f * (by_D * D[1] + by_g * g[1] - to_b * a[1] - to_a * u[1]),
        f * (by_D * D[2] + by_g * g[2] - to_b * a[2] - to_a * u[2]),
    )


@inner_kernel
def _moment(
    joints: Joints,
    k: int,
    a: Triple,
    b: Triple,
    g: Triple,
) -> Triple:
    """Return the moment m (3,) [N m] of joint k."""
    c = _turned_cross(a, b, g)
    s = joints.stiffness[k] * angle_per_sine(math.sqrt(_dot(c, c)), _dot(_turn(g, a), b))
    return s * c[0], s * c[1], s * c[2]


@kernel
def add_bending_forces(x: FloatArray, joints: Joints, f: FloatArray) -> None:
    """Add the forces of joints at x (n, 3) [m] to the f (n, 3) [N] of their particles."""
    for k in range(joints.stiffness.shape[0]):
        h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
        a, b, g = _sides(x, joints, k)
        m = _moment(joints, k, a, b, g)
        u, v = _cross(a, _turn(_back(g), m)), _cross(m, b)
        A2, B2 = _dot(a, a), _dot(b, b)
        for axis in range(3):
            on_a, on_b = u[axis] / A2, v[axis] / B2  # dU/da, dU/db
            f[h, axis] += on_a
            f[i, axis] += on_b - on_a
            f[j, axis] -= on_b


@kernel
def joint_moments(x: Any, joints: Any, moment: Any, hold: Any) -> None:
    """Compute |m| (k,) [N m] of joints, and |m - R^T m|, the moments that hold the sections."""
    for k in range(moment.shape[0]):
        a, b, g = _sides(x, joints, k)
        m = _moment(joints, k, a, b, g)
        on_a = _turn(_back(g), m)
        t = (m[0] - on_a[0], m[1] - on_a[1], m[2] - on_a[2])
        moment[k], hold[k] = math.sqrt(_dot(m, m)), math.sqrt(_dot(t, t))


@inner_kernel
def joint_moment(x: FloatArray, joints: Joints, k: int) -> float:
    """Return the moment |m| [N m] of joint k at x (n, 3) [m]."""
    a, b, g = _sides(x, joints, k)
    m = _moment(joints, k, a, b, g)
    return math.sqrt(_dot(m, m))


@inner_kernel
def joint_energy(x: FloatArray, joints: Joints, k: int) -> float:
    """Return the energy [J] stored in joint k at x (n, 3) [m]."""
    a, b, g = _sides(x, joints, k)
    m = _moment(joints, k, a, b, g)
    return 0.5 * _dot(m, m) / joints.stiffness[k]


@kernel
def joint_tangents(x: Any, joints: Any, stiffness: Any, positive: Any) -> None:
    """Fill the (k, 6, 6) matrices of `JointTangent`: the second derivatives of U by (a, b).

    With unit vectors p along a and r along b, the axis e of psi, e' = R^T e, and Q, which turns R p to r
    about e, U has in the blocks aa, ab and bb

        k / |a|^2  [1 - pp - (1 - psi cot psi) e'e' + psi (q'p + pq')]     q' = e' x p
        -k / |a||b| [R^T Q^T - pr + (psi / sin psi - 1) e'e]
        k / |b|^2  [1 - rr - (1 - psi cot psi) ee - psi (qr + rq)]         q = e x r

    Without the terms with psi it is k |Q R dp - dr|^2 / 2, which is positive.
    """
    for k in range(joints.stiffness.shape[0]):
        a, b, g = _sides(x, joints, k)
        inverse_g, c, C = _back(g), _turned_cross(a, b, g), _dot(_turn(g, a), b)
        A, B, S = math.sqrt(_dot(a, a)), math.sqrt(_dot(b, b)), math.sqrt(_dot(c, c))
        ratio, per_sine = angle_per_sine(S, C), 1.0 / S if S > 0.0 else 0.0
        psi, axis_term, skew = ratio * S, 1.0 - ratio * C, ratio * A * B - 1.0
        cosine, sine = C / (A * B), S / (A * B)
        e = (per_sine * c[0], per_sine * c[1], per_sine * c[2])
        ea = _turn(inverse_g, e)
        p, r = (a[0] / A, a[1] / A, a[2] / A), (b[0] / B, b[1] / B, b[2] / B)
        qa, qb = _cross(ea, p), _cross(e, r)
        aa, bb = joints.stiffness[k] / (A * A), joints.stiffness[k] / (B * B)
        ab = joints.stiffness[k] / (A * B)
        for n in range(3):
            unit = (1.0 if n == 0 else 0.0, 1.0 if n == 1 else 0.0, 1.0 if n == 2 else 0.0)
            u, along = _cross(e, unit), (1.0 - cosine) * e[n]
            rotated = _turn(  # column n of R^T Q^T
                inverse_g,
                (
                    cosine * unit[0] - sine * u[0] + along * e[0],
                    cosine * unit[1] - sine * u[1] + along * e[1],
                    cosine * unit[2] - sine * u[2] + along * e[2],
                ),
            )
            for m in range(3):
                identity = 1.0 if m == n else 0.0
                base_aa, base_bb = aa * (identity - p[m] * p[n]), bb * (identity - r[m] * r[n])
                base_ab = -ab * (rotated[m] - p[m] * r[n])
                positive[k, m, n], positive[k, 3 + m, 3 + n] = base_aa, base_bb
                positive[k, m, 3 + n] = positive[k, 3 + n, m] = base_ab
                moment_aa = psi * (qa[m] * p[n] + p[m] * qa[n]) - axis_term * ea[m] * ea[n]
                moment_bb = psi * (qb[m] * r[n] + r[m] * qb[n]) + axis_term * e[m] * e[n]
                stiffness[k, m, n] = base_aa + aa * moment_aa
                stiffness[k, 3 + m, 3 + n] = base_bb - bb * moment_bb
                stiffness[k, m, 3 + n] = stiffness[k, 3 + n, m] = base_ab - ab * skew * ea[m] * e[n]


@kernel
def add_joint_stiffness(u: Any, particles: Any, stiffness: Any, force: Any) -> None:
    """Add the stiffness (k, 6, 6) [N/m] of joints times displacements u (n, 3) to force (n, 3)."""
    w = np.empty(6)
    for k in range(particles.shape[0]):
        h, i, j = particles[k, 0], particles[k, 1], particles[k, 2]
        for m in range(3):
            w[m], w[3 + m] = u[i, m] - u[h, m], u[j, m] - u[i, m]
        for m in range(3):
            on_a = on_b = 0.0
            for n in range(6):
                on_a += stiffness[k, m, n] * w[n]
                on_b += stiffness[k, 3 + m, n] * w[n]
            force[h, m] -= on_a
            force[i, m] += on_a - on_b
            force[j, m] += on_b


@kernel
def add_joint_bounds(x: Any, joints: Any, times: Any, out: Any) -> None:
    """Add `times` k |dpsi/dx|^2 of the joints at each particle to out (n,) [N/m], at x (n, 3) [m].

    |dpsi/da| is 1 / |a|. Including the terms of the moment k psi, a joint's stiffness is at most three times
    these sizes.
    """
    for k in range(joints.stiffness.shape[0]):
        h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
        a, b, g = _sides(x, joints, k)
        c = _turned_cross(a, b, g)
        S, s = math.sqrt(_dot(c, c)), times * joints.stiffness[k]
        psi = S * angle_per_sine(S, _dot(_turn(g, a), b))
        by_a, by_b = 1.0 / math.sqrt(_dot(a, a)), 1.0 / math.sqrt(_dot(b, b))
        out[h] += s * (1.0 + psi) * by_a * by_a
        out[i] += s * ((by_a + by_b) * (by_a + by_b) + psi * (by_a * by_a + by_b * by_b))
        out[j] += s * (1.0 + psi) * by_b * by_b


@kernel
def compute_curvatures(x: Any, particles: Any, curvature: Any) -> None:
    """Write 2 tan(phi / 2) n (k, 3) of joints of particles (k, 3) at x (n, 3) [m]."""
    for k in range(curvature.shape[0]):
        h, i, j = particles[k, 0], particles[k, 1], particles[k, 2]
        a = (x[i, 0] - x[h, 0], x[i, 1] - x[h, 1], x[i, 2] - x[h, 2])
        b = (x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2])
        half, _ = _half_turn(a, b)
        for axis in range(3):
            curvature[k, axis] = 2.0 * half[axis]


def curvatures(x: np.ndarray, particles: np.ndarray) -> np.ndarray:
    """Return 2 tan(phi / 2) n (k, 3) of joints of particles (k, 3) at x (n, 3) [m]; phi n turns a to b."""
    curvature = np.empty((len(particles), 3))
    compute_curvatures(np.asfortranarray(x), particles.astype(np.uint32), curvature)
    return curvature
