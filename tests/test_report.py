"""`netfall report`: resistances, cutting lists, reactions and envelopes compared with hand calculations."""

import re
from base64 import b64encode
from itertools import product
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import BARE, STEEL, Workshop, refused, run_on_standing_ranks
from results import Report, rows_of
from scipy.optimize import brentq

import netfall
from netfall.core.errors import InputError
from netfall.driver.sample import run_sample
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.parallel.mpi import MPI
from netfall.post.checks.cables import Cutting, cutting_columns
from netfall.post.checks.codes import read_codes
from netfall.post.checks.ends import end_weights
from netfall.post.checks.shop import Piece, order_elements
from netfall.post.plots import utilisation
from netfall.post.plots.canvas import MARK
from netfall.post.report.info import info_of_result
from netfall.post.report.report import write_report
from netfall.results.states import (
    MOST_MARKED,
    at_limit_in_permanent_state,
    compute_envelope,
    equilibrium_groups,
)
from netfall.results.warning_text import limit_warnings

BUCKLES = "breaking_load = 80e3\nsecond_moment = 1e-4\nbuckling = true"
# Two cables of 5 m from supports above hold node 5 against one of 4 m to a support below: with 50 kN in each
# of the two and 2 x 50 x 4/5 = 80 kN in the third it is in equilibrium as given.
NODES = "id,x,y,z,fixed,load_z\n1,-3,0,4,1,0\n2,3,0,4,1,0\n3,0,0,-4,1,0\n5,0,0,0,0,-200e3\n"
ELEMENTS = "id,start,end,group,prestress,breaking_load\n{}"
ROWS = "11,1,5,upper,50e3,240e3\n12,2,5,upper,50e3,240e3\n13,5,3,lower,80e3,\n"
STEP = "[load]\nself_weight = false\nsteps = 1\n"
STATICS = BARE + STEP + "tolerance = 1e-9\n"
EA = 1.95e11 * 683.08e-6


# a file of checks; left open are the groups of its factor
OWN_CHECK = """[[check]]
name = "mine"
title = "by hand"
[[check.resistance]]
of = "breaking_load"
factor = [{{name = "g", use = "divide", value = 2.0, edition = "mine, 2026", {}}}]
"""


def column(rows, name) -> list[float]:
    return [float(row[name]) for row in rows]


@pytest.fixture(scope="module")
def loaded(shared_workshop):
    """Return the result of the three cables under 200 kN, and its folder."""
    shared_workshop.solve(STATICS, NODES, ELEMENTS.format(ROWS)).close()
    return shared_workshop.folder


def report_of(folder, result="result.vtkhdf", **options) -> Report:
    """Return the report of a result in a folder."""
    return Workshop(folder).report(result, **options)


def write_types(folder, *rows: str) -> str:
    """Write a catalogue; return the keys that name it. rows : name, kg/m, axial stiffness, breaking load"""
    head = "name,mass_per_length,axial_stiffness,breaking_load\n"
    (folder / "types.csv").write_text(head + "".join(f"{row}\n" for row in rows))
    return f'catalogue = "{folder}/types.csv"\n'


HUNG = "[cable]\nmodulus = 1e11\narea = 1e-4\ndensity = 7850.0\n"


def hung(workshop, text: str, load: float, mass=0, **options) -> Report:
    """Return the report of element 7 that hangs from node 1 with a load [N] at its end. text : after HUNG"""
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,9,1,0,0\n2,0,0,0,0,{mass},{-load}\n"
    return solved(workshop, HUNG + text, nodes, "id,start,end\n7,1,2\n", **options)


GIVEN_ROWS = ELEMENTS.format(ROWS)


def solved(workshop, text: str, nodes: str = NODES, elements: str = GIVEN_ROWS, **options) -> Report:
    """Return the report of a job, of the three cables by default."""
    workshop.solve(text, nodes, elements).close()
    return workshop.report(**options)


def test_resistances_are_those_of_the_codes(tmp_path):
    """EN 1993-1-11 for published F_uk of 240 to 10,075 kN; yield if it is less; ASCE 19; a user's file."""
    F_uk = 1e3 * np.array([240.0, 1520.0, 1615.0, 10075.0, 1520.0, np.inf])
    strengths = {"breaking_load": F_uk, "yield_force": np.array([np.inf] * 4 + [900e3, np.inf])}
    groups = np.array(["a", "a", "a", "a", "b", "a"], object)
    en, service, erection, asce = (check.resistance(strengths, groups) for check in read_codes()[:4])
    assert np.round(en / 1e3)[:5].tolist() == [160, 1013, 1077, 6717, 900] and np.isnan(en[5])
    assert service[:2].tolist() == pytest.approx([108e3, 684e3]) and asce[0] == pytest.approx(240e3 / 2.2)
    assert erection[:2].tolist() == pytest.approx([132e3, 836e3])
    own = tmp_path / "own.toml"
    own.write_text(OWN_CHECK.format("groups = {b = 4.0}"))
    (code,) = read_codes(own)
    assert code.resistance(strengths, groups)[[0, 4]].tolist() == [120e3, 380e3]
    own.write_text(own.read_text().replace("2.0", "-2.0").replace('"divide"', '"by"'))
    with pytest.raises(InputError) as raised:
        read_codes(own)
    assert [line.partition("factor g: ")[2] for line in raised.value.lines] == [
        'use = "by": expected one of "multiply", "divide" [E126]',
        "value = -2.0: expected a number > 0 [E126]",
    ]


def test_an_unknown_key_or_group_of_a_file_of_checks_is_refused(loaded):
    own, text = loaded / "own.toml", OWN_CHECK.format("groups = {uper = 4.0}")
    own.write_text(text)
    error = refused("report", "result.vtkhdf", "--codes", "own.toml", "-o", "none", cwd=loaded)
    assert not (loaded / "none").exists()
    place = "own.toml: [[check]] 1: factor g:"
    wrong = 'groups: uper = 4: no such group of elements in the result; did you mean "upper"?'
    assert f"{place} {wrong}" in error
    own.write_text("factr = 3\n" + text.replace("divide", "multiply").replace("groups =", "group ="))
    with pytest.raises(InputError) as raised:
        read_codes(own)
    assert raised.value.lines == [
        f"{own}: factr: unknown key; known: check [E125]",
        f'{own}: [[check]] 1: factor g: group: unknown key; did you mean "groups"? [E125]',
    ]
    own.write_text('[[check]]\nname = "mine"\ntitle = "by hand"\nresistance = []\n')
    with pytest.raises(InputError, match="1: resistance = \\[\\]: expected a list of tables"):
        read_codes(own)


def test_reactions_balance_the_load(loaded):
    """The cables have 50 and 80 kN as given, by hand. Under the load the reactions sum to the load."""
    rows = report_of(loaded).rows("reactions")
    force = {(row["stage"], row["node"]): [float(row[f"force_{axis}"]) for axis in "xyz"] for row in rows}
    given = [force["as given", node] for node in ("1", "2", "3")]
    assert np.array(given) == pytest.approx(
        np.array([[30e3, 0, -40e3], [-30e3, 0, -40e3], [0, 0, 80e3]]),
        abs=1e-5,  # rounding of lengths, of EA
    )
    at_load = np.array([force["statics, load factor 1", node] for node in ("1", "2", "3")])
    assert at_load.sum(0) == pytest.approx([0, 0, -200e3], abs=2e-4 * 2)  # 1e-9 of the load, on each axis
    with h5py.File(loaded / "result.vtkhdf") as f:
        # printed digits
        assert np.linalg.norm(at_load[0]) == pytest.approx(f["statics/tension"][-1, 0], rel=1e-11)


def test_the_report_names_governing_stages_and_slack_cables(loaded):
    """Under 200 kN the lower cable is slack and each upper one has 100 kN over the sine of its slope."""
    report = report_of(loaded)
    rows, page = {row["cable"]: row for row in report.rows("cables")}, report.page
    with h5py.File(loaded / "result.vtkhdf") as f:
        z = f["statics/displacement"][-1, 3, 2]
    N = 100e3 * np.hypot(3.0, 4.0 - z) / (4.0 - z)
    assert float(rows["e11"]["tension_max"]) == pytest.approx(N, rel=1e-8)  # 1e-9 of the load
    assert float(rows["e11"]["utilisation_en1993"]) == pytest.approx(N / 160e3, rel=1e-8)
    assert float(rows["e11"]["utilisation_asce19"]) == pytest.approx(2.2 * N / 240e3, rel=1e-8)
    assert rows["e11"]["case_max"] == rows["e13"]["slack_in"] == "statics, load factor 1"
    assert "slack cable elements, state" in page  # of cases.csv; the page counts cables
    assert float(rows["e13"]["tension_max"]) == pytest.approx(80e3) and rows["e13"]["case_max"] == "as given"
    assert rows["e13"]["utilisation_en1993"] == rows["e13"]["breaking_load"] == ""
    assert rows["e11"]["breaking_load"] != ""
    assert "cables without utilisation, because they have neither breaking_load nor yield_stress: 1" in page
    assert "| e13 | lower | statics, load factor 1 |" in page and "EN 1993-1-11:2006" in page


def test_the_report_states_the_sections_of_groups_and_the_digest_of_the_job(loaded):
    """EA = 195 GPa x 683.08 mm2, 7850 kg/m3; the upper cables break at 240 kN, the lower one never."""
    page = report_of(loaded).page
    assert "| upper |  | cable | 2 | 133201 | 5.36218 | 240 |" in page
    assert "| lower |  | cable | 1 | 133201 | 5.36218 |  |" in page
    with h5py.File(loaded / "result.vtkhdf") as f:
        assert f"\nDigest of the job and its net: {f['provenance'].attrs['job_digest'][:16]}.\n" in page


def test_the_report_lists_bars_and_cables_of_a_group_in_separate_rows(workshop):
    """A cable and a strut without a group, EA = 200 MN."""
    text = "[cable]\nmodulus = 2e11\narea = 1e-3\ndensity = 7850\nprestress = 1e3\n"
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,10,1\n3,10,0,0,1\n"
    elements = "start,end,kind\n1,2,bar\n1,3,cable\n"
    rows = [f"| (none) |  | {kind} | 1 | 200000 | 7.85 |\n" for kind in ("bar", "cable")]
    assert "".join(rows) in solved(workshop, text + STEP, nodes, elements).page


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_bar_in_line_with_a_cable_of_its_group_is_another_piece(workshop, order):
    """Each has its own row, and only the cable is measured under its 10 kN."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,5,0\n3,0,0,10,1\n"
    rows = "1,1,2,stay,cable,10e3\n", "2,2,3,stay,bar,10e3\n"
    elements = "id,start,end,group,kind,prestress\n" + rows[order[0]] + rows[order[1]]
    report = solved(workshop, BARE + STEP, nodes, elements)
    pieces = {row["cable"]: row for row in rows_of(report.folder / "cutting_list.csv")}
    assert {name: float(row["measuring_load"]) for name, row in pieces.items()} == {
        "e1": pytest.approx(10e3),
        "e2": 0.0,
    }


def test_the_table_of_groups_counts_elements_without_strength(workshop):
    """One of the two upper cables breaks at 240 kN, the other one never."""
    rows = ROWS.replace("12,2,5,upper,50e3,240e3", "12,2,5,upper,50e3,")
    page = solved(workshop, STATICS, elements=ELEMENTS.format(rows)).page
    assert "| upper |  | cable | 2 | 133201 | 5.36218 | 240, 1 without |" in page


def test_a_state_without_forces_has_no_slack_cables(workshop):
    """Without prestress and permanent loads no cable counts as slack until loads of nodes.csv act."""
    page = solved(workshop, STATICS, elements=re.sub(r"[0-9.]+e3,(.*)", r"0,\1", GIVEN_ROWS)).page
    assert "No element has a force in: as given; statics, permanent loads.\n" in page
    assert "| e13 | lower | all stages |" in page and "| e11 | upper |" not in page.partition("## Slack")[2]


def test_lengths_at_a_temperature_and_a_measuring_load_are_those_by_hand(loaded):
    """L0 = L / (1 + N / EA); measured 15 K warmer under 60 kN: L0 (1 + 12e-6 x 15) (1 + 60 kN / EA)."""
    unstressed = [5 / (1 + 50e3 / EA), 5 / (1 + 50e3 / EA), 4 / (1 + 80e3 / EA)]
    assert unstressed == pytest.approx([4.9981238, 4.9981238, 3.9975991], abs=1e-7)  # EA = 133.2006 MN
    rows = report_of(loaded, cutting=Cutting(15.0, 60e3)).rows("cutting_list")
    assert [row["cable"] for row in rows] == ["e11", "e12", "e13"]
    assert column(rows, "unstressed_length") == pytest.approx(unstressed, rel=1e-11)  # digits of the table
    warm = [L0 * (1 + 12e-6 * 15) for L0 in unstressed]
    assert column(rows, "unstressed_length_at_temperature") == pytest.approx(warm, rel=1e-11)
    measured = [L0 * (1 + 60e3 / EA) for L0 in warm]
    assert column(rows, "length_at_measuring_load") == pytest.approx(measured, rel=1e-11)
    assert column(rows, "temperature") == [15.0] * 3 and column(rows, "measuring_load") == [60e3] * 3
    as_it_stands = report_of(loaded).rows("cutting_list")
    assert column(as_it_stands, "measuring_load") == pytest.approx([50e3, 50e3, 80e3])
    assert column(as_it_stands, "length_at_measuring_load") == pytest.approx([5, 5, 4], rel=1e-11)


def test_a_measuring_load_above_the_strength_is_a_warning(loaded):
    """For the upper two cables of 240 kN; the third has no strength."""
    lines = []
    for load in (None, 240e3, 240.1e3):
        write_report(loaded / "result.vtkhdf", loaded / "measured", lines.append, cutting=Cutting(0.0, load))
    (line,) = (line for line in lines if "--measuring-load" in line)
    assert "240.1 kN is above the strength of 2 cables (e11, e12), 240 kN for the first. Lengths" in line


def test_a_logarithmic_cable_is_measured_by_its_own_law(workshop):
    """L0 = L exp(-N / EA), and the same length under the load of the form."""
    section = STATICS.replace("[load]", 'strain_measure = "logarithmic"\n[load]')
    rows = solved(workshop, section, cutting=Cutting(0.0, 50e3)).rows("cutting_list")
    assert column(rows, "unstressed_length")[0] == pytest.approx(5 * np.exp(-50e3 / EA), rel=1e-11)
    assert column(rows, "length_at_measuring_load")[0] == pytest.approx(5.0, rel=1e-11)


# Areas of 10 m2 at the free node and of 2 m2 at a support; snow on them as a case, and twice as much.
ROOFED = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n1,-3,0,4,1,2,0,0,1\n2,3,0,4,1,0,,,\n"
ROOFED += "3,0,0,-4,1,0,,,\n5,0,0,0,0,10,0,0,1\n"
CASES = BARE + "[load]\nself_weight = false\nsteps = 0\ntolerance = 1e-10\n"
CASES += '[[case]]\nname = "snow"\nset = {"load.snow" = 2000.0}\n'
CASES += '[[case]]\nname = "much"\nset = {"load.snow" = 4000.0}\n'


@pytest.fixture(scope="module")
def snowed(shared_workshop):
    with shared_workshop.solve(CASES, ROOFED, ELEMENTS.format(ROWS), output="snow.vtkhdf") as f:
        states = {name: (f[f"cases/{name}/tension"][:], f[f"cases/{name}/displacement"][:]) for name in CASED}
    write_report(shared_workshop.folder / "snow.vtkhdf", shared_workshop.folder / "snow")
    return states, shared_workshop.folder / "snow"


CASED = ("snow", "much")


def test_the_report_states_loads_of_cases_and_factors_of_combinations(workshop):
    """Factors that are not given are those in effect, 1 for the permanent loads and the prestress."""
    text = CASES.replace("set = {", "settlement = {1 = [0.0, 0.0, -0.03]}\nset = {", 1)
    text += '[combinations]\n"A" = {permanent = 1.35, snow = 1.5}\n"B" = {kind = "SLS", much = 1}\n'
    nodes = ROOFED.replace("normal_z\n", "normal_z,load_x\n")
    nodes = nodes.replace(",,\n", ",,,500\n").replace(",1\n", ",1,500\n")
    page = solved(workshop, text, nodes).page
    resultant = "- loads of nodes.csv: resultant 2 kN, 0 kN, 0 kN along x, y, z\n"
    assert f"{resultant}- snow: load.snow = 2000.0, " in page
    assert ", settlement.1 = \\[0.0, 0.0, -0.03]\n" in page
    assert "- A: 1.35 permanent + 1 prestress + 1.5 snow\n- B: 1 permanent + 1 prestress + 1 much\n" in page


def test_a_row_for_each_case_and_group_has_its_extremes(snowed):
    """The extremes are those of the file. Node 5 is in equilibrium under its snow, by hand."""
    states, folder = snowed
    page = (folder / "summary.md").read_text()
    assert "loads of nodes.csv" not in page and "en1993_erection" not in page  # it has neither
    rows = rows_of(folder / "cases.csv")
    assert [(row["case"], row["group"]) for row in rows] == [
        (case, group) for case in CASED for group in ("upper", "lower")
    ]
    forces, moved = rows_of(folder / "forces.csv"), rows_of(folder / "displacements.csv")
    for k, case in enumerate(CASED):
        N, d = states[case]
        assert column(forces, case) == pytest.approx(N, rel=1e-11)  # digits of the table
        assert column(moved, f"{case} z") == pytest.approx(d[:, 2], rel=1e-11)
        upper, lower = rows[2 * k : 2 * k + 2]
        assert float(upper["tension_max"]) == pytest.approx(N[:2].max(), rel=1e-11)
        assert float(lower["tension_min"]) == pytest.approx(N[2], rel=1e-11)
        assert float(upper["displacement_max"]) == pytest.approx(-d[3, 2], rel=1e-11)
        assert upper["node_max"] == "5" and upper["slack"] == "0" and upper["state"] == "equilibrium"
        z = d[3, 2]
        by_hand = 2 * N[0] * (4 - z) / np.hypot(3, 4 - z) - N[2]  # of node 5
        assert by_hand == pytest.approx(2000.0 * (k + 1) * 10, rel=1e-8)  # 1e-10 of the largest force
    assert column(forces, "as given") == pytest.approx([50e3, 50e3, 80e3], rel=1e-11)


def test_columns_of_a_table_have_different_names(workshop, loaded):
    """The size of case "snow z" and the heights of case "snow". A case may have the name of a dataset,
    because /cases is not an equilibrium. A check may not have the name "max".
    """
    text = CASES.replace('"snow"', '"snow z"').replace('"much"', '"snow"')
    text += '[[case]]\nname = "tension"\nset = {"load.snow" = 1000.0}\n'
    with workshop.run(workshop.job(text, ROOFED, ELEMENTS.format(ROWS))) as f:
        first, second = (f[f"cases/{name}/displacement"][:] for name in ("snow z", "snow"))
    report = workshop.report()
    rows = report.rows("displacements")
    assert column(rows, "snow z") == pytest.approx(np.linalg.norm(first, axis=1), rel=1e-11)
    assert column(rows, "snow, z") == pytest.approx(second[:, 2], rel=1e-11)
    assert column(rows, "snow z z") == pytest.approx(first[:, 2], rel=1e-11)
    assert {row["case"] for row in report.rows("cases")} == {"snow z", "snow", "tension"}
    own = workshop.folder / "own.toml"
    own.write_text(OWN_CHECK.format("groups = {}").replace('"mine"', '"max"'))
    with pytest.raises(InputError, match="has a column case_max already"):
        report_of(loaded, codes=own)


def test_forces_on_the_foundation_add_up_to_all_loads(snowed):
    """Including loads on the support, 2 m2 of snow on node 1, which its cables do not carry."""
    rows = [row for row in rows_of(snowed[1] / "reactions.csv") if row["stage"] == "case much"]
    pull, foundation = (
        np.array([column(rows, f"{of}_{a}") for a in "xyz"]).T for of in ("force", "foundation")
    )
    assert foundation - pull == pytest.approx(np.array([[0, 0, -8000.0], [0, 0, 0], [0, 0, 0]]), abs=1e-6)
    assert foundation.sum(0) == pytest.approx([0, 0, -48e3], abs=1e-9 * 48e3)


# A cable of 10 m that hangs and a bar that stands, of 200 and 300 kg/m; 50 mm of ice as a case.
UPRIGHT = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,0,0,-10,0,0,0,-1e4\n"
UPRIGHT += "3,5,0,0,1,1,1,0\n4,5,0,10,1,1,0,-5e4\n"
HEAVY = "id,start,end,group,prestress\n1,2,1,cable,1\n2,3,4,bar,-1\n"
ICED = STEEL.replace("density = 7850.0\nprestress = 100e3\n", "breaking_load = 90e3\n")
ICED += f"[group.bar]\nkind = 'bar'\ndensity = {300 / 683.08e-6}\n"
ICED += f"[group.cable]\ndensity = {200 / 683.08e-6}\ndiameter = '40 mm'\n"
ICED += "[load]\nsteps = 0\nice = '10 mm'\n[[case]]\nname = 'ice'\nset = {'load.ice' = '50 mm'}\n"
ICED += "[combinations]\nmore = {permanent = 1.35, load = 1.2, ice = 0.5}\nless = {permanent = 0.9}\n"


def test_the_force_of_a_check_is_that_of_the_end_of_an_element(workshop):
    """The force is that of the foundation: the middle of the element has half of its weight less.

    By hand for `more`: 1.35 x 200 g 10 m + 1.2 (10 kN + ice of 10 mm) + 0.5 (ice of 50 mm - ice of 10 mm).
    """
    with workshop.solve(ICED, UPRIGHT, HEAVY) as f:
        envelope = compute_envelope(f, end_weights(f))
    report, g = workshop.report(), 9.81
    foundation = {(row["stage"], row["node"]): float(row["foundation_z"]) for row in report.rows("reactions")}
    names = "permanent loads", "case ice", "combination more", "combination less"
    for name, high, low in zip(envelope.names, envelope.high, envelope.low):
        if name in names:
            assert [high[0], -low[1]] == pytest.approx([-foundation[name, k] for k in "13"], rel=1e-6), name
    thin, thick = (900.0 * np.pi * (0.04 * t + t * t) * 10.0 * g for t in (0.01, 0.05))
    by_hand = 1.35 * 2000.0 * g + 1.2 * (1e4 + thin) + 0.5 * (thick - thin)
    row = next(row for row in report.rows("checks") if row["group"] == "cable" and row["check"] == "en1993")
    assert row["case"] == "combination more" and float(row["N_Ed"]) == pytest.approx(by_hand, rel=2e-5)


def test_the_force_at_an_end_includes_half_of_the_line_load(workshop):
    """The force is that of the foundation, in a stage, a case and combinations, with tables of all."""
    for name, line in (("own", -100), ("stage", -300), ("case", -700)):
        (workshop.folder / f"{name}.csv").write_text(f"element,line_z\n1,{line}\n2,{2 * line}\n")
    text = ICED.replace("ice = '10 mm'", "load_table = 'own.csv'")
    text = text.replace("set = {'load.ice' = '50 mm'}", "load_table = 'case.csv'")
    stages = '[[stage]]\nname = "a"\nload_table = "stage.csv"\n[[stage]]\nname = "b"\n'
    stages += 'set = {"load.dead" = 0.0}\n[[stage]]\nname = "c"\nload_table = "none"\n'
    with workshop.solve(text + "all = {load = -0.3, prestress = 0.7}\n" + stages, UPRIGHT, HEAVY) as f:
        envelope = compute_envelope(f, end_weights(f))
    rows = {(row["stage"], row["node"]): row for row in workshop.report().rows("reactions")}
    assert [name for name in envelope.names if name.startswith("stage")] == ["stage a", "stage b", "stage c"]
    for name, high, low in zip(envelope.names, envelope.high, envelope.low):
        expected = [abs(float(rows[name, node]["foundation_z"])) for node in "13"]
        assert [max(high[0], -low[0]), -low[1]] == pytest.approx(expected, rel=1e-5), name


@pytest.mark.parametrize("form", ["", '[form_finding]\nmethod = "given_geometry"\n'])
def test_neither_stages_of_erection_nor_the_form_before_them_count_in_service(workshop, form):
    """The structure is never in the state of that form. The first state is a stage, or the form."""
    text = CASES + form + '[combinations]\n"B" = {kind = "SLS", snow = 1.0}\n[[stage]]\nname = "lift"\n'
    in_service = "\nOf kind SLS. The largest tension of each element in: permanent loads; combination B.\n"
    assert in_service in solved(workshop, text, ROOFED).page


def test_the_largest_tension_excludes_a_form_before_stages_of_erection(workshop):
    """The structure is never in that form, here with twice the prestress of the net that is lifted."""
    lift = '[[stage]]\nname = "lift"\nset = {"load.temperature" = 60.0}\n'
    text = CASES + '[form_finding]\nmethod = "given_geometry"\n' + lift
    with workshop.solve(text, ROOFED, ELEMENTS.format(ROWS)) as f:
        N = np.array([f[f"{place}/tension"][:] for place in equilibrium_groups(f)])
        assert (f["form_finding/tension"][:] > N.max(0)).any()
    rows = workshop.report().rows("elements")
    assert [float(row["tension_max"]) for row in rows] == pytest.approx(N.max(0), rel=1e-3)
    assert "form" not in {row["case_max"] for row in rows}


@pytest.mark.parametrize("form", ["", '[form_finding]\nmethod = "given_geometry"\n'])
@pytest.mark.parametrize("stages", [1, 2])
def test_stages_of_erection_have_the_stress_limit_of_construction(workshop, form, stages):
    """EN 1993-1-11, 7.2 allows 0.55 F_uk, and 0.45 F_uk in service, which begins with the last stage."""
    lift = '[[stage]]\nname = "lift"\nset = {"load.snow" = 23e3}\n'
    done = '[[stage]]\nname = "done"\nset = {"load.snow" = 0.0}\n' * (stages - 1)
    with workshop.solve(CASES + form + lift + done, ROOFED, ELEMENTS.format(ROWS)) as f:
        N = f["stages/lift/tension"][:].max()
    report = workshop.report()
    rows = {row["check"]: row for row in report.rows("checks") if row["group"] == "upper"}
    share = N / (0.55 * 240e3)
    assert float(rows["en1993_erection"]["utilisation"]) == pytest.approx(share, rel=1e-9) and share > 1.0
    assert rows["en1993_erection"]["case"] == "stage lift" and "en1993_erection FAILS" in report.page
    last = f"stage lift{'; stage done' * (stages - 1)}".split("; ")[-1]
    in_service = f"Of kind SLS. The largest tension of each element in: {last}; permanent loads; case snow;"
    assert in_service in report.page
    lifted = "; ".join(["stage lift", "stage done"][:stages])
    assert f"Of kind ULS. The largest tension of each element in: {lifted}; permanent" in report.page
    assert f"Of kind erection. The largest tension of each element in: {lifted}.\n" in report.page


@pytest.mark.parametrize("stage", ["", '[[stage]]\nname = "lift"\n'])
def test_the_report_states_that_stages_of_erection_have_no_partial_factors(workshop, stage):
    """The remark follows the states of an ultimate check, also of a job with combinations of kind ULS."""
    combinations = '[combinations]\n"A" = {permanent = 1.35, snow = 1.5}\n'
    page = solved(workshop, CASES + combinations + stage, ROOFED).page
    assert ("stage lift; permanent loads" in page) == bool(stage)
    assert ("**Loads in stages of erection count as the job gives" in page) == bool(stage)


@pytest.mark.parametrize(
    "motion", ["", "[dynamics]\nduration = 0.5\n[[remove]]\nelements = [2]\ntime = 0.1\n"]
)
def test_the_utilisation_of_a_sample_is_that_at_the_ends_of_elements(workshop, motion):
    """It was that in their middle, which lacks half of weight, ice and line load: 0.34 in place of 0.57."""
    for name in ("own", "case"):
        (workshop.folder / f"{name}.csv").write_text("element,line_z\n1,-1e3\n2,-1e3\n")
    text = ICED.replace("name = 'ice'\n", "name = 'ice'\nload_table = 'case.csv'\n").partition(
        "[combinations]"
    )[0]
    job = workshop.job(text.replace("[[case]]", 'load_table = "own.csv"\n[[case]]') + motion, UPRIGHT, HEAVY)
    with workshop.run(job) as f:
        envelope = compute_envelope(f, end_weights(f))
    sample = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache(1))
    places = ("", "removal") if motion else ("permanent", "cases/ice")
    high = [high[0] for place, high in zip(envelope.places, envelope.high) if place in places]
    assert sample["utilisation_max"] == pytest.approx(max(high) / 90e3, rel=1e-12)
    assert max(high) > sample["tension_max"] + 0.5 * 10.0 * 200.0 * 9.81
    breaking = sample["tension_max"] / 90e3 if motion else sample["utilisation_max"]  # the middle breaks
    assert sample["utilisation_before_break"] == pytest.approx(breaking, rel=1e-12)


def test_the_force_at_an_end_has_the_share_of_line_load_and_ice_of_its_load_step(workshop):
    """It is that of the foundation in each step; the permanent state has neither line load nor ice."""
    (workshop.folder / "own.csv").write_text("element,line_z\n1,-700\n2,-900\n")
    text = ICED.split("[[case]]")[0].replace("steps = 0", "load_table = 'own.csv'\nsteps = 2")
    with workshop.solve(text, UPRIGHT, HEAVY) as f:
        envelope = compute_envelope(f, end_weights(f))
    rows = {(row["stage"], row["node"]): row for row in workshop.report().rows("reactions")}
    for name, high, low in list(zip(envelope.names, envelope.high, envelope.low))[1:]:
        wanted = [abs(float(rows[name, node]["foundation_z"])) for node in "13"]
        assert [high[0], -low[1]] == pytest.approx(wanted, rel=1e-5), name


# Snow of 200 kN on node 5, by factors; [limits] apply to combinations of kind service only.
SERVICE = {"light": (0.25, "SLS"), "heavy": (0.75, "SLS"), "lift": (-0.5, "SLS")}
KINDS_OF = SERVICE | {"more": (1.0, "ULS"), "most": (1.5, "ULS")}
LIMITED = CASES.split("[[case]]")[0] + "[limits]\ndisplacement = '2 mm'\n"
LIMITED += '[[case]]\nname = "snow"\nset = {"load.snow" = 20e3}\n' + "".join(
    f'[[combination]]\nname = "{name}"\nfactors = {{snow = {factor}}}\nkind = "{kind}"\n'
    for name, (factor, kind) in KINDS_OF.items()
)


def three_cables(load: float) -> tuple[float, float, float]:
    """Return the displacement of node 5 under a load [N] and the tensions [N] of upper and lower cables."""
    upper = lambda w: EA * max(0.0, np.hypot(3, 4 + w) / 5 * (1 + 50e3 / EA) - 1)
    lower = lambda w: EA * max(0.0, (4 - w) / 4 * (1 + 80e3 / EA) - 1)
    rest = lambda w: 2 * upper(w) * (4 + w) / np.hypot(3, 4 + w) - lower(w) - load
    w = brentq(rest, -0.1, 0.1, xtol=1e-15)
    return w, upper(w), lower(w)


def test_service_has_limits_and_each_kind_has_its_checks(workshop):
    """200 kN times factors. ULS: 300 kN on two cables, 188 of 160 kN. SLS of 150 kN: 97 of 108 kN, but 2.2 of
    2 mm; lifted by 100 kN the lower cable has 129 kN, which no ULS check contains.
    """
    report = solved(workshop, LIMITED, ROOFED)
    hand = {name: three_cables(200e3 * factor) for name, (factor, _) in KINDS_OF.items()}
    checks = {(row["check"], row["group"]): row for row in report.rows("checks")}
    for check, group, case, N, result in (
        ("en1993", "upper", "combination most", hand["most"][1], "FAILS"),
        ("en1993", "lower", "as given", 80e3, ""),
        ("en1993_service", "upper", "combination heavy", hand["heavy"][1], "passes"),
        ("en1993_service", "lower", "combination lift", hand["lift"][2], ""),
    ):
        row = checks[check, group]
        assert (row["case"], row["result"]) == (case, result)
        assert float(row["N_Ed"]) == pytest.approx(N, rel=1e-8)
    assert hand["heavy"][1] < 0.45 * 240e3 < hand["more"][1] < 160e3 < hand["most"][1]
    page = report.page.split("## Limits in service")[1].split("\n## ")[0]
    matches = re.findall(
        r"^\| (\w+) \| displacement from permanent \| (.+) mm \| node 5 \| 2 mm \| \W*(\w+)", page, re.M
    )
    results = {"heavy": "FAILS", "light": "passes", "lift": "passes"}
    assert matches == [(name, f"{1e3 * abs(hand[name][0]):.4g}", result) for name, result in results.items()]
    reactions = report.rows("reactions")
    for name, (factor, _) in KINDS_OF.items():
        own_rows = [row for row in reactions if row["stage"] == f"combination {name}"]
        sums = [sum(column(own_rows, f"foundation_{axis}")) for axis in "xyz"]
        total = 12 * 20e3 * factor  # 10 m2 at node 5, 2 m2 on a support
        assert sums == pytest.approx([0, 0, -total], rel=0, abs=1e-9 * abs(total))


def test_each_check_names_the_worst_of_each_group_and_equal_ones(snowed):
    """Both upper cables share a row; their force in the heavier case over F_uk / 1.5 = 160 kN."""
    states, folder = snowed
    rows = [row for row in rows_of(folder / "checks.csv") if row["check"] == "en1993"]
    assert [rows[0][name] for name in ("group", "alike", "case")] == ["upper", "2", "case much"]
    N = states["much"][0][0]
    assert float(rows[0]["N_Ed"]) == pytest.approx(N, rel=1e-11) and float(rows[0]["N_Rd"]) == 160e3
    assert float(rows[0]["utilisation"]) == pytest.approx(N / 160e3, rel=1e-11)
    assert rows[0]["result"] == "passes" and rows[1]["utilisation"] == rows[1]["result"] == ""


def test_the_parts_of_a_subdivided_cable_count_as_one(workshop):
    """The heavier case governs the two equal upper cables, the start the lower one."""
    report = solved(workshop, "subdivide = 3\n" + CASES, ROOFED)
    assert [row["alike"] for row in report.rows("checks")] == ["2", "1"] * 3
    (table,) = (part for part in report.page.split("\n\n") if "governs elements" in part)
    assert [row.split("|")[3].strip() for row in table.splitlines()[2:]] == ["1", "0", "0", "2"]


def test_the_shop_list_is_that_by_hand(loaded, tmp_path):
    """Equal cables share a row, less rigid ends of 750 mm, measured 15 K warmer without load; or whole."""
    table = tmp_path / "ends.csv"
    table.write_text("group,pin,socket\nlower,,\n,100,650\n")  # the first matching row applies
    upper, lower = report_of(loaded, cutting=Cutting(15.0, 0.0), deductions=table).rows("shop_list")
    assert (upper["mark"], upper["count"], upper["cables"]) == ("upper-1", "2", "e11; e12")
    heat = 1 + 12e-6 * 15
    cut, ends = 3500 / (1 + 50e3 / EA) * heat, 1500 * heat
    lengths = [float(upper[name]) for name in ("length_node_to_node", "length_pin_to_pin", "cut_length")]
    assert lengths == pytest.approx([cut + ends, cut + ends - 200 * heat, cut], abs=0.05)  # mm
    assert all(len(upper[name].partition(".")[2]) <= 1 for name in upper if "length" in name)
    assert float(upper["mass"]) == pytest.approx(683.08e-6 * 7850 * 3.5 / (1 + 50e3 / EA), abs=0.005)
    assert upper["measuring_load"] == "0"
    assert lower["cut_length"] == lower["length_node_to_node"] and lower["clamps"] == ""
    table.write_text("group,socket\nuper,50\nupper,2600\n")
    done = run_on_standing_ranks("report", "result.vtkhdf", "--deductions", table, cwd=loaded, code=2)
    assert "line 2: group = 'uper': no such group" in done.stderr
    table.write_text("group,socket\nupper,2600\n")
    done = run_on_standing_ranks("report", "result.vtkhdf", "--deductions", table, cwd=loaded, code=2)
    assert "cable e11 (upper) of 5000 mm: 2600 and 2600 mm at its ends" in done.stderr


def test_bars_are_made_to_their_length_without_load(workshop):
    """A strut of 10 m under 500 kN of compression, EA = 200 MN, is made 10 m / (1 - 500e3 / 200e6) long."""
    text = '[cable]\nkind = "bar"\nmodulus = 2e11\narea = 1e-3\ndensity = 7850\nprestress = -500e3\n'
    nodes, elements = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,10,1\n", "start,end\n1,2\n"
    (piece,) = solved(workshop, text + STEP, nodes, elements).rows("shop_list")
    assert (piece["cut_length"], piece["measuring_load"]) == ("10025.1", "0")


def test_cables_of_one_length_are_equal_only_with_equal_force_section_and_expansion(workshop):
    """20 m under 200, 40, 40 and 40 kN in 400 mm2, and under 40 kN in 200 mm2: L0 = 20 m / (1 + N / EA)."""
    nodes = "id,x,y,z,fixed\n" + "".join(f"{k},{k % 2 * 20},{k // 2},0,1\n" for k in range(10))
    kinds = [(4e-4, 200e3, 12e-6), *[(4e-4, 40e3, 12e-6)] * 2, (4e-4, 40e3, 16e-6), (2e-4, 40e3, 12e-6)]
    elements = "id,start,end,area,prestress,expansion\n" + "".join(
        f"{k},{2 * k},{2 * k + 1},{area},{N},{expansion}\n" for k, (area, N, expansion) in enumerate(kinds)
    )
    text = "[cable]\nmodulus = 160e9\ndensity = 8000\n" + STEP
    rows = solved(workshop, text, nodes, elements).rows("shop_list")
    assert [row["cables"] for row in rows] == ["e0", "e1; e2", "e3", "e4"]
    assert {row["cut_length"] for row in rows} == {"20000"}
    forces = (2e5, 64e6), (4e4, 64e6), (4e4, 64e6), (4e4, 32e6)
    masses = [20 / (1 + N / EA) * EA * 8000 / 160e9 for N, EA in forces]
    assert column(rows, "mass") == pytest.approx(masses, abs=0.005)


def test_the_shop_list_has_clamps_and_types_of_the_table(workshop, tmp_path):
    """A cable of 2 + 3 m less 1 and 0.5 m has a clamp, also with `subdivide`; each end has its type."""
    types = write_types(workshop.folder, f"A,5,{EA},1e6", f"B,3,{EA},1e6")
    table = tmp_path / "ends.csv"
    table.write_text("type,pin,socket\nA,700,300\nB,400,100\n")
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,2,0,0,0\n3,5,0,0,1\n"
    elements = "id,start,end,group,prestress,type\n7,1,2,main,50e3,A\n8,2,3,main,50e3,B\n"
    text = "subdivide = 3\n" + STATICS.replace("[cable]\n", "[cable]\n" + types)
    (row,) = solved(workshop, text, nodes, elements, deductions=table).rows("shop_list")
    words = [row[name] for name in ("type", "length_pin_to_pin", "cut_length", "clamps")]
    assert words == ["A + B", "3900", "3500", "1000.0"]
    assert float(row["mass"]) == pytest.approx((1.0 * 5 + 2.5 * 3) / (1 + 50e3 / EA), abs=0.005)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4, 5), (5, 1, 4, 0, 3, 2)])
def test_the_shop_list_does_not_depend_on_the_order_of_rows(workshop, order):
    """A cable of 2 + 3 m and its mirror image are one piece, marked from the node of the smaller id."""
    nodes = ["1,0,0,0,1", "2,2,0,0,0", "3,5,0,0,1", "4,0,1,0,1", "5,3,1,0,0", "6,5,1,0,1"]
    rows = ["1,1,2,b,A", "2,2,3,b,B", "3,4,5,b,B", "4,5,6,b,A", "5,1,4,a,A", "6,3,6,c,A"]
    types = write_types(workshop.folder, f"A,5,{EA},1e6", f"B,5,{EA},1e6")
    tables = ["\n".join([rows[k] for k in order]) for rows in (nodes, rows)]
    text = STATICS.replace("[cable]\n", f"[cable]\n{types}prestress = 5e3\n")
    tables = f"id,x,y,z,fixed\n{tables[0]}", f"id,start,end,group,type\n{tables[1]}"
    pieces = solved(workshop, text, *tables).rows("shop_list")
    shown = [tuple(row[name] for name in ("mark", "type", "clamps", "cables")) for row in pieces]
    assert shown == [("b-1", "A + B", "2000.0", "e1; e3"), ("a-1", "A", "", "e5"), ("c-1", "A", "", "e6")]


def test_a_table_of_other_columns_gives_no_deductions(loaded):
    """A table without group and type, or pin and socket, is refused. Unknown columns are ignored."""
    table = loaded / "ends.csv"
    table.write_text("name,x\nupper,100\n")
    done = run_on_standing_ranks("report", "result.vtkhdf", "--deductions", "ends.csv", cwd=loaded, code=2)
    assert "ends.csv: columns group and type: missing. Give one of them. [E128]" in done.stderr
    assert "ends.csv: columns pin and socket: missing. Give one of them. [E128]" in done.stderr
    table.write_text("group,pin,remark\nupper,100,x\n")
    done = run_on_standing_ranks("report", "result.vtkhdf", "--deductions", "ends.csv", cwd=loaded)
    assert 'which netfall ignores: "remark"' in done.stdout and "\n1 warning (W845;" in done.stdout


def test_the_shop_list_has_no_concrete(workshop):
    """A ring of 33 GPa and 2500 kg/m3 is cast. Steel posts and aluminium masts are manufactured."""
    bars = {"ring": (33e9, 2500.0), "post": (2.1e11, 7850.0), "mast": (7e10, 2700.0)}
    groups = "".join(
        f'[group.{name}]\nkind = "bar"\nmodulus = {E}\ndensity = {rho}\n' for name, (E, rho) in bars.items()
    )
    rows = "".join(f"{k},{name}\n" for k, name in enumerate(["5,1,ring", "5,2,post", "5,3,mast"]))
    elements = "id,start,end,group\n" + rows
    report = solved(workshop, STATICS.replace("[load]", groups + "[load]"), elements=elements)
    assert {row["group"] for row in report.rows("shop_list")} == {"post", "mast"}
    assert len(report.rows("cutting_list")) == 3
    assert "Without members of concrete: ring." in report.page


def test_elements_at_a_limit_are_in_one_table():
    """One warning for each limit, for any number of equilibria, and a row for each of them."""
    states = [("case a", {"beyond_euler": [7, 9]}), ("case b", {}), ("case long", {"beyond_euler": [9]})]
    warning, *rows = [*limit_warnings(*states, ("case d", {"yielding": [1]}))][:3]
    assert warning.startswith(
        "warning: 2 of 4 equilibria: 2 elements (7, 9): compression above the Euler load"
    )
    assert rows == ["    case a     2 elements (7, 9)", "    case long  element 9"]
    (single,) = limit_warnings(*states[:2])
    assert single.startswith("warning: case a: 2 elements (7, 9): compression above")


def test_clamps_are_marked_along_a_cable_from_either_end():
    """A cable of three segments and its mirror image are equal; a ring has no ends."""
    ends = np.array([[4, 3], [1, 2], [2, 3], [7, 8], [8, 9], [9, 7]])
    chain = order_elements(ends, np.array([0, 1, 2]))
    assert chain.elements.tolist() == [1, 2, 0] and chain.in_order and not chain.closed
    ring = order_elements(ends, np.array([3, 4, 5]))
    assert ring.elements.tolist() in ([3, 4, 5], [3, 5, 4]) and ring.closed
    lengths, section = [6.0] * 4, np.ones((3, 2))
    piece = lambda marks: Piece(0, "", "", chain, *lengths, *[np.array(marks)] * 2, section, 0.0, 1.0)
    assert piece([1.0, 3.0]).alike(piece([3.0, 5.0])) and not piece([1.0, 3.0]).alike(piece([1.0, 4.0]))


def test_the_page_is_self_contained(snowed):
    """The page refers to no other file. Pictures are those of the folder, the text is that of summary.md."""
    page, text = ((snowed[1] / name).read_text() for name in ("report.html", "summary.md"))
    sources = re.findall(r'(?:src|href|url)\s*[=(]\s*"?([^">)]{0,30})', page)
    assert len(sources) == 2 and all(source.startswith("data:image/png;base64,") for source in sources)
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert page.count("<table") == page.count('width="100%"') > 5  # as a word processor wants it
    for title in re.findall(r"^## (.+)$", text, re.M):
        assert f"<h2>{title}</h2>" in page
    pictures = {
        b64encode((snowed[1] / f"{name}.png").read_bytes()).decode() for name in ("utilisation", "states")
    }
    assert set(re.findall(r"base64,([A-Za-z0-9+/=]+)", page)) == pictures


BREAKS = "[dynamics]\nduration = 0.05\n[output]\nframes = 5\n"


def test_a_support_whose_cable_tore_off_carries_nothing(workshop):
    """The upper cables break at their supports under 200 kN. Then only the lower one acts."""
    section = STATICS.partition("[load]")[0]
    nodes = NODES.replace("load_z\n", "load_z,mass\n").replace("200e3", "200e3,100")
    nodes = nodes.replace("1,0\n", "1,0,0\n")
    with workshop.solve(section + BREAKS, nodes, ELEMENTS.format(ROWS.replace("240e3", "100e3"))) as f:
        ends = f["events/new_particle"][:] - 4 - 2 * f["events/element"][:]
        torn = sorted(set(zip(f["events/element"][:].tolist(), ends.tolist())))
        assert torn == [(0, 0), (1, 0)]  # at their starts, nodes 1 and 2
    report = workshop.report()
    rows = [row for row in report.rows("reactions") if row["stage"].startswith("final")]
    assert column(rows[:2], "force") == [0.0, 0.0] and [row["node"] for row in rows] == ["1", "2", "3"]
    cables, text = report.rows("cables"), report.page
    assert all(float(row["broken_at"]) > 0 for row in cables[:2]) and cables[2]["broken_at"] == ""
    assert [row["slack_in"] for row in cables[:2]] == ["", ""]  # broken, and so not slack
    assert "Cables with an element that was removed or broke: 2" in text and "| e12 | upper |  | 0." in text
    with h5py.File(workshop.folder / "result.vtkhdf", "r+") as f:
        moved = f["envelope/displacement_max"][:]
        assert moved.argmax() == 3
        assert f"in motion, from the net as given: {1e3 * moved[3]:.4g} mm at node 5" in text
        tensions = {"tension_max": [99e3, 98e3, 81e3], "tension_min": [0.0, 0.0, 0.0]}
        times = {"tension_max_time": [0.011, 0.012, 0.013], "slack_time": [0.0, 0.0, 0.02]}
        for name, values in (tensions | times).items():
            f[f"envelope/{name}"][:] = values
    assert column(report.rows("displacements"), "dynamics") == pytest.approx(moved, rel=1e-11)
    cables = workshop.report().rows("cables")
    assert column(cables, "tension_max") == [99e3, 98e3, 81e3]
    assert column(cables, "time_max") == [0.011, 0.012, 0.013] and cables[0]["case_max"] == "dynamics"
    assert column(report.rows("elements"), "slack_time") == [0.0, 0.0, 0.02]


def test_the_report_is_next_to_the_result_and_replaces_no_other_file(loaded):
    options = "--measuring-load", "60e3", "--temperature", "-20"  # a negative change is a number too
    done = run_on_standing_ranks("report", "result.vtkhdf", *options, cwd=loaded)
    names = [
        *("summary.md", "report.html", "cases.csv", "checks.csv", "cables.csv", "elements.csv", "forces.csv"),
        *("displacements.csv", "reactions.csv", "cutting_list.csv", "shop_list.csv", "utilisation.png"),
        "states.png",
    ]
    written, warning = done.stdout.splitlines()[: len(names)], done.stdout.splitlines()[len(names) :]
    assert written == [f"result-report/{name}" for name in names]
    assert warning[0].startswith("warning: checks: element 13") and warning[1].startswith("1 warning (W845;")
    catalogue = "name,mass_per_length,axial_stiffness,breaking_load\nFLC40,8.9,1.77e8,1.52e6\n"
    (loaded / "cables.csv").write_text(catalogue)
    error = refused("report", "result.vtkhdf", "-o", ".", cwd=loaded)
    assert "cables.csv: exists and is not a table of a report" in error
    assert (loaded / "cables.csv").read_text() == catalogue and not (loaded / "summary.md").exists()


def test_the_page_describes_each_table(loaded, snowed):
    """A table that the page does not name would not be read."""
    for folder in (report_of(loaded).folder, snowed[1]):
        page = (folder / "summary.md").read_text()
        names = [path.name for path in folder.glob("*.csv")]
        assert names and [name for name in names if f"- `{name}`: " not in page] == []


def test_a_report_removes_what_only_an_earlier_one_has(loaded):
    """Moments of an earlier run must not pass for those of this one. Files of the user remain."""
    folder = report_of(loaded).folder
    for name in ("moments.csv", "slides.csv", "stages.png"):
        (folder / name).write_text("element,group,node,case\n")
    (folder / "form.png").write_bytes(MARK)
    names = {path.name for path in report_of(loaded).folder.iterdir()}
    assert not names & {"moments.csv", "form.png"} and {"slides.csv", "stages.png"} <= names


@pytest.mark.parametrize(
    "option, value, message",
    [
        ("--measuring-load", "nan", "nan: expected a tension >= 0 in N"),
        ("--measuring-load", "-5000", "-5000: expected a tension >= 0 in N"),
        ("--temperature", "inf", "inf: expected a change of temperature from -273 to 1000 K"),
        ("--deductions", "none.csv", "--deductions none.csv: no such file; give the path"),
    ],
)
def test_the_measuring_load_is_a_number_or_a_table(loaded, option, value, message):
    assert message in refused("report", "result.vtkhdf", option, value, cwd=loaded)


def test_a_cable_of_several_sections_names_them_all(workshop):
    """Two straight halves of 3 and 5 kg/m are one cable with both types, and the mass of each."""
    types = write_types(workshop.folder, "thin,3.0,4e7,3e5", "thick,5.0,8e7,6e5")
    nodes = "id,x,y,z,fixed\n0,0,0,0,1\n1,4,0,0,0\n2,10,0,0,1\n"
    elements = "start,end,type,cable,group\n0,1,thin,stay,low\n1,2,thick,stay,high\n"
    with workshop.solve(f"[cable]\n{types}prestress = 1e5\n", nodes, elements) as f:
        columns = cutting_columns(f, Cutting())
    assert columns["type"].tolist() == ["thick + thin"] and columns["group"].tolist() == ["high + low"]
    lengths = 4.0 / (1 + 1e5 / 4e7), 6.0 / (1 + 1e5 / 8e7)
    assert columns["unstressed_length"] == pytest.approx(sum(lengths), rel=1e-12)
    assert columns["mass"] == pytest.approx(3.0 * lengths[0] + 5.0 * lengths[1], rel=1e-12)


def test_no_check_passes_with_an_unstable_equilibrium(workshop):
    """A post of 4 m under 50 kN between cables of 5 m and 1 kN: 2 x 1 / 5 - 50 / 4 kN/m across it."""
    nodes = "id,x,y,z,fixed,load_z\n1,-5,0,4,1,\n2,5,0,4,1,\n3,0,0,0,1,\n4,0,0,4,0,{}\n"
    rows = "1,1,4,stay,1e3,240e3\n2,4,2,stay,1e3,240e3\n3,3,4,post,0,\n"
    text = STATICS + '[group.post]\nkind = "bar"\narea = 0.01\nsecond_moment = 1e-3\n'
    erected = text.replace("steps = 1", "steps = 0") + '[[stage]]\nname = "last"\n'
    loads = ("-50e3", "not stable"), ("-1e3", "passes")
    for (load, result), (job, what) in product(loads, ((text, "statics"), (erected, "stage last"))):
        report = solved(workshop, job, nodes.format(load), ELEMENTS.format(rows))
        page, results = report.page, {row["result"] for row in report.rows("checks") if row["utilisation"]}
        for table in map(report.rows, ("elements", "cables")):
            checks = [name.removeprefix("result_") for name in table[0] if name.startswith("result_")]
            results |= {
                row[f"result_{each}"] for each in checks for row in table if row[f"utilisation_{each}"]
            }
        assert results == {result} and (f"**FAILS: {what} is not stable.**" in page) == (load == "-50e3")
        assert ("unstable equilibrium: compressed bars buckle" in page) == (load == "-50e3")
        assert ("cables that fail: 0, not stable: 1, without value: 1" in page) == (load == "-50e3")


def test_notes_of_a_run_are_in_its_result_and_report(workshop):
    """80 kN from above and 60 kN from below: 20 kN are unbalanced as given; none with 80 kN."""
    off = "net as given: not in equilibrium with its prestress: largest residual 20 kN, largest "
    for lower, is_noted in (("60e3", True), ("80e3", False)):
        page = solved(workshop, STATICS, elements=GIVEN_ROWS.replace("80e3", lower)).page
        assert (f"warning: {off}" in workshop.info(), f"- **warning: {off}" in page) == (is_noted, is_noted)


def test_cables_are_slack_in_a_case_of_any_name(workshop):
    """The page separates names of states by semicolons, which may be part of a name."""
    text = BARE.replace("[cable]", "[cable]\nprestress = 20e3") + "[load]\nself_weight = false\n"
    text += "[[case]]\nname = 'wind; up'\nload_table = 'up.csv'\n"
    (workshop.folder / "up.csv").write_text("node,load_z\n2,-100e3\n")
    nodes = "id,x,y,z,fixed\n1,0,0,10,1\n2,0,0,5,0\n3,0,0,0,1\n"
    assert "| e1 |  | case wind; up |\n" in solved(workshop, text, nodes, "id,start,end\n1,1,2\n2,2,3\n").page


def test_the_picture_names_checks_that_it_does_not_show(workshop, monkeypatch):
    """50 kN of 100 kN: 0.75 of the resistance of EN 1993-1-11 for ultimate loads, 1.11 in service. Without
    ultimate loads no check counts.
    """
    titles = []
    draw = utilisation._draw
    shown = []
    draw_noted = lambda *given: (shown.append(given[1].tolist()), titles.append(given[3:5])) and draw(*given)
    monkeypatch.setattr(utilisation, "_draw", draw_noted)
    for loads in ("steps = 1\n", 'steps = 0\n[combinations]\nservice = {kind = "SLS", load = 1.0}\n'):
        text = f"breaking_load = 100e3\n[load]\nself_weight = false\n{loads}"
        hung(workshop, text, 50e3, pictures=True)
    assert "en1993 (besides, 1 fail en1993_service, 1 fail asce19);" in titles[0][1]
    assert shown[0] == pytest.approx([50.0 / 45.0])  # in the colour of what fails
    assert [title for title, _ in titles] == [
        "how far elements are used",
        "how far elements are used (NOT VERIFIED: not checked)",
    ]


@pytest.mark.parametrize(
    ("strength", "warns"),
    [
        ("yield_stress = 1e9", True),
        ("yield_stress = 1e9\nfracture_strain = 0.05\nbreaking_load = 120e3", False),
        ('yield_stress = 1e9\nkind = "bar"', False),
    ],
)
def test_a_check_against_the_yield_force_alone_is_a_warning(workshop, strength, warns):
    """90 kN of 100 kN: 0.9 of the yield force, but 1.13 of 120 kN over 1.5."""
    report = hung(workshop, f"{strength}\n{STEP}", 90e3)
    (row,) = [row for row in report.rows("checks") if row["check"] == "en1993"]
    has_strength = "breaking_load" in strength
    assert float(row["utilisation"]) == pytest.approx(1.125 if has_strength else 0.9, rel=1e-6)
    assert ("warning: checks: element 7: cables without breaking_load" in report.page) == warns


@pytest.mark.parametrize("more", ["", '[[stage]]\nname = "a"\nactive = ["present"]\n'], ids=["", "stage"])
@pytest.mark.parametrize(
    ("kind", "prestress", "warns"), [("cable", 1e3, True), ("bar", 1e3, True), ("bar", -1e3, False)]
)
def test_tension_without_a_strength_among_others_is_a_warning(workshop, kind, prestress, warns, more):
    """The tables of checks omit the cable or tie. A strut has no tension, a cable in no stage no force."""
    nodes = "id,x,y,z,fixed\n1,0,0,9,1\n2,0,0,0,1\n3,5,0,0,1\n4,9,0,0,1\n"
    rows = "id,start,end,group,kind,prestress,breaking_load\n7,1,2,present,cable,1e3,100e3\n"
    rows += f"8,1,3,present,{kind},{prestress},\n9,1,4,absent,cable,1e3,{'' if more else '100e3'}\n"
    page = solved(workshop, f"{HUNG}{STEP}{more}", nodes, rows).page
    assert ("warning: checks: element 8: cables without breaking_load, or bars in tension" in page) == warns


def test_yielding_elements_fail_for_any_utilisation(workshop):
    """A yielding cable carries its yield force, here its resistance: 1.000 FAILS. Released, 6 t at its end
    pull with twice their weight; below the yield force it passes.
    """
    cable = "prestress = 0.0\nyield_stress = 1e9\nfracture_strain = 0.5\n"
    falls = "[load]\nself_weight = false\nsteps = 0\n[dynamics]\nduration = 0.3\n"
    results = {}
    seldom = falls + "[output]\nhistory_interval = 0.3\n"  # a row at the start, another after the peak
    stages = (
        ("rest", cable + STEP, 99e3),
        ("falls", cable + falls, 60e3),
        ("seldom", cable + seldom, 60e3),
        ("unbroken", cable.replace("fracture_strain = 0.5\n", "") + seldom, 60e3),
        ("swings", cable + falls, 45e3),
    )
    for what, stage, load in stages:
        report = hung(workshop, stage, load, 6000, folder=what)
        row, of_group = (report.rows(name)[0] for name in ("elements", "checks"))
        assert of_group["result"] == row["result_en1993"]
        assert of_group["utilisation"] == row["utilisation_en1993"]
        results[what] = float(row["utilisation_en1993"]), row["result_en1993"]
    assert results["rest"] == (pytest.approx(0.99, rel=1e-6), "passes")
    assert results["swings"] == (pytest.approx(0.9, rel=1e-2), "passes")  # the mass of the cable, rows
    assert results["falls"] == (pytest.approx(1.0, rel=1e-12), "FAILS")
    assert results["seldom"] == results["unbroken"] == (pytest.approx(1.0, rel=1e-12), "FAILS")
    assert "cables that fail: 1" in (workshop.folder / "falls" / "summary.md").read_text()


def test_a_cable_that_yields_between_two_rows_has_its_yield_force_as_largest(workshop):
    """A gust of 20 ms, within 50 steps, adds 16 kN and vibrations to 80 kN; the cable yields at 100 kN."""
    speeds = "time,speed\n0,10\n0.03,10\n0.04,80\n0.06,80\n0.07,10\n0.2,10\n"
    (workshop.folder / "gust.csv").write_text(speeds)
    nodes = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z,load_z\n1,0,0,9,1,,,,,\n2,0,0,0,0,4,0,0,1,-80e3\n"
    text = f"{HUNG}yield_stress = 1e9\n{STEP}[wind]\nfile = 'gust.csv'\nramp = 0.0\nprofile_exponent = 0.0\n"
    text += "base_height = 10.0\npressure_coefficient = 1.0\n[dynamics]\nduration = 0.2\n"
    text += "[output]\nhistory_interval = 0.2\n"
    (row,) = solved(workshop, text, nodes, "id,start,end\n7,1,2\n").rows("elements")
    assert float(row["tension_max"]) == pytest.approx(100e3) and row["result_en1993"] == "FAILS"


@pytest.mark.parametrize(
    ("strength", "load", "results"),
    [
        ("yield_stress = 1e9", -150e3, {"en1993": "FAILS"}),
        ("yield_stress = 1e9", -90e3, {"en1993": ""}),
        (BUCKLES, -90e3, {"euler": "FAILS", "en1993": "FAILS"}),
        (BUCKLES, -70e3, {"euler": "passes", "en1993": ""}),
        ("breaking_load = 80e3\nfracture_strain = 4e-3", 45e3, {"en1993": "FAILS"}),
        ("breaking_load = 80e3\nfracture_strain = 5e-3", 45e3, {"en1993": "passes"}),
        ("fracture_strain = 4e-3", 45e3, {"en1993": "FAILS"}),
        ("fracture_strain = 5e-3", 45e3, {"en1993": ""}),
    ],
)
def test_elements_above_their_strength_in_statics_fail(workshop, strength, load, results):
    """A bar on a weak spring, at its yield force of 100 kN, its strength of 80 kN, a strain of 0.0043."""
    nodes = f"id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z,load_z\n1,0,0,0,1,1,1,0,0\n2,0,0,4,1,1,0,1e5,{load}\n"
    report = solved(workshop, f'{HUNG}kind = "bar"\n{strength}\n{STEP}', nodes, "id,start,end\n7,1,2\n")
    (row,) = report.rows("elements")
    assert {check: row[f"result_{check}"] for check in results} == results
    assert "**FAILS** |" in report.page or "FAILS" not in results.values()
    assert not re.search(r"\| -\d\.\d+ \(element", report.page)  # a compressed bar is not used in tension


SUCKED = HUNG.replace("1e11", "1.6e11") + "{}[roof]\n[load]\nself_weight = {}\ndead = {}\n"
SUCKED += "[[case]]\nname = 'suction'\nset = {{'load.pressure' = [0.0, 0.0, {}]}}\n"
SAG = "id,x,y,z,fixed,area\n1,-10,0,0,1,0\n2,10,0,0,1,0\n3,0,0,-1,0,10\n", "id,start,end\n1,1,3\n2,3,2\n"


def test_elements_that_yield_under_permanent_loads_fail(workshop):
    """Two cables of 100 kN that sag 1.51 m at their yield force carry 29.8 kN; suction relieves them."""
    for dead, result in ((3.2e3, "FAILS"), (2.2e3, "passes")):
        text = SUCKED.format("yield_stress = 1e9\n", "false", dead, 600.0)
        done = workshop.solve(text, *SAG, code=None)
        is_named = "warning: permanent loads: 2 elements (1, 2): at the yield force." in done.stdout
        report = workshop.report()
        (row,) = (row for row in report.rows("checks") if row["check"] == "en1993")
        assert (row["result"], float(row["utilisation"]) < 1.0) == (result, result == "passes")
        is_listed = "| permanent loads | at the yield force | 2 elements (1, 2) |" in report.page
        assert is_named == is_listed == (result == "FAILS")


def test_elements_above_their_strength_under_permanent_loads_pass_in_erection(workshop):
    """The cables carry nothing in the stage, and 3.2 kN/m2 later."""
    text = SUCKED.format("breaking_load = 1e5\n", "false", 3.2e3, 600.0)
    text += "[[stage]]\nname = 'bare'\nset = {'load.dead' = 10.0}\n"
    results = {row["check"]: row["result"] for row in solved(workshop, text, *SAG).rows("checks")}
    assert (results["en1993"], results["en1993_erection"]) == ("FAILS", "passes")


@pytest.mark.parametrize(("count", "failing"), [(10, 10), (MOST_MARKED, MOST_MARKED + 5)])
def test_unlisted_elements_at_a_limit_count_as_all(count, failing):
    """An attribute lists 4096 elements. The others that yield are unknown."""
    ids = np.arange(MOST_MARKED + 5)
    f = {"net/element_id": ids, "permanent": SimpleNamespace(attrs={"yielding": ids[:count]})}
    assert at_limit_in_permanent_state(f).sum() == failing


SUCTION = '[combinations]\nU = {suction = 1.0}\nS = {kind = "SLS", suction = 1.0}\n'


@pytest.mark.parametrize("combinations", ["", SUCTION])
def test_the_permanent_loads_are_a_state_of_the_checks(workshop, combinations):
    """A cable sags from 1 m under 22 kN of cladding and half its weight; suction of 15 kN relieves it."""
    text = SUCKED.format("breaking_load = 160e3\n", "true\ntolerance = 1e-10", 2200.0, 1500.0) + combinations
    job, L0 = workshop.job(text, *SAG), np.sqrt(101.0)
    own = 9.81 * 7850.0 * 1e-4 * L0  # weight of one element, half of it on node 3, as of the other
    force = lambda sag: 1.6e7 * (np.hypot(10.0, sag) / L0 - 1.0)
    excess = lambda sag: 2.0 * force(sag) * sag / np.hypot(10.0, sag) - 22e3 - own
    sag = brentq(excess, 1.0, 3.0)
    N = force(sag)
    workshop.run(job).close()
    with netfall.Result(workshop.folder / "result.vtkhdf") as result:
        permanent, suction = result.permanent, result.cases["suction"]["tension"]
        assert permanent["tension"] == pytest.approx([N, N], rel=1e-7) and suction.max() < 0.4 * N
        assert permanent["displacement"][2] == pytest.approx([0.0, 0.0, 1.0 - sag], rel=1e-7, abs=1e-9)
        assert permanent["load"][:, 2] == pytest.approx([-own / 2, -own / 2, -22e3 - own], rel=1e-9)
    report = workshop.report()
    assert ("**No combination is of kind ULS: loads " in report.page) == (not combinations)
    assert "**Not passed: en1993_service FAILS (no group); asce19 FAILS (no group).**\n" in report.page
    checks = {row["check"]: row for row in report.rows("checks")}
    for name, share, outcome in (("en1993", 1.5, "passes"), ("en1993_service", 1.0 / 0.45, "FAILS")):
        row = checks[name]
        assert (row["case"], row["result"]) == ("permanent loads", outcome)
        at_end = N + 0.5 * own * sag / np.hypot(10.0, sag)
        assert float(row["utilisation"]) == pytest.approx(share * at_end / 160e3, rel=1e-7)
    feet = [row for row in report.rows("reactions") if row["stage"] == "permanent loads"]
    assert column(feet, "foundation_z") == pytest.approx([-11e3 - own, -11e3 - own], rel=1e-8)
    assert column(report.rows("forces"), "permanent loads") == pytest.approx([N, N], rel=1e-7)
    with workshop.open() as f:
        equilibria = info_of_result(f)["equilibria"]
    assert list(equilibria)[:2] == ["permanent", "cases/suction"]
    assert equilibria["permanent"]["tension_max"] == pytest.approx(N, rel=1e-7)
    sample = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache(1))
    assert sample["utilisation_max"] == pytest.approx(at_end / 160e3, rel=1e-7)


def test_a_check_without_a_state_of_its_kind_does_not_pass(workshop):
    """With combinations of one kind the other checks use the given net and the permanent loads."""
    text = STATICS.replace("steps = 1\n", "") + '[combinations]\nonly = {{kind = "{}", load = 0.5}}\n'
    for kind in ("ULS", "SLS"):
        report = solved(workshop, text.format(kind))
        rows = [row for row in report.rows("checks") if row["utilisation"]]
        results = {(row["kind"] == kind, row["result"]) for row in rows}
        assert results == {(True, "passes"), (False, "not checked")}
        fact = "**NOT CHECKED: there is neither a case nor a combination of this kind, so only as given and "
        assert fact + "permanent loads count.**" in report.page and "No combination is" not in report.page


def test_limits_without_a_combination_of_service_are_not_checked(workshop):
    """Load steps are not combinations: a warning and the page state this, also for limits of groups."""
    text = STATICS + "[limits.group.lower]\ndisplacement = 0.1\n"
    done = workshop.solve(text, NODES, ELEMENTS.format(ROWS), code=None)
    assert "warning: [limits]: not checked: there is no combination of kind" in done.stdout
    assert "\nNot checked: no combination is of kind SLS.\n" in workshop.report().page


def test_states_after_removals_are_accidental_and_not_of_service(workshop):
    """40 kN on two cables, 20 kN each; without one the other has 60 kN at its peak, of 66.7 and 45 kN."""
    text = "[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 1.0\nbreaking_load = 100e3\n[load]\n"
    text += "self_weight = false\n[[remove]]\nelements = [7]\ntime = 0.0\n[dynamics]\nduration = 0.4\n"
    nodes = "id,x,y,z,fixed,load_z,mass\n1,0,0,0,0,-40e3,100\n2,0,0,10,1,,\n3,0,0,5,1,,\n"
    report = solved(workshop, text, nodes, "id,start,end,prestress\n7,1,2,20e3\n9,1,3,20e3\n")
    rows = {row["check"]: (float(row["utilisation"]), row["result"]) for row in report.rows("checks")}
    assert rows["en1993"] == (pytest.approx(60.0 / 66.667, rel=1e-3), "passes")
    assert rows["en1993_service"] == (pytest.approx(20.0 / 45.0, rel=1e-6), "passes")
