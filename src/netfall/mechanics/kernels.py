"""Forces, kick and drift over the arrays of one rank. p is a particle, e an element, s a slot.

What a scene does not have is passed as None; the compiler then drops the branch and the array with it.
Each particle sums over its own elements, which stand in its slots in ascending global number; so the sum has the
same order, and the same bits, on any number of ranks. Every element is computed at both ends, from the same
bits: twice the arithmetic, but nothing is scattered, and the loop over particles runs in vector registers.
"""

import math
from typing import NamedTuple

import numpy as np

from netfall.mechanics.arithmetic import fused, like
from netfall.mechanics.compile import allocating_kernel, kernel, part_of_kernel, vector_kernel
from netfall.mechanics.material import (
    dissipated_by_flow,
    elastic_force,
    force_density,
    plastic_force,
    stored_energy,
    strain,
)

REGISTER = 64  # bytes of the widest registers
FEWEST = 3  # particles that are worth a register of their own
MANY_LOOSE = 8  # one particle in so many outside the whole runs of a chunk: then the kick goes through all of it at once
SLOTS = 4  # in the vector loop; particles with more elements have layers of their own
EMPTY = np.uint32(0xFFFFFFFF)  # in place of an element's number


class Runs(NamedTuple):
    """How the vector loop goes through the particles of each chunk. A run's far ends are all as far away in number, so they load in one piece.

    lanes : particles that a register takes at once
    spans : (chunks, 8) from and up to which row of each of the next four
    whole : (., 2 + SLOTS) first and last particle of runs, a multiple of lanes apart, and how far away the far ends are
    parts : (., 4 + SLOTS) what remains of runs, or all of one: first and last particle, a multiple of lanes apart; from and up to
        which of them it is the run; and how far away the far ends are
    rest : (.,) particles in no run, the last of a chunk repeated up to a multiple of lanes
    loose : (., 2) first and last particle of stretches outside the whole runs, whose kick comes after all forces; the whole chunk where
        it has many
    """

    lanes: int
    spans: np.ndarray
    whole: np.ndarray
    parts: np.ndarray
    rest: np.ndarray
    loose: np.ndarray


@part_of_kernel
def add_force(
    p,
    o,
    s,
    fx,
    fy,
    fz,
    near,
    x,
    start,
    inv_L0,
    EA,
    slot_EA,
    measure,
    slot_bar,
    yield_force,
    slot_yield,
    slot_eps_p,
    reach,
):
    """Forces [N] on particle p so far, and those of the element in its slot s, whose far end is o; near: whether one is near flow or fracture."""
    dx, dy, dz = x[0][o] - x[0][p], x[1][o] - x[1][p], x[2][o] - x[2][p]
    if start is None:
        q, found = force_density(
            dx,
            dy,
            dz,
            None,
            s,
            p,
            inv_L0,
            EA,
            slot_EA,
            measure,
            slot_bar,
            yield_force,
            slot_yield,
            slot_eps_p,
            reach,
        )
        return (
            like(fx, fused(q, dx, fx)),
            like(fx, fused(q, dy, fy)),
            like(fx, fused(q, dz, fz)),
            near | found,
        )
    # of displacements: L^2 - L_start^2 = (d - d_start) (d + d_start), to their own last digits
    sx, sy, sz, per_L0 = start[0][s, p], start[1][s, p], start[2][s, p], inv_L0[s, p]
    ux, uy, uz = like(sx, dx), like(sy, dy), like(sz, dz)
    ex, ey, ez = sx + ux, sy + uy, sz + uz
    excess = fused(fused(uz, ez + sz, fused(uy, ey + sy, ux * (ex + sx))), per_L0 * per_L0, start[3][s, p])
    q, found = force_density(
        ex,
        ey,
        ez,
        excess,
        s,
        p,
        inv_L0,
        EA,
        slot_EA,
        measure,
        slot_bar,
        yield_force,
        slot_yield,
        slot_eps_p,
        reach,
    )
    return fused(q, ex, fx), fused(q, ey, fy), fused(q, ez, fz), near | found


@part_of_kernel
def four_forces(
    p,
    o0,
    o1,
    o2,
    o3,
    x,
    start,
    inv_L0,
    EA,
    slot_EA,
    measure,
    slot_bar,
    yield_force,
    slot_yield,
    slot_eps_p,
    reach,
):
    """Sum of the forces [N] of the first four slots of particle p, with far ends o0 to o3, in this order; and whether one is near flow or fracture."""
    none = like(inv_L0, 0.0)
    fx, fy, fz, near = add_force(
        p,
        o0,
        0,
        none,
        none,
        none,
        False,
        x,
        start,
        inv_L0,
        EA,
        slot_EA,
        measure,
        slot_bar,
        yield_force,
        slot_yield,
        slot_eps_p,
        reach,
    )
    fx, fy, fz, near = add_force(
        p,
        o1,
        1,
        fx,
        fy,
        fz,
        near,
        x,
        start,
        inv_L0,
        EA,
        slot_EA,
        measure,
        slot_bar,
        yield_force,
        slot_yield,
        slot_eps_p,
        reach,
    )
    fx, fy, fz, near = add_force(
        p,
        o2,
        2,
        fx,
        fy,
        fz,
        near,
        x,
        start,
        inv_L0,
        EA,
        slot_EA,
        measure,
        slot_bar,
        yield_force,
        slot_yield,
        slot_eps_p,
        reach,
    )
    return add_force(
        p,
        o3,
        3,
        fx,
        fy,
        fz,
        near,
        x,
        start,
        inv_L0,
        EA,
        slot_EA,
        measure,
        slot_bar,
        yield_force,
        slot_yield,
        slot_eps_p,
        reach,
    )


@part_of_kernel
def kick_axis(
    p, i, internal, square, kick_dt, c_v, c_a, zeta, v, f, per_mass, free, mass, load, wind, work_ext
):
    """Kick of particle p along one axis under its internal force [N] and the external one; total force to row i of f.

    load, wind : of this axis, None where there is none. Returns the work [J] of the external, internal and damping forces
    """
    external = like(internal, 0.0)
    if load is not None:
        external += load[p]
    if wind is not None:
        external += wind[p] * square
    total = internal + external
    f[i] = total
    old = v[p]
    new = kick(old, total * per_mass[p], c_v, c_a)  # v to n + 1/2
    if free is not None:
        new = new if free[p] else old
    v[p] = new
    if work_ext is None:
        return external, external, external  # of no use
    mean = like(old, 0.5) * (old + new)
    way = kick_dt * mean  # zero where held
    return way * external, way * internal, way * (zeta * mass[p] * mean)


@part_of_kernel
def kick_particle(
    p,
    i,
    fx,
    fy,
    fz,
    kick_dt,
    c_v,
    c_a,
    zeta,
    share,
    v,
    f,
    per_mass,
    free,
    mass,
    load,
    work_ext,
    work_int,
    work_damp,
    wind,
    speed_before,
    speed_after,
):
    """Kick and work of particle p under its internal forces [N] and the external ones; total force to row i of f."""
    square = like(per_mass, 0.0)
    if speed_before is not None:
        square = squared_speed(p, speed_before, speed_after, share)
    ax, bx, cx = kick_axis(
        p,
        i,
        fx,
        square,
        kick_dt,
        c_v,
        c_a,
        zeta,
        v[0],
        f[0],
        per_mass,
        free[0],
        mass,
        load[0],
        wind[0],
        work_ext,
    )
    ay, by, cy = kick_axis(
        p,
        i,
        fy,
        square,
        kick_dt,
        c_v,
        c_a,
        zeta,
        v[1],
        f[1],
        per_mass,
        free[1],
        mass,
        load[1],
        wind[1],
        work_ext,
    )
    az, bz, cz = kick_axis(
        p,
        i,
        fz,
        square,
        kick_dt,
        c_v,
        c_a,
        zeta,
        v[2],
        f[2],
        per_mass,
        free[2],
        mass,
        load[2],
        wind[2],
        work_ext,
    )
    if work_ext is not None:
        work_ext[p] = work_ext[p] + ax + ay + az
        work_int[p] = work_int[p] + bx + by + bz
        work_damp[p] = work_damp[p] + cx + cy + cz


@vector_kernel
def kick_rows(
    c,
    low,
    width,
    runs,
    f_rest,
    near_rest,
    kick_dt,
    zeta,
    share,
    x,
    v,
    f,
    near_of,
    per_mass,
    free,
    mass,
    load,
    work_ext,
    work_int,
    work_damp,
    wind,
    speed_before,
    speed_after,
    other,
    start,
    inv_L0,
    EA,
    slot_EA,
    measure,
    slot_bar,
    yield_force,
    slot_yield,
    slot_eps_p,
    reach,
):
    """Forces, kick and work of the particles of chunk c, from `low` on.

    Three arrays for three axes stand in a tuple: then the compiler sees that nothing written is read again.
    runs : `Runs`; f_rest, near_rest : scratch; width : slots in use, if more than SLOTS
    x : (n,) [m], positions, or displacements where start is not None; v : (n,) [m/s]; f : rows counted from `low`, out, total force [N]; near_of : rows as f, out, 1 where an element
        of the particle is near, None: elastic
    free : (n,) each, None where every particle is free or held on all axes (per_mass = 0)
    other : (slots, n) local number of the far end, the particle's own or any in an empty slot; inv_L0 : (slots, n) [1/m], 0: empty
    start : four of (slots, n), the differences [m] to the far end from which displacements count, and (L / L0)^2 - 1 there; None: x are positions
    EA : [N] of all elements, unless slot_EA (slots, n) gives it; the same for yield_force [N] and slot_yield; None: elastic
    measure : None: engineering strain, else logarithmic; slot_bar : (slots, n), None: cables alone
    slot_eps_p : (slots, n) plastic strain, None: zero; reach : L / L0 from which an element is looked at for fracture
    """
    origin = np.uint64(low)  # unsigned: no index then counts from the end
    lanes, spans, whole, parts, rest, loose = runs
    c_v, c_a = kick_factors(zeta, kick_dt)
    c_v, c_a, kick_dt, zeta, share = (
        like(v[0], c_v),
        like(v[0], c_a),
        like(v[0], kick_dt),
        like(v[0], zeta),
        like(v[0], share),
    )
    for r in range(spans[c, 0], spans[c, 1]):
        s0, s1, s2, s3 = (
            np.uint64(whole[r, 2]),
            np.uint64(whole[r, 3]),
            np.uint64(whole[r, 4]),
            np.uint64(whole[r, 5]),
        )
        for p in range(np.uint64(whole[r, 0]), np.uint64(whole[r, 1])):
            i = p - origin
            fx, fy, fz, found = four_forces(
                p,
                p + s0,
                p + s1,
                p + s2,
                p + s3,
                x,
                start,
                inv_L0,
                EA,
                slot_EA,
                measure,
                slot_bar,
                yield_force,
                slot_yield,
                slot_eps_p,
                reach,
            )
            if near_of is not None:
                near_of[i] = 1 if found else 0
            kick_particle(
                p,
                i,
                fx,
                fy,
                fz,
                kick_dt,
                c_v,
                c_a,
                zeta,
                share,
                v,
                f,
                per_mass,
                free,
                mass,
                load,
                work_ext,
                work_int,
                work_damp,
                wind,
                speed_before,
                speed_after,
            )
    for r in range(spans[c, 2], spans[c, 3]):
        s0, s1, s2, s3 = (
            np.uint64(parts[r, 4]),
            np.uint64(parts[r, 5]),
            np.uint64(parts[r, 6]),
            np.uint64(parts[r, 7]),
        )
        from_, up_to = np.uint64(parts[r, 2]), np.uint64(parts[r, 3])
        for p in range(np.uint64(parts[r, 0]), np.uint64(parts[r, 1])):
            i = p - origin
            mine = (p >= from_) & (p < up_to)
            fx, fy, fz, found = four_forces(
                p,
                p + s0,
                p + s1,
                p + s2,
                p + s3,
                x,
                start,
                inv_L0,
                EA,
                slot_EA,
                measure,
                slot_bar,
                yield_force,
                slot_yield,
                slot_eps_p,
                reach,
            )
            f[0][i], f[1][i], f[2][i] = (
                fx if mine else f[0][i],
                fy if mine else f[1][i],
                fz if mine else f[2][i],
            )
            if near_of is not None:
                near_of[i] = (1 if found else 0) if mine else near_of[i]
    first, last = np.uint64(spans[c, 4]), np.uint64(spans[c, 5])
    filled_up = first + np.uint64((spans[c, 5] - spans[c, 4] + lanes - 1) // lanes * lanes)
    for i in range(first, filled_up):
        p, k = rest[i], i - first
        f_rest[0][k], f_rest[1][k], f_rest[2][k], found = four_forces(
            p,
            other[0, p],
            other[1, p],
            other[2, p],
            other[3, p],
            x,
            start,
            inv_L0,
            EA,
            slot_EA,
            measure,
            slot_bar,
            yield_force,
            slot_yield,
            slot_eps_p,
            reach,
        )
        near_rest[k] = 1 if found else 0
    for s in range(SLOTS, width):
        for i in range(first, last):
            p, k = rest[i], i - first
            f_rest[0][k], f_rest[1][k], f_rest[2][k], found = add_force(
                p,
                other[s, p],
                s,
                f_rest[0][k],
                f_rest[1][k],
                f_rest[2][k],
                near_rest[k] != 0,
                x,
                start,
                inv_L0,
                EA,
                slot_EA,
                measure,
                slot_bar,
                yield_force,
                slot_yield,
                slot_eps_p,
                reach,
            )
            near_rest[k] = 1 if found else 0
    for i in range(first, last):
        k, row = i - first, rest[i] - origin
        f[0][row], f[1][row], f[2][row] = f_rest[0][k], f_rest[1][k], f_rest[2][k]
        if near_of is not None:
            near_of[row] = near_rest[k]
    for r in range(spans[c, 6], spans[c, 7]):
        for p in range(np.uint64(loose[r, 0]), np.uint64(loose[r, 1])):
            i = p - origin
            kick_particle(
                p,
                i,
                f[0][i],
                f[1][i],
                f[2][i],
                kick_dt,
                c_v,
                c_a,
                zeta,
                share,
                v,
                f,
                per_mass,
                free,
                mass,
                load,
                work_ext,
                work_int,
                work_damp,
                wind,
                speed_before,
                speed_after,
            )


@vector_kernel
def count_near(near_of, particles):
    """How many of the first so many particles of a chunk have an element near yield or fracture."""
    near = 0
    for i in range(np.uint64(particles)):
        near += near_of[i]
    return near


@kernel
def flow(
    first,
    last,
    width,
    n_owned,
    first_split,
    x,
    x_start,
    other,
    inv_L0,
    slot_element,
    slot_eps_p,
    ends,
    L0,
    EA,
    logarithmic,
    bar,
    yield_force,
    eps_p,
    dissipated,
    eps_u,
    pending,
    count,
    near_of,
):
    """Plastic flow of the elements of particles first to last at x, and those that reach their fracture strain, where near_of is not 0.

    Both ends come to the same plastic strain by themselves; that which `reports` keeps the element's record.
    x : (n, 3) positions [m], or displacements from x_start, which is None otherwise
    pending : (m,), out, elements from place `count` on; the new count, and whether anything flowed
    """
    any_flow = False
    for p in range(first, last):
        if near_of[p - first] == 0:
            continue
        for s in range(max(width, SLOTS)):
            if inv_L0[s, p] == 0.0:
                continue
            e, o = slot_element[s, p], other[s, p]
            dx, dy, dz = (
                np.float64(x[o, 0]) - x[p, 0],
                np.float64(x[o, 1]) - x[p, 1],
                np.float64(x[o, 2]) - x[p, 2],
            )
            if x_start is not None:
                dx, dy, dz = (
                    dx + (x_start[o, 0] - x_start[p, 0]),
                    dy + (x_start[o, 1] - x_start[p, 1]),
                    dz + (x_start[o, 2] - x_start[p, 2]),
                )
            eps = strain(math.sqrt(dx * dx + dy * dy + dz * dz), L0[e], logarithmic)
            reports = ends[e, 0] == p or (n_owned <= ends[e, 0] and ends[e, 0] < first_split)
            if yield_force is not None:
                _, flowed = plastic_force(eps, np.float64(slot_eps_p[s, p]), EA[e], yield_force[e], bar[e])
                flowed = np.float64(like(slot_eps_p, flowed))
                if flowed != slot_eps_p[s, p]:
                    any_flow = True
                    if reports:
                        dissipated[e] += dissipated_by_flow(
                            eps_p[e], flowed, L0[e], EA[e], yield_force[e], logarithmic
                        )
                        eps_p[e] = flowed
                    slot_eps_p[s, p] = flowed
            if eps_u is not None:
                if reports and eps > eps_u[e]:
                    pending[count] = e
                    count += 1
    return count, any_flow


@kernel
def attach_slots(n_owned, first_split, n_local, ends, EA, other, slot_element, filled):
    """Put every element into a slot of each of its ends that this rank steps, in ascending order.

    other : (slots, n), out, far ends, the particle's own in an empty slot; slot_element : (slots, n), out, EMPTY there
    filled : (n,), out, slots in use, the first ones
    """
    for s in range(other.shape[0]):
        for p in range(n_local):
            other[s, p], slot_element[s, p] = p, EMPTY
    filled[:n_local] = 0
    for e in range(ends.shape[0]):
        if EA[e] == 0.0:
            continue  # another rank has kept it, or it is out of the net
        for end in range(2):
            p = ends[e, end]
            if n_owned <= p and p < first_split:
                continue
            other[filled[p], p], slot_element[filled[p], p] = ends[e, 1 - end], e
            filled[p] += 1


@allocating_kernel
def align_slots(first, last, direction, n_local, other, slot_element, filled):
    """Move the empty slots of particles first to last (counted in `direction`, 1 or -1) so that far ends are as far away in number as their predecessor's.

    So a run goes on where a particle lacks an element that its neighbour has: an empty slot may name any particle, and adds zero.
    The elements keep their order. slot_element : (slots, n), EMPTY in empty slots
    """
    far, mine = np.empty(SLOTS, np.int64), np.empty(SLOTS, np.uint32)
    for p in range(first, last, direction):
        if filled[p] > SLOTS or filled[p - direction] > SLOTS:
            continue
        k, placed, fits = 0, 0, True
        for s in range(SLOTS):
            far[s] = np.int64(other[s, p - direction]) + direction
            fits &= 0 <= far[s] and far[s] < n_local
            while k < SLOTS and slot_element[k, p] == EMPTY:
                k += 1
            mine[s] = EMPTY
            if k < SLOTS and np.int64(other[k, p]) == far[s]:
                mine[s] = slot_element[k, p]
                placed += 1
                k += 1
        if fits and placed == filled[p]:
            for s in range(SLOTS):
                other[s, p], slot_element[s, p] = far[s], mine[s]


@kernel
def fill_slots(
    n_local,
    slot_element,
    L0,
    EA,
    bar,
    yield_force,
    eps_p,
    x_start,
    other,
    start,
    inv_L0,
    slot_EA,
    slot_bar,
    slot_yield,
    slot_eps_p,
):
    """What the vector loop reads of each element, at both of its ends; inv_L0 = 0 in an empty slot.

    start : as in `kick_rows`, out, of the positions x_start (n, 3); None where it is
    """
    for s in range(inv_L0.shape[0]):
        for p in range(n_local):
            e = slot_element[s, p]
            if e == EMPTY:
                inv_L0[s, p] = 0.0
                if slot_bar is not None:
                    slot_bar[s, p] = 0
                if start is not None:
                    start[0][s, p] = start[1][s, p] = start[2][s, p] = start[3][s, p] = 0.0
                continue
            inv_L0[s, p] = 1.0 / L0[e]
            if start is not None:
                o = other[s, p]
                dx, dy, dz = (
                    x_start[o, 0] - x_start[p, 0],
                    x_start[o, 1] - x_start[p, 1],
                    x_start[o, 2] - x_start[p, 2],
                )
                L = math.sqrt(dx * dx + dy * dy + dz * dz)
                start[0][s, p], start[1][s, p], start[2][s, p] = dx, dy, dz
                start[3][s, p] = (L - L0[e]) * (L + L0[e]) / (L0[e] * L0[e])
            if slot_EA is not None:
                slot_EA[s, p] = EA[e]
            if slot_bar is not None:
                slot_bar[s, p] = bar[e]
            if slot_yield is not None:
                slot_yield[s, p] = yield_force[e]
            if slot_eps_p is not None:
                slot_eps_p[s, p] = eps_p[e]


@kernel
def empty_slots(e, p, slot_element, start, inv_L0, slot_bar):
    """Leave the slot of element e at particle p empty, where it is; runs stay as they are."""
    for s in range(inv_L0.shape[0]):
        if slot_element[s, p] == e:
            slot_element[s, p], inv_L0[s, p] = EMPTY, 0.0
            if slot_bar is not None:
                slot_bar[s, p] = 0
            if start is not None:
                start[0][s, p] = start[1][s, p] = start[2][s, p] = start[3][s, p] = 0.0


@kernel
def end_of_run(p, high, other):
    """The first particle after p, at most `high`, whose far ends are not as far away in number as those of p."""
    end = p + 1
    while end < high and (
        other[0, end] - end == other[0, p] - p
        and other[1, end] - end == other[1, p] - p
        and other[2, end] - end == other[2, p] - p
        and other[3, end] - end == other[3, p] - p
    ):
        end += 1
    return end


@kernel
def kick_at_once(low, high, width, lanes, other):
    """Whether so few particles of a chunk are in whole runs that the kick had better go through all of it, after the forces."""
    outside, p = high - low, low
    while p < high and width <= SLOTS:
        end = end_of_run(p, high, other)
        outside -= (end - p) // lanes * lanes
        p = end
    return outside * MANY_LOOSE > high - low


@kernel
def find_runs(chunk_low, chunk_high, chunk_width, other, lanes, spans, whole, parts, rest, loose):
    """Write the `Runs` of the chunks, whose arrays have room for the most there could be.

    other : (slots, n) local number of the far end
    """
    wholes = partials = rests = stretches = 0
    for c in range(chunk_width.shape[0]):
        low, high = chunk_low[c], chunk_high[c]
        at_once = kick_at_once(low, high, chunk_width[c], lanes, other)
        spans[c, 0], spans[c, 2], spans[c, 4], spans[c, 6] = wholes, partials, rests, stretches
        p = covered = low  # covered: where the last whole run ends
        while p < high:
            end = end_of_run(p, high, other)
            left = p  # so far in nothing
            if not at_once and end - p >= lanes:
                left = end - (end - p) % lanes
                whole[wholes, 0], whole[wholes, 1] = p, left
                for s in range(SLOTS):
                    whole[wholes, 2 + s] = np.int64(other[s, p]) - p
                wholes += 1
                if covered < p:
                    loose[stretches, 0], loose[stretches, 1] = covered, p
                    stretches += 1
                covered = left
            length = (end - left + lanes - 1) // lanes * lanes
            begin = min(left, high - length)
            fits = end - left >= FEWEST and begin >= low and chunk_width[c] <= SLOTS
            for s in range(SLOTS):
                far = begin + np.int64(other[s, p]) - p
                fits &= 0 <= far and far + length <= other.shape[1]
            if fits:
                parts[partials, 0], parts[partials, 1], parts[partials, 2], parts[partials, 3] = (
                    begin,
                    begin + length,
                    left,
                    end,
                )
                for s in range(SLOTS):
                    parts[partials, 4 + s] = np.int64(other[s, p]) - p
                partials += 1
                left = end
            for p in range(left, end):
                rest[rests] = p
                rests += 1
            p = end
        if covered < high:
            loose[stretches, 0], loose[stretches, 1] = covered, high
            stretches += 1
        spans[c, 1], spans[c, 3], spans[c, 5], spans[c, 7] = wholes, partials, rests, stretches
        while rests % lanes > 0:
            rest[rests] = rest[rests - 1]
            rests += 1


@kernel
def element_state(x, ends, L0, EA, logarithmic, bar, yield_force, eps_p, N, eps, eps_p_now, L):
    """Force, strain, plastic strain and length of each element at x, changing nothing else.

    N : (m,) [N], eps : (m,), eps_p_now : (m,), L : (m,) [m], out; the other arguments are the fields of `State`
    """
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        L[e] = math.sqrt(dx * dx + dy * dy + dz * dz)
        if EA[e] == 0.0:  # out of the net: how far its ends are apart is no strain
            N[e], eps[e], eps_p_now[e] = 0.0, 0.0, 0.0 if yield_force is None else eps_p[e]
            continue
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
def add_stiffness(u, ends, direction, axial, transverse, force):
    """Add to force (n, 3) what elements answer to displacements u (n, 3) with, along their direction (m, 3) and across it; axial, transverse : (m,) [N/m]."""
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        along = 0.0
        for k in range(3):
            along += (u[b, k] - u[a, k]) * direction[e, k]
        for k in range(3):
            d = transverse[e] * (u[b, k] - u[a, k]) + (axial[e] - transverse[e]) * along * direction[e, k]
            force[b, k] += d
            force[a, k] -= d


@kernel
def element_energies(N, eps_p_now, L0, EA, logarithmic, yield_force, eps_p, dissipated, stored, heat):
    """Stored and dissipated energy (m,) [J] of each element, for the state of `element_state`."""
    for e in range(N.shape[0]):
        stored[e] = stored_energy(N[e], eps_p_now[e], L0[e], EA[e], logarithmic)
        heat[e] = 0.0 if dissipated is None else dissipated[e]
        if yield_force is not None and EA[e] > 0.0:
            heat[e] += dissipated_by_flow(eps_p[e], eps_p_now[e], L0[e], EA[e], yield_force[e], logarithmic)


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


@part_of_kernel
def squared_speed(p, speed_before, speed_after, share):
    """Square [m2/s2] of the wind speed at particle p, `share` of the way between two samples."""
    speed = speed_before[p] + share * (speed_after[p] - speed_before[p])
    return speed * speed


@kernel
def kick_factors(zeta, dt):
    """Factors c_v, c_a of `kick` for a kick of length dt [s] and damping zeta [1/s]."""
    h = 0.5 * zeta * dt
    return (1.0 - h) / (1.0 + h), dt / (1.0 + h)


@part_of_kernel
def kick(v, a, c_v, c_a):
    """Velocity [m/s] v(n+1/2) of v(n-1/2) and acceleration a [m/s2], with the mean velocity in the damping.

    (1 + zeta dt/2) v(n+1/2) = (1 - zeta dt/2) v(n-1/2) + dt a
    """
    return c_v * v + c_a * a


@kernel
def inverse_mass(mass):
    """1 / mass [1/kg]; 0 for a particle left without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
