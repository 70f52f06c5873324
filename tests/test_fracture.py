"""Fracture by splitting particles: which particles split, conserved quantities, consequences."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import STEEL, assert_same_results, audits
from mpi4py import MPI
from nets import saddle, table
from test_kernels import ALL_FEATURES, LATTICE, lattice, make_state

from netfall.core.kernels import kernel
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan
from netfall.geometry.net import Net
from netfall.loads.removal import is_unsupported
from netfall.model.schedule import choose_stride
from netfall.parallel.halo import Halo
from netfall.parallel.subdomain import split_net
from netfall.physics.fields import Features, fields_of
from netfall.physics.fracture import FractureRules, dissipate_stored
from netfall.physics.state import State

BRITTLE = STEEL.replace("prestress = 100e3\n", "yield_stress = 1e12\nfracture_strain = 1e-3\n")
DYNAMICS = "[dynamics]\nduration = {}\n[output]\nhistory_interval = 0.001\nframes = {}\n"


def test_an_element_with_an_end_without_mass_breaks_without_splitting(workshop):
    """Its ends have no mass, so there is nothing to split off."""
    nodes = "id,x,y,z,load_z\n1,0,0,0,0\n2,0,0,1,200000\n"
    f = workshop.solve(BRITTLE + DYNAMICS.format(0.001, 5), nodes, "start,end\n1,2\n")
    assert f["events/particle"][:].tolist() == [0] and f["events/new_particle"][:].tolist() == [-1]
    assert f["history/broken"][-1] == 1 and len(f["final/position"]) == 2


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_load_without_mass_ends_with_the_last_element(workshop, ranks):
    """The load does not stretch the broken element without end, and pull on 1000 kg with its strength."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,3,1,0,0\n2,0,0,2,0,1000,0\n3,0,0,0,0,0,-400000\n"
    f = workshop.solve(BRITTLE + DYNAMICS.format(0.1, 5), nodes, "start,end\n1,2\n2,3\n", ranks=ranks)
    assert f["events/particle"][:].tolist() == [2] and f["events/new_particle"][:].tolist() == [6]
    assert (f["final/velocity"][2] == 0.0).all() and abs(f["final/position"][2, 2]) < 0.01
    assert f["envelope/tension_max"][0] < 0.6 * 683.08e-6 * 1.95e11 * 1e-3
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12


@pytest.mark.parametrize("ranks", [1, 2])
def test_masses_at_free_ends_fall_off(workshop, ranks):
    """Two masses part from their element at both ends and fly on. None stays on a broken element."""
    nodes = "id,x,y,z,mass,load_z\n1,0,0,0,500,-200000\n2,0,0,1,500,200000\n"
    f = workshop.solve(BRITTLE + DYNAMICS.format(0.05, 5), nodes, "start,end\n1,2\n", ranks=ranks)
    assert f["events/new_particle"][:].tolist() == [2, 3]
    assert abs(f["final/tension"][0]) < 1e5 and len(f["final/position"]) == 4
    acceleration = 200000 / 500
    assert abs(np.ptp(f["final/velocity"][:2, 2]) / (2 * acceleration * 0.05) - 1) < 0.2


def test_ice_leaves_with_the_fragment(workshop):
    """The fragment that falls off takes its half of the ice, mass and weight, as of the element itself."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,2,1,0,0\n2,0,0,0,0,1000,-400000\n"
    iced = BRITTLE + "diameter = 0.04\n[load]\nice = 0.05\n"
    damped = ("--set", "dynamics.fragment_mass=0", "--set", "dynamics.mass_damping=100")
    f = workshop.solve(iced + DYNAMICS.format(1.0, 5), nodes, "start,end\n1,2\n", *damped)
    L0 = f["net/unstressed_length"][0]
    own, ice = 7850 * 683.08e-6 * L0, 900 * np.pi * (0.04 * 0.05 + 0.05**2) * L0
    assert f["events/mass"][:] == pytest.approx([0.5 * (own + ice)], rel=1e-9)
    assert f["events/particle"][:].tolist() == [1]
    assert f["final/tension"][0] == pytest.approx(9.81 * 0.5 * (own + ice), rel=1e-2)  # it hangs at rest


PULLED = saddle(section=(1.95e11, 683.08e-6, 7850.0)) + "[load]\nself_weight = false\n"
PULLED += "pressure = [0.0, 0.0, 12000.0]\n[dynamics]\nduration = {}\n[output]\nframes = 10\n"
LIGHT = ("--set", "load.dead=500", "--set", "dynamics.fragment_mass=0")  # fragments on a heavy roof


def test_the_short_step_begins_with_the_first_fracture(workshop):
    """Earlier rows have the long step. The fracture equals that with steps of a fifth."""
    f = workshop.solve(PULLED.format(0.6), "", "", *LIGHT)
    attributes, first = f["provenance"].attrs, f["events/time"][0]
    time, step = f["history/time"][1:], f["history/time_step"][1:]
    long, short = attributes["time_step"], attributes["shortest_time_step"]
    assert long / short == pytest.approx(round(long / short), rel=1e-12) and long > 1.5 * short
    assert (step[time < first] == long).all() and step[time > first][0] == short
    assert 0.6 / long < attributes["steps"] < 0.6 / short
    sentence = f"{attributes['steps']} steps of {long:.4g} s, or of {short:.4g} s after fractures;"
    assert sentence in workshop.info()
    fine = workshop.run(workshop.folder / "job.toml", *LIGHT, "--set", f"dynamics.time_step={short / 5:.9g}")
    assert abs(fine["events/time"][0] - first) < short and fine["events/element"][0] == f["events/element"][0]
    assert fine["provenance"].attrs["steps"] == round(0.6 / float(f"{short / 5:.9g}"))
    assert "after fractures" not in workshop.info()


def test_frames_and_checkpoints_do_not_change_the_steps(workshop):
    """Only fractures decide which steps are repeated, so the bits are the same.

    The row of the step from which steps are short is made before these in both runs.
    """
    path, common = workshop.job(PULLED.format(0.6)), (*LIGHT, "--set", "output.history_interval=1e-4")
    one = workshop.run(path, *common, output="one.vtkhdf")
    more = (*common, "--set", "output.frames=6000", "--set", "output.checkpoint_interval=0.0173")
    other = workshop.run(path, *more, output="other.vtkhdf")
    assert one["history/broken"][-1] > 10
    for group in ("events", "history", "envelope", "final"):
        for name in one[group]:
            assert one[group][name][()].tobytes() == other[group][name][()].tobytes(), name


@pytest.mark.parametrize("ratio, stride", [(1.0, 1), (1.4, 1), (1.45, 2), (2.4, 2), (2.5, 3), (7.9, 8)])
def test_the_long_step_is_a_multiple_of_the_short_one(ratio, stride):
    """The cheaper of the two steps becomes shorter."""
    assert choose_stride(ratio) == stride and choose_stride(np.inf) == 1


def test_a_refused_step_names_the_fragments(workshop):
    """A step that is stable only in the intact net is refused, with the element that limits it."""
    done = workshop.solve(PULLED.format(0.3), "", "", "--set", "dynamics.time_step=2e-3", code=2)
    assert "of the fragments after a fracture" in done.stderr and "set by element" in done.stderr


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
def test_removed_elements_keep_the_mass_and_the_energy_balance(both_ways, strain):
    """No particle splits off, stored energy is dissipated; the step is that of the intact net."""
    text = PULLED.format(0.6).replace("fracture_strain", f'strain_measure = "{strain}"\nfracture_strain')
    f = both_ways.solve(text, "", "", "--set", "dynamics.fragments=false", "--set", "dynamics.safety=0.1")
    assert f["history/broken"][-1] > 10
    assert (f["events/new_particle"][:] == -1).all()
    assert not f["events/mass"][:].any()
    assert len(f["final/position"]) == len(f["net/particles"])
    assert "limit_after_fracture" not in f["provenance"].attrs
    assert (audits(f) < (1e-10, 1e-3)).all()
    broken = np.unique(f["events/element"][:])
    last = f["VTKHDF/Connectivity"][:][-2 * len(f["net/elements"]) :].reshape(-1, 2)
    assert np.array_equal(np.flatnonzero(last[:, 0] == last[:, 1]), broken)  # drawn as points
    assert f["VTKHDF/CellData/strain"][-len(last) :].max() < 0.0405
    assert not f["final/tension"][:][broken].any()
    assert f["VTKHDF/CellData/broken"][-len(f["net/elements"]) :].sum() == len(broken)


def test_a_removed_elastic_element_keeps_the_energy_balance(workshop):
    """A chain without yielding is pulled apart."""
    rows = ((k, 0, 0, k, int(k == 0), 50, 150000 * (k == 8)) for k in range(9))
    tables = table("id,x,y,z,fixed,mass,load_z", rows), table("start,end", ((k, k + 1) for k in range(8)))
    text = BRITTLE.replace("yield_stress = 1e12\n", "") + DYNAMICS.format(0.05, 10)
    settings = "--set", "dynamics.fragments=false", "--set", "dynamics.safety=0.05"
    f = workshop.solve(text, *tables, *settings)
    assert f["history/broken"][-1] >= 1 and f["history/plastic_dissipation"][-1] > 0.0
    assert (audits(f) < (1e-10, 1e-3)).all()


@kernel
def dissipate_one(e, dt, elements, particles, law):
    dissipate_stored(e, dt, elements, particles, law)


def test_a_removed_element_that_cannot_yield_dissipates_its_strain_energy():
    """Another group yields. Its own yield force is infinite, and its plastic work is 0, not inf x 0."""
    state = State(Features(plastic=True, fracture=True, fragments=False), 2, 0, 1)
    state.ends[:], state.owned[:], state.free[:], state.mass[:] = [[0, 1]], 1, 1, 1.0
    state.x[1, 0], state.L0[:], state.EA[:], state.yield_force[:] = 2.0, 1.9, 1e6, np.inf
    dissipate_one(0, 1e-4, state.elements, state.particles, state.law)
    assert state.dissipated[0] == pytest.approx(0.5 * 1e6 * 0.1**2 / 1.9, rel=1e-12)


def test_a_part_without_vertical_support_is_loose():
    """A weight guided in x and y but not in z has no equilibrium."""
    fixed = np.array([[True, True, True], [True, True, False]])
    net = Net(x=np.zeros((2, 3)), elements=np.array([[0, 1]]), fixed=fixed, group=[0], group_names=[""])
    load, removed = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.zeros(2, bool)
    assert not is_unsupported(net, np.array([True]), load, removed)
    assert is_unsupported(net, np.array([False]), load, removed)
    assert not is_unsupported(net, np.array([False]), load[:, [0, 2, 1]], removed)
    net.fixed[1], net.angle = [True, False, True], np.array([0.0, 90.0])  # held along y, by its angle
    assert not is_unsupported(net, np.array([False]), load[:, [0, 2, 1]], removed)
    assert is_unsupported(net, np.array([False]), load[:, [2, 0, 1]], removed)


def torn_lattice(fragments: bool) -> tuple[State, StepPlan]:
    """Return a lattice of 1,600 particles and all kinds of elements, after hundreds broke in 400 steps."""
    n, elements = len(LATTICE), lattice()
    state = make_state(replace(ALL_FEATURES, fragments=fragments), n, elements, LATTICE, 3)
    state.valence[:], state.half_mass[:] = np.bincount(elements.ravel()), 0.01
    state.gid[:], state.v[:] = np.arange(n), 10.0 * np.random.default_rng(3).normal(size=(n, 3))
    (subdomain,) = split_net(n, elements, np.zeros(n, np.int32), 1)
    ranks = n, n, np.arange(len(elements))  # all particles are owned
    rules = FractureRules(n, *ranks, 9.81, True, True, True, 2e-5 if fragments else np.nan, 0.0)
    plan = StepPlan(state, Halo(MPI.COMM_SELF, subdomain, 5), rules)
    advance(plan, 0, 400)
    assert (state.broken == 1).sum() > 200
    return state, plan


def advance(plan: StepPlan, step: int, last: int) -> None:
    """Advance from one step to another, with all fractures."""
    while step < last:
        step += plan.run(Interval(step, last - step, 2e-5, 2e-5, 0.0, 0.0, 1e9))


@pytest.mark.parametrize("fragments", [True, False])
def test_the_updated_incidence_after_fractures_equals_a_new_one(fragments):
    """A lattice with all kinds of elements breaks. Incident elements stay in order, with all fields."""
    state, plan = torn_lattice(fragments)
    assert (state.n_local > state.n_owned) == fragments
    mended = slots_of(state)
    plan.attach(state)
    assert mended == slots_of(state)


def slots_of(state: State) -> list:
    """Return the incident elements of each particle in order, with all fields except extremes."""
    known = [f for f in fields_of("slot") if state.features.has(f) and f.short not in ("highest", "lowest")]
    columns = {f.short: getattr(state, f.name) for f in known}
    slots = [column[:, : state.n_local] for column in columns.values()]
    full = columns["inv_L0"][:, : state.n_local] > 0.0
    return [[tuple(c[s, p] for c in slots) for s in np.flatnonzero(full[:, p])] for p in range(state.n_local)]


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
def test_the_remainder_of_an_element_that_cannot_yield_keeps_its_strength(strain):
    """Its light end has four times the energy that it can store. At its strength it lengthens further."""
    EA, eps_u, mass, dt = 1e6, 0.01, 2.0, 2e-6
    strength = EA * eps_u
    state = State(Features(fracture=True, strain=strain), 2, 0, 1)
    state.ends[:], state.owned[:], state.free[1], state.mass[:] = [[0, 1]], 1, 1, mass
    state.x[1, 0], state.L0[:], state.EA[:], state.eps_u[:] = 1.0, 1.0, EA, eps_u
    state.broken[:], state.valence[:], state.gid[:] = 1, 1, [0, 3]
    state.v[1, 0] = np.sqrt(4.0 * strength * eps_u / mass)
    (subdomain,) = split_net(2, state.ends.astype(np.int64), np.zeros(2, np.int32), 1)
    rules = FractureRules(2, 2, 2, np.zeros(1, int), 0.0, False, False, False, dt, 0.0)
    plan = StepPlan(state, Halo(MPI.COMM_SELF, subdomain, 5), rules)
    energy, adds = 0.5 * mass * state.v[1, 0] ** 2, EA * state.v[1, 0] * dt
    most, over, step = 0.0, 0, 0
    while state.v[1, 0] > 0.0:
        step += plan.run(Interval(step, 1, dt, dt, 0.0, 0.0, 1.0))
        N = state.present_element_state().N[0]
        most, over = max(most, N), over + (N > strength * (1.0 + 1e-6))
    assert over == 1
    assert strength < most < strength + adds and not plan.events.count[0]
    grown = (state.L0[0] - 1.0) * (1.0 + eps_u if strain == "engineering" else np.exp(eps_u))
    assert state.dissipated[0] == pytest.approx(strength * grown, rel=0.02)
    stored = 0.5 * strength * eps_u * state.L0[0]
    assert state.dissipated[0] + stored == pytest.approx(energy, rel=0.01)


TORN_BY_LOAD = PULLED.replace("yield_stress = 1.75e9\nfracture_strain = 0.0404", "breaking_load = 500e3")
TORN_BY_LOAD = TORN_BY_LOAD.replace("12000.0", "20000.0").format(1.0)


def test_a_yield_stress_that_no_element_reaches_changes_nothing(workshop):
    """Cables that break at 500 kN and yield at 6.8 MN break like cables without a yield stress."""
    job = workshop.job(TORN_BY_LOAD)
    plain = workshop.run(job, output="plain.vtkhdf")
    yielding = workshop.run(job, "--set", "cable.yield_stress=1e10", output="yielding.vtkhdf")
    assert len(plain["events/time"]) > 10
    names = "events/time", "events/strain", "envelope/tension_max", "history/plastic_dissipation"
    for name in (*names, "final/position"):
        assert np.array_equal(plain[name][:], yielding[name][:])


def test_a_fracture_just_before_yield_has_the_same_energies_on_two_ranks(workshop):
    """One step exceeds the strength and the yield force, 1 % larger. The remainder never yields."""
    job = workshop.job(TORN_BY_LOAD)
    given = "--set", "cable.yield_stress=7.4e8"
    one = workshop.run(job, *given, output="one.vtkhdf")
    assert_same_results(one, workshop.run(job, *given, ranks=2, output="two.vtkhdf"))
    assert len(one["events/time"]) > 10 and one["final/plastic_strain"][:].any()
    assert np.abs(one["history/balance_error_attached"][:]).max() < 1e-3
