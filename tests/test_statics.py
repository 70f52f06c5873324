"""Static equilibrium under load: load steps, slack cables, balance of forces. Closed forms:
test_validation_statics.py.
"""

import numpy as np
import pytest
from conftest import STEEL
from nets import pulls

from netfall.driver.reporting.run import stages
from netfall.job.derived import load_steps
from netfall.job.read import read_job

SADDLE = '[net]\ngenerator = "saddle"\n' + STEEL.replace("683.08e-6", "3600e-6").replace("100e3", "1800e3")


def test_loads_alone_act_with_self_weight_in_one_step(workshop):
    """These are the defaults of [load]. A job with a dynamic stage has no load step by default."""
    job = read_job(workshop.job(SADDLE + "[load]\n"))
    assert job.load.self_weight and stages(job) == ["statics (1 load step)"]
    assert load_steps(read_job(workshop.job(SADDLE + "[load]\n[dynamics]\nduration = 0.1\n"))) == 0


def test_a_net_of_slack_cables_finds_its_equilibrium(workshop):
    """300 K lengthen each cable by 3.6e-3, its prestress by 7.5e-4, so all are slack without snow. With it
    the forces balance at every free node, with tensions of Hooke's law at the computed lengths.
    """
    text = '[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 16\n[form_finding]\nmethod = "force_density"\n'
    f = workshop.solve(
        f"{text}{STEEL}[load]\nself_weight = false\nsnow = 500.0\ntemperature = 300.0\nsteps = 2\n"
    )
    N, m = f["statics/tension"][-1], len(f["net/elements"])
    assert f["statics/slack"][0] == m and 0 < f["statics/slack"][-1] == (N == 0).sum() < m
    x = f["form_finding/position"][:] + f["statics/displacement"][-1]
    a, b = f["net/elements"][:].T
    lengths, rest = np.linalg.norm(x[b] - x[a], axis=1), 1.0036 * f["form_finding/unstressed_length"][:]
    law = np.maximum(0.0, 1.95e11 * 683.08e-6 * (lengths / rest - 1.0))
    assert np.abs(N - law).max() < 1e-8 * N.max()  # EA times the rounding of a length of 5 m
    force = pulls(x, f["net/elements"][:], N)
    force[:, 2] -= 500.0 * f["net/plan_area"][:]
    free = ~f["net/fixed"][:].astype(bool)
    assert np.abs(force[free]).max() <= 1e-5 * N.max()  # tolerance 1e-6 of tensions, four at a node


def test_stability_is_checked_at_the_displaced_positions(workshop):
    """Masts are stable in the inflated position by the tangent there, not by that of the form."""
    n, corners = 8, ((0, -17, 2), (17, 0, 11), (0, 17, 2), (-17, 0, 11))
    nodes, elements = ["id,x,y,z,fixed"], ["start,end,group"]
    for i, j in np.ndindex(n + 1, n + 1):
        u, v = i / n, j / n
        x, y, z = np.array([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v]) @ corners
        k, low = (n + 1) * i + j + 1, i == j and i in (0, n)
        nodes.append(f"{k},{x},{y},{z},{int(low)}")
        elements += [f"{k},{k + n + 1},{'edge' if j in (0, n) else 'net'}"] * (i < n)
        elements += [f"{k},{k + 1},{'edge' if i in (0, n) else 'net'}"] * (j < n)
    for side, top, first in ((1, (n + 1) * n + 1, 101), (-1, n + 1, 201)):
        nodes += [f"{first + k},{side * x},{y},0,1" for k, (x, y) in enumerate(((19, 0), (28, -9), (28, 9)))]
        elements += [f"{first},{top},mast", f"{first + 1},{top},stay", f"{first + 2},{top},stay"]
    job = workshop.job(
        "[cable]\nmodulus = 1.6e11\narea = 120e-6\ndensity = 7850.0\nprestress = 15e3\n"
        "[group.edge]\narea = 600e-6\nprestress = 110e3\n[group.stay]\narea = 900e-6\nprestress = 100e3\n"
        '[group.mast]\nkind = "bar"\narea = 6e-3\nprestress = -160e3\n'
        '[form_finding]\nmethod = "force_density"\n[load]\nself_weight = true\ndead = 50.0\n'
        '[[case]]\nname = "uplift"\nset = {"load.pressure" = -2400.0}\n',
        "\n".join(nodes),
        "\n".join(elements),
    )
    done = workshop.run(job, code=None)
    with workshop.open() as f:
        assert f["cases/uplift"].attrs["state"] == "equilibrium"
    assert done.returncode == 0 and "could not be decided" not in done.stdout


@pytest.mark.parametrize("top, is_noted", [(5.0, True), (-5.0, False)])
def test_a_net_that_snaps_through_is_a_warning(workshop, top, is_noted):
    """From 5 m above the square the top moves by 10 m, from 5 m below it by less than 0.01 m."""
    nodes = "id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,10,0,0,1,0\n3,10,10,0,1,0\n4,0,10,0,1,0\n"
    cable = "[cable]\nmodulus = 1e11\narea = 1e-3\ndensity = 7850.0\n[load]\nself_weight = false\nsteps = 2\n"
    tables = nodes + f"5,5,5,{top},0,-1e4\n", "start,end\n1,5\n2,5\n3,5\n4,5\n"
    done = workshop.solve(cable, *tables, code=None)
    with workshop.open() as f:
        moved = -f["statics/displacement"][-1][4, 2]
    assert done.returncode == 0 and ((9.99 < moved < 10.01) if is_noted else (0.0 < moved < 0.01))
    for text in (done.stdout, workshop.info(), workshop.report().page):
        lines = [line for line in text.splitlines() if "warning: statics: node 5 moved by 100" in line]
        assert ["mm, more than 20% of the largest" in line for line in lines] == [True] * is_noted, text
