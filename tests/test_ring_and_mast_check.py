"""Rings and masts: axial force with bending, moments by plane, concrete; compared with statics by hand."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import assert_same_results, run_on_standing_ranks
from results import rows_of

K, R, P = 24, 20.0, 50e3  # nodes of the ring; m; N
TUBE = 'kind = "bar"\nmodulus = 2.1e11\narea = 6570e-6\nsecond_moment = 36.0e-6\nbending = true\n'
CABLES = "[cable]\nmodulus = 1e11\narea = 1e-3\ndensity = 1000.0\n"
STIFF = 'kind = "bar"\nmodulus = {}\narea = 0.6\nsecond_moment = 0.05\nbending = true\ndensity = {}\n'
LOAD = "[load]\nself_weight = false\ntolerance = 1e-10\n"
# in plan at three nodes of the ring, without effect on radial motions; vertically at all
FREE = f'[[stage]]\nname = "free"\nrelease = ["ring"]\nhold = {{ring = "z", 1 = "y", {K // 4 + 1} = "x", '
FREE += f'{K // 2 + 1} = "y"}}\n'


def ring(loads, backwards=()) -> tuple[str, str]:
    """Return tables of a held ring. loads : (K,) inward at its nodes [N]; backwards : reversed bars"""
    nodes, elements = "id,x,y,z,fixed,load_x,load_y\n", "id,start,end,group\n"
    for k, (a, q) in enumerate(zip(2.0 * np.pi * np.arange(K) / K, map(float, loads)), 1):
        c, s = float(np.cos(a)), float(np.sin(a))
        nodes += f"{k},{R * c!r},{R * s!r},5,1,{-q * c!r},{-q * s!r}\n"
        ends = (k, k % K + 1)[:: -1 if k in backwards else 1]
        elements += f"{k},{ends[0]},{ends[1]},ring\n"
    return nodes, elements


def two_loads() -> np.ndarray:
    """Return P inwards at nodes 1 and K / 2 + 1."""
    return np.where(np.arange(K) % (K // 2) == 0, P, 0.0)


def moments_of(report, case: str) -> dict[tuple[int, int], dict[str, float]]:
    """Return rows of moments.csv in a state, by element and node, as numbers."""
    names = "N", "moment", "moment_vertical", "moment_plan"
    rows = [row for row in report.rows("moments") if row["case"] == case]
    return {
        (int(row["element"]), int(row["node"])): {name: float(row[name]) for name in names} for row in rows
    }


@pytest.mark.parametrize("material", [(2.1e11, 7850.0), (40e9, 2100.0)])  # steel, glass fibres
def test_a_ring_released_under_even_loads_has_thrust_and_no_moment(workshop, material):
    """N = F / (2 sin(pi / K)), q R of the polygon, in each bar. Moments are rounding errors."""
    text = CABLES + "[group.ring]\n" + STIFF.format(*material) + "section_modulus = 0.1\n"
    text += "design_strength = 470e6\nyield_stress = 235e6\n" + LOAD + FREE
    workshop.solve(text, *ring(np.full(K, P))).close()
    report, N = workshop.report(), P / (2.0 * np.sin(np.pi / K))
    for row in moments_of(report, "stage free").values():
        assert row["N"] == pytest.approx(-N, rel=1e-6) and row["moment"] < 1e-6 * N * R
    (check,) = [row for row in report.rows("checks") if row["check"] == "en1993_section"]
    assert float(check["utilisation"]) == pytest.approx(N / (0.6 * 235e6), rel=1e-5)
    assert (check["group"], check["alike"], check["result"]) == ("ring", str(K), "passes")
    assert "en1993_member" not in {row["check"] for row in report.rows("checks")}  # no buckling_length
    assert {row["group"] for row in report.rows("shop_list")} == {"ring"}
    assert "Reinforced concrete" not in report.page
    assert ("If it is, remove section_modulus" in report.page) == (material[0] < 60e9)


def test_moments_of_a_ring_have_the_sign_of_the_side_that_is_pulled(workshop):
    """Two loads: P R / pi inside under each, P R (1/2 - 1/pi) outside between (Roark); the polygon to 1e-3.

    Its joints give way alike, so their moments add up to zero: (P R / 2) (1 - mean |sin|) between the loads.
    Bars in either direction have the same signs. Without a section_modulus nothing passes.
    """
    text = CABLES + "[group.ring]\n" + STIFF.format(2.1e11, 7850.0) + "yield_stress = 235e6\n"
    text += "buckling_length = 30.0\n" + LOAD + FREE
    f = workshop.solve(text, *ring(two_loads(), backwards=(1, 4, 9, K)))
    size = f["stages/free/bending_moment"][:]
    done = run_on_standing_ranks(
        "report", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "report"
    )
    report = workshop.report()
    rows = moments_of(report, "stage free")
    mean = np.abs(np.sin(2.0 * np.pi * np.arange(K) / K)).mean()
    under, between = -0.5 * P * R * mean, 0.5 * P * R * (1.0 - mean)
    assert [under, between] == pytest.approx([-P * R / np.pi, P * R * (0.5 - 1.0 / np.pi)], rel=0.011)
    for node, M in ((1, under), (K // 4 + 1, between), (K // 2 + 1, under), (3 * K // 4 + 1, between)):
        for element in (node, (node - 2) % K + 1):
            row = rows[element, node]
            assert row["moment_plan"] == pytest.approx(M, rel=1e-3)
            assert row["moment_vertical"] == 0.0  # rounding governs nothing
    assert rows[K // 4 + 1, K // 4 + 1]["N"] == pytest.approx(-0.5 * P * np.cos(np.pi / K), rel=2e-3)
    shown = np.sort([row["moment"] for row in rows.values()])
    assert shown == pytest.approx(np.sort(size.ravel()), rel=1e-9)
    results = {row["check"]: row["result"] for row in report.rows("checks") if row["group"] == "ring"}
    assert results["en1993_buckling"] == "not checked for bending" and "passes" not in results.values()
    assert "[group.ring]: 24 elements (1, 2, 3, 4, 5, ...) with bending moments up to 316" in done.stdout
    assert "largest M in plan" in report.page and "M vertical," not in report.page.split("governs |")[1]
    assert "W843; netfall" in done.stdout and "W843; netfall" in report.page


def test_concrete_has_a_table_and_no_check(workshop):
    """The ring of two loads in concrete without a section_modulus has extremes of N and M."""
    text = CABLES + "[group.ring]\n" + STIFF.format(33e9, 2500.0) + "yield_stress = 30e6\n" + LOAD + FREE
    workshop.solve(text, *ring(two_loads())).close()
    report = workshop.report()
    part = report.page.split("## Reinforced concrete")[1].split("\n## ")[0]
    least = next(line for line in part.splitlines() if "least M in plan" in line).split(" | ")
    largest = next(line for line in part.splitlines() if "largest M in plan" in line).split(" | ")
    assert (least[3], least[4]) in (("1", "stage free"), (str(K // 2 + 1), "stage free"))
    assert float(least[7].split()[0]) == pytest.approx(-316.5, abs=2.0) and least[7].split()[1] == "kN"
    assert float(largest[7].split()[0]) == pytest.approx(183.5, abs=2.0)
    assert not any(row["check"].startswith("en1993_s") and row["result"] for row in report.rows("checks"))
    assert "W843" not in report.page and {row["group"] for row in report.rows("moments")} == {"ring"}


def test_signs_of_crossing_beams_and_of_a_mast(workshop):
    """P L / 4 at the middle, positive below, on the side of y, and of x and y for a mast."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_x,load_y,load_z\n"
    rows = [(x, 0, 0) for x in (-4, -2, 0, 2, 4)] + [(0, y, 0) for y in (-4, -2, 2, 4)]
    rows += [(20, 9, z) for z in (0, 2, 4, 6, 8)] + [(x, 30, 0) for x in (0, 2, 4, 6, 8)]
    held = {1: "0,1,1", 5: "0,1,1", 6: "1,0,1", 9: "1,0,1", 3: "1,1,0", 10: "1,1,1", 14: "1,1,0"}
    held |= {15: "1,1,1", 19: "0,1,1"}
    loads = {3: "0,0,-2000", 12: "600,-300,0", 17: "0,-1000,0"}
    for k, (x, y, z) in enumerate(rows, 1):
        free = "0,0,1" if k > 15 else "0,0,0"
        nodes += f"{k},{x},{y},{z},{held.get(k, free)},{loads.get(k, '0,0,0')}\n"
    chains = {
        "along": (1, 2, 3, 4, 5),
        "across": (6, 7, 3, 8, 9),
        "mast": range(10, 15),
        "rail": range(15, 20),
    }
    elements, number = "id,start,end,group,cable\n", 0
    for name, chain in chains.items():
        for a, b in pairwise(chain):
            number += 1
            group = "beam" if name in ("along", "across") else name
            elements += f"{number},{a if number % 2 else b},{b if number % 2 else a},{group},{name}\n"
    f = workshop.solve("[cable]\ndensity = 7850.0\n" + TUBE + LOAD + "steps = 1\n", nodes, elements)
    size = f["statics/bending_moment"][-1]
    at = moments_of(workshop.report(), "statics, load factor 1")
    assert np.sort([row["moment"] for row in at.values()]) == pytest.approx(np.sort(size.ravel()), rel=1e-9)
    expected = {
        (2, 3): (2000.0, 0.0),
        (7, 3): (2000.0, 0.0),
        (10, 12): (1200.0, -600.0),
        (14, 17): (0.0, -2000.0),
    }
    for place, values in expected.items():
        shown = at[place]["moment_vertical"], at[place]["moment_plan"]
        assert shown == pytest.approx(values, rel=2e-3, abs=1e-3)


# Tube 219.1 x 10, W = I / 109.55 mm, under P and H across at the middle: length, P, H, and by hand
# N_cr = pi2 E I / L2 [kN], lambda = sqrt(A f / N_cr), chi of curve a, tan(u) / u with u = pi/2 sqrt(P / N_cr)
MASTS = {
    "short": (3.0, 600e3, 40e3, 8290.5, 0.5304, 0.9146, 1.0641),
    "medium": (8.0, 400e3, 5e3, 1165.8, 1.4144, 0.4109, 1.4276),
    "long": (14.0, 150e3, 1.5e3, 380.68, 2.4752, 0.1495, 1.5319),
}
PARTS = 16


def masts() -> tuple[str, str, str]:
    """Return groups and tables of the masts, hinged at both ends."""
    text, nodes, elements = "", "id,x,y,z,fixed_x,fixed_y,fixed_z,load_y,load_z\n", "id,start,end,group\n"
    for k, (name, (L, N, H, *_)) in enumerate(MASTS.items()):
        text += f'[group.{name}]\n{TUBE}buckling_length = {L}\nbuckling_curve = "a"\n'
        text += "section_modulus = 328.6e-6\ndesign_strength = 355e6\n"
        for p in range(PARTS + 1):
            held = "1,1,1" if p == 0 else "1,1,0" if p == PARTS else "0,0,0"
            loads = f"{H if 2 * p == PARTS else 0.0},{-N if p == PARTS else 0.0}"
            nodes += f"{100 * k + p},{5 * k},0,{L * p / PARTS!r},{held},{loads}\n"
            elements += f"{100 * k + p},{100 * k + p - 1},{100 * k + p},{name}\n" if p else ""
    return text, nodes, elements


def test_checks_of_masts_agree_with_hand_calculations(both_ways):
    """N / (A f) + M / (W f) and N / (chi A f) + M / (W f), M = H L / 4 tan(u) / u: 16 bars, to 1 part in 200.

    Moments are of second order already, so that tan(u) / u stands once. Results have the same bits without
    the keys of the check, and on two ranks.
    """
    text, nodes, elements = masts()
    text = CABLES + text + LOAD + "steps = 1\n"
    f = both_ways.solve(text, nodes, elements)
    rows = {(row["check"], row["group"]): row for row in both_ways.report().rows("checks")}
    for name, (L, N, H, N_cr, slender, chi, amplified) in MASTS.items():
        M = H * L / 4.0 * amplified
        section, member = rows["en1993_section", name], rows["en1993_member", name]
        by_hand = N / 2332.35e3 + M / 116.653e3
        assert float(section["utilisation"]) == pytest.approx(by_hand, rel=5e-3)
        by_hand += N / 2332.35e3 * (1.0 / chi - 1.0)
        assert float(member["utilisation"]) == pytest.approx(by_hand, rel=5e-3)
        assert member["result"] == ("FAILS" if by_hand > 1.0 else "passes")
        assert float(member["N_Ed"]) == pytest.approx(N, rel=1e-3)
        assert float(member["M_Ed"]) == pytest.approx(M, rel=5e-3)
        assert (float(member["N_Rd"]), float(member["M_Rd"])) == pytest.approx(
            (chi * 2332.35e3, 116.653e3), rel=1e-3
        )
        assert slender == pytest.approx(np.sqrt(2332.35 / N_cr), rel=1e-3)
    factored = text.replace("design_strength = 355e6", "yield_stress = 355e6\ndesign_strength = 322.7e6")
    both_ways.solve(factored, nodes, elements, output="factored.vtkhdf", ranks=1).close()
    report = both_ways.report("factored.vtkhdf")
    for row in (row for row in report.rows("checks") if row["check"] == "en1993_member"):
        chi_N_y = MASTS[row["group"]][5] * 322.7 / 355.0 * 2332.35e3  # chi of the yield stress
        assert float(row["N_Rd"]) == pytest.approx(chi_N_y, rel=1e-3)
    bare = text.replace("section_modulus = 328.6e-6\ndesign_strength = 355e6\n", "")
    with both_ways.solve(bare, nodes, elements, output="bare.vtkhdf", ranks=1) as other:
        assert assert_same_results(f, other) > 20


def test_a_bar_has_no_tension_check_in_states_that_only_compress_it(workshop):
    """The tension on top of a post under its weight is rounding; 60 kN upwards act in service alone."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z\n1,0,0,0,1,1,1\n2,0,0,7.7,1,1,0\n"
    text = CABLES + '[group.post]\nkind = "bar"\narea = 1e-3\nbreaking_load = 9e5\nsecond_moment = 1e-6\n'
    text += "density = 7850.0\nyield_stress = 9e8\n[combinations]\n"
    text += "a = {down = 1.0}\nb = {kind = 'SLS', up = 1.0}\n"
    for name, load in (("down", -1e3), ("up", 6e4)):
        (workshop.folder / f"{name}.csv").write_text(f"node,load_z\n2,{load}\n")
        text += f'[[case]]\nname = "{name}"\nload_table = "{name}.csv"\n'
    workshop.solve(text, nodes, "id,start,end,group\n1,1,2,post\n").close()
    rows = {row["check"]: row for row in workshop.report().rows("checks")}
    assert (rows["en1993"]["utilisation"], rows["en1993"]["result"]) == ("", "")
    assert float(rows["en1993_service"]["utilisation"]) == pytest.approx(6e4 / (0.45 * 9e5), rel=1e-6)


def test_a_single_bar_of_a_group_that_bends_is_checked_for_buckling(workshop):
    """Bar 3 of 8 m carries 1.2 N_cr; the chain of bars 1 and 2, of the same group, 0.1 N_cr."""
    N_cr = np.pi**2 * 2.1e11 * 36.0e-6 / 64.0
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,0,0,4,0,0,0,0\n"
    nodes += f"3,0,0,8,1,1,0,{-0.1 * N_cr!r}\n4,5,0,0,1,1,1,0\n5,5,0,8,1,1,0,{-1.2 * N_cr!r}\n"
    text = CABLES + f"[group.post]\n{TUBE}yield_stress = 355e6\n" + LOAD + "steps = 1\n"
    workshop.solve(text, nodes, "id,start,end,group\n1,1,2,post\n2,2,3,post\n3,4,5,post\n").close()
    report = workshop.report()
    (row,) = [row for row in report.rows("checks") if row["check"] == "euler"]
    assert (row["element"], row["alike"], row["result"]) == ("3", "1", "FAILS")
    assert float(row["utilisation"]) == pytest.approx(1.2, rel=1e-6)
    assert "element 3: compression above the Euler load" in report.page


@pytest.mark.parametrize("parts", [1, 4])
def test_a_report_names_moments_between_nodes_that_are_missing(workshop, parts):
    """A beam of two parts of l = 4 m under its weight q lacks q l^2 / 8 = 1.01 kN m, one of eight little."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z\n1,0,0,0,1,1,1\n2,4,0,0,0,1,0\n3,8,0,0,0,1,1\n"
    text = f"subdivide = {parts}\n[cable]\ndensity = 7850.0\n{TUBE}section_modulus = 328.6e-6\n"
    text += "design_strength = 35.5e6\n[load]\nsteps = 1\n"
    workshop.solve(text, nodes, "start,end,group\n1,2,beam\n2,3,beam\n").close()
    page = workshop.report().page
    assert ("element 0 of 4 m may carry 0.506 kN/m" in page) == ("W848" in page) == (parts == 1)
    assert ("up to 1.01 kN m (9% of the resistance)" in page) == (parts == 1)


@pytest.mark.parametrize(
    "change, message",
    [
        (
            ("design_strength = 355e6\n", ""),
            "section_modulus = 0.0003286: needs design_strength or yield_stress",
        ),
        (
            ("= 328.6e-6", "= 328.6"),
            "section_modulus = 328.6 m3; expected at most sqrt(second_moment area) = 0.0004863",
        ),
        (("second_moment = 36.0e-6\nbending = true\n", ""), "section_modulus: needs second_moment"),
        (('kind = "bar"\n', ""), "section_modulus = 0.0003286: only for bars"),
    ],
)
def test_wrong_keys_of_the_check_are_refused(workshop, change, message):
    text, nodes, elements = masts()
    text = (CABLES + text + LOAD).replace(*change)
    assert message in run_on_standing_ranks("check", workshop.job(text, nodes, elements), code=2).stderr


def test_a_design_strength_without_section_modulus_is_named(workshop):
    text, nodes, elements = masts()
    job = workshop.job((CABLES + text + LOAD).replace("section_modulus = 328.6e-6\n", ""), nodes, elements)
    assert "[group.short] design_strength: no effect" in run_on_standing_ranks("check", job).stdout


def test_moments_after_a_member_removal_count(workshop):
    """The hanger of a beam of 8 m is removed under 1 kN: PL/4 = 2 kN m, twice which is W f."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z,mass\n1,0,0,0,1,1,1,0,0\n2,4,0,0,0,1,0,-1e3,100\n"
    nodes += "3,8,0,0,0,1,1,0,0\n4,4,0,4,1,1,1,0,0\n"
    elements = "id,start,end,group\n0,1,2,beam\n1,2,3,beam\n2,2,4,hanger\n"
    text = "[cable]\nmodulus = 2e11\narea = 1e-3\ndensity = 100.0\n[load]\nself_weight = false\n"
    text += '[group.beam]\nkind = "bar"\nbending = true\nsecond_moment = 1e-4\nsection_modulus = 1e-5\n'
    text += "design_strength = 1e8\n[dynamics]\nduration = 2e-4\n[[remove]]\nelements = [2]\ntime = 1e-4\n"
    with workshop.solve(text, nodes, elements) as f:
        moment = f["removal/bending_moment_after"][0]
    assert moment[:2] == pytest.approx(2e3, rel=1e-3) and np.isnan(moment[2])
    rows = rows_of(workshop.report().folder / "checks.csv")
    (row,) = (row for row in rows if row["check"] == "en1993_section" and row["group"] == "beam")
    assert (row["case"], row["result"]) == ("equilibrium after removal 1", "FAILS")
    assert float(row["utilisation"]) == pytest.approx(2.0, rel=1e-2)
