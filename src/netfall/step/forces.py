"""Forces, kick and work of the particles of a chunk, in vector registers. p is a particle, s a slot.

What a scene does not have is None in the named tuples; the compiler then drops the branch and the array with
it. `Particles` come as the plan prepares them (`plan.stepped_particles`).
"""

import numpy as np

from netfall.ground.compile import inner_kernel, kernel_apart, part_of_kernel, vector_kernel
from netfall.mechanics.air import air_work, damped_mass, with_air
from netfall.mechanics.fields import SLOTS
from netfall.mechanics.ground import pull_of_ground, velocity_after, works_of_motion
from netfall.mechanics.law.branches import density_with_branches
from netfall.mechanics.law.slot import force_density
from netfall.mechanics.loads import external_force, squared_speed, wind_speed
from netfall.mechanics.motion import along_x, along_y, along_z, kicked, make_kick
from netfall.mechanics.supports import on_guide, spring_force, turned_springs
from netfall.numerics.arithmetic import dot, fused
from netfall.step.runs import BORROWING, LANES, ORDERED
from netfall.step.slots import keep_force

NO_FORCE = (0.0, 0.0, 0.0)

# Of the particles what is read and written here: scenes that differ in others share kernels.
KICKED = (
    *("x", "v", "free", "mass", "per_mass", "load", "spring", "spring_zero", "turned", "ground", "bend"),
    *("load_before", "load_after", "wind", "speed_before", "speed_after", "tapped"),
    *("air", "air_pull", "air_mass", "drag", "work", "other_work"),
)


@part_of_kernel
def density(p, o, s, keeps, x, slots, law):
    """N / L [N/m] of the element in slot s of particle p; of its branches alone; past; and its direction.

    Where the slots hold plastic strains, a cable's yield is kept. o : its far end; keeps : None if the
    extremes of its axial force are not kept here; x : positions [m], three of (n,); past : below 0 where it
    is past its limits; direction : three [m], from p to o
    """
    d = x[0][o] - x[0][p], x[1][o] - x[1][p], x[2][o] - x[2][p]
    q, past, yielded = force_density(d, s, p, np.int64(0), slots, law)
    if slots.highest is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if keeps is not None:
            keep_force(q, d, s, p, slots)
    if slots.eps_p is not None:
        slots.eps_p[s, p] = yielded
    of_branches = 0.0
    if slots.branch_a is not None:
        total = density_with_branches(q, d, s, p, slots, law)
        of_branches, q = total - q, total
    return q, of_branches, past, d


@part_of_kernel
def pulled(so_far, q, d):
    """A force [N], three, and that of an element of density q [N/m] along d [m]."""
    return fused(q, d[0], so_far[0]), fused(q, d[1], so_far[1]), fused(q, d[2], so_far[2])


@part_of_kernel
def four_forces(p, far, keeps, x, slots, law):
    """Sum of the forces [N] of the first four slots of particle p, in this order; of their branches alone.

    Then whether an element is past its limits, and the density of the fourth: `density` without direction.
    far : their far ends. Numbers have one type each, or all would be compiled for each type that occurs.
    keeps : of the first two
    """
    q0, b0, past0, d0 = density(p, far[0], np.int64(0), keeps, x, slots, law)
    q1, b1, past1, d1 = density(p, far[1], np.int64(1), keeps, x, slots, law)
    q2, b2, past2, d2 = density(p, far[2], np.int64(2), True, x, slots, law)
    q3, b3, past3, d3 = density(p, far[3], np.int64(3), True, x, slots, law)
    force = pulled(pulled(pulled(pulled(NO_FORCE, q0, d0), q1, d1), q2, d2), q3, d3)
    band = NO_FORCE
    if slots.branch_a is not None:
        band = pulled(pulled(pulled(pulled(NO_FORCE, b0, d0), b1, d1), b2, d2), b3, d3)
    return force, band, past0 | past1 | past2 | past3, (q3, b3, past3)


@part_of_kernel
def lend(p, fourth, lent):
    """Have particle p lend the element in its fourth slot; fourth : of `four_forces`"""
    q, of_branches, past = fourth
    lent.density[p] = q
    if lent.band is not None:
        lent.band[p] = of_branches
    if lent.near is not None:
        lent.near[p] = 1 if past < 0 else 0


@part_of_kernel
def kick_axis(p, total, kick, axis, particles):
    """Kick of particle p along one axis under its total force [N]; its velocity [m/s] before.

    axis : `motion.Axis`
    """
    old = axis.v[p]
    axis.v[p] = velocity_after(p, old, kicked(old, total * particles.per_mass[p], kick), axis)  # v to n + 1/2
    return old


@part_of_kernel
def add_works(p, twice, internal, external, kick, particles):
    """Add the works [J] of a kick of particle p: v.f dt of its mean velocity; supports do not move.

    twice : of the mean velocity [m/s], zero where held; internal, external : forces [N]; three each
    """
    of_external, of_internal, of_damping = particles.work
    half, pull = 0.5 * kick.dt, 0.25 * kick.dt * kick.zeta
    of_external[p] = fused(half, dot(twice, external), of_external[p])
    of_internal[p] = fused(half, dot(twice, internal), of_internal[p])
    of_damping[p] = fused(pull * damped_mass(p, particles), dot(twice, twice), of_damping[p])


@part_of_kernel
def add_works_along(p, old, internal, external, kick, axis, particles):
    """As `add_works`, along one axis, where supports may move; old : [m/s], the velocity before."""
    of_external, of_internal, of_damping = particles.work
    mean = 0.5 * (old + axis.v[p])
    way = kick.dt * mean
    damping, ground = works_of_motion(
        p, old, axis.v[p], kick.dt, way, external + internal, mean, kick, axis, particles
    )
    of_external[p] += way * external
    of_internal[p] += way * internal
    of_damping[p] += damping
    particles.other_work[2][p] += ground


@part_of_kernel
def kick_particle(p, i, force, branches, kick, particles, law, f):
    """Kick and work of particle p under its internal forces [N] and the external ones.

    Totals to row i of f. branches : three [N], of the branches alone
    """
    if particles.bend is not None:
        bend = particles.bend
        force = (force[0] + bend[0][p], force[1] + bend[1][p], force[2] + bend[2][p])
    square = 0.0
    if particles.wind is not None:
        square = squared_speed(wind_speed(p, particles, kick.share), particles)
    x, y, z = along_x(particles), along_y(particles), along_z(particles)
    nx, ny, nz = spring_force(p, force[0], x), spring_force(p, force[1], y), spring_force(p, force[2], z)
    nx, ny = turned_springs(p, nx, ny, particles)
    ex, ey, ez = (
        external_force(p, x, square, kick.share),
        external_force(p, y, square, kick.share),
        external_force(p, z, square, kick.share),
    )
    total = (nx + ex, ny + ey, nz + ez)
    if particles.ground is not None:
        gx, gy, gz = (
            pull_of_ground(p, x, kick, particles),
            pull_of_ground(p, y, kick, particles),
            pull_of_ground(p, z, kick, particles),
        )
        total = (total[0] + gx, total[1] + gy, total[2] + gz)
    total, pull = with_air(p, total, kick, particles)
    f[0][i], f[1][i], f[2][i] = total
    total = on_guide(p, total, particles)
    vx = kick_axis(p, total[0], kick, x, particles)
    vy = kick_axis(p, total[1], kick, y, particles)
    vz = kick_axis(p, total[2], kick, z, particles)
    v = particles.v
    twice = (vx + v[0][p], vy + v[1][p], vz + v[2][p])
    if particles.other_work is not None:
        air, band, _ = particles.other_work
        if law.branches is not None:
            band[p] = fused(-0.5 * kick.dt, dot(twice, branches), band[p])
        if particles.air is not None:
            air[p] += air_work(p, kick.dt, pull, twice, particles)
    if particles.work is not None:
        if particles.ground is None:
            add_works(p, twice, (nx, ny, nz), (ex, ey, ez), kick, particles)
        else:
            add_works_along(p, vx, nx, ex, kick, x, particles)
            add_works_along(p, vy, ny, ey, kick, y, particles)
            add_works_along(p, vz, nz, ez, kick, z, particles)


@kernel_apart
def kick_chunk(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """Forces, kick and work of the particles of chunk c; where plastic strains are, yield of cables.

    kick_dt, zeta, share : of `motion.Kick`; chunks, scratch : `plan.Chunks`, `plan.Scratch`
    scratch.f : (rows,) counted from the chunk's first particle, out, total force [N]
    scratch.near : the same, out, 1 where an element of the particle is near its limits; None: all are elastic
    """
    if chunks.is_split is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if chunks.is_split[c]:
            if slots.eps_p is not None:
                chunks.has_yielded[c] = 1  # yield is kept in the loop from now on
            kick_splits(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)
            return
    kick_owned(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)


@kernel_apart
def kick_unyielded(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """`kick_chunk` of particles of the net without plastic strains. slots : without them, the same else"""
    kick_owned(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)


@vector_kernel
def kick_owned(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """`kick_chunk` of particles of the net, in runs or one after the other."""
    if chunks.runs.gathered[c]:
        kick_gathered(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)
    else:
        kick_runs(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)


@vector_kernel
def kick_splits(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """`kick_chunk` of particles that have split off: each has one element, broken, in slot 0."""
    origin, x, f, other = np.uint64(chunks.low[c]), particles.x, scratch.f, slots.other
    kick = make_kick(kick_dt, zeta, share)
    for p in range(origin, np.uint64(chunks.high[c])):
        i, far = p - origin, np.uint64(other[0, p])
        q, of_branches, past, d = density(p, far, np.int64(0), None, x, slots, law)
        if scratch.near is not None:
            scratch.near[i] = 1 if past < 0 else 0
        force, band = pulled(NO_FORCE, q, d), pulled(NO_FORCE, of_branches, d)
        kick_particle(p, i, force, band, kick, particles, law, f)


@part_of_kernel
def kick_gathered(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """`kick_chunk` one particle after the other, wherever the far ends are."""
    origin, end = np.uint64(chunks.low[c]), np.uint64(chunks.high[c])  # unsigned: nothing counts from the end
    x, f, other = particles.x, scratch.f, slots.other
    kick = make_kick(kick_dt, zeta, share)
    for p in range(origin, end):
        i = p - origin
        force, band, past, fourth = four_forces(p, far_ends(p, other), True, x, slots, law)
        keep_row(i, force, band, scratch)
        lend(p, fourth, scratch.lent)
        if scratch.near is not None:
            scratch.near[i] = 1 if past < 0 else 0
    for s in range(SLOTS, chunks.width[c]):
        for p in range(origin, end):
            i = p - origin
            q, of_branches, past, d = density(p, np.uint64(other[s, p]), np.int64(s), True, x, slots, law)
            band = pulled(row_of(scratch.band, i), of_branches, d)
            keep_row(i, pulled(row_of(f, i), q, d), band, scratch)
            if scratch.near is not None:
                scratch.near[i] |= 1 if past < 0 else 0
    for p in range(origin, end):
        i = p - origin
        kick_particle(p, i, row_of(f, i), row_of(scratch.band, i), kick, particles, law, f)


@part_of_kernel
def keep_row(i, force, band, scratch):
    """Force [N] and that of the branches alone, three each, into row i of the scratch."""
    scratch.f[0][i], scratch.f[1][i], scratch.f[2][i] = force
    if scratch.band is not None:
        scratch.band[0][i], scratch.band[1][i], scratch.band[2][i] = band


@part_of_kernel
def row_of(columns, i):
    """Row i of three columns, zeros where there are none."""
    if columns is None:
        return 0.0, 0.0, 0.0
    return columns[0][i], columns[1][i], columns[2][i]


@part_of_kernel
def far_ends(p, other):
    """The far ends in the first four slots of particle p."""
    return np.uint64(other[0, p]), np.uint64(other[1, p]), np.uint64(other[2, p]), np.uint64(other[3, p])


@part_of_kernel
def kick_run(r, origin, keeps, kick, whole, particles, slots, law, scratch):
    """`kick_chunk` of the particles of run r, which borrow nothing.

    keeps : as of `four_forces`; whole : of `Runs`
    """
    s0, s1 = np.uint64(whole[r, 2]), np.uint64(whole[r, 3])
    s2, s3 = np.uint64(whole[r, 4]), np.uint64(whole[r, 5])
    for p in range(np.uint64(whole[r, 0]), np.uint64(whole[r, 1])):
        i, far = p - origin, (p + s0, p + s1, p + s2, p + s3)
        force, band, past, fourth = four_forces(p, far, keeps, particles.x, slots, law)
        lend(p, fourth, scratch.lent)
        if scratch.near is not None:
            scratch.near[i] = 1 if past < 0 else 0
        kick_particle(p, i, force, band, kick, particles, law, scratch.f)


@part_of_kernel
def kick_borrowing(r, origin, kick, whole, particles, slots, law, scratch):
    """`kick_run` where they borrow: the first element from the one before it is of, the second from p - 1.

    The latter goes on from lane to lane in a register. The former was stored before the block began: a block
    is no longer than the way to the lender, so the compiler finds that loads and stores do not meet.

    Elements near their limits are rare without bars, which are pointed at in each step in which they yield:
    then the loop finds whether a block has any, which costs less, and whose they are is found behind it.
    """
    s0, s3, one = np.uint64(whole[r, 2]), np.uint64(whole[r, 5]), np.uint64(1)
    x, lent = particles.x, scratch.lent
    first, last = np.uint64(whole[r, 0]), np.uint64(whole[r, 1])
    length = np.uint64(-whole[r, 2] // LANES * LANES)
    q1, b1, past1, _ = density(first, first - one, np.int64(1), None, x, slots, law)
    if scratch.near is not None and slots.bar is None:
        clear_near(first, last, origin, past1, scratch)
    for begin in range(first, last, length):
        end, anywhere = min(begin + length, last), np.int64(0)
        for p in range(begin, end):
            i, o0, o1 = p - origin, p + s0, p - one
            d0 = x[0][o0] - x[0][p], x[1][o0] - x[1][p], x[2][o0] - x[2][p]
            d1 = x[0][o1] - x[0][p], x[1][o1] - x[1][p], x[2][o1] - x[2][p]
            q2, b2, past2, d2 = density(p, p + one, np.int64(2), True, x, slots, law)
            q3, b3, past3, d3 = density(p, p + s3, np.int64(3), True, x, slots, law)
            force = pulled(pulled(pulled(pulled(NO_FORCE, lent.density[o0], d0), q1, d1), q2, d2), q3, d3)
            band = NO_FORCE
            if lent.band is not None:
                band = pulled(pulled(pulled(pulled(NO_FORCE, lent.band[o0], d0), b1, d1), b2, d2), b3, d3)
            if slots.bar is None:
                anywhere |= past2 | past3
            elif scratch.near is not None:
                lent.near[p] = 1 if past3 < 0 else 0
                scratch.near[i] = lent.near[o0] | (1 if past1 | past2 | past3 < 0 else 0)
                past1 = past2
            lent.density[p] = q3
            if lent.band is not None:
                lent.band[p] = b3
            q1, b1 = q2, b2
            kick_particle(p, i, force, band, kick, particles, law, scratch.f)
        if scratch.near is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
            if anywhere < 0:
                mark_near(begin, end, last, origin, s3, x, slots, law, scratch)
    if scratch.near is not None and slots.bar is None:
        mark_borrowed(first, last, origin, s0, scratch)


@inner_kernel
def clear_near(first, last, origin, past, scratch):
    """Of a run that borrows no particle has an element near its limits, unless the first has."""
    for p in range(first, last):
        scratch.near[p - origin] = scratch.lent.near[p] = 0
    if past < 0:
        scratch.near[first - origin] = 1


@inner_kernel
def mark_near(begin, end, last, origin, s3, x, slots, law, scratch):
    """Mark who has an element near its limits that the particles of a block lend; s3 : of `kick_borrowing`.

    last : of the run
    """
    near, one = scratch.near, np.uint64(1)
    for p in range(begin, end):
        for s in range(2, SLOTS):
            if not is_past(p, p + (one if s == 2 else s3), s, x, slots, law):
                continue
            near[p - origin] = 1
            if s == 3:
                scratch.lent.near[p] = 1
            elif p + one < last:
                near[p + one - origin] = 1


@inner_kernel
def is_past(p, o, s, x, slots, law):
    """Whether the element in slot s of particle p, whose far end is o, is past its limits."""
    d = x[0][o] - x[0][p], x[1][o] - x[1][p], x[2][o] - x[2][p]
    _, past, _ = force_density(d, s, p, np.int64(0), slots, law)
    return past < 0


@inner_kernel
def mark_borrowed(first, last, origin, s0, scratch):
    """Mark who borrows an element near its limits from one before; s0 : of `kick_borrowing`."""
    for p in range(first, last):
        scratch.near[p - origin] |= scratch.lent.near[p + s0]


@part_of_kernel
def kick_runs(c, kick_dt, zeta, share, chunks, particles, slots, law, scratch):
    """`kick_chunk` in runs; `Runs`."""
    origin = np.uint64(chunks.low[c])  # unsigned: no index then counts from the end
    runs = chunks.runs
    spans, whole, rest, loose = runs.spans, runs.whole, runs.rest, runs.loose
    x, f, f_rest, near_rest, other = particles.x, scratch.f, scratch.f_rest, scratch.near_rest, slots.other
    band_rest, lent_rest = scratch.band_rest, scratch.lent_rest
    kick = make_kick(kick_dt, zeta, share)
    first, last = np.uint64(spans[c, 2]), np.uint64(spans[c, 3])
    filled_up = first + np.uint64((spans[c, 3] - spans[c, 2] + LANES - 1) // LANES * LANES)
    if slots.branch_a is not None:  # whose state goes on once in a step
        filled_up = last
    for i in range(first, filled_up):
        p, k = np.uint64(rest[i]), i - first
        force, band, past, fourth = four_forces(p, far_ends(p, other), True, x, slots, law)
        f_rest[0][k], f_rest[1][k], f_rest[2][k] = force
        lend(k, fourth, lent_rest)
        near_rest[k] = 1 if past < 0 else 0
        if scratch.band is not None:
            band_rest[0][k], band_rest[1][k], band_rest[2][k] = band
    for i in range(first, last):
        k, p = i - first, np.uint64(rest[i])
        row = p - origin
        keep_row(row, row_of(f_rest, k), row_of(band_rest, k), scratch)
        scratch.lent.density[p] = lent_rest.density[k]
        if lent_rest.band is not None:
            scratch.lent.band[p] = lent_rest.band[k]
        if scratch.near is not None:
            scratch.lent.near[p], scratch.near[row] = lent_rest.near[k], near_rest[k]
    for r in range(spans[c, 0], spans[c, 1]):  # these may borrow from the rest
        if whole[r, 2 + SLOTS] == BORROWING:
            kick_borrowing(r, origin, kick, whole, particles, slots, law, scratch)
            continue
        if slots.highest is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
            if whole[r, 2 + SLOTS] == ORDERED:
                kick_run(r, origin, None, kick, whole, particles, slots, law, scratch)
                continue
        kick_run(r, origin, True, kick, whole, particles, slots, law, scratch)
    for r in range(spans[c, 4], spans[c, 5]):
        for p in range(np.uint64(loose[r, 0]), np.uint64(loose[r, 1])):
            i = p - origin
            kick_particle(p, i, row_of(f, i), row_of(scratch.band, i), kick, particles, law, f)
