"""Supports in stages, by axes, groups and zones: a ring released in plan, by hand and by statics."""

import numpy as np
import pytest
from conftest import assert_same_results, run_on_standing_ranks
from nets import stage

K, R, FORCE = 24, 20.0, 50e3  # nodes of the ring; m; N, of each radial in the form
RING_EA, RADIAL_EA = 4e9, 1e8  # N
CABLES = "[cable]\nmodulus = 1e11\narea = 1e-3\ndensity = 1000.0\n"
RING = '[group.ring]\nkind = "bar"\nmodulus = 2e11\narea = 0.02\nsecond_moment = 1e-2\n'
FORM = "[form_finding]\nmodulus_factor = 0.0\ntolerance = 1e-9\n"
LOAD = "[load]\nself_weight = false\ntolerance = 1e-10\n"
ANGLE = 2.0 * np.pi * np.arange(K) / K


def tables(hub: bool, zone: bool = False) -> tuple[str, str]:
    """Return a ring of held nodes 1 to K in plan with radials to a free hub, 100, or a tie along x."""
    x = [(float(R * np.cos(a)), float(R * np.sin(a))) for a in ANGLE]
    nodes = "id,x,y,z,fixed,zone\n"
    nodes += "".join(f"{k},{p!r},{q!r},5,1,{'rim' * zone}\n" for k, (p, q) in enumerate(x, 1))
    nodes += "100,0.3,-0.2,5,0,\n" * hub
    elements = "id,start,end,group,prestress\n"
    elements += "".join(f"{k},{k},{k % K + 1},ring,0\n" for k in range(1, K + 1))
    if hub:
        return nodes, elements + "".join(f"{100 + k},{k},100,radial,{FORCE}\n" for k in range(1, K + 1))
    return nodes, elements + f"101,1,{K // 2 + 1},tie,{FORCE}\n"


# tangentially at three nodes, without effect on radial motions
IN_PLACE = f'{{1 = "y", {K // 4 + 1} = "x", {K // 2 + 1} = "y"}}'
RELEASES = ['{ring = "xy"}', '{rim = "xy"}', '{all = "xy"}']


def shrunk() -> tuple[float, float]:
    """Force of a bar of the ring and of a radial [N] after the release: N = T / (2 sin(pi / K)).

    The ring is unstressed in the form, and each length is proportional to the radius R - u.
    """
    L0 = R / (1.0 + FORCE / RADIAL_EA)
    # RING_EA u / R = RADIAL_EA ((R - u) / L0 - 1) / (2 sin(pi / K)), linear in u
    share = 1.0 / (2.0 * np.sin(np.pi / K))
    u = RADIAL_EA * share * (R / L0 - 1.0) / (RING_EA / R + RADIAL_EA * share / L0)
    return -RING_EA * u / R, RADIAL_EA * ((R - u) / L0 - 1.0)


@pytest.mark.parametrize("release", RELEASES)
def test_a_ring_released_in_plan_has_the_thrust_q_times_r(workshop, release):
    """Group, zone and all nodes, held vertically: N = q R of the polygon, without reactions in plan."""
    text = CABLES + RING + FORM + LOAD + stage("free", release=release, hold=IN_PLACE)
    f = workshop.solve(text, *tables(True, zone=True))
    assert f["form_finding/tension"][K:] == pytest.approx(FORCE, rel=1e-6)
    g, (N, T) = f["stages/free"], shrunk()
    assert g["tension"][:K] == pytest.approx(N, rel=1e-6) and g["tension"][K:] == pytest.approx(T, rel=1e-6)
    q = T * K / (2.0 * np.pi * R)  # N/m
    assert -g["tension"][:K].mean() == pytest.approx(q * R, rel=(np.pi / K) ** 2 / 5.0)  # of the circle
    assert np.abs(g["reaction"][:]).max() < 1e-6 * FORCE
    held = g["held"][:K]
    assert (held[:, 2] == 1).all() and held[:, :2].sum() == 3 and held[0].tolist() == [0, 1, 1]


STEPS = [
    stage("free", release='{ring = "xy"}', hold=IN_PLACE),
    stage("up", move="{all = [0.0, 0.0, 0.5]}"),
    stage("held", hold='"ring"'),
    stage("rig", load_table='"rig.csv"'),
]


def test_a_factor_of_prestress_after_stages_with_bending_is_refused(workshop):
    """The factor would not change the moments of the last stage, so forces would be too small."""
    text = CABLES + RING + "bending = true\n" + LOAD + stage("free", hold=IN_PLACE)
    for factor, code in ((1.2, 2), (1.0, 0)):
        job = workshop.job(text + f"[combinations]\nmore = {{prestress = {factor}}}\n", *tables(False))
        errors = run_on_standing_ranks("check", job, code=code).stderr
        assert ("more: prestress 1.2 multiplies axial forces" in errors) == (code == 2)


def test_stages_of_supports_have_the_same_bits_on_ranks_and_after_a_pause(workshop):
    """Released, lifted, held in place, with a load table; later stages begin there."""
    (workshop.folder / "rig.csv").write_text("node,load_z\n100,-3000\n")
    ends = '[[case]]\nname = "more"\nload_table = "rig.csv"\n[dynamics]\nduration = 0.05\n'
    job = workshop.job(CABLES + RING + FORM + LOAD + "".join(STEPS) + ends, *tables(True))
    one = workshop.run(job)
    lifted = one["stages/up/displacement"][:] - one["stages/free/displacement"][:]
    assert lifted[:, 2] == pytest.approx(0.5, abs=1e-9) and np.abs(lifted[:, :2]).max() < 1e-9
    held = one["stages/held"]
    assert held["tension"][:] == pytest.approx(one["stages/up/tension"][:], rel=1e-6)
    assert held["held"][:K].all() and one["stages/rig/reaction"][:, 2].sum() == pytest.approx(-3000.0)
    assert one["net/fixed"][:K].all()
    with workshop.run(job, ranks=2, output="two.vtkhdf") as two:
        assert assert_same_results(one, two) > 20
    checkpoint, message = workshop.pause(job, 12, "paused.vtkhdf")
    assert "in form finding or erection" in message
    with workshop.run(job, "--restart", checkpoint, ranks=2, output="again.vtkhdf") as again:
        assert assert_same_results(one, again) > 20


def test_partly_released_supports_move_in_dynamics(workshop):
    """The last stage leaves the ring free in plan: it stays in equilibrium, held vertically."""
    text = CABLES + RING + FORM + LOAD + STEPS[0] + "[dynamics]\nduration = 0.05\n"
    f = workshop.solve(text, *tables(True))
    assert f["net/fixed"][0].tolist() == [0, 1, 1] and f["net/fixed"][1].tolist() == [0, 0, 1]
    assert f["envelope/displacement_max"][:].max() < 1e-6
    assert f["final/tension"][:K] == pytest.approx(shrunk()[0], rel=1e-5)


WRONG = [
    ("release", '{rang = "xy"}', 'release: "rang": neither a group nor a zone with nodes; did you mean'),
    ("hold", "[7, 99]", "hold: no node 99. Give ids of nodes of the net"),
    ("hold", '{1 = "yx"}', "hold = {'1': 'yx'}: expected ids of nodes, groups, zones or"),
    ("release", "[]", "release = []: expected ids of nodes, groups, zones"),
    ("release", "3", "release = 3: expected ids of nodes, groups, zones"),
    ("move", "{radial = [0.0, 1.0]}", "move = {'radial': [0.0, 1.0]}: expected a table of [x, y, z]"),
    ("move", "{100 = [0.0, 0.0, 1.0]}", "move: node 100: an axis that moves must be held"),
    ("release", '"all"', "has no support"),
]  # fmt: skip


@pytest.mark.parametrize("key, value, line", WRONG)
def test_a_wrong_support_is_refused_with_its_place(workshop, key, value, line):
    job = workshop.job(CABLES + RING + FORM + LOAD + stage("s", **{key: value}), *tables(True))
    errors = run_on_standing_ranks("check", job, code=2).stderr
    assert "[[stage]] s" in errors and line in errors


def test_a_node_with_an_angle_cannot_become_guided(workshop):
    nodes, elements = tables(True)
    turned = "\n".join(
        line + (",angle" if k == 0 else ",30" if k == 1 else ",") for k, line in enumerate(nodes.splitlines())
    )
    job = workshop.job(CABLES + RING + FORM + LOAD + stage("s", release='{1 = "x"}'), turned, elements)
    assert "[[stage]] s: node 1: have an angle" in run_on_standing_ranks("check", job, code=2).stderr
    workshop.job(CABLES + RING + FORM + LOAD + stage("s", release='{1 = "xy"}'), turned, elements)
    run_on_standing_ranks("check", job)


def test_a_node_that_a_stage_holds_can_settle(workshop):
    """The middle of two cables of 5 m moves by 1 mm along them. Without the stage's support it is refused."""
    nodes = "id,x,y,z,fixed\n1,0,0,5,1\n2,5,0,5,0\n3,10,0,5,1\n"
    elements = "start,end,unstressed_length\n1,2,4.99\n2,3,4.99\n"
    case = '[[case]]\nname = "sunk"\nsettlement = {2 = [0.001, 0.0, 0.0]}\n'
    f = workshop.solve(CABLES + LOAD + case + stage("prop", hold="[2]"), nodes, elements)
    assert f["cases/sunk/tension"][:] == pytest.approx(1e8 / 4.99 * np.array([0.011, 0.009]), rel=1e-9)
    job = workshop.job(CABLES + LOAD + case + stage("prop", hold='{2 = "yz"}'), nodes, elements)
    line = "sunk: settlement: node 2: not held after the last [[stage]]"
    assert line in run_on_standing_ranks("check", job, code=2).stderr
