"""Forces, kick and drift over the arrays of one rank. p is a particle, e an element, s a slot.

What a scene does not have is passed as None; the compiler then drops the branch and the array with it.
Each particle sums over its own elements, which stand in its slots in ascending global number; so the sum has the
same order, and the same bits, on any number of ranks. Every element is computed at both ends, from the same
bits: twice the arithmetic, but nothing is scattered, and the loop over particles runs in vector registers.
"""

import math

import numpy as np

from netfall.mechanics.compile import kernel, vector_kernel
from netfall.mechanics.material import (
    dissipated_by_flow, elastic_force, force_density, plastic_force, stored_energy, strain)

SHORTEST_RUN = 12  # particles; below that the general loop is as fast
SLOTS = 4  # in the vector loop; particles with more elements have layers of their own


@kernel
def far_force(p, o, s, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach):
    """Force [N] on particle p of the element in its slot s, whose far end is o; and 1 if it is near flow or fracture."""
    dx, dy, dz = x[o, 0] - x[p, 0], x[o, 1] - x[p, 1], x[o, 2] - x[p, 2]
    q, near = force_density(dx, dy, dz, s, p, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
    return q * dx, q * dy, q * dz, near


@vector_kernel
def run_forces(first, last, origin, step, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach, f_int, near_of):
    """`slot_forces` of a run: particles first to last whose far ends are `step` (SLOTS,) numbers away, so that they load in one piece."""
    first, last, origin = np.uint64(first), np.uint64(last), np.uint64(origin)
    step0, step1, step2, step3 = np.uint64(step[0]), np.uint64(step[1]), np.uint64(step[2]), np.uint64(step[3])
    near = 0
    for p in range(first, last):
        ax, ay, az, a = far_force(p, p + step0, 0, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
        bx, by, bz, b = far_force(p, p + step1, 1, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
        cx, cy, cz, c = far_force(p, p + step2, 2, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
        dx, dy, dz, d = far_force(p, p + step3, 3, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
        f_int[p - origin, 0], f_int[p - origin, 1], f_int[p - origin, 2] = 0.0 + ax + bx + cx + dx, 0.0 + ay + by + cy + dy, 0.0 + az + bz + cz + dz
        if near_of is not None:
            near_of[p - origin] = a + b + c + d
            near += a + b + c + d
    return near


@vector_kernel
def slot_forces(first, last, origin, width, x, other, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach, f_int, near_of):
    """Internal forces [N] of particles first to last, to rows of f_int counted from `origin`, out; elements near yield or fracture.

    x : (n, 3) [m]; other : (slots, n) local number of the far end, the particle's own in an empty slot; inv_L0 : (slots, n) [1/m], 0: empty
    EA : [N] of all elements, unless slot_EA (slots, n) gives it; the same for yield_force [N] and slot_yield; None: elastic
    measure : None: engineering strain, else logarithmic; slot_bar : (slots, n), None: cables alone; slot_eps_p : (slots, n) plastic strain
    reach : L / L0 from which an element is looked at for fracture; width : slots in use, if more than SLOTS
    near_of : rows as f_int, out, elements of each particle that are near; None: elastic
    """
    first, last, origin = np.uint64(first), np.uint64(last), np.uint64(origin)  # unsigned: no index then counts from the end
    near = 0
    for p in range(first, last):
        fx, fy, fz = 0.0, 0.0, 0.0
        found = 0
        for s in range(SLOTS):
            qx, qy, qz, over = far_force(p, other[s, p], s, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
            found += over
            fx += qx
            fy += qy
            fz += qz
        f_int[p - origin, 0], f_int[p - origin, 1], f_int[p - origin, 2] = fx, fy, fz
        if near_of is not None:
            near_of[p - origin] = found
            near += found
    for s in range(SLOTS, width):
        for p in range(first, last):
            qx, qy, qz, over = far_force(p, other[s, p], s, x, inv_L0, EA, slot_EA, measure, slot_bar, yield_force, slot_yield, slot_eps_p, reach)
            if near_of is not None:
                near_of[p - origin] += over
                near += over
            f_int[p - origin, 0] += qx
            f_int[p - origin, 1] += qy
            f_int[p - origin, 2] += qz
    return near


@kernel
def flow(first, last, width, n_owned, first_split, x, other, inv_L0, slot_element, slot_eps_p, ends, L0, EA, logarithmic, bar, yield_force,
         eps_p, dissipated, eps_u, pending, count, near_of):
    """Plastic flow of the elements of particles first to last at x, and those that reach their fracture strain, where near_of is not 0.

    Both ends come to the same plastic strain by themselves; that which `reports` keeps the element's record.
    pending : (m,), out, elements from place `count` on; the new count
    """
    for p in range(first, last):
        if near_of[p - first] == 0:
            continue
        for s in range(max(width, SLOTS)):
            if inv_L0[s, p] == 0.0:
                continue
            e, o = slot_element[s, p], other[s, p]
            dx, dy, dz = x[o, 0] - x[p, 0], x[o, 1] - x[p, 1], x[o, 2] - x[p, 2]
            eps = strain(math.sqrt(dx * dx + dy * dy + dz * dz), L0[e], logarithmic)
            reports = ends[e, 0] == p or (n_owned <= ends[e, 0] and ends[e, 0] < first_split)
            if yield_force is not None:
                _, flowed = plastic_force(eps, slot_eps_p[s, p], EA[e], yield_force[e], bar[e])
                if flowed != slot_eps_p[s, p]:
                    if reports:
                        dissipated[e] += dissipated_by_flow(eps_p[e], flowed, L0[e], EA[e], yield_force[e], logarithmic)
                        eps_p[e] = flowed
                    slot_eps_p[s, p] = flowed
            if eps_u is not None:
                if reports and eps > eps_u[e]:
                    pending[count] = e
                    count += 1
    return count


@kernel
def find_runs(n_owned, chunk, chunk_width, other, first, last, step, chunk_run):
    """Cut the chunks of particles 0 to n_owned into runs, whose far ends are all as far away in number, and what lies between; their number.

    first, last : (runs,), out; step : (runs, SLOTS), out, distances, 0 in the first place: no run; chunk_run : (chunks + 1,), out, first run of each chunk
    """
    count = 0
    for c in range(chunk_width.shape[0]):
        chunk_run[c] = count
        low, high = c * chunk, min((c + 1) * chunk, n_owned)
        between = p = low
        while p < high:
            end = p + 1
            while end < high and (other[0, end] - end == other[0, p] - p and other[1, end] - end == other[1, p] - p
                                  and other[2, end] - end == other[2, p] - p and other[3, end] - end == other[3, p] - p):
                end += 1
            if end - p >= SHORTEST_RUN and chunk_width[c] <= SLOTS and other[0, p] != p:
                if between < p:
                    first[count], last[count], step[count, 0] = between, p, 0
                    count += 1
                first[count], last[count] = p, end
                for s in range(SLOTS):
                    step[count, s] = np.int64(other[s, p]) - p
                count += 1
                between = end
            p = end
        if between < high:
            first[count], last[count], step[count, 0] = between, high, 0
            count += 1
    chunk_run[chunk_width.shape[0]] = count
    return count


@kernel
def fill_slots(n_owned, first_split, n_local, ends, L0, EA, bar, yield_force, eps_p, other, inv_L0, slot_element, slot_EA, slot_bar, slot_yield,
               slot_eps_p, filled):
    """Put every element into a slot of each of its ends that this rank steps, in ascending order. filled : (n,), scratch."""
    for s in range(other.shape[0]):
        for p in range(n_local):
            other[s, p] = p
            inv_L0[s, p] = 0.0
    filled[:n_local] = 0
    for e in range(ends.shape[0]):
        if EA[e] == 0.0:
            continue  # another rank has kept it
        for end in range(2):
            p = ends[e, end]
            if n_owned <= p and p < first_split:
                continue
            s = filled[p]
            filled[p] += 1
            other[s, p], inv_L0[s, p] = ends[e, 1 - end], 1.0 / L0[e]
            if slot_element is not None:
                slot_element[s, p] = e
            if slot_EA is not None:
                slot_EA[s, p] = EA[e]
            if slot_bar is not None:
                slot_bar[s, p] = bar[e]
            if slot_yield is not None:
                slot_yield[s, p] = yield_force[e]
            if slot_eps_p is not None:
                slot_eps_p[s, p] = eps_p[e]


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
    return load[p, k] + wind[p, k] * squared_speed(p, speed_before, speed_after, share)


@kernel
def squared_speed(p, speed_before, speed_after, share):
    """Square [m2/s2] of the wind speed at particle p, `share` of the way between two samples."""
    speed = speed_before[p] + share * (speed_after[p] - speed_before[p])
    return speed * speed


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
