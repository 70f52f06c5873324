"""Areas of the roof: faces of any drawing in plan, by hand and compared with known polygons."""

import re
from itertools import product

import hypothesis.strategies as st
import numpy as np
import pytest
import shapely
from conftest import error_lines, lines_with
from hypothesis import HealthCheck, assume, given, settings
from nets import model_of, pulls, table
from scipy.spatial import Delaunay

import netfall
from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.geometry.areas import find_roof, normals, tributary_areas
from netfall.geometry.build import build_net
from netfall.geometry.faces import find_faces
from netfall.geometry.net import Net, subdivide
from netfall.geometry.plan import draw_plan
from netfall.geometry.shares import make_panels, share_out_faces
from netfall.job.read import read_job
from netfall.model.layout import layout_digest

SOFT = "[cable]\nmodulus = 1e9\narea = 1e-6\ndensity = 7850.0\nprestress = 1e3\n"
PRESSED = SOFT + "[load]\nself_weight = false\npressure = [0.0, 0.0, -10.0]\n"


def net_of(xy, elements, group=None, z=0.0):
    """Return a net of free nodes in plan."""
    x = np.column_stack([np.array(xy, float), np.broadcast_to(np.asarray(z, float), len(xy))])
    group = np.zeros(len(elements), int) if group is None else np.array(group)
    names = [f"g{k}" for k in range(group.max() + 1)]
    return Net(x, np.zeros((len(xy), 3), bool), np.array(elements), group, names)


def tributary_of(net):
    """Return areas of the particles of a drawing without faults."""
    plan = draw_plan(net)
    assert not plan.error, plan.error
    return tributary_areas(net.x, net, find_faces(net, plan))


def ring(*corners):
    """Return elements around a ring of nodes."""
    return list(zip(corners, (*corners[1:], corners[0])))


def grid_tables(rim="short", more=()):
    """Return nodes.csv and elements.csv of a grid of 1 m cells with a fixed rim; node ids are 10 i + j."""
    line, last = range(5), 4
    rows = list(product(line, line))
    pairs = [(10 * i + j, 10 * i + j + 1) for i in line[1:-1] for j in line[:-1]]
    pairs += [(10 * i + j, 10 * i + j + 10) for j in line[1:-1] for i in line[:-1]]
    if rim != "open":
        step = last if rim == "long" else 1
        for k in range(0, last, step):
            pairs += [(k, k + step), (10 * last + k, 10 * last + k + step)]
            pairs += [(10 * k, 10 * (k + step)), (10 * k + last, 10 * (k + step) + last)]
    else:
        rows = [place for place in rows if place not in product((0, last), (0, last))]
    nodes = ((10 * i + j, i, j, 0, int(not {i, j}.isdisjoint((0, last)))) for i, j in rows)
    elements = ((*ends, 100 + k) for k, ends in enumerate([*pairs, *more]))
    return table("id,x,y,z,fixed", nodes), table("start,end,id", elements)


def roof_from(workshop, text, nodes, elements, overrides=()):
    """Return net, roof and areas of a job with tables."""
    job = read_job(workshop.job(text, nodes, elements), list(overrides))
    net = build_net(job)
    roof = find_roof(job, net)
    return net, roof, tributary_areas(net.x, net, roof.faces)[1]


GRIDS = {
    "short rim": ("short", []),
    "rim of four long elements over the supports": ("long", []),
    "both rims": ("short", [(0, 4), (40, 44), (0, 40), (4, 44)]),
    "an inner element twice": ("short", [(11, 12), (22, 21)]),
    "a border element twice": ("short", [(1, 0)]),
    "a long element beside two short ones": ("short", [(21, 23), (33, 31)]),
}


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("parts", [1, 3])
def test_a_grid_has_one_square_metre_at_each_inner_node(workshop, name, parts):
    """Five by five nodes, 1 m cells: 16 m2 in total, 1 m2 at each inner node, for any kind of drawing."""
    net, _, area = roof_from(workshop, PRESSED, *grid_tables(*GRIDS[name]), [f"net.subdivide={parts}"])
    assert np.isclose(area.sum(), 16.0, rtol=1e-12)
    inner = ~net.fixed.all(1) & (np.arange(net.n) < 25)
    # divided in three: in each of four cells the square up to half way to the next corners, 1/36 m2
    expected = 1.0 if parts == 1 else 4 / 36
    assert np.allclose(area[inner], expected, rtol=1e-12)
    assert (area >= 0).all()


def raised_tables(height):
    """Return the grid with nodes at height(x, y, fixed)."""
    nodes, elements = grid_tables()
    rows = [(i, x, y, height(float(x), float(y), int(fixed)), fixed) for i, x, y, _, fixed in cells(nodes)]
    return table("id,x,y,z,fixed", rows), elements


def cells(text):
    """Return the cells of a table's rows, without the header."""
    return [line.split(",") for line in text.splitlines()[1:]]


def tilted_tables():
    """Return the grid with its rim on z = 3/4 x, inner nodes at z = 0: 5/4 m2 of surface for 1 in plan."""
    return raised_tables(lambda x, y, fixed: 0.75 * x * fixed)


FOUND = SOFT + "[form_finding]\nmodulus_factor = 0\ntolerance = 1e-12\n"


def test_areas_are_those_of_the_form(workshop):
    """A plane of 16 m2 in plan and 20 m2 of surface, from another start: 8 N/m2 are 10 N at a node."""
    job = workshop.job(FOUND + "[load]\nself_weight = false\ndead = 8.0\nsteps = 1\n", *tilted_tables())
    with workshop.run(job) as f:
        surface, plan = f["net/tributary_area"][:], f["net/plan_area"][:]
        inner = f["net/fixed"][:, 0] == 0
        sag = -f["statics/displacement"][-1][12, 2]
    # positions are found to 1e-12 of the prestress
    assert np.allclose(surface[inner], 1.25, rtol=1e-9) and np.isclose(surface.sum(), 20.0, rtol=1e-9)
    assert np.allclose(plan[inner], 1.0, rtol=1e-9) and np.isclose(plan.sum(), 16.0, rtol=1e-9)
    # linear statics in x and z: cables of N = EA = 1 kN, L0 = L / 2; N / L across, EA / L0 along
    line, slope = 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1), np.array([0.8, 0.6])
    uphill, level = 800 * np.eye(2) + 800 * np.outer(slope, slope), 1000 * np.eye(2)
    stiffness = np.kron(np.kron(line, np.eye(3)), uphill) + np.kron(np.kron(np.eye(3), line), level)
    linear = np.linalg.solve(stiffness, np.tile([0.0, 10.0], 9)).reshape(9, 2)[4, 1]
    assert abs(sag / linear - 1) < 5e-3  # slopes of a hundredth


@pytest.mark.parametrize("pressure", ["8.0", "[4.8, 0.0, -6.4]"])
def test_pressure_acts_on_the_surface(workshop, pressure):
    """8 N/m2 against the normal (-0.6, 0, 0.8) of the plane, as a number or a vector: 10 N at each node."""
    load = f"[load]\nself_weight = false\npressure = {pressure}\nsteps = 1\n"
    with workshop.solve(FOUND + load, *tilted_tables()) as f:
        x = f["form_finding/position"][:] + f["statics/displacement"][-1]
        tension, ends = f["statics/tension"][-1], f["net/elements"][:]
        free = f["net/fixed"][:, 0] == 0
        area = f["net/tributary_area"][:]
    # equilibrium to the tolerance of statics, 1e-6 of 1 kN
    load = 8 * area[free, None] * np.array([0.6, 0, -0.8])
    assert np.allclose(pulls(x, ends, tension)[free], -load, atol=2e-3)
    assert np.allclose(area[free], 1.25, rtol=1e-9)


def dome_tables(rise):
    """Return the grid of 25 nodes, 4 m wide, raised to a quadric over a horizontal rim."""
    bump = lambda t: t * (4.0 - t) / 4.0
    return raised_tables(lambda x, y, fixed: rise * bump(x) * bump(y))


@pytest.mark.parametrize("rise", [0.5, 1.0, 2.0])
def test_the_resultant_of_a_pressure_is_that_on_the_outline(workshop, rise):
    """10 N/m2 over a horizontal outline of 16 m2: 160 N down; 250 N/m2 of wind, or at taps: 4 kN up."""
    text = SOFT + "[load]\nself_weight = false\npressure = 10.0\n[dynamics]\nduration = 0.01\n"
    wind = "[wind]\nspeed = 20.0\nsurface_drag = 0.0\npressure_coefficient = -1.0\nprofile_exponent = 0.0\n"
    model = model_of(read_job(workshop.job(text + wind, *dome_tables(rise))))
    # rounding of 25 shares of 1 m2 each
    assert model.loading.live.sum(0) == pytest.approx([0.0, 0.0, -160.0], rel=1e-14, abs=1e-12)
    assert 20.0**2 * model.wind.sum(0) == pytest.approx([0.0, 0.0, 4000.0], rel=1e-14, abs=1e-11)
    assert (model.roof.area > lengths(model.roof.vector))[~model.net.fixed.all(1)].any()
    (workshop.folder / "taps.csv").write_text("name,x,y\na,0,0\n")
    (workshop.folder / "values.csv").write_text("time,a\n0,-250\n1,-250\n")
    tapped = '[wind]\ntaps = "taps.csv"\npressures = "values.csv"\n'
    model = model_of(read_job(workshop.job(text + tapped, *dome_tables(rise))))
    assert model.mean_wind.sum(0) == pytest.approx([0.0, 0.0, 4000.0], rel=1e-14, abs=1e-11)


def test_given_vector_areas_are_used(workshop):
    """Area times normal. A missing normal has the proportions of the faces, a missing area their area."""
    rows = ("", ",area", ",normal_x,normal_y,normal_z", ",area,normal_x,normal_y,normal_z")
    nodes, elements = dome_tables(1.0)
    areas = []
    for head, cells in zip(rows, ("", ",3", ",0.6,0,0.8", ",3,0.6,0,0.8")):
        first, *others = nodes.splitlines()
        table = "\n".join([first + head, *(row + cells for row in others)])
        net = build_net(read_job(workshop.job(PRESSED, table, elements)))
        areas.append(tributary_areas(net.x, net, find_faces(net)))
    plain, area, normal, both = areas
    factor = 3.0 / plain.surface
    assert np.allclose(area.vector, factor[:, None] * plain.vector, rtol=1e-14)
    assert (area.surface == 3.0).all()
    assert np.allclose(area.plan, factor * plain.plan, rtol=1e-14)
    assert np.allclose(normal.vector, plain.surface[:, None] * [0.6, 0, 0.8], rtol=1e-14)
    assert (normal.surface == plain.surface).all() and (normal.plan == plain.plan).all()
    assert np.allclose(both.vector, [1.8, 0, 2.4], rtol=1e-14) and np.allclose(both.plan, 2.4)


def test_a_given_area_of_a_ridge_has_the_slope_of_each_side(workshop):
    """Twice 4 m2 on slopes of 45 degrees are 8 cos 45 m2 in plan, not 8 m2 along the mean normal."""
    grid = [(i, j) for i in range(3) for j in range(3)]
    area = lambda place: 8 if place == (1, 1) else ""
    rows = ((10 * i + j, 2 * i, 2 * j, 2 * (j == 1), int(i != 1), area((i, j))) for i, j in grid)
    nodes = table("id,x,y,z,fixed,area", rows)
    pairs = [(10 * i + j, 10 * i + j + step) for i, j in grid for step in (1, 10)]
    elements = table("start,end", (pair for pair in pairs if pair[1] % 10 < 3 and pair[1] < 30))
    net, roof, _ = roof_from(workshop, PRESSED, nodes, elements)
    ridge = net.node_id.tolist().index(11)
    assert roof.given.surface[ridge] == 8.0
    assert roof.given.plan[ridge] == pytest.approx(8.0 * np.sqrt(0.5), rel=1e-14)
    assert roof.given.vector[ridge] == pytest.approx([0.0, 0.0, 8.0 * np.sqrt(0.5)], rel=1e-14, abs=1e-14)


def test_the_result_has_vector_areas(workshop):
    """Vector areas sum to the outline, also in Python. Dead load uses the surface."""
    text = SOFT + "[load]\nself_weight = false\ndead = 8.0\npressure = 10.0\nsteps = 1\n"
    with workshop.solve(text, *dome_tables(0.1)) as f:
        vector, surface = f["net/vector_area"][:], f["net/tributary_area"][:]
    assert vector.shape == (25, 3) and vector.sum(0) == pytest.approx([0, 0, 16.0], abs=1e-13)
    assert surface.sum() > 16.01
    result = netfall.open(workshop.folder / "result.vtkhdf")
    assert (result.nodes["vector_area"] == vector).all()


def test_an_open_rim_is_a_warning(workshop):
    """Without a rim only the four middle cells are closed: 4 of the 14 m2 within the convex outline."""
    _, roof, area = roof_from(workshop, PRESSED, *grid_tables("open"))
    assert np.isclose(area.sum(), 4.0)
    note = next(note for note in roof.notes if "continue beyond the faces" in note)
    assert note.startswith("warning: ") and "28.6%" in note
    assert "8 free nodes" in note and "11, 12, 13, 21, 23, ..." in note
    _, roof, _ = roof_from(workshop, PRESSED, *grid_tables("short"))
    assert roof.notes == [] and roof.covered_share == 1.0


U_SHAPE = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]


def test_a_concave_face_by_hand():
    """A dart is two triangles at its reflex corner, each shared in thirds; a U is shared by nearest corner.

    The dart has two triangles of 1 m2. Of the U of 7 m2 a foot has the triangle below x + y = 1. A leg of
    1 m: its inner tip has 1/2 m x 1 m, its outer one 1/16 m2 more, above y = 2 + (x - 1/2) / 2; the knee has
    the rest of the half.
    """
    dart = net_of([(0, 0), (2, 2), (4, 0), (2, 3)], ring(*range(4)))
    assert np.allclose(tributary_of(dart).plan, [1 / 3, 2 / 3, 1 / 3, 2 / 3], rtol=1e-12)
    foot, inner, outer = 1 / 2, 1 / 2, 1 / 2 + 1 / 16
    knee = 7 / 2 - foot - inner - outer
    expected = [foot, foot, outer, inner, knee, knee, inner, outer]
    assert np.allclose(tributary_of(net_of(U_SHAPE, ring(*range(8)))).plan, expected, rtol=1e-12)


def two_layers(groups=""):
    """Return a grid over its image 2 m below, with hangers."""
    nodes, upper = grid_tables()
    rows, pairs = cells(nodes), cells(upper)
    nodes += "".join(f"{int(i) + 500},{x},{y},-2,{fixed}\n" for i, x, y, _, fixed in rows)
    elements = "start,end,id,group\n" + "".join(f"{a},{b},{k},upper\n" for a, b, k in pairs)
    elements += "".join(f"{int(a) + 500},{int(b) + 500},{int(k) + 500},lower\n" for a, b, k in pairs)
    elements += "".join(f"{i},{int(i) + 500},{int(i) + 2000},hanger\n" for i, *_ in rows)
    return PRESSED + groups, nodes, elements


def test_two_layers_need_the_groups_of_the_roof(workshop):
    """The error has nodes, elements and the remedy. With the groups the roof is that layer's 16 m2."""
    pairs = r"25 pairs of nodes.*0 \(elements 124, 126\) and 500 \(elements 624, 626\).*\[roof\] groups"
    with pytest.raises(InputError, match=pairs):
        roof_from(workshop, *two_layers())
    for name, first in (("upper", 0), ("lower", 25)):
        net, roof, area = roof_from(workshop, *two_layers(f'[roof]\ngroups = ["{name}"]\n'))
        own = slice(first, first + 25)
        assert np.isclose(area.sum(), 16.0) and np.isclose(area[own].sum(), 16.0) and roof.notes == []
        assert np.allclose(area[own][~net.fixed[own, 0]], 1.0)
    with pytest.raises(InputError, match=r'groups: no element is of group "uper"; did you mean "upper"'):
        roof_from(workshop, *two_layers('[roof]\ngroups = ["uper"]\n'))


def test_elements_that_cross_are_refused_with_their_ids(workshop):
    """Two diagonals have no common node. Without loads on the roof this is not an error."""
    nodes, elements = grid_tables("short", [(11, 22), (12, 21)])
    at = r"1 pair of elements \(140 and 141\) cross in plan without a node, the first at x, y = 1.5, 1.5 m\. "
    with pytest.raises(InputError, match=at + "Name in"):
        roof_from(workshop, PRESSED, nodes, elements)
    _, roof, area = roof_from(workshop, SOFT, nodes, elements)
    assert area.sum() == 0 and "140 and 141" in roof.notes[0]


def test_areas_and_normals_of_the_table_replace_faces(workshop):
    """Elements cross, but all areas and normals are given. Normals become unit vectors; all must exist."""
    nodes, elements = grid_tables("short", [(11, 22), (12, 21)])
    rows = ((*row, 2, 0.3, 0, 0.4) for row in cells(nodes))
    given = table("id,x,y,z,fixed,area,normal_x,normal_y,normal_z", rows)
    text = SOFT + "[load]\nself_weight = false\npressure = 5.0\n"
    net, roof, area = roof_from(workshop, text, given, elements)
    assert np.allclose(area, 1.6)  # in plan: 2 m2 of surface on a slope of 3/4
    assert np.allclose(normals(net, roof.given.vector), [0.6, 0, 0.8])
    with pytest.raises(InputError, match="normal_z"):
        roof_from(workshop, text, given.replace("2,0.3,0,0.4", "2,,,", 1), elements)
    faults = {"0.3,0,-0.4": "upward normal", "0,0,0": "upward normal", "0.3,,0.4": "three numbers"}
    for wrong, message in faults.items():
        with pytest.raises(InputError, match=message):
            roof_from(workshop, text, given.replace("0.3,0,0.4", wrong, 1), elements)


@pytest.mark.parametrize("parts", [1, 2, 3, 4])
@pytest.mark.parametrize("rows", [["11"], ["11", "12", "13", "21", "22", "23", "31", "32", "33"]])
def test_areas_of_some_nodes_count_once_in_subdivided_nets(workshop, rows, parts):
    """Nodes have 1 m2 given and by their faces: 16 m2 in both cases, and none at inner nodes."""
    nodes, elements = grid_tables()
    head, *lines = nodes.splitlines()
    given = [f"{line},{int(line.split(',')[0] in rows) or ''}" for line in lines]
    tables = "\n".join([head + ",area", *given]), elements
    net, roof, area = roof_from(workshop, f"subdivide = {parts}\n" + PRESSED, *tables)
    assert area.sum() == pytest.approx(16.0, rel=1e-12)
    is_given = np.isin(net.node_id.astype(str), rows)
    assert area[is_given] == pytest.approx(1.0, rel=1e-15)  # rounding of the slope of the faces
    area[~is_given] *= 4.0  # in a form of twice the size all others follow their faces
    assert tributary_areas(2.0 * net.x, net, roof.faces).surface == pytest.approx(area, rel=1e-12)


def test_nodes_without_area_are_named(workshop):
    """A free end inside a cell carries nothing."""
    nodes, elements = grid_tables("short", [(11, 999)])
    _, roof, area = roof_from(workshop, PRESSED, nodes + "999,1.4,1.4,0,0\n", elements)
    assert np.isclose(area.sum(), 16.0) and "1 free nodes (999) carry no roof area" in roof.notes[0]


def test_check_states_both_areas_and_the_outline(workshop):
    """In a line of `netfall check`, with notes on parallel elements and on a node within an element."""
    job = workshop.job(PRESSED, *grid_tables("long", [(11, 12)]))
    output = workshop.check(job)
    line = "roof: 16.0 m2 of surface, 16.0 m2 in plan; closed faces cover 100.0% of the net's outline in plan"
    assert line in output, output
    assert "join the same two nodes (101 and 128)." in output
    assert "not at their ends: " in output and " (1 in element 124" in output


def spokes():
    """Return tables of twelve radial cables over nodes at 10, 20 and 30 m, with a rim at the last."""
    angle = 2 * np.pi * np.arange(12) / 12
    places = [(0.0, 0.0), *((r * np.cos(a), r * np.sin(a)) for r in (10.0, 20.0, 30.0) for a in angle)]
    number = lambda ring, k: 101 + ring * 12 + k % 12
    pairs = [(100, number(0, k)) for k in range(12)]
    pairs += [(number(j, k), number(j + 1, k)) for j in (0, 1) for k in range(12)]
    pairs += [(number(2, k), number(2, k + 1)) for k in range(12)]
    nodes = ((100 + row, *place, 0, int(row > 24)) for row, place in enumerate(places))
    return table("id,x,y,z,fixed", nodes), table("start,end", pairs)


SLOPE = np.tan(np.radians(15.0))
OUTER = 450.0 * np.sin(np.radians(30.0)) - 625.0 * SLOPE  # m2 of a sector at its node of the rim


def test_sectors_without_rings_are_shared_along_the_spokes(workshop):
    """12 spokes, nodes at 10, 20 and 30 m, a rim at 30 m alone: a sector between two spokes is one face.

    Half a sector belongs to its spoke, cut at 5, 15 and 25 m: tan 15 (15^2 - 5^2), tan 15 (25^2 - 15^2) and
    the rest of 450 sin 30 m2; the middle has 12 tan 15 5^2.
    """
    _, _, area = roof_from(workshop, PRESSED, *spokes())
    expected = [300.0 * SLOPE, *[200.0 * SLOPE] * 12, *[400.0 * SLOPE] * 12, *[OUTER] * 12]
    assert np.allclose(area, expected, rtol=1e-13)


@pytest.mark.parametrize("parts", [1, 3])
def test_panels_are_whole_faces_with_the_loads_of_their_corners(parts):
    """A U, cut into cells for its surface, a rectangle and a triangle: three panels by the same shares."""
    xy = [*U_SHAPE, (4, 0), (4, 3), (5, 1.5)]
    elements = [*ring(*range(8)), (1, 8), (8, 9), (9, 2), (8, 10), (10, 9)]
    net = subdivide(net_of(xy, elements, z=[0.1 * x * y for x, y in xy]), parts)
    faces = find_faces(net)
    areas = tributary_areas(net.x, net, faces)
    panels = make_panels(net, faces, areas.shares)
    assert panels.count == faces.count == 3 and len(faces) > 3
    at_nodes = lambda values: np.bincount(panels.node, values, net.n)
    assert np.allclose(at_nodes(panels.area), areas.surface, rtol=1e-14)
    assert np.allclose(at_nodes(panels.plan_area), areas.plan, rtol=1e-14)
    assert np.allclose(at_nodes(panels.vector[:, 2]), areas.vector[:, 2], rtol=1e-14)
    of_panel = np.bincount(panels.of_corner, panels.plan_area)
    assert sorted(of_panel.round(12)) == [1.5, 3.0, 7.0]
    shared, within_u = (panels.at(np.arange(parts) + parts * k) for k in (1, 4))
    assert len(shared) == 2 and of_panel[within_u].round(12).tolist() == [7.0]


def nearest_shares(rings):
    """Return area and share of each corner (k,) of an outer ring and holes, by nearest corner."""
    polygon = shapely.Polygon(rings[0], rings[1:])
    corners = np.array([corner for ring in rings for corner in ring])
    reach = 4.0 * np.ptp(corners, axis=0).max()
    shares = []
    for i, own in enumerate(corners):
        cell = polygon
        for other in np.delete(corners, i, axis=0):
            along = (other - own) / np.linalg.norm(other - own)
            across, middle = reach * np.array([-along[1], along[0]]), 0.5 * (own + other)
            far = reach * along
            box = [middle - across, middle + across, middle + across - far, middle - across - far]
            cell = shapely.intersection(cell, shapely.Polygon(box))
        shares.append(cell.area)
    return polygon.area, np.array(shares)


def cut_triangulation(rng, points, share):
    """Return random Delaunay triangles without some sides: concave faces with holes; and their area."""
    xy = rng.uniform(0, 10, (points, 2))
    triangles = Delaunay(xy).simplices
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    pairs, side = np.unique(sides, axis=0, return_inverse=True)
    is_side = rng.random(len(pairs)) < share
    of_side = [[] for _ in pairs]
    for row, k in enumerate(side.ravel()):
        of_side[k].append(row // 3)
    outside = len(triangles)
    label = list(range(outside + 1))
    for k in np.flatnonzero(~is_side):
        a, b = (label[t] for t in [*of_side[k], outside][:2])
        label = [b if value == a else value for value in label]
    p, q, r = (xy[triangles[:, k]] for k in range(3))
    u, v = q - p, r - p
    area = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    closed = np.array(label[:-1]) != label[outside]

    def outline(z):
        """Return the vector area of the closed triangles, with the nodes at heights z."""
        x = np.column_stack([xy, z])
        p, q, r = (x[triangles[closed, k]] for k in range(3))
        vector = 0.5 * np.cross(q - p, r - p)
        return (np.sign(vector[:, 2:]) * vector).sum(0)

    return xy, pairs[is_side], area[closed].sum(), outline


@settings(max_examples=150, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 2**32 - 1), st.integers(4, 40), st.sampled_from([0.6, 0.8, 0.9]), st.integers(1, 3))
def test_areas_of_random_faces_are_exact(seed, points, share, parts):
    """Shares of a face add to 1; vector areas sum to that of the outline, for any heights of inner nodes.

    The order of nodes and elements changes no area. On an inclined plane each node's area is also that of the
    faces cut by bisectors in that plane.
    """
    rng = np.random.default_rng(seed)
    xy, elements, closed, outline = cut_triangulation(rng, points, share)
    if not len(elements):
        return
    z = rng.uniform(-3, 3, points)
    net = subdivide(net_of(xy, elements, z=z), parts)
    assume(not draw_plan(net).notes)  # no triangle so flat that its node lies on the side opposite
    shares = share_out_faces(net.x, find_faces(net))
    assume(len(shares.face))
    assert np.allclose(np.bincount(shares.face, shares.share), 1.0, rtol=1e-12) and (shares.share >= 0).all()
    order, number = rng.permutation(len(elements)), rng.permutation(points)
    turned = np.roll(elements[order], 1, axis=1)
    places = np.argsort(number)
    other = tributary_of(subdivide(net_of(xy[places], number[turned], z=z[places]), parts))
    areas, scale = tributary_of(net), np.abs(shares.vector).sum()
    assert np.allclose(other.plan[number], areas.plan[:points], rtol=1e-9, atol=1e-9)
    assert abs(areas.vector.sum(0) - outline(z)).max() <= 1e-12 * scale
    assert abs(areas.plan.sum() - closed) <= 1e-12 * scale
    slope = np.array([0.75, 0.0])
    plane = subdivide(net_of(xy, elements, z=xy @ slope), parts)
    faces = find_faces(plane)
    areas, shares = tributary_areas(plane.x, plane, faces), share_out_faces(plane.x, faces)
    assert np.allclose(areas.vector, areas.surface[:, None] * [-0.6, 0.0, 0.8], rtol=1e-11, atol=1e-12)
    rings = faces.rings
    for face in range(faces.count):
        own = np.flatnonzero(rings.face == face) if rings.face is not None else [face]
        shapes = [rings.corner[rings.start[r] : rings.start[r + 1]] for r in own]
        corner = np.concatenate(shapes)
        if len(corner) > 4 and len(corner) <= 14 and len(set(corner)) == len(corner):
            in_plane = plane.x[:, :2] * [1.25, 1.0]
            area, part = nearest_shares([in_plane[shape] for shape in shapes])
            of_face = shares.face == face
            computed = np.bincount(shares.node[of_face], shares.surface_areas()[of_face], plane.n)
            assert np.allclose(computed[corner], part, rtol=1e-12, atol=1e-12 * area)


# --- openings

CORNERS = (0, 0), (6, 0), (6, 6), (0, 6), (2, 2), (4, 2), (4, 4), (2, 4)
RINGS = table("id,x,y,z,fixed", ((k, *at, 0, int(k < 6)) for k, at in enumerate(CORNERS, 1)))
TWO_RINGS = "start,end\n1,2\n2,3\n3,4\n4,1\n5,6\n6,7\n7,8\n8,5\n"
SPOKED = TWO_RINGS + "1,5\n2,6\n3,7\n4,8\n"
LOADED = SOFT + "[load]\nself_weight = false\npressure = 100\nsteps = 1\n"


def areas_of(workshop, elements, *arguments) -> np.ndarray:
    """Return the areas of the nodes of a roof of two rings."""
    return roof_from(workshop, LOADED, RINGS, elements, arguments)[2]


def test_an_opening_has_no_area(workshop):
    """6 m x 6 m round an opening of 2 m x 2 m: four trapezoids of 8 m2, whose centroids lie 5/6 m from the
    long side: triangles of 2.5, 7/6 and twice 13/6 m2. Joined to the outer ring by one element 32 m2 too;
    with the opening 36.
    """
    area = areas_of(workshop, SPOKED, "roof.openings=[[3, 3]]")
    assert np.allclose(area, [2.5 + 13 / 6] * 4 + [7 / 6 + 13 / 6] * 4, rtol=1e-14)
    assert np.isclose(areas_of(workshop, TWO_RINGS + "1,5\n", "roof.openings=[[3, 3]]").sum(), 32.0)
    assert np.isclose(areas_of(workshop, SPOKED).sum(), 36.0)
    # two of the trapezoids too, one named twice: 36 - 4 - 2 * 8
    several = "roof.openings=[[3, 3], [3, 1], [2.5, 0.5], [3, 5]]"
    assert np.isclose(areas_of(workshop, SPOKED, several).sum(), 16.0)


def test_an_opening_outside_all_faces_is_refused(workshop):
    """Outside the roof, or on an element: one line for each point."""
    done = workshop.solve(LOADED, RINGS, TWO_RINGS, "--set", "roof.openings=[[3, 3], [7, 3], [3, 2]]", code=2)
    lines = [line.split("openings: ")[1].partition(" of")[0] for line in done.stderr.splitlines()]
    assert lines == ["[7, 3] lies in no face", "[3, 2] lies in no face"]


LINED = LOADED + '[roof]\nlines = "panels.csv"\n'


def lined_roof(workshop, rows, nodes, elements):
    """Return net, roof and areas of a job with these lines."""
    (workshop.folder / "panels.csv").write_text("start,end\n" + rows)
    return roof_from(workshop, LINED, nodes, elements)


LOOSE = "nothing connects the ring of nodes (5, 6, 7, 8) to the face of the roof around it (nodes 1, 2, 3, 4)"


def test_an_unconnected_ring_is_refused(workshop):
    """The ring lies below the roof, inside a face in plan. Connected or outside the roof it is valid."""
    rows = ((k, *at, -2 * (k > 4), int(k < 6)) for k, at in enumerate(CORNERS, 1))
    low = table("id,x,y,z,fixed", rows)
    with pytest.raises(InputError, match=re.escape(LOOSE)) as raised:
        roof_from(workshop, LOADED, low, TWO_RINGS)
    assert len(raised.value.lines) == 1 and "[roof] lines" in raised.value.lines[0]
    assert roof_from(workshop, SOFT, low, TWO_RINGS)[1].notes[0].startswith(f"note: {LOOSE}")
    grouped = LOADED + '[roof]\ngroups = ["roof"]\n'
    rows = ((*ends, "roof" if k < 4 else "hung") for k, ends in enumerate(cells(TWO_RINGS)))
    groups = table("start,end,group", rows)
    _, _, area = roof_from(workshop, grouped, low, groups)
    assert area[:4].tolist() == [9.0] * 4 and not area[4:].any()
    assert roof_from(workshop, LOADED, low, TWO_RINGS + "1,5\n")[1].notes == []
    stayed = groups.replace("hung", "roof") + "3,9,stay\n9,7,stay\n"
    assert roof_from(workshop, grouped, low + "9,9,9,-4,1\n", stayed)[1].notes == []
    _, roof, _ = lined_roof(workshop, "1,5\n", low, TWO_RINGS)
    assert not any(LOOSE in note for note in roof.notes)


# --- edges without elements


def test_lines_close_faces_without_elements(workshop):
    """The inner ring of spokes is given as 12 lines. Shares by hand equal those of faces of elements."""
    nodes, elements = spokes()
    _, _, before = roof_from(workshop, PRESSED, nodes, elements)
    rows = "".join(f"{101 + (k + 1) % 12};{101 + k}\n" for k in range(12))
    (workshop.folder / "panels.csv").write_text("# panels of the top\nend;start\n" + rows)
    net, roof, area = roof_from(workshop, PRESSED + '[roof]\nlines = "panels.csv"\n', nodes, elements)
    third = 0.5 * 10.0**2 * np.sin(np.radians(30.0)) / 3.0
    assert area[0] == pytest.approx(12 * third, rel=1e-13) and net.m == 48 and roof.notes == []
    # the trapezium of five or more corners is shared by nearest corner: six, with those at 20 m
    assert np.allclose(area[25:], OUTER, rtol=1e-13) and area.sum() == pytest.approx(before.sum(), rel=1e-13)


def test_wrong_lines_are_named_by_row_and_id(workshop):
    """An unknown node, one node twice and a text for a number, together; and a missing file."""
    (workshop.folder / "panels.csv").write_text("start,end\n1,99\n2,2\nx,1\n")
    place = workshop.folder / "panels.csv"
    assert error_lines(roof_from, workshop, LINED, RINGS, TWO_RINGS) == [
        f"{place}: line 4: start = 'x': expected an integer [E187]",
        f"{place}: line 2: end = 99: no such node in nodes.csv. Give the id of one. [E202]",
        f"{place}: line 3: start and end are both node 2. Give two different nodes. [E201]",
    ]
    place.unlink()
    with pytest.raises(InputError, match=r"panels.csv: No such file or directory. Paths are relative"):
        roof_from(workshop, LINED, RINGS, TWO_RINGS)


def test_lines_that_cross_or_close_no_face_are_named(workshop):
    """The message names them by the ids of their ends."""
    _, roof, area = lined_roof(workshop, "1,6\n", RINGS, SPOKED)
    assert roof.notes == [] and area.sum() == pytest.approx(36.0)
    with pytest.raises(InputError, match="the line 1 to 6 and the line 2 to 5"):
        lined_roof(workshop, "1,6\n2,5\n", RINGS, SPOKED)
    loose = RINGS + "9,1,3,0,0\n10,0.5,3,0,1\n", SPOKED + "9,10\n"
    _, roof, _ = lined_roof(workshop, "1,9\n", *loose)
    assert any("edges that bound no face: 1 (1 to 9)" in note for note in roof.notes)


def test_lines_are_part_of_the_digest(workshop):
    """A checkpoint with other lines is refused, even if only the table has changed."""
    digests = set()
    for row in ("1,6", "2,5"):
        (workshop.folder / "panels.csv").write_text(f"start,end\n{row}\n")
        job = read_job(workshop.job(LINED, RINGS, SPOKED))
        digests |= {job.digest(), layout_digest(job, build_net(job))}
    assert len(digests) == 4


def test_check_says_how_to_exclude_a_large_face(workshop):
    """A ring of 16 cells of 1 m2 around an opening of 9 m2, more than four times as much."""
    xy = [(x, y) for y in range(6) for x in range(6) if not (1 < x < 4 and 1 < y < 4)]
    number = {place: k for k, place in enumerate(xy)}
    nodes = table("id,x,y,z,fixed", ((k, x, y, 0, int(k == 0)) for k, (x, y) in enumerate(xy)))
    sides = [((x, y), to) for x, y in xy for to in ((x + 1, y), (x, y + 1)) if to in number]
    job = workshop.job(LOADED, nodes, table("start,end", ((number[a], number[b]) for a, b in sides)))
    (line,) = lines_with("largest face", "check", job)
    assert "9 m2 in plan around [2.5, 2.5], the usual one has 1 m2" in line
    key = line.split("leave it out with [roof] ")[1].partition(" [N")[0].replace(" = ", "=")
    output = workshop.check(job, "--set", f"roof.{key}")
    assert "roof: 16.0 m2 of surface" in output and "largest face" not in output


def test_the_point_in_a_large_face_lies_in_the_given_geometry(workshop):
    """Strong cables along x pull the opening of 9 m2 to the right, away from its given place."""
    xy = [(x, y) for y in range(6) for x in range(10) if not (1 < x < 4 and 1 < y < 4)]
    number = {place: k for k, place in enumerate(xy)}
    rows = ((k, x, y, 0, int(x in (0, 9) or y in (0, 5))) for k, (x, y) in enumerate(xy))
    sides = [(a, b) for a in xy for b in ((a[0] + 1, a[1]), (a[0], a[1] + 1)) if b in number]
    q = [60 if a[0] >= 4 and a[1] == b[1] else 1 for a, b in sides]
    elements = table("start,end,force_density", ((number[a], number[b], k) for (a, b), k in zip(sides, q)))
    text = LOADED + '[form_finding]\nmethod = "force_density"\n'
    job = workshop.job(text, table("id,x,y,z,fixed", rows), elements)
    (line,) = lines_with("largest face", "check", job)
    assert "9 m2 in plan around [2.5, 2.5], the usual one has 1 m2" in line


def test_check_suggests_no_openings_for_a_table_of_faces(workshop):
    """A table of faces leaves openings out, and excludes the key."""
    corners = [(0, 1, 2), (0, 2, 3), (3, 2, 4)]
    rows = ((face, node) for face, ring in enumerate(corners) for node in ring)
    (workshop.folder / "faces.csv").write_text(table("face,node", rows))
    xy = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 30)]
    nodes = table("id,x,y,z,fixed", ((k, x, y, 0, int(k != 2)) for k, (x, y) in enumerate(xy)))
    elements = table("start,end", ((k, (k + 1) % 5) for k in range(5)))
    job = workshop.job(LOADED + '[roof]\nfaces = "faces.csv"\n', nodes, elements)
    assert "15.5 m2 of surface" in (output := workshop.check(job)) and "largest face" not in output


def test_a_node_above_or_below_an_element_is_named_with_its_distance(workshop):
    """The foot of an inclined mast, 3 m below a cable, probably belongs to another layer."""
    job = workshop.job(LOADED, RINGS + "9,1,3,-3,1\n", SPOKED + "1,9\n")
    assert "within element" not in workshop.check(job)
    job = workshop.job(LOADED, RINGS + "9,1,1,-3,1\n", SPOKED + "5,9\n")
    (note,) = lines_with("lie within", "check", job)
    assert "9 in element 8 (3 m below)" in note
