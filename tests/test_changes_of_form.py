"""Exact equivalences: other units, axes, orders and names must not change results; single parts."""

import json
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import STEEL, assert_same_results
from mpi4py import MPI
from scipy.optimize import brentq
from test_loads import CABLE, EA, ELEMENTS, nodes
from test_manufactured import DT, JOB, STEPS, make_tables, plain_of, run_here

from netfall.driver.dynamics.stepper import is_long_step_stable
from netfall.geometry.build import build_net
from netfall.job.read import read_job
from netfall.loads.wind.field import GrowingGusts
from netfall.parallel.halo import buffers_without_neighbours, exchange_rows
from netfall.physics.fields import Features
from netfall.physics.state import State
from netfall.post.checks.nodes import reaction_columns
from netfall.results.checkpoint import checkpoint_path, remove_old_checkpoints
from netfall.results.states import compute_envelope
from netfall.study.answers.removals import removals_of
from netfall.study.study import SampleQueue

STATE = ("position", "velocity", "tension", "plastic_strain")  # in /final


@pytest.fixture(scope="module")
def original(shared_workshop):
    """Return the net of test_manufactured.py, which breaks, as it is given there."""
    return run_here(shared_workshop, JOB.format(after="particle"), make_tables(), "original")[1]


def final(f, name):
    """Return /final, by number."""
    values = f[f"final/{name}"][:]
    return values if len(values) == len(f["net/elements"]) else values[np.argsort(f["final/particle_id"][:])]


def times(text: str, factors: dict) -> str:
    """Return a job text with numbers of some keys multiplied; "section.key" if a key occurs twice."""
    lines, section = [], ""
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        section = line.strip("[]") if line.startswith("[") else section
        factor = factors.get(f"{section}.{key}", factors.get(key, 1.0))
        lines.append(f"{key} = {float(value) * factor!r}" if factor != 1.0 else line)
    return "\n".join(lines) + "\n"


def test_equal_ratios_of_mass_and_force_move_equally(original, workshop):
    """All bits: stiffness, strength, density and loads times four give tensions and energies times four."""
    keys = ("modulus", "density", "yield_stress", "dead", "snow", "pressure", "air_density")
    t = make_tables()
    t |= {name: 4.0 * t[name] for name in ("load", "carried", "spring")}
    f = run_here(workshop, times(JOB.format(after="particle"), dict.fromkeys(keys, 4.0)), t)[1]
    for name, factor in zip(STATE, (1.0, 1.0, 4.0, 1.0)):
        assert (final(f, name) == factor * final(original, name)).all(), name
    for name in ("kinetic_energy", "strain_energy", "plastic_dissipation", "damping_work", "external_work"):
        assert (f[f"history/{name}"][:] == 4.0 * original[f"history/{name}"][:]).all(), name
    assert (f["history/energy_balance_error"][:] == original["history/energy_balance_error"][:]).all()
    assert (f["events/element"][:] == original["events/element"][:]).all()


def test_a_scaled_net_has_a_scaled_motion(original, workshop):
    """All bits, by Froude numbers: speeds times two, forces and masses times four, the same gravity."""
    factors = dict.fromkeys(("modulus", "yield_stress"), 4.0) | {"air_density": 1 / 16, "mass_damping": 0.5}
    factors |= dict.fromkeys(("dead", "snow", "pressure"), 0.25)
    factors |= dict.fromkeys(("ramp", "duration", "time_step", "history_interval"), 2.0)
    t = make_tables()
    t |= {name: 4.0 * t[name] for name in ("x", "L0", "carried", "load")} | {"area": 16.0 * t["area"]}
    text = times(JOB.format(after="particle"), factors).replace("[4.0, 8.0]", "[16.0, 32.0]")
    f = run_here(workshop, text, t, wind=(2.0, 2.0))[1]
    for name, factor in zip(STATE, (4.0, 2.0, 4.0, 1.0)):
        assert (final(f, name) == factor * final(original, name)).all(), name
    assert (f["history/kinetic_energy"][:] == 16.0 * original["history/kinetic_energy"][:]).all()
    assert (f["events/time"][:] == 2.0 * original["events/time"][:]).all()


@pytest.mark.parametrize("sign", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1)])
def test_a_mirror_image_has_the_mirrored_motion(original, workshop, sign):
    """All bits: no axis has a preferred direction, except z because of gravity."""
    t = make_tables()
    t |= {name: t[name] * sign for name in ("x", "load", "normal")}
    text = JOB.format(after="particle").replace("[4.0, 8.0]", f"[{4.0 * sign[0]}, {8.0 * sign[1]}]")
    f = run_here(workshop, text, t)[1]
    for name in STATE:
        assert (final(f, name) == final(original, name) * (sign if name in STATE[:2] else 1.0)).all(), name


def test_a_rotation_by_a_right_angle_changes_only_rounding(original, workshop):
    """x and y are exchanged. A length sums its squares in the order of the axes, so bits may differ."""
    t = make_tables()
    t |= {name: t[name][:, [1, 0, 2]] for name in ("x", "free", "spring", "load", "normal")}
    text = JOB.format(after="particle").replace("[4.0, 8.0]", "[8.0, 4.0]")
    f = run_here(workshop, text, t)[1]
    assert (f["events/element"][:] == original["events/element"][:]).all()
    for name in STATE:
        turned = final(original, name)[:, [1, 0, 2]] if name in STATE[:2] else final(original, name)
        assert np.abs(final(f, name) - turned).max() <= 1e-9 * np.abs(turned).max(), name  # as the plain one


def test_ids_and_order_of_nodes_change_no_bit(original, workshop):
    """Rows of nodes.csv are shuffled and renamed. A particle sums in the order of its elements."""
    t, order = make_tables(), np.random.default_rng(2).permutation(25)
    place = np.argsort(order)  # of each old row
    shuffled = {name: t[name][order] for name in ("x", "free", "spring", "area", "normal", "carried", "load")}
    t |= shuffled | {"ends": place[t["ends"]], "names": 1000 - 7 * order}
    text = JOB.format(after="particle").replace("[12, ", f"[{1000 - 7 * 12}, ")
    f = run_here(workshop, text, t)[1]
    assert (f["events/element"][:] == original["events/element"][:]).all()
    new = original["final/particle_id"][:]
    old = np.where(new < 25, place[np.minimum(new, 24)], new)
    rows = np.searchsorted(np.sort(f["final/particle_id"][:]), old)
    for name in STATE[:2]:
        assert (final(f, name)[rows] == original[f"final/{name}"][:]).all(), name
    for name in STATE[2:]:
        assert (final(f, name) == final(original, name)).all(), name
    for name in ("kinetic_energy", "external_work", "probe_displacement", "element_tension"):
        assert (f[f"history/{name}"][:] == original[f"history/{name}"][:]).all(), name


def test_the_order_of_elements_changes_only_rounding(original, workshop):
    """Some elements are also reversed. Sums at a particle have another order."""
    t, rng = make_tables(), np.random.default_rng(3)
    order = rng.permutation(len(t["ends"]))
    turned = rng.random(len(order)) < 0.5
    t |= {name: t[name][order] for name in ("ends", "L0", "bar")}
    t["ends"][turned] = t["ends"][turned, ::-1]
    t["ids"] = order
    f = run_here(workshop, JOB.format(after="particle"), t)[1]
    assert order[f["events/element"][:]].tolist() == original["events/element"][:].tolist()
    assert f["events/particle"][:].tolist() == original["events/particle"][:].tolist()
    for name in STATE[2:]:
        one, other = final(original, name)[order], final(f, name)
        assert np.abs(one - other).max() <= 1e-9 * np.abs(one).max(), name


def test_final_reactions_are_those_of_attached_elements(original):
    """Elements that broke off a support do not count, however taut they are. Springs push back."""
    plain = plain_of(make_tables())
    plain.run(DT, STEPS)
    eps, direction = plain.strains()
    pull = np.zeros_like(plain.x)
    along = plain.axial(eps)[0][:, None] * direction
    np.add.at(pull, plain.ends[:, 0], along)
    np.add.at(pull, plain.ends[:, 1], -along)
    pull = np.where(plain.spring > 0, plain.spring * (plain.x - plain.start), np.where(plain.free, 0.0, pull))
    rows = reaction_columns(original)
    last = np.flatnonzero([name.startswith("final") for name in rows["stage"]])
    forces = np.column_stack([rows[f"force_{axis}"][last] for axis in "xyz"])
    assert np.abs(forces - pull[rows["node"][last]]).max() <= 1e-7 * np.abs(pull).max()  # N, of kN of springs


# --- removals, panels, cases


def test_a_fading_cable_between_two_weights(workshop):
    """Factors 1 + abs(sin(pi d / T)) / (pi d / T) of falling tensions; equal bits after a restart."""
    W = 1500.0  # N: at rest the outer cables carry 2000 + W / 3, the middle one 2000 - 2 W / 3
    EA, L0 = 1e6, 5.0 / (1 + 2000.0 / 1e6)
    period = 2 * np.pi * np.sqrt(4000.0 * 1e-4 * L0 * L0 / EA)
    dt = period / 400
    text = CABLE.replace("1000.0", "4000.0\nprestress = 2000.0") + "[load]\nself_weight = false\n"
    text += f"tolerance = 1e-11\n[dynamics]\nduration = {1.6 * period}\ntime_step = {dt}\n[output]\n"
    text += f"history_interval = {40 * dt}\nframes = 2\ncheckpoint_interval = {130 * dt}\n"
    text += f"[[remove]]\nelements = [1]\ntime = {100 * dt}\nduration = {0.3 * period}\n"
    table = f"id,x,y,z,fixed,load_x\n0,0,0,0,1,0\n1,5,0,0,0,{W}\n2,10,0,0,0,-{W}\n3,15,0,0,1,0\n"
    job = workshop.job(text, table, "start,end\n0,1\n1,2\n2,3\n")
    f = workshop.run_here(job, "whole.vtkhdf")
    before, after, peak = (f[f"removal/tension_{of}"][0] for of in ("before", "after", "peak"))
    factor = f["removal/dynamic_factor"][0]
    assert before == pytest.approx([2500.0, 1000.0, 2500.0], rel=1e-9)
    assert after == pytest.approx([1500.0, 0.0, 1500.0], rel=1e-9) and (peak[[0, 2]] < 1500.0).all()
    turn = np.pi * 0.3
    # the step rounds the peak by (2 pi / 400)^2 / 8 of the swing
    assert factor[[0, 2]] == pytest.approx(1 + np.sin(turn) / turn, abs=1e-4)
    assert factor[0] == pytest.approx(factor[2], rel=1e-12)
    (checkpoint, *_) = sorted(workshop.folder.glob("whole.checkpoint*"))
    assert_same_results(f, workshop.run_here(job, "again.vtkhdf", restart=checkpoint))


def test_elements_that_yielded_in_statics_do_not_yield_again(workshop):
    """Dead load beyond yield acts, then most of it is removed: the sag is that of the plastic strain."""
    text = CABLE
    text += "yield_stress = 2e7\n[load]\nself_weight = false\ndead = 400.0\npressure = -250.0\nsteps = 1\n"
    text += "tolerance = 1e-9\n[dynamics]\nduration = 0.05\n[output]\nhistory_interval = 0.01\n"
    job = workshop.job(text, nodes(), ELEMENTS)
    f = workshop.run_here(job)
    sine = 0.5 * 1600.0 / 2000.0
    plastic = 1 / np.sqrt(1 - sine**2) - 1 - 2e-3
    assert f["final/plastic_strain"][:] == pytest.approx(plastic, rel=1e-6)
    pull = lambda w: 2 * EA * (np.hypot(5, w) / 5 - 1 - plastic) * w / np.hypot(5, w) - 600.0
    assert -f["statics/displacement"][-1, 1, 2] == pytest.approx(brentq(pull, 0.1, 5.0), rel=1e-6)
    assert np.abs(f["history/plastic_dissipation"][:]).max() < 1e-5  # of 2 kN 5 m 0.09, at rest to 1e-9


@pytest.mark.parametrize("bar, most", [(0, 1.0), (1, 2.0)])
def test_the_long_step_may_reach_the_limit_of_the_intact_net(bar, most):
    """0.9 of 1 / omega of a cable, 2 / omega of a bar; omega^2 = k (1 / M + 1 / m), half of m split off."""
    state = State(Features(bars=True), 2, 0, 1)
    state.ends[:], state.EA[:], state.L0[:], state.bar[:] = [[0, 1]], 1e6, 5.0, bar
    state.free[:] = 1
    nobody = SimpleNamespace(width=1, update=lambda rows: None)
    for mass, shorter in ((20.0, 1.0), (10.0, np.sqrt(2.0 / 3.0))):
        state.mass[:] = mass, 20.0
        state.invert_masses()
        longest = 0.9 * most / np.sqrt(2e5 * 2.0 / 20.0) * shorter
        for dt, allowed in ((longest * (1 - 1e-9), True), (longest * (1 + 1e-9), False)):
            assert is_long_step_stable(MPI.COMM_SELF, state, nobody, dt, 0.9) is allowed


def test_a_spring_starts_with_the_reaction_of_the_form(workshop):
    """Nothing moves."""
    table = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_x\n1,0,0,0,1,1,1,\n2,5,0,0,0,1,1,4e5\n"
    text = CABLE + "prestress = 20e3\n[form_finding]\n[dynamics]\nduration = 0.01\ntime_step = 2e-4\n"
    job = workshop.job(text + "[output]\nhistory_interval = 0.002\n", table, "start,end\n1,2\n")
    f = workshop.run_here(job)
    assert np.abs(f["final/position"][1] - [5.0, 0.0, 0.0]).max() < 1e-14  # rounding: 20 kN over 4e5 N/m
    assert f["net/spring"][1, 0] == 4e5


def test_a_case_that_yields_does_not_affect_the_next_one(workshop):
    """Two equal cases enclose one in which the cables yield. Their results have equal bits."""
    text = CABLE + "yield_stress = 2e7\n[load]\nself_weight = false\ndead = 50.0\ntolerance = 1e-9\n"
    for name, snow in (("first", 60.0), ("heavy", 400.0), ("again", 60.0)):
        text += f'[[case]]\nname = "{name}"\nset = {{"load.snow" = {snow}}}\n'
    f = workshop.run_here(workshop.job(text, nodes(), ELEMENTS))
    of_cases = [f[f"cases/{name}/tension"][:] for name in ("first", "heavy", "again")]
    whole = compute_envelope(f)
    assert (whole.most == np.max(of_cases, axis=0)).all() and (whole.least == 0.0).all()  # as given
    assert (f["cases/heavy/tension"][:] == 2000.0).all()  # at yield
    for name in ("displacement", "tension"):
        assert np.array_equal(f[f"cases/first/{name}"][:], f[f"cases/again/{name}"][:])


def test_a_cable_breaks_at_its_breaking_load(workshop):
    """The strain at fracture is the breaking load over EA, if it is less than the given one."""
    text = STEEL.replace("prestress = 100e3\n", "breaking_load = 300e3\n")
    job = workshop.job(text, nodes(), ELEMENTS)
    net = build_net(read_job(job))
    assert net.fracture_strain == pytest.approx([300e3 / (1.95e11 * 683.08e-6)] * 2, rel=1e-14)


def test_a_resumed_run_keeps_the_last_two_checkpoints(tmp_path):
    """And the one that it resumed, but none of another job."""
    result = tmp_path / "result.vtkhdf"
    paths = [checkpoint_path(result, 5, 10 * k) for k in range(6)]
    for k, path in enumerate(paths):
        with h5py.File(path, "w") as file:
            file["record"] = json.dumps({"job": "another" if k == 1 else "this"})
    remove_old_checkpoints(paths[5], result, "this", paths[2])
    assert sorted(tmp_path.iterdir()) == [paths[k] for k in (1, 2, 4, 5)]


# --- studies


def test_a_worker_reuses_its_cached_results():
    """Samples that differ only in gusts run one after the other. Another worker begins with others."""
    values = {1: ("a", 1), 2: ("b", 1), 3: ("a", 2), 4: ("b", 2)}
    sample = lambda k: SimpleNamespace(values={"load.snow": values[k][0], "wind.seed": values[k][1]})
    queue = SampleQueue(SimpleNamespace(sample=sample), [1, 2, 3, 4])
    first, number = queue.take(None)
    assert number == 1 and queue.take(first) == (first, 3)
    assert [queue.take(first)[1], queue.take(None)[1], queue.take(None)] == [2, 4, None]


def test_a_roof_without_equilibrium_counts_as_detached():
    """For any earlier detached area. The worst of several samples of a removal counts."""
    samples = {
        "removed": np.array(["7", "7", "9"]),
        "state": np.array(["finished", "no_equilibrium", "finished"]),
        "detached_area": np.array([0.2, 0.1, 0.3]),
        "broken": np.array([3, 1, 0]),
    }
    removals = removals_of(SimpleNamespace(samples=samples, finished=samples["state"] == "finished"))
    assert removals.name.tolist() == ["7", "9"] and removals.detached_area.tolist() == [1.0, 0.3]
    assert removals.no_equilibrium.tolist() == [1, 0] and removals.broken.tolist() == [3.0, 0.0]
    samples["equilibrium_after_removal"] = np.array(["breaks", "", "unstable"])
    removals = removals_of(SimpleNamespace(samples=samples, finished=samples["state"] == "finished"))
    assert removals.no_equilibrium.tolist() == [1, 1] and removals.detached_area.tolist() == [1.0, 0.3]
    assert removals.not_stable.tolist() == [0, 1] and removals.breaking.tolist() == [1, 0]


# --- parts of the wind


def test_a_table_of_speeds_begins_at_its_mean():
    """The ramp applies to the difference from the mean. A table that begins before 0 s may act at once."""
    rows = [(-0.5, 10.0), (0.5, 30.0), (4.0, 18.0)]
    samples = [(time, np.array([speed])) for time, speed in rows]
    of = SimpleNamespace(mean_gust=np.array([20.0]), sample=samples.__getitem__)
    grown, speeds = GrowingGusts(of, 2.0), []
    for _ in rows:
        speeds += [(t, float(u[0])) for t, u in grown.next()]
    time, speed = np.transpose(speeds)
    share = 0.5 * (1 - np.cos(np.pi * np.clip(time, 0, 2) / 2))
    given = np.interp(time, *np.transpose(rows))
    assert speed == pytest.approx(20.0 + share * (given - 20.0), rel=1e-12) and len(time) > 16
    at_once = GrowingGusts(of, 0.0)
    assert [at_once.next()[0][1][0] for _ in rows] == [10.0, 30.0, 18.0]


# --- the exchange


def test_a_rank_may_be_one_exchange_ahead():
    """A rank fills its second buffer while its stopped neighbour has not yet read the first."""
    numbers, none = np.zeros(64), np.zeros(0, np.uint32)
    address = numbers.ctypes.data
    ahead, behind = (
        buffers_without_neighbours().with_values(
            send_index=send, numbers=numbers, send_at=8, receive_at=receive, to_second=8,
            count=np.zeros(1, np.int64), own_count=own, counts=np.array([address], np.uint64),
        )
        for send, receive, own in (
            (np.array([0, 1], np.uint32), np.zeros(0, np.int64), address),
            (none, np.array([8, 9]), address + 8 * 40),
        )
    )  # fmt: skip
    arrived, nothing = np.zeros((2, 1)), np.zeros((0, 1))
    for turn in range(1, 4):
        if turn == 1:
            exchange_rows(np.array([[1.0], [10.0]]), nothing, ahead)
        exchange_rows((turn + 1) * np.array([[1.0], [10.0]]), nothing, ahead)
        exchange_rows(nothing, arrived, behind)
        assert arrived[:, 0].tolist() == [turn, 10.0 * turn]
