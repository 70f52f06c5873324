"""Wind and ice on elements with a diameter, by hand."""

import numpy as np
import pytest
from conftest import STEEL, run_on_standing_ranks
from scipy.optimize import brentq

from netfall.driver.check import check_values
from netfall.geometry.net import GRAVITY
from netfall.job.read import read_job

BARE = STEEL.replace("prestress = 100e3\n", "")
STIFF = BARE.replace("1.95e11", "1e14")
RHO, U = 1.25, 30.0  # kg/m3, m/s
HEAD = "id,x,y,z,fixed\n"
UNIFORM = '"wind.speed" = 30.0, "wind.profile_exponent" = 0.0'


def case(settings: str, name: str = "wind") -> str:
    return f'[[case]]\nname = "{name}"\nset = {{{settings}}}\n'


def stay(elevation: float) -> tuple[str, str, np.ndarray]:
    """Tables of a stay of 40 m in two elements that rises along x, and its axis; the middle is free."""
    axis = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    rows = "".join(
        f"{k},{r[0]!r},0,{r[2]!r},{int(k != 1)}\n" for k, r in enumerate(np.outer((0, 20, 40), axis))
    )
    return HEAD + rows.replace("np.float64(", "").replace(")", ""), "start,end,group\n0,1,g\n1,2,g\n", axis


@pytest.mark.parametrize("direction", [0.0, 180.0, 90.0, 30.0])
def test_wind_on_an_inclined_stay_acts_across_its_axis(workshop, direction):
    """F = q c_d d L sin^2 of the angle between wind and axis. Along the plane of the stay, rising at b, it is
    q c_d d L sin^2 b, sin b of it along the wind and cos b of it down or up.
    """
    b, d, c_d, L = np.radians(50.0), 0.1, 0.7, 40.0
    nodes, elements, axis = stay(b)
    text = BARE + f"[group.g]\nprestress = 2e4\ndiameter = {d}\ndrag_coefficient = {c_d}\n"
    text += case(f'{UNIFORM}, "wind.direction" = {direction}')
    f = workshop.run_here(workshop.job(text, nodes, elements))
    force = f["cases/wind/load"][:]
    full, a = 0.5 * RHO * U**2 * c_d * d * L, np.radians(direction)
    sin = np.sqrt(1.0 - (np.cos(a) * np.cos(b)) ** 2)
    total = force.sum(0)
    assert np.linalg.norm(total) == pytest.approx(full * sin**2, rel=1e-12)
    assert total @ axis == pytest.approx(0.0, abs=1e-12 * full)
    assert total @ [np.cos(a), np.sin(a), 0.0] == pytest.approx(
        full * sin**3, rel=1e-12
    )  # drags, never thrusts
    if direction in (0.0, 180.0):
        sign = np.cos(a)
        by_hand = [sign * np.sin(b) ** 3, 0.0, -sign * np.sin(b) ** 2 * np.cos(b)]
        assert total == pytest.approx(full * np.array(by_hand), rel=1e-12, abs=1e-12 * full)
    assert force == pytest.approx(np.outer((0.25, 0.5, 0.25), total), rel=1e-12, abs=1e-12 * full)


def test_a_horizontal_cable_deflects_across(workshop):
    """The node in the middle of 2 x 20 m takes half of the wind: 2 N w / l = F / 2, N = EA (l / L0 - 1)."""
    d, EA, l0 = 0.05, 1.95e11 * 683.08e-6, 20.0
    L0, F = l0 / (1.0 + 1e4 / EA), 0.5 * RHO * U**2 * 1.2 * d * 40.0
    pull = lambda w: 2.0 * EA * (np.hypot(l0, w) / L0 - 1.0) * w / np.hypot(l0, w) - F / 2.0
    text = BARE + f"prestress = 1e4\ndiameter = {d}\n" + case(f'{UNIFORM}, "wind.direction" = 90.0')
    nodes = HEAD + "0,0,0,10,1\n1,20,0,10,0\n2,40,0,10,1\n"
    f = workshop.run_here(workshop.job(text, nodes, "start,end\n0,1\n1,2\n"))
    moved = f["cases/wind/displacement"][1]
    assert moved == pytest.approx([0.0, brentq(pull, 0.0, 5.0, xtol=1e-12), 0.0], rel=1e-5, abs=1e-7)


MAST = HEAD + "0,0,0,0,1\n1,0,0,60,0\n2,-40,-30,0,1\n3,-40,30,0,1\n"
GUYS = "start,end,group\n0,1,mast\n2,1,guy\n3,1,guy\n"
SECTIONS = (
    STIFF
    + '[group.mast]\nkind = "bar"\ndiameter = 0.4\ndrag_coefficient = 1.0\n[group.guy]\ndiameter = 0.03\n'
)


def on_top_and_foot(ice: float, direction: float, exponent: float, base: float):
    """Wind [N] at 30 m/s on the four nodes of the guyed mast, by hand."""
    x = np.array([[0, 0, 0], [0, 0, 60], [-40, -30, 0], [-40, 30, 0]], float)
    u = np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction)), 0.0])
    force = np.zeros((4, 3))
    for a, b, c_d, d in ((0, 1, 1.0, 0.4), (2, 1, 1.2, 0.03), (3, 1, 1.2, 0.03)):
        L = np.linalg.norm(x[b] - x[a])
        across = np.cross((x[b] - x[a]) / L, np.cross(u, (x[b] - x[a]) / L))
        F = 0.5 * RHO * c_d * (d + 2.0 * ice) * L * np.linalg.norm(across) * across
        for node in (a, b):
            force[node] += 0.5 * F * (U * (max(x[node, 2] + base, 1.0) / 10.0) ** exponent) ** 2
    return x, force


@pytest.mark.parametrize("direction, ice", [(0.0, 0.0), (20.0, 0.02)])
def test_a_guyed_mast_by_statics(workshop, direction, ice):
    """A mast on a hinge and two guys to windward: three forces hold its top, foundations take all wind."""
    exponent, base = 0.16, 5.0
    settings = f'"wind.speed" = {U}, "wind.base_height" = {base}, "wind.direction" = {direction}'
    text = SECTIONS + "[load]\nself_weight = false\n" + case(settings + f', "load.ice" = {ice}' * (ice > 0.0))
    job = workshop.job(text, MAST, GUYS)
    f = workshop.run_here(job)
    x, force = on_top_and_foot(ice, direction, exponent, base)
    L = np.linalg.norm(x[1] - x[[0, 2, 3]], axis=1)
    if ice:
        weight = GRAVITY * 900.0 * np.pi * (np.array([0.4, 0.03, 0.03]) * ice + ice**2) * L
        force[[0, 2, 3], 2] -= 0.5 * weight
        force[1, 2] -= 0.5 * weight.sum()
    assert f["cases/wind/load"][:] == pytest.approx(force, rel=1e-9, abs=1e-9 * np.abs(force).max())
    axes = (x[[0, 2, 3]] - x[1]).T / L
    N = np.linalg.solve(axes, -force[1])
    assert f["cases/wind/tension"][:] == pytest.approx(N, rel=1e-4)
    assert N[0] < 0.0 < N[1:].min()
    f.close()
    run_on_standing_ranks("report", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "report")
    rows = np.genfromtxt(
        workshop.folder / "report/reactions.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    at = {row["node"]: row for row in rows if row["stage"] == "case wind"}
    foundation = np.array([[at[k][f"foundation_{axis}"] for axis in "xyz"] for k in (0, 2, 3)])
    assert foundation.sum(0) == pytest.approx(force.sum(0), rel=1e-4, abs=1e-4 * np.abs(force).max())
    assert foundation[0] == pytest.approx(force[0] - N[0] * axes[:, 0], rel=1e-4, abs=1.0)
    lines: list[str] = []
    loads = {each["load"]: each["resultant"] for each in check_values(read_job(job), lines)["slender_loads"]}
    drag = on_top_and_foot(ice, direction, exponent, base)[1].sum(0)
    assert loads["wind of [[case]] wind"] == pytest.approx(drag, rel=1e-9)
    assert ("ice of [[case]] wind" in loads) == bool(ice)
    assert any("wind of [[case]] wind on elements with a diameter: resultant" in line for line in lines)
    assert not any("area" in line for line in lines if line.startswith("warning"))
