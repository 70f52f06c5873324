"""Cables that slip over nodes: equilibria compared with closed forms and published cases; refusals."""

import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks
from nets import stage, table
from scipy.optimize import brentq

from netfall.core.errors import UndecidedError
from netfall.driver.statics import stage as statics
from netfall.geometry.build import build_net
from netfall.job.read import read_job
from netfall.post.checks.nodes import slip_point_columns, sum_end_forces
from netfall.post.plots.curves import slips
from netfall.post.report.page import _slides
from netfall.statics import slip as equilibria_with_slip

MU = 0.1


def rope(area=1e-3):
    """Return a section of 1e11 Pa, almost without weight."""
    return f"[cable]\nmodulus = 1e11\narea = {area}\ndensity = 1e-3\n"


def weight_on_a_ring(slide):
    """Return 1200 N on a ring on a weightless cable of 10 m between (0, 0) and (8, -2)."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,4,0,-3,0,1,0,-1200\n"
    nodes += "3,8,0,-2,1,1,1,0\n"
    elements = "start,end,group,unstressed_length\n2,1,rope,5\n2,3,rope,5\n"
    return rope(area=1e-2) + f"[load]\nself_weight = false\nsteps = 2\n[[slide]]\n{slide}", nodes, elements


def test_an_idle_stage_of_a_cable_over_a_pulley_converges_to_any_tolerance(workshop):
    """Rounded forces move it by 1e-13 m, which is no share of a displacement; it stays where it is."""
    nodes = "id,x,y,z,fixed,load_z\n0,0,0,0,1,0\n1,5,0,4,1,0\n2,12,0,0,1,0\n"
    nodes += "3,2,0,1,0,-1000\n4,9,0,1,0,-3000\n"
    text = rope().replace("density = 1e-3", "density = 8e3") + "[load]\nself_weight = true\nsteps = 1\n"
    text += 'tolerance = 1e-10\n[[slide]]\ngroup = "rope"\nnodes = [1]\nfriction = 0.0\n'
    text += stage("moves") + stage("idle")
    elements = "start,end,group,cable\n0,3,rope,c\n3,1,rope,c\n1,4,rope,c\n4,2,rope,c\n"
    with workshop.solve(text, nodes, elements) as f:
        moved = f["stages/idle/displacement"][:] - f["stages/moves/displacement"][:]
        assert np.abs(moved).max() < 1e-11
        assert f["stages/idle/tension_error"][()] < 1e-10


def test_a_ring_with_a_weight_finds_its_equilibrium(workshop):
    """Both parts have 1000 N, and the ring is at x = 5.3333 m, z = -4 m; elastic to 2e-6."""
    f = workshop.solve(*weight_on_a_ring('group = "rope"\n'))
    assert np.allclose(f["statics/tension"][-1], 1000.0, rtol=1e-5)
    x = f["net/particles"][1] + f["statics/displacement"][-1, 1]
    assert np.allclose(x, [16.0 / 3.0, 0.0, -4.0], atol=2e-5)
    slip = f["statics/slip"][-1]
    # the first element runs from the ring to node 1: what passes the ring towards it is positive
    assert f["slide/node"][()].tolist() == [2] and slip == pytest.approx([5.0 / 3.0], abs=2e-5)


def test_a_clamp_below_its_resistance_does_not_change_the_result(workshop):
    """No length passes, and tensions agree to the accuracy of Newton's method."""
    held = workshop.solve(*weight_on_a_ring('group = "rope"\nslip_resistance = 1e6\n'))
    text, nodes, elements = weight_on_a_ring('group = "rope"\n')
    fixed = workshop.solve(text.partition("[[slide]]")[0], nodes, elements, output="fixed.vtkhdf")
    assert not held["statics/slip"][:].any()
    assert np.allclose(held["statics/tension"][:], fixed["statics/tension"][:], rtol=1e-7)


def test_the_load_of_a_case_follows_a_cable_that_slips(workshop):
    """Tension and load balance at the ring, and give the reactions, with 8 kN of rope that slips."""
    case = '[[case]]\nname = "own"\nset = {"load.temperature" = 10.0}\n'
    text, *tables = weight_on_a_ring('group = "rope"\n' + case)
    text = text.replace("density = 1e-3", "density = 8e3").replace("self_weight = false", "tolerance = 1e-9")
    f = workshop.solve(text, *tables)
    case, ends = f["cases/own"], f["net/elements"][:]
    x, reaction = f["net/particles"][:] + case["displacement"][:], case["reaction"][:]
    pull = sum_end_forces(x, ends, case["tension"][:])
    assert np.abs(f["cases/own/slip"][:]).min() > 0.1 and reaction[:, 2].sum() < -8000.0
    assert np.abs(pull + case["load"][:] - reaction).max() < 1e-6 * np.abs(pull).max()


def half_circle(n, slide):
    """Return a cable over n fixed nodes of a half circle, held at one end and pulled at the other."""
    angle = np.pi * np.arange(n + 2) / (n + 1)
    x, z = -np.cos(angle), np.sin(angle)
    pull = 1000.0 * np.array([x[-1] - x[-2], z[-1] - z[-2]]) / np.hypot(x[-1] - x[-2], z[-1] - z[-2])
    rows = []
    for k in range(n + 2):
        last = k == n + 1
        rows.append((k, x[k], 0, z[k], *((0, 1, 0) if last else (1, 1, 1)), *(pull if last else (0, 0))))
    elements = table("start,end,group", ((k, k + 1, "rope") for k in range(n + 1)))
    text = rope() + f'[load]\nself_weight = false\nsteps = 4\n[[slide]]\ngroup = "rope"\n{slide}'
    return text, table("id,x,y,z,fixed_x,fixed_y,fixed_z,load_x,load_z", rows), elements


@pytest.mark.parametrize("n, published", [(1, 1.170089), (5, 1.299266)])
def test_friction_over_saddles_is_that_of_a_capstan(workshop, n, published):
    """Euler and Eytelwein, over n nodes with pi / (n + 1) each. Elasticity changes it by T / EA."""
    f = workshop.solve(*half_circle(n, f"friction = {MU}\n"))
    N = f["statics/tension"][-1]
    assert N[-1] == pytest.approx(1000.0, rel=1e-6)
    assert np.allclose(N[1:] / N[:-1], np.exp(MU * np.pi / (n + 1)), rtol=1e-5)
    assert N[-1] / N[0] == pytest.approx(published, rel=1e-4)
    assert (f["statics/slip"][-1] > 0.0).all()
    used, turn = slip_point_columns(f), MU * np.pi / (n + 1)
    # a saddle that slips is used by its friction over 1.65
    assert used["utilisation"][-1] == pytest.approx(np.expm1(turn) / np.expm1(turn / 1.65), rel=1e-4)
    assert used["slip"][-1] > 0.0 and used["tension_after"][-1] == pytest.approx(1000.0, rel=1e-6)


def test_clamps_reduce_the_tension_one_after_the_other(both_ways):
    """1000 N against clamps of 300 N: 1000, 700, 400, 100. The cable behind is slack and does not slip."""
    f = both_ways.solve(*half_circle(5, "slip_resistance = 300.0\n"))
    assert np.allclose(f["statics/tension"][-1], [0, 0, 100, 400, 700, 1000], atol=1e-2)
    slip = f["statics/slip"][-1]
    assert not slip[:1].any() and (np.diff(slip) >= 0.0).all()
    used = slip_point_columns(f)
    passed, of_clamps = (panel.lines[5].get_ydata() for panel in slips(f).axes)  # of the last load step
    last = used["stage"] == "statics, load factor 1"
    assert used["node"][last].tolist() == [1, 2, 3, 4, 5]
    assert used["utilisation"][last] == pytest.approx([0.0, 1.0 / 3.0, 1.0, 1.0, 1.0], abs=1e-4)
    assert passed == pytest.approx(1e3 * slip) and of_clamps[-1] == pytest.approx(1.0, abs=1e-4)


def test_friction_and_a_clamp_at_one_node_add_up(workshop):
    """A saddle with a clamp holds t exp(mu theta) + R: 1000 N leave (1000 - 300) exp(-mu pi / 2)."""
    f = workshop.solve(*half_circle(1, f"friction = {MU}\nslip_resistance = 300.0\n"))
    N = f["statics/tension"][-1]
    assert N == pytest.approx([700.0 * np.exp(-MU * np.pi / 2.0), 1000.0], rel=1e-5)


def test_a_clamp_that_slips_under_self_weight_is_fully_used(workshop):
    """7.7 kg/m through a clamp of 15 kN carry 20 kN. Mid-element tensions differ by 0.76 kN less."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,20,1,1,1,0\n2,0,0,10,1,1,1,0\n"
    nodes += "3,0,0,0,1,1,0,-20e3\n"
    text = rope().replace("1e-3\n", "7700.0\n") + "[load]\nself_weight = true\nsteps = 1\n"
    text += '[[slide]]\ngroup = "m"\nnodes = [2]\nslip_resistance = 15e3\n'
    used = slip_point_columns(workshop.solve(text, nodes, "start,end,group\n1,2,m\n2,3,m\n"))
    assert used["slip"][-1] != 0.0 and used["utilisation"][-1] == pytest.approx(1.0, rel=2e-4)  # T / EA
    assert abs(used["difference"][-1]) == pytest.approx(15e3, rel=2e-4)


def test_a_saddle_holds_by_the_tensions_at_the_saddle(workshop):
    """10 m of cable of 200 kg/m hang above it; 30 kN pull from it. The slip carries 1.5e-4 of its force."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_x\n1,0,0,10,1,1,1,0\n2,0,0,0,1,1,1,0\n"
    nodes += "3,10,0,0,0,1,1,30e3\n"
    text = rope().replace("1e-3\n", "2e5\n") + "[load]\nself_weight = true\nsteps = 1\n"
    text += '[[slide]]\ngroup = "m"\nnodes = [2]\nfriction = 0.3\n'
    f = workshop.solve(text, nodes, "start,end,group\n1,2,m\n2,3,m\n")
    used, reaction = slip_point_columns(f), f["statics/reaction"][-1]
    before = -reaction[0, 2] - 2e5 * 1e-3 * 9.81 * 10.0
    holds = min(before, 30e3) * np.expm1(0.3 * np.pi / 2.0 / 1.65)
    assert before > 1e3 and used["tension_before"][-1] == pytest.approx(before, rel=3e-4)
    assert used["holds"][-1] == pytest.approx(holds, rel=3e-4)
    assert used["difference"][-1] == pytest.approx(30e3 - before, rel=3e-4)


def test_an_unstable_permanent_state_with_a_sliding_cable_is_a_warning(workshop):
    """A mast of two hinged bars buckles. A case that lifts it is stable, and passes no check."""
    nodes = "id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,0,0,2,0,-1e4\n3,0,0,4,0,-1e4\n"
    nodes += "4,-5,0,0,1,0\n5,5,0,0,1,0\n6,0,5,0,1,0\n7,0,-5,0,1,0\n"
    elements = "start,end,group\n1,2,mast\n2,3,mast\n4,3,stay\n3,5,stay\n6,3,guy\n3,7,guy\n"
    text = rope() + 'prestress = 1e3\n[group.mast]\nkind = "bar"\n[load]\nself_weight = true\n'
    text += '[[case]]\nname = "up"\nload_table = "up.csv"\n[[slide]]\ngroup = "stay"\nnodes = [3]\n'
    (workshop.folder / "up.csv").write_text("node,load_z\n2,1e4\n3,1.2e4\n")
    done = workshop.solve(text, nodes, elements, code=None)
    assert "warning: the permanent loads: unstable equilibrium" in done.stdout
    assert "FAILS: the path to case up passes a limit point" in workshop.report().page


def test_friction_that_more_than_doubles_a_tension_converges(workshop):
    """T1 = T2 exp(2 theta) with a friction of 2 does not follow from the tensions of the last search."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_x,load_z\n1,-9,0,0,1,1,1,0,0\n2,9,0,0,1,1,1,0,0\n"
    nodes += "3,0,0,-2,0,1,0,20e3,-8e3\n"
    text = "[cable]\nmodulus = 1.6e11\narea = 2e-4\ndensity = 7850.0\nprestress = 2e4\n[load]\n"
    text += 'self_weight = false\nsteps = 1\ntolerance = 1e-8\n[[slide]]\ngroup = "c"\nfriction = 2.0\n'
    f = workshop.solve(text, nodes, "start,end,group\n1,3,c\n3,2,c\n")
    x = f["net/particles"][2] + f["statics/displacement"][-1, 2]
    theta = np.arctan2(-x[2], x[0] + 9.0) + np.arctan2(-x[2], 9.0 - x[0])
    T1, T2 = f["statics/tension"][-1]
    assert f["statics/slip"][-1, 0] != 0.0 and T1 / T2 == pytest.approx(np.exp(2.0 * theta), rel=1e-6)


def test_friction_that_does_not_converge_states_its_change(workshop, monkeypatch):
    """One iteration is allowed to a weight that slips on its cable. Its resistance changes by kN."""
    monkeypatch.setattr(equilibria_with_slip, "MOST_STEPS", 1)
    nodes = "id,x,y,z,fixed,load_x,load_z\n1,-9,0,0,1,0,0\n2,9,0,0,1,0,0\n3,0,0,-2,0,20e3,-8e3\n"
    text = rope() + "[load]\nself_weight = false\nsteps = 1\n"
    text += '[[slide]]\ngroup = "rope"\nfriction = 0.5\n'
    job = workshop.job(text, nodes, "start,end,group,prestress\n1,3,rope,2e4\n3,2,rope,2e4\n")
    pattern = r"the slip resistances still change by [\d.]+ kN after 1 rounds, allowed [\d.e-]+ kN"
    with pytest.raises(UndecidedError, match=pattern):
        workshop.run_here(job)


def test_a_straight_cable_with_friction_bends_before_it_slips(workshop):
    """1 kN at each node: both ends have 48.4 kN, 0.0206 rad hold 200 N, and 83 N act."""
    rows = ((k, k, 0, 0, int(k % 10 == 0), -1000 if k % 10 else 0) for k in range(11))
    text = "[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 7850.0\nprestress = 2e4\n"
    text += '[load]\nself_weight = false\nsteps = 1\n[[slide]]\ngroup = "c"\nfriction = 0.2\n'
    elements = table("start,end,group", ((k, k + 1, "c") for k in range(10)))
    f = workshop.solve(text, table("id,x,y,z,fixed,load_z", rows), elements)
    N = f["statics/tension"][-1]
    assert not f["statics/slip"][-1].any() and f["statics/iterations"][-1] < 500
    assert N.max() == pytest.approx(48.4e3, rel=1e-2) and N == pytest.approx(N[::-1], rel=1e-6)


def test_a_cable_that_becomes_slack_over_a_saddle_loses_all_its_tension(workshop):
    """One side is lengthened by 0.1 m of 10 m. The other side follows; its resistance falls as well."""
    nodes = "id,x,y,z,fixed\n1,-3,0,0,1\n2,0,0,4,1\n3,3,0,0,1\n"
    elements = "start,end,group,prestress,cable\n1,2,m,1e4,first\n2,3,m,1e4,last\n"
    job = rope() + '[load]\nself_weight = false\n[[slide]]\ngroup = "m"\nfriction = 0.2\n'
    job += stage("slack", lengths="{first = {change = 0.1}}")
    f = workshop.solve(job, nodes, elements)
    assert f["stages/slack/tension"][:] == pytest.approx(0.0, abs=1e-3)
    assert f["stages/slack/slip"][:] == pytest.approx(5.0 * 1e4 / (1e11 * 1e-3), rel=1e-3)


def test_a_jack_pulls_over_saddles_without_overshoot(workshop):
    """100 kN at the jack, 100 kN exp(-0.2 theta) behind a saddle. Trials above 100 kN have no effect."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,6,1\n3,25,0,6,1\n4,35,0,0,1\n"
    elements = "start,end,group,prestress,cable\n1,2,m,1e4,first\n2,3,m,1e4,mid\n3,4,m,1e4,last\n"
    job = rope() + '[load]\nself_weight = false\n[[slide]]\ngroup = "m"\nfriction = 0.2\n'
    job += stage("jack", lengths="{first = {force = 1e5}}")
    N = workshop.solve(job, nodes, elements)["stages/jack/tension"][:]
    assert N == pytest.approx(1e5 * np.exp(-0.2 * np.arctan(0.6) * np.arange(3)), rel=2e-6)


@pytest.mark.parametrize("slide, strand", [("", 17.0), ("friction = 0.1\n", 7.0)])
def test_a_weight_on_a_rope_over_a_pulley_vibrates_on_its_whole_length(workshop, slide, strand):
    """T = 2 pi sqrt(m L0 / EA), L0 of 10 m behind the node and 7 m before it; of 7 m if it sticks."""
    EA, T, m = 1e8, 9810.0, 1000.0
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n1,0,0,0,1,1,1,0\n2,0,0,10,1,1,1,0\n3,0,0,3,1,1,0,1000\n"
    job = rope() + f'[[slide]]\ngroup = "rope"\nnodes = [2]\n{slide}[dynamics]\nduration = 1e-3\n'
    job += "[output]\nframes = 1\n[modes]\ncount = 1\n"
    f = workshop.solve(job, nodes, f"start,end,group,prestress\n1,2,rope,{T}\n2,3,rope,{T}\n")
    expected = 2.0 * np.pi * np.sqrt(m * strand / (1.0 + T / EA) / EA)
    assert f["modes/period"][0] == pytest.approx(expected, rel=1e-6)  # half of the rope's mass is 4e-9 of m


def test_a_form_with_unequal_tensions_at_a_pulley_is_a_warning(workshop):
    """40 and 60 kN at node 2; none at constant tension, with a friction of 9, or for equal tensions."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,5,0,0,0\n3,10,0,0,1\n4,5,5,1,1\n5,5,-5,1,1\n"
    pairs = "start,end,group,prestress\n1,2,rope,4e4\n2,3,rope,{}\n2,4,side,2e4\n2,5,side,2e4\n"
    job = rope() + '[form_finding]\n{}[[slide]]\ngroup = "rope"\n{}'
    warnings = []
    for more, slide, force in ("", "", 6e4), ("modulus_factor = 0\n", "", 4e4), ("", "friction = 9\n", 6e4):
        job_file = workshop.job(job.format(more, slide), nodes, pairs.format(force))
        lines = run_on_standing_ranks("check", job_file).stdout.splitlines()
        warnings.append([line for line in lines if "[[slide]]: in the form the tensions" in line])
    assert "of 1 of 1 slip points differ by more than their slip resistance; at node 2: 4" in warnings[0][0]
    assert warnings[1:] == [[], []]


def test_each_case_begins_with_the_slips_of_the_permanent_state(workshop, monkeypatch):
    """Also the first case, whose tangent includes them. A run resumed in a later case has equal bits."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,4,0,-1,0\n3,10,0,-1,0\n4,14,0,0,1\n"
    nodes += "5,4,5,1,1\n6,4,-5,1,1\n7,10,5,1,1\n8,10,-5,1,1\n"
    pairs = "start,end,group,prestress\n1,2,rope,4e4\n2,3,rope,5e4\n3,4,rope,6e4\n2,5,side,2e4\n"
    pairs += "2,6,side,2e4\n3,7,side,2e4\n3,8,side,2e4\n"
    job = rope() + "[form_finding]\n[load]\nself_weight = false\n"
    job += 'tolerance = 1e-2\n[[slide]]\ngroup = "rope"\nfriction = 0.05\n'
    for name, warm in ("first", 5), ("second", 10):
        job += f'[[case]]\nname = "{name}"\nset = {{"load.temperature" = {warm}.0}}\n'
    begins, solve_equilibrium = [], statics.solve_equilibrium

    def noted(scene, each, *arguments, **more):
        begins.append((each.kind, scene.state.slip.tobytes()))
        return solve_equilibrium(scene, each, *arguments, **more)

    monkeypatch.setattr(statics, "solve_equilibrium", noted)
    workshop.run_here(workshop.job(job, nodes, pairs)).close()
    slips = [slip for kind, slip in begins if kind == "case"]
    assert len(slips) == 2 and slips[0] == slips[1] != bytes(len(slips[0]))


def catenary(a, c, count):
    """Return points (count + 1, 2) of a catenary of half span a and parameter c, evenly spaced on it."""
    half = c * np.sinh(a / c)
    s = np.linspace(-half, half, count + 1)
    x = c * np.arcsinh(s / c)
    return np.column_stack([x + a, c * (np.cosh(x / c) - np.cosh(a / c))])


def spans(points, length, fixed, others=()):
    """Return tables of a cable through points (k, 2), with elements of unstressed lengths (k - 1,).

    others : (group, node, x, z, held) of elements that hang on a node of it
    """
    held = lambda k: (1, 1, 1) if k in fixed else (0, 1, 0)
    rows = [(k, x, 0, z, *held(k)) for k, (x, z) in enumerate(points)]
    lines = [(k, k + 1, "rope", "c", length[k]) for k in range(len(length))]
    for group, node, x, z, held in others:
        lines.append((node, len(rows), group, group, abs(z - points[node][1])))
        rows.append((len(rows), x, 0, z, held, 1, held))
    nodes = table("id,x,y,z,fixed_x,fixed_y,fixed_z", rows)
    return nodes, table("start,end,group,cable,unstressed_length", lines)


LINE = (
    "[cable]\nmodulus = 5e11\narea = 1e-4\ndensity = 30581.0398\n"  # EA 5e7 N, 30 N/m
    '[load]\nself_weight = true\nsteps = 1\n[[slide]]\ncables = ["c"]\n'
)


def test_a_line_over_two_pulleys_with_a_weight(workshop):
    """Code_Aster R3.08.05: sag 7.941 m published; 7.940537 inextensible, 7.939679 elastic."""
    count = 40
    arc = catenary(50.0, 158.725, count)
    points = np.concatenate([arc, arc[1:] + [100.0, 0.0], [[200.0, -10.0]]])
    lengths, end = np.hypot(*np.diff(points, axis=0).T), len(points) - 1
    # a metre below the last strand weighs 4700 N, that strand itself 300 N, less what slips into it
    slipped = 0.0205  # m, at 30 N/m
    others = [("stay", count, 100.0, 10.0, 1), ("weight", end, 200.0, -11.0, 0)]
    nodes, elements = spans(points, lengths, {0, 2 * count}, others)
    weight = (4700 - 30 * slipped) / 9.81e-2  # as a density
    sections = f"[group.stay]\ndensity = 1.0\n[group.weight]\narea = 1e-2\ndensity = {weight}\n"
    f = workshop.solve(sections + LINE + f"nodes = [{count}, {2 * count}]\n", nodes, elements)
    z = f["net/particles"][:, 2] + f["statics/displacement"][-1, :, 2]
    sag = f["statics/displacement"][-1, count, 2] - z[: 2 * count].min()
    assert f["statics/slip"][-1, -1] == pytest.approx(slipped, abs=1e-4)
    assert sag == pytest.approx(7.939679, rel=1e-4)


def test_a_line_whose_end_moves_inwards(workshop):
    """Code_Aster SSNL100: 220 m over two spans of 100 m, the end at 210 m: H 2757.02 N, T 3175.19 N."""
    count = 120  # straight elements: the sag of 40 is off by 7e-4
    arc = catenary(50.0, 91.9, count)
    length = 2.0 * 91.9 * np.sinh(50.0 / 91.9)
    points = np.concatenate([arc, arc[1:] + [100.0, 0.0], [[210.0, 0.0]]])
    lengths = np.append(np.hypot(*np.diff(points[:-1], axis=0).T), 220.0 - 2.0 * length)
    nodes, elements = spans(points, lengths, {0, count, 2 * count, 2 * count + 1})
    f = workshop.solve(LINE + f"nodes = [{count}, {2 * count}]\n", nodes, elements)
    x = f["net/particles"][:] + f["statics/displacement"][-1]
    N = f["statics/tension"][-1]
    assert N[-1] == pytest.approx(3175.186, rel=1e-4)
    along = slips(f).axes[0].lines[0].get_xdata()
    assert np.allclose(along, [0.0, 100.0])  # between the two pulleys
    low = np.interp(48.5, x[: count + 1, 0], x[: count + 1, 2])
    assert low == pytest.approx(-13.9274, rel=1e-4)


DAMPED = "[dynamics]\nduration = 0.1\naxial_damping_ratio = 0.01\naxial_damping_band = [1.0, 9.0]\n"


@pytest.mark.parametrize(
    "slide, message",
    [
        ("friction = 0.1\n", "group or cables: missing"),
        ('group = "hoop"\n', "no such group of elements"),
        ('group = "rope"\nnodes = [1]\n', "no cable of this entry runs through"),
        ('group = "rope"\nnodes = [9]\n', "no node 9"),
        ('group = "rope"\n[[slide]]\ngroup = "rope"\n', "entry 1 lets this cable slip there already"),
        ('group = "rope"\n[group.rope]\nyield_stress = 1e9\n', "a cable that slips cannot yield"),
        ('group = "rope"\n[group.rope]\nkind = "bar"\n', "bars do not slip"),
        ('group = "rope"\n[[stage]]\nname = "a"\nclamps = "shut"\n', 'expected one of "open", "closed"'),
        ('group = "rope"\n' + DAMPED, "[dynamics] axial_damping_ratio: not together with [[slide]]"),
    ],
)
def test_cables_that_cannot_slip_are_refused(workshop, slide, message):
    done = workshop.solve(*weight_on_a_ring(slide), code=2)
    assert message in done.stderr and "Traceback" not in done.stderr


def test_the_most_used_saddle_in_motion_is_that_of_the_largest_difference():
    """Its resistance in motion is unknown. In a stage with utilisations the largest of these counts."""
    table = {
        "stage": np.array(["dynamics"] * 3 + ["initial state"] * 3),
        "node": np.array([1, 2, 3] * 2),
        "cable": np.array(["a"] * 6),
        "difference": np.array([1e3, -5e3, 2e3, 9e3, 2e3, 1e3]),
        "holds": np.array([np.nan] * 3 + [18e3, 2e3, 4e3]),
        "utilisation": np.array([np.nan] * 3 + [0.5, 1.0, 0.25]),
        "slip": np.array([0.02, 0.0, 6e-11, 6e-11, 0.0, 0.0]),  # m; the smallest are residuals
    }
    assert _slides(table)[-2:] == [
        "| dynamics | node 2, cable a | 5 kN | not known |  | 1, by up to 20 mm |",
        "| initial state | node 2, cable a | 2 kN | 2 kN | 1.000 | none |",
    ]


@pytest.mark.parametrize("parts", [1, 8])
def test_slip_does_not_stop_at_the_first_part_of_a_cable(workshop, parts):
    """A support moves 5 m towards a pulley, so 5 m of stretched rope pass: three parts of 1.67 m."""
    T, EA, span = 5000.0, 1e8, 13.4
    nodes = f"id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,{span},0,0,1,0\n3,{span},0,-12,0,-5000\n"
    stretch = 1.0 + T / EA
    elements = f"start,end,group,unstressed_length\n1,2,rope,{span / stretch}\n2,3,rope,{12 / stretch}\n"
    text = f"subdivide = {parts}\n" + rope() + "[load]\nself_weight = false\nsteps = 0\n"
    text += "[[case]]\nname = 'in'\nsettlement = {1 = [5.0, 0.0, 0.0]}\n"
    case = workshop.solve(text + '[[slide]]\ngroup = "rope"\n', nodes, elements)["cases/in"]
    assert case["slip"][0] == pytest.approx(5.0 / stretch, rel=1e-8)  # of the tolerance, 1e-6 of 12 m
    assert case["tension"][:] == pytest.approx([T] * 2 * parts, rel=1e-6)
    assert "stopped" not in case.attrs


@pytest.mark.parametrize("nodes, cables", [("nodes = [2]\n", ["e5"] * 3 + ["e9"]), ("", ["e5"] * 4)])
def test_a_sliding_cable_continues_over_its_saddles(workshop, nodes, cables):
    """The cable turns by 90 degrees at held node 2 and free node 3; it ends at 4 if nothing slips there."""
    at = "id,x,y,z,fixed\n1,0,0,0,1\n2,9,0,0,1\n3,9,0,-6,0\n4,15,0,-6,1\n5,20,0,-6,1\n"
    rows = [(7, 2, 1, "rope", 9), (5, 2, 3, "rope", 6), (6, 3, 4, "rope", 6), (9, 4, 5, "rope", 5)]
    text = f'subdivide = 3\n{rope()}[[slide]]\ngroup = "rope"\n{nodes}'
    job = workshop.job(text, at, table("id,start,end,group,unstressed_length", rows))
    net = build_net(read_job(job))
    assert [net.cable_names[k] for k in net.cable] == np.repeat(cables, 3).tolist()


@pytest.mark.parametrize("parts, chosen", [(8, "nodes = [16]\n"), (8, ""), (20, "nodes = [40]\n")])
def test_slip_in_different_spans_is_that_of_catenaries(workshop, parts, chosen):
    """Spans of 100 and 60 m with lengths of 106 and 66.8 m: 30 N/m slip until both tensions are equal.

    Without `nodes` the cable slips over its support, not at nodes that belong only to the cable.

    Elastic catenaries in closed form. Straight elements, as hinged links, are off by the square of their
    length: with 16 in each span by 1.8e-4 of the slip and 1.3e-3 of the tension.
    """
    w, EA, given = 30.0, 5e7, {100.0: 106.0, 60.0: 66.8}

    def force(span, S):  # the horizontal force at which an unstressed length S hangs over a span
        return brentq(lambda H: 2 * H / w * np.arcsinh(w * S / 2 / H) + H * S / EA - span, 10.0, 1e6)

    def lengths(s):  # after s has slipped into the second span
        return dict(zip(given, np.add(list(given.values()), (-s, s))))

    def difference(s):  # of the tensions at the pulley
        before, after = (np.hypot(force(span, S), w * S / 2) for span, S in lengths(s).items())
        return before - after

    slip, count = brentq(difference, -6.0, 5.0), 2 * parts
    arcs = [catenary(span / 2, force(span, S) / w, count) for span, S in given.items()]
    points = np.concatenate([arcs[0], arcs[1][1:] + [100.0, 0.0]])
    each = np.repeat(list(given.values()), count) / count
    f = workshop.solve(LINE + chosen, *spans(points, each, {0, count, 2 * count}))
    assert f["slide/node"][()].tolist() == [count]
    assert f["statics/slip"][-1, 0] == pytest.approx(slip, rel=2e-4 * (8 / parts) ** 2)
    N = f["statics/tension"][-1]
    for (span, S), link in zip(lengths(slip).items(), N[count - 1 : count + 1]):
        middle = w * S / 2 * (1.0 - 0.5 / parts)  # force at the middle of the element next to the pulley
        assert link == pytest.approx(np.hypot(force(span, S), middle), rel=1.5e-3 * (8 / parts) ** 2)


@pytest.mark.parametrize("measure", ["engineering", "logarithmic"])
def test_slips_converge_to_any_tolerance_in_both_strain_measures(workshop, measure):
    """The energy of a stiff cable in logarithmic strain is no difference of large terms, so slips settle."""
    settings = ["--set", "load.tolerance=1e-10", "--set", f"cable.strain_measure={measure}"]
    f = workshop.run(ROOT / "jobs" / "slide.toml", *settings)
    assert (f["statics/tension_error"][:] <= 1e-10).all() and not f["statics/relaxed"][:].any()
