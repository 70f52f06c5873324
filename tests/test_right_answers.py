"""Wrong input with plausible results is refused or named; right results agree with hand calculations."""

import re

import numpy as np
import pytest
from conftest import BARE, STEEL, lines_with, refused, run_on_standing_ranks
from nets import table

from netfall.job.read import read_job
from netfall.model.layout import make_layout

SECTION = "[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 7850.0\n"


# --- form finding

CROSS = "id,x,y,z,fixed\n1,-2,0,0,1\n2,2,0,0,1\n3,0,-2,1,1\n4,0,2,1,1\n5,0.5,0.3,0,0\n"
TO_MIDDLE = "start,end,force_density\n1,5,3\n2,5,3\n3,5,1\n4,5,1\n"


def test_form_finding_by_particles_without_prestress_is_refused(workshop):
    """The table has only force densities. With the method that the error names, z = 2 / 8 in the middle."""
    job = workshop.job(SECTION + "[form_finding]\n", CROSS, TO_MIDDLE)
    line = refused("run", job)
    assert "no element that can move has a prestress" in line and 'or method = "force_density"' in line
    f = workshop.run(job, "--set", 'form_finding.method="force_density"')
    assert np.allclose(f["form_finding/position"][4], [0, 0, 0.25], atol=1e-15)
    elements = "start,end,prestress\n1,5,0\n2,5,0\n3,5,0\n4,5,0\n1,3,1000\n"  # only between supports
    job = workshop.job(SECTION + "[form_finding]\n", CROSS, elements)
    assert "no element that can move has a prestress." in refused("check", job)


def test_a_collapsed_form_is_refused(workshop):
    """A triangle held at one node shrinks to a point. The error names the shortest element, both lengths."""
    nodes = "id,x,y,z,fixed\n1,-2,0,0,1\n2,2,0,0,1\n3,0,1,0,0\n7,0,2,0,0\n8,0.5,2.5,0,0\n"
    elements = "id,start,end\n11,1,3\n12,2,3\n13,3,7\n14,7,8\n15,8,3\n"
    of_bars = 'prestress = 1e4\nkind = "bar"\nsecond_moment = 1e-6\n'  # Euler's load at no length: no warning
    job = workshop.job(SECTION + of_bars + '[form_finding]\nmethod = "force_density"\n', nodes, elements)
    line = refused("run", job)
    assert "the form has collapsed: element 1" in line and "m as given" in line
    assert not list(workshop.folder.glob("*.vtkhdf"))


def test_warnings_of_a_net_precede_the_failure_of_its_form(workshop):
    """Element 3 ends 1 mm from support 3. Both warnings come once, before the form collapses."""
    text = SECTION + 'prestress = 1e4\n[form_finding]\nmethod = "force_density"\n'
    near_nodes, elements = CROSS + "6,0,-1.9991,1,0\n", "start,end\n1,5\n2,5\n6,5\n4,5\n"
    nodes = near_nodes.replace("3,0,-2,1,1\n", "") + "3,0,-2,1,1\n7,0,-3,1,1\n"
    job = workshop.job(text, nodes, elements + "3,7\n")
    warning = "warning: node 6: free, with one element only (node 3 is 0.9 mm away). Form finding pulls "
    unjoined = "warning: nodes lie close to each other and are not joined (6 and 3, 0.9 mm apart). If "
    for command in ("check", "run"):
        done = run_on_standing_ranks(command, job, code=2)
        lines = [line for line in (done.stdout + done.stderr).splitlines() if "[W2" in line]
        assert len(lines) == 2 and lines[0].startswith(unjoined)
        assert lines[1].startswith(warning) and lines[1].endswith("[W238]")
        assert "[E446]" in done.stderr.splitlines()[-1]
    job = workshop.job(text, nodes.replace("-1.9991", "-1.5"), elements + "3,7\n")
    assert "node 6: free, with one element only. Form" in run_on_standing_ranks("check", job, code=2).stdout


@pytest.mark.parametrize("loads", ["", '[[case]]\nname = "snow"\nset = {"load.snow" = 500.0}\n'])
def test_a_weight_without_vertical_support_is_refused(workshop, loads):
    """Supports hold in plan alone. Without weight the net is valid."""
    nodes = CROSS.replace("fixed", "fixed_x,fixed_y").replace(",1\n", ",1,1\n").replace("0,0\n", "0,0,0\n")
    text, elements = SECTION + "prestress = 1e4\n[form_finding]\n", "start,end\n1,5\n2,5\n3,5\n4,5\n"
    line = refused("check", workshop.job(f"{text}[load]\n{loads}", nodes, elements))
    assert "the part of the net with node 1 (5 nodes) has no vertical support. Fix one of its nodes" in line
    run_on_standing_ranks("check", workshop.job(text, nodes, elements))


def test_warnings_and_notes_of_a_net_precede_its_errors(workshop):
    """A part ends 0.5 mm from a support and is unsupported, then a column is ignored: these come first."""
    nodes = CROSS + "6,0,1.9995,1,0\n7,0,3,1,0\n"
    elements = "start,end\n1,5\n2,5\n3,5\n4,5\n6,7\n"
    job = workshop.job(SECTION + "prestress = 1e4\n[form_finding]\n", nodes, elements)
    lines = run_on_standing_ranks("check", job, code=2).stderr.splitlines()
    assert lines[0].startswith("warning: nodes lie close to each other") and "4 and 6, 0.5 mm" in lines[0]
    assert lines[-1].startswith("error: ") and "has no support" in lines[-1]
    of_json = run_on_standing_ranks("check", job, "--json", code=2).stdout
    assert '"warnings"' in of_json and of_json.count("[W211]") == 1
    pattern = '[group."post*"]\nsecond_moment = 1e-6\n'  # one key of two groups
    elements = "start,end,group\n1,5,post a\n2,5,post b\n3,5,post b\n4,5,post b\n"
    job = workshop.job(SECTION + pattern, CROSS.replace("fixed", "support"), elements)
    done = run_on_standing_ranks("check", job, code=2)
    lines = done.stderr.splitlines()
    assert lines[0].startswith("note: ") and 'which netfall ignores: "support"' in lines[0]
    assert sum("[E255]" in line for line in lines) == 1
    of_json = run_on_standing_ranks("check", job, "--json", code=2).stdout
    assert "[N184]" not in of_json and "[E255]" in of_json


def test_the_motion_of_the_form_is_named_before_exceeded_strengths(workshop):
    """A mast without its stay moves far and its cables are too long. Their strength is not the cause."""
    nodes = "id,x,y,z,fixed\n1,-10,0,0,1\n2,0,0,0,1\n3,0,0,10,0\n4,-10,5,0,1\n"
    elements = "start,end,group,prestress\n1,3,cable,1e4\n4,3,cable,1e4\n2,3,mast,-1.9e4\n"
    text = SECTION + 'breaking_load = 2e4\n[group.mast]\nkind = "bar"\n'
    text += '[form_finding]\nmethod = "force_density"\n'
    lines = run_on_standing_ranks("check", workshop.job(text, nodes, elements), code=2).stderr.splitlines()
    assert [line[-6:] for line in lines] == ["[W719]", "[W740]", "[E444]"]


def test_a_form_a_thousand_times_smaller_than_its_start_is_found(workshop):
    """Force densities put the free node in the middle of 2 mm, from a start 2 m away."""
    nodes = "id,x,y,z,fixed\n1,-0.001,0,0,1\n2,0.001,0,0,1\n3,0,2,0,0\n"
    text = SECTION + '[form_finding]\nmethod = "force_density"\n'
    f = workshop.solve(text, nodes, "start,end,force_density\n1,3,5\n2,3,5\n")
    assert np.allclose(f["form_finding/position"][2], 0.0, atol=1e-15)


# --- tolerances

SPAN = "id,x,y,z,fixed,load_x,load_z\n1,-1,0,0,1,{0},0\n2,0,0,0,0,0,-1\n3,1,0,0,1,0,0\n4,-2,0,-1,1,0,0\n"
THIN = "[cable]\nmodulus = 1.6e11\narea = 1e-6\ndensity = 7850.0\n"


@pytest.mark.parametrize("on_support, backstay", [(0, 0), (1e9, 0), (0, 1e9)])
def test_loads_on_supports_do_not_loosen_the_tolerance_of_statics(both_ways, on_support, backstay):
    """1 N on the middle of a span of 2 m under 1000 N gives a sag of 1 / (2 * 1000) m, for any load on
    supports. Stretch adds EA w^2 / 2 = 0.02 N to the tension: 2e-5 of the sag.
    """
    elements = f"start,end,prestress,area\n1,2,1000,\n2,3,1000,\n1,4,{backstay},1\n"
    sag = both_ways.solve(
        THIN + "[load]\nself_weight = false\nsteps = 1\ntolerance = 1e-9\n", SPAN.format(on_support), elements
    )["statics/displacement"][-1, 1, 2]
    assert np.isclose(sag, -5e-4, rtol=5e-5)


def test_a_backstay_does_not_loosen_the_tolerance_of_form_finding(both_ways):
    """The middle of a span starts 0.5 m above it and ends on it, to 1e-6 of 1000 N."""
    nodes = SPAN.format(0).replace("2,0,0,0,0", "2,0.3,0,0.5,0")
    elements = "start,end,prestress,area\n1,2,1000,\n2,3,1000,\n1,4,1e9,1\n"
    f = both_ways.solve(THIN + "[form_finding]\n", nodes, elements)
    assert abs(f["form_finding/position"][1, 2]) < 1e-6 and f["form_finding/residual"][()] <= 1e-6


# --- starts that are broken already, and units


def notes_of(workshop, job, *settings) -> list[str]:
    """Return the warnings and notes of `netfall check`, those of `netfall run` too, except on modes."""
    arguments = [word for setting in settings for word in ("--set", setting)]
    texts = workshop.check(job, *arguments), workshop.printed(job, *arguments, output="r.h5")
    check, run = (re.findall(r"^(?:note:|warning:(?! modes:)).*", text, re.M) for text in texts)
    assert set(check) <= set(run)
    return check


LINE = "id,x,y,z,fixed\n1,0,0,0,1\n2,2,0,0,0\n3,4,0,0,1\n"  # of three nodes [m]
BRITTLE = '[net]\ngenerator = "saddle"\n' + STEEL.replace("1.95e11", "195.0") + "fracture_strain = 0.0404\n"
BRITTLE += "[form_finding]\nmodulus_factor = 0\n[dynamics]\nduration = 0.01\n"
WINDY = BRITTLE.replace("195.0", "1.95e11").replace("fracture_strain = 0.0404\n", "")
WINDY += "[load]\nself_weight = false\n"
WINDY += "dead = 100\n[wind]\nonset = 'sudden'\nspeed = 20\npressure_coefficient = -1\n"
WINDY += "base_height = 10\nsurface_drag = 0.03\ngust_field = 'point'\n[output]\nhistory_interval = 0.002\n"


def test_a_modulus_in_gigapascals_is_refused(workshop):
    """195 for 195e9: 100 kN is a strain of 1e5 / (195 * 683.08e-6) = 7.507e5 in all elements."""
    job = workshop.job(BRITTLE)
    line = refused("run", job)
    assert "(0, 1, 2, 3, 4, ...): beyond fracture_strain at the start: 7.507e+05 in element 0" in line
    assert "allowed 0.0404" in line and "check the units of modulus (Pa)" in line
    assert "units" not in run_on_standing_ranks("check", job, "--set", "cable.modulus=1.95e11").stdout


@pytest.mark.parametrize(
    "limit, message",
    [
        ("fracture_strain = 0.05", "beyond fracture_strain at the start: 0.05263 in element 7 (nodes 1-2"),
        ("yield_stress = 1.5e9", "beyond yield force [N] at the start: 8.421e+05 in element 7 (nodes 1-2"),
    ],
)
def test_an_unstressed_length_beyond_the_limits_is_refused(workshop, limit, message):
    """2 m from 1.9 m: a strain of 1 / 19, a force of 1.6e7 / 19 = 8.42e5 N; 1.985 m is within both."""
    elements = "id,start,end,unstressed_length\n7,1,2,{0}\n9,2,3,{0}\n"
    job = workshop.job(f"{SECTION}{limit}\n[dynamics]\nduration = 1e-4\n", LINE, elements.format(1.9))
    assert "2 elements (7, 9): " + message in refused("run", job)
    (workshop.folder / "elements.csv").write_text(elements.format(1.985))
    notes = make_layout(read_job(job), 1).notes
    assert not [note for note in notes if "unit" in note or "strain" in note]


@pytest.mark.parametrize(
    "change, message",
    [
        ("cable.modulus=195", "modulus = 195 Pa of 112 elements (0, 1, 2, 3, 4, ...): implausible for"),
        ("cable.area=683", "area = 683 m2 of"),
        ("cable.density=7.85", "density = 7.85 kg/m3 of"),
        ("cable.diameter=0.0034", "diameter = 0.0034 m of 112 elements"),
        ("cable.yield_stress=1.75e17", "yield_stress = 1.75e+17 Pa of"),
        ("cable.fracture_strain=4.04", "fracture_strain = 4.04 of"),
        ("cable.prestress=100", "prestress of up to 100 N is a strain of"),
        ("load.dead=0.3", "load.dead = 0.3 N/m2: implausible for roofs (5 to 20000). Cladding weighs"),
        ("load.pressure=[0, 0, -0.8]", "load.pressure = [0.0, 0.0, -0.8] N/m2: implausible"),
        ("load.temperature=293", "load.temperature = 293.0 K: implausible"),
        ("load.snow=0.75", "load.snow = 0.75 N/m2: implausible"),
        ("load.added_mass=2000", "load.added_mass = 2000.0 kg/m2: implausible"),
        ("wind.speed=150", "wind.speed = 150.0 m/s: implausible"),
        ("wind.pressure_coefficient=-800", "wind.pressure_coefficient = -800.0: implausible"),
        ("wind.air_density=1250", "wind.air_density = 1250.0 kg/m3: implausible"),
        ("dynamics.mass_damping=50", "[dynamics] mass_damping = 50 1/s: implausible"),
        ("cable.breaking_load=6e2;cable.prestress=500", "breaking_load = 600 N of 112 elements"),
        ("cable.breaking_load=1e20", "breaking_load = 1e+20 N of 112 elements (0, 1, 2, 3, 4, ...): a"),
        ("net.saddle.side=7e4", "[net]: the net is 7e+04 m from end to end"),
    ],
)
def test_values_in_other_units_are_named(workshop, change, message):
    """One message for each kind of value that no usual cable has; none for steel."""
    job = workshop.job(WINDY)
    (note,) = make_layout(read_job(job, change.split(";")), 1).notes
    assert note.startswith(f"warning: {message}")


@pytest.mark.parametrize("stiffness, mass, expected", [(6.4e7, 3.14, 0), (6.4e4, 3.14, 1), (6.4e7, 3140, 1)])
def test_stiffness_and_mass_in_other_units_are_named(workshop, stiffness, mass, expected):
    """A job in kN or in g/m is recognised by the speed of waves. Without an area it has no modulus."""
    text = f"[cable]\naxial_stiffness = {stiffness}\nmass_per_length = {mass}\n"
    text += f"prestress = {1e-3 * stiffness}\n"
    notes = make_layout(read_job(workshop.job(text, LINE, "start,end\n1,2\n2,3\n")), 1).notes
    assert any("axial waves run along them at 142.8 m/s" in note for note in notes) == expected


@pytest.mark.parametrize(
    "duration, expected",
    [(1.0, "[wind] ramp: lasts until t = 2 s"), (10.0, ""), (600.0, "gusts slower than 71.3 s have")],
)
def test_gusts_of_short_and_of_long_runs_are_named(workshop, duration, expected):
    """Short gusts never reach their full size. Gusts of minutes have less in Davenport's spectrum."""
    text = WINDY.replace("onset = 'sudden'\n", "").replace("speed = 20", "speed = 46")
    text = text.replace("surface_drag = 0.03", "turbulence_intensity = 0.2")
    changes = ["--set", f"dynamics.duration={duration}", "--set", "output.history_interval=0.1"]
    output = run_on_standing_ranks("check", workshop.job(text), *changes).stdout
    assert ("[wind] ramp" in output or "slower than" in output) == bool(expected) and expected in output


@pytest.mark.parametrize(
    "spectrum, height, length",
    [("kaimal", 60.0, "340 m"), ("en1991", 40.0, "130 m"), ("kaimal", 10.0, ""), ("davenport", 60.0, "")],
)
def test_a_gust_length_for_another_height_is_a_warning(workshop, spectrum, height, length):
    """5.67 z up to 60 m (IEC 61400-1), 300 m (z / 200 m)^0.52 (EN 1991-1-4); none if the length is given."""
    changes = ["--set", f"wind.spectrum={spectrum}", "--set", f"wind.base_height={height}"]
    job = workshop.job(WINDY)
    output = run_on_standing_ranks("check", job, *changes).stdout
    assert ("where its formula gives" in output) == bool(length) and length in output
    given = run_on_standing_ranks("check", job, *changes, "--set", "wind.gust_length=200").stdout
    assert "where its formula gives" not in given


def test_cases_and_combinations_in_other_units_are_named(workshop):
    text = '[[case]]\nname = "west"\nset = {"wind.speed" = 30.0, "wind.pressure_coefficient" = 900.0}\n'
    text += '[[case]]\nname = "sunk"\nsettlement = {1 = [0.0, 0.0, -30.0]}\n'
    text += '[[combination]]\nname = "U"\nfactors = {permanent = 135.0, west = 1.5, sunk = 1.0}\n'
    notes = make_layout(read_job(workshop.job(WINDY + text)), 1).notes
    sunk, factor = "[[case]] sunk: settlement of up to 30 m", '[[combination]] "U": factors: permanent = 135'
    for words in "wind.pressure_coefficient = 900.0", sunk, factor:
        assert any(note.startswith(f"warning: {words}: implausible") for note in notes), words


IN_TIME = '[wind]\nfile = "wind.csv"\nbase_height = 10.0\npressure_coefficient = -1.0\n'
AT_TAPS = '[wind]\npressures = "wind.csv"\ntaps = "taps.csv"\n'
BY_SECTORS = '[wind]\nspeed = 30.0\nsurface_drag = 0.0\nbase_height = 10.0\nsectors = "wind.csv"\n'
AT_POINTS = '[[case]]\nname = "tunnel"\npressure_table = "wind.csv"\n'


@pytest.mark.parametrize(
    "section, table, expected",
    [
        (IN_TIME, "time,speed\n0,30\n0.5,90\n2,30\n", ""),
        (IN_TIME, "time,speed\n0,30\n0.5,110\n2,30\n", "wind.csv: speed of up to 110 m/s: implausible"),
        (IN_TIME, "time,speed\n0,30\n1000,35\n", "wind.csv: no row between 0 and duration = 1 s"),
        (AT_TAPS, "time,a\n0,-0.5\n0.5,-0.8\n2,1\n", "wind.csv: pressure of up to 1 N/m2: implausible"),
        (AT_TAPS, "time,a\n0,1\n0.5,-800\n2,1\n", ""),
        (
            BY_SECTORS,
            "direction,pressure_coefficient\n0,-800\n90,2\n",
            "wind.csv: pressure_coefficient of up to 800",
        ),
        (AT_POINTS, "x,y,pressure\n0,0,0.8\n", "[[case]] tunnel: pressure_table: pressure of up to 0.8 N/m2"),
    ],
)
def test_tables_in_other_units_are_named(workshop, section, table, expected):
    """km/h, ms, kN/m2, a pressure for a coefficient. Values of a possible storm give no message."""
    job = workshop.job(WINDY[: WINDY.index("[wind]")] + section)
    (workshop.folder / "wind.csv").write_text(table)
    (workshop.folder / "taps.csv").write_text("name,x,y\na,0,0\n")
    notes = make_layout(read_job(job, ["dynamics.duration=1"]), 1).notes
    notes = [note for note in notes if "implausible" in note or "no row" in note]
    assert [note.startswith(f"warning: {expected}") for note in notes] == [True] * bool(expected), notes


@pytest.mark.parametrize("load, mass, is_noted", [(-5.0, 510, True), (-5e3, 0.51, True), (-5e3, 510, False)])
def test_loads_and_masses_of_nodes_in_other_units_are_named(workshop, load, mass, is_noted):
    nodes = f"id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,,\n2,2,0,0,0,{load},{mass}\n3,4,0,0,1,,\n"
    text = SECTION + "prestress = 1e5\n[dynamics]\nduration = 1.0\n"
    notes = make_layout(read_job(workshop.job(text, nodes, "start,end\n1,2\n2,3\n")), 1).notes
    assert any("loads may be in kN, masses in t" in note for note in notes) == is_noted


def test_an_unstressed_length_in_millimetres_is_named(workshop):
    job = workshop.job(SECTION, LINE, "start,end,unstressed_length\n1,2,1990\n2,3,1990\n")
    (note,) = notes_of(workshop, job)
    assert "elements that start compressed or slack by more than 50%" in note and "-0.999" in note


# --- keys without effect

NO_GUSTS = "[wind] seed, gust_field: no effect: with surface_drag = 0 there are no gusts"
LATE = "[output] checkpoint_interval: no effect: it is not shorter than the duration"
IDLE = {
    "dynamics.safety=0.5 dynamics.time_step=1e-5": "[dynamics] safety: no effect: time_step is fixed",
    "dynamics.fragment_mass=0.1": "[dynamics] fragment_mass: no effect: nothing can break",
    "form_finding.method=force_density form_finding.start=given": "[form_finding] start, modulus_factor",
    "load.tolerance=1e-3": "[load] tolerance: no effect: with steps = 0 there is no statics",
    "wind.pressure_coefficient=0": "[wind]: no effect: pressure_coefficient = 0",
    "wind.surface_drag=0 wind.seed=3": NO_GUSTS,
    "wind.surface_drag=0 wind.ramp=1": NO_GUSTS.replace("seed, gust_field", "gust_field, ramp"),
    "load.stop_at_strength=true cable.fracture_strain=1": "[load] stop_at_strength: no effect: there is no",
    "wind.after_fracture=all": "[wind] after_fracture: no effect: nothing can break",
    "output.checkpoint_interval=1": LATE,
}


@pytest.mark.parametrize("settings", IDLE)
def test_a_key_without_effect_is_named(workshop, settings):
    job = workshop.job(WINDY)
    notes = make_layout(read_job(job, settings.split()), 1).notes
    assert any(note.startswith(f"note: {IDLE[settings]}") for note in notes)


def test_keys_with_an_effect_are_not_named(workshop):
    """Stages are equilibria to the tolerance of [load], also without load steps."""
    job = workshop.job(WINDY)
    assert make_layout(read_job(job), 1).notes == ()
    assert make_layout(read_job(job, ["load.added_mass=0"]), 1).notes == ()
    job = read_job(workshop.job(WINDY + '[[stage]]\nname = "erected"\n'), ["load.tolerance=1e-3"])
    assert not any("tolerance: no effect" in note for note in make_layout(job, 1).notes)


def test_sections_and_columns_without_effect_are_named(workshop):
    text = SECTION + "[load]\nself_weight = false\ndead = 3\nsteps = 0\n[output]\nframes = 3\n"
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,5,\n2,2,0,0,0,5,\n3,4,0,0,1,5,-10\n4,2,1,0,1,0,\n"
    rows = [(1, 2, 1.99), (2, 3, 1.99), (2, 4, 1), (1, 4, 2.23), (3, 4, 2.23)]
    rows = [(a, b, 5, L, 100) for a, b, L in rows]
    elements = table("start,end,force_density,unstressed_length,prestress", rows)
    notes = notes_of(workshop, workshop.job(text, nodes, elements))
    for start in (
        "warning: [load]: no effect: steps = 0",
        "note: [output] frames: no effect: there is no [dynamics]",
        "note: column force_density: no effect",
        "note: prestress: no effect: every element has an unstressed_length",
        "warning: columns load_x, load_y, load_z: no effect",
        "note: column mass: no effect",
    ):
        assert any(note.startswith(start) for note in notes), start


def test_roof_groups_without_loads_are_named(workshop):
    """The faces of a group matter to loads on the roof, and to the area that form finding changes."""
    text = BRITTLE.replace("195.0", "1.95e11") + '[roof]\ngroups = ["x"]\n'
    assert not any("[roof] groups" in note for note in notes_of(workshop, workshop.job(text)))
    job = workshop.job(text.replace("[form_finding]\nmodulus_factor = 0\n", ""))
    assert any("[roof] groups: no effect" in note for note in notes_of(workshop, job))


def test_a_yield_stress_above_the_stress_at_fracture_is_named(workshop):
    """1.95e11 * 0.001 = 1.95e8 Pa at fracture is above the 1.5e8 Pa of the prestress, below 1.75e9 Pa."""
    text = BRITTLE.replace("195.0", "1.95e11").replace("0.0404", "0.001\nyield_stress = 1.75e9")
    (note,) = [n for n in notes_of(workshop, workshop.job(text)) if "yield_stress" in n]
    assert "breaks at a strain of 0.001, before it yields at 0.00897" in note
    statics = text + "[load]\nsteps = 1\nstop_at_strength = {}\n"  # in statics it breaks if asked alone
    for stops in ("true", "false"):
        notes = notes_of(workshop, workshop.job(statics.format(stops)))
        assert any("before it yields" in note for note in notes) == (stops == "true")


def test_trade_warns_of_a_varied_safety_if_the_step_is_fixed(workshop):
    """All runs would be equal. The message comes before the first run, whose launcher fails."""
    job = workshop.job(WINDY)
    line = ["trade", job, "--vary", "dynamics.safety=0.8", "--set", "dynamics.time_step=2e-4", "--reference"]
    line += ["dynamics.time_step=1e-4", "--launcher", "false {ranks}", "-o", workshop.folder / "out"]
    done = run_on_standing_ranks(*line, code=2)
    assert "--vary dynamics.safety: time_step is fixed" in done.stdout, done.stderr


# --- the audit

SPRING = "id,x,y,z,fixed,mass\n1,-1,0,0,1,0\n2,0.001,0,0,0,{0!r}\n3,1,0,0,1,0\n"


def swing(workshop, phase: float):
    """Return the result of a weight between two cables, released 1 mm away, with steps of omega dt = phase.
    Two cables of 1.6e7 N from 0.99 m: k = 2 * 1.6e7 / 0.99 N/m. The mass follows from omega = phase / 1 ms.
    """
    mass = 2 * 1.6e7 / 0.99 / (phase / 1e-3) ** 2 - 7850 * 1e-4 * 0.99
    text = SECTION + "[dynamics]\nduration = 0.2\ntime_step = 1e-3\n"
    text += "[output]\nhistory_interval = 1e-3\nframes = 1\n"
    elements = "start,end,unstressed_length\n1,2,0.99\n2,3,0.99\n"
    return workshop.solve(text, SPRING.format(mass), elements)


@pytest.mark.parametrize("phase, expected", [(0.5, "0.067"), (0.06, None)])
def test_the_balance_error_of_a_start_out_of_equilibrium_by_hand(workshop, phase, expected):
    """Central difference: the energy is k a^2 (1 - q sin^2), of which k a^2 (1 - q) sin^2 moves,
    with q = (omega dt)^2 / 4.

    So without any external work the balance is off by q / (1 - q) at most; above 0.1 % that
    is said after the run and by `info`. With their prestress, a strain of 0.01, the cables store 101
    times k a^2, a 1 mm: of that it is q / 101.
    """
    f = swing(workshop, phase)
    h, q = f["history"], phase**2 / 4
    assert not h["external_work"][:].any()
    assert np.isclose(np.abs(h["energy_balance_error"][:]).max(), q / (1 - q), rtol=1e-6)
    assert np.isclose(np.abs(h["balance_error_attached"][:]).max(), q / 101, rtol=1e-3)
    assert np.isclose(h["kinetic_energy"][:].max(), 1.6e7 / 0.99 * 1e-6 * (1 - q), rtol=1e-3)
    assert np.abs(h["work_identity_error"][:]).max() < 1e-12
    assert h["energy_balance_error"].attrs["unit"] == "1"
    info = run_on_standing_ranks("info", f.filename).stdout
    assert ("is off by up to" in info) == bool(expected) and (expected or "balance to") in info
    again = "run", workshop.folder / "job.toml", "-o", workshop.folder / "again.vtkhdf"
    assert ("is off by up to" in run_on_standing_ranks(*again).stdout) == bool(expected)


def test_the_balance_error_of_a_net_in_equilibrium_ignores_rounding(workshop):
    """A form-found net does not move. The rounding of its stored energy is far below the limit."""
    job = workshop.job(BRITTLE.replace("195.0", "1.95e11").replace("= 0.01", "= 0.3"))
    h = workshop.run(job, "--set", "form_finding.tolerance=1e-11")["history"]
    assert np.abs(h["energy_balance_error"][:]).max() < 1e-3 and np.abs(h["kinetic_energy"][:]).max() < 1e-9


# --- limits of the step, and what moves

BAR = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"


@pytest.mark.parametrize("kind", ["bar", "cable"])
def test_a_step_too_long_for_unstressed_elements_is_refused(workshop, kind):
    """Two elements of 1.6e7 N/m without tension, 0.785 kg: 2 / sqrt(3.2e7 / 0.785) = 3.132e-4 s."""
    text = f'{SECTION}kind = "{kind}"\n[dynamics]\nduration = 0.01\ntime_step = '
    elements = "start,end\n1,2\n2,3\n"
    line = refused("run", workshop.job(text + "3.2e-4\n", BAR, elements))
    assert "above the stable step 0.0003132 s of the net in any shape" in line
    workshop.solve(text + "3.1e-4\n", BAR, elements)


def test_a_step_that_is_stable_only_in_the_given_shape_is_refused(workshop):
    """Cables of 10 and 50^0.5 m at right angles may align: 2 / sqrt(EA (1/10 + 50^-0.5) / M) = 2.386e-3 s.

    At right angles 3.117e-3 s is stable. With EA = 1.332e8 N, M = 45.77 kg.
    """
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,-10,0\n3,5,5,-10,1\n"
    text = BARE + "[dynamics]\nduration = 0.01\ntime_step = 3.1e-3\n"
    job = workshop.job(text, nodes, "start,end\n1,2\n2,3\n")
    assert "above the stable step 0.002386 s of the net in any shape" in refused("run", job)


TWO = SECTION
TWO += "[group.weak]\nfracture_strain = {0}\n[dynamics]\nduration = 0.05\nsafety = 0.05\nfragment_mass = 0\n"


def test_elements_that_cannot_break_do_not_shorten_the_step(workshop):
    """100 kg between 0.1 m that cannot break and 1 m that can: 1 / c = 2.215e-4 s, not a tenth of it.

    Let go 2.07 mm off its place, the weight swings by twice that: the weak one breaks at 0.55 of 0.66 %, at
    both ends, for the other one is slack and each end has but its force.
    """
    nodes = "id,x,y,z,fixed,mass\n1,0.9,0,0,1,0\n2,0.9975,0,0,0,100\n3,2,0,0,1,0\n"
    elements = "start,end,group,unstressed_length\n1,2,strong,0.095\n2,3,weak,1.0\n"
    f = workshop.solve(TWO.format(0.0055), nodes, elements)
    limit = f["provenance"].attrs["limit_after_fracture"]
    assert np.isclose(limit, np.sqrt(7850 / 1.6e11), rtol=1e-6)
    assert set(f["events/element"][:]) == {1} and np.abs(f["history/energy_balance_error"][:]).max() < 1e-2


def test_a_rim_between_supports_stays_when_subdivided(workshop):
    """4 m x 4 m with a cross of cables under 100 kN, 100 N/m2: the middle sags by 2 mm, the rim not at all.

    In halves of the segments, by nearest corner, the middle carries 4 x 1/4 m2, each of its four neighbours
    2 x 3/4 m2: w_i = 1.75 p / T, w_c = 2 p / T, less 2e-4 of it for the stretch.
    """
    nodes = table("id,x,y,z,fixed", ((k, 2 * (k % 3), 2 * (k // 3), 0, int(k != 4)) for k in range(9)))
    rim = [(0, 1), (1, 2), (2, 5), (5, 8), (8, 7), (7, 6), (6, 3), (3, 0)]
    rows = [(*pair, 0) for pair in rim] + [(4, k, 1e5) for k in (1, 3, 5, 7)]
    elements = table("start,end,prestress", rows)
    text = SECTION + "[load]\nself_weight = false\npressure = 100\nsteps = 1\ntolerance = 1e-9\n"
    f = workshop.solve(text, nodes, elements, "--set", "net.subdivide=2")
    w, area = -f["statics/displacement"][-1, :, 2], f["net/tributary_area"][:]
    free = ~f["net/fixed"][:].astype(bool).any(1)
    assert free.sum() == 5 and not w[~free].any() and np.isclose(area.sum(), 16.0)
    assert np.isclose(w[4], 2e-3, rtol=1e-3) and np.allclose(w[free][1:], 1.75e-3, rtol=1e-3)


def test_a_compressed_bar_in_parts_is_named(workshop):
    """A mast of 1 m under 100 N is held by a cable. In parts, its middle has no lateral support."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,1,0\n3,0,0,-1,1\n"
    elements = "id,start,end,group,prestress\n5,1,2,mast,-100\n6,3,2,,100\n"
    job = workshop.job(SECTION + '[group.mast]\nkind = "bar"\n', nodes, elements)
    assert notes_of(workshop, job) == []
    (note,) = notes_of(workshop, job, "net.subdivide=2")
    assert "warning: [net] subdivide: element 5: compressed bars" in note


def test_a_run_that_ends_after_its_duration_states_its_end(workshop):
    """Two whole steps of 6 ms for a duration of 10 ms end at 12 ms."""
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,0\n2,1,0,0,0,9000\n3,2,0,0,1,0\n"
    text = SECTION + "prestress = 1e3\n[dynamics]\nduration = 0.01\ntime_step = 0.006\n"
    job = workshop.job(text, nodes, "start,end\n1,2\n2,3\n")
    assert any("the run ends at t = 0.012 s" in note for note in notes_of(workshop, job))
    assert workshop.open("r.h5")["history/time"][-1] == 0.012
    assert notes_of(workshop, job, "dynamics.time_step=0.005") == []


def test_a_probe_over_two_layers_names_its_node(workshop):
    """Nodes 2 and 5 are 1 m above one another; at [0, 0] there is only one."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n4,0.5,0,1,1\n5,1,0,1,0\n6,1.5,0,1,1\n"
    text = SECTION + "prestress = 1e3\n[dynamics]\nduration = 1e-3\n[output]\nhistory_interval = 1e-3\n"
    job = workshop.job(text + "probes = [[1, 0], [0, 0]]\n", nodes, "start,end\n1,2\n2,3\n4,5\n5,6\n")
    (note,) = [note for note in notes_of(workshop, job) if "probes" in note]
    assert "[1, 0]: nodes 2, 5 lie above one another there. Its histories are those of node 2" in note


# --- excessive strains, nodes outside the wind's profile, names that are nearly the same


@pytest.mark.parametrize("ranks", [1, 2])
def test_strains_too_large_for_cables_are_a_warning_in_motion(workshop, ranks):
    """4.4 kN applied at once to EA = 10 kN: 44 % in equilibrium, at most twice that in motion."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,100,-4400\n"
    text = "[cable]\nmodulus = 1e8\narea = 1e-4\ndensity = 7850.0\n[dynamics]\nduration = 2.5\n"
    job = workshop.job(text + "[output]\nhistory_interval = 0.05\n", nodes, "id,start,end\n7,1,2\n")
    line = ["run", job, "-o", workshop.folder / "r.vtkhdf"]
    (note,) = lines_with("strain of", *line, ranks=ranks)
    # omega = sqrt(1e4 / 10 / 103.9) = 3.1 1/s: within 0.025 s of the lowest point, 1 - cos(0.08) = 0.3 %
    strain = float(note.split("strain of ")[1].split()[0])
    assert note.startswith("warning: element 7 (nodes 1-2, 10 m)") and abs(strain / 0.88 - 1) < 4e-3
    assert "no fracture_strain" in note
    still = run_on_standing_ranks(*line, "--set", "cable.modulus=1e11").stdout
    assert "strain of" not in still


def test_strains_too_large_for_cables_are_a_warning_in_statics(workshop):
    """3 kN on EA = 10 kN: 30 %. A slack cable of twice the length does not count."""
    nodes = "id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,0,0,-2,0,-3000\n"
    text = "[cable]\nmodulus = 1e8\narea = 1e-4\ndensity = 1000.0\n[load]\nself_weight = false\nsteps = 1\n"
    job = workshop.job(text, nodes, "id,start,end,unstressed_length\n7,1,2,2\n8,1,2,6\n")
    (note,) = lines_with("strain of 0.3, ", "run", job, "-o", workshop.folder / "r.vtkhdf")
    assert note.startswith("warning: element 7 ") and " t = " not in note


def test_nodes_below_the_profile_of_the_wind_are_named(workshop):
    """A roof at z = -3, -2 and 5 m has z = 0 at 2 m above ground: two nodes are too low."""
    nodes = "id,x,y,z,fixed\n1,0,0,5,1\n2,2,0,5,1\n3,2,2,-2,0\n4,0,2,-3,0\n5,5,5,-9,1\n6,6,6,-9,1\n"
    text = SECTION
    text += "[wind]\nonset = 'sudden'\nspeed = 20\npressure_coefficient = -1\nsurface_drag = 0\n"
    text += "base_height = {}\n"
    elements = "start,end\n1,2\n2,3\n3,4\n4,1\n5,6\n"
    job = workshop.job(text.format(2) + "[dynamics]\nduration = 1e-3\n", nodes, elements)
    (note,) = lines_with("base_height", "check", job)
    assert "nodes in the wind less than 1 m above ground: 2; the lowest is node 4 at -1 m" in note
    assert "base_height" not in run_on_standing_ranks("check", job, "--set", "wind.base_height=4.0").stdout
    values = "{speed = 20, pressure_coefficient = -1, base_height = 2}"
    cases = "".join(f"[[case]]\nname = '{name}'\nset = {{wind = {values}}}\n" for name in ("west", "east"))
    (note,) = lines_with("base_height", "check", workshop.job(SECTION + cases, nodes, elements))
    assert note.startswith("warning: [[case]] west: base_height = 2: nodes in the wind less than 1 m above")


@pytest.mark.parametrize(
    "base, warned", [("430", 1), ("203.5", 1), ("202", 0), ("30000", 1), ('"30000 mm"', 0)]
)
def test_a_roof_far_above_ground_is_named_once(workshop, base, warned):
    """The lowest node in the wind is at z = -3 m: its height is 427 m, 200.5 m, ..."""
    nodes = "id,x,y,z,fixed\n1,0,0,5,1\n2,2,0,5,1\n3,2,2,-2,0\n4,0,2,-3,0\n"
    values = f"{{speed = 20, pressure_coefficient = -1, base_height = {base}}}"
    cases = "".join(f"[[case]]\nname = '{name}'\nset = {{wind = {values}}}\n" for name in ("west", "east"))
    notes = lines_with(
        "[W158]", "check", workshop.job(SECTION + cases, nodes, "start,end\n1,2\n2,3\n3,4\n4,1\n")
    )
    assert len(notes) == warned
    assert base != "430" or ("case]] west: base_height = 430: " in notes[0] and "node 4 at 427 m" in notes[0])


def test_a_group_with_a_similar_name_of_section_is_named(workshop):
    """Group Mast takes [cable], not [group.mast]; group edge does so on purpose. One warning names all."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"
    elements = "start,end,group\n1,2,Mast\n2,3,mast\n2,3,edge\n"
    job = workshop.job(SECTION + "[group.mast]\narea = 2e-4\n", nodes, elements)
    (note,) = [note for note in notes_of(workshop, job) if "group" in note]
    assert note.startswith('warning: group "Mast": no section has this name, so ') and "[W458]" in note
    assert "If [group.mast] is meant, correct the name in the table" in note
    job = workshop.job(SECTION + "[group.mast]\narea = 2e-4\n", nodes, elements.replace("edge", "mast2"))
    (note,) = [note for note in notes_of(workshop, job) if "group" in note]
    assert note.startswith('warning: 2 groups ("Mast", "mast2"): no section has this name')
    wheel = "[net]\ngenerator = 'wheel'\n[cable]\naxial_stiffness = 1e8\nmass_per_length = 10.0\n"
    wheel += "[group.ring_upper]\naxial_stiffness = 1e9\n"  # there, no table has a name to correct
    wheel += "".join(f"[group.{name}]\nkind = 'bar'\n" for name in ("ring_outer", "ring_truss", "strut"))
    assert not any("no section has" in note for note in notes_of(workshop, workshop.job(wheel, name="wheel")))
