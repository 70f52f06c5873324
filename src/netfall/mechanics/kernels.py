"""Forces, kick and drift over the arrays of one rank. p is a particle, e an element.

What a scene does not have is passed as None; the compiler then drops the branch and the array with it.
Elements stand in ascending global number and each adds to its two ends in turn, so the sum on a particle has
the same order, and the same bits, on any number of ranks.
"""

import math

from netfall.mechanics.compile import kernel
from netfall.mechanics.material import (
    dissipated_by_flow, elastic_force, plastic_force, stored_energy, strain)


@kernel
def element_forces(x, ends, L0, EA, logarithmic, bar, yield_force, eps_p, dissipated, eps_u, pending, f_int):
    """Add the elements' forces to their ends; the number of elements that reach their fracture strain.

    x : (n, 3) [m]; ends : (m, 2) local particle numbers; L0 : (m,) [m]; EA : (m,) [N]; bar : (m,) 0 or 1
    yield_force : (m,) [N], eps_p : (m,), dissipated : (m,) [J], in and out; None: elastic
    eps_u : (m,) fracture strain, None: nothing breaks; pending : (m,), out, elements that reach it
    f_int : (n, 3) [N], in and out
    """
    count = 0
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        L = math.sqrt(dx * dx + dy * dy + dz * dz)
        eps = strain(L, L0[e], logarithmic)
        if yield_force is None:
            N = elastic_force(eps, EA[e], bar[e])
        else:
            N, flowed = plastic_force(eps, eps_p[e], EA[e], yield_force[e], bar[e])
            if flowed != eps_p[e]:
                dissipated[e] += dissipated_by_flow(eps_p[e], flowed, L0[e], EA[e], yield_force[e], logarithmic)
                eps_p[e] = flowed
        if eps_u is not None:
            if eps > eps_u[e]:
                pending[count] = e
                count += 1
        q = N / L if L > 0.0 else 0.0  # without a length there is no direction
        f_int[a, 0] += q * dx
        f_int[a, 1] += q * dy
        f_int[a, 2] += q * dz
        f_int[b, 0] -= q * dx
        f_int[b, 1] -= q * dy
        f_int[b, 2] -= q * dz
    return count


@kernel
def element_state(x, ends, L0, EA, logarithmic, bar, yield_force, eps_p, N, eps, eps_p_now, L):
    """Force, strain, plastic strain and length of each element at x, changing nothing else.

    N : (m,) [N], eps : (m,), eps_p_now : (m,), L : (m,) [m], out; the other arguments as in `element_forces`
    """
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        L[e] = math.sqrt(dx * dx + dy * dy + dz * dz)
        eps[e] = strain(L[e], L0[e], logarithmic)
        if yield_force is None:
            N[e] = elastic_force(eps[e], EA[e], bar[e])
            eps_p_now[e] = 0.0
        else:
            N[e], eps_p_now[e] = plastic_force(eps[e], eps_p[e], EA[e], yield_force[e], bar[e])


@kernel
def add_tensions(x, ends, N, L, f_int):
    """Add given axial forces N (m,) [N] at lengths L (m,) [m] to the particles' f_int (n, 3) [N]."""
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        q = N[e] / L[e] if L[e] > 0.0 else 0.0
        for k in range(3):
            d = q * (x[b, k] - x[a, k])
            f_int[a, k] += d
            f_int[b, k] -= d


@kernel
def element_energies(N, eps_p_now, L0, EA, logarithmic, yield_force, eps_p, dissipated, stored, heat):
    """Stored and dissipated energy (m,) [J] of each element, for the state of `element_state`."""
    for e in range(N.shape[0]):
        stored[e] = stored_energy(N[e], eps_p_now[e], L0[e], EA[e], logarithmic)
        if yield_force is None:
            heat[e] = 0.0
        else:
            heat[e] = dissipated[e] + dissipated_by_flow(eps_p[e], eps_p_now[e], L0[e], EA[e], yield_force[e], logarithmic)


@kernel
def external_force(p, k, load, wind, speed_before, speed_after, share):
    """Component k of the external force [N] on particle p: load and wind.

    load : (n, 3) [N], constant
    wind : (n, 3) [N s2/m2], force at 1 m/s; None: no wind. Its speed lies between two samples of the history,
        speed_before and speed_after (n,) [m/s], at `share` of the way
    """
    if wind is None:
        return load[p, k]
    speed = speed_before[p] + share * (speed_after[p] - speed_before[p])
    return load[p, k] + wind[p, k] * (speed * speed)


@kernel
def kick_factors(zeta, dt):
    """Factors c_v, c_a of `kick` for a kick of length dt [s] and damping zeta [1/s]."""
    h = 0.5 * zeta * dt
    return (1.0 - h) / (1.0 + h), dt / (1.0 + h)


@kernel
def kick(v, a, c_v, c_a):
    """Velocity [m/s] v(n+1/2) of v(n-1/2) and acceleration a [m/s2], with the mean velocity in the damping.

    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a
    """
    return c_v * v + c_a * a


@kernel
def inverse_mass(mass):
    """1 / mass [1/kg]; 0 for a particle left without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
