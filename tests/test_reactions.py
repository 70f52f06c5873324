"""Reactions balance the loads in every equilibrium of a result, for any net."""

import re
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import h5py
import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks
from loaded_nets import FEATURES, LoadedNet, case_load, loaded_net
from nets import table

from netfall.geometry.net import GRAVITY
from netfall.parallel.mpi import MPI
from netfall.post.checks.nodes import reaction_columns
from netfall.results.warning_text import force_balance_warnings
from netfall.statics.reactions import BalanceTerms, sum_balance

# of the sum of absolute reactions: reactions and residuals against loads; rounding is below 1e-12
EXACT = 1e-9
SHORT, LONG = [*range(25), 34, 39, 106], range(200)  # seeds of jobs, with every feature
NOT_FOUND = "no_equilibrium", "undecided"  # states


class Kept(NamedTuple):
    """An equilibrium of a result: its place in the file, positions (n, 3) [m]; the rest in N.

    load : (n, 3), as the job gives it; reaction : (n, 3); residual_sum : (3,)
    """

    place: str
    x: np.ndarray
    load: np.ndarray
    reaction: np.ndarray
    residual_sum: np.ndarray

    @property
    def scale(self) -> float:
        """The sum of absolute reactions."""
        return np.abs(self.reaction).sum()


def kept_at(f, place: str, row, start: np.ndarray, load: np.ndarray) -> Kept:
    """Return an equilibrium of a group of the file. row : of its datasets; start : (n, 3) [m]"""
    group = f[place]
    x = group["position"][row] if "position" in group else start + group["displacement"][row]
    return Kept(place, x, load, group["reaction"][row], group["residual_sum"][row])


def hanging(net: LoadedNet, f, L0, is_present=None) -> np.ndarray:
    """Return self weight (n, 3) [N] of elements with unstressed lengths L0 (m,) [m], half at each end."""
    ends, parts = f["net/elements"][:], len(f["net/elements"]) // len(net.ends)
    half = 0.5 * np.repeat(net.weights(net.group), parts) * L0 * (True if is_present is None else is_present)
    force = np.zeros((len(f["net/particles"]), 3))
    for end in ends.T:
        np.subtract.at(force[:, 2], end, half)
    return force


def kept_states(net: LoadedNet, f) -> list[Kept]:
    """Return all equilibria of a result that carry their whole load, with the loads of the job."""
    n, every = len(f["net/particles"]), np.ones(len(f["net/elements"]), bool)
    # inside elements there is none
    on_all = lambda rows: np.concatenate([rows, np.zeros((n - len(rows), 3))])
    live = lambda changed: on_all(net.of_roof("snow", changed) + net.of_roof("pressure", changed))
    dead, at_nodes = lambda changed: on_all(net.of_roof("dead", changed)), on_all(net.load)
    states, changed, last = [], {}, None
    carries = lambda place: place in f and f[place].attrs.get("state") not in NOT_FOUND
    start = f["form_finding/position"][:] if "form_finding" in f else f["net/particles"][:]
    if carries("form_finding"):
        load = hanging(net, f, f["form_finding/unstressed_length"][:]) + dead({})
        states.append(kept_at(f, "form_finding", ..., start, load * ("loaded_form" in net.features)))
    for stage in net.job.get("stage", []):
        changed |= stage.get("set", {})
        if (place := f"stages/{stage['name']}") not in f:
            return states
        is_present, at, last = f[place]["active"][:] == 1, np.zeros((n, 1), bool), place
        at[f["net/elements"][:][is_present]] = True
        load = np.where(at, live(changed) + dead(changed) + at_nodes, 0.0)
        load += hanging(net, f, f[place]["unstressed_length"][:], is_present)
        if carries(place):
            states.append(kept_at(f, place, ..., start, load))
    is_present = f[last]["active"][:] == 1 if last else every
    start = start + f[last]["displacement"][:] if last else start
    permanent = hanging(net, f, f["net/unstressed_length"][:], is_present) + dead({})
    load = permanent + live({}) + at_nodes
    if "statics" in f:
        factors = f["statics/load_factor"][:]
        for row in range(len(factors) - (not carries("statics"))):
            states.append(kept_at(f, "statics", row, start, permanent + factors[row] * (load - permanent)))
    named, added = {}, {}
    for case in net.job.get("case", []):
        own, others = case.get("set", {}), on_all(case_load(net, case, start[: len(net.x)]))
        added[case["name"]] = live(own) - live({}) + dead(own) - dead({}) + others
        named[case["name"]] = load + added[case["name"]]
    for each in net.job.get("combination", []):
        factors = each["factors"]
        named[each["name"]] = factors["permanent"] * permanent + factors["load"] * (live({}) + at_nodes)
        named[each["name"]] += sum(factors[name] * force for name, force in added.items())
    for name, force in named.items():
        if carries(f"cases/{name}"):
            states.append(kept_at(f, f"cases/{name}", ..., start, force))
    if carries("initial_state"):
        wind = on_all(net.of_steady_wind(start[: len(net.x)]))
        states.append(kept_at(f, "initial_state", ..., start, load + wind))
    return states


def balanced(net: LoadedNet, folder: Path, counts: Counter) -> None:
    """Run a job; AssertionError if the reactions of any of its equilibria do not balance the loads.

    counts : receives the exit code and the largest imbalances
    """
    for name, text in (net.tables | {"job.toml": net.text}).items():
        (folder / name).write_text(text)
    line = ["run", "job.toml", "-o", "result.vtkhdf"]
    done = run_on_standing_ranks(*line, cwd=folder, code=None)
    output = done.stdout + done.stderr
    counts[f"exit code {done.returncode}"] += 1
    assert done.returncode in (0, 3), output
    assert "out of balance" not in output, output
    if not (folder / "result.vtkhdf").exists():
        return
    with h5py.File(folder / "result.vtkhdf") as f:
        if "initial_state" in f and "envelope" in f:  # the motion starts in this equilibrium
            R, e = f["initial_state/reaction"][:], f["envelope"]
            small = 1e-9 * np.abs(R).max()
            assert (e["reaction_lowest"][:] <= R + small).all()
            assert (e["reaction_highest"][:] >= R - small).all()
        for each in kept_states(net, f):
            tolerance = net.job["load"]["tolerance"]
            if each.place == "form_finding":
                tolerance = net.job["form_finding"]["tolerance"]
            off = each.load - each.reaction
            exact = np.abs(off.sum(0) - each.residual_sum).max() / each.scale
            rough = np.abs(off.sum(0)).max() / (tolerance * each.scale)
            turning = np.abs(np.cross(each.x - each.x.mean(0), off).sum(0)).max()
            turning /= tolerance * each.scale * np.ptp(each.x, axis=0).max()
            assert exact <= EXACT and rough <= 1.0, f"{each.place}: {exact:.2g}, {rough:.2g} of the tolerance"
            if not net.features & {"bending", "slide"}:  # sections held against tilting; weights that moved
                assert turning <= 1.0, f"{each.place}: moments, {turning:.2g} times the tolerance"
                counts["moments"] = max(counts["moments"], turning)
            counts["exact"], counts["rough"] = max(counts["exact"], exact), max(counts["rough"], rough)
            counts[each.place.partition("/")[0]] += 1
            counts.update(net.features)


def try_all(seeds) -> Counter:
    """Run the jobs of some seeds; return their outcomes."""
    counts = Counter()
    for seed in seeds:
        with TemporaryDirectory() as folder:
            balanced(loaded_net(seed), Path(folder), counts)
    return counts


def test_reactions_include_the_weight_of_slipping_cables(workshop):
    """jobs/slide.toml: 380 kN at hangers, and its own weight, less of which is then at the anchors."""
    f = workshop.run(ROOT / "jobs" / "slide.toml", "--set", "load.tolerance=1e-9")
    weight = GRAVITY * np.sum(f["net/mass_per_length"][:] * f["net/unstressed_length"][:])
    assert np.abs(f["statics/slip"][-1]).max() > 0.01  # m
    for factor, reaction in zip(f["statics/load_factor"][:], f["statics/reaction"][:]):
        off = reaction.sum(0) + [0.0, 0.0, weight + factor * 380e3]
        assert np.abs(off).max() < 1e-9 * np.abs(reaction).sum()


UP = np.array([0.0, 0.0, 1.0])
# two supports and a node between them [m]
ROW = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    "left, right, between, hold, expected",
    [
        (5.0, 5.0, 0.0, 0.0, 0.0),
        (4.9995, 4.9995, 0.001, 0.0, (1e-3 - 5e-4 - 1e-5) / 9.999),  # beyond residual 5e-4 N, tolerance 1e-6
        (4.9998, 4.9998, 0.0004, 0.0, 0.0),
        (4.999, 5.0, 0.0, 0.0, 1e-3 / 9.999),  # a force that no residual has
        (6.0, 4.0, 0.0, 0.0, 4.0 / (10.0 * 4.0)),  # a moment of 4 N m, of 10 N times 4 m
        (6.0, 4.0, 0.0, 4.0, 0.0),  # which sections that are held against tilting may take
    ],
)
def test_a_run_detects_reactions_that_do_not_balance_the_loads(left, right, between, hold, expected):
    """10 N at the middle of three nodes, by hand: the unexplained share."""
    forces = [0, 10, 0], [left, 0, right], [0, between, 0]
    load, reaction, residual = (np.outer(rows, -UP) for rows in forces)
    moves, N = np.array([False, True, False]), np.array([7.0, 7.0])
    parts = BalanceTerms(ROW, load, reaction, residual, moves, N, np.array([hold]))
    balance = sum_balance(MPI.COMM_SELF, parts, 5e-4, 1e-6)
    assert balance.unexplained == pytest.approx(expected, rel=1e-4, abs=1e-12)
    assert balance.error == pytest.approx(abs(10.0 - left - right) / max(left + right, 7.0), abs=1e-15)
    assert balance.residual_sum == pytest.approx([0.0, 0.0, -between])


def test_one_warning_names_the_worst_equilibrium():
    assert [*force_balance_warnings([("case snow", 0.0)])] == []
    (line,) = force_balance_warnings([("case snow", 1e-4), ("case wind", 0.12), ("form", 0.0)])
    assert line.startswith("warning: case wind (and 1 other equilibria): loads, reactions") and "0.12" in line


@pytest.mark.parametrize("seeds", [SHORT, pytest.param(LONG, marks=pytest.mark.long)], ids=len)
def test_reactions_balance_the_loads_of_random_nets(seeds):
    counts = try_all(seeds)
    assert counts["exit code 0"] > 0.8 * len(seeds), counts
    assert not {name for name in FEATURES if not counts[name]}, counts
    places = "form_finding", "stages", "statics", "cases", "initial_state"
    assert min(counts[place] for place in places) > 2, counts


def test_reactions_in_motion_have_their_peak(workshop):
    """A weight falls into a spring under a bar: at most twice the weight, 50 N of load on the other foot."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z,load_z,mass\n1,0,0,0,1,1,1,0,-50,0\n"
    nodes += "2,0,0,-1,1,1,0,3e5,-1000,100\n"
    text = '[cable]\nkind = "bar"\nmodulus = 1e9\narea = 1e-4\ndensity = 1.0\n'
    text += "[load]\nself_weight = false\nsteps = 0\n[dynamics]\nduration = 0.09\n"
    text += "[output]\nhistory_interval = 1e-3\n"
    f = workshop.solve(text, nodes, "start,end\n1,2\n")
    e, period = f["envelope"], 2.0 * np.pi * np.sqrt(100.0 / 4e5)
    assert e["reaction_lowest"][:] == pytest.approx(np.array([[0, 0, -550], [0, 0, -1500]]), rel=1e-3)
    assert e["reaction_highest"][:] == pytest.approx(np.array([[0, 0, -50], [0, 0, 0]]), abs=1e-9)
    assert e["reaction_max"][:] == pytest.approx(np.array([550, 1500]), rel=1e-3)
    assert e["reaction_max_time"][:] % period == pytest.approx(0.5 * period, rel=0.05)
    columns = reaction_columns(f)
    lowest = columns["foundation_z"][columns["stage"] == "dynamics, lowest"]
    assert lowest.tolist() == e["reaction_lowest"][:, 2].tolist()
    summary = workshop.report().page
    assert re.search(r"Largest in motion: 1.49\d* kN at node 2", summary)
    extremes = r"\n\| 2 \| least z \(dynamics\) \| 0 kN to 0 kN \| 0 kN to 0 kN \| -1\.49\d* kN to 0 kN \|\n"
    assert re.search(extremes, summary)


def test_the_report_names_the_supports_with_the_extremes_of_all_states(workshop):
    """Two cables at 45 degrees carry 20 kN downwards in one case, and two others 30 kN upwards in another."""
    nodes = "id,x,y,z,fixed,load_z\n1,-5,0,5,1,0\n2,5,0,5,1,0\n3,-5,0,-5,1,0\n4,5,0,-5,1,0\n5,0,0,0,0,1e3\n"
    text = "[cable]\naxial_stiffness = 1e8\nmass_per_length = 1.0\n[load]\nself_weight = false\nsteps = 0\n"
    text += "[combinations]\ndown = {load = -20.0}\nup = {load = 30.0}\n"
    workshop.solve(text, nodes, "start,end\n1,5\n2,5\n3,5\n4,5\n").close()
    page = workshop.report().page.split("Supports with the extremes")[1]
    assert page.split("\n## ")[0].splitlines()[4:] == [
        "| 4 | least x (combination up) | -14.994 kN to 0 kN | 0 kN to 0 kN | 0 kN to 15 kN |",
        "| 3 | largest x (combination up), largest z (combination up) | 0 kN to 14.994 kN "
        "| 0 kN to 0 kN | 0 kN to 15 kN |",
        "| 1 | least z (combination down) | 0 kN to 9.9972 kN | 0 kN to 0 kN | -10 kN to 0 kN |",
    ]


BEAM = '[group.beam]\nkind = "bar"\nbending = true\nsecond_moment = 1e-8\n'


@pytest.mark.parametrize("beam", ["", BEAM], ids=["", "beside a beam"])
def test_the_reaction_of_a_single_cable_has_the_peak_between_two_rows(workshop, beam):
    """A weight falls by 0.5 m until its cable is taut: peak m g + sqrt((m g)^2 + 2 k m g h)."""
    nodes = "id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,-50,0\n2,0,0,-9.5,0,-1000,100\n"
    text = f"[cable]\nmodulus = 1e9\narea = 1e-3\ndensity = 1.0\n{beam}"
    text += "[load]\nself_weight = false\nsteps = 0\n"
    text += "[dynamics]\nduration = 1.0\nsafety = 0.1\n[output]\nhistory_interval = 0.25\n"
    elements = "start,end,unstressed_length,group\n1,2,10,\n"
    if beam:
        nodes += "3,5,0,0,1,0,0\n4,6,0,0,0,0,0\n5,7,0,0,1,0,0\n"
        elements += "3,4,1,beam\n4,5,1,beam\n"
    f = workshop.solve(text, nodes, elements)
    e, peak = f["envelope"], 1000.0 + np.sqrt(1e6 + 2e5 * 1000.0 * 0.5)
    assert e["reaction_max"][0] == pytest.approx(peak + 50.0, rel=2e-3)
    assert e["reaction_max"][0] == pytest.approx(e["tension_max"][0] + 50.0, rel=1e-12)
    assert e["reaction_lowest"][0] == pytest.approx([0.0, 0.0, -peak - 50.0], rel=2e-3)
    assert e["reaction_highest"][0].tolist() == [0.0, 0.0, -50.0]


STAGE = '[[stage]]\nname = "rope"\nactive = ["rope"]\n'


@pytest.mark.parametrize(
    "more", [STAGE, '[[remove]]\ngroup = "stay"\ntime = 0.0\n'], ids=["stage", "removal"]
)
def test_a_support_with_an_absent_cable_has_the_peak_of_the_present_one(workshop, more):
    """A support rises at 1 m/s from a hanging weight on: peak m g + v sqrt(k m), between two rows."""
    nodes = "id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,0,0\n2,0,0,-10,0,-1000,100\n3,5,0,0,1,0,0\n"
    text = f"[cable]\naxial_stiffness = 1e6\nmass_per_length = 1e-3\n[load]\nself_weight = false\n{more}"
    text += '[[motion]]\nnodes = [1]\ndisplacement = "move.csv"\n'
    text += "[dynamics]\nduration = 0.15\nsafety = 0.1\n[output]\nhistory_interval = 0.15\n"
    elements = "start,end,group,unstressed_length\n1,2,rope,10\n1,3,stay,5.1\n"
    job = workshop.job(text, nodes, elements)
    (job.parent / "move.csv").write_text("time,z\n0,0\n1,1\n")
    e, peak = workshop.run(job)["envelope"], 1000.0 + np.sqrt(1e6 / 10.01 * 100.0)
    assert e["reaction_max"][0] == pytest.approx(peak, rel=2e-3)
    assert e["reaction_max"][0] == pytest.approx(e["tension_max"][0], rel=1e-12)


def test_supports_of_a_beam_have_its_shear(workshop):
    """A beam carries P at midspan: each support has P / 2, in statics and in the last state of the motion."""
    rows = ((k, k, 0, 0, int(k == 0), 1, int(k in (0, 4)), -1000 * (k == 2)) for k in range(5))
    nodes = table("id,x,y,z,fixed_x,fixed_y,fixed_z,load_z", rows)
    text = '[cable]\nkind = "bar"\nmodulus = 2.1e11\narea = 1e-3\ndensity = 1.0\nbending = true\n'
    text += "second_moment = 1e-6\n[load]\nself_weight = false\nsteps = 1\n[dynamics]\nduration = 0.01\n"
    f = workshop.solve(text, nodes, "start,end\n0,1\n1,2\n2,3\n3,4\n")
    columns = reaction_columns(f)
    for stage in ("statics, load factor 1", "final, t = 0.01 s"):
        of_stage = columns["stage"] == stage
        force = dict(zip(columns["node"][of_stage], columns["force_z"][of_stage]))
        assert [force[0], force[4]] == pytest.approx([-500.0] * 2, rel=1e-5), stage


@pytest.mark.parametrize("spring, bar", [(0, ""), (3e5, ""), (0, "second_moment = 1e-8\n")])
def test_peak_reactions_at_supports_of_several_elements_count_every_step(workshop, spring, bar):
    """Weights that bounce and swing at one support: rows 0.5 s apart lose nothing of its peak."""
    nodes = (
        f"id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z,load_z,mass\n1,0,0,4,1,1,{int(not spring)},{spring},0,5\n"
    )
    nodes += (
        "2,-3,0,0,0,0,0,0,-1000,100\n3,1,0,1,0,0,0,0,-700,70\n4,3,0,4,1,1,1,0,0,0\n5,1.5,0,4,0,0,0,0,-50,5\n"
    )
    text = "[cable]\nmodulus = 1e11\narea = 1e-5\ndensity = 10.0\n[load]\nself_weight = false\nsteps = 0\n"
    text += f'[group.beam]\nkind = "bar"\nbending = true\n{bar}' if bar else ""
    text += "[dynamics]\nduration = 1.0\ntime_step = 5e-5\n[output]\nhistory_interval = "
    pairs = "start,end,group\n1,2,\n1,3,\n1,5,beam\n5,4,beam\n" if bar else "start,end\n1,2\n1,3\n1,5\n5,4\n"
    peaks = []
    for interval in (0.5, 5e-5):
        envelope = workshop.solve(f"{text}{interval}\n", nodes, pairs)["envelope"]
        peaks.append([envelope[name][0] for name in ("reaction_max", "reaction_max_time")])
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-9)


@pytest.mark.parametrize("lift", [0.0, 500.0])
def test_the_peak_reaction_of_a_broken_cable_is_that_from_before_the_fracture(workshop, lift):
    """Two cables at a slope of 4 in 3 break between rows: their weight falls; supports lose the wind."""
    nodes = "id,x,y,z,fixed,load_z,mass,area,normal_x,normal_y,normal_z\n1,-3,0,4,1,0,0,2,0,0,1\n"
    nodes += "2,3,0,4,1,0,0,2,0,0,1\n3,0,0,0,0,-1000,100,0,0,0,1\n"
    text = "[cable]\naxial_stiffness = 1e6\nmass_per_length = 1e-3\nbreaking_load = 1000.0\n"
    text += '[wind]\nonset = "sudden"\nspeed = 20.0\nsurface_drag = 0.0\nprofile_exponent = 0.0\n'
    text += f"pressure_coefficient = {-lift / 500.0}\n"  # 1/2 rho U^2 A is 500 N
    text += "[load]\nself_weight = false\nsteps = 0\n[dynamics]\nduration = 1.0\nfragments = false\n"
    f = workshop.solve(text + "[output]\nhistory_interval = 0.5\n", nodes, "start,end\n1,3\n2,3\n")
    e, peak = f["envelope"], f["envelope/tension_max"][:]
    assert f["events/element"][:].tolist() == [0, 1]
    cosine = 3.0 / (5.0 * (1.0 + peak / 1e6))
    reaction = np.hypot(cosine * peak, np.sqrt(1.0 - cosine**2) * peak - lift)
    assert e["reaction_max"][:2] == pytest.approx(reaction, rel=1e-9)
    assert e["reaction_lowest"][:2, 2] == pytest.approx(lift - 0.8 * peak, rel=0.01)


@pytest.mark.parametrize("duration", [0.0, 0.2])
def test_the_reaction_before_a_removal_has_the_peak_of_its_cable(workshop, duration):
    """A support moves down, and a removal between two rows ends the increase of a cable's tension."""
    nodes = "id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,0,0\n2,0,0,-10,0,-1000,100\n3,0,0,-20,1,0,0\n"
    text = "[cable]\naxial_stiffness = 1e6\nmass_per_length = 1e-3\n[load]\nself_weight = false\nsteps = 1\n"
    text += '[[motion]]\nnodes = [3]\ndisplacement = "move.csv"\n'
    text += f"[[remove]]\nelements = [0]\ntime = 0.0584\nduration = {duration}\n"
    text += "[dynamics]\nduration = 0.1\ntime_step = 1e-4\n[output]\nhistory_interval = 0.0045\n"
    job = workshop.job(text, nodes, "start,end,unstressed_length\n1,2,10\n2,3,9.99\n")
    (job.parent / "move.csv").write_text("time,z\n0,0\n1,-1\n")
    e = workshop.run(job)["envelope"]
    assert e["reaction_max"][0] == pytest.approx(e["tension_max"][0], rel=1e-12)
