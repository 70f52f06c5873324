"""Motion compared with closed forms, and both energy checks."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import BARE, STEEL

from netfall.core.errors import DivergedError
from netfall.model.schedule import make_schedule

EA = 1.95e11 * 683.08e-6  # N
SMALL = '[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 4\n' + STEEL


def test_step_limits_of_elements_of_different_speed():
    """The limit for any shape is below that of the chain in closed form; after fracture it is L0 / c."""
    from netfall.physics.stability import after_fracture_limit, any_shape_limits

    n, k, m = 40, 1e6, 2.0
    elements = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    fixed = np.zeros((n + 1, 3), bool)
    fixed[[0, -1]] = True
    ones = np.ones(n)
    sharp = 1.0 / (np.sqrt(k / m) * np.cos(np.pi / (2 * n)))  # 2 / omega_max of a chain fixed at both ends
    mass, free = m * np.ones(n + 1), ~fixed.all(1)
    safe = any_shape_limits(elements, k * ones, ones, mass, free, ones > 1, 0.0 * mass)[0]
    assert 0.7 * sharp < safe.dt <= sharp
    L0 = np.r_[0.5, ones[1:]]
    own = np.bincount(elements.ravel(), np.repeat(4.0 * L0, 2))
    for share in (0.0, 0.5):  # nothing is carried that a fragment could take
        of_elements = elements, 2e8 * ones / L0, 4.0 * L0
        after = after_fracture_limit(*of_elements, own, ~free, 0.04 * ones, 0.0 * own, share)
        assert np.isclose(after.dt, 0.5 / 5000.0) and after.element == 0


@pytest.mark.parametrize("sprung", [0.0, 0.5])
@pytest.mark.parametrize("weak", [1.0, 0.3])
@pytest.mark.parametrize("seed", range(5))
def test_any_fragments_are_stable_within_the_limit_after_fracture(seed, weak, sprung):
    """Random nets break. The bound is at least the limit, and no mass is lost or negative. weak : share of
    elements that break; sprung : share of nodes on elastic supports
    """
    from netfall.physics.stability import after_fracture_limit, any_shape_limits, fragment_mass

    rng = np.random.default_rng(seed)
    n, m = 40, 90
    elements = np.array([rng.choice(n, 2, replace=False) for _ in range(m)])
    EA, L0 = 10.0 ** rng.uniform(6, 9, m), 10.0 ** rng.uniform(-1, 1, m)
    half = 10.0 ** rng.uniform(-1, 1, m) * L0
    held = rng.random(n) < 0.2
    mass = np.bincount(elements.ravel(), np.repeat(half, 2), n)
    mass += rng.choice([0.0, 1.0, 1000.0], n, p=[0.1, 0.3, 0.6])
    share = rng.choice([0.02, 0.05, 0.5])
    eps_u = np.where(rng.random(m) < weak, 0.04, np.inf)
    spring = np.where(rng.random(n) < sprung, 10.0 ** rng.uniform(8, 13, n), 0.0)
    limit = after_fracture_limit(elements, EA / L0, half, mass, held, eps_u, spring, share)
    strict = after_fracture_limit(elements, EA / L0, half, mass, held, eps_u, spring, 0.0)
    every = after_fracture_limit(elements, EA / L0, half, mass, held, np.full(m, 0.04), spring, share)
    assert limit.dt >= strict.dt * (1 - 1e-12) and limit.dt >= every.dt * (1 - 1e-12)
    ends, masses, free, total = elements.copy(), mass.tolist(), (~held).tolist(), mass.sum()
    for e in rng.permutation(np.flatnonzero(np.isfinite(eps_u))):
        for end in rng.permutation(2)[: rng.integers(1, 3)]:
            p = ends[e, end]
            if (ends == p).sum() == 1 and free[p] and not (p < n and spring[p]):
                continue  # a loose end
            part = fragment_mass(EA[e], L0[e], half[e], limit.dt)
            masses[ends[e, end]] -= part
            masses.append(part)
            free.append(True)
            ends[e, end] = len(masses) - 1
        assert min(masses) > -1e-9 and np.isclose(sum(masses), total)
        alive = np.array(free) & (np.array(masses) > 1e-9)
        support = np.append(spring, np.zeros(len(masses) - n))
        intact = any_shape_limits(ends, EA, L0, np.array(masses), alive, EA < 0, support)
        assert intact[0].dt >= limit.dt * (1 - 1e-6)


DIVERGES = (  # a soft cable throws a mass at a stiff slack one; the step is 0.94 of the stable one
    BARE + "[dynamics]\nduration = 0.1\ntime_step = 2.7e-3\n",
    "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,-10,0\n3,0,0,-20,1\n",
    "start,end,unstressed_length,area\n1,2,10.1,\n2,3,9.9,1e-5\n",
)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_run_that_diverges_stops(workshop, ranks):
    """Exit code 3 with the time, no file. At each contact a slack cable returns too much energy."""
    assert "diverged at t =" in workshop.solve(*DIVERGES, code=3, ranks=ranks).stderr
    assert {p.name for p in workshop.folder.iterdir()} == {"job.toml", "nodes.csv", "elements.csv"}


def test_divergence_names_the_last_good_checkpoint(workshop, monkeypatch):
    """A velocity of nan at 0.06 s ends the run with particle, element and checkpoint, and is not saved."""
    from netfall.driver.dynamics import stage as dynamics

    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,-10,0\n3,5,5,-10,1\n"
    text = BARE + "[dynamics]\nduration = 0.1\n[output]\ncheckpoint_interval = 0.02\n"
    job = workshop.job(text + "history_interval = 0.05\n", nodes, "start,end\n1,2\n2,3\n")
    advance = dynamics.Simulation.advance_block

    def broken(simulation, stop):
        if stop * simulation.schedule.dt > 0.055:
            simulation.state.v[1] = np.nan
        advance(simulation, stop)

    monkeypatch.setattr(dynamics.Simulation, "advance_block", broken)
    with pytest.raises(DivergedError) as raised:
        workshop.run_here(job)
    checkpoints = sorted(workshop.folder.glob("*checkpoint*"))
    message = str(raised.value)
    for words in ("diverged at t = 0.06", "fastest node 2", "element", str(checkpoints[-1])):
        assert words in message
    for path in checkpoints:
        with h5py.File(path) as file:
            assert np.isfinite(file["particles/v"][()]).all()


@pytest.mark.parametrize("history, rows", [(0.0123, 10), (0.03, 5), (0.01, 11), (0.25, 2)])
def test_the_run_ends_at_its_duration_for_any_history_interval(history, rows):
    """Rows are at the first steps after the multiples of an odd interval, and at 0.1 s, not later."""
    dynamics = SimpleNamespace(time_step="auto", safety=0.8, duration=0.1)
    output = SimpleNamespace(history_interval=history, frames=4, checkpoint_interval=0.0)
    soft, made = (make_schedule(limit, limit, False, dynamics, output) for limit in (1e9, 3e-4))
    assert soft.steps * soft.dt == pytest.approx(0.1, rel=1e-12) and soft.dt <= history
    assert soft.steps == np.ceil(0.1 / history - 1e-9)  # a step for each row
    assert made.steps * made.dt == pytest.approx(0.1, rel=1e-12) and made.dt <= 0.8 * 3e-4
    times, multiples = made.history * made.dt, np.append(np.arange(rows - 1) * history, 0.1)
    assert made.history[-1] == made.steps and len(times) == rows
    late = times - multiples
    assert late.min() > -1e-9 * made.dt and late.max() < made.dt and abs(late[-1]) < 1e-12


@pytest.mark.parametrize("limit, breaks, stride", [(1e-3, False, 1), (1e-3, True, 3), (2e-4, True, 5)])
def test_the_step_of_elements_that_break(limit, breaks, stride):
    """The step is that of fragments and at most a third of the long step, which does not depend on them."""
    dynamics = SimpleNamespace(time_step="auto", safety=0.8, duration=0.1)
    output = SimpleNamespace(history_interval=0.01, frames=4, checkpoint_interval=0.0)
    made = make_schedule(limit, 1e-3, breaks, dynamics, output)
    assert made.stride == stride and made.long_dt == pytest.approx(0.01 / 13)
    assert made.dt <= 0.8 * limit and made.dt / 0.8 <= made.stable_dt <= limit


@pytest.mark.parametrize("share", [0.01, 0.05, 0.5])
def test_mass_scaling_keeps_its_budget_and_its_step(share):
    """In the stadium at most the given share is added, none is removed, and no element limits the step."""
    from netfall.geometry.generators import generate as generators
    from netfall.job.keys.net import Stadium
    from netfall.physics.stability import any_shape_limits, scaled_mass

    net = generators.stadium(Stadium())
    L = np.linalg.norm(np.diff(net.x[net.elements], axis=1)[:, 0], axis=1)
    free, stiffness = ~net.fixed.all(1), np.full(net.m, EA)
    mass = 300.0 + np.random.default_rng(1).uniform(0.0, 200.0, net.n)
    scaled = scaled_mass(net.elements, stiffness, L, mass, free, np.zeros(net.n), share)
    assert (scaled >= mass).all() and (scaled == mass)[~free].all()
    assert 0.9 * share < (scaled - mass).sum() / mass[free].sum() <= share
    never, still = np.zeros(net.m, bool), np.zeros(net.n)
    all_limits = (any_shape_limits(net.elements, stiffness, L, m, free, never, still) for m in (mass, scaled))
    limits = [{limit.name: limit.dt for limit in each}["slackening"] for each in all_limits]
    assert limits[1] > 1.5 * limits[0]
    needed = scaled > mass  # these are as heavy as their step needs, not more
    Omega2 = np.bincount(net.elements.ravel(), np.repeat(EA / L, 2), net.n) / scaled
    assert (Omega2[needed] * limits[1] ** 2 > 0.49).all()


def test_added_inertia_has_no_weight(workshop):
    """A net in equilibrium under dead load does not move. The frequency of an oscillator follows the mass."""
    text = '[net]\ngenerator = "stadium"\n' + STEEL
    text += "[form_finding]\n[load]\ndead = 1000.0\nself_weight = true\nsteps = 1\ntolerance = 1e-9\n"
    text += "[dynamics]\nduration = 0.2\nmass_scaling = 0.05\n[output]\nframes = 2\n"
    f = workshop.solve(text)
    assert f["provenance"].attrs["added_mass"] > 1000.0
    moved = np.diff(f["VTKHDF/PointData/displacement"][:].reshape(3, -1, 3), axis=0)
    assert np.abs(moved).max() < 1e-6 and f["provenance"].attrs["time_step"] > 6e-4


@pytest.mark.parametrize("share, warns", [(0.08, False), (1.0, True)])
def test_large_added_inertia_is_a_warning(workshop, share, warns):
    """mass_scaling = 1 doubles the mass."""
    text = f"{SMALL}[form_finding]\n[dynamics]\nduration = 0.01\nmass_scaling = {share}\n"
    assert ("mass scaling adds" in workshop.printed(workshop.job(text))) == warns


def test_modes_are_those_of_the_roof_without_mass_scaling(workshop):
    """Periods and damping ratios do not depend on inertia that the roof does not have."""
    text = SMALL + "[form_finding]\n[load]\ndead = 50.0\nself_weight = true\nadded_mass = 5.0\n"
    text += "[modes]\ncount = 3\n"
    text += "[dynamics]\nduration = 0.01\nmass_damping = 0.1\nmass_scaling = 0.0\n"
    names = ("modes/period", "modes/damping_ratio")
    plain = [workshop.solve(text)[name][:] for name in names]
    f = workshop.solve(text.replace("mass_scaling = 0.0", "mass_scaling = 0.5"))
    assert f["provenance"].attrs["added_mass"] > 0.0
    for name, values in zip(names, plain):
        assert f[name][:] == pytest.approx(values, rel=1e-9)


def test_mass_scaling_with_fragments_is_refused(workshop):
    """Fragments would move with inertia that has no weight."""
    text = "fracture_strain = 0.04\n[form_finding]\n[dynamics]\nduration = 0.1\nmass_scaling = 0.05\n"
    done = workshop.solve(SMALL + text, code=2)
    assert "mass_scaling = 0.05" in done.stderr and "fragments = false" in done.stderr


def test_rounded_coordinates_are_no_error_of_the_balance(workshop):
    """A loaded strut at rest at projected coordinates: only their rounding, 1e-9 m, changes its energy."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_x\n1,4e5,57e5,0,1,1,1,0\n2,400003,57e5,0,0,1,1,-98e3\n"
    text = '[cable]\nkind = "bar"\naxial_stiffness = 2e9\nmass_per_length = 6000\n'
    text += "[load]\nsteps = 1\ntolerance = 1e-6\n[dynamics]\nduration = 10.0\n"
    assert "0 warnings" in workshop.printed(workshop.job(text, nodes, "start,end\n1,2\n"))
