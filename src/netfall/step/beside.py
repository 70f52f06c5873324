"""What a step does besides forces, kick and drift of its own particles, each in a kernel of its own.

The time loop calls them by their address (`loop.Beside`). What a scene does not have is None in what they are
given; the compiler then drops it.
"""

import numpy as np

from netfall.ground.apart import call
from netfall.ground.compile import kernel, kernel_apart, part_of_kernel, vector_kernel
from netfall.mechanics.air import set_air, set_drag
from netfall.mechanics.bending import find_bending_forces
from netfall.mechanics.ground import velocity_after
from netfall.mechanics.law.branches import set_branches
from netfall.mechanics.motion import along_x, along_y, along_z, kicked, make_kick
from netfall.mechanics.slip.motion import drift_slips, kick_slips
from netfall.mechanics.supports import on_guide
from netfall.parallel.halo import pack_forces, unpack_forces
from netfall.step.slots import collect_elements, follow_slips

# Of the particles what the exchange and the motion of the halo read, so that scenes share them.
EXCHANGED = (
    *("x", "v", "free", "mass", "per_mass", "load", "turned", "air_mass"),
    *("slip_v", "valence", "ground", "f"),
)

BLOWN = ("v", "per_mass", "speed_before", "speed_after", "drag")  # the same of the drag on detached particles


@kernel_apart
def find_drag(kick_dt, share, relative, particles):
    """`set_drag`."""
    set_drag(kick_dt, share, relative, particles)


@kernel_apart
def begin_step(time, before_dt, dt, kick_dt, zeta, share, anew, bends, places, particles, elements, law):
    """What forces need at a time [s]: branches, air, chains that bend; kick of slips.

    before_dt, dt : [s] the steps before and after; kick_dt, zeta, share : of `motion.Kick`
    anew : whether the kick, or a mass, is another than in the step before
    bends : `Bends`; places : at which cables slip
    """
    if law.branches is not None:
        set_branches(before_dt, dt, law)
    if particles.air is not None and anew:
        set_air(kick_dt, zeta, particles)
    if bends is not None:
        find_bending_forces(bends)
    if places is not None:
        kick_slips(time, kick_dt, share, places, particles, elements, law)


@kernel_apart
def end_step(dt, chunks, places, particles, elements, slots):
    """Drift of slips over dt [s], and unstressed lengths that follow."""
    drift_slips(dt, places, particles)
    follow_slips(places, chunks.n_owned, chunks.n_owned + chunks.n_halo, particles, elements, slots)


@kernel_apart
def pack(place, particles, buffers):
    """`pack_forces`."""
    pack_forces(particles, place, buffers)


@kernel_apart
def unpack(place, kick_dt, dt, zeta, chunks, particles, buffers):
    """The total forces of the halo, which have arrived, and its motion."""
    n_owned, n_halo = chunks.n_owned, chunks.n_halo
    unpack_forces(n_owned, particles, place, buffers)
    if n_halo > 0:
        move_halo(n_owned, n_owned + n_halo, kick_dt, dt, zeta, particles)


@part_of_kernel
def move_axis(p, kick, axis, f, per_mass, dt):
    """Kick and drift of particle p along one axis, under the total force f [N]."""
    new = velocity_after(p, axis.v[p], kicked(axis.v[p], f * per_mass[p], kick), axis)
    axis.v[p] = new
    axis.x[p] += dt * new


@vector_kernel
def move_halo(first, last, kick_dt, dt, zeta, particles):
    """Kick and drift of halo particles, whose total force f the owner has sent."""
    first, last = np.uint64(first), np.uint64(last)
    f, per_mass = particles.f, particles.per_mass
    kick = make_kick(kick_dt, zeta, 0.0)
    for p in range(first, last):
        fx, fy, fz = on_guide(p, (f[0][p], f[1][p], f[2][p]), particles)
        move_axis(p, kick, along_x(particles), fx, per_mass, dt)
        move_axis(p, kick, along_y(particles), fy, per_mass, dt)
        move_axis(p, kick, along_z(particles), fz, per_mass, dt)


@kernel_apart
def collect(chunks, elements, slots, law):
    """Bring the elements up to date with what their slots have of their own."""
    changed = slots.eps_p is not None and chunks.has_yielded.any()
    if changed or slots.highest is not None or slots.branch_a is not None:
        collect_elements(chunks.n_owned, chunks.n_owned + chunks.n_halo, elements, slots, law)


@kernel
def collect_now(entry):
    """`collect` from Python."""
    call(entry)
