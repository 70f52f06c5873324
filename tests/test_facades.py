"""Roofs seen from their outer side: facades and canopies, their areas, zones, wind and pictures, by hand."""

import numpy as np
import pytest
from nets import elastic, equilibrium, table

from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.driver.check import check_job
from netfall.job.read import read_job
from netfall.model.layout import make_layout
from netfall.model.model import make_model

CABLES = "[cable]\nmodulus = 1.6e11\narea = 400e-6\ndensity = 7850.0\nprestress = 200e3\n"
LOAD = "[load]\nself_weight = false\ntolerance = 1e-9\n"
OUTSIDE = "[roof]\nnormal = [0, -1, 0]\n"  # the outer side of the facade looks to -y
PRESSED = CABLES + LOAD + "pressure = 1000.0\n"


def turned(x, angle):
    """Points (n, 3) turned about z by an angle [degrees]."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.asarray(x, float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def facade(columns=8, rows=5, angle=0.0, width=40.0, height=25.0):
    """Positions (n, 3) [m], supports (n,) bool and elements of an upright grid in y = 0, held at its edge."""
    i, k = (part.ravel() for part in np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)))
    x = np.column_stack([width / columns * i, 0.0 * i, height / rows * k])
    number = np.arange(len(x)).reshape(rows + 1, columns + 1)
    pairs = [np.stack([number[:, :-1], number[:, 1:]], -1), np.stack([number[:-1], number[1:]], -1)]
    edge = (i == 0) | (i == columns) | (k == 0) | (k == rows)
    return turned(x, angle), edge, np.concatenate([pair.reshape(-1, 2) for pair in pairs])


def tables(x, edge, elements, group=None):
    """nodes.csv and elements.csv of a grid; groups of the elements."""
    group = ["net"] * len(elements) if group is None else group
    return (
        table("id,x,y,z,fixed", [(p, *at, int(held)) for p, (at, held) in enumerate(zip(x.tolist(), edge))]),
        table("start,end,group", [(*pair, name) for pair, name in zip(elements.tolist(), group)]),
    )


def model_of(workshop, text, net=None, overrides=()):
    """The model of a job with the tables of a facade, or of another net."""
    job = read_job(workshop.job(text, *tables(*(net or facade()))), list(overrides))
    layout = make_layout(job, 1)
    return make_model(job, layout, layout.net.x, None)


def test_areas_of_a_facade(workshop):
    """1000 m2 that look to -y: 25 m2 at inner nodes, half on the sides, a quarter in the corners."""
    model, x = model_of(workshop, PRESSED + OUTSIDE), facade()[0]
    sides = np.isin(x[:, 0], (0.0, 40.0)).astype(int) + np.isin(x[:, 2], (0.0, 25.0))
    assert np.allclose(model.roof.area, np.array([25.0, 12.5, 6.25])[sides], rtol=1e-12)
    assert np.allclose(model.roof.vector, model.roof.area[:, None] * [0.0, -1.0, 0.0], atol=1e-12)
    assert np.allclose(model.loading.live.sum(0), [0.0, 1e6, 0.0], atol=1e-6)
    assert np.abs(model.roof.plan_area).max() == 0.0


def test_snow_and_dead_load_on_a_facade(workshop):
    """Snow needs an area in plan and has none; cladding of 0.2 kN/m2 weighs 200 kN."""
    text = CABLES + "[load]\nself_weight = false\ndead = 200.0\nsnow = 750.0\n" + OUTSIDE
    loading = model_of(workshop, text).loading
    assert np.allclose(loading.permanent.sum(0), [0.0, 0.0, -200e3]) and not loading.live.any()


@pytest.mark.parametrize("angle", [30.0, 90.0, 200.0])
def test_a_turned_facade_has_the_turned_result(workshop, angle):
    """Areas to rounding, displacements of the equilibrium to its tolerance."""
    zone = '[[zone]]\nname = "top"\npolygon = [[3, 18], [43, 18], [43, 26], [3, 26]]\n'
    text, found = PRESSED + "steps = 1\n" + zone + "[load.zone.top]\npressure = -500.0\n", []
    for each in (0.0, angle):
        x, edge, elements = facade(4, 3, each)
        along = turned([[1.0, 0.0, 0.0]], each)[0]
        shift = 3.0 * along  # polygons count from the origin: shifted, to see that they do
        normal = turned([[0.0, -1.0, 0.0]], each)[0].tolist()
        with workshop.solve(f"{text}[roof]\nnormal = {normal}\n", *tables(x + shift, edge, elements)) as f:
            found.append((f["net/vector_area"][:], f["statics/displacement"][-1], f["net/tributary_area"][:]))
    (vector, u, area), (other_vector, other_u, other_area) = found
    assert np.allclose(other_vector, turned(vector, angle), atol=1e-9) and np.allclose(area, other_area)
    assert np.abs(other_u - turned(u, angle)).max() < 1e-7 * lengths(u).max()
    assert u[:, 1].max() > 0.01 and lengths(u).max() > 0.0


def test_the_middle_of_a_flat_net_under_pressure(workshop):
    """One free node on four cables of 5 m: p 25 m2 = 4 w (T / l + EA / 2 l (w / l)2 ...), by statics."""
    x, edge, elements = facade(2, 2, width=10.0, height=10.0)
    with workshop.solve(PRESSED + "steps = 1\n" + OUTSIDE, *tables(x, edge, elements)) as f:
        w = f["statics/displacement"][-1][4, 1]
    EA, T, side = 1.6e11 * 400e-6, 200e3, 5.0
    L0 = side / (1.0 + T / EA)
    length = np.hypot(side, w)
    assert np.isclose(4 * EA * (length / L0 - 1.0) * w / length, 1000.0 * 25.0, rtol=1e-7)


def test_a_two_way_net_under_pressure(workshop):
    """40 x 25 m, 1 kN/m2: against the equilibrium of springs that Newton's method finds on its own."""
    x, edge, elements = facade()
    with workshop.solve(PRESSED + "steps = 1\n" + OUTSIDE, *tables(x, edge, elements)) as f:
        u, N = f["statics/displacement"][-1], f["statics/tension"][-1]
    EA, length = 1.6e11 * 400e-6, lengths(x[elements[:, 1]] - x[elements[:, 0]])
    load = np.where(edge, 0.0, 25e3)[:, None] * [0.0, 1.0, 0.0]
    fixed = np.repeat(edge[:, None], 3, 1)
    wanted, wanted_N = equilibrium(x, elements, elastic(length / (1.0 + 200e3 / EA), EA), fixed, load)
    assert np.abs(u - (wanted - x)).max() < 1e-6 * np.abs(u).max()
    assert np.allclose(N[~edge[elements].all(1)], wanted_N[~edge[elements].all(1)], rtol=1e-6)


def test_check_and_info_tell_the_outer_side(workshop):
    """The resultant of a pressure, in both; a facade without the key is answered with it."""
    job = workshop.job(PRESSED + "steps = 1\n" + OUTSIDE, *tables(*facade(4, 3)))
    line = "outer side: a pressure of 1 kN/m2 on all faces has the resultant 0, 1000, 0 kN along x, y, z"
    said = []
    check_job(read_job(job), said.append, None)
    assert line in said and "0 warnings" in said
    with workshop.run(job):
        assert line in workshop.info()
    with pytest.raises(InputError, match=r"looks to \[roof\] normal = \[0, -?1, 0\], or"):
        model_of(workshop, PRESSED)
    with pytest.raises(InputError, match=r"\[roof\] normal = \[0, 0, 0\]: has no direction"):
        model_of(workshop, PRESSED + "[roof]\nnormal = [0, 0, 0]\n")


def test_a_steep_roof_without_the_key_is_a_warning(workshop):
    """A facade that leans by 1 in 10: its upper side is told to be the outer one."""
    x, edge, elements = facade(4, 3)
    x[:, 1] = 0.1 * x[:, 2]
    lean = (x, edge, elements)
    notes = model_of(workshop, PRESSED, lean).layout.notes
    assert any("W239" in note for note in notes) and any("m2 in plan of 1005 m2" in note for note in notes)
    assert not any("W239" in note for note in model_of(workshop, PRESSED + OUTSIDE, lean).layout.notes)
