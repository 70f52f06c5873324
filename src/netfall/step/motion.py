"""The second pass over a chunk of particles: forces on each besides its elements', kick, work and new place.

`total_forces` and `kick` serve any scene; where a particle has loads and wind alone, which may slow down no
large net, `move` does both at once. Rows of the history use `total_forces` too (`audit`).
"""

from netfall.core.kernels import inner_kernel, part_of_kernel
from netfall.core.records import has
from netfall.core.vectors import LANES, fma, load, load_truths, put, store, where, zeros
from netfall.physics.targets import particle

PLAIN_LAW, RARE, SIDEWAYS, PART_HELD = 1, 2, 4, 8  # bits of what a rank has, `plan.traits_of`
between, kicked, moved = particle.between, particle.kicked, particle.moved
works_of_motion = particle.works_of_motion


@part_of_kernel
def squared_speed(p, share, particles):
    """Squares [m2/s2] of the wind speeds at LANES particles from p on; of pressures in time these [N/m2]."""
    square = zeros()
    if has(particles.wind):
        square = between(load(particles.speed_before, 0, p), load(particles.speed_after, 0, p), share)
        if not has(particles.tapped):
            square = square * square
    return square


@part_of_kernel
def constant_load(k, p, traits, particles):
    """Constant load [N] along axis k."""
    force = zeros()
    if k == 2 or traits & SIDEWAYS:
        force = load(particles.load, k, p)
    return force


@part_of_kernel
def damped_mass(p, particles):
    """Mass [kg] on which the mass-proportional damping acts."""
    mass = load(particles.mass, 0, p)
    if has(particles.air_mass):
        mass = mass - load(particles.air_mass, 0, p)
    return mass


@inner_kernel
def total_forces(low, high, with_supports, kick_dt, zeta, share, traits, x, particles, scratch):
    """Forces on particles low to high, whose elements' are in scratch.f, into external, total and pull.

    with_supports : whether f has yet to get those of chains that bend and of elastic supports
    kick_dt : [s] length of the kick; share : place between two samples of the loads
    """
    f = scratch.f
    for p in range(low, high, LANES):
        i, square = p - low, squared_speed(p, share, particles)
        for k in range(3):
            n, e = load(f, k, i), constant_load(k, p, traits, particles)
            if with_supports and has(particles.bend):
                n = n + load(particles.bend, k, p)
            if with_supports and has(particles.spring):
                off = load(particles.spring_zero, k, p) - load(x, k, p)
                n = fma(load(particles.spring, k, p), off, n)
                if has(particles.turned) and k < 2:
                    across = load(particles.spring_zero, 1 - k, p) - load(x, 1 - k, p)
                    n = fma(load(particles.turned, 2, p), across, n)
            if has(particles.load_before):
                after = load(particles.load_after, k, p)
                e = e + between(load(particles.load_before, k, p), after, share)
            if has(particles.wind):
                e = fma(load(particles.wind, k, p), square, e)
            if has(particles.drag):
                e = e + load(particles.drag, k, p)
            t = n + e
            if has(particles.ground):  # the damping holds to the ground below
                pulled = fma(zeta * damped_mass(p, particles), load(particles.ground, k, p), t)
                t = where(load_truths(particles.free, k, p), pulled, t)
            store(f, k, i, n)
            store(scratch.external, k, i, e)
            store(scratch.total, k, i, t)
        half = 0.5 * kick_dt * load(particles.per_mass, 0, p)
        if has(particles.air):
            add_air_damping(p, i, half, share, particles, scratch)
        if has(particles.air_mass):
            add_air_mass(p, i, half, zeta, particles, scratch)


@part_of_kernel
def add_air_damping(p, i, half, share, particles, scratch):
    """Add the air's damping to the total forces of LANES particles from p on.

    With u = v(n-1/2) + dt f / 2M, h = zeta dt / 2 of the mass without air and a = |U| c^2 dt / 2M the mean
    velocity is u / (1 + h) across c and u / (1 + h + a) along it. half : dt / 2M
    """
    total, along_f, along_v = scratch.total, zeros(), zeros()
    for k in range(3):
        c = load(particles.air, k, p)
        along_f, along_v = fma(c, load(total, k, i), along_f), fma(c, load(particles.v, k, p), along_v)
    before, after = load(particles.air_pull, 0, p), load(particles.air_pull, 1, p)
    pull = abs(fma(share, after - before, before)) * fma(half, along_f, along_v)
    store(scratch.pull, 0, i, pull)
    for k in range(3):
        store(total, k, i, fma(-pull, load(particles.air, k, p), load(total, k, i)))


@part_of_kernel
def add_air_mass(p, i, half, zeta, particles, scratch):
    """Spare the air that moves along the mass-proportional damping. half : dt / 2M [s/kg]"""
    air = load(particles.air_mass, 0, p)
    spared = zeta * air / fma(half * zeta, load(particles.mass, 0, p) - air, 1.0)
    for k in range(3):
        t = load(scratch.total, k, i)
        store(scratch.total, k, i, fma(spared, fma(half, t, load(particles.v, k, p)), t))


@part_of_kernel
def force_along_guides(p, i, total, particles):
    """Total forces [N] along the lines on which supports hold LANES particles from p on, zero elsewhere."""
    along = zeros()
    if has(particles.turned):
        nx, ny = load(particles.turned, 0, p), load(particles.turned, 1, p)
        along = fma(nx, load(total, 0, i), ny * load(total, 1, i))
    return along


@part_of_kernel
def free_force(k, p, i, total, along, particles):
    """Total forces [N] along axis k less what such supports take. along : of `force_along_guides`"""
    force = load(total, k, i)
    if has(particles.turned) and k < 2:
        force = fma(-along, load(particles.turned, k, p), force)
    return force


@inner_kernel
def keep_totals(low, high, particles, scratch):
    """Total forces [N] of particles low to high from the scratch to particles.f."""
    for k in range(3):
        for p in range(low, high, LANES):
            put(p, high, particles.f, k, load(scratch.total, k, p - low))


@part_of_kernel
def new_velocity(k, p, old, total, per_mass, c_v, c_a, traits, particles):
    """Velocities [m/s] along axis k after a kick under total forces [N]; of what is held the ground's."""
    new = kicked(old, total * per_mass, c_v, c_a)
    if traits & PART_HELD:
        held = old
        if has(particles.ground):
            held = load(particles.ground, k, p)
        new = where(load_truths(particles.free, k, p), new, held)
    return new


@part_of_kernel
def add_works(p, high, half, quarter, external, internal, square, particles):
    """Add works [J] of a kick; the three : twice the mean velocity times forces, and times itself."""
    work = particles.work
    put(p, high, work, 0, fma(half, external, load(work, 0, p)))
    put(p, high, work, 1, fma(half, internal, load(work, 1, p)))
    put(p, high, work, 2, fma(quarter * damped_mass(p, particles), square, load(work, 2, p)))


@inner_kernel
def kick(low, high, traits, kick_dt, zeta, dt, x, y, particles, scratch):
    """Kick particles low to high under the forces in the scratch, with work, and move them from x to y."""
    h = 0.5 * zeta * kick_dt
    c_v, c_a, half, quarter = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h), 0.5 * kick_dt, 0.25 * kick_dt * zeta
    v, energy, ground, air = particles.v, has(particles.work), has(particles.ground), has(particles.air)
    work, other, band = particles.work, particles.other_work, has(scratch.band)
    for p in range(low, high, LANES):
        i, per_mass = p - low, load(particles.per_mass, 0, p)
        external, internal, square, of_band, of_air = zeros(), zeros(), zeros(), zeros(), zeros()
        along = force_along_guides(p, i, scratch.total, particles)
        for k in range(3):
            n, e, old = load(scratch.f, k, i), load(scratch.external, k, i), load(v, k, p)
            total = free_force(k, p, i, scratch.total, along, particles)
            new = new_velocity(k, p, old, total, per_mass, c_v, c_a, traits, particles)
            twice = old + new
            external, internal, square = (
                fma(twice, e, external),
                fma(twice, n, internal),
                fma(twice, twice, square),
            )
            if band:
                of_band = fma(twice, load(scratch.band, k, i), of_band)
            if air:
                of_air = fma(load(particles.air, k, p), twice, of_air)
            if ground and energy:
                free = load_truths(particles.free, k, p)
                way, at = 0.5 * kick_dt * twice, load(particles.ground, k, p)
                mass, damped = load(particles.mass, 0, p), damped_mass(p, particles)
                pull, against, gained = works_of_motion(mass, damped, zeta, at, old, new, twice, kick_dt)
                put(p, high, work, 0, fma(way, e, load(work, 0, p)))
                put(p, high, work, 1, fma(way, n, load(work, 1, p)))
                so_far, by_ground = load(work, 2, p), load(other, 2, p)
                put(p, high, work, 2, where(free, fma(pull, against, so_far), so_far))
                held, drawn = fma(-way, e + n, gained) + by_ground, fma(-pull * kick_dt, at, by_ground)
                put(p, high, other, 2, where(free, drawn, held))
            put(p, high, v, k, new)
            put(p, high, y, k, moved(load(x, k, p), new, dt))
        if energy and not ground:
            add_works(p, high, half, quarter, external, internal, square, particles)
        if energy and band:
            put(p, high, other, 1, fma(-half, of_band, load(other, 1, p)))
        if energy and air:
            put(p, high, other, 0, fma(half * load(scratch.pull, 0, i), of_air, load(other, 0, p)))


@part_of_kernel
def move_vector(p, high, whole, i, keeps, traits, times, x, y, particles, scratch):
    """`move` of the particles from p on; whole : whether there are LANES of them below high

    times : kick_dt [s], zeta [1/s], share, dt [s] of `move`
    """
    kick_dt, zeta, share, dt = times
    h = 0.5 * zeta * kick_dt
    c_v, c_a, half, quarter = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h), 0.5 * kick_dt, 0.25 * kick_dt * zeta
    v, per_mass, square = particles.v, load(particles.per_mass, 0, p), squared_speed(p, share, particles)
    external, internal, squares, energy = zeros(), zeros(), zeros(), has(particles.work)
    for k in range(3):
        n, e, old = load(scratch.f, k, i), constant_load(k, p, traits, particles), load(v, k, p)
        if has(particles.wind):
            e = fma(load(particles.wind, k, p), square, e)
        if keeps:
            put(p, high, particles.f, k, n + e)
        new = kicked(old, (n + e) * per_mass, c_v, c_a)
        if energy:
            twice = old + new
            external, internal = fma(twice, e, external), fma(twice, n, internal)
            squares = fma(twice, twice, squares)
        place = moved(load(x, k, p), new, dt)
        if whole:
            store(v, k, p, new)
            store(y, k, p, place)
        else:
            put(p, high, v, k, new)
            put(p, high, y, k, place)
    if energy:
        add_works(p, high, half, quarter, external, internal, squares, particles)


@inner_kernel
def move(low, high, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, scratch):
    """`total_forces` and `kick` at once, of particles on which loads and wind act besides their elements.

    keeps : whether their total forces [N] are written to particles.f
    """
    rest = (high - low) % LANES
    of_all = keeps, traits, (kick_dt, zeta, share, dt), x, y, particles, scratch
    for p in range(low, high - rest, LANES):
        move_vector(p, high, True, p - low, *of_all)
    if rest:
        move_vector(high - rest, high, False, high - rest - low, *of_all)


@inner_kernel
def move_chunk(low, high, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, scratch):
    """Kick and move the particles of a chunk, whose elements' forces are in the scratch."""
    if not traits & RARE:
        move(low, high, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, scratch)
        return
    total_forces(low, high, True, kick_dt, zeta, share, traits, x, particles, scratch)
    if keeps:
        keep_totals(low, high, particles, scratch)
    kick(low, high, traits, kick_dt, zeta, dt, x, y, particles, scratch)


@inner_kernel
def move_halo(low, high, traits, kick_dt, zeta, dt, x, y, particles):
    """Kick and move halo particles low to high, whose total forces their owners have sent."""
    h = 0.5 * zeta * kick_dt
    c_v, c_a, v = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h), particles.v
    for p in range(low, high, LANES):
        per_mass, along = load(particles.per_mass, 0, p), force_along_guides(p, p, particles.f, particles)
        for k in range(3):
            total = free_force(k, p, p, particles.f, along, particles)
            new = new_velocity(k, p, load(v, k, p), total, per_mass, c_v, c_a, traits, particles)
            put(p, high, v, k, new)
            put(p, high, y, k, moved(load(x, k, p), new, dt))
