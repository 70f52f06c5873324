"""The two passes over a chunk of particles: forces of the elements at each, then its motion.

A vector holds LANES particles, one after the other. Each sums over its own elements in the order of their
global numbers, so that the sum has the same bits on any number of ranks; an element is computed at both ends,
from the same bits. Forces wait in a scratch, which stays in the first cache.

What holds for a whole rank (whether all cables are alike, whether anything yields) is told by literals of
`part_of_kernel` functions, each of which is compiled once for each combination that matters for speed. What a
scene has besides is looked up at run time (`has`).
"""

from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.records import Record, f8_2, has, u1
from netfall.core.vectors import (
    LANES,
    add,
    any_of,
    fma,
    gather,
    load,
    load_truths,
    nowhere,
    put,
    store,
    store_truths,
    where,
    zeros,
)
from netfall.mechanics.law.limits import NEARLY
from netfall.physics.targets import CPU, element, particle

GENERAL, RARE, SIDEWAYS, PART_HELD = 1, 2, 4, 8  # bits of what a rank has, `plan.traits_of`
INFINITE = float("inf")

inverse_length, elastic_density, logarithmic_density = (
    element.inverse_length,
    element.elastic_density,
    element.logarithmic_density,
)
logarithmic_strain, grown, shrunk, branch = (
    element.logarithmic_strain,
    element.grown,
    element.shrunk,
    element.branch,
)
madd = CPU.madd
dot, between, kicked, off_guide, air_pull = (
    particle.dot,
    particle.between,
    particle.kicked,
    particle.off_guide,
    particle.air_pull,
)


class Scratch(Record):
    """Of the particles of a chunk: f (3, c) [N] sums over their elements, and of the branches alone (absent:
    there are none); near (c,) 1 where an element is near its limits.
    """

    f: f8_2
    band: f8_2
    near: u1


@part_of_kernel
def limits_of(s, p, bar, slots, law):
    """Force [N] at which the elements in slot s yield in tension; the lowest that they bear."""
    highest = zeros() + law.yield_force
    if has(slots.yield_force):
        highest = load(slots.yield_force, s, p)
    lowest = where(bar, -highest, zeros())
    if has(slots.euler):
        buckling = -load(slots.euler, s, p)
        lowest = where(buckling > lowest, buckling, lowest)
    return highest, lowest


@part_of_kernel
def is_past(q, per_L, per_L0, s, p, bar, slots, law):
    """Where elastic elements in slot s are near yield or fracture; q : N / L [N/m] before any limit."""
    if law.alike:
        past = fma(law.near, per_L, -q) < 0.0
    else:
        past = nowhere()
        if law.plastic:
            highest = zeros() + law.yield_force
            if has(slots.yield_force):
                highest = load(slots.yield_force, s, p)
            past = past | (fma(NEARLY, highest * per_L, -q) < 0.0)
        past = past | is_stretched(per_L, per_L0, s, p, slots, law)
    if law.plastic:
        highest = zeros() + law.yield_force
        if has(slots.yield_force):
            highest = load(slots.yield_force, s, p)
        past = past | (bar & (fma(NEARLY, highest * per_L, q) < 0.0))
    return past | is_crushed(per_L, per_L0, s, p, bar, slots, law)


@part_of_kernel
def is_stretched(per_L, per_L0, s, p, slots, law):
    """Where elements in slot s are near fracture."""
    reach = zeros() + law.reach
    if has(slots.reach):
        reach = load(slots.reach, s, p)
    return fma(reach, per_L, -per_L0) < 0.0


@part_of_kernel
def is_crushed(per_L, per_L0, s, p, bar, slots, law):
    """Where bars that buckle are near fracture in compression."""
    crushed = nowhere()
    if has(slots.euler) and law.reach < INFINITE:
        reach = zeros() + law.reach
        if has(slots.reach):
            reach = load(slots.reach, s, p)
        crushed = bar & (fma(reach, per_L0, -per_L) < 0.0)
    return crushed


@part_of_kernel
def general_density(s, p, per_L, L, per_L0, eps_p, limited, yields, bar, slots, law):
    """N / L [N/m] of elements of any kind; where they are near their limits; their plastic strain."""
    EA = zeros() + law.EA
    if has(slots.EA):
        EA = load(slots.EA, s, p)
    stretch = L * per_L0
    if law.logarithmic:
        q = logarithmic_density(stretch, per_L, eps_p, EA)
    else:
        q = elastic_density(per_L, per_L0, eps_p, EA)
    past, new, highest, lowest = nowhere(), eps_p, zeros(), where(bar, zeros() - INFINITE, zeros())
    if yields:
        limit = zeros() + law.yield_strain
        if has(slots.yield_strain):
            limit = load(slots.yield_strain, s, p)
        eps = logarithmic_strain(stretch) if law.logarithmic else stretch - 1.0
        new = grown(eps, eps_p, limit)
        by_force = bar
        if has(slots.euler):
            by_force = bar & (load(slots.euler, s, p) == INFINITE)
        new = where(by_force, smaller(new, eps + limit), new)
        past = bar & (new != eps_p)  # their heat does not follow from their plastic strain
        new = where(bar, eps_p, new)
        past = past | is_stretched(per_L, per_L0, s, p, slots, law)
        past = past | is_crushed(per_L, per_L0, s, p, bar, slots, law)
        highest, lowest = limits_of(s, p, bar, slots, law)
        highest, lowest = highest * per_L, where(lowest < 0.0, lowest * per_L, zeros())
        q = where(q > highest, highest, q)
    else:
        if limited:
            past = is_past(q, per_L, per_L0, s, p, bar, slots, law)
        if has(slots.euler):
            buckled = -load(slots.euler, s, p) * per_L
            lowest = where(buckled > lowest, buckled, lowest)
    return where(q > lowest, q, lowest), past, new


@part_of_kernel
def smaller(a, b):
    """The smaller one."""
    return where(a < b, a, b)


@part_of_kernel
def cable_density(s, p, per_L, L, per_L0, eps_p, limited, yields, slots, law):
    """N / L [N/m] of cables that are all alike, in the engineering strain; the rest as `general_density`."""
    q, past, new = elastic_density(per_L, per_L0, eps_p, law.EA), nowhere(), eps_p
    if yields:
        new = grown(L * per_L0 - 1.0, eps_p, law.yield_strain)
        past = fma(law.reach, per_L, -per_L0) < 0.0
        highest = law.yield_force * per_L
        q = where(q > highest, highest, q)
    elif limited:
        past = fma(law.near, per_L, -q) < 0.0
    return where(q > 0.0, q, zeros()), past, new


@part_of_kernel
def keep_extremes(N, skipped, s, p, slots):
    """Take in axial forces N [N] of the elements in slot s, but where they are skipped."""
    most = load(slots.highest, s, p)
    more = where(skipped, most, N) > most
    if any_of(more):
        store(slots.highest, s, p, where(more, N, most))
    if has(slots.lowest):
        least = load(slots.lowest, s, p)
        less = where(skipped, least, N) < least
        if any_of(less):
            store(slots.lowest, s, p, where(less, N, least))


@part_of_kernel
def with_branches(q, per_L, L, s, p, high, bar, slots, law):
    """N / L [N/m] with the branches of axial damping, without them q; their state goes on to n + 1."""
    of, N = law.branches, q * L
    a, b = load(slots.branch_a, s, p), load(slots.branch_b, s, p)
    held = a + b
    put(p, high, slots.branch_a, s, branch(a, N, of[2, 0], of[3, 0]))
    put(p, high, slots.branch_b, s, branch(b, N, of[2, 1], of[3, 1]))
    if has(slots.branch_c):
        c = load(slots.branch_c, s, p)
        held = held + c
        put(p, high, slots.branch_c, s, branch(c, N, of[2, 2], of[3, 2]))
    total = fma(-held, per_L, of[4, 0] * q)
    return where(bar | (total > 0.0), total, zeros())


@part_of_kernel
def add_forces(low, high, width, general, limited, yields, x, slots, law, scratch):
    """Sum the forces of the elements at particles low to high into the scratch; whether any is near a limit.

    width : most elements at one of them
    general : whether they are not all cables of one section; limited : whether any may yield or break;
        yields : whether they have plastic strains: these go on to the present positions
    x : (3, n) [m]
    """
    f, near, anywhere = scratch.f, scratch.near, nowhere()
    peaks, branches = has(slots.highest), general and has(law.branches)
    bars = general and has(slots.bar)
    for p in range(low, high, LANES):
        i = p - low
        px, py, pz = load(x, 0, p), load(x, 1, p), load(x, 2, p)
        fx, fy, fz, past = zeros(), zeros(), zeros(), nowhere()
        bx, by, bz, bar = zeros(), zeros(), zeros(), nowhere()
        for s in range(width):
            dx = gather(x, 0, slots.other, s, p) - px
            dy = gather(x, 1, slots.other, s, p) - py
            dz = gather(x, 2, slots.other, s, p) - pz
            per_L, L = inverse_length(dx, dy, dz)
            per_L0, eps_p = load(slots.inv_L0, s, p), zeros()
            if yields:
                eps_p = load(slots.eps_p, s, p)
            if general:
                if bars:
                    bar = load_truths(slots.bar, s, p)
                q, here, new = general_density(
                    s, p, per_L, L, per_L0, eps_p, limited, yields, bar, slots, law
                )
            else:
                q, here, new = cable_density(s, p, per_L, L, per_L0, eps_p, limited, yields, slots, law)
            if yields and any_of(new != eps_p):
                put(p, high, slots.eps_p, s, new)
            past = past | here
            if peaks:  # what may yet yield comes again
                keep_extremes(q * L, here if limited and law.plastic else nowhere(), s, p, slots)
            if branches:
                total = with_branches(q, per_L, L, s, p, high, bar, slots, law)
                alone = total - q
                bx, by, bz = fma(alone, dx, bx), fma(alone, dy, by), fma(alone, dz, bz)
                q = total
            fx, fy, fz = fma(q, dx, fx), fma(q, dy, fy), fma(q, dz, fz)
        store(f, 0, i, fx)
        store(f, 1, i, fy)
        store(f, 2, i, fz)
        if branches:
            store(scratch.band, 0, i, bx)
            store(scratch.band, 1, i, by)
            store(scratch.band, 2, i, bz)
        if limited or yields:
            store_truths(near, 0, i, past)
            anywhere = anywhere | past
    return any_of(anywhere)


@inner_kernel
def elastic_cables(low, high, width, x, slots, law, scratch):
    """`add_forces` of cables of one section that never yield or break."""
    return add_forces(low, high, width, False, False, False, x, slots, law, scratch)


@inner_kernel
def limited_cables(low, high, width, x, slots, law, scratch):
    """The same of those that may; what is near a limit comes again, with `yielding_cables`."""
    return add_forces(low, high, width, False, True, False, x, slots, law, scratch)


@inner_kernel
def yielding_cables(low, high, width, x, slots, law, scratch):
    """The same with plastic strains."""
    return add_forces(low, high, width, False, False, True, x, slots, law, scratch)


@inner_kernel
def limited_elements(low, high, width, x, slots, law, scratch):
    """`add_forces` of elements of any kind without plastic strains."""
    return add_forces(low, high, width, True, True, False, x, slots, law, scratch)


@inner_kernel
def yielding_elements(low, high, width, x, slots, law, scratch):
    """The same with plastic strains."""
    return add_forces(low, high, width, True, False, True, x, slots, law, scratch)


@inner_kernel
def chunk_forces(c, traits, x, chunks, slots, law, scratch):
    """Forces of the elements at the particles of chunk c, with yield; whether any is near a limit."""
    low, high, width = chunks.low[c], chunks.high[c], chunks.width[c]
    if traits & GENERAL:
        if not (law.plastic and (chunks.has_yielded[c] or has(law.branches))):
            near = limited_elements(low, high, width, x, slots, law, scratch)
            if not (near and law.plastic):
                return near
        chunks.has_yielded[c] = 1
        return yielding_elements(low, high, width, x, slots, law, scratch)
    if not law.plastic and law.near == INFINITE:
        return elastic_cables(low, high, width, x, slots, law, scratch)
    if not chunks.has_yielded[c]:
        near = limited_cables(low, high, width, x, slots, law, scratch)
        if not (near and law.plastic):
            return near
    chunks.has_yielded[c] = 1
    return yielding_cables(low, high, width, x, slots, law, scratch)


# --- motion


@part_of_kernel
def external_forces(p, share, rare, traits, particles):
    """External forces [N] on LANES particles from p on, three; share : place between two samples."""
    ex, ey, ez = zeros(), zeros(), load(particles.load, 2, p)
    if traits & SIDEWAYS:
        ex, ey = load(particles.load, 0, p), load(particles.load, 1, p)
    if rare and has(particles.load_before):
        before, after = particles.load_before, particles.load_after
        ex = ex + between(load(before, 0, p), load(after, 0, p), share)
        ey = ey + between(load(before, 1, p), load(after, 1, p), share)
        ez = ez + between(load(before, 2, p), load(after, 2, p), share)
    if has(particles.wind):
        speed = between(load(particles.speed_before, 0, p), load(particles.speed_after, 0, p), share)
        if not has(particles.tapped):
            speed = speed * speed
        ex = madd(load(particles.wind, 0, p), speed, ex)
        ey = madd(load(particles.wind, 1, p), speed, ey)
        ez = madd(load(particles.wind, 2, p), speed, ez)
    if rare and has(particles.drag):
        ex, ey, ez = (
            ex + load(particles.drag, 0, p),
            ey + load(particles.drag, 1, p),
            ez + load(particles.drag, 2, p),
        )
    return ex, ey, ez


@part_of_kernel
def with_springs(p, nx, ny, nz, x, particles):
    """Internal forces [N], three, with those of elastic supports."""
    off_x = load(particles.spring_zero, 0, p) - load(x, 0, p)
    off_y = load(particles.spring_zero, 1, p) - load(x, 1, p)
    off_z = load(particles.spring_zero, 2, p) - load(x, 2, p)
    nx = madd(load(particles.spring, 0, p), off_x, nx)
    ny = madd(load(particles.spring, 1, p), off_y, ny)
    nz = madd(load(particles.spring, 2, p), off_z, nz)
    if has(particles.turned):
        turned = load(particles.turned, 2, p)
        nx, ny = madd(turned, off_y, nx), madd(turned, off_x, ny)
    return nx, ny, nz


@part_of_kernel
def damped_mass(p, particles):
    """Mass [kg] on which the mass-proportional damping acts."""
    mass = load(particles.mass, 0, p)
    if has(particles.air_mass):
        mass = mass - load(particles.air_mass, 0, p)
    return mass


@part_of_kernel
def with_air(p, fx, fy, fz, kick_dt, zeta, share, particles):
    """Total forces [N] with those of the air, three, and that of the air's damping over -c.

    With u = v(n-1/2) + dt f / 2M, h = zeta dt / 2 of the mass without air and a = |U| c^2 dt / 2M the mean
    velocity is u / (1 + h) across c and u / (1 + h + a) along it.
    """
    half, pull = 0.5 * kick_dt * load(particles.per_mass, 0, p), zeros()
    vx, vy, vz = load(particles.v, 0, p), load(particles.v, 1, p), load(particles.v, 2, p)
    if has(particles.air):
        cx, cy, cz = load(particles.air, 0, p), load(particles.air, 1, p), load(particles.air, 2, p)
        before, after = load(particles.air_pull, 0, p), load(particles.air_pull, 1, p)
        size = abs(fma(share, after - before, before))
        pull = air_pull(size, half, cx, cy, cz, fx, fy, fz, vx, vy, vz)
        fx, fy, fz = fma(-pull, cx, fx), fma(-pull, cy, fy), fma(-pull, cz, fz)
    if has(particles.air_mass):
        air = load(particles.air_mass, 0, p)
        spared = zeta * air / madd(half * zeta, load(particles.mass, 0, p) - air, 1.0 + zeros())
        fx, fy, fz = (
            madd(spared, madd(half, fx, vx), fx),
            madd(spared, madd(half, fy, vy), fy),
            madd(spared, madd(half, fz, vz), fz),
        )
    return fx, fy, fz, pull


@part_of_kernel
def air_work(p, duration, pull, tx, ty, tz, particles):
    """Work [J] of the air's damping in some time [s] of a kick; (tx, ..) twice the mean velocity there."""
    cx, cy, cz = load(particles.air, 0, p), load(particles.air, 1, p), load(particles.air, 2, p)
    return (0.5 * duration * pull) * dot(cx, cy, cz, tx, ty, tz)


@part_of_kernel
def with_ground(p, k, total, zeta, particles):
    """A total force [N] along axis k with that of the damping for the ground's own velocity."""
    pull = zeta * damped_mass(p, particles) * load(particles.ground, k, p)
    return total + where(load_truths(particles.free, k, p), pull, zeros())


@part_of_kernel
def held_velocity(p, k, old, new, particles):
    """Velocities [m/s] along axis k after a kick: of what is held that of the ground."""
    held = old
    if has(particles.ground):
        held = load(particles.ground, k, p)
    return where(load_truths(particles.free, k, p), new, held)


@part_of_kernel
def works_of_motion(p, k, old, new, duration, way, force, mean, zeta, particles):
    """Works [J] of damping and of the ground along axis k; the velocities go from old to new.

    duration : [s]; way : [m] meanwhile; force : [N], external and internal; mean : [m/s] over the whole kick
    """
    ground, free = load(particles.ground, k, p), load_truths(particles.free, k, p)
    pull = zeta * damped_mass(p, particles) * (mean - ground)
    held = 0.5 * load(particles.mass, 0, p) * (new * new - old * old) - way * force
    damping = where(free, pull * (way - duration * ground), zeros())
    return damping, where(free, -pull * duration * ground, held)


@part_of_kernel
def add_works_along(p, high, k, old, new, internal, external, kick_dt, zeta, particles):
    """Add the works [J] of a kick along axis k, where supports may move."""
    mean = 0.5 * (old + new)
    way = kick_dt * mean
    damping, ground = works_of_motion(
        p, k, old, new, kick_dt, way, external + internal, mean, zeta, particles
    )
    add(p, high, particles.work, 0, way * external)
    add(p, high, particles.work, 1, way * internal)
    add(p, high, particles.work, 2, damping)
    add(p, high, particles.other_work, 2, ground)


@part_of_kernel
def move(low, high, rare, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, law, scratch):
    """Kick particles low to high under the forces in the scratch, with work, and move them from x to y.

    rare : whether the scene has anything of what is looked up under that word
    keeps : whether their total forces [N] are written to particles.f
    """
    h = 0.5 * zeta * kick_dt
    c_v, c_a = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h)
    half, quarter = 0.5 * kick_dt, 0.25 * kick_dt * zeta
    f, v, work = scratch.f, particles.v, particles.work
    springs, turned = rare and has(particles.spring), rare and has(particles.turned)
    ground, part_held = rare and has(particles.ground), rare and traits & PART_HELD != 0
    air = rare and (has(particles.air) or has(particles.air_mass))
    energy, others = has(work), rare and has(particles.other_work)
    for p in range(low, high, LANES):
        i = p - low
        nx, ny, nz = load(f, 0, i), load(f, 1, i), load(f, 2, i)
        ux, uy, uz = load(v, 0, p), load(v, 1, p), load(v, 2, p)
        if rare and has(particles.bend):
            nx, ny, nz = (
                nx + load(particles.bend, 0, p),
                ny + load(particles.bend, 1, p),
                nz + load(particles.bend, 2, p),
            )
        if springs:
            nx, ny, nz = with_springs(p, nx, ny, nz, x, particles)
        ex, ey, ez = external_forces(p, share, rare, traits, particles)
        tx, ty, tz, pull = nx + ex, ny + ey, nz + ez, zeros()
        if ground:
            tx, ty, tz = (
                with_ground(p, 0, tx, zeta, particles),
                with_ground(p, 1, ty, zeta, particles),
                with_ground(p, 2, tz, zeta, particles),
            )
        if air:
            tx, ty, tz, pull = with_air(p, tx, ty, tz, kick_dt, zeta, share, particles)
        if keeps:
            put(p, high, particles.f, 0, tx)
            put(p, high, particles.f, 1, ty)
            put(p, high, particles.f, 2, tz)
        if turned:
            tx, ty = off_guide(load(particles.turned, 0, p), load(particles.turned, 1, p), tx, ty)
        per_mass = load(particles.per_mass, 0, p)
        vx, vy, vz = (
            kicked(ux, tx * per_mass, c_v, c_a),
            kicked(uy, ty * per_mass, c_v, c_a),
            kicked(uz, tz * per_mass, c_v, c_a),
        )
        if part_held:
            vx, vy, vz = (
                held_velocity(p, 0, ux, vx, particles),
                held_velocity(p, 1, uy, vy, particles),
                held_velocity(p, 2, uz, vz, particles),
            )
        mx, my, mz = ux + vx, uy + vy, uz + vz  # twice the mean
        if others:
            if has(law.branches):
                of = dot(
                    *(mx, my, mz),
                    *(load(scratch.band, 0, i), load(scratch.band, 1, i), load(scratch.band, 2, i)),
                )
                put(p, high, particles.other_work, 1, fma(-half, of, load(particles.other_work, 1, p)))
            if has(particles.air):
                add(p, high, particles.other_work, 0, air_work(p, kick_dt, pull, mx, my, mz, particles))
        if ground:
            if energy:
                add_works_along(p, high, 0, ux, vx, nx, ex, kick_dt, zeta, particles)
                add_works_along(p, high, 1, uy, vy, ny, ey, kick_dt, zeta, particles)
                add_works_along(p, high, 2, uz, vz, nz, ez, kick_dt, zeta, particles)
        elif energy:
            mass = load(particles.mass, 0, p)
            if rare and has(particles.air_mass):
                mass = mass - load(particles.air_mass, 0, p)
            put(p, high, work, 0, fma(half, dot(mx, my, mz, ex, ey, ez), load(work, 0, p)))
            put(p, high, work, 1, fma(half, dot(mx, my, mz, nx, ny, nz), load(work, 1, p)))
            put(p, high, work, 2, fma(quarter * mass, dot(mx, my, mz, mx, my, mz), load(work, 2, p)))
        put(p, high, v, 0, vx)
        put(p, high, v, 1, vy)
        put(p, high, v, 2, vz)
        put(p, high, y, 0, madd(dt, vx, load(x, 0, p)))
        put(p, high, y, 1, madd(dt, vy, load(x, 1, p)))
        put(p, high, y, 2, madd(dt, vz, load(x, 2, p)))


@inner_kernel
def move_chunk(low, high, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, law, scratch):
    """`move` of the particles of a chunk."""
    if traits & RARE:
        move(low, high, True, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, law, scratch)
    else:
        move(low, high, False, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, law, scratch)


@inner_kernel
def move_halo(low, high, traits, kick_dt, zeta, dt, x, y, particles):
    """Kick and move halo particles low to high, whose total forces their owners have sent."""
    h = 0.5 * zeta * kick_dt
    c_v, c_a = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h)
    f, v = particles.f, particles.v
    for p in range(low, high, LANES):
        tx, ty, tz, per_mass = load(f, 0, p), load(f, 1, p), load(f, 2, p), load(particles.per_mass, 0, p)
        if has(particles.turned):
            tx, ty = off_guide(load(particles.turned, 0, p), load(particles.turned, 1, p), tx, ty)
        ux, uy, uz = load(v, 0, p), load(v, 1, p), load(v, 2, p)
        vx, vy, vz = (
            kicked(ux, tx * per_mass, c_v, c_a),
            kicked(uy, ty * per_mass, c_v, c_a),
            kicked(uz, tz * per_mass, c_v, c_a),
        )
        if traits & PART_HELD:
            vx, vy, vz = (
                held_velocity(p, 0, ux, vx, particles),
                held_velocity(p, 1, uy, vy, particles),
                held_velocity(p, 2, uz, vz, particles),
            )
        put(p, high, v, 0, vx)
        put(p, high, v, 1, vy)
        put(p, high, v, 2, vz)
        put(p, high, y, 0, madd(dt, vx, load(x, 0, p)))
        put(p, high, y, 1, madd(dt, vy, load(x, 1, p)))
        put(p, high, y, 2, madd(dt, vz, load(x, 2, p)))
