"""Notes, warnings and refusals are true, appear once, and are absent from faultless jobs."""

import re

import numpy as np
import pytest
from conftest import BARE, STEEL, refused, run_on_standing_ranks

CURVED = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_y\n" + "".join(
    f"{k},{10.0 * np.cos(t):.9f},0,{10.0 * np.sin(t):.9f},{int(k < 2)},{{y}},{int(k < 2)},{{load}}\n"
    for k, t in enumerate(0.1 * np.arange(12))
)
IN_PLANE = CURVED.format(y=1, load=0)
ACROSS = CURVED.format(y=0, load=1e4).replace("1,0,1,10000.0", "1,1,1,0")
CHAIN = "start,end\n" + "".join(f"{k},{k + 1}\n" for k in range(11))
RING = (
    '[cable]\nkind = "bar"\nbending = true\nmodulus = 3e10\narea = 1.2\ndensity = 2500.0\n'
    "yield_stress = 30e6\nsecond_moment = 0.16\n[load]\nself_weight = {weight}\nsteps = {steps}\n"
)
HEAVY = RING.format(weight="true", steps=1)


def text_of(workshop, verb: str, job) -> str:
    """Return the output of a command on a job."""
    more = ["-o", workshop.folder / "result.vtkhdf"] if verb == "run" else []
    return run_on_standing_ranks(verb, job, *more).stdout


@pytest.mark.parametrize("verb", ["check", "run"])
def test_a_curved_chain_without_forces_is_in_equilibrium(workshop, verb):
    """A concrete chain, curved without moment, has only rounding errors: no note."""
    text = text_of(workshop, verb, workshop.job(HEAVY, IN_PLANE, CHAIN))
    assert "in equilibrium with its prestress" not in text and "Check for" not in text, text


def test_parts_of_a_chain_have_no_resistance(workshop):
    """The Euler load between two nodes does not apply. Only buckling_length gives the chain a resistance."""
    for length, stands in (("", False), ("buckling_length = 8.0\n", True)):
        text_of(workshop, "run", workshop.job(HEAVY.replace("second", length + "second"), IN_PLANE, CHAIN))
        rows = workshop.report().rows("elements")
        assert any(row.get("result_en1993_buckling") for row in rows) == stands, rows


@pytest.mark.parametrize(
    "area, second_moment, words",
    [
        (1e-3, 80.0, "second_moment = 80 m4 of 11 elements"),  # cm4
        (120.0, 0.16, "area = 120 m2 of 11 elements (0, 1, 2, 3, 4, ...): implausible for bars"),  # dm2
    ],
)
def test_bars_in_other_units_are_named(workshop, area, second_moment, words):
    text = HEAVY.replace("area = 1.2", f"area = {area}").replace("= 0.16", f"= {second_moment}")
    output = text_of(workshop, "check", workshop.job(text, IN_PLANE, CHAIN))
    assert words in output, output


def test_a_given_axial_stiffness_implies_no_modulus(workshop):
    """A bungee of EA = 100 N and 4 kg/m would have 2e5 Pa as steel of that mass, which was not given."""
    text = "[cable]\naxial_stiffness = 100.0\nmass_per_length = 4.0\n"
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,5,0,0,0\n3,10,0,0,1\n"
    output = text_of(workshop, "check", workshop.job(text, nodes, "start,end\n1,2\n2,3\n"))
    assert "modulus =" not in output and "axial waves run along them at 5 m/s" in output, output


def test_a_prestress_outside_all_states_is_refused_with_its_group(workshop):
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,5,0,0,0\n3,10,0,0,1\n4,5,5,0,1\n"
    elements = "start,end,group\n1,2,line\n2,3,line\n2,4,stay\n"
    assert "prestress = 100e3\n" in STEEL
    text = BARE + "[group.stay]\nprestress = 1e4\n"
    job = workshop.job(text + '[form_finding]\nmethod = "given_geometry"\n', nodes, elements)
    line = refused("run", job, "-o", workshop.folder / "result.vtkhdf")
    assert "prestress of group stay: no state of self-stress of the geometry has it" in line
    assert "(1 known, with forces in line)" in line and "axial force is" not in line


def test_bending_across_the_plane_of_a_chain_is_one_warning(workshop):
    """It occurs in four load steps, but not in the permanent loads; one line covers them."""
    job = workshop.job(RING.format(weight="false", steps=4), ACROSS, CHAIN)
    lines = [line for line in text_of(workshop, "run", job).splitlines() if "bends out of its plane" in line]
    assert len(lines) == 1 and lines[0].startswith("warning: statics") and "in 4 of 5 equilibria" in lines[0]


@pytest.mark.parametrize(
    "steps, more, place",
    [(1, "", ""), (0, '[[stage]]\nname = "a"\n', r"warning: stage a: estimated error \S+ \(\[load\] ")],
)
def test_a_tolerance_below_rounding_is_named_with_the_least_one(workshop, steps, more, place):
    """1e-12 of the tension of a chain of 100 parts of 1 m at 4000 m from the origin, with EA = 8e7 N.

    Coordinates are rounded to 4.5e-13 m there, so strains to 4.5e-13 and forces to 3.6e-5 N. At 1.05 times
    its span the chain has 2 to 5 kN. In a stage of erection too.
    """
    nodes = "id,x,y,z,fixed\n" + "".join(f"{k},{4000 + k},0,0,{int(k % 100 == 0)}\n" for k in range(101))
    elements = "start,end,unstressed_length\n" + "".join(f"{k},{k + 1},1.05\n" for k in range(100))
    text = "[cable]\nmodulus = 1.6e11\narea = 5e-4\ndensity = 7850.0\n"
    text += f"[load]\nself_weight = true\nsteps = {steps}\ntolerance = 1e-12\n"
    output = text_of(workshop, "run", workshop.job(text + more, nodes, elements))
    allowed = r"tolerance = 1e-12; rounded coordinates allow (\S+)\). Set tolerance to"
    match = re.search(place + allowed, output)
    assert 3.6e-5 / 5e3 < float(match[1]) < 10.0 * 3.6e-5 / 2e3, output


def test_a_state_without_forces_has_no_error(workshop):
    """Three bars find their unstressed lengths without load, so all forces are rounding errors."""
    nodes = "id,x,y,z,fixed,load_z\n0,0,0,0,1,0\n1,3,0.7,4.1,0,-1e5\n2,6.1,0,0,1,0\n3,3.3,5.9,0,1,0\n"
    text = '[cable]\nkind = "bar"\nmodulus = 2.1e11\narea = 1e-3\ndensity = 7850.0\n'
    text += "[load]\nself_weight = false\nsteps = 1\n"
    elements = "start,end,unstressed_length\n0,1,5.2\n1,2,5.1\n1,3,6.5\n"
    assert "rounded coordinates allow" not in text_of(workshop, "run", workshop.job(text, nodes, elements))


PLAN = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,10,10,0,1\n4,0,10,0,1\n5,{x},5,0,0\n"
SIDES = "start,end,force_density\n" + "".join(
    f"{ends},1e4\n" for ends in ("1,5", "2,5", "3,5", "4,5", "1,2", "2,3", "3,4", "4,1")
)


@pytest.mark.parametrize("x, is_far", [(5.15, False), (5.25, True)])
@pytest.mark.parametrize("form", ["modulus_factor = 0.0", 'method = "force_density"'])
def test_a_form_that_moves_nodes_in_plan_is_a_warning(workshop, x, is_far, form):
    """The middle of a square moves by 1.5 % and 2.5 % of its side; at constant tension with a remedy."""
    text = f"{STEEL}[form_finding]\n{form}\n"
    lines = text_of(workshop, "check", workshop.job(text, PLAN.format(x=x), SIDES)).splitlines()
    warnings = [line for line in lines if line.startswith("warning: form finding: ")]
    assert len(warnings) == is_far
    if is_far:
        assert (
            "1 of 5 nodes moved in plan by more than 2% of the span of 10 m; node 5 moved most, by 2"
            in warnings[0]
        )
        assert ("Constant tension moves nodes along cables" in warnings[0]) == (
            form == "modulus_factor = 0.0"
        )
        workshop.run(workshop.folder / "job.toml").close()
        assert workshop.info().count("moved in plan") == workshop.report().page.count("moved in plan") == 1


@pytest.mark.parametrize("ends", [False, True])
def test_loads_that_continue_beyond_the_stage_are_a_warning(workshop, ends):
    """Gusts of a table, a pressure ramp, a fading tension, a wave over supports 10 m apart, a record; 2 s."""
    ramp, growth, fade, speed = (2.0, 2.0, 1.0, 10.0) if ends else (4.0, 8.0, 10.0, 2.0)
    text = STEEL + (
        f'[load]\npressure = -100.0\nramp = {growth}\n[wind]\nfile = "wind.csv"\nramp = {ramp}\n'
        "base_height = 10.0\npressure_coefficient = -1.0\n"
        f"[[remove]]\nelements = [2]\ntime = 1.0\nduration = {fade}\n"
        f'[[motion]]\ndisplacement = "move.csv"\nspeed = {speed}\ntravel = [1.0, 0.0, 0.0]\n'
        '[[motion]]\nnodes = [4]\nacceleration = "shake.csv"\n[dynamics]\nduration = 2.0\n'
    )
    nodes = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n1,-5,0,0,1,,,,\n2,0,0,0,0,4,0,0,1\n"
    nodes += "3,5,0,0,1,,,,\n4,0,5,0,1,,,,\n"
    job = workshop.job(text, nodes, "id,start,end\n1,1,2\n2,2,3\n3,2,4\n")
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n4,40\n")
    (workshop.folder / "move.csv").write_text("time,z\n0,0\n0.2,-0.01\n")
    last = 0.05 if ends else 0.5  # m/s2, of up to 1: the rest of a record may be weak
    (workshop.folder / "shake.csv").write_text(f"time,x\n0,0\n0.5,1\n1,0\n2.2,{last}\n2.5,0\n3,0\n")
    rest = "of its largest acceleration or velocity is still to come"
    output = text_of(workshop, "check", job)
    output = re.findall(r"warning: (.*): lasts until t = (.*) s, .* At its end (.*?)\. ", output)
    expected = [
        ("[wind] ramp", "4", "gusts have 50.0% of their full size"),
        ("[load] ramp", "8", "25.0% of the pressure acts"),
        ("[[remove]] 1", "11", "90.0% of the removed tension still acts"),
        ("[[motion]] 1", "5.2", f"up to 100% {rest}, and 2 supports did not move yet"),
        ("[[motion]] 2", "2.5", f"up to 50% {rest}"),
    ]
    assert output == ([] if ends else expected)
