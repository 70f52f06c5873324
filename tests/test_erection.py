"""Targets reached by lengths, stages of erection: by hand, in reverse, on ranks, paused, and wrong input."""

import re
from functools import partial

import numpy as np
import pytest
from conftest import ROOT, assert_same_results, lines_with, run_on_standing_ranks
from mpi4py import MPI
from nets import bare_saddle, stage
from processors import digest, stored_digests
from scipy.optimize import fsolve

from netfall.core.errors import DivergedError
from netfall.core.progress import Progress
from netfall.driver.erection import erect, permanent_state, tension
from netfall.driver.run import run_job
from netfall.driver.sample import run_sample
from netfall.geometry.build import build_net
from netfall.geometry.net import GRAVITY
from netfall.geometry.sections import set_strengths
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.post.checks.cables import Cutting, cutting_columns
from netfall.post.checks.cases import count_slack_cables, displacement_columns
from netfall.post.checks.nodes import reaction_columns, slip_point_columns, sum_end_forces
from netfall.post.checks.shop import Deduction, group_equal_cables, shop_cables
from netfall.post.page.states import select_drawn, shown_series
from netfall.post.plots.states import find_equilibrium, force_words
from netfall.post.plots.states import stages as stages_picture
from netfall.results.file import Frames, read_cases
from netfall.results.states import compute_envelope, start_position

EA, WEIGHT, SPAN = 1e6, 1000.0, 8.0  # N, N, m
# of forces and displacements, of an equilibrium ([load] tolerance); Newton's last step is far below
FOUND = 1e-6
CABLES = "[cable]\nmodulus = 1e9\narea = 1e-3\ndensity = 1000.0\n"
COLD_CASE = '[[case]]\nname = "all"\nset = {"load.temperature" = 0.0}\n'
NODES = f"id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,{SPAN},0,0,1,0\n3,4,0,-3,0,-{WEIGHT}\n"
ROOFED = NODES.replace("load_z", "load_z,area").replace("1,0\n", "1,0,0\n").replace("00.0\n", "00.0,7\n")
TWO = "id,start,end,group,unstressed_length\n1,1,3,left,5\n2,2,3,right,5\n"
STAYED = (  # a V of two cables, a stay below it, no load
    NODES.replace(f"-{WEIGHT}", "0") + "4,4,0,-8,1,0\n",
    "start,end,group,prestress\n1,3,left,1e4\n2,3,right,1e4\n3,4,stay,12e3\n",
)


def target(force: float) -> str:
    """Return the text of a force [N] for the stay, reached by the length of the right cable."""
    return f'[[target]]\ngroup = "stay"\nforce = {force}\nadjust = "right"\n'


def hanging(lengths=None, force=None, foot=SPAN, middle=None):
    """Return node (x, z) [m] and forces of two cables with a weight; the right one has a length or force."""

    def forces(at):
        x, z = at
        long = np.hypot(x, z), np.hypot(foot - x, z)
        left = EA * (long[0] / lengths[0] - 1)
        right = force if force is not None else EA * (long[1] / lengths[1] - 1)
        return (left, right), long

    def balance(at):
        (N, long), (x, z) = forces(at), at
        left, right = np.divide(N, long) / WEIGHT
        return right * (foot - x) - left * x, -(left + right) * z - 1

    at = fsolve(balance, middle or (4.5, -2.0 if force is None else -0.4), xtol=1e-13)
    return at, forces(at)[0]


PULL = [
    stage("hung", lengths="{left = {change = 1.0}}"),
    stage("pulled", lengths="{right = {force = 5000.0}}"),
    stage("moved", move="{2 = [0.05, 0.0, 0.0]}"),
    stage("back", move="{2 = [-0.05, 0.0, 0.0]}"),
    stage("loose", lengths="{right = {length = 5.0}}"),
]


def test_two_sagging_cables_are_pulled_taut(workshop):
    """Each stage agrees with a hand calculation. In reverse they return to their first position."""
    with workshop.solve(CABLES + "".join(PULL), NODES, TWO) as f:
        right = f["stages/pulled/unstressed_length"][1]
        hung, taut = hanging((6.0, 5.0)), hanging((6.0, None), force=5000.0)
        moved = hanging((6.0, right), foot=SPAN + 0.05)
        by_hand = {"hung": hung, "pulled": taut, "moved": moved, "back": taut, "loose": hung}
        for name, (at, forces) in by_hand.items():
            stage = f[f"stages/{name}"]
            assert stage["displacement"][2, [0, 2]] + [4, -3] == pytest.approx(at, abs=FOUND * 5), name
            assert stage["tension"][:] == pytest.approx(forces, rel=FOUND), name
        order = [f[f"stages/{name}"].attrs["order"] for name in by_hand]
        assert order == sorted(order) and f["stages/hung"].attrs["state"] == "equilibrium"
        pull = -f["stages/pulled/reaction"][:].sum(0)
        assert pull == pytest.approx([0, 0, WEIGHT], abs=FOUND * 5000)  # on both feet


SLACK = stage("slack", lengths="{right = {length = 9.6}}")
PULLED_TAUT = stage("pulled", lengths="{right = {force = 300.0}}")


@pytest.mark.parametrize("temperature", [0.0, 40.0])
def test_a_slack_cable_is_pulled_to_a_force(workshop, temperature):
    """The cable sags in an arc at first. A stay that is installed later begins to act.

    A heated cable expands more than 300 N stretch it.
    """
    first = f'active = ["left", "right"]\nset = {{"load.temperature" = {temperature}}}\nlengths'
    stages = SLACK.replace("lengths", first)
    with workshop.solve(CABLES + stages + PULLED_TAUT, NODES, TWO) as f:
        assert f["stages/slack/tension"][:] == pytest.approx([WEIGHT, 0.0], rel=FOUND)  # upright on one cable
        assert f["stages/pulled/tension"][1] == pytest.approx(300.0, rel=FOUND)
        left = hanging((5.0 * (1.0 + 1.2e-5 * temperature), None), 300.0, middle=(1.5, -4.7))[1][0]
        assert f["stages/pulled/tension"][0] == pytest.approx(left, rel=FOUND)


def test_the_weight_of_a_pulled_cable_is_that_of_its_remaining_length(workshop):
    """Half of both unstressed lengths, at 1 kg/m, acts at the node, and on the supports."""
    text = CABLES + "[load]\nself_weight = true\n" + SLACK + PULLED_TAUT
    with workshop.solve(text, NODES, TWO) as f:
        g, x = f["stages/pulled"], f["net/particles"][:]
        N, L0 = g["tension"][:], g["unstressed_length"][:]
        assert N[1] == pytest.approx(300.0, rel=FOUND) and L0[1] < 9.0
        pull = sum_end_forces(x + g["displacement"][:], f["net/elements"][:], N)[2]
        assert pull == pytest.approx([0, 0, WEIGHT + 0.5 * GRAVITY * L0.sum()], abs=FOUND * WEIGHT)
        assert g["reaction"][:, 2].sum() == pytest.approx(-WEIGHT - GRAVITY * L0.sum(), rel=FOUND)


def run_here(workshop, job):
    run_job(MPI.COMM_SELF, read_job(job), workshop.folder / "turns.vtkhdf", Progress(True))


def test_two_jacks_reach_forces_that_need_a_large_motion(workshop):
    """Two cables of a node with a weight are given forces, and the node moves by 1.7 m.

    Expected: the node where both forces, the elastic force of the third cable and the weight balance.
    """
    elements = "id,start,end,group,unstressed_length\n1,1,3,left,5.5\n2,2,3,right,5.5\n3,3,4,stay,5.2\n"
    jacks = stage("hung") + stage("pulled", lengths="{left = {force = 1000.0}, stay = {force = 6000.0}}")
    job = CABLES + "[load]\nself_weight = false\n" + jacks
    with workshop.solve(job, NODES + "4,4,0,-8,1,0\n", elements) as f:
        N = f["stages/pulled/tension"][:]
    supports = np.array([[0.0, 0.0], [SPAN, 0.0], [4.0, -8.0]])

    def forces(at):
        L = np.hypot(*(supports - at).T)
        return np.array([1000.0, EA * (L[1] / 5.5 - 1.0), 6000.0]), L

    def balance(at):
        force, L = forces(at)
        return ((force / L) @ (supports - at) - [0.0, WEIGHT]) / WEIGHT

    assert N == pytest.approx(forces(fsolve(balance, (5.0, -4.5), xtol=1e-13))[0], rel=10 * FOUND)


def test_a_jack_force_below_yield_leaves_no_plastic_strain(workshop):
    """Trials of the search exceed the yield force of 100 kN; the jack force is 99 kN."""
    nodes = f"{NODES}4,4,3,-6,1,0\n5,4,-3,-6,1,0\n"
    elements = "start,end,group,prestress\n1,3,left,1e3\n2,3,right,1e3\n3,4,stay,200\n3,5,stay,200\n"
    cables = "[cable]\nmodulus = 160e9\narea = 1e-4\ndensity = 1000.0\nyield_stress = 1e9\n"
    job = cables + "[load]\nself_weight = false\n" + stage("jack", lengths="{left = {force = 99e3}}")
    N = workshop.solve(job, nodes, elements)["stages/jack/tension"][:]
    assert N[0] == pytest.approx(99e3, rel=1e-6) and N[1:].max() == pytest.approx(95224.2, rel=1e-5)


def test_iterations_that_run_out_are_reported(workshop, monkeypatch, capsys):
    """Weights change with lengths. After one iteration a jack force is an error, a target a warning."""
    monkeypatch.setattr(erect, "MOST_TURNS", 1)
    monkeypatch.setattr(permanent_state, "MOST_TURNS", 1)
    text = CABLES + "[load]\nself_weight = true\n" + SLACK + PULLED_TAUT
    words = "pulled.*1 iterations were not enough: the loads still change"
    with pytest.raises(DivergedError, match=words):
        run_here(workshop, workshop.job(text, NODES, TWO))
    text = CABLES + target(2e4) + "[load]\nself_weight = true\n"
    text += '[form_finding]\nmethod = "given_geometry"\nloads = "permanent"\ntolerance = 1e-9\n'
    run_here(workshop, workshop.job(text, *STAYED))
    assert "warning: targets: the permanent load changes with the lengths:" in capsys.readouterr().out


def test_a_stage_has_the_areas_of_its_own_geometry(workshop):
    """Snow of 1 kN/m2 on 10 m x 10 m, then on 10 m x 8 m once two corners have moved; a case has no other."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,10,10,0,1\n4,0,10,0,1\n5,5,5,-1,0\n"
    elements = "start,end,unstressed_length\n1,5,7\n2,5,7\n3,5,7\n4,5,7\n1,2,11\n2,3,11\n3,4,11\n4,1,11\n"
    text = CABLES + "[load]\nself_weight = false\nsnow = 1000.0\n" + stage("wide")
    text += stage("moved", move="{2 = [-2.0, 0.0, 0.0], 3 = [-2.0, 0.0, 0.0]}")
    with workshop.solve(text + COLD_CASE, nodes, elements) as f:
        for name, snow in (("stages/wide", 1e5), ("stages/moved", 8e4), ("cases/all", 8e4)):
            group = f[name]
            assert group["reaction"][:, 2].sum() == pytest.approx(-snow, rel=FOUND), name
        x = f["net/particles"][:] + f["stages/moved/displacement"][:]
        pull = sum_end_forces(x, f["net/elements"][:], f["stages/moved/tension"][:])[4]
        assert pull == pytest.approx([0, 0, 8e4 / 3], abs=FOUND * 8e4)
        assert f["cases/all/displacement"][:] == pytest.approx(0.0, abs=FOUND)


def test_the_loads_of_a_stage_converge_in_a_soft_net(workshop):
    """A pressure lifts it by more than 1 m, and each iteration reduces the change of the loads to a sixth."""
    text = bare_saddle(6, 2e3, rise=4.0, section=(1.6e11, 3e-4, 8e3)) + "[form_finding]\n[load]\nsteps = 0\n"
    with workshop.solve(text + "tolerance = 1e-12\n" + stage("up", set='{"load.pressure" = -3000.0}')) as f:
        assert np.abs(f["stages/up/displacement"][:, 2]).max() > 1.0


def test_statics_start_from_the_last_stage(workshop):
    """Geometry, lengths and supports are those of the stage, and displacements count from it."""
    text = CABLES + "[load]\nself_weight = false\nsteps = 1\n" + PULL[0] + stage("held", hold="[3]")
    text += stage("free", release="[3]")
    with workshop.solve(text, NODES, TWO) as f:
        assert np.abs(f["statics/displacement"][-1]).max() < FOUND * 5  # under the weight, as in the stages
        assert f["statics/tension"][-1] == pytest.approx(f["stages/free/tension"][:], rel=FOUND)
        assert f["net/unstressed_length"][:].tolist() == [6.0, 5.0]
    sentence = "its displacement [m] and components from the last stage of erection"
    assert sentence in workshop.report().page


def test_removed_elements_are_not_slack_and_released_supports_do_not_settle(workshop):
    """A stay of the erection is not a slack cable in a case or the report. An export names it."""
    elements = TWO.rstrip() + "\n3,1,3,stay,5\n"
    text = stage("stayed") + stage("free", active='["left", "right"]')
    cases = '[[case]]\nname = "all"\nsettlement = {2 = [0.01, 0.0, 0.0]}\n'
    path = workshop.folder / "result.vtkhdf"
    with workshop.solve(CABLES + text + cases, NODES, elements) as f:
        assert f["stages/free/active"][:].tolist() == [1, 1, 0]
        slack = compute_envelope(f).slack[1:]  # without the load, two cables hang loose
        assert slack.tolist() == [[False] * 3, [True, True, False], [False] * 3]
        assert count_slack_cables(f, read_cases(f)) == [0]
    process = run_on_standing_ranks("export", path, "-o", workshop.folder / "net.json")
    assert "element 3 out of the net by then: no edges" in process.stdout
    text += stage("loose", hold="[3]", release="[2]")
    done = workshop.solve(CABLES + text + cases, NODES, elements, code=2)
    assert "settlement: node 2: not held after the last [[stage]]" in done.stderr


@pytest.mark.parametrize("cable, dynamics", [("", "mass_scaling = 0.2\n"), ("fracture_strain = 0.05\n", "")])
def test_a_removed_prop_limits_no_step_and_gets_no_mass(workshop, cable, dynamics):
    """Steps and added inertia are those of a rope that never had the prop, 100 times as stiff."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z\n"
    nodes += "".join(f"{k},{2 * k},0,0,{int(k in (0, 4))},1,{int(k in (0, 4))}\n" for k in range(5))
    pairs = "start,end,group\n" + "".join(f"{k},{k + 1},rope\n" for k in range(4))
    text = f"{CABLES}prestress = 1e4\n{cable}[dynamics]\nduration = 0.1\n{dynamics}"
    prop = '[group.prop]\nkind = "bar"\narea = 5e-2\nprestress = 0.0\n' + stage("struck", active=["rope"])
    outputs = []
    for more, node, pair in (("", "", ""), (prop, "9,4,0,-1,1,1,1\n", "2,9,prop\n")):
        lines = workshop.check(workshop.job(text + more, nodes + node, pairs + pair)).splitlines()
        known = ("stable step", "steps:", "mass scaling:")
        lines = [line for line in lines if line.startswith(known)]
        outputs.append([re.sub(r"of \d+ particles|, set by.*", "", line) for line in lines])
    assert outputs[0] == outputs[1] and len(outputs[0]) == 3


def test_the_removal_of_an_absent_element_is_a_note(workshop):
    """A stage has removed the prop. There is no note on an element that is present."""
    nodes = "id,x,y,z,fixed\n1,-4,0,0,1\n2,0,0,0,0\n3,4,0,0,1\n4,0,0,-3,1\n"
    text = CABLES + 'prestress = 1e4\n[group.prop]\nkind = "bar"\nprestress = 0.0\n'
    text += stage("struck", active=["rope"]) + "[dynamics]\nduration = 0.1\n"
    text += "[[remove]]\nelements = [7, 8]\ntime = 0.05\n[[remove]]\nelements = [9]\ntime = 0.06\n"
    job = workshop.job(text, nodes, "id,start,end,group\n7,1,2,rope\n8,2,4,prop\n9,2,3,rope\n")
    notes = lines_with("[[remove]]", "check", job)
    assert notes == ["note: [[remove]] 1: no effect on element 8, which a stage of erection removed. [N333]"]


def test_a_removed_prop_holds_nothing_and_is_not_used(workshop):
    """Fractures and utilisation are those of a net without it. A part on the prop has no equilibrium."""
    nodes = "id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,0,0\n2,0,0,-3,0,0,0\n3,0,0,-6,1,0,0\n"
    elements = "start,end,group,unstressed_length\n1,2,rope,3\n2,3,prop,3\n"
    text = CABLES + "fracture_strain = 0.01\n" + stage("struck", active=["rope"])
    prop = '[group.prop]\nkind = "bar"\n'
    move = '[[motion]]\ndisplacement = "up.csv"\n[dynamics]\nduration = 0.1\n'
    (workshop.folder / "up.csv").write_text("time,z\n0,0\n0.001,0.08\n")
    with workshop.solve(text + prop + move, nodes, elements) as f:
        one = f["events/new_particle"][:], f["final/position"][:2]
    job = workshop.job(text + move, nodes.partition("3,0,0,-6")[0], elements.partition("2,3,prop")[0])
    with workshop.run(job, output="other.vtkhdf") as f:
        assert one[0].tolist() == [3, -1] and f["events/new_particle"][:].tolist() == [2, -1]
        assert (one[1] == f["final/position"][:2]).all()
    nodes = nodes.replace("2,0,0,-3,0,0,0", f"2,0,0,-3,0,-{WEIGHT},100")
    lost = "[dynamics]\nduration = 0.1\n[[remove]]\nelements = [0]\ntime = 0.05\n"
    output = workshop.printed(workshop.job(text + prop + lost, nodes, elements))
    assert "warning: the net without element 0: no equilibrium: a part is connected to no support" in output
    job = workshop.job(text + prop + COLD_CASE, nodes, elements)
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache(1))
    assert outcomes["utilisation_before_break"] == pytest.approx(WEIGHT / EA / 0.01, rel=FOUND)


def test_the_loads_of_nodes_of_a_removed_prop_disappear(workshop):
    """1 kN is on the rope, 5 kN on a node of the prop: reactions of the stage and of a later case."""
    nodes = f"id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,0,0,-3,0,-{WEIGHT}\n3,0,0,-4,0,-5000\n4,0,0,-6,1,0\n"
    elements = "start,end,group,unstressed_length\n1,2,rope,3\n2,3,prop,1\n3,4,prop,2\n"
    text = CABLES + '[load]\nself_weight = false\n[group.prop]\nkind = "bar"\n'
    text += stage("struck", active=["rope"]) + COLD_CASE
    with workshop.solve(text, nodes, elements) as f:
        for state in ("stages/struck", "cases/all"):
            assert np.allclose(f[state]["reaction"][:, 2], [-WEIGHT, 0.0, 0.0, 0.0], atol=FOUND * WEIGHT)
        assert f["cases/all/load"][:, 2].tolist() == [0.0, -WEIGHT, 0.0, 0.0]


def test_a_start_under_the_loads_of_the_last_stage_is_in_equilibrium(workshop):
    """No warning of a rope 1 cm too short; at another temperature a slack rope leaves a residual."""
    text = CABLES + "[load]\nself_weight = false\ntemperature = WARM\n[dynamics]\nduration = 0.1\n"
    text += stage("cold", set='{"load.temperature" = 0.0}')
    warnings = []
    for warm in ("0.0", "1e3"):
        job = workshop.job(text.replace("WARM", warm), NODES, TWO.replace("left,5", "left,4.99"))
        warnings.append([line for line in workshop.check(job).splitlines() if "not in equilibrium" in line])
    start = "warning: start: not in equilibrium: largest residual "
    assert warnings[0] == [] and len(warnings[1]) == 1
    assert warnings[1][0].startswith(f"{start}{WEIGHT / 1e3:.3g} kN, largest tension 0 kN. ")
    # the same of a net with a form
    form = "[form_finding]\nmodulus_factor = 0\n" + text.replace("WARM", "0.0")
    form += stage("more", set='{"load.dead" = 10.0}', lengths="{right = {change = -0.01}}")
    job = workshop.job(form, ROOFED, TWO.replace("unstressed_length", "prestress").replace(",5\n", ",1e3\n"))
    assert f"{start}0.07 kN" in workshop.check(job)
    # another temperature without a stage: EA alpha T in two ropes, which no load balances
    cold = CABLES + "[load]\nself_weight = false\ntemperature = -100\n[dynamics]\nduration = 0.1\n"
    assert f"{start}1.442 kN, largest tension 1.201 kN. " in workshop.check(workshop.job(cold, NODES, TWO))
    # errors of length only disturb the equilibrium
    drawn = CABLES + "length_std = 1e-3\n[load]\nself_weight = false\nsteps = 1\n"
    lines = workshop.check(workshop.job(drawn, NODES, TWO.replace("left,5", "left,4.9")))
    assert "warning: net as given: not in equilibrium" in lines
    assert re.match(r"\d+ warnings? \(.*W632", lines.splitlines()[-1])


@pytest.mark.parametrize(
    ("last", "load", "keys"),
    [
        ({"set": '{"load.dead" = 5.0, "load.snow" = 0.0}', "load_table": '"none"'}, "", "load.dead"),
        ({"load_table": '"t.csv"', "set": '{"load.temperature" = 9.0}'}, "", "load.temperature, load_table"),
        ({"set": '{"load.dead" = 5.0}', "load_table": '"none"'}, "dead = 5.0\n", ""),
    ],
)
def test_loads_that_end_with_the_last_stage_are_a_warning(workshop, last, load, keys):
    """Loads that differ from [load] count. A load that an earlier stage removes, or a table, does not."""
    (workshop.folder / "t.csv").write_text("node,load_z\n3,-100.0\n")
    first = stage("rope", set='{"load.dead" = 0.0}', load_table='"t.csv"') + stage("roof", **last)
    job = workshop.job(f"{CABLES}[load]\n{load}{first}", ROOFED, TWO)
    warnings = lines_with("[W663]", "check", job)
    assert [line.split(": ")[2] for line in warnings] == [keys] * bool(keys)


def test_an_element_of_one_stage_has_the_forces_of_that_stage(workshop):
    """Not zero in stages without it. A stay that is removed is in the shop list, with plates at its ends."""
    elements = TWO.rstrip() + "\n3,1,3,stay,4.9\n4,2,3,tie,4.9\n"
    text = stage("first", active=["left", "right", "stay"]) + stage("second", active=["left", "right", "tie"])
    text += stage("moved", move="{2 = [-3.0, 0.0, 0.0]}")
    with workshop.solve(CABLES + text, NODES, elements) as f:
        envelope, rows = compute_envelope(f), cutting_columns(f, Cutting())
        N = [f[f"stages/{name}/tension"][:] for name in ("first", "second", "moved")]
        assert envelope.least[2] == envelope.most[2] == N[0][2] > 100.0
        assert envelope.least[3] == min(N[1][3], N[2][3]) and envelope.of_least[2] == 0
        assert np.isnan(rows["length_in_form"]).tolist() == [False, False, True, False]
        assert rows["mass"] == pytest.approx(rows["unstressed_length"])  # 1 kg/m
        pieces = shop_cables(f, Cutting(), [Deduction("", "", 0.0, 0.2)])
        (stay,) = (piece for piece in pieces if piece.cable == 2)
        assert stay.cut == pytest.approx(4.5) and stay.mass == pytest.approx(4.5)
        moved = displacement_columns(f, [])  # of each stage from the net as given
        for name in ("first", "second", "moved"):
            of_stage = np.column_stack([moved[f"stage {name} {axis}"] for axis in "xyz"])
            assert of_stage == pytest.approx(f[f"stages/{name}/displacement"][:], abs=1e-12)
        assert np.abs(of_stage[1] - [-3.0, 0.0, 0.0]).max() < 1e-12  # by `move`


def test_an_element_in_no_stage_has_no_force_in_the_report(workshop):
    """It is in the form alone. Tables have empty cells, and no check passes it."""
    elements = TWO.rstrip() + "\n3,1,3,stay,4.9\n4,2,3,left_out,4.9\n"
    text = CABLES + "breaking_load = 1e6\n" + stage("only", active=["left", "right", "stay"])
    text += "[dynamics]\nduration = 0.001\n"
    N = workshop.solve(text, NODES, elements)["stages/only/tension"][:]
    for name in ("elements", "cables"):
        rows = {row["group"]: row for row in workshop.report().rows(name)}
        assert float(rows["stay"]["tension_max"]) == pytest.approx(N[2]) and rows["stay"]["case_max"]
        starts = "tension", "case", "utilisation", "result", "slack"
        absent = {key: cell for key, cell in rows["left_out"].items() if key.startswith(starts)}
        assert len(absent) >= 7 and set(absent.values()) == {""}, absent


def test_cables_of_one_unstressed_length_have_one_mark_whatever_their_force_in_the_last_stage(workshop):
    """Two of 5 m, one support raised by 2 m: their forces, and lengths under these, are not equal."""
    elements = TWO.replace("left", "rope").replace("right", "rope")
    text = CABLES + stage("raised", move="{2 = [0.0, 0.0, 2.0]}")
    with workshop.solve(text, NODES, elements) as f:
        pieces = shop_cables(f, Cutting(), [Deduction("", "", 0.0, 0.2)])
        (equal,) = group_equal_cables(pieces)
        assert abs(equal[0].cut - equal[1].cut) > 1e-3
    with workshop.solve(text, NODES, elements.replace("2,2,3,rope,5", "2,2,3,rope,5.002")) as f:
        assert len(group_equal_cables(shop_cables(f, Cutting(), []))) == 2


TIED = (  # the V under a weight, tied to a second weight that is held above
    NODES + f"4,4,0,5,1,-{WEIGHT}\n",
    TWO.replace(",unstressed_length", ",prestress").replace(",5\n", ",1e3\n") + "3,3,4,tie,1e3\n",
)


def test_the_motion_in_form_finding_excludes_that_of_stages(workshop):
    """The last stage releases a node, which falls by metres. Form finding moved the other, to 30 degrees."""
    text = CABLES + "[form_finding]\nmodulus_factor = 0\n" + stage("free", release="[4]")
    output = workshop.printed(workshop.job(text, *TIED))
    (line,) = (line for line in output.splitlines() if line.startswith("form: "))
    match = re.match(r"form: nodes moved by up to ([\d.]+) mm \(node 3\), ([\d.]+) mm on average", line)
    assert match[1] == match[2] == f"{1e3 * (3 + 4 / 3**0.5):.4g}"
    assert line in workshop.info().splitlines()


def test_the_form_has_the_supports_loads_and_elements_before_the_stages(workshop):
    """A stage releases a support and removes a tie. Weights of all elements act in the form."""
    text = CABLES + '[form_finding]\nloads = "permanent"\n[load]\nself_weight = true\n'
    text += stage("free", hold="[3]", release="[4]", active=["left", "right"])
    with workshop.solve(text, *TIED) as f:
        of, form = reaction_columns(f), f["form_finding"]
        rows, weight = of["stage"] == "form", GRAVITY * form["unstressed_length"][:]  # 1 kg/m
        assert of["node"][rows].tolist() == [1, 2, 4]
        pull, all_of_it = of["force_z"][rows], of["foundation_z"][rows]
        assert pull - all_of_it == pytest.approx(weight / 2)
        assert all_of_it.sum() == pytest.approx(-weight.sum(), abs=1e-6 * 1e3)  # the form's tolerance
        first = next(state for state in shown_series(f, select_drawn(f))[0] if state.name == "form")
        assert not first.away.any() and (first.tension[0] == form["tension"][:]).all()
        assert force_words(f, find_equilibrium(f, "form")) == "form: 490.4 to 828.5 N"
        rows = of["stage"] == "stage free"
        assert of["node"][rows].tolist() == [1, 2, 3]


def test_elements_of_some_stages_are_shown_only_there(workshop):
    """A weight is held while a stay exists: a reaction, a square. Later the stay is not slack or broken."""
    nodes, elements = NODES.replace("load_z", "load_z,mass").replace("1,0\n", "1,0,0\n"), TWO
    nodes = nodes.replace(f"0,-{WEIGHT}", f"0,-{WEIGHT},100")
    text = stage("stayed", hold="[3]") + stage("free", release="[3]", active='["left", "right"]')
    text += "[dynamics]\nduration = 0.1\n"
    with workshop.solve(CABLES + text, nodes, elements.rstrip() + "\n3,1,3,stay,5\n") as f:
        of = reaction_columns(f)
        rows = [k for k, name in enumerate(of["stage"]) if name == "stage stayed"]
        assert of["node"][rows].tolist() == [1, 2, 3]
        assert of["foundation_z"][rows] == pytest.approx([0, 0, -WEIGHT])
        assert [3 not in of["node"][of["stage"] == name] for name in of["stage"]].count(False) == 3
        frames = Frames(f)
        assert f["VTKHDF/CellData/broken"][:3].tolist() == [0, 0, 2] and not frames.broken(0).any()
        assert frames.present(0).tolist() == [True, True, False]
        envelope = compute_envelope(f)
        assert not envelope.slack[-1].any()
        assert [state.slack.sum() for state in shown_series(f, select_drawn(f))[0]] == [0, 3, 0]
        figure = stages_picture(f)
        assert [len(axes.lines[0].get_xdata()) for axes in figure.axes[:2]] == [3, 2]  # squares


SHIPPED = ROOT / "jobs" / "wheel_erection.toml"
DIRECT = SHIPPED.read_text().partition("[[stage]]")[0]


@pytest.fixture(scope="module")
def wheel(shared_workshop):
    """Return the output and the result of the shipped wheel, lifted."""
    path = shared_workshop.folder / "wheel.vtkhdf"
    done = run_on_standing_ranks("run", SHIPPED, "-o", path, cwd=shared_workshop.folder)
    with shared_workshop.open(path.name) as f:
        yield done.stdout, f


def test_the_lifted_shipped_wheel_has_the_form_found_directly(wheel, workshop):
    """Ring forces grow from stage to stage. The last has the forces of the wheel under its weight."""
    text, f = wheel
    assert digest(f.filename) == stored_digests()["wheel_erection"]  # others: test_processors.py
    with workshop.solve(DIRECT + '[[case]]\nname = "weight"\nset = {"load.snow" = 0.0}\n') as direct:
        expected, sunk = direct["cases/weight/tension"][:], direct["cases/weight/displacement"][:]
    names = f["net/group_names"].asstr()[:].tolist()
    stages = [f[f"stages/lift {k}"] for k in range(1, 9)]
    N, x = stages[-1]["tension"][:], stages[-1]["displacement"][:]
    assert np.abs(N - expected).max() < FOUND * np.abs(expected).max()
    assert np.abs(x - sunk).max() < FOUND
    for name, sign in (("ring_outer", -1), ("ring_lower", 1), ("ring_upper", 1)):
        in_group = f["net/group"][:] == names.index(name)
        forces = np.array([sign * each["tension"][:][in_group].mean() for each in stages])
        assert (np.diff(forces) >= 0).all() and forces[-1] > 2 * forces[3]
    assert not stages[0]["stable"][()] and stages[-1]["stable"][()]  # struts without bending tip over
    assert "stage lift 1: estimated error" in text and "warning: stage lift 1: unstable equilibrium" in text


def test_lowering_the_wheel_reverses_its_lifting(wheel, workshop):
    """From the form to hanging in its lower radials: 1e-6 of the largest force, 1e-6 m."""
    text = DIRECT.replace("[load]", "[load]\nsteps = 0\ntolerance = 1e-7")  # a hanging net has no limit load
    down = {4: 0.2, 1: 0.15}  # to lift 4 and from there to lift 1: m, of each radial
    for k, back in down.items():
        text += stage(f"down {k}", lengths=f"{{upper = {{change = {back}}}, lower = {{change = {back}}}}}")
    with workshop.solve(text) as lowered:
        for k in down:
            up, back = wheel[1][f"stages/lift {k}"], lowered[f"stages/down {k}"]
            N, x = up["tension"][:], up["displacement"][:]
            assert np.abs(back["tension"][:] - N).max() < FOUND * np.abs(N).max(), k
            assert np.abs(back["displacement"][:] - x).max() < FOUND, k
            for each in (up, back):
                assert max(each["tension_error"][()], each["displacement_error"][()]) <= FOUND, k


@pytest.mark.parametrize("name", ["dome_rings", "two_cables"])
def test_targets_and_stages_have_the_same_bits_on_ranks(workshop, name):
    """Every dataset of shipped jobs; the dome without snow and with targets of two hoops, for time."""
    job = ROOT / "jobs" / f"{name}.toml"
    if name == "dome_rings":
        head, hoop, _, _, crown = job.read_text().split("\n[[target]]")
        job = workshop.job("\n[[target]]".join([head, hoop, crown.partition("[[case]]")[0]]))
    one, two = (workshop.run(job, ranks=ranks, output=f"{ranks}.vtkhdf") for ranks in (1, 2))
    assert assert_same_results(one, two) > 20


def drawn_in():
    """Return two strands of 1 m through a clamp, in stages. A weight hangs at it, so that it moves."""
    nodes = "id,x,y,z,fixed,load_z\n0,0,0,0,1,0\n1,1,0,0,1,0\n2,2,0,0,1,0\n3,1,0,-2,0,-100\n"
    elements = "start,end,group,cable,unstressed_length\n0,1,rope,c,1\n1,2,rope,c,1\n1,3,line,l,2\n"
    stages = [
        stage("moved", move=f"{{2 = [{MOVED}, 0.0, 0.0]}}"),
        stage("opened", clamps='"open"'),
        stage("back", clamps='"closed"', move=f"{{2 = [{-MOVED}, 0.0, 0.0]}}"),
        stage("pulled", clamps='"open"', lengths=f"{{c = {{force = {PULLED}}}}}"),
        stage("shut", clamps='"closed"'),
    ]
    text = "[cable]\nmodulus = 1e11\narea = 1e-3\ndensity = 1.0\n"
    text += '[load]\nself_weight = false\nsteps = 1\n[[slide]]\ngroup = "rope"\nslip_resistance = 3e5\n'
    return text + "".join(stages), nodes, elements


MOVED, PULLED, STIFF = 1e-3, 5e4, 1e8  # m, N, N


def test_clamps_are_open_and_closed_in_stages(workshop):
    """Forces of closed clamps, lengths that pass open ones, and a jack agree with hand calculations."""
    job = workshop.job(*drawn_in())
    f = workshop.run(job)
    passed = -MOVED / (2.0 + MOVED)  # 1 - s over 1 + s is 1 + d
    less = 1.0 / (1.0 + PULLED / STIFF)
    held = STIFF * (1.0 / (1.0 + passed) - 1.0)
    by_hand = {  # tensions of both strands, unstressed length of the first one, what has passed
        "moved": (0.0, STIFF * MOVED, 1.0, 0.0),
        "opened": (held, held, 1.0 + passed, -passed),
        "back": (held, 0.0, 1.0 + passed, -passed),
        "pulled": (PULLED, PULLED, less, -passed * (1.0 - less)),
        "shut": (PULLED, PULLED, less, -passed * (1.0 - less)),
    }
    for name, (first, second, length, slip) in by_hand.items():
        of = f[f"stages/{name}"]
        assert of["tension"][:2] == pytest.approx([first, second], rel=1e-6, abs=0.01), name
        assert of["unstressed_length"][0] == pytest.approx(length, rel=1e-9), name
        assert of["slip"][:] == pytest.approx([slip], abs=1e-10), name
    assert [f[f"stages/{name}"].attrs["clamps"] for name in ("moved", "opened")] == ["closed", "open"]
    held = slip_point_columns(f)
    assert held["holds"][held["stage"] == "stage moved"] == pytest.approx([3e5])
    assert not held["holds"][held["stage"] == "stage opened"].any()
    assert f["statics/tension"][-1, :2] == pytest.approx(PULLED, rel=1e-6)
    assert f["statics/slip"][-1] == pytest.approx([0.0], abs=1e-10)  # it counts from the last stage
    assert_same_results(f, workshop.run(job, ranks=2, output="two.vtkhdf"))


def test_a_stop_counts_the_slips_of_all_stages(workshop):
    """7.5 m and 2 m of 20 m move over a pulley. A stop at 2 m of 10 m leaves 18 m over 19.5 m."""
    nodes = "id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,10,0,0,1,0\n3,20,0,0,1,0\n4,10,0,-2,0,-100\n"
    elements = "start,end,group,cable,unstressed_length\n1,2,rope,c,10\n2,3,rope,c,10\n2,4,line,l,2\n"
    text = "[cable]\nmodulus = 1e9\narea = 1e-3\ndensity = 7850.0\n[load]\nself_weight = false\nsteps = 1\n"
    text += '[[slide]]\ngroup = "rope"\n[dynamics]\nduration = 0.1\n[output]\nframes = 1\n'
    for name, distance in ("first", 7.5), ("second", 2.0):
        text += stage(name, move=f"{{1 = [{distance}, 0, 0], 3 = [{distance}, 0, 0]}}")
    job = workshop.job(text, nodes, elements)
    f = workshop.run(job, output="whole.vtkhdf")
    expected = 1e6 * (19.5 / 18.0 - 1.0)
    for group in "stages/second", "statics":
        N = f[group]["tension"][...].reshape(-1, 3)[-1]
        assert N == pytest.approx([0, expected, 100], rel=3e-3, abs=1e-3)
    assert f["slide/slip"][-1] == pytest.approx(f["slide/slip"][0], abs=1e-3)
    workshop.assert_pause_changes_no_bit(job, 2, "in form finding or erection", f)


TWO_CABLES = CABLES + "[load]\nself_weight = false\nsteps = 1\n" + "".join(PULL), NODES, TWO


FORM = CABLES + "[form_finding]\n[load]\nself_weight = true\nsteps = 1\n" + stage("a")
WITH_FORM = FORM + stage("b", move="{2 = [0.1, 0, 0]}"), *STAYED  # its pause is not in its form
PAUSES = *((TWO_CABLES, looks) for looks in (1, 12, 25)), (drawn_in(), 6), (WITH_FORM, 4)


@pytest.mark.parametrize("net, looks", PAUSES)
def test_a_paused_erection_resumes_at_its_stage(workshop, net, looks):
    """The result has the bits of an erection without pause; statics follow."""
    job = workshop.job(*net)
    whole = workshop.run(job, output="whole.vtkhdf")
    checkpoint, message = workshop.pause(job, looks)
    assert "in form finding or erection, which the resumed run repeats" in message
    assert assert_same_results(whole, workshop.run_here(job, restart=checkpoint)) > 20


@pytest.mark.parametrize(
    "cable, load, keys, words, factor, elements",
    [
        ("", "", {"lengths": "{right = {force = -10.0}}"}, "not reached in", np.nan, []),
        ("yield_stress = 0.7e6\n", "", {}, "yield in 2 elements (1, 2), but", np.nan, [1, 2]),
        ("breaking_load = 700.0\n", "stop_at_strength = true\n", {}, "breaks", 700 / 833.8, [1, 2]),
    ],
)
def test_a_stage_without_equilibrium_leaves_a_file(workshop, cable, load, keys, words, factor, elements):
    """The file has the earlier stages, the reason and the elements. Exit code 3; no later stage runs."""
    text = CABLES + cable + f"[load]\nself_weight = false\nsteps = 1\n{load}" + stage("good", hold="[3]")
    text += stage("bad", release="[3]", **keys) + stage("never")
    done = workshop.solve(text, NODES, TWO, ranks=2, code=3)
    assert "stage bad: no equilibrium: " in done.stderr
    assert re.match(r"\d+ warning", done.stdout.splitlines()[-1])
    with workshop.open() as f:
        assert f["provenance"].attrs["exit_state"] == "no_equilibrium"
        assert list(f["stages"]) == ["bad", "good"] and "statics" not in f
        good, bad = f["stages/good"], f["stages/bad"]
        assert good.attrs["state"] == "equilibrium"
        assert good["reaction"][:].sum(0) == pytest.approx([0, 0, -WEIGHT]) and not good["tension"][:].any()
        assert bad.attrs["state"] == "no_equilibrium" and words in bad.attrs["reason"]
        assert set(bad.attrs["elements"]) <= set(elements) and np.isnan(bad["reaction"][:]).all()
        assert bad.attrs["load_factor"] == pytest.approx(factor, rel=0.01, nan_ok=True)
        assert not f["VTKHDF/PointData/displacement"][:].any()  # from the last stage
    assert "NO EQUILIBRIUM" in workshop.info()
    run_on_standing_ranks("plot", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "plot")
    assert "**stage bad has no equilibrium: " in workshop.report(pictures=True).page


def test_three_hoops_get_their_forces_by_three_diagonals(shared_workshop):
    """In at most 15 equilibria. The influence of lengths is that of differences."""
    h, pairs = 1e-4, ("diagonal2", "diagonal3", "diagonal4")  # m: errors of h^2 of the second derivative
    text = (ROOT / "jobs" / "dome_rings.toml").read_text()
    text = text[: text.index("[[case]]")]
    for name in pairs:
        text += stage(f"{name} +", lengths=f"{{{name} = {{change = {h}}}}}")
        text += stage(f"{name} -", lengths=f"{{{name} = {{change = {-2 * h}}}}}")
        text += stage(f"{name} 0", lengths=f"{{{name} = {{change = {h}}}}}")
    text = text.replace("self_weight = true", "self_weight = true\ntolerance = 1e-10")
    output = shared_workshop.printed(shared_workshop.job(text, name="targets"), output="targets.vtkhdf")
    line = next(line for line in output.splitlines() if line.startswith("targets: reached in"))
    assert int(line.split()[3]) <= 15
    with shared_workshop.open("targets.vtkhdf") as f:
        names = f["net/group_names"].asstr()[:].tolist()
        of = lambda N, name: N[f["net/group"][:] == names.index(name)].mean()
        N = f["form_finding/tension"][:]
        for name, force in (("hoop1", 7e5), ("hoop2", 1.6e6), ("hoop3", 3.2e6)):
            assert of(N, name) == pytest.approx(force, rel=FOUND)
        # under the load of the lengths they need
        assert f["form_finding/residual_real_material"][()] <= FOUND
        influence = f["form_finding/target_influence"][:]
        for k, name in enumerate(pairs):
            plus, minus = (f[f"stages/{name} {sign}/tension"][:] for sign in "+-")
            differences = [of(plus - minus, hoop) / (2 * h) for hoop in ("hoop1", "hoop2", "hoop3")]
            assert influence[:3, k] == pytest.approx(differences, abs=1e-4 * np.abs(influence[:3, :3]).max())


def test_a_node_reaches_its_target_height(workshop):
    """The length of one of two cables changes."""
    text = CABLES + '[[target]]\nnode = 3\nheight = -2.5\nadjust = "right"\n'
    elements = TWO.replace("unstressed_length", "prestress").replace(",5\n", ",0\n")
    nodes = NODES.replace(f"4,0,-3,0,-{WEIGHT}", "4,0,-3,0,0")
    loads = '[form_finding]\nmethod = "given_geometry"\nloads = "permanent"\n[load]\nself_weight = true\n'
    with workshop.solve(text + loads, nodes, elements) as f:
        assert f["form_finding/position"][2, 2] == pytest.approx(-2.5, abs=FOUND * SPAN)


CROSS = "id,x,y,z,fixed\n1,-10,0,2,1\n2,10,0,2,1\n3,0,-10,0,1\n4,0,10,0,1\n5,0,0,1,0\n"
ERRORS = np.array([0.004, 0.0, -0.003, 0.0])  # m
RECOVERED = 2e-6  # m: FOUND of the forces, over EA / L of four cables that stretch together


def four(column, values):
    """Return elements of the cross, each one a cable."""
    rows = (f"{k + 1},5,c,c{k + 1},{value:.12g}\n" for k, value in enumerate(values))
    return f"start,end,group,cable,{column}\n" + "".join(rows)


def test_length_errors_and_forces_of_a_roof_agree(workshop):
    """Measured lengths give the forces, and these forces give the errors, as in the how-to."""
    text = CABLES.replace("1e9", "80e9") + "[load]\nself_weight = true\nsteps = 1\n"
    with workshop.solve(text, CROSS, four("prestress", [1e5] * 4), output="plan.vtkhdf") as f:
        planned = f["net/unstressed_length"][:]
    job = workshop.job(text, CROSS, four("unstressed_length", planned + ERRORS))
    with workshop.run(job, output="lengths.vtkhdf") as f:
        N, moved = f["statics/tension"][0], f["statics/displacement"][0]
    pulls = ", ".join(f"c{k + 1} = {{force = {force:.12g}}}" for k, force in enumerate(N))
    text += stage("planned") + stage("measured", lengths=f"{{{pulls}}}")
    with workshop.solve(text, CROSS, four("prestress", [1e5] * 4), output="forces.vtkhdf") as f:
        before, after = (f[f"stages/{name}/unstressed_length"][:] for name in ("planned", "measured"))
        assert after - before == pytest.approx(ERRORS, abs=RECOVERED)
        assert f["stages/measured/displacement"][:] == pytest.approx(moved, abs=RECOVERED)


def test_a_given_geometry_with_targets_has_a_form(workshop):
    """The form is in equilibrium as the file states, and displacements count from it."""
    text = CABLES + target(2e4) + "[load]\nself_weight = false\nsteps = 1\n"
    with workshop.solve(text, *STAYED) as f:
        x, N = start_position(f), f["form_finding/tension"][:]
        assert N[2] == pytest.approx(2e4, rel=FOUND)
        assert np.abs(sum_end_forces(x, f["net/elements"][:], N)[2]).max() < FOUND * 2e4
        assert np.abs(x[2] - [4, 0, -3]).max() > 0.05
        form = x + f["statics/displacement"][-1]
        assert np.abs(form - f["VTKHDF/Points"][-len(x) :]).max() < 1e-6  # single precision


def test_targets_that_are_not_reached_leave_a_file(workshop):
    """The file has the nearest form and the reason. Exit code 3; no later stage runs."""
    text = CABLES + target(-10.0) + "[load]\nself_weight = false\nsteps = 1\n"
    assert "not reached in" in workshop.solve(text + stage("s"), *STAYED, ranks=2, code=3).stderr
    with workshop.open() as f:
        assert "statics" not in f and "stages" not in f
        assert f["provenance"].attrs["exit_state"] == "diverged"  # as in a study: there is an equilibrium
        came = f["form_finding"].attrs["reason"].split("force of stay = -0.01 kN: ")[1].split(" kN")[0]
        assert abs(float(came)) < 1e-6  # a cable that is slack to rounding
        pull = sum_end_forces(start_position(f), f["net/elements"][:], f["form_finding/tension"][:])
        assert np.abs(pull[2]).max() < FOUND * 1e4
    assert "form finding did not reach its targets: the targets" in workshop.info()


LESS = '[[combination]]\nname = "c"\nfactors = {prestress = 0.9}\n'


@pytest.mark.parametrize(
    "text, words",
    [
        ('[[target]]\ngroup = "left"\nforce = 1e3\nadjust = "rigth"\n', '"rigth": neither a group'),
        ('[[target]]\ngroup = "left"\nheight = 1e3\nadjust = "right"\n', "expected group and force, or node"),
        (stage("s", move="{3 = [0.0, 0.0, 1.0]}"), "move: node 3: an axis that moves must be held"),
        (
            stage("s", move="{1 = [0, 0, -0.1], all = [0, 0, 0.2]}"),
            "move: node 1: two entries give different",
        ),
        (stage("s", release="[1, 2]"), "the part of the net with these nodes has no support"),
        (stage("s", hold="[9]"), "hold: no node 9"),
        (stage("s", release="[2, 3]"), "[[stage]] s: release: node 3: not held"),
        (stage("s", release="[1]", hold='["left"]'), "release: node 1: not held, or kept by hold"),
        (stage("s", active='["lift"]'), 'active: no group "lift"; did you mean "left"?'),
        (stage("s", lengths="{left = {change = -9.0}}"), "element 1: no unstressed length remains"),
        (stage("s", lengths="{left = {pull = 9.0}}"), "one of change"),
        (stage("s", lengths="{right = {force = 1.0}}", active='["left"]'), "not active in this stage"),
        (
            stage("s", lengths="{left = {change = -0.1}, e1 = {change = -0.1}}"),
            'lengths: "e1": element 1: an',
        ),
        (stage("s", set='{"load.steps" = 3}'), "not a key that a stage can set"),
        (stage("s") + stage("s"), "entry 1 has this name already"),
        (stage("s", set='{"load.temperature" = 20.0}') + LESS, "the last [[stage]] ends at 20 K"),
    ],
)
def test_wrong_input_is_named_with_its_place(workshop, text, words):
    """With the place in the job."""
    errors = workshop.solve(CABLES + text, NODES, TWO, code=2).stderr
    assert words in errors, errors
    assert not (workshop.folder / "result.vtkhdf").exists()


SCATTERED = CABLES + 'length_std = {}\n[form_finding]\nmethod = "given_geometry"\n'


def test_errors_of_length_without_equilibrium_leave_a_file(workshop):
    """The file has their scatter and the reason. Exit code 3; no later stage runs."""
    text = SCATTERED.format("0.2\nlength_seed = 3\nyield_stress = 2.2e7")
    text += "[load]\nself_weight = false\nsteps = 1\n" + stage("never")
    done = workshop.solve(text, *line_of_three(), ranks=2, code=3)
    assert "errors of length: no equilibrium with them" in done.stderr
    with workshop.open() as f:
        assert "statics" not in f and "stages" not in f
        assert f["provenance"].attrs["exit_state"] == f["deviation"].attrs["state"] == "no_equilibrium"
        assert (f["deviation/tension_deviation"][:] > 0.0).all()
    assert "no equilibrium after erection with errors of length" in workshop.info()
    page = workshop.report(pictures=True).page
    assert "**No equilibrium: errors of" in page and "**These lengths and the shop list" in page


def test_an_unstable_form_has_no_linear_influence_of_errors(workshop):
    """A hinged strut on three ropes nearly in one plane buckles out of it: nan, and a warning."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,1,0\n3,-10,0.1,-10,1\n4,10,0.1,-10,1\n5,0,-0.3,-10,1\n"
    elements = "start,end,group,kind,prestress\n"
    densities = {(1, 2): -440.0, (2, 3): 15.0, (2, 4): 15.0, (2, 5): 10.0}  # N/m: balance node 2
    x = np.array([[0, 0, 0], [0, 0, 1], [-10, 0.1, -10], [10, 0.1, -10], [0, -0.3, -10]])
    for (i, j), q in densities.items():
        force = q * np.linalg.norm(x[j - 1] - x[i - 1])
        elements += f"{i},{j},{'rope' if q > 0 else 'strut'}{j},{'cable' if q > 0 else 'bar'},{force}\n"
    output = workshop.printed(workshop.job(SCATTERED.format(1e-5), nodes, elements))
    assert "errors of length: the net is a mechanism or unstable" in output and "[W664]" in output
    with workshop.open() as f:
        assert np.isnan(f["deviation/tension_deviation"][:]).all()
        assert np.isnan(f["deviation/piece_effect"][:]).any()


def line_of_three():
    """Return three cables of 4, 5 and 6 m in a line between supports, with one tension."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,4,0,0,0\n3,9,0,0,0\n4,15,0,0,1\n"
    rows = "".join(f"{k},{k + 1},c,{'abc'[k - 1]},2e4\n" for k in (1, 2, 3))
    return nodes, "start,end,group,cable,prestress\n" + rows


def test_a_cable_of_two_groups_has_the_error_of_the_group_with_the_larger_one(workshop):
    """The draw has the standard deviation of the linear scatter, not a share of it."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,4,0,0,0\n3,9,0,0,1\n"
    elements = "start,end,group,cable,prestress\n1,2,a,one,2e4\n2,3,b,one,2e4\n"
    states = []
    for std in (0.0, 0.002):
        text = SCATTERED.format(f"{std}\n[group.a]\nlength_std = 0.002")
        f = workshop.solve(text, nodes, elements)
        states.append((f["form_finding/unstressed_length"][:], f["deviation/tension_deviation"][:]))
    assert np.array_equal(*(length for length, _ in states))
    assert np.array_equal(*(scatter for _, scatter in states))


def test_scatter_of_tensions_by_hand_and_by_runs(workshop):
    """EA s sqrt(3) / L for three errors s in a line. 1,000 draws have that scatter and no bias."""
    s, count = 0.002, 1000
    text = SCATTERED.format(s)
    job = workshop.job(text, *line_of_three())
    with workshop.run(job) as f:
        L0 = 15.0 / (1 + 2e4 / EA)
        by_hand = EA * 15.0 / L0**2 * s * np.sqrt(3)  # of the slope of EA (L / L0 - 1)
        assert f["deviation/tension_deviation"][:] == pytest.approx([by_hand] * 3, rel=FOUND)
        assert f["deviation/piece_effect"][:] == pytest.approx([by_hand / np.sqrt(3)] * 3, rel=FOUND)
        error = f["net/unstressed_length"][:].sum() - L0
        assert f["form_finding/tension"][:] == pytest.approx([EA * (15.0 / (L0 + error) - 1)] * 3, rel=FOUND)
    net, errors = build_net(read_job(job)), np.zeros((count, 3))
    for seed in range(count):
        set_strengths(read_job(job, [f"cable.length_seed={seed}"]), net)
        errors[seed] = net.length_error
    N = EA * (15.0 / (L0 + errors.sum(1)) - 1)
    assert abs(N.mean() - 2e4) < 4 * by_hand / np.sqrt(count)  # four standard errors
    assert N.std() == pytest.approx(by_hand, rel=4 / np.sqrt(2 * count))
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 4 / np.sqrt(count)


UNEVEN = bare_saddle(4, side=24.0, rise=3.0) + 'length_std = 0.05\n[form_finding]\nloads = "permanent"\n'
UNEVEN += "[load]\nself_weight = true\ndead = 120.0\n"


def test_a_form_with_errors_of_length_carries_the_load_of_these_lengths(workshop):
    """Reactions balance the permanent load; its self weight and areas changed with the lengths."""
    f = workshop.solve(UNEVEN)
    form, net = f["form_finding"], f["net"]
    weight = GRAVITY * (net["mass_per_length"][:] * net["unstressed_length"][:]).sum()
    load = weight + 120.0 * net["tributary_area"][:].sum()
    assert -form["reaction"][:, 2].sum() == pytest.approx(load, rel=1e-6)
    assert b"W722" not in f["provenance/warnings"][()]


def test_a_form_with_errors_of_length_needs_an_equilibrium_under_the_load_of_these_lengths(
    workshop, monkeypatch
):
    """Without one the run ends, although there was one under the load of the lengths without errors."""
    solve = permanent_state.solve_equilibrium
    failed = {"state": "no_equilibrium", "reason": "by the test"}
    monkeypatch.setattr(permanent_state, "solve_equilibrium", lambda *given: solve(*given)._replace(**failed))
    with pytest.raises(DivergedError, match="errors of length: no equilibrium with them: by the test"):
        run_here(workshop, workshop.job(UNEVEN))


def test_a_load_that_still_changes_with_errors_of_length_is_reported(workshop, monkeypatch):
    """If the iterations run out, netfall warns of the residual force, as for targets."""
    job, warned = workshop.job(UNEVEN), []
    for turns in (0, permanent_state.MOST_TURNS):
        monkeypatch.setattr(permanent_state, "MOST_TURNS", turns)
        with workshop.run_here(job) as f:
            warned.append(b"errors of length: the permanent load changes" in f["provenance/warnings"][()])
    assert warned == [True, False]


def test_a_stage_balances_if_its_load_changes_within_the_tolerance(workshop):
    """The loads of a stage change by up to the tolerance after its last search, at every node."""
    output = workshop.printed(ROOT / "jobs" / "clamps.toml", "--set", "load.tolerance=1e-8")
    assert "W722" not in output


def test_errors_of_length_of_a_net_as_given_leave_it_out_of_balance(workshop):
    """Nodes do not move: EA of the differences of strain between three cables of one tension."""
    text = CABLES + "length_std = 0.01\n[load]\nself_weight = false\n[dynamics]\nduration = 0.01\n"
    job = workshop.job(text, *line_of_three())
    with workshop.run(job) as f:
        L0 = f["net/unstressed_length"][:]
    largest = np.abs(np.diff(EA * (np.array([4.0, 5.0, 6.0]) / L0 - 1.0))).max()
    assert f"start: not in equilibrium: largest residual {largest / 1e3:.4g} kN" in workshop.check(job)


def test_samples_that_differ_by_their_errors_share_the_influence_of_errors(workshop, monkeypatch):
    """The influence is computed once. Outcomes and files are those of single runs."""
    text = SCATTERED.format(0.002) + "[load]\nself_weight = true\n"
    job, shared, texts, count = workshop.job(text, *line_of_three()), ResultCache(2), [], []
    compute = tension._influence
    monkeypatch.setattr(tension, "_influence", lambda *given: count.append(1) or compute(*given))
    for name, memory in (("shared", shared), ("own", ResultCache())):
        for seed in (1, 2):
            read, path = partial(read_job, job, [f"cable.length_seed={seed}"]), f"{name}{seed}.vtkhdf"
            outcomes = run_sample(MPI.COMM_SELF, read, workshop.folder / path, memory)
            texts.append(repr({key: value for key, value in outcomes.items() if not key.endswith("seconds")}))
    assert len(count) == 3 and texts[:2] == texts[2:] and texts[0] != texts[1]
    for seed in (1, 2):
        with workshop.open(f"shared{seed}.vtkhdf") as one, workshop.open(f"own{seed}.vtkhdf") as other:
            assert_same_results(one, other)
