"""History rows, computed within the time loop and buffered until Python collects them.

If rows are far apart, the envelope is also updated between them, so that it does not depend on their spacing.

A row stores all values of its step. Contributions to global sums stay in exact parts (limbs) until the
rows are collected (`explicit.rows`). So the bits of a row do not depend on when that happens.
"""

import math
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray, Integer
from netfall.core.kernels import call, copied_kernel, inner_kernel, kernel, part_of_kernel, routine
from netfall.core.records import Record, f8, f8_2, i8, i8_2, i8_3, is_present, real, whole
from netfall.core.threads import agree, each, leads, meet
from netfall.core.vectors import bits_of, number_of
from netfall.explicit.energy_check import ObservationArrays, ObservedState
from netfall.explicit.motion import total_forces
from netfall.physics.bending import joint_moment
from netfall.physics.elements import ElementState
from netfall.physics.fields import Elements

REPORTED_STRAIN = 0.1  # strain; a larger one without a fracture strain is reported
NO_BENDING = -2  # joint number of elements without bending, as in `geometry.cables`
INFINITE = np.int64(0x7FF) << 52  # bits of infinity; as integers the bits of nan are larger
SIZE = np.int64(0x7FFFFFFFFFFFFFFF)  # all bits but the sign


class Table(Record):
    """Computed rows of this rank that are not yet collected, (k, ...) each.

    number : of the step; time_step : [s] the one before; slack : number of slack cables; sums : (k, s, LIMBS)
    probes : (k, p) displacements [m] and tensions [N], 0 if another rank has them; then slip values
    size, who : (k, 3) largest speed [m/s], largest strain, and largest strain beyond REPORTED_STRAIN of
        elements that never break, with the global numbers of the particle and the elements; -1: none
    """

    number: i8
    time_step: f8
    slack: i8
    sums: i8_3
    probes: f8_2
    size: f8_2
    who: i8_2


class LocalProbes(Record):
    """Probes of this rank: rows of particles and elements, and the columns of their values.

    slip, difference : (points,) columns of slips and of tension differences across slip points; absent: none
    """

    particle: i8
    particle_place: i8
    element: i8
    element_place: i8
    slip: i8
    difference: i8


class Rows(Record):
    """Schedule of the rows and the arrays they are computed from.

    due : (rows,) step numbers of all rows of the stage; dt : [s] length of the steps as counted
    made : (2,) rows made so far, and rows now in the table
    every : counted steps after which the envelope is updated if no row is made
    last : (1,) number of the step of the last envelope update
    element_gid : (m,); joint_at : (m, 2) joints at both ends of elements, as in `State`
    tension : (4, m), displacement : (2, n_owned), moment : (m,), reaction : (15, h), as in `explicit.rows`
    supports : (h,) rows of the particles with a support, ascending
    support_at : (n_owned,) support of each particle whose forces of each step are recorded, otherwise -1
    second : (3, n) [m] second position array of the loop
    include_reaction : address of this routine
    update_moments : address of this routine; 0 without moments
    """

    due: i8
    dt: real
    made: i8
    every: whole
    last: i8
    element_gid: i8
    tension: f8_2
    displacement: f8_2
    moment: f8
    supports: i8
    support_at: i8
    second: f8_2
    reaction: f8_2
    include_reaction: whole
    update_moments: whole
    joint_at: i8_2
    local: LocalProbes
    table: Table
    observed: ObservedState
    observation: ObservationArrays


def no_rows() -> Rows:
    """Return a schedule without rows."""
    return Rows.absent().with_values(
        made=np.zeros(2, np.int64), every=1 << 62, last=np.zeros(1, np.int64), dt=1.0
    )


@part_of_kernel
def has_row(number: int, rows: Rows) -> bool:
    """Return whether a row is due at a step and not yet made."""
    k = rows.made[0]
    return k < rows.due.shape[0] and rows.due[k] == number


@part_of_kernel
def is_due(number: int, rows: Rows) -> bool:
    """Return whether a row is due at a step, or an update of the envelope."""
    return has_row(number, rows) or number - rows.last[0] >= rows.every


@routine(whole, real, real, real, real, real, Rows.kind)
def make_row(
    number: Any, before_dt: Any, dt: Any, zeta: Any, sample_time: Any, sample_dt: Any, rows: Any
) -> Any:
    """Observe a step within the time loop; update the envelope, and append a row if one is due.

    The arguments are those of `loop.Interval`.
    """
    due = has_row(number, rows)
    share = (number * rows.dt - sample_time) / sample_dt
    call(rows.observed.observe, (before_dt, dt, zeta, share, int(due), rows.observed, rows.observation))
    update_envelope(number, share, rows)
    if not due:
        return 0
    table, row, k, sums = rows.table, rows.made[0], rows.made[1], rows.observation.sums
    table.number[k], table.slack[k] = number, rows.observation.slack[0]
    table.time_step[k] = before_dt if before_dt > 0.0 else dt
    for i in range(sums.shape[0]):
        for j in each(0, sums.shape[1]):
            table.sums[k, i, j] = sums[i, j]
    read_probes(rows, table.probes[k])
    speed, fastest = find_fastest(rows)
    strain, strained = find_most_strained(rows)
    if leads():
        write_largest(speed, fastest, strain, strained, rows, table.size[k], table.who[k])
    rows.made[0], rows.made[1] = row + 1, k + 1
    return 0


@copied_kernel
def update_envelope(number: int, share: float, rows: Rows) -> None:
    """Update the envelope with axial forces, displacements, reactions and moments at a step.

    share : position between two samples of the loads
    """
    time = number * rows.dt
    since = time - rows.last[0] * rows.dt
    tension, elements = rows.tension, rows.observed.elements
    for e in each(0, tension.shape[1]):
        update_element_envelope(e, time, since, rows)
    for p in each(0, rows.displacement.shape[1]):
        update_particle_envelope(p, time, rows)
    f_int = rows.observation.f_int
    for i in each(0, rows.supports.shape[0]):
        p = rows.supports[i]
        fx, fy, fz = f_int[0, p], f_int[1, p], f_int[2, p]
        call(rows.include_reaction, (i, 0, 0, time, share, fx, fy, fz, rows))
    if is_present(elements.highest):
        update_tension_envelope(time, elements.highest, elements.lowest, tension)
    if is_present(rows.moment):
        call(rows.update_moments, (rows,))
    meet()
    rows.last[0] = number


@part_of_kernel
def update_element_envelope(e: int, time: float, since: float, rows: Rows) -> None:
    """Include the axial force of element e at a time [s]; since : [s] from the last update"""
    tension, N, elements = rows.tension, rows.observation.now.N, rows.observed.elements
    if N[e] > tension[0, e]:
        tension[0, e], tension[1, e] = N[e], time
    tension[2, e] = min(tension[2, e], N[e])
    if N[e] == 0.0 and elements.bar[e] == 0 and elements.broken[e] == 0:
        tension[3, e] += since


@part_of_kernel
def update_particle_envelope(p: int, time: float, rows: Rows) -> None:
    """Include the displacement of particle p at a time [s]."""
    x, start, displacement = rows.observed.particles.x, rows.observed.particles.x_start, rows.displacement
    dx, dy, dz = x[0, p] - start[0, p], x[1, p] - start[1, p], x[2, p] - start[2, p]
    u = math.sqrt(dx * dx + dy * dy + dz * dz)
    if u > displacement[0, p]:
        displacement[0, p], displacement[1, p] = u, time


@part_of_kernel
def record_new_extreme(
    i: int, column: int, in_second: int, time: float, share: float, f: FloatArray, rows: Rows
) -> None:
    """Include the reaction of support i at a time [s] if the force on it has a new extreme.

    column : of f (3, ...) [N]; in_second, share : as of `include_reaction`
    """
    reaction, square, is_new = rows.reaction, 0.0, False
    for k in range(3):
        force = force_without_loads(k, i, f[k, column], in_second, rows)
        square += force * force
        is_new = is_new or force > reaction[8 + k, i] or force < reaction[11 + k, i]
    if is_new or square > reaction[14, i]:
        for k in range(3):
            force = force_without_loads(k, i, f[k, column], in_second, rows)
            reaction[8 + k, i] = max(reaction[8 + k, i], force)
            reaction[11 + k, i] = min(reaction[11 + k, i], force)
        reaction[14, i] = max(reaction[14, i], square)
        fx, fy, fz = f[0, column], f[1, column], f[2, column]
        call(rows.include_reaction, (i, 1, in_second, time, share, fx, fy, fz, rows))


@part_of_kernel
def force_without_loads(k: int, i: int, pull: float, in_second: int, rows: Rows) -> float:
    """Return the force [N] on support i along axis k of elements and bending chains, or on its spring.

    pull : of the elements [N]; in_second : as of `include_reaction`
    """
    p, particles = rows.supports[i], rows.observed.particles
    if is_present(particles.spring) and particles.free[k, p]:
        return force_of_spring(k, p, in_second, rows)
    if is_present(particles.bend):
        return pull + particles.bend[k, p]
    return pull


@part_of_kernel
def force_of_spring(k: int, p: int, in_second: int, rows: Rows) -> float:
    """Return the force [N] along axis k on the spring of particle p; in_second : as of `include_reaction`"""
    particles = rows.observed.particles
    force = particles.spring[k, p] * elongation_of(k, p, in_second, rows)
    if is_present(particles.turned) and k < 2:
        force += particles.turned[2, p] * elongation_of(1 - k, p, in_second, rows)
    return force


@routine(whole, whole, whole, real, real, real, real, real, Rows)
def include_reaction(
    i: int,
    with_supports: int,
    in_second: int,
    time: float,
    share: float,
    fx: float,
    fy: float,
    fz: float,
    rows: Rows,
) -> int:
    """Include the reaction of support i at a time [s], as of `statics.reactions.compute_balance`.

    with_supports : as of `motion.total_forces`; in_second : whether the positions are in the second array
    share : position between two samples of the loads; fx, fy, fz : internal force on the support [N]
    """
    p, observed, scratch, reaction = rows.supports[i], rows.observed, rows.observation.scratch, rows.reaction
    particles, f = observed.particles, scratch.f
    x = particles.x
    if in_second:
        x = rows.second
    f[0, 0], f[1, 0], f[2, 0] = fx, fy, fz
    total_forces(p, p + 1, with_supports, 0.0, 0.0, share, observed.traits, x, particles, scratch)
    for k in range(3):
        f[k, 0] += scratch.external[k, 0]
        if is_present(particles.air):
            f[k, 0] -= scratch.pull[0] * particles.air[k, p]
    turned, along, square = is_present(particles.turned), 0.0, 0.0
    if turned:
        nx, ny = particles.turned[0, p], particles.turned[1, p]
        along = nx * f[0, 0] + ny * f[1, 0]
    for k in range(3):
        force = f[k, 0]
        if particles.free[k, p]:
            force = along * particles.turned[k, p] if turned and k < 2 else 0.0
            if is_present(particles.spring):
                force += force_of_spring(k, p, in_second, rows)
        reaction[k, i], reaction[3 + k, i] = max(reaction[k, i], force), min(reaction[3 + k, i], force)
        square += force * force
    if math.sqrt(square) > reaction[6, i]:
        reaction[6, i], reaction[7, i] = math.sqrt(square), time
    return 0


@part_of_kernel
def elongation_of(k: int, p: int, in_second: int, rows: Rows) -> float:
    """Return the elongation [m] of the spring of particle p along axis k."""
    particles = rows.observed.particles
    x = rows.second[k, p] if in_second else particles.x[k, p]
    return (x - particles.x_start[k, p]) - particles.spring_rest[k, p]


@kernel
def update_tension_envelope(
    time: float, highest: FloatArray, lowest: FloatArray, tension: FloatArray
) -> None:
    """Update the tension envelope (4, m) with extremes (m,) up to a time [s]; lowest may be absent."""
    for e in each(0, tension.shape[1]):
        if highest[e] > tension[0, e]:
            tension[0, e], tension[1, e] = highest[e], time
        if is_present(lowest):
            tension[2, e] = min(tension[2, e], lowest[e])


@routine(Rows)
def update_moments(rows: Rows) -> int:
    """Update the envelope of bending moments [N m] at element ends; the moment is 0 at the end of a chain."""
    joints, joint_at, moment = rows.observed.joints, rows.joint_at, rows.moment
    for e in range(moment.shape[0]):
        for end in range(2):
            k = joint_at[e, end]
            if k != NO_BENDING:
                magnitude = 0.0 if k < 0 else joint_moment(rows.observed.particles.x.T, joints, k)
                if magnitude > moment[e] or math.isnan(moment[e]):
                    moment[e] = magnitude
    return 0


@copied_kernel
def read_probes(rows: Rows, values: FloatArray) -> None:
    """Write displacements [m] and tensions [N] of the probes of this rank into one row of values."""
    local, x, start = rows.local, rows.observed.particles.x, rows.observed.particles.x_start
    for i in each(0, local.particle.shape[0]):
        p, column = local.particle[i], local.particle_place[i]
        for k in range(3):
            values[column + k] = x[k, p] - start[k, p] + 0.0  # no negative zeros
    for i in each(0, local.element.shape[0]):
        e = local.element[i]
        N = rows.observation.now.N[e] + 0.0
        values[local.element_place[i]] = N if rows.observed.elements.owned[e] else 0.0
    if is_present(local.slip):
        read_slips(rows, values)


@copied_kernel
def read_slips(rows: Rows, values: FloatArray) -> None:
    """Write slips [m] and tension differences [N] (after minus before) of slip points.

    Broken elements count as 0.
    """
    points, broken, N = rows.observed.slip_points, rows.observed.elements.broken, rows.observation.now.N
    for i in range(points.node.shape[0]):
        before, after = points.before[i], points.after[i]
        T_before = N[before] if broken[before] == 0 else 0.0
        T_after = N[after] if broken[after] == 0 else 0.0
        values[rows.local.slip[i]] = rows.observed.particles.slip[points.column[i], points.node[i]] + 0.0
        values[rows.local.difference[i]] = T_after - T_before + 0.0


@inner_kernel
def bit_magnitude(bits: Integer) -> float:
    """Return the magnitude of the number with these bits (sign cleared); infinity for nan."""
    return math.inf if bits >= INFINITE else number_of(bits)


@copied_kernel
def find_fastest(rows: Rows) -> tuple[Integer, Integer]:
    """Return the bits of the largest speed along an axis of movable particles, and its particle; -1: none."""
    observed, velocity, free = rows.observed, rows.observation.velocity, rows.observed.particles.free
    halo, best, fastest = observed.first_split - observed.n_owned, np.int64(-1), np.int64(-1)
    for i in each(0, observed.rows[0] - halo):
        p = i if i < observed.n_owned else i + halo
        bits = np.int64(0)
        for k in range(3):
            bits = max(bits, bits_of(velocity[k, i]) & SIZE)
        if bits > best and (free[0, p] or free[1, p] or free[2, p]):
            best, fastest = bits, p
    return agree(best, fastest, rows.observation.slack[1:])


@copied_kernel
def find_most_strained(rows: Rows) -> tuple[Integer, Integer]:
    """Return the bits of the largest strain, and its element; -1: none."""
    eps, best, element = rows.observation.now.eps, np.int64(-1), np.int64(-1)
    for e in each(0, eps.shape[0]):
        bits = bits_of(eps[e]) & SIZE
        if bits > best:
            best, element = bits, e
    return agree(best, element, rows.observation.slack[1:])


@copied_kernel
def write_largest(
    speed: int, fastest: int, strain: int, strained: int, rows: Rows, size: FloatArray, who: IntArray
) -> None:
    """Write the largest speed and strain, given as bits, with their particle and element to a row.

    Place 2 has the largest strain of elements that never break.
    """
    size[0], size[1], size[2], who[0], who[1], who[2] = -1.0, -1.0, 0.0, -1, -1, -1
    if speed >= 0:
        size[0], who[0] = bit_magnitude(speed), rows.observed.particles.gid[fastest]
    if strain >= 0:
        size[1], who[1] = bit_magnitude(strain), rows.element_gid[strained]
    if size[1] > REPORTED_STRAIN:
        element = most_strained_unbreakable(rows.observed.elements, rows.observation.now)
        if element >= 0:
            size[2], who[2] = abs(rows.observation.now.eps[element]), rows.element_gid[element]


@copied_kernel
def most_strained_unbreakable(elements: Elements, now: ElementState) -> int:
    """Return the element with the largest strain beyond REPORTED_STRAIN that never breaks; -1: none.

    Slack cables are excluded, as their strain has no meaning, and fragments, which have no limit after a
    fracture.
    """
    largest, element = REPORTED_STRAIN, -1
    for e in range(now.N.shape[0]):
        limit = math.inf
        if is_present(elements.eps_u):
            limit = elements.eps_u[e]
        counts = limit == math.inf and elements.broken[e] == 0 and now.N[e] != 0.0
        if counts and abs(now.eps[e]) > largest:
            largest, element = abs(now.eps[e]), e
    return element
