"""Second pass over a chunk of particles: the remaining forces, velocity update, work and position update.

`total_forces` and `update_velocities` are for any problem. `move_vector` does both at once for particles with
only loads and wind; it is the fast path of large nets. History rows use `total_forces` too (`energy_check`).
The wind force is computed here.
"""

from netfall.core.arrays import FloatArray, Index, Lanes
from netfall.core.kernels import copied_kernel, inner_kernel, part_of_kernel
from netfall.core.records import is_present
from netfall.core.vectors import (
    LANES,
    fma,
    index_in,
    load,
    load_at,
    load_mask,
    store,
    store_at,
    store_below,
    where,
    zeros,
)
from netfall.explicit.forces import Scratch
from netfall.physics.fields import Particles
from netfall.physics.particle_step import between, next_v, next_x, works_of_motion

HORIZONTAL_LOAD, PARTLY_FIXED = 1, 2  # feature bits of a rank, set by `plan.feature_bits`


@part_of_kernel
def squared_speed(p: int, share: float, particles: Particles) -> Lanes:
    """Return squared wind speeds [m2/s2], gusts included, at LANES particles from p on.

    Speeds are interpolated and then squared (paper Eq. 7). Given pressures are returned instead [N/m2].
    """
    square = zeros()
    if is_present(particles.wind):
        square = between(load(particles.speed_before, 0, p), load(particles.speed_after, 0, p), share)
        if not is_present(particles.tapped):
            square = square * square
    return square


@part_of_kernel
def constant_load(k: int, at: Index, traits: int, particles: Particles) -> Lanes:
    """Return the constant load [N] along axis k; at : index of the particles there (`vectors.index_in`)"""
    force = zeros()
    if k == 2 or traits & HORIZONTAL_LOAD:
        force = load_at(particles.load, at)
    return force


@part_of_kernel
def damped_mass(p: int, particles: Particles) -> Lanes:
    """Return the mass [kg] on which the mass-proportional damping acts."""
    mass = load(particles.mass, 0, p)
    if is_present(particles.air_mass):
        mass = mass - load(particles.air_mass, 0, p)
    return mass


@inner_kernel
def total_forces(
    low: int,
    high: int,
    with_supports: int,
    dt_v: float,
    zeta: float,
    share: float,
    traits: int,
    x: FloatArray,
    particles: Particles,
    scratch: Scratch,
) -> None:
    """Compute external, total and air damping forces on particles low to high; scratch.f has element forces.

    with_supports : 1 if f still lacks the forces of bending chains and elastic supports, otherwise 0; numba
        would compile the function twice for True and False
    dt_v : [s] length of the velocity update; share : position between two samples of the loads
    """
    f = scratch.f
    for p in range(low, high, LANES):
        i, square = p - low, squared_speed(p, share, particles)
        for k in range(3):
            f_int = load(f, k, i)
            f_ext = constant_load(k, index_in(particles.load, k, p), traits, particles)
            if with_supports and is_present(particles.bend):
                f_int = f_int + load(particles.bend, k, p)
            if with_supports and is_present(particles.spring):
                offset = load(particles.spring_zero, k, p) - load(x, k, p)
                f_int = fma(load(particles.spring, k, p), offset, f_int)
                if is_present(particles.turned) and k < 2:
                    across = load(particles.spring_zero, 1 - k, p) - load(x, 1 - k, p)
                    f_int = fma(load(particles.turned, 2, p), across, f_int)
            if is_present(particles.load_before):
                next_load = load(particles.load_after, k, p)
                f_ext = f_ext + between(load(particles.load_before, k, p), next_load, share)
            if is_present(particles.wind):
                f_ext = fma(load(particles.wind, k, p), square, f_ext)
            if is_present(particles.drag):
                f_ext = f_ext + load(particles.drag, k, p)
            total = f_int + f_ext
            if is_present(particles.ground):  # the damping acts on the velocity relative to the ground
                pulled = fma(zeta * damped_mass(p, particles), load(particles.ground, k, p), total)
                total = where(load_mask(particles.free, k, p), pulled, total)
            store(f, k, i, f_int)
            store(scratch.external, k, i, f_ext)
            store(scratch.total, k, i, total)
        half = 0.5 * dt_v * load(particles.per_mass, 0, p)
        if is_present(particles.air):
            add_air_damping(p, i, half, zeta, share, particles, scratch)
        if is_present(particles.air_mass):
            add_air_mass(p, i, half, zeta, particles, scratch)


@part_of_kernel
def free_air(k: int, p: int, particles: Particles) -> Lanes:
    """Return c of `physics.air` along axis k of LANES particles from p on; zero along held axes."""
    return where(load_mask(particles.free, k, p), load(particles.air, k, p), zeros())


@part_of_kernel
def add_air_damping(
    p: int, i: int, half: Lanes, zeta: float, share: float, particles: Particles, scratch: Scratch
) -> None:
    """Add the aerodynamic damping to the total forces of LANES particles from p on.

    With u = v(n-1/2) + dt f / 2M, h = zeta dt / 2 of the mass without air and a = |U| c^2 dt / 2M the mean
    velocity is u / (1 + h) across c and u / (1 + h + a) along it, c along free axes. A mean velocity g of
    supports along held axes adds (1 + h) c.g to c.u. half : dt / 2M
    """
    total, along_f, along_v = scratch.total, zeros(), zeros()
    for k in range(3):
        c, v = free_air(k, p, particles), load(particles.v, k, p)
        along_f, along_v = fma(c, load(total, k, i), along_f), fma(c, v, along_v)
        if is_present(particles.ground):
            held = 0.5 * fma(half * zeta, damped_mass(p, particles), 1.0) * (load(particles.air, k, p) - c)
            along_v = fma(held, v + load(particles.ground, k, p), along_v)
    before, after = load(particles.air_pull, 0, p), load(particles.air_pull, 1, p)
    pull = abs(fma(share, after - before, before)) * fma(half, along_f, along_v)
    store(scratch.pull, 0, i, pull)
    for k in range(3):
        store(total, k, i, fma(-pull, free_air(k, p, particles), load(total, k, i)))


@part_of_kernel
def add_air_mass(p: int, i: int, half: Lanes, zeta: float, particles: Particles, scratch: Scratch) -> None:
    """Exempt the added mass of the air from the mass-proportional damping. half : dt / 2M [s/kg]"""
    air = load(particles.air_mass, 0, p)
    correction = zeta * air / fma(half * zeta, load(particles.mass, 0, p) - air, 1.0)
    for k in range(3):
        t = load(scratch.total, k, i)
        store(scratch.total, k, i, fma(correction, fma(half, t, load(particles.v, k, p)), t))


@part_of_kernel
def force_along_guides(p: int, i: int, total: FloatArray, particles: Particles) -> Lanes:
    """Return total forces [N] along the lines that guide LANES particles from p on; zero without guides."""
    along = zeros()
    if is_present(particles.turned):
        nx, ny = load(particles.turned, 0, p), load(particles.turned, 1, p)
        along = fma(nx, load(total, 0, i), ny * load(total, 1, i))
    return along


@part_of_kernel
def free_force(k: int, p: int, i: int, total: FloatArray, along: Lanes, particles: Particles) -> Lanes:
    """Return total forces [N] along axis k without the guided part `along` (`force_along_guides`)."""
    force = load(total, k, i)
    if is_present(particles.turned) and k < 2:
        force = fma(-along, load(particles.turned, k, p), force)
    return force


@copied_kernel
def store_totals(low: int, high: int, particles: Particles, scratch: Scratch) -> None:
    """Copy total forces [N] of particles low to high from the scratch to particles.f."""
    for k in range(3):
        for p in range(low, high, LANES):
            store_below(p, high, particles.f, k, load(scratch.total, k, p - low))


@part_of_kernel
def new_velocity(
    k: int,
    p: int,
    old: Lanes,
    total: Lanes,
    per_mass: Lanes,
    c_v: float,
    c_a: float,
    traits: int,
    particles: Particles,
) -> Lanes:
    """Return updated velocities [m/s] along axis k under total forces [N]; held axes follow the ground."""
    new = next_v(old, total * per_mass, c_v, c_a)
    if traits & PARTLY_FIXED:
        fixed_velocity = old
        if is_present(particles.ground):
            fixed_velocity = load(particles.ground, k, p)
        new = where(load_mask(particles.free, k, p), new, fixed_velocity)
    return new


@part_of_kernel
def add_works(
    p: int,
    high: int,
    half: float,
    quarter: float,
    external: Lanes,
    internal: Lanes,
    square: Lanes,
    particles: Particles,
) -> None:
    """Add works [J] of a velocity update.

    external, internal, square : twice the mean velocity times the external force, the internal force, and
        itself
    """
    work = particles.work
    store_below(p, high, work, 0, fma(half, external, load(work, 0, p)))
    store_below(p, high, work, 1, fma(half, internal, load(work, 1, p)))
    store_below(p, high, work, 2, fma(quarter * damped_mass(p, particles), square, load(work, 2, p)))


@copied_kernel
def update_velocities(
    low: int,
    high: int,
    traits: int,
    dt_v: float,
    zeta: float,
    dt: float,
    x: FloatArray,
    y: FloatArray,
    particles: Particles,
    scratch: Scratch,
) -> None:
    """Update velocities and works of particles low to high from the scratch forces; move them from x to y."""
    h = 0.5 * zeta * dt_v
    c_v, c_a, half, quarter = (1.0 - h) / (1.0 + h), dt_v / (1.0 + h), 0.5 * dt_v, 0.25 * dt_v * zeta
    v, work, other = particles.v, particles.work, particles.other_work
    energy, ground = is_present(particles.work), is_present(particles.ground)
    air, band = is_present(particles.air), is_present(scratch.band)
    for p in range(low, high, LANES):
        i, per_mass = p - low, load(particles.per_mass, 0, p)
        external, internal, square, band_work, air_work = zeros(), zeros(), zeros(), zeros(), zeros()
        along = force_along_guides(p, i, scratch.total, particles)
        for k in range(3):
            f_int, f_ext, old = load(scratch.f, k, i), load(scratch.external, k, i), load(v, k, p)
            total = free_force(k, p, i, scratch.total, along, particles)
            new = new_velocity(k, p, old, total, per_mass, c_v, c_a, traits, particles)
            v_sum = old + new
            external, internal = fma(v_sum, f_ext, external), fma(v_sum, f_int, internal)
            square = fma(v_sum, v_sum, square)
            if band:
                band_work = fma(v_sum, load(scratch.band, k, i), band_work)
            f_held = f_ext + f_int
            if air:
                air_work = fma(load(particles.air, k, p), v_sum, air_work)
                f_held = fma(-load(scratch.pull, 0, i), load(particles.air, k, p), f_held)
            if ground and energy:
                free = load_mask(particles.free, k, p)
                path, v_ground = 0.5 * dt_v * v_sum, load(particles.ground, k, p)
                mass, damped = load(particles.mass, 0, p), damped_mass(p, particles)
                f_damp, path_rel, dE_kin = works_of_motion(
                    mass, damped, zeta, v_ground, old, new, v_sum, dt_v
                )
                store_below(p, high, work, 0, fma(path, f_ext, load(work, 0, p)))
                store_below(p, high, work, 1, fma(path, f_int, load(work, 1, p)))
                damping, support = load(work, 2, p), load(other, 2, p)
                store_below(p, high, work, 2, where(free, fma(f_damp, path_rel, damping), damping))
                fixed = fma(-path, f_held, dE_kin) + support
                drawn = fma(-f_damp * dt_v, v_ground, support)
                store_below(p, high, other, 2, where(free, drawn, fixed))
            store_below(p, high, v, k, new)
            store_below(p, high, y, k, next_x(load(x, k, p), new, dt))
        if energy and not ground:
            add_works(p, high, half, quarter, external, internal, square, particles)
        if energy and band:
            store_below(p, high, other, 1, fma(-half, band_work, load(other, 1, p)))
        if energy and air:
            store_below(p, high, other, 0, fma(half * load(scratch.pull, 0, i), air_work, load(other, 0, p)))


@part_of_kernel
def move_vector(
    p: int,
    high: int,
    is_full: bool,
    i: int,
    keeps: bool,
    traits: int,
    times: tuple[float, ...],
    x: FloatArray,
    y: FloatArray,
    particles: Particles,
    scratch: Scratch,
) -> None:
    """Move the vector of particles from p on under element forces, loads and wind alone.

    Does the work of `total_forces` and `update_velocities` at once.

    is_full : whether all LANES of them are below high
    keeps : whether the total forces [N] are written to particles.f
    times : dt_v [s], zeta [1/s], share, dt [s], as in these
    """
    dt_v, zeta, share, dt = times
    h = 0.5 * zeta * dt_v
    c_v, c_a, half, quarter = (1.0 - h) / (1.0 + h), dt_v / (1.0 + h), 0.5 * dt_v, 0.25 * dt_v * zeta
    v, per_mass, square = particles.v, load(particles.per_mass, 0, p), squared_speed(p, share, particles)
    external, internal, squares, energy = zeros(), zeros(), zeros(), is_present(particles.work)
    for k in range(3):
        at = index_in(v, k, p)
        f_int, f_ext, old = load(scratch.f, k, i), constant_load(k, at, traits, particles), load_at(v, at)
        if is_present(particles.wind):
            f_ext = fma(load_at(particles.wind, at), square, f_ext)
        if keeps:
            store_below(p, high, particles.f, k, f_int + f_ext)
        new = next_v(old, (f_int + f_ext) * per_mass, c_v, c_a)
        if energy:
            v_sum = old + new
            external, internal = fma(v_sum, f_ext, external), fma(v_sum, f_int, internal)
            squares = fma(v_sum, v_sum, squares)
        position = next_x(load_at(x, at), new, dt)
        if is_full:
            store_at(v, at, new)
            store_at(y, at, position)
        else:
            store_below(p, high, v, k, new)
            store_below(p, high, y, k, position)
    if energy:
        add_works(p, high, half, quarter, external, internal, squares, particles)


@copied_kernel
def advance_halo(
    low: int,
    high: int,
    traits: int,
    dt_v: float,
    zeta: float,
    dt: float,
    x: FloatArray,
    y: FloatArray,
    particles: Particles,
) -> None:
    """Update velocities and positions of halo particles low to high from the total forces of their owners."""
    h = 0.5 * zeta * dt_v
    c_v, c_a, v = (1.0 - h) / (1.0 + h), dt_v / (1.0 + h), particles.v
    for p in range(low, high, LANES):
        per_mass, along = load(particles.per_mass, 0, p), force_along_guides(p, p, particles.f, particles)
        for k in range(3):
            total = free_force(k, p, p, particles.f, along, particles)
            new = new_velocity(k, p, load(v, k, p), total, per_mass, c_v, c_a, traits, particles)
            store_below(p, high, v, k, new)
            store_below(p, high, y, k, next_x(load(x, k, p), new, dt))
