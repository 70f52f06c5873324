"""Rows of the history, made within the time loop: several of them, before Python takes them up.

Where rows are far apart, the envelope is widened between them too, or it would depend on their number.

A row has all that is known of its step: what must come from all ranks, and that is left in exact parts (sums
as limbs), until the rows are taken up (`record.rows`). So its bits do not depend on when that is.
"""

import math

import numpy as np

from netfall.core.kernels import inner_kernel, kernel, part_of_kernel, routine
from netfall.core.records import Record, f8, f8_2, has, i8, i8_2, i8_3, real, whole
from netfall.core.vectors import bits_of, number_of
from netfall.mechanics.bending import joint_moment
from netfall.step.audit import Room, Subject, observe

MOST_STRAIN = 0.1  # that any cable bears; what is beyond it without a limit of its own is told
NO_BENDING = -2  # in place of a joint, as `net.cables` has it
INFINITE = np.int64(0x7FF) << 52  # the bits of infinity; those of nan are more
SIZE = np.int64(0x7FFFFFFFFFFFFFFF)  # all bits but the sign


class Table(Record):
    """Rows that are made and not yet taken up, (k, ...) each, of this rank.

    number : of the step; time_step : [s] the one before; slack : cables; sums : (k, s, LIMBS)
    probes : (k, p) displacements [m] and tensions [N], 0 where another rank has them; then what slips
    size, who : (k, 3) largest speed [m/s], strain, and strain beyond MOST_STRAIN where nothing ever breaks,
        with the global numbers of the particle and the elements; -1: none
    """

    number: i8
    time_step: f8
    slack: i8
    sums: i8_3
    probes: f8_2
    size: f8_2
    who: i8_2


class Local(Record):
    """The probes that this rank has: rows of particles and of elements, and the places of their values.

    slip, difference : (places,) where slips, and differences of the tensions beside them, stand; absent: none
    """

    particle: i8
    particle_place: i8
    element: i8
    element_place: i8
    slip: i8
    difference: i8


class Rows(Record):
    """Which rows are made, and what they are made of.

    due : (rows,) numbers of the steps of all rows of the stage; dt : [s] length of the steps as counted
    made : (2,) rows made so far, those of them in the table
    every : steps, as they are counted, after which the envelope is widened where no row is made
    last : (1,) number of the step at which the envelope was widened last
    element_gid : (m,); joint_at : (m, 2) joints at both ends of elements, as `State` has them
    tension : (4, m), displacement : (2, n_owned), moment : (m,), as `record.envelope` has them
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
    joint_at: i8_2
    local: Local
    table: Table
    subject: Subject
    room: Room


def no_rows() -> Rows:
    """Where none are made."""
    return Rows.absent().replaced(
        made=np.zeros(2, np.int64), every=1 << 62, last=np.zeros(1, np.int64), dt=1.0
    )


@part_of_kernel
def has_row(number, rows):
    """Whether a row is due at a step that is not made yet."""
    k = rows.made[0]
    return k < rows.due.shape[0] and rows.due[k] == number


@part_of_kernel
def is_due(number, rows):
    """Whether a row is due at a step, or the envelope has not been widened for long."""
    return has_row(number, rows) or number - rows.last[0] >= rows.every


@routine(whole, real, real, real, real, real, Rows.kind)
def make_row(number, before_dt, dt, zeta, sample_time, sample_dt, rows):
    """The row of a step, within the time loop: into the table, and taken in by the envelope; or that alone.

    Its arguments as of `loop.Interval`.
    """
    due = has_row(number, rows)
    share = (number * rows.dt - sample_time) / sample_dt
    observe(before_dt, dt, zeta, share, due, rows.subject, rows.room)
    take_row(number, before_dt if before_dt > 0.0 else dt, due, rows)
    return 0


@inner_kernel
def take_row(number, step, due, rows):
    """What was observed at a step into the envelope, and if a row is due into the table.

    step : [s] the one before
    """
    widen(number, rows)
    if not due:
        return
    made, table, k, sums = rows.made, rows.table, rows.made[1], rows.room.sums
    table.number[k], table.slack[k] = number, rows.room.slack[0]
    table.time_step[k] = step
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            table.sums[k, i, j] = sums[i, j]
    read_probes(rows, table.probes[k])
    find_fastest(rows, table.size[k], table.who[k])
    find_most_strained(rows, table.size[k], table.who[k])
    made[0] += 1
    made[1] += 1


@inner_kernel
def widen(number, rows):
    """Take in the axial forces, the positions and the moments at a step."""
    time = number * rows.dt
    since = time - rows.last[0] * rows.dt
    rows.last[0] = number
    tension, displacement, N = rows.tension, rows.displacement, rows.room.now.N
    particles, elements = rows.subject.particles, rows.subject.elements
    for e in range(tension.shape[1]):
        if N[e] > tension[0, e]:
            tension[0, e], tension[1, e] = N[e], time
        tension[2, e] = min(tension[2, e], N[e])
        if N[e] == 0.0 and elements.bar[e] == 0 and elements.broken[e] == 0:
            tension[3, e] += since
    x, start = particles.x, particles.x_start
    for p in range(displacement.shape[1]):
        dx, dy, dz = x[0, p] - start[0, p], x[1, p] - start[1, p], x[2, p] - start[2, p]
        u = math.sqrt(dx * dx + dy * dy + dz * dz)
        if u > displacement[0, p]:
            displacement[0, p], displacement[1, p] = u, time
    if has(elements.highest):
        widen_to_extremes(time, elements.highest, elements.lowest, tension)
    if has(rows.moment):
        widen_moments(rows)


@kernel
def widen_to_extremes(time, highest, lowest, tension):
    """Take in the extremes (m,) of all steps up to a time [s]; lowest may be absent; tension : (4, m)"""
    for e in range(tension.shape[1]):
        if highest[e] > tension[0, e]:
            tension[0, e], tension[1, e] = highest[e], time
        if has(lowest):
            tension[2, e] = min(tension[2, e], lowest[e])


@inner_kernel
def widen_moments(rows):
    """Take in the bending moments [N m] at both ends of each element, 0 at the end of a chain."""
    joints, joint_at, moment = rows.subject.joints, rows.joint_at, rows.moment
    for e in range(moment.shape[0]):
        for end in range(2):
            k = joint_at[e, end]
            if k != NO_BENDING:
                size = 0.0 if k < 0 else joint_moment(rows.subject.particles.x.T, joints, k)
                if size > moment[e] or math.isnan(moment[e]):
                    moment[e] = size


@inner_kernel
def read_probes(rows, values):
    """Displacements (p, 3) [m], tensions [N] of what meets there and of what is named, in one row."""
    local, x, start = rows.local, rows.subject.particles.x, rows.subject.particles.x_start
    for i in range(local.particle.shape[0]):
        p, place = local.particle[i], local.particle_place[i]
        for k in range(3):
            values[place + k] = x[k, p] - start[k, p] + 0.0  # no negative zeros
    for i in range(local.element.shape[0]):
        e = local.element[i]
        N = rows.room.now.N[e] + 0.0
        values[local.element_place[i]] = N if rows.subject.elements.owned[e] else 0.0
    if has(local.slip):
        read_slips(rows, values)


@inner_kernel
def read_slips(rows, values):
    """Slips [m], and tensions after less those before their places [N], none of what has broken."""
    places, broken, N = rows.subject.places, rows.subject.elements.broken, rows.room.now.N
    for i in range(places.node.shape[0]):
        before, after = places.before[i], places.after[i]
        T_before = N[before] if broken[before] == 0 else 0.0
        T_after = N[after] if broken[after] == 0 else 0.0
        values[rows.local.slip[i]] = rows.subject.particles.slip[places.column[i], places.node[i]] + 0.0
        values[rows.local.difference[i]] = T_after - T_before + 0.0


@inner_kernel
def size_of(bits):
    """The number of these bits without the sign; infinite where it is none."""
    return math.inf if bits >= INFINITE else number_of(bits)


@inner_kernel
def find_fastest(rows, size, who):
    """The largest speed along an axis of the particles that can move, and its particle, into place 0."""
    subject, velocity, free = rows.subject, rows.room.velocity, rows.subject.particles.free
    halo, best, at = subject.first_split - subject.n_owned, np.int64(-1), np.int64(-1)
    for i in range(subject.rows[0] - halo):
        p = i if i < subject.n_owned else i + halo
        bits = np.int64(0)
        for k in range(3):
            bits = max(bits, bits_of(velocity[k, i]) & SIZE)
        if bits > best and (free[0, p] or free[1, p] or free[2, p]):
            best, at = bits, p
    size[0], who[0] = -1.0, -1
    if at >= 0:
        size[0], who[0] = size_of(best), subject.particles.gid[at]


@inner_kernel
def find_most_strained(rows, size, who):
    """The largest strain and its element into place 1; that where nothing ever breaks into place 2."""
    eps, best, at = rows.room.now.eps, np.int64(-1), np.int64(-1)
    for e in range(eps.shape[0]):
        bits = bits_of(eps[e]) & SIZE
        if bits > best:
            best, at = bits, e
    size[1], size[2], who[1], who[2] = -1.0, 0.0, -1, -1
    if at >= 0:
        size[1], who[1] = size_of(best), rows.element_gid[at]
    if size[1] > MOST_STRAIN:
        at = endless_strain(rows.subject.elements, rows.room.now)
        if at >= 0:
            size[2], who[2] = abs(eps[at]), rows.element_gid[at]


@inner_kernel
def endless_strain(elements, now):
    """The element with the largest strain beyond MOST_STRAIN of those that nothing ever breaks; -1: none.

    A slack cable may hang as it likes; what hangs on after a fracture has no limit any more.
    """
    largest, at = MOST_STRAIN, -1
    for e in range(now.N.shape[0]):
        limit = math.inf
        if has(elements.eps_u):
            limit = elements.eps_u[e]
        endless = limit == math.inf and elements.broken[e] == 0 and now.N[e] != 0.0
        if endless and abs(now.eps[e]) > largest:
            largest, at = abs(now.eps[e]), e
    return at
