"""Static cases and combinations: the loads in each, compared with the same loads written out, and by hand."""

import re

import h5py
import numpy as np
import pytest
from conftest import STEEL
from nets import LOW_SADDLE

from netfall.core.errors import InputError
from netfall.driver.check import check_values
from netfall.job.read import read_job
from netfall.model.layout import make_layout
from netfall.post.checks.nodes import reaction_columns
from netfall.statics.newton import Newton, NoConvergence

TOLERANCE = 1e-6  # of the largest tension, well above [load] tolerance = 1e-9
SADDLE = (
    LOW_SADDLE + "[form_finding]\ntolerance = 1e-9\n"
    '[[zone]]\nname = "half"\npolygon = [[-1, -1], [20, -1], [20, 41], [-1, 41]]\ncut = true\n'
)
LOAD = "[load]\ntolerance = 1e-9\nself_weight = true\ndead = 100.0\n"


def case(name: str, what: str) -> str:
    """Return an entry [[case]]; what : the lines below its name."""
    return f'[[case]]\nname = "{name}"\n{what}\n'


def combination(name: str, factors: str, more: str = "") -> str:
    """Return an entry [[combination]]."""
    return f'[[combination]]\nname = "{name}"\nfactors = {{{factors}}}\n{more}'


def apart(one: h5py.Group, other: h5py.Group) -> float:
    """Return the largest difference of tensions of two equilibria, relative to the largest tension."""
    N, M = one["tension"][:], other["tension"][:]
    return np.abs(N - M).max() / M.max()


WIND = '"wind.base_height" = 10.0, "wind.speed" = 30.0, '
WIND += '"wind.pressure_coefficient" = -0.8, "wind.zone.half.pressure_coefficient" = -1.4'


def test_a_combination_is_the_case_of_the_same_loads(workshop):
    """The reference has the factored snow, zone, dead load, pressure and temperature in [load]."""
    cases = case("snow", 'set = {"load.snow" = 500.0}')
    cases += case("drift", 'set = {"load.zone.half.snow" = 400.0}')
    cases += case("lift", 'set = {"load.pressure" = -200.0, "load.temperature" = -30.0}')
    cases += case("cladding", 'set = {"load.dead" = 160.0}')
    factors = "snow = 1.5, drift = 0.75, lift = 0.6, cladding = 0.5, temperature = 1.0"
    given = LOAD + "temperature = 10.0\n"
    f = workshop.solve(SADDLE + given + cases + combination("all", factors))
    # dead 100 + 0.5 x 60; snow 750, and 300 more in the half; 10 + 0.6 x (-30 - 10) K
    by_hand = LOAD.replace("100.0", "130.0")
    by_hand += "temperature = -14.0\nsnow = 750.0\npressure = -120.0\nsteps = 1\n"
    by_hand += "[load.zone.half]\nsnow = 1050.0\n"
    g = workshop.solve(SADDLE + by_hand, name="hand", output="hand.vtkhdf")
    N, M = f["cases/all/tension"][:], g["statics/tension"][-1]
    assert np.abs(N - M).max() <= TOLERANCE * M.max()
    assert f["cases/all"].attrs["kind"] == "ULS"
    assert f["cases"].attrs["order"].tolist() == ["snow", "drift", "lift", "cladding", "all"]


def test_a_case_adds_only_what_load_does_not_contain(workshop):
    """Snow is 750 in the case and 500 in [load]: together they are 750, so the case adds 250."""
    text = SADDLE + LOAD + "snow = 500.0\n" + case("deep", 'set = {"load.snow" = 750.0}')
    text += combination("both", "load = 1.0, deep = 1.0") + combination("rise", "deep = 1.0")
    text += case("250", 'set = {"load.snow" = 250.0}')
    f = workshop.solve(text)
    assert apart(f["cases/both"], f["cases/deep"]) <= TOLERANCE
    assert apart(f["cases/rise"], f["cases/250"]) <= TOLERANCE


def notes_of(workshop, text: str, words: str) -> list[str]:
    """Return the notes on the loads of the saddle with these words."""
    notes = make_layout(read_job(workshop.job(SADDLE + LOAD + text)), 1).notes
    return [note for note in notes if words in note]


CORNERS = [(x, y, -x) for x in (0, 40) for y in (0, 40)]
AROUND = [(10 * np.cos(k * np.pi / 3), 10 * np.sin(k * np.pi / 3), k) for k in range(6)]


@pytest.mark.parametrize(
    "points, fact",
    [
        (CORNERS, ""),
        ([(1000 * x, 1000 * y, p) for x, y, p in CORNERS], "3 of 4 points lie far outside the roof, "),
        (AROUND, "node "),
        ([*AROUND, (0.0, 0.0, 3.0)], ""),
    ],
    ids=["the corners", "in millimetres", "six around the middle", "one in the middle"],
)
def test_implausible_points_of_a_pressure_table_are_a_warning(workshop, points, fact):
    """The roof is 40 m long. The order of six points around the middle decides which four count there."""
    rows = "".join(f"{x:.4f},{y:.4f},{p}\n" for x, y, p in points)
    (workshop.folder / "cp.csv").write_text("x,y,pressure\n" + rows)
    notes = notes_of(workshop, case("tunnel", 'pressure_table = "cp.csv"'), "pressure_table")
    assert len(notes) == bool(fact)
    more = "five or more points" if fact == "node " else "the farthest at x, y = 40000, 40000 m by "
    start = f"warning: [[case]] tunnel: pressure_table: {fact}"
    assert all(note.startswith(start) and more in note for note in notes)


def test_zones_that_keep_their_values_in_a_case_are_named(workshop):
    """600 N/m2 of a case do not reach a zone with 70 N/m2; 0, or its value in the case, is meant."""
    zone = '[[zone]]\nname = "e"\npolygon = [[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]]\n[load.zone.e]\nsnow = '
    deep = "\n" + case("deep", 'set = {"load.snow" = 600.0}')
    (note,) = notes_of(workshop, zone + "70.0" + deep, "value of their own")
    assert "(load.zone.e.snow = 70)" in note
    for text in ("0.0" + deep, "70.0" + deep.replace("}", ', "load.zone.e.snow" = 70.0}')):
        assert notes_of(workshop, zone + text, "value of their own") == []


def test_a_combination_of_load_and_case_is_explained(workshop):
    """Snow is 250 in [load] and 900 in a case, with factors 1.05 and 1.5: 1237.5, not 1350."""
    snow, lift = case("deep", 'set = {"load.snow" = 900.0}'), case("lift", 'set = {"load.pressure" = -9.0}')
    sums = combination("U", "load = 1.05, deep = 1.5, lift = 1.5, temperature = 0")
    sums += combination("V", "load = 1.5, deep = 1.5, temperature = 0") + combination("W", "lift = 1.0")
    warning, drift = "warning: [[", case("drift", 'set = {"load.snow" = 900.0}')
    assert notes_of(workshop, snow + lift + sums, warning) == []
    warmed = "snow = 250.0\ntemperature = 9.0\n"
    many, left_out, warm = notes_of(workshop, warmed + snow + lift + sums, warning)
    assert many.startswith("warning: [[case]] deep: load.snow = 900, but [load] has 250. ")
    assert '("U": 1.5 x (900 - 250) + 1.05 x 250 = 1237.5)' in many
    assert left_out.startswith(
        'warning: [[combination]] "W": the factors do not name load, so snow, ice and pressure of [load]'
    )
    assert warm.startswith('warning: [[combination]] "W": the factors do not name temperature, ')
    (left_out,) = notes_of(workshop, drift + snow + lift + sums, warning)
    assert left_out.startswith("warning: [[case]] drift: in no combination")
    sums += combination("X", "drift = 0.0")
    assert notes_of(workshop, drift + snow + lift + sums, warning) == []


def test_a_combination_with_the_mean_wind_is_a_warning(workshop):
    """The pressure of the mean speed is half of that of codes. A factor, also of 1, confirms it."""
    text = "".join(case(name, f"set = {{{WIND}}}") for name in ("mean", "north", "alone"))
    text += case("peak", f'set = {{{WIND}, "wind.pressure_factor" = 1.0}}')
    text += combination("U", "mean = 1.5") + combination("V", "peak = 1.5, mean = 0, alone = 0")
    text += combination("W", "north = 1.5, mean = 0.9")
    (note,) = notes_of(workshop, text, "")
    assert note.startswith("warning: [[case]] mean, north: set: no wind.pressure_factor")
    assert 'so the pressure in [[combination]] "U", "W" is that of the mean speed. ' in note
    (note,) = make_layout(read_job(workshop.job(SADDLE + LOAD + case("only", f"set = {{{WIND}}}"))), 1).notes
    assert note.startswith("warning: [[case]] only: set: no wind.pressure_factor, so the pressure is that of")


def test_factors_apply_to_permanent_loads_and_prestress(workshop):
    """1.35 of the permanent loads is a net 1.35 times as heavy; 0.8 of the prestress is 0.8 in the form."""
    text = SADDLE + LOAD + combination("heavy", "permanent = 1.35")
    f = workshop.solve(text + combination("low", "permanent = 0, prestress = 0.8"))
    heavy = SADDLE.replace("7850.0", "10597.5") + LOAD.replace("100.0", "135.0") + "steps = 1\n"
    g = workshop.solve(heavy, name="hand", output="hand.vtkhdf")
    N, M = f["cases/heavy/tension"][:], g["statics/tension"][0]
    # The weight of an element is that of its unstressed length, which does not change with its density.
    assert np.abs(N - M).max() <= TOLERANCE * M.max()
    form = f["form_finding/tension"][:]
    assert np.abs(f["cases/low/tension"][:] - 0.8 * form).max() <= 1e-6 * form.max()
    assert np.abs(f["cases/low/displacement"][:]).max() < 1e-6  # m: without loads the form stays


@pytest.mark.parametrize("held", ["fixed", "spring"])
def test_a_support_that_settles_by_hand(workshop, held):
    """The upper end of a cable of 10 m with a weight moves down or up by 20 mm, and so does the weight. On a
    spring of 2 MN/m the end moves down by 5 kN / 2 MN/m = 2.5 mm more.
    """
    spring = held == "spring"
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z,spring_z\n"
    nodes += f"7,0,0,0,1,1,{int(not spring)},0,{2e6 * spring}\n9,0,0,-10,1,1,0,-5000,0\n"
    text = STEEL.replace("100e3", "0.0") + "[load]\nself_weight = false\ntolerance = 1e-10\n"
    text += case("down", "settlement = {7 = [0.0, 0.0, -0.02]}") + combination("up", "load = 1, down = -0.5")
    f = workshop.solve(text, nodes, "start,end\n7,9\n")
    stretch = 5000.0 * 10.0 / (1.95e11 * 683.08e-6)
    sags = 5000.0 / 2e6 if spring else 0.0
    for name, top in (("down", -0.02), ("up", 0.01)):
        z = f[f"cases/{name}/displacement"][:, 2]
        assert z == pytest.approx([top - sags, top - sags - stretch], rel=1e-8)
        assert f[f"cases/{name}/tension"][0] == pytest.approx(5000.0, rel=1e-9)
    reactions = reaction_columns(f)
    rows = (reactions["node"] == 7) & ~np.isin(reactions["stage"], ["as given", "permanent loads"])
    assert reactions["force_z"][rows] == pytest.approx(-5000.0, rel=1e-8)  # on a foot that settled as well
    assert reactions["foundation_z"][rows] == pytest.approx(-5000.0, rel=1e-8)


def test_a_settlement_of_two_cables_by_hand(workshop):
    """Two cables in line, 10 m each, have 50 kN. One end moves outwards by 1 mm: EA x 1 mm / 20 m more. L0 =
    L / (1 + N / EA), so the force is then EA ((20.001) (1 + N / EA) / 20 - 1).
    """
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,0\n3,20,0,0,1\n"
    text = STEEL.replace("100e3", "50e3") + case("out", "settlement = {3 = [0.001, 0.0, 0.0]}")
    f = workshop.solve(text, nodes, "start,end\n1,2\n2,3\n")
    EA = 1.95e11 * 683.08e-6
    expected = EA * (20.001 / 20.0 * (1.0 + 50e3 / EA) - 1.0)
    assert f["cases/out/tension"][:] == pytest.approx([expected] * 2, rel=1e-9)
    assert f["cases/out/displacement"][:, 0] == pytest.approx([0.0, 0.0005, 0.001], abs=1e-10)


def test_a_static_wind_equals_the_equilibrium_under_the_mean_wind(workshop):
    """The keys of a case in [wind] give the same forces at the start of the dynamic stage."""
    wind = "[wind]\nspeed = 30.0\nsurface_drag = 0.0\npressure_coefficient = -0.8\nbase_height = 10.0\n"
    wind += "[wind.zone.half]\npressure_coefficient = -1.4\n"
    moves = "[dynamics]\nduration = 0.001\n"
    g = workshop.solve(SADDLE + LOAD + wind + moves, name="rest", output="rest.vtkhdf")
    f = workshop.solve(SADDLE + LOAD + case("wind", f"set = {{{WIND}}}"))
    assert apart(f["cases/wind"], g["initial_state"]) <= TOLERANCE


def test_only_coefficients_of_another_direction_are_a_warning(workshop):
    """Coefficients that each case has for its direction need no table. The dynamic stage has one too.

    Directions of 360 and -360 degrees are that of 0.
    """
    words, north = "are those of another direction", case("north", f"set = {{{WIND}}}")
    east = case("east", f'set = {{{WIND}, "wind.direction" = 90.0}}')
    other = case("west", f'set = {{{WIND.replace("-0.8", "-0.5")}, "wind.direction" = 270.0}}')
    turned = [case("turn", f'set = {{{WIND}, "wind.direction" = {angle}}}') for angle in (360.0, -360.0)]
    moving = "[wind]\nspeed = 30.0\nsurface_drag = 0.0\npressure_coefficient = -0.8\nbase_height = 10.0\n"
    moving += "[wind.zone.half]\npressure_coefficient = -1.4\n[dynamics]\nduration = 0.001\n"
    pairs = ((north + other, []), (north + east + other, ["east"]), (moving + east, ["east"]))
    for text, cases in (*pairs, *((north + each, []) for each in turned)):
        assert [note.split()[2][:-1] for note in notes_of(workshop, text, words)] == cases


def test_keys_of_wind_need_no_dynamic_stage_if_cases_use_them(workshop):
    """Air, profile and coefficients apply to all cases. Sectors of a case replace a coefficient."""
    shared = "[wind]\nspeed = 30.0\nbase_height = 10.0\npressure_coefficient = -0.8\n"
    shared += "[wind.zone.half]\npressure_coefficient = -1.4\n"
    text = case("west", 'set = {"wind.direction" = 270.0}')
    text += case("table", 'set = {wind = {sectors = "s.csv"}}') + case("snow", 'set = {"load.snow" = 1.0}')
    west, table, snow = read_job(workshop.job(SADDLE + LOAD + shared + text)).cases
    written = case("west", f'set = {{{WIND}, "wind.direction" = 270.0}}')
    assert west == read_job(workshop.job(SADDLE + LOAD + written)).cases[0]
    assert "wind.pressure_coefficient" not in table.set and table.set["wind.speed"] == 30.0
    assert snow.set == {"load.snow": 1.0}
    job = workshop.job(SADDLE + LOAD + "[wind]\nseed = 3\nspeed = 30.0\n" + text)
    with pytest.raises(InputError, match=r"\[wind\] seed: has no effect without \[dynamics\]"):
        read_job(job)
    job = workshop.job(SADDLE + LOAD + "[wind]\nspeed = 50.0\n" + case("west", f"set = {{{WIND}}}"))
    with pytest.raises(InputError, match=r"\[wind\] speed: has no effect"):  # each case has its own
        read_job(job)


def test_two_winds_add_as_forces_and_a_factor_multiplies_pressure(workshop):
    """A speed times the root of two has twice the pressure, like pressure_factor = 2 and the factor 2."""
    text = SADDLE + LOAD + case("one", f"set = {{{WIND}}}")
    text += case("faster", f"set = {{{WIND.replace('30.0', repr(30.0 * 2**0.5))}}}")
    text += case("factor", f'set = {{{WIND}, "wind.pressure_factor" = 2.0}}')
    text += combination("twice", "one = 2.0") + combination("sum", "one = 1.0, factor = 0.5")
    f = workshop.solve(text)
    for name in ("factor", "twice", "sum"):
        assert apart(f[f"cases/{name}"], f["cases/faster"]) <= TOLERANCE


def test_a_table_of_one_pressure_is_that_pressure(workshop):
    """Equal coefficients times their factor, at points in plan or in space, equal [load] pressure."""
    text = SADDLE + LOAD + case("plain", 'set = {"load.pressure" = -340.0}')
    for name, axes in (("plan", "x,y"), ("space", "x,y,z")):
        rows = [f"{x},{y}{',3' * (name == 'space')},-0.4" for x in (0, 20, 40) for y in (0, 20, 40)]
        (workshop.folder / f"{name}.csv").write_text("\n".join([axes + ",coefficient", *rows]))
        text += case(name, f'pressure_table = "{name}.csv"\nfactor = 850.0')
    f = workshop.solve(text)
    for name in ("plan", "space"):
        assert apart(f[f"cases/{name}"], f["cases/plain"]) <= TOLERANCE
    values = check_values(read_job(workshop.folder / "job.toml"), [])
    assert [each["table"] for each in values["load_tables"]] == ["plan.csv", "space.csv"]
    for each in values["load_tables"]:
        assert each["resultant"][2] == pytest.approx(340.0 * values["plan_area"], rel=1e-12)


def test_springs_carry_their_share_of_a_factor_of_the_prestress(workshop):
    """The factor 0.8 applies to spring forces of the form, also if its tables run without form finding."""
    nodes = "id,x,y,z,fixed,spring_x,spring_y,spring_z,load_z\n1,-10,0,2,1,0,0,0,0\n2,10,0,2,1,0,0,0,0\n"
    nodes += "3,0,-10,0,0,2e6,2e6,2e6,0\n4,0,10,0,1,0,0,0,0\n5,0,0,0.6,0,0,0,0,-1e4\n"
    text = STEEL + "[form_finding]\ntolerance = 1e-9\n" + LOAD.replace("dead = 100.0\n", "")
    text += combination("low", "prestress = 0.8, load = 1.0")
    text += combination("none", "permanent = 0, prestress = 0.8")
    f = workshop.solve(text, nodes, "id,start,end\n1,1,5\n2,2,5\n3,3,5\n4,4,5\n")
    again, _ = workshop.run_exported()
    for name in ("low", "none"):
        assert apart(again[f"cases/{name}"], f[f"cases/{name}"]) <= 1e-9  # to rounding
    assert np.abs(again["cases/none/displacement"][:]).max() < 1e-8  # without loads the form stays
    assert again["cases/none/tension"][:] == pytest.approx(0.8 * f["form_finding/tension"][:], rel=1e-6)


def set_in_case(keys: str) -> str:
    """Return an entry [[case]] that sets keys."""
    return case("a", f"set = {{{keys}}}")


FAST, SNOW = "wind.speed = 30", set_in_case("load.snow = 1")
WRONG = [  # a text, the place and value of its error, and the code
    (set_in_case(FAST + ", wind.pressure_factor = 900"), "] a: set: wind.pressure_factor = 900: ", "E126"),
    (SNOW.replace('"a"', '"load"'), '[[case]] load: name: "load" has a meaning in combinations', "E161"),
    (set_in_case("wind.direction = 30"), "[[case]] a: set: wind.speed: missing; expected a number", "E163"),
    (set_in_case(FAST), "[[case]] a: set: wind.pressure_coefficient: missing", "E164"),
    (set_in_case(FAST + ", wind.pressure_coefficient = -1"), "a: set: wind.base_height: missing; ", "E154"),
    (set_in_case("wind.seed = 3"), "[[case]] a: set: wind.seed: not a key that a case can set", "E160"),
    (case("a", "factor = 3.0"), "[[case]] a: factor: has no effect without pressure_table", "E131"),
    (case("a", "settlement = {17 = [0.0, 0.1]}"), "[[case]] a: settlement = ", "E126"),
    (
        case("a", "settlement = {1 = [0.0, 0.0, 0.1], 01 = [0.0, 0.0, 0.2]}"),
        "by ids of nodes without leading zeros, {17",
        "E126",
    ),
    (combination("c", "snaw = 1.5"), "[[combination]] c: factors: snaw: no case has this name; ", "E166"),
    (combination("c", "prestress = -1.0"), "c: factors: prestress = -1: expected a number >= 0", "E167"),
    (combination("c", "permanent = 1e9"), "[[combination]] c: factors = ", "E126"),
    ('[[combination]]\nname = "c"\n', "[[combination]] c: factors: missing", "E127"),
    (combination("c", "load = 1.0", 'kind = "fire"\n'), 'c: kind = "fire": expected one of', "E126"),
    (SNOW + combination("a", "a = 1.0"), '[[combination]] a: name: "a" is the name of a case', "E165"),
    ("[limits]\ndisplacement = -1.0\n", "[limits] displacement = -1.0: expected a number > 0", "E126"),
    (
        case("a", "settlement = {7 = [0.0, 0.0, 0.1]}"),
        "[[case]] a: settlement: the net has no node 7",
        "E346",
    ),
    (case("a", "settlement = {2 = [0.0, 0.1, 0.1]}"), "settlement: node 2: y, z: neither held nor", "E347"),
    (case("a", 'pressure_table = "no.csv"'), "no.csv: No such file or directory", "E105"),
    (case("a", 'pressure_table = "elements.csv"'), "elements.csv: column x is missing", "E186"),
    (case("a", 'pressure_table = "cp.csv"'), "[[case]] a: factor: missing", "E345"),
]
NODES = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n"
NODES += "1,0,0,0,1,1,0,0,1\n2,10,0,0,0,1,0,0,1\n3,20,0,0,1,1,0,0,1\n"


@pytest.mark.parametrize("text, place, code", WRONG)
def test_a_wrong_entry_is_refused_with_its_place(workshop, text, place, code):
    """Exit code 2 without a file, and a line with the place, the fault and the remedy."""
    (workshop.folder / "cp.csv").write_text("x,y,coefficient\n0,0,1\n")
    lines = workshop.solve(STEEL + text, NODES, "start,end\n1,2\n2,3\n", code=2).stderr.splitlines()
    assert any(place in line and line.endswith(f"[{code}]") for line in lines)
    assert not (workshop.folder / "result.vtkhdf").exists()


TEN = "".join(case(f"{k}", f'set = {{"load.snow" = {100.0 * k}}}') for k in range(1, 7)) + "".join(
    combination(f"c{k}", f"1 = {factor}") for k, factor in ((1, 1.0), (2, 1e3), (3, 2.0), (4, 900.0))
)


def test_three_overloaded_cases_of_ten_leave_seven(workshop):
    """With strengths the run ends with 0, names the cases without equilibrium, and stores the others."""
    strong = SADDLE.replace("[form_finding]", "breaking_load = 6e5\n[form_finding]")
    job = workshop.job(strong + LOAD + "stop_at_strength = true\n" + TEN.replace("600.0}", "6000.0}"))
    output = workshop.printed(job)
    assert len(re.findall(r"^warning: (?:case|combination) .*\[W623\]$", output, re.M)) == 3
    f = workshop.open()
    states = {name: f["cases"][name].attrs["state"] for name in f["cases"].attrs["order"]}
    overloaded = ["6", "c2", "c4"]
    assert [name for name, state in states.items() if state == "no_equilibrium"] == overloaded
    for name in overloaded:
        attributes = f["cases"][name].attrs
        assert 0.0 < attributes["load_factor"] < 1.0
        assert "breaks" in attributes["reason"] and len(attributes["elements"])
    for name in set(states) - {*overloaded}:
        assert np.isfinite(f["cases"][name]["tension"][:]).all()
        assert f["cases"][name].attrs["load_factor"] == 1.0


def test_no_element_breaks_in_statics_without_the_key_breaking(workshop):
    """Tensions are then the same as without strengths, and a note names the exceeded strengths."""
    strong = SADDLE.replace("[form_finding]", "breaking_load = 2e5\n[form_finding]")
    snow = "snow = 3000.0\nsteps = 1\n"
    f = workshop.solve(SADDLE + LOAD + snow)
    output = workshop.printed(workshop.job(strong + LOAD + snow), output="strong.vtkhdf")
    assert "strength exceeded. No element breaks in this static equilibrium" in output
    g = workshop.open("strong.vtkhdf")
    assert f["statics/tension"][-1].max() > 2e5
    assert np.array_equal(f["statics/tension"][:], g["statics/tension"][:])
    assert g["statics"].attrs["state"] == "equilibrium"
    over = f["net/element_id"][:][f["statics/tension"][-1] > 2e5]
    assert g["statics"].attrs["over_strength"].tolist() == over.tolist()


NEIGHBOURS = SADDLE + LOAD.replace("1e-9", "1e-8") + case("snow", 'set = {"load.snow" = 900.0}')
NEIGHBOURS += "".join(
    combination(f"c{k}", f"permanent = {1.0 + 0.1 * k}, prestress = {1.1 - 0.1 * k}, snow = {0.4 * k}")
    for k in range(4)
)


@pytest.mark.parametrize("looks", [20, 26, 32])
def test_a_pause_among_combinations_changes_no_bit(workshop, looks):
    """The run stops at a correction and resumes on two ranks with the factors of the permanent state."""
    workshop.assert_pause_changes_no_bit(workshop.job(NEIGHBOURS), looks, "in statics, (case|combination) ")


def test_a_case_that_is_relaxed_does_not_depend_on_the_other_cases(workshop, monkeypatch):
    """Without Newton's method its bits are the same before and after a case of 300 times the load."""

    def not_found(*_):
        raise NoConvergence

    monkeypatch.setattr(Newton, "solve", not_found)
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,-0.5,0\n3,2,0,0,1\n"
    text, cases = STEEL + "[load]\nself_weight = true\ntolerance = 1e-2\n", []
    for name, load in ("small", 1e3), ("large", 3e5):
        (workshop.folder / f"{name}.csv").write_text(f"node,load_x\n2,{load}\n")
        cases.append(case(name, f'load_table = "{name}.csv"'))
    results = []
    for order in cases, cases[::-1]:
        f = workshop.run_here(workshop.job(text + "".join(order), nodes, "start,end\n1,2\n2,3\n"))
        results.append(f["cases/small/displacement"][:])
        assert f["cases/small/relaxed"][()]
        f.close()
    assert np.array_equal(*results)
