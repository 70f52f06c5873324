"""Displacements from the permanent state, their limits by span and group, and loads by case: by hand."""

import re

import numpy as np
import pytest
from conftest import error_lines
from nets import stage
from results import rows_of
from test_report import ELEMENTS, LIMITED, ROOFED, ROWS, column, report_of, three_cables

import netfall
from netfall.geometry.build import build_net
from netfall.job.keys.groups import displacement_limits
from netfall.job.read import read_job
from netfall.post.page.states import select_drawn, shown_series
from netfall.post.plots.states import find_equilibrium, force_words

# Node 5 has 10 m2, node 1 on a support 2 m2: 5 kN/m2 of cladding are 50 kN on node 5, the permanent load.
DEAD, PERMANENT = "load.dead=5e3", 50e3
SHARES = {"light": 0.25, "heavy": 0.75, "lift": -0.5}  # of 200 kN of snow, in service
FROM_FORM = {name: three_cables(PERMANENT + 200e3 * share)[0] for name, share in SHARES.items()}
FROM_PERMANENT = {name: sunk - three_cables(PERMANENT)[0] for name, sunk in FROM_FORM.items()}
FACES = ELEMENTS.format(ROWS)


@pytest.fixture(scope="module")
def dead(shared_workshop):
    """Return the result of three cables with cladding."""
    shared_workshop.solve(LIMITED, ROOFED, FACES, "--set", DEAD, name="dead", output="dead.vtkhdf").close()
    return shared_workshop.folder


def limit_rows(folder, result="dead.vtkhdf") -> list[tuple[str, ...]]:
    """Return rows of the report on limits: combination, quantity, value, node, limit, result."""
    page = report_of(folder, result).page.split("## Limits in service")[1]
    return re.findall(
        r"^\| (\w+) \| (displacement.*?) \| (.+?) mm \| (.+?) \| (.+?) mm \| \W*(\w+)",
        page.split("\n## ")[0],
        re.M,
    )


def test_displacements_are_given_from_the_form_and_from_the_permanent_state(dead):
    """Three cables carry 50 kN, and 50 kN with the snow of each combination, by hand."""
    folder = report_of(dead, "dead.vtkhdf").folder
    moved, cases = rows_of(folder / "displacements.csv"), rows_of(folder / "cases.csv")
    for name in SHARES:
        assert column(moved, f"{name} z")[3] == pytest.approx(-FROM_FORM[name], rel=1e-7)
        computed = column(moved, f"{name}, from permanent z")[3]
        assert computed == pytest.approx(-FROM_PERMANENT[name], rel=1e-7)
        assert column(moved, f"{name}, from permanent")[3] == pytest.approx(abs(computed), rel=1e-11)
        row = next(row for row in cases if (row["case"], row["group"]) == (name, "lower"))
        assert float(row["displacement_max"]) == pytest.approx(abs(FROM_FORM[name]), rel=1e-7)
        assert float(row["from_permanent_max"]) == pytest.approx(abs(computed), rel=1e-9)
        assert row["node_max"] == row["node_from_permanent"] == "5"
    page = (folder / "summary.md").read_text()
    moved = (1e3 * abs(at["heavy"]) for at in (FROM_FORM, FROM_PERMANENT))
    assert " | ".join(f"{size:.1f} mm at node 5" for size in moved) in page
    assert "| largest displacement | from the permanent state |" in page
    assert re.search(r"^\*\*Not passed: .*limits in service FAIL\.\*\*$", page, re.M)


@pytest.mark.parametrize("start, by_hand", [("permanent", FROM_PERMANENT), ("form", FROM_FORM)])
def test_a_displacement_limit_counts_from_the_state_of_the_job(dead, shared_workshop, start, by_hand):
    """The default is the permanent state: 150 kN of snow beyond 50 kN of cladding, or 200 kN in total."""
    job, output = shared_workshop.folder / "dead.toml", f"{start}.vtkhdf"
    shared_workshop.run(job, "--set", DEAD, "--set", f"limits.from={start}", output=output).close()
    rows = {row[0]: row[1:] for row in limit_rows(dead, output)}
    for name, moved in by_hand.items():
        result = "passes" if abs(moved) <= 2e-3 else "FAILS"
        assert rows[name] == (f"displacement from {start}", f"{1e3 * abs(moved):.4g}", "node 5", "2", result)
    if start == "permanent":
        assert sorted(rows.items()) == sorted({row[0]: row[1:] for row in limit_rows(dead)}.items())


def test_a_limit_of_a_group_replaces_the_general_one(workshop):
    """6 m / 4000 = 1.5 mm in general, 9 m / 4000 = 2.25 mm for a group; or for the group alone."""
    text = LIMITED.replace("displacement = '2 mm'", "displacement = 'span/4000'\nspan = 6.0")
    text = text.replace("[[case]]", "[limits.group.lower]\nspan = '9 m'\n[[case]]", 1)
    job = workshop.job(text, ROOFED, FACES)
    workshop.run(job).close()
    moved = three_cables(150e3)[0]
    heavy = [row[1:] for row in limit_rows(workshop.folder, "result.vtkhdf") if row[0] == "heavy"]
    assert set(heavy) == {
        ("displacement of lower from permanent", f"{1e3 * moved:.4g}", "node 5", "2.25", "passes"),
        ("displacement from permanent", "0", "node 1", "1.5", "passes"),  # nodes of no such group
    }
    limits = read_job(job, ["limits.group.upper.displacement='3 mm'"]).limits
    assert displacement_limits(limits, ["lower", "upper"]) == {"": 1.5e-3, "lower": 2.25e-3, "upper": 3e-3}


def test_a_group_without_keys_has_the_general_limit(workshop):
    """Node 5 belongs to both groups, so the larger limit of one does not replace that of the other."""
    text = LIMITED.replace("displacement = '2 mm'", "displacement = '1.5 mm'")
    text = text.replace(
        "[[case]]", "[limits.group.lower]\ndisplacement = 1.0\n[limits.group.upper]\n[[case]]", 1
    )
    workshop.solve(text, ROOFED, FACES).close()
    heavy = [row[1:] for row in limit_rows(workshop.folder, "result.vtkhdf") if row[0] == "heavy"]
    assert {(what, at, result) for what, _, at, _, result in heavy} == {
        ("displacement of lower from permanent", "node 5", "passes"),
        ("displacement of upper from permanent", "node 5", "FAILS"),
    }


@pytest.mark.parametrize(
    "limits, keys, reason",
    [
        ("span = 6.0\nfrom = 'form'\n", "span, from", "no displacement is limited"),
        ("span = 6.0\ndisplacement = '2 mm'\n", "span", "no displacement is a share of it"),
    ],
)
def test_limits_without_effect_are_named(workshop, limits, keys, reason):
    """The report does not name missing service combinations, because they exist."""
    text = LIMITED.replace("displacement = '2 mm'\n", limits)
    done = workshop.printed(workshop.job(text, ROOFED, FACES))
    assert f"note: [limits] {keys}: no effect: {reason}. [N451]" in done
    page = report_of(workshop.folder).page
    assert "Not checked: no combination" not in page
    assert ("limits neither displacements nor slack cables." in page) == ("from" in keys)


def test_a_limit_of_a_removed_group_has_no_nodes(workshop):
    """Without the lower cable, node 5 belongs only to the upper ones: the general limit applies."""
    text = LIMITED.replace("[[case]]", "[limits.group.lower]\ndisplacement = 1.0\n[[case]]", 1)
    text += stage("open", active='["upper"]')
    workshop.solve(text, ROOFED, FACES, "--set", DEAD).close()
    heavy = [row[1:] for row in limit_rows(workshop.folder, "result.vtkhdf") if row[0] == "heavy"]
    assert [(row[0], row[2], row[-1]) for row in heavy] == [
        ("displacement from permanent", "node 5", "FAILS")
    ]


@pytest.mark.parametrize(
    "limits, message",
    [
        ("displacement = 'span/250'\n", '[limits] span: missing. displacement = "span/250" is a share of it'),
        ("[limits.group.lower]\ndisplacement = 'span/9'\n", "[limits.group.lower] span: missing."),
        ("displacement = 'span/9'\nspan = 'x'\n", '[limits] span = "x": expected a number'),
        ("displacement = '250/span'\n", 'm, or a share of the span such as "span/250"'),
        ("displacement = 'span/0'\n", 'm, or a share of the span such as "span/250"'),
        ("from = 'load'\n", 'from = "load": expected one of "permanent", "form"'),
        (
            "[limits.group.lwer]\ndisplacement = 0.1\n",
            "[limits.group.lwer]: no element is of this group; did you",
        ),
        ("[limits.group.'x*']\ndisplacement = 0.1\n", "[limits.group.x*]: no group matches this pattern"),
        (
            "[limits.group.'l*']\nspan = 1.0\n[limits.group.'*r']\nspan = 2.0\n",
            '[limits.group.l*] and [limits.group.*r] both give span to the group "lower"',
        ),
        ("[limits.group.lower]\nslack = 1\n", "[limits.group.lower] slack: unknown key"),
    ],
)
def test_wrong_limits_are_refused(workshop, limits, message):
    """One line each, with the place, the value and the allowed range."""
    text = LIMITED.replace("displacement = '2 mm'\n", limits)
    job = workshop.job(text, ROOFED, FACES)
    (line,) = error_lines(lambda: build_net(read_job(job)))
    assert message in line


def test_a_case_has_its_loads_in_the_result(dead):
    """Cladding and snow on 10 m2 and 2 m2 balance the reactions, also in the permanent state."""
    with netfall.open(dead / "dead.vtkhdf") as result:
        for name in ("area", "tributary_area"):
            assert result.nodes[name].tolist() == [2.0, 0.0, 0.0, 10.0]
        assert "area" in repr(result.nodes) and "[m2]" in repr(result.nodes)
        z = result.permanent["displacement"][3, 2]
        assert z == pytest.approx(-three_cables(PERMANENT)[0], rel=1e-7)
        for name, share in (("heavy", 0.75), ("lift", -0.5), ("snow", 1.0)):
            case, total = result.cases[name], np.zeros((4, 3))
            total[:, 2] = -result.nodes["area"] * (5e3 + share * 20e3)
            assert np.array(case["load"]) == pytest.approx(total, rel=1e-13, abs=1e-9)
            assert case["reaction"].sum(0) == pytest.approx(total.sum(0), abs=1e-8 * 400e3)
        assert case.units["load"] == "[N]"


@pytest.mark.parametrize("parts", [1, 4])
def test_a_slack_cable_in_parts_is_slack(workshop, parts):
    """Two stays are loose in S. In one part they have no tension, in four they sag under their weight."""
    job = workshop.job(
        "[cable]\nmodulus = 1.6e11\narea = 5e-4\ndensity = 7850.0\nprestress = 2e4\n[group.stay]\n"
        'prestress = 1e3\narea = 1e-4\n[form_finding]\nmethod = "force_density"\n[load]\nself_weight = true\n'
        '[[case]]\nname = "A"\nset = {"load.temperature" = 0.0}\nsettlement = {3 = [-0.2, 0.0, 0.0]}\n'
        '[combinations]\nS = {kind = "SLS", A = 1.0}\n[limits]\nslack = 1\n',
        "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,-1,0\n3,20,0,0,1\n4,10,4,-6,1\n5,10,-4,-6,1\n",
        "start,end,group\n1,2,main\n2,3,main\n2,4,stay\n2,5,stay\n",
    )
    with workshop.run(job, "--set", f"net.subdivide={parts}", output="loose.vtkhdf") as f:
        assert force_words(f, find_equilibrium(f, "S")).endswith(", 2 elements slack (grey)")
        assert [series.slack.tolist() for series in shown_series(f, select_drawn(f))[0]][-1] == [2]
    folder = report_of(workshop.folder, "loose.vtkhdf").folder
    page, info = (folder / "summary.md").read_text(), workshop.info("loose.vtkhdf")
    assert "| S | slack | 2 cables |  | 1 cables | **FAILS** |" in page
    assert re.search(r"\| combination S \|.*\| 2 \|\n", page)
    assert re.search("combination S: .* slack 2,", info)
    cases, cables = rows_of(folder / "cases.csv"), rows_of(folder / "cables.csv")
    assert [int(row["slack"]) for row in cases if row["case"] == "S"] == [0, 2]
    assert [row["slack_in"] for row in cables] == ["", *["case A; combination S"] * 2]
