"""Compressed bars: Euler's load and the check of EN 1993-1-1, 6.3.1, in the report."""

import csv

import numpy as np
import pytest
from conftest import STEEL

from netfall.checks.buckling import IMPERFECTION, reduction, slenderness
from netfall.checks.codes import read_codes
from netfall.ground.errors import InputError
from netfall.report.report import Inputs, write_report

# A post of 4 m, its head held sideways, below 200 kN; a level cable at it.
NODES = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,0,0,4,1,1,0,-200e3\n3,5,0,4,1,1,1,0\n"
ELEMENTS = "id,start,end,group\n7,1,2,post\n8,2,3,\n"
POST = (
    '[cable.post]\nkind = "bar"\nmodulus = 2.1e11\narea = 3e-3\nprestress = 0.0\nyield_stress = 355e6\n'
    "second_moment = 5e-6\n"
)
STATICS = STEEL.replace("100e3", "0.0") + "[load]\nsteps = 1\n"
BY_CURVE = {  # chi of the curves a0 to d by hand; EN 1993-1-1, figure 6.4
    0.2: (1.0, 1.0, 1.0, 1.0, 1.0),
    0.5: (0.9513, 0.9243, 0.8842, 0.8430, 0.7793),
    1.0: (0.7253, 0.6656, 0.5970, 0.5399, 0.4671),
    1.5: (0.3953, 0.3724, 0.3422, 0.3145, 0.2766),
    2.5: (0.1515, 0.1467, 0.1397, 0.1325, 0.1214),
}


@pytest.mark.parametrize("slender", BY_CURVE)
def test_reduction_is_that_of_the_five_curves(slender):
    """At five slendernesses, to the four figures that tables have."""
    alpha = np.array(list(IMPERFECTION.values()))
    assert np.round(reduction(np.full(5, slender), alpha), 4).tolist() == list(BY_CURVE[slender])
    assert slenderness(np.array([slender**2 * 3e5]), np.array([3e5])) == pytest.approx(slender, rel=1e-12)


def rows_of(workshop, more="", parts=1):
    """Rows of the table of elements in the report on the post, by the element."""
    job = workshop.job(STATICS + POST + more, NODES, ELEMENTS)
    workshop.run(job, "--set", f"net.subdivide={parts}").close()
    write_report(workshop.folder / "result.vtkhdf", workshop.folder / "report", Inputs())
    with open(workshop.folder / "report" / "elements.csv", newline="") as file:
        return {int(row["element"]): row for row in csv.DictReader(file)}


def test_a_post_is_checked_as_by_hand(workshop):
    """N_cr = pi^2 E I / L^2 over all parts of it, lambda, chi of curve c, utilisation; of cables nothing."""
    rows = rows_of(workshop)
    N_cr, N_y = np.pi**2 * 2.1e11 * 5e-6 / 16.0, 3e-3 * 355e6
    slender = np.sqrt(N_y / N_cr)
    phi = 0.5 * (1 + 0.49 * (slender - 0.2) + slender**2)
    chi = 1 / (phi + np.sqrt(phi**2 - slender**2))
    post, of = rows[7], lambda name: float(rows[7][name])
    assert of("euler_load") == pytest.approx(N_cr, rel=1e-10)  # twelve digits stand in the table
    assert (of("slenderness"), of("chi")) == (pytest.approx(slender), pytest.approx(chi))
    assert of("compression_en1993_buckling") == pytest.approx(200e3, rel=1e-6)
    assert of("utilisation_en1993_buckling") == pytest.approx(200e3 / (chi * N_y), rel=1e-6)
    assert of("utilisation_euler") == pytest.approx(200e3 / N_cr, rel=1e-6)
    assert post["case_en1993_buckling"].startswith("statics")
    assert rows[8]["euler_load"] == rows[8]["utilisation_euler"] == ""
    page = (workshop.folder / "report" / "summary.md").read_text()
    assert "chi N_y / gamma_M1: largest" in page and "compression, not checked" not in page


def test_parts_of_a_bar_buckle_as_one_and_a_given_length_counts(workshop):
    """A post in parts has the length of all, 8 m a quarter of its load; curves by name."""
    whole = rows_of(workshop, parts=2)
    assert float(whole[7]["euler_load"]) == pytest.approx(np.pi**2 * 2.1e11 * 5e-6 / 16.0, rel=1e-10)
    long = rows_of(workshop, 'buckling_length = 8.0\nbuckling_curve = "a0"\n')
    assert float(long[7]["euler_load"]) == pytest.approx(np.pi**2 * 2.1e11 * 5e-6 / 64.0, rel=1e-10)
    slender = np.sqrt(3e-3 * 355e6 / float(long[7]["euler_load"]))
    assert float(long[7]["chi"]) == pytest.approx(reduction(slender, IMPERFECTION["a0"]), rel=1e-9)


def test_without_a_second_moment_the_report_is_as_before(workshop):
    """No check of compression, and the page says that it is not checked."""
    job = workshop.job(STATICS + POST.replace("second_moment = 5e-6\n", ""), NODES, ELEMENTS)
    with workshop.run(job) as f:
        assert "second_moment" not in f["net"]
    write_report(workshop.folder / "result.vtkhdf", workshop.folder / "report", Inputs())
    page = (workshop.folder / "report" / "summary.md").read_text()
    assert "en1993_buckling" not in page and "compression, not checked: largest 200 kN" in page


def test_keys_of_bars_for_cables_are_refused(workshop):
    """With the group, the key, the value and what to do; also a bar whose modulus is not known."""
    cable = POST.replace('kind = "bar"\n', "")
    error = workshop.run(workshop.job(STATICS + cable, NODES, ELEMENTS), code=2).stderr
    assert "[cable.post] second_moment = 5e-06: of bars alone" in error
    nameless = POST.replace(
        "modulus = 2.1e11\narea = 3e-3\n", "axial_stiffness = 6e8\nmass_per_length = 20.0\n"
    )
    nameless = STATICS.replace("modulus = 1.95e11\narea = 683.08e-6\ndensity = 7850.0\n", "") + nameless
    nameless = nameless.replace("[cable]\n", "[cable]\naxial_stiffness = 1e8\nmass_per_length = 5.0\n")
    error = workshop.run(workshop.job(nameless, NODES, ELEMENTS), code=2).stderr
    assert "element 7: second_moment = 5e-06: needs the modulus" in error


def test_a_check_is_of_tension_or_of_compression(tmp_path):
    """A file of checks that mixes them is refused."""
    (tmp_path / "own.toml").write_text(
        '[[check]]\nname = "mine"\ntitle = "by hand"\n[[check.resistance]]\nof = "breaking_load"\n'
        '[[check.resistance]]\nof = "buckling"\n'
    )
    with pytest.raises(InputError, match="of = 'buckling' beside 'breaking_load'"):
        read_codes(tmp_path / "own.toml")
