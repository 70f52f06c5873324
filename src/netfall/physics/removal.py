"""Member removal: elements that leave the net at a given time, whatever their strain.

From a step on the element has no stiffness; its mass stays with its ends. Its stored energy counts as
dissipated, as after a fracture without fragments (`fracture.remove_broken_element`). Particles that held only
removed elements leave with them: they stay where they are, without mass and load. Their kinetic energy counts
as negative external work, as that of cladding that falls off.

Particles inside a removed cable first transfer mass, momentum, loads and wind to others
(`loads.removal`). The masses then share one velocity, as in a plastic impact. The lost kinetic energy
is in the same work, which equals the difference of the kinetic energies.
"""

import numpy as np

from netfall.physics.air import damping_areas, damping_vectors
from netfall.physics.fracture import dissipate_stored
from netfall.physics.state import State
from netfall.physics.supports import project_on_guides

EXTERNAL, INTERNAL = 0, 1  # columns of the works of forces


def remove_elements(state: State, elements: np.ndarray, since: np.ndarray) -> None:
    """Remove elements, local rows (k,), from the net; call `plan.StepPlan.attach` afterwards.

    since : (k,) [s] before now at which each stopped acting
    Every rank that holds one decides alike.
    """
    all_elements, law = state.elements_and_law
    for e, time in zip(elements.tolist(), since.tolist()):
        if state.EA[e] > 0.0:  # 0: on another rank since it broke, or removed
            dissipate_stored(e, 2.0 * time, all_elements, state.particles, law)
            _detach(state, e)
        state.EA[e], state.lost[e], state.broken[e] = 0.0, 1, 1
        if state.eps_u is not None:
            state.eps_u[e] = np.inf


def apply_impulses(state: State, particles: np.ndarray, impulse: np.ndarray, work: int) -> None:
    """Apply impulses (k, 3) [N s] to particles, local rows (k,), in order. work : EXTERNAL or INTERNAL"""
    for p, one_impulse in zip(particles.tolist(), impulse):
        if state.mass[p] > 0.0:
            before = _kinetic_energy(state, p)
            state.v[p] += np.where(state.free[p], one_impulse / state.mass[p], 0.0)
            if state.turned is not None:
                project_on_guides(state.turned[p : p + 1], state.v[p : p + 1])
            if state.work is not None and state.own(p):
                state.work[p, work] += _kinetic_energy(state, p) - before


def remove_particles(state: State, particles: np.ndarray) -> None:
    """Remove particles, local rows (k,), from the net."""
    for p in particles.tolist():
        if state.work is not None and state.own(p):
            state.work[p, 0] -= _kinetic_energy(state, p)
        state.mass[p] = 0.0
        state.v[p] = state.load[p] = 0.0
        for name in ("wind", "air", "air_mass", "drag", "drag_size"):
            if getattr(state, name) is not None:
                getattr(state, name)[p] = 0.0


CARRIED = ("mass", "v", "load", "wind", "air", "air_mass", "drag_size")  # fields that leave with particles
PASSED_ON = ("load", "wind", "air_mass", "drag_size")  # of these, those whose shares add up


def transfer_carried(
    state: State,
    particles: np.ndarray,
    source: np.ndarray,
    share: np.ndarray,
    carried: dict[str, np.ndarray],
) -> None:
    """Add shares (s,) of what the leaving rows `source` (s,) carry to particles, local rows (s,).

    carried : values (k, ...) of the leaving rows, of those fields of CARRIED that the state has

    Every rank that holds one of them computes the same, in the order of the rows.
    """
    added_mass = share * carried["mass"][source]
    for p in dict.fromkeys(particles.tolist()):
        entries = np.flatnonzero(particles == p)
        before, momentum = _kinetic_energy(state, p), state.mass[p] * state.v[p]
        for k in entries.tolist():
            momentum += added_mass[k] * carried["v"][source[k]]
            state.mass[p] += added_mass[k]
            for name in [name for name in PASSED_ON if name in carried]:
                getattr(state, name)[p] += share[k] * carried[name][source[k]]
            if "air" in carried:
                areas = damping_areas(state.air[p]) + share[k] * damping_areas(carried["air"][source[k]])
                state.air[p] = damping_vectors(areas)
        if state.mass[p] > 0.0:
            velocity = momentum / state.mass[p]
            state.v[p] = np.where(state.free[p], velocity, state.v[p])  # fixed axes keep their velocity
            if state.turned is not None:
                project_on_guides(state.turned[p : p + 1], state.v[p : p + 1])
        if state.work is not None and state.own(p):
            state.work[p, 0] += _kinetic_energy(state, p) - before


def _kinetic_energy(state: State, p: int) -> float:
    """Return the kinetic energy [J] of a particle."""
    return 0.5 * state.mass[p] * float(np.sum(state.v[p] ** 2))


def _detach(state: State, e: int) -> None:
    """Detach element e from its ends; ends that split off from the net with it leave."""
    for p in state.ends[e].tolist():
        if state.valence is not None:
            state.valence[p] -= 1
        if p >= state.first_split:
            remove_particles(state, np.array([p]))
