"""History rows on a GPU: `explicit.sampling.make_row` and `explicit.energy_check.observe` with all threads.

Formulas are those of the CPU, for one element or particle at a time. Sums have the same bits in any order,
because they are exact (`parallel.sums`). `gpu.target` translates this module, like `gpu.kernels`.
"""

from typing import Any

from netfall.core.records import is_present
from netfall.explicit.energy_check import span_energies, spring_energies
from netfall.explicit.motion import total_forces
from netfall.explicit.sampling import (
    find_fastest,
    find_most_strained,
    has_row,
    read_probes,
    update_element_envelope,
    update_particle_envelope,
    update_reaction_envelope,
    update_tension_envelope_at,
    write_largest,
)
from netfall.parallel.sums import pieces_of
from netfall.physics.elements import element_energies_at, element_state_at
from netfall.physics.fields import EMPTY
from netfall.physics.supports import add_spring_forces

# defined by the translation
meet: Any = None  # barrier of the threads of a net
atomic_add: Any = None  # (array, index, value), as the next two
atomic_max: Any = None
atomic_min: Any = None
# first column of an order for the bits of the largest speed and strain, then their particle and element
LARGEST = 14
NO_ROW = 1 << 62  # larger than any number of an element or a particle


def make_row(
    thread: Any,
    threads: Any,
    number: Any,
    before_dt: Any,
    moment: Any,
    largest: Any,
    work: Any,
    scratch: Any,
) -> None:
    """Update the envelope at a step, and append a row if one is due.

    number : of the step; before_dt : [s] the previous step; moment : as in `kernels.step_particle`
    largest : (4,) from LARGEST on
    """
    rows = work.rows
    observed, elements, due = rows.observed, work.elements, has_row(number, rows)
    now, m = rows.observation.now, work.elements.ends.shape[0]
    time, since = number * rows.dt, number * rows.dt - rows.last[0] * rows.dt
    for e in range(thread, m, threads):
        state = element_state_at(work.particles.x.T, elements, work.law, e)
        now.N[e], now.eps[e], now.eps_p[e], now.L[e] = state[0], state[1], state[2], state[3]
        update_element_envelope(e, time, since, rows)
        if is_present(elements.highest):
            update_tension_envelope_at(e, time, elements.highest, elements.lowest, rows.tension)
    for p in range(thread, rows.displacement.shape[1], threads):
        update_particle_envelope(p, time, rows)
    meet()
    for i in range(thread, rows.supports.shape[0], threads):
        sum_internal_forces(rows.supports[i], work, scratch.f)
        update_reaction_envelope(i, time, moment[1], rows, scratch)
    if thread == 0:
        rows.last[0] = number
    if not due:
        return
    table, made, k = rows.table, rows.made, rows.made[1]
    sums = table.sums[k]
    for i in range(sums.shape[0]):
        for j in range(thread, sums.shape[1], threads):
            sums[i, j] = 0
    if thread == 0:
        table.slack[k] = 0
        largest[0], largest[1], largest[2], largest[3] = -1, -1, NO_ROW, NO_ROW
    meet()
    halo = observed.first_split - observed.n_owned
    for i in range(thread, observed.rows[0] - halo, threads):
        add_particle(i, i if i < observed.n_owned else i + halo, before_dt, moment, sums, work, scratch)
    for e in range(thread, m, threads):
        add_element(e, sums, work)
    meet()
    best, fastest = find_fastest(thread, threads, rows)
    agree(0, best, fastest, largest)
    best, strained = find_most_strained(thread, threads, rows)
    agree(1, best, strained, largest)
    if thread == 0:
        table.number[k] = number
        table.time_step[k] = before_dt if before_dt > 0.0 else moment[2]
        read_probes(rows, table.probes[k])
        write_largest(largest[0], largest[2], largest[1], largest[3], rows, table.size[k], table.who[k])
        made[0] += 1
        made[1] += 1


def add_exact(value: Any, limbs: Any) -> None:
    """Compute `parallel.sums.add_term` while other threads do the same."""
    k, low, middle, high = pieces_of(value)
    atomic_add(limbs, k, low)
    atomic_add(limbs, k + 1, middle)
    atomic_add(limbs, k + 2, high)


def sum_internal_forces(p: Any, work: Any, f: Any) -> None:
    """Compute the axial forces and spring forces on particle p in f (3, 1) [N].

    Its slots have the order of element numbers, in which the CPU adds the forces.
    """
    particles, slots, now = work.particles, work.slots, work.rows.observation.now
    x = particles.x
    f[0, 0], f[1, 0], f[2, 0] = 0.0, 0.0, 0.0
    for s in range(slots.element.shape[0]):
        if slots.element[s, p] != EMPTY:
            e, far = int(slots.element[s, p]), int(slots.other[s, p])
            q = now.N[e] / now.L[e] if now.L[e] > 0.0 else 0.0
            for k in range(3):
                f[k, 0] += q * (x[k, far] - x[k, p])
    if is_present(particles.spring):
        one = slice(p, p + 1)
        springs = particles.spring[:, one].T, particles.spring_rest[:, one].T, particles.turned[:, one].T
        add_spring_forces(particles.x[:, one].T, particles.x_start[:, one].T, *springs, f.T)


def add_particle(i: Any, p: Any, before_dt: Any, moment: Any, sums: Any, work: Any, scratch: Any) -> None:
    """Compute velocity and energies of particle p, the i-th owned one, and add them to the sums."""
    dt_v, share, dt, zeta = moment
    rows, particles = work.rows, work.particles
    observed, observation = rows.observed, rows.observation
    sum_internal_forces(p, work, scratch.f)
    if is_present(particles.spring):
        spring_energies(p, p + 1, p - i, particles, observation.sprung)
    total_forces(p, p + 1, 0, dt_v, zeta, share, observed.traits, particles.x, particles, scratch)
    part = before_dt / (before_dt + dt)
    span_energies(p, p + 1, p - i, part, dt_v, zeta, observed, observation, scratch)
    kinds = observation.terms.shape[0]
    for k in range(kinds):
        add_exact(observation.terms[k, i], sums[k])
    attached = is_present(particles.detached) and particles.detached[p] == 0
    last = sums.shape[0] - 1
    if attached:
        add_exact(observation.terms[0, i], sums[last])
    if is_present(observation.sprung):
        add_exact(observation.sprung[i], sums[kinds + 2])
        if is_present(particles.detached):
            add_exact(observation.sprung[i], sums[last])


def add_element(e: Any, sums: Any, work: Any) -> None:
    """Add the energies of element e to the sums, and count it if it is slack."""
    elements, observation, detached = work.elements, work.rows.observation, work.particles.detached
    now, rows = observation.now, work.rows
    observation.stored[e], observation.heat[e] = element_energies_at(e, elements, now, work.law)
    if elements.owned[e] == 0:
        return
    kinds, last = observation.terms.shape[0], sums.shape[0] - 1
    add_exact(observation.stored[e], sums[kinds])
    add_exact(observation.heat[e], sums[kinds + 1])
    if is_present(detached) and not (detached[elements.ends[e, 0]] and detached[elements.ends[e, 1]]):
        add_exact(observation.stored[e], sums[last])
    if elements.bar[e] == 0 and elements.broken[e] == 0 and now.N[e] == 0.0:
        atomic_add(rows.table.slack, rows.made[1], 1)


def agree(place: Any, bits: Any, number: Any, largest: Any) -> None:
    """Find the largest bits of all threads, and the smallest number with these bits."""
    atomic_max(largest, place, bits)
    meet()
    if largest[place] == bits:
        atomic_min(largest, 2 + place, number)
    meet()
