"""Compressed bars: the Euler load and the check of EN 1993-1-1, 6.3.1, in the report."""

import numpy as np
import pytest
from conftest import STEEL, assert_same_bits_on, audits
from mpi4py import MPI

from netfall.core.errors import InputError
from netfall.driver.sample import run_sample
from netfall.geometry.build import build_net
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.post.checks.bending import IMPERFECTION, buckling_reduction, slenderness
from netfall.post.checks.codes import read_codes

# A post of 4 m, its head held sideways, below 200 kN; a level cable at it.
NODES = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,0,0,4,1,1,0,-200e3\n3,5,0,4,1,1,1,0\n"
ELEMENTS = "id,start,end,group\n7,1,2,post\n8,2,3,\n"
POST = '[group.post]\nkind = "bar"\nmodulus = 2.1e11\narea = 3e-3\nprestress = 0.0\nyield_stress = 355e6\n'
POST += "second_moment = 5e-6\n"
STATICS = STEEL.replace("100e3", "0.0") + "[load]\nself_weight = false\nsteps = 1\n"
BY_CURVE = {  # chi of the curves a0 to d by hand; EN 1993-1-1, figure 6.4
    0.2: (1.0, 1.0, 1.0, 1.0, 1.0),
    0.5: (0.9513, 0.9243, 0.8842, 0.8430, 0.7793),
    1.0: (0.7253, 0.6656, 0.5970, 0.5399, 0.4671),
    1.5: (0.3953, 0.3724, 0.3422, 0.3145, 0.2766),
    2.5: (0.1515, 0.1467, 0.1397, 0.1325, 0.1214),
}


@pytest.mark.parametrize("slender", BY_CURVE)
def test_reduction_factors_are_those_of_the_five_curves(slender):
    """At five slendernesses, to the four figures of tables."""
    alpha = np.array(list(IMPERFECTION.values()))
    assert np.round(buckling_reduction(np.full(5, slender), alpha), 4).tolist() == list(BY_CURVE[slender])
    assert slenderness(np.array([slender**2 * 3e5]), np.array([3e5])) == pytest.approx(slender, rel=1e-12)


def rows_of(workshop, more="", parts=1):
    """Return rows of the table of elements in the report on the post, by element."""
    workshop.solve(STATICS + POST + more, NODES, ELEMENTS, "--set", f"net.subdivide={parts}").close()
    return {int(row["element"]): row for row in workshop.report().rows("elements")}


@pytest.mark.parametrize("length, warns", [(0.004, True), (1.7, True), (2.0, False), (8.0, False)])
@pytest.mark.parametrize("parts", [1, 3])
def test_a_buckling_length_below_half_the_length_is_a_warning(workshop, length, warns, parts):
    """The post of 4 m, also in parts. With clamped ends it has 2 m."""
    job = workshop.job(STATICS + POST + f"buckling_length = {length}\n", NODES, ELEMENTS)
    notes = build_net(read_job(job, [f"net.subdivide={parts}"])).notes
    assert any("[W147]" in note and "a length of 4 m" in note for note in notes) == warns


def test_the_check_of_a_post_agrees_with_a_hand_calculation(workshop):
    """N_cr = pi^2 E I / L^2 over all its parts, lambda, chi of curve c, utilisation; cables have none."""
    rows = rows_of(workshop)
    N_cr, N_y = np.pi**2 * 2.1e11 * 5e-6 / 16.0, 3e-3 * 355e6
    slender = np.sqrt(N_y / N_cr)
    phi = 0.5 * (1 + 0.49 * (slender - 0.2) + slender**2)
    chi = 1 / (phi + np.sqrt(phi**2 - slender**2))
    post, of = rows[7], lambda name: float(rows[7][name])
    assert of("euler_load") == pytest.approx(N_cr, rel=1e-10)  # the table has twelve digits
    assert (of("slenderness"), of("chi")) == (pytest.approx(slender), pytest.approx(chi))
    assert of("compression_en1993_buckling") == pytest.approx(200e3, rel=1e-6)
    assert of("utilisation_en1993_buckling") == pytest.approx(200e3 / (chi * N_y), rel=1e-6)
    assert of("utilisation_euler") == pytest.approx(200e3 / N_cr, rel=1e-6)
    assert post["case_en1993_buckling"].startswith("statics")
    assert rows[8]["euler_load"] == rows[8]["utilisation_euler"] == ""
    page = (workshop.folder / "report" / "summary.md").read_text()
    assert "chi N_y / gamma_M1: largest" in page and "[W847]" not in page
    workshop.solve(STATICS + POST, NODES.replace("-200e3", "200e3"), ELEMENTS).close()  # in tension
    page = workshop.report().page
    assert "gamma_M1: empty, no element that has a strength for it is in compression" in page
    assert "Empty: no element that has a strength for it is in compression." in page


@pytest.mark.parametrize("more, is_above, ranks", [("", False, 1), ("buckling_length = 8.0\n", True, 2)])
def test_a_bar_above_its_euler_load_is_a_warning(workshop, more, is_above, ranks):
    """200 kN on a post of 648 kN, or of 162 kN: the run and its file contain the warning."""
    job = workshop.job(STATICS + POST + more, NODES, ELEMENTS)
    output = workshop.printed(job, ranks=ranks)
    assert ("warning: statics: element 7: compression above the Euler load" in output) == is_above, output
    with workshop.open() as f:
        assert ("beyond_euler" in f["statics"].attrs) == is_above


@pytest.mark.parametrize("length, is_above", [(4.0, False), (6.0, True)])
def test_a_bar_above_its_euler_load_in_motion_is_a_warning(workshop, length, is_above):
    """200 kN applied at once press with up to 400 kN, on a post of 648 kN or of 288 kN."""
    text = STEEL.replace("100e3", "0.0") + POST + f"buckling_length = {length}\n[dynamics]\nduration = 0.02\n"
    job = workshop.job(text, NODES, ELEMENTS)
    for each in (workshop.printed(job), workshop.info()):
        assert ("warning: dynamics: element 7: compression above the Euler load" in each) == is_above, each


def test_parts_of_a_bar_buckle_as_one_and_a_given_length_counts(workshop):
    """A post in parts has its whole length; 8 m give a quarter of its load. Curves have names."""
    whole = rows_of(workshop, parts=2)
    assert float(whole[7]["euler_load"]) == pytest.approx(np.pi**2 * 2.1e11 * 5e-6 / 16.0, rel=1e-10)
    long = rows_of(workshop, 'buckling_length = 8.0\nbuckling_curve = "a0"\n')
    assert float(long[7]["euler_load"]) == pytest.approx(np.pi**2 * 2.1e11 * 5e-6 / 64.0, rel=1e-10)
    slender = np.sqrt(3e-3 * 355e6 / float(long[7]["euler_load"]))
    assert float(long[7]["chi"]) == pytest.approx(buckling_reduction(slender, IMPERFECTION["a0"]), rel=1e-9)


def test_without_a_second_moment_compression_is_not_checked(workshop):
    """The report warns."""
    with workshop.solve(STATICS + POST.replace("second_moment = 5e-6\n", ""), NODES, ELEMENTS) as f:
        assert "second_moment" not in f["net"]
    page = workshop.report().page
    assert "en1993_buckling" not in page and "200 kN in element 7 (statics" in page


STRENGTHS = "yield_stress = 355e6\n", "section_modulus = 1e-4\ndesign_strength = 355e6\n"


@pytest.mark.parametrize("more, warns", [("", True), *((more, False) for more in STRENGTHS)])
def test_a_check_against_the_euler_load_alone_is_a_warning(workshop, more, warns):
    """200 kN of 648 kN are 0.31. chi N_y of curve c is 423 kN, with or without a section modulus."""
    post = POST.replace("yield_stress = 355e6\n", "") + more
    workshop.solve(STATICS + post, NODES, ELEMENTS).close()
    line = "warning: checks: element 7: compressed bars without yield_stress"
    assert (line in workshop.report().page) == warns


def test_compressed_bars_without_a_check_are_a_warning(workshop):
    """A second post carries 90 kN. The warning counts bars and names the largest force."""
    nodes = NODES + "4,9,0,0,1,1,1,0\n5,9,0,4,1,1,0,-90e3\n"
    groups = (POST + POST.replace("post", "prop")).replace("second_moment = 5e-6\n", "")
    workshop.solve(STATICS + groups, nodes, ELEMENTS + "9,4,5,prop\n").close()
    warnings: list[str] = []
    page = workshop.report(say=warnings.append).page
    warning = "checks: 2 elements (7, 9): compressed bars with unchecked buckling, up to 200 kN in element 7 "
    assert [warning + "(statics" in text for text in (page, "".join(warnings))] == [True, True]


def test_a_check_is_either_of_tension_or_of_compression(tmp_path):
    """A file of checks that mixes them is refused."""
    (tmp_path / "own.toml").write_text(
        '[[check]]\nname = "mine"\ntitle = "by hand"\n[[check.resistance]]\nof = "breaking_load"\n'
        '[[check.resistance]]\nof = "buckling"\n'
    )
    with pytest.raises(InputError, match="of = 'breaking_load' and 'buckling'"):
        read_codes(tmp_path / "own.toml")


EA, EULER, M = 3e-3 * 2.1e11, np.pi**2 * 2.1e11 * 5e-6 / 16.0, 5e4  # N, N, kg
STIFF, LOAD = EA / 4.0, 0.75 * EULER  # N/m, N
FREE = NODES.replace("load_z", "mass,load_z").replace("1,0\n", "1,0,0\n").partition("2,0,0,4")[0]
DROP = STEEL.replace("100e3", "0.0") + "[dynamics]\nduration = 0.2\nmass_damping = 0.0\nsafety = 0.1\n"
DROP += "[output]\nframes = 2\nhistory_interval = 0.0005\ncheckpoint_interval = 0.02\n"
BUCKLES = POST.replace("yield_stress = 355e6\n", "buckling = true\n")
DROP += BUCKLES


def dropped(workshop, more="", parts=1, **how):
    """Return the result of a mass that acts suddenly on the post."""
    nodes = FREE + f"2,0,0,4,1,1,0,{M},{-LOAD}\n"
    job = workshop.job(f"subdivide = {parts}\n{DROP}{more}", nodes, "id,start,end,group\n7,1,2,post\n")
    return job, workshop.run(job, **how)


@pytest.mark.parametrize("more", ["", f"breaking_load = {1.5 * EULER}\n"])
def test_a_buckled_post_carries_its_euler_load(both_ways, more):
    """The force is then constant: P x = N_E x - N_E^2 / 2 k where the mass stops. It never breaks."""
    _, f = dropped(both_ways, more)
    assert f["envelope/tension_min"][0] == pytest.approx(-EULER, rel=1e-12)
    deep = EULER**2 / (2 * STIFF * (EULER - LOAD))
    assert f["envelope/displacement_max"][1] == pytest.approx(deep, rel=1e-4)
    assert (audits(f) < (1e-10, 1e-3)).all()
    assert not len(f["events/time"]) and not f["history/plastic_dissipation"][-1]
    assert "warning: dynamics: element 7: buckled, at the Euler load" in both_ways.info()


def test_a_cable_carries_the_load_above_the_euler_load(both_ways):
    """P = 1.5 N_E on a post below a cable of 6 m: the cable has P - N_E and lengthens accordingly."""
    nodes = FREE + f"2,0,0,4,1,1,0,0,{-1.5 * EULER}\n"
    hung = nodes + "3,0,0,10,1,1,1,0,0\n", "id,start,end,group\n7,1,2,post\n8,2,3,\n"
    f = both_ways.solve(STATICS + BUCKLES, *hung)
    assert f["net/buckling"][:].tolist() == [1, 0]
    assert f["statics/tension"][-1] == pytest.approx([-EULER, 0.5 * EULER], rel=1e-6)
    sunk = 0.5 * EULER * 6.0 / (1.95e11 * 683.08e-6)
    assert f["statics/displacement"][-1][1] == pytest.approx([0.0, 0.0, -sunk], rel=1e-6)


@pytest.mark.parametrize("load, stiffness", [(500.0, 5e6 + 1e5), (20e3, 1e5)])
def test_a_buckled_bar_has_no_stiffness_in_modes(workshop, load, stiffness):
    """A mass on a post of EA / L = 5e6 N/m, N_E = 1 kN, and a spring of 1e5 N/m: straight, and buckled."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z,mass,load_z\n1,0,0,0,1,1,1,0,0,0\n"
    nodes += f"2,0,0,4,1,1,0,1e5,2000,{-load}\n"
    post = '[cable]\nkind = "bar"\nmodulus = 2e11\narea = 1e-4\ndensity = 1e-3\nsecond_moment = 8.1e-9\n'
    text = post + "buckling = true\n[load]\nself_weight = false\n"
    text += "steps = 1\n[dynamics]\nduration = 1e-3\n[modes]\ncount = 1\n"
    with workshop.solve(text, nodes, "start,end\n1,2\n") as f:
        period = f["modes/period"][0]
    assert period == pytest.approx(2.0 * np.pi * np.sqrt(2000.0 / stiffness), rel=1e-6)


def test_elements_that_buckle_and_yield_in_statics_are_named(both_ways):
    """1.5 N_E on a post below a cable that yields: both are named, the Euler check fails; none at half."""
    nodes = FREE + f"2,0,0,4,1,1,0,0,{-1.5 * EULER}\n3,0,0,10,1,1,1,0,0\n4,0,0,12,1,1,1,0,0\n"
    soft = f"[group.soft]\nyield_stress = {0.2 * EULER / 683.08e-6}\n"
    hung = nodes, "id,start,end,group\n7,1,2,post\n8,2,3,\n9,2,4,soft\n"
    job = both_ways.job(STATICS.replace("[load]", f"{BUCKLES}{soft}[load]"), *hung)
    with both_ways.run(job) as f:
        assert f["statics/tension"][-1] == pytest.approx([-EULER, 0.3 * EULER, 0.2 * EULER], rel=1e-6)
        named = {name: f["statics"].attrs[name].tolist() for name in ("buckled", "yielding")}
        assert named == {"buckled": [7], "yielding": [9]} and "over_strength" not in f["statics"].attrs
    texts = [both_ways.printed(job, output="again.vtkhdf")]
    report = both_ways.report("again.vtkhdf")
    texts += [both_ways.info("again.vtkhdf"), report.page]
    at_euler = [row for row in report.rows("checks") if (row["check"], row["group"]) == ("euler", "post")]
    assert [row["result"] for row in at_euler] == ["FAILS"]  # used by 1.000
    for text in texts:
        assert "arning: statics: element 7: buckled, at the Euler load. A bar that is not quite" in text
        assert "arning: statics: element 9: at the yield force" in text
    (both_ways.folder / "nodes.csv").write_text(nodes.replace(f"{-1.5 * EULER}", f"{-0.5 * EULER}"))
    with both_ways.run(job, "--set", "load.steps=2", "--set", "group.soft.yield_stress=1e12") as f:
        assert not {"buckled", "yielding"} & set(f["statics"].attrs)


NAMELESS = (STATICS + POST).replace("modulus = 1.95e11\narea = 683.08e-6\ndensity = 7850.0\n", "")
NAMELESS = NAMELESS.replace(
    "modulus = 2.1e11\narea = 3e-3\n", "axial_stiffness = 6e8\nmass_per_length = 20\n"
)
NAMELESS = NAMELESS.replace("[cable]\n", "[cable]\naxial_stiffness = 1e8\nmass_per_length = 5.0\n")


@pytest.mark.parametrize(
    "text, words",
    [
        (STATICS + POST.replace('kind = "bar"\n', ""), "[group.post] second_moment = 5e-06: only for bars"),
        (NAMELESS, "element 7: second_moment = 5e-06: needs the modulus"),
        (STATICS + BUCKLES.replace("= 0.0", f"= {-1.01 * EULER}"), "beyond the Euler load 647.7 kN"),
        (DROP + "bending = true\n", "exclude each other"),
        (DROP.replace("second_moment = 5e-6\n", ""), "needs second_moment"),
    ],
    ids=["cable", "modulus not known", "beyond Euler's load", "bends too", "no second moment"],
)
def test_contradictory_keys_are_refused(workshop, text, words):
    """The error has the group or element, the key and the value; exit code 2."""
    assert words in workshop.solve(text, NODES, ELEMENTS, code=2).stderr


def falls(limit, strain):
    """Return the time [s] at which a post has a strain: elastic to `limit` [N], then constant force."""
    w, first, x = np.sqrt(STIFF / (M + 47.1)), limit / STIFF, 4.0 * strain
    sunk = LOAD / STIFF
    if x <= first:
        return np.arccos(1.0 - x / sunk) / w
    turned = np.arccos(1.0 - first / sunk)
    v, a = sunk * w * np.sin(turned), (LOAD - limit) / (M + 47.1)
    return turned / w + (-v + np.sqrt(v * v + 2.0 * a * (x - first))) / a


@pytest.mark.parametrize(
    "keys, limit, strain, heat",
    [
        ("fracture_strain = 1.5e-3\n", EULER, 1.5e-3, 0.0),
        ("fracture_strain = 5e-3\nyield_stress = 150e6\n", 450e3, 5e-3, 450e3 * (0.02 - 450e3 / STIFF)),
        ("breaking_load = 400e3\nyield_stress = 355e6\n", EULER, 400e3 / EA, 0.0),
    ],
)
def test_a_post_breaks_in_compression(workshop, keys, limit, strain, heat):
    """Breaks at a strain after buckling or yielding, or at a force, have the right time and plastic work."""
    _, f = dropped(workshop, keys)
    assert f["events/time"][0] == pytest.approx(falls(limit, strain), rel=2e-3)
    assert f["events/strain"][0] == pytest.approx(-strain, rel=5e-3)
    until = f["history/time"][:] < f["events/time"][0]
    assert f["history/plastic_dissipation"][until][-1] == pytest.approx(heat, rel=3e-2)
    assert abs(f["history/work_identity_error"][:]).max() < 1e-10


def used_by(job):
    """Return the utilisation of a job in a study."""
    return run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache(1))["utilisation_before_break"]


def test_a_study_names_elements_that_break_in_compression(workshop):
    """Above its strength if the post broke; otherwise the Euler load in motion and its static force."""
    nodes, post = FREE + f"2,0,0,4,1,1,0,{M},{-LOAD}\n", "id,start,end,group\n7,1,2,post\n"
    drop = DROP.replace("checkpoint_interval = 0.02\n", "")
    used = lambda strain: used_by(workshop.job(f"{drop}fracture_strain = {strain}\n", nodes, post))
    assert used(1.5e-3) == pytest.approx(1.0, abs=5e-3) and used(1.5e-3) > 1.0
    assert EULER / EA / 0.1 * (1 - 1e-9) < used(0.1) < 1.0
    case = '[[case]]\nname = "all"\nset = {"load.temperature" = 0.0}\n'
    text = STATICS + case + POST + "fracture_strain = 1e-3\nbuckling = true\n"
    job = workshop.job(text, NODES, ELEMENTS)
    assert used_by(job) == pytest.approx(200e3 / (2.1e11 * 3e-3 * 1e-3), rel=1e-6)


def test_bits_of_a_post_that_buckles_and_breaks(workshop):
    """In four parts, on three ranks and from a checkpoint."""
    job, one = dropped(workshop, "fracture_strain = 1.5e-3\n", 4, output="one.vtkhdf")
    assert len(one["events/time"])
    assert_same_bits_on(3, job, one, workshop, "one")
