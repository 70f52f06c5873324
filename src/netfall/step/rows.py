"""Rows of the history, made within the time loop: several of them, before Python takes them up.

Where rows are far apart, the envelope is widened between them too, or it would depend on their number.

A row has all that is known of its step: what must come from all ranks, and that is left in exact parts (sums
as limbs), until the rows are taken up (`record.rows`). So its bits do not depend on when that is.
"""

import math
from typing import NamedTuple

import numpy as np

from netfall.ground.apart import Entry, call
from netfall.ground.compile import inner_kernel, kernel, kernel_apart, part_of_kernel
from netfall.mechanics.bending import Joints, joint_moment
from netfall.mechanics.elements import ElementState
from netfall.mechanics.slip.motion import Places
from netfall.numerics.arithmetic import bits_of, number_of

MOST_STRAIN = 0.1  # that any cable bears; what is beyond it without a limit of its own is told
NO_BENDING = -2  # in place of a joint, as `net.chains` has it
INFINITE = np.int64(0x7FF) << 52  # the bits of infinity; those of nan are more
SIZE = np.int64(0x7FFFFFFFFFFFFFFF)  # all bits but the sign


class Table(NamedTuple):
    """Rows that are made and not yet taken up, (k, ...) each, of this rank.

    number : of the step; time_step : [s] the one before; slack : cables; sums : (k, s, LIMBS)
    probes : (k, p) displacements [m] and tensions [N], 0 where another rank has them; then what slips
    size, who : (k, 3) largest speed [m/s], strain, and strain beyond MOST_STRAIN where nothing ever breaks,
        with the global numbers of the particle and the elements; -1: none
    """

    number: np.ndarray
    time_step: np.ndarray
    slack: np.ndarray
    sums: np.ndarray
    probes: np.ndarray
    size: np.ndarray
    who: np.ndarray


class Local(NamedTuple):
    """The probes that this rank has: rows of particles and of elements, and the places of their values.

    slip, difference : (places,) where slips, and differences of the tensions beside them, stand; None: none
    """

    particle: np.ndarray
    particle_place: np.ndarray
    element: np.ndarray
    element_place: np.ndarray
    slip: np.ndarray | None
    difference: np.ndarray | None


class Bending(NamedTuple):
    """x : (n, 3) [m]; joint_at : (m, 2) joints at both ends of elements, as `State` has them."""

    x: np.ndarray
    joints: Joints
    joint_at: np.ndarray


class Seen(NamedTuple):
    """What a row reads of what was observed, and where it goes: of few kinds, whatever else a scene has.

    dt : [s] length of the steps as counted; made : (2,) rows made so far, those of them in the table
    last : (1,) number of the step at which the envelope was widened last
    n_owned, first_split, rows : as of `Subject`; velocity, now, slack, sums : of `Room`
    x, x_start, free : three of (n,); particle_gid : (n,); bar, broken, owned, element_gid : (m,)
    tension : (4, m), displacement : (2, n_owned), moment : (m,), as `record.envelope` has them
    highest, lowest, eps_u : (m,) of elements, None as in `Elements`
    bending : None, as moment: no chain bends; places, slip : of `Subject` and its particles, None: none slips
    """

    dt: float
    made: np.ndarray
    last: np.ndarray
    n_owned: int
    first_split: int
    rows: np.ndarray
    velocity: tuple
    now: ElementState
    slack: np.ndarray
    sums: np.ndarray
    x: tuple
    x_start: tuple
    free: tuple
    particle_gid: np.ndarray
    bar: np.ndarray
    broken: np.ndarray
    owned: np.ndarray
    element_gid: np.ndarray
    tension: np.ndarray
    displacement: np.ndarray
    moment: np.ndarray | None
    local: Local
    table: Table
    highest: np.ndarray | None
    lowest: np.ndarray | None
    eps_u: np.ndarray | None
    bending: Bending | None
    places: Places | None
    slip: tuple | None


class Rows(NamedTuple):
    """Which rows are made, and what makes them.

    due : (rows,) numbers of the steps of all rows of the stage; made, last, dt : of `Seen`
    every : steps, as they are counted, after which the envelope is widened where no row is made
    observe : of `audit`; take_row : for what has been `seen`
    """

    due: np.ndarray
    made: np.ndarray
    every: int
    last: np.ndarray
    dt: float
    observe: Entry
    take_row: Entry


def no_rows() -> Rows:
    """Where none are made."""
    none, nothing, never = np.zeros(0, np.int64), np.zeros(2, np.int64), 1 << 62
    observe = Entry(None, *[0.0] * 4, True, given=(None, None))
    take = Entry(None, 0, 0.0, True, given=(None,))
    return Rows(none, nothing, never, nothing[:1], 1.0, observe, take)


@part_of_kernel
def has_row(number, rows):
    """Whether a row is due at a step that is not made yet."""
    k = rows.made[0]
    return k < rows.due.shape[0] and rows.due[k] == number


@part_of_kernel
def is_due(number, rows):
    """Whether a row is due at a step, or the envelope has not been widened for long."""
    return has_row(number, rows) or number - rows.last[0] >= rows.every


@inner_kernel
def make_row(number, before_dt, dt, zeta, sample_time, sample_dt, rows):
    """The row of a step, within the time loop: into the table, and taken in by the envelope; or that alone.

    Its arguments as of `loop.Interval`.
    """
    due = has_row(number, rows)
    share = (number * rows.dt - sample_time) / sample_dt
    call(rows.observe, before_dt, dt, zeta, share, due)
    call(rows.take_row, number, before_dt if before_dt > 0.0 else dt, due)


@kernel_apart
def take_row(number, step, due, seen):
    """What was observed at a step into the envelope, and if a row is due into the table.

    step : [s] the one before
    """
    widen(number, seen)
    if not due:
        return
    made, table, k = seen.made, seen.table, seen.made[1]
    table.number[k], table.slack[k] = number, seen.slack[0]
    table.time_step[k] = step
    for i in range(seen.sums.shape[0]):
        for j in range(seen.sums.shape[1]):
            table.sums[k, i, j] = seen.sums[i, j]
    read_probes(seen, table.probes[k])
    find_fastest(seen, table.size[k], table.who[k])
    find_most_strained(seen, table.size[k], table.who[k])
    made[0] += 1
    made[1] += 1


@inner_kernel
def widen(number, seen):
    """Take in the axial forces, the positions and the moments at a step."""
    time = number * seen.dt
    since = time - seen.last[0] * seen.dt
    seen.last[0] = number
    tension, displacement, N = seen.tension, seen.displacement, seen.now.N
    for e in range(tension.shape[1]):
        if N[e] > tension[0, e]:
            tension[0, e], tension[1, e] = N[e], time
        tension[2, e] = min(tension[2, e], N[e])
        if N[e] == 0.0 and seen.bar[e] == 0 and seen.broken[e] == 0:
            tension[3, e] += since
    x, start = seen.x, seen.x_start
    for p in range(displacement.shape[1]):
        dx, dy, dz = x[0][p] - start[0][p], x[1][p] - start[1][p], x[2][p] - start[2][p]
        u = math.sqrt(dx * dx + dy * dy + dz * dz)
        if u > displacement[0, p]:
            displacement[0, p], displacement[1, p] = u, time
    if seen.highest is not None:
        widen_to_extremes(time, seen.highest, seen.lowest, tension)
    if seen.moment is not None:
        widen_moments(seen.bending, seen.moment)


@kernel
def widen_to_extremes(time, highest, lowest, tension):
    """Take in the extremes of all steps up to a time [s], as `Seen` has them, and tension (4, m)."""
    for e in range(tension.shape[1]):
        if highest[e] > tension[0, e]:
            tension[0, e], tension[1, e] = highest[e], time
        if lowest is not None:
            tension[2, e] = min(tension[2, e], lowest[e])


@inner_kernel
def widen_moments(bending, moment):
    """Take in the bending moments [N m] at both ends of each element, 0 at the end of a chain."""
    x, joints, joint_at = bending.x, bending.joints, bending.joint_at
    for e in range(moment.shape[0]):
        for end in range(2):
            k = joint_at[e, end]
            if k != NO_BENDING:
                size = 0.0 if k < 0 else joint_moment(x, joints, k)
                if size > moment[e] or math.isnan(moment[e]):
                    moment[e] = size


@inner_kernel
def read_probes(seen, values):
    """Displacements (p, 3) [m], tensions [N] of what meets there and of what is named, in one row."""
    local, x, start = seen.local, seen.x, seen.x_start
    for i in range(local.particle.shape[0]):
        p, place = local.particle[i], local.particle_place[i]
        for k in range(3):
            values[place + k] = x[k][p] - start[k][p] + 0.0  # no negative zeros
    for i in range(local.element.shape[0]):
        e = local.element[i]
        N = seen.now.N[e] + 0.0
        values[local.element_place[i]] = N if seen.owned[e] else 0.0
    if local.slip is not None:
        read_slips(seen, values)


@inner_kernel
def read_slips(seen, values):
    """Slips [m], and tensions after less those before their places [N], none of what has broken."""
    places, broken, N = seen.places, seen.broken, seen.now.N
    for i in range(places.node.shape[0]):
        before, after = places.before[i], places.after[i]
        T_before = N[before] if broken[before] == 0 else 0.0
        T_after = N[after] if broken[after] == 0 else 0.0
        values[seen.local.slip[i]] = seen.slip[places.column[i]][places.node[i]] + 0.0
        values[seen.local.difference[i]] = T_after - T_before + 0.0


@inner_kernel
def size_of(bits):
    """The number of these bits without the sign; infinite where it is none."""
    return math.inf if bits >= INFINITE else number_of(bits)


@inner_kernel
def find_fastest(seen, size, who):
    """The largest speed along an axis of the particles that can move, and its particle, into place 0."""
    halo, best, at = seen.first_split - seen.n_owned, np.int64(-1), np.int64(-1)
    x, y, z = seen.velocity
    free = seen.free
    for i in range(seen.rows[0] - halo):
        p = i if i < seen.n_owned else i + halo
        bits = max(bits_of(x[i]) & SIZE, max(bits_of(y[i]) & SIZE, bits_of(z[i]) & SIZE))
        if bits > best and (free[0][p] or free[1][p] or free[2][p]):
            best, at = bits, p
    size[0], who[0] = -1.0, -1
    if at >= 0:
        size[0], who[0] = size_of(best), seen.particle_gid[at]


@inner_kernel
def find_most_strained(seen, size, who):
    """The largest strain and its element into place 1; that where nothing ever breaks into place 2."""
    eps, best, at = seen.now.eps, np.int64(-1), np.int64(-1)
    for e in range(eps.shape[0]):
        bits = bits_of(eps[e]) & SIZE
        if bits > best:
            best, at = bits, e
    size[1], size[2], who[1], who[2] = -1.0, 0.0, -1, -1
    if at >= 0:
        size[1], who[1] = size_of(best), seen.element_gid[at]
    if size[1] > MOST_STRAIN:
        at = endless_strain(seen.eps_u, seen.broken, seen.now)
        if at >= 0:
            size[2], who[2] = abs(eps[at]), seen.element_gid[at]


@inner_kernel
def endless_strain(eps_u, broken, now):
    """The element with the largest strain beyond MOST_STRAIN of those that nothing ever breaks; -1: none.

    A slack cable may hang as it likes; what hangs on after a fracture has no limit any more.
    """
    largest, at = MOST_STRAIN, -1
    for e in range(now.N.shape[0]):
        limit = math.inf
        if eps_u is not None:
            limit = eps_u[e]
        endless = limit == math.inf and broken[e] == 0 and now.N[e] != 0.0
        if endless and abs(now.eps[e]) > largest:
            largest, at = abs(now.eps[e]), e
    return at
