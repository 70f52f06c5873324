"""Zones of the roof: the nodes of each zone, the values that apply, and the errors."""

import numpy as np
import pytest
from conftest import STEEL, error_lines
from nets import model_of, table

from netfall.core.errors import InputError
from netfall.geometry.areas import RoofFaces, find_roof, tributary_areas
from netfall.geometry.build import build_net
from netfall.geometry.faces import Faces
from netfall.geometry.zones import make_zones, nodes_named
from netfall.job.read import read_job
from netfall.loads.wind.sectors import read_sectors
from netfall.model.layout import make_layout
from netfall.model.model import make_model

SIDE = 6  # nodes along a side of the flat grid: 5 x 5 cells of 1 m
STILL = "[dynamics]\nduration = 0.01\n"
WIND = "[wind]\nspeed = 20.0\nsurface_drag = 0.0\npressure_coefficient = -1.0\nbase_height = 10.0\n"


def node(x: int, y: int) -> int:
    """Return the row and the id of the node at a position."""
    return SIDE * x + y


def grid(zone=lambda x, y: "") -> tuple[str, str]:
    """Return tables of the flat grid with a fixed rim, and cables along x and y in groups of these names."""
    places = [(x, y) for x in range(SIDE) for y in range(SIDE)]
    rim = (0, SIDE - 1)
    nodes = [f"{node(x, y)},{x},{y},0,{int(x in rim or y in rim)},{zone(x, y)}" for x, y in places]
    elements = [f"{node(x, y)},{node(x + 1, y)},x" for x, y in places if x < SIDE - 1]
    elements += [f"{node(x, y)},{node(x, y + 1)},y" for x, y in places if y < SIDE - 1]
    return "\n".join(["id,x,y,z,fixed,zone", *nodes]), "\n".join(["start,end,group", *elements])


CROSSED_CELL = f"\n{node(1, 1)},{node(2, 2)},y\n{node(1, 2)},{node(2, 1)},y"  # two elements


def square(name: str, x0, y0, x1, y1) -> str:
    """Return an entry that takes the nodes of a rectangle whole."""
    return rectangle(name, x0, y0, x1, y1) + "cut = false\n"


def rectangle(name: str, x0, y0, x1, y1) -> str:
    """Return an entry whose polygon is a rectangle."""
    return f'[[zone]]\nname = "{name}"\npolygon = [[{x0}, {y0}], [{x1}, {y0}], [{x1}, {y1}], [{x0}, {y1}]]\n'


def zones(workshop, text: str, *overrides, column=lambda x, y: ""):
    """Return job, net and zones of a text, on the flat grid."""
    job = read_job(workshop.job(STEEL + text, *grid(column)), list(overrides))
    net = build_net(job)
    return job, net, zones_at(job, net)


def zones_at(job, net=None):
    """Return the zones of a job of a net without faces."""
    net, none = net or build_net(job), Faces()
    return make_zones(job, net, RoofFaces(none, tributary_areas(net.x, net, none)))


def grid_job(workshop, text: str, *overrides):
    """Return a job of a text on the flat grid."""
    return read_job(workshop.job(STEEL + text, *grid()), list(overrides))


def zones_on_faces(workshop, text: str):
    """Return the zones of a text on the faces of the flat grid."""
    job = grid_job(workshop, text)
    net = build_net(job)
    return make_zones(job, net, find_roof(job, net))


def notes_of(workshop, text: str) -> list[str]:
    """Return the notes on the layout of a text on the flat grid."""
    return make_layout(grid_job(workshop, text), 1).notes


def places(net, zoned, name: str) -> set[tuple[float, float]]:
    """Return the positions of a zone's nodes in plan."""
    return {tuple(p) for p in net.x[zoned.of_node == zoned.names.index(name), :2].tolist()}


def lines_of(workshop, text: str, *overrides, column=lambda x, y: "") -> list[str]:
    """Return the errors, without the name of the file."""
    lines = error_lines(zones, workshop, text, *overrides, column=column)
    return [line.removeprefix(f"{workshop.folder / 'job.toml'}: ") for line in lines]


def test_a_polygon_has_the_nodes_inside_and_on_its_border(workshop):
    """A triangle has the nodes of its corners and slope: 6 nodes, also one 1e-9 m outside."""
    text = '[[zone]]\nname = "t"\npolygon = [[1, 1], [2.999999999, 1], [1, 2.999999999]]\ncut = false\n'
    _, net, zoned = zones(workshop, text)
    assert places(net, zoned, "t") == {(1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (1, 3)}
    assert (zoned.of_node == -1).sum() == SIDE**2 - 6


def test_a_polygon_may_be_concave_and_closed(workshop):
    """An L with its first corner repeated at the end."""
    corners = "[[0, 0], [3, 0], [3, 0.5], [0.5, 0.5], [0.5, 2], [0, 2], [0, 0]]"
    _, net, zoned = zones(workshop, f'[[zone]]\nname = "L"\npolygon = {corners}\ncut = false\n')
    assert places(net, zoned, "L") == {(0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (0, 2)}


def test_a_polygon_is_in_metres_for_any_unit_of_the_table(workshop):
    """[net] unit is that of nodes.csv alone."""
    _, _, zoned = zones(workshop, square("a", 0, -0.001, 0.02, 0.001), "net.unit=cm")
    assert (zoned.of_node == 0).sum() == 3


def test_groups_have_the_nodes_of_their_elements(workshop):
    """Each node of the grid is the end of a cable along x. A group of one cable has two nodes."""
    _, _, zoned = zones(workshop, '[[zone]]\nname = "a"\ngroups = ["x"]\n')
    assert (zoned.of_node == 0).all()
    nodes, elements = grid()
    path = workshop.job(STEEL + '[[zone]]\nname = "a"\ngroups = ["ridge"]\n', nodes, elements[:-1] + "ridge")
    zoned = zones_at(read_job(path))
    assert np.flatnonzero(zoned.of_node == 0).tolist() == [node(5, 4), node(5, 5)]


def test_the_column_names_zones_with_and_without_an_entry(workshop):
    column = lambda x, y: {0: "west", 5: "east"}.get(x, "")
    _, net, zoned = zones(workshop, "", column=column)
    assert zoned.names == ["east", "west"]
    assert places(net, zoned, "west") == {(0, y) for y in range(SIDE)}
    _, _, named = zones(workshop, '[[zone]]\nname = "west"\n', column=column)
    assert named.names == ["west", "east"]


def test_a_node_in_several_zones_belongs_to_the_last(workshop):
    """In the order of entries. Zones of the column follow, unless an entry sets their position."""
    both = square("low", 0, 0, 3, 3), square("high", 2, 2, 5, 5)
    for entries, first, last in ((both, "low", "high"), (both[::-1], "high", "low")):
        _, net, zoned = zones(workshop, "".join(entries))
        assert (2, 2) in places(net, zoned, last) and len(places(net, zoned, first)) == 16 - 4
    column = lambda x, y: "own" if (x, y) == (2, 2) else ""
    _, net, zoned = zones(workshop, "".join(both), column=column)
    assert places(net, zoned, "own") == {(2, 2)}
    _, net, zoned = zones(workshop, '[[zone]]\nname = "own"\n' + "".join(both), column=column)
    assert places(net, zoned, "own") == set()
    (line,) = zoned.notes
    assert line.startswith('warning: zone "own": other zones ("low", "high") cover 100% of it.')


SHARED = """id, x, y, z, fixed, zone, zone_share
0, 0, 0, 0, 1, edge/drift, 0.25/0.5
1, 1, 0, 0, 0, drift, 0.5
2, 2, 0, 0, 0, edge,
3, 3, 0, 0, 1, , 
"""
CHAIN = "start, end\n0, 1\n1, 2\n2, 3\n"
OF_DRIFT = "[load]\nself_weight = false\nsnow = 100.0\n[load.zone.drift]\nsnow = 500.0\n"
OF_DRIFT += "[load.zone.edge]\nsnow = 300.0\n"


def test_a_column_gives_shares_of_zones(workshop):
    """The first node has 100 / 4 + 300 / 4 + 500 / 2 by hand; a polygon takes the remaining share.

    The middle of an element has half of its area at either end.
    """
    job = read_job(workshop.job(STEEL + OF_DRIFT, SHARED, CHAIN), ["net.subdivide=2"])
    net = build_net(job)
    zoned = zones_at(job, net)
    assert zoned.names == ["drift", "edge"]
    assert zoned.spread(job.load, "snow").tolist() == [350, 300, 300, 100, 325, 300, 200]
    assert zoned.share[:4, :2].tolist() == [[0.5, 0.25], [0.5, 0], [0, 1], [0, 0]]
    text = STEEL + OF_DRIFT + "[load.zone.rest]\nsnow = 0.0\n" + square("rest", -1, -1, 9, 1)
    text += '[[zone]]\nname = "drift"\n[[zone]]\nname = "edge"\n'
    job = read_job(workshop.job(text, SHARED, CHAIN))
    zoned = zones_at(job)
    assert zoned.names == ["rest", "drift", "edge"]
    assert zoned.spread(job.load, "snow").tolist() == [325, 250, 300, 0]


@pytest.mark.parametrize(
    "zone, share",
    [("edge/drift", "0.25"), ("edge", "1.5"), ("edge/drift", "0.6/0.5"), ("", "0.5"), ("a/a", "0.1/0.1")]
    + [("edge", "much"), ("edge", "0"), ("edge", "nan"), ("edge", "0.2_5")],
)
def test_invalid_shares_are_refused(workshop, zone, share):
    nodes = SHARED.replace("edge/drift, 0.25/0.5", f"{zone}, {share}")
    (line,) = error_lines(build_net, read_job(workshop.job(STEEL, nodes, CHAIN)))
    assert f"line 2: zone_share = '{share}' of zone = '{zone}': expected a share above 0 for each" in line


@pytest.mark.parametrize("name, share", [("a/b", ""), ("..", ""), ("..", "0.5")])
@pytest.mark.parametrize("column", [", zone_share", ""])
def test_a_name_of_a_zone_that_no_entry_could_have_is_refused(workshop, name, share, column):
    """As in [[zone]]; only shares divide a node between several zones."""
    nodes = f"id, x, y, z, fixed, zone{column}\n0, 0, 0, 0, 1, {name}" + f", {share}" * bool(column)
    nodes += "\n1, 1, 0, 0, 1, east" + ", " * bool(column)
    (line,) = error_lines(build_net, read_job(workshop.job(STEEL, nodes + "\n", "start, end\n0, 1\n")))
    assert f"nodes.csv: line 2: zone = '{name}': expected a name without /, other than . and .." in line


def test_shares_and_cuts_exclude_each_other(workshop):
    """A polygon could not cut given shares."""
    job = read_job(workshop.job(STEEL + cut("half", 0, -1, 1.5, 1), SHARED, CHAIN))
    (line,) = error_lines(zones_at, job)
    assert "[[zone]] half: cut = true (the default) and the column zone_share of nodes.csv excl" in line


def test_subdivision_continues_the_zones(workshop):
    """Positions count in a polygon, the nearer end of the element in groups and a column.

    A stage holds nodes in a zone, not those near it.
    """
    halves, thirds = "net.subdivide=2", "net.subdivide=3"
    _, net, zoned = zones(workshop, square("a", 0, 0, 1.5, 0.1), halves)
    assert places(net, zoned, "a") == {(0, 0), (0.5, 0), (1, 0), (1.5, 0)}
    _, net, zoned = zones(workshop, '[[zone]]\nname = "a"\ngroups = ["x"]\n', halves)
    assert (zoned.share[:, 0] == 1.0).all()
    assert nodes_named(net, zoned, "a").sum() == SIDE * (2 * SIDE - 1)
    column = lambda x, y: {0: "a", 1: "b"}.get(y, "") if x < 2 else ""
    for parts, near in ((halves, {0.0, 0.5}), (thirds, {0.0, 1 / 3})):
        _, net, zoned = zones(workshop, "", parts, column=column)
        shares = dict(zip(map(tuple, net.x[:, :2].round(2)), zoned.share[:, :2].tolist()))
        assert shares[0.0, round(max(near), 2)] == ([0.5, 0.5] if parts == halves else [1.0, 0.0])
        assert shares[1.0, 1.0] == [0.0, 1.0] and shares[1.0, 0.0] == [1.0, 0.0]
        inner = 1 if parts == halves else 2
        assert nodes_named(net, zoned, "a").sum() == 2 + inner


ROWS = '[[zone]]\nname = "row"\n'
BY_GROUP = '[[zone]]\nname = "row"\ngroups = ["row"]\n'
ZONES_OF_ROWS = {  # entries, and the area [m2] of "row" and "rest", by hand
    "column": (ROWS, 5.0, 0.0),
    "groups": (BY_GROUP, 5.0, 0.0),
    "before a polygon": (BY_GROUP + rectangle("rest", 0, 1.5, 5, 5), 5.0, 17.5),
    "after a polygon": (rectangle("rest", 0, 1.5, 5, 5) + ROWS, 5.0, 17.5),
    "after a polygon over it": (rectangle("rest", 0, 0, 5, 5) + ROWS, 5.0, 20.0),
    "after an overlapping polygon": (rectangle("rest", 0, 0, 5, 1.5) + BY_GROUP, 5.0, 2.5),
    "before a polygon beside its nodes": (ROWS + rectangle("rest", 0, 0, 5, 0.75), 3.75, 3.75),
    "before an overlapping polygon": (BY_GROUP + rectangle("rest", 0, 0, 5, 1.5), 0.0, 7.5),
}


@pytest.mark.parametrize("parts", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("by", ZONES_OF_ROWS)
@pytest.mark.parametrize("roof", ["", "[roof]\nnormal = [0, 0, 1]\n"])
def test_subdivision_keeps_the_area_of_zones(workshop, by, parts, roof):
    """The row of nodes at y = 1 has 5 m2 of the grid by hand, alone and with a cut polygon beside or over it.

    With `[roof] normal`, a polygon takes its part of a face before a zone that has some corners of it. A
    warning states the part of the row that it takes.
    """
    entries, row, rest = ZONES_OF_ROWS[by]
    if roof and "over" in by:
        row, rest = 0.0, 25.0 if "over it" in by else 7.5
    nodes, elements = grid((lambda x, y: "row" * (y == 1)) if BY_GROUP not in entries else lambda x, y: "")
    lines = elements.splitlines()
    at_row = {f"{node(x, 1)},{node(x + 1, 1)},x" for x in range(SIDE - 1)}
    elements = "\n".join(line[:-1] + "row" if line in at_row else line for line in lines)
    text = "[load]\nself_weight = false\nsteps = 1\ndead = 200.0\n[load.zone.row]\ndead = 900.0\n"
    job = read_job(workshop.job(STEEL + text + entries + roof, nodes, elements), [f"net.subdivide={parts}"])
    model = model_of(job)
    zoned = model.roof.zones
    areas = dict(zip(zoned.names, zoned.share.T @ model.roof.area))
    assert zoned.share.sum(1) == pytest.approx(np.ones(model.net.n), abs=1e-14)
    assert areas["row"] == pytest.approx(row, abs=1e-12)
    covered = [note for note in model.layout.notes if "other zones" in note]
    assert len(covered) == (row < 5.0)
    assert all(f'zone "row": other zones ("rest") cover {1.0 - row / 5.0:.0%} ' in note for note in covered)
    assert areas.get("rest", 0.0) == pytest.approx(rest, abs=1e-12)
    assert model.loading.carried.sum() * 9.81 == pytest.approx(200.0 * 25 + 700.0 * row, rel=1e-13)


@pytest.mark.parametrize("parts", [1, 2, 3, 4])
@pytest.mark.parametrize(
    "given, row, cut, by_hand",  # area of inner nodes at y = 1, y of the row and of the polygon, areas
    [(1.0, 1, 1.5, [17.5, 5.0, 2.5]), (3.0, 0, 0.75, [4.25 * 5 + 4 * 1.5, 2.5, 0.25 * 5 + 4 * 0.5])],
)
def test_subdivision_keeps_zones_beside_given_areas(workshop, given, row, cut, by_hand, parts):
    """A given area covers the nearer halves of middle nodes; polygons cut it as they cut these halves."""
    nodes, elements = grid(lambda x, y: "row" * (y == row))
    inner = {node(x, 1) for x in range(1, SIDE - 1)}
    rows = [f"{line},{given if k in inner else ''}" for k, line in enumerate(nodes.splitlines()[1:])]
    nodes = "\n".join(["id,x,y,z,fixed,zone,area", *rows])
    text = "[load]\nself_weight = false\nsteps = 1\ndead = 200.0\n" + rectangle("rest", 0, cut, 5, 5)
    model = model_of(read_job(workshop.job(STEEL + text, nodes, elements), [f"net.subdivide={parts}"]))
    areas = model.roof.zones.share.T @ model.roof.area
    assert areas == pytest.approx(by_hand, abs=1e-12)


def test_values_of_zones_replace_those_of_the_section(workshop):
    """Values are equal by node and as parts. A zone without a key has the value of the section."""
    text = "[load]\nself_weight = false\n"
    text += "dead = 5.0\n[load.zone.a]\nsnow = 750.0\npressure = [0, 0, -1]\n[load.zone.b]\nsnow = 0.0\n"
    text += square("a", 0, 0, 0.5, 0.5) + square("b", 5, 5, 6, 6)
    job, _, zoned = zones(workshop, text)
    snow = np.zeros(SIDE**2)
    snow[node(0, 0)] = 750.0
    assert zoned.spread(job.load, "snow").tolist() == snow.tolist()
    assert zoned.spread(job.load, "dead").tolist() == [5.0] * SIDE**2
    parts = zoned.parts(job.load, "snow")
    assert [(value, int(nodes.sum())) for value, nodes in parts] == [(0.0, SIDE**2 - 1), (750.0, 1)]
    parts = zoned.parts(job.load, "pressure")
    assert [(value, int(nodes.sum())) for value, nodes in parts] == [(None, SIDE**2 - 1), ([0, 0, -1], 1)]
    assert np.flatnonzero(parts[1][1]).tolist() == [node(0, 0)]
    assert job.loads("pressure") == [None, [0, 0, -1]]


def test_set_reaches_the_values_of_zones(workshop):
    text = STILL + WIND + "[wind.zone.a]\npressure_coefficient = -2.2\n" + square("a", 0, 0, 1, 1)
    job, _, zoned = zones(workshop, text, "wind.zone.a.pressure_coefficient=-2", "load.zone.a.snow=1500")
    assert job.wind.zone_values("pressure_coefficient") == {"a": -2.0}
    assert job.load.zone_values("snow") == {"a": 1500.0}
    assert zoned.spread(job.wind, "pressure_coefficient").tolist().count(-2.0) == 4


def test_a_zone_without_nodes_is_a_warning(workshop):
    _, _, zoned = zones(workshop, square("a", 0, 0, 1, 1) + square("off", 100, 0, 101, 1))
    (line,) = zoned.notes
    assert line.startswith('warning: zone "off": no node lies in it.') and "in m in plan" in line


def test_values_that_a_later_zone_replaces_are_named(workshop):
    """The rim has a pressure coefficient and no snow, so 3 of the 9 nodes lose the drifted snow."""
    both = square("west", 0, 0, 2, 2) + square("rim", 0, -0.1, 9, 0.1)
    drift = 'steps = 1\n[[case]]\nname = "c"\nset = {"load.zone.west.snow" = 900%s}\n'
    wind = "[wind.zone.rim]\npressure_coefficient = 1\n"
    (line,) = zones(workshop, both + STILL + WIND + wind + "[load]\n" + drift % "")[2].notes
    assert 'zone "west": other zones ("rim") cover 33% of it' in line and "(load.snow) do not" in line
    text = both + STILL + WIND + wind + "[load]\n" + drift % ', "load.zone.rim.snow" = 900'
    assert zones(workshop, text)[2].notes == []
    covered = square("inner", 1, 1, 2, 2) + square("all", 0, 0, 9, 9)
    assert 'zone "inner": other zones ("all") cover 100%' in zones(workshop, covered)[2].notes[0]


ZONED = WIND.replace("[wind]\n", "[wind]\ndirection = 0\n") + STILL
ZONED += "[wind.zone.edge]\npressure_coefficient = -2.2\n" + square("edge", 0, 0, 1, 5)
A = '[[zone]]\nname = "a"\n'
C = '[[case]]\nname = "c"\n'
EDGED = square("edge", 0, 0, 1, 1)
TRIANGLE, CROSSED = "polygon = [[0, 0], [1, 0], [1, 1]]\n", "polygon = [[0, 0], [2, 2], [2, 0], [0, 2]]\n"
WRONG = [  # a text, the start of its error and the end
    (A + CROSSED, "[[zone]] a: polygon: Self-intersection[1 1]; expected corners in order", "[E293]"),
    (A + 'groups = ["z"]\n', '[[zone]] a: groups: no element is of group "z"; ', "known: x, y [E216]"),
    (A, "[[zone]] a: polygon or groups: missing", "[E296]"),
    (EDGED + STILL + WIND + "[wind.zone.egde]\n", "[wind.zone.egde]: there", 'mean "edge"? [E297]'),
    ("[load.zone.edge]\nsnow = 1\n", '[load.zone.edge]: there is no zone "edge"; the job has', "[E297]"),
    (
        EDGED + C + "set = {load.zone.edg.snow = 1}\n",
        "[[case]] c: set: load.zone.edg.snow: ",
        '"edge"? [E297]',
    ),
    (A + "polygon = 3\n", "[[zone]] a: polygon = 3: expected a list of three or more [x, y]", "[E126]"),
    ("[[zone]]\n", "[[zone]] 1: name: missing", "[E127]"),
    ('[[zone]]\nname = "a/b"\n', '[[zone]] a/b: name = "a/b": expected a name in quotes', "[E126]"),
    (A + "poligon = 1\n", "[[zone]] a: poligon: unknown key; ", 'mean "polygon"? [E125]'),
    (A * 2, "[[zone]] a: name: entry 1 has this name", "[E132]"),
    (A + 'groups = ["x"]\n' + TRIANGLE, "[[zone]] a: polygon and groups exclude each other", "[E130]"),
    ('[zone]\nname = "a"\n', "zone = {'name': 'a'}: expected entries, [[zone]]", "[E123]"),
    ("[load]\nself_weight = false\nzone = 3\n", "[load] zone = 3: expected tables", "[E122]"),
    ("[load.zone.a]\nsnow = -1\n", "[load.zone.a] snow = -1: ", "a number from 0 to 1e+09 N/m2 [E126]"),
    ("[load.zone.a]\nsteps = 1\n", "[load.zone.a] steps: unknown key; ", "dead, pressure, snow [E125]"),
    (C, "[[case]] c: set, load_table, pressure_table or settlement: missing", "[E162]"),
    (C + "set = {load.snaw = 1}\n", "[[case]] c: set: load.snaw: not a key that", '"load.snow"? [E160]'),
    (C + 'set = {load.zone.a.snow = "x"}\n', '[[case]] c: set: load.zone.a.snow = "x": exp', "N/m2 [E126]"),
    (A + 'groups = ["x"]\ncut = true\n', "[[zone]] a: cut = true: has no effect without pol", "[E131]"),
    (ZONED.replace("pressure_coefficient = -1.0", ""), "[wind] pressure_coefficient: missing", "[E152]"),
]


@pytest.mark.parametrize("text, start, end", WRONG)
def test_a_wrong_entry_is_one_line(workshop, text, start, end):
    """It names the entry, the value and, if one is near, the word that was meant."""
    (line,) = lines_of(workshop, text)
    assert line.startswith(start) and line.endswith(end)


def test_a_zone_has_either_a_column_or_a_polygon(workshop):
    """It would be unclear which applies."""
    (line,) = lines_of(workshop, EDGED, column=lambda x, y: "edge")
    assert line.startswith("[[zone]] edge: the column zone of nodes.csv has") and "[E294]" in line


def test_all_errors_of_zones_come_at_once(workshop):
    text = '[[zone]]\npolygon = 3\n[[zone]]\nname = "a"\ngroups = 1\n[load]\nself_weight = false\nsnow = -1\n'
    assert len(lines_of(workshop, text)) == 4
    text = '[[zone]]\nname = "a"\ngroups = ["z", "w"]\n[load]\nself_weight = false\n[load.zone.b]\nsnow = 1\n'
    assert len(lines_of(workshop, text)) == 3


def test_set_does_not_reach_into_lists(workshop):
    (line,) = lines_of(workshop, EDGED, "zone.edge.polygon=3")
    assert line.startswith("--set zone.edge.polygon=3: zone is a list, [[zone]]") and "[E111]" in line


def test_a_case_sets_loads_and_those_of_zones(workshop):
    text = '[load]\nself_weight = false\nsteps = 2\n[[case]]\nname = "a"\n'
    text += 'set = {"load.snow" = 750, "load.zone.e.pressure" = [0, 0, 1]}\n'
    text += '[[case]]\nname = "b"\nset = {load.snow = 1, load.zone.e.snow = 2}\n' + square("e", 0, 0, 1, 1)
    job, _, _ = zones(workshop, text)
    assert [case.name for case in job.cases] == ["a", "b"]
    assert job.cases[0].set == {"load.snow": 750.0, "load.zone.e.pressure": [0, 0, 1]}
    assert job.cases[1].set == {"load.snow": 1.0, "load.zone.e.snow": 2.0}
    assert job.loads("snow") == [0.0, 750.0, 1.0, 2.0]


# --- what they do to the wind

EDGE = 7.5  # m2: the nodes at x = 0 carry 2 x 0.25 + 4 x 0.5, those at x = 1 twice that
REST = 25.0 - EDGE
SUCTION = 0.5 * 1.25 * 20.0**2  # N/m2; z = 0 is 10 m above ground, where the speed is [wind] speed


def test_wind_acts_with_the_coefficient_of_each_zone(workshop):
    model = model_of(grid_job(workshop, ZONED))
    total = model.wind.sum(0) * 20.0**2
    # rounding of areas
    assert model.roof.area[model.roof.zones.of_node == 0].sum() == pytest.approx(EDGE, rel=1e-14)
    assert total[2] == pytest.approx(SUCTION * (2.2 * EDGE + 1.0 * REST), rel=1e-14)  # and of the sum
    assert (total[:2] == 0).all()


def test_the_result_has_zones_and_mean_pressures_on_any_number_of_ranks(both_ways):
    text = STEEL + ZONED + "[load]\nself_weight = false\n"
    text += "steps = 1\npressure = 3.0\n[load.zone.edge]\npressure = [0, 0, -1]\nsnow = 5\n"
    with both_ways.solve(text, *grid()) as f:
        edge = f["net/zone"][:] == 0
        assert edge.tolist() == [x < 2 for x in range(SIDE) for _ in range(SIDE)]
        assert f["net/zone_names"].asstr()[:].tolist() == ["edge"]
        assert f["wind/shape_coefficient"][:].tolist() == np.where(edge, -2.2, -1.0).tolist()
        pressure = f["wind/mean_pressure"][:]
        # rounding of the profile, (10 / 10)^0.16
        assert pressure == pytest.approx(np.where(edge, -2.2, -1.0) * SUCTION, rel=1e-14)
        assert f["load/snow"][:].tolist() == np.where(edge, 5.0, 0.0).tolist()
        assert np.isnan(f["load/pressure"][edge]).all() and (f["load/pressure"][~edge] == 3.0).all()


def test_the_roof_is_drawn_with_zones_and_pressures(workshop):
    """One panel each for zones, areas, wind, pressure and snow, with ranges in the titles; or only areas."""
    from netfall.post.plots.roof import roof

    titles = lambda f: [axes.get_title() for axes in roof(f).axes if axes.get_title()]
    text = STEEL + ZONED
    text += "[load]\nself_weight = false\npressure = 3.0\n[load.zone.edge]\npressure = [0, 0, -1]\nsnow = 5\n"
    with workshop.solve(text, *grid()) as f:
        legend = [words.get_text() for words in roof(f).axes[0].get_legend().get_texts()]
        assert legend == [f"(none): {REST:g} m2", f"edge: {EDGE:g} m2"]
        assert titles(f) == [
            "zones, with their area of surface",
            "tributary area, of the surface: 0.25 to 1 m2",
            "pressure of the mean wind: -550 to -250 N/m2",
            "static pressure: 3 N/m2, grey: along axes",
            "snow, in plan: 0 to 5 N/m2",
        ]
    with workshop.solve(STEEL, *grid()) as f:
        assert titles(f) == ["tributary area, of the surface: 0.25 to 1 m2"]
        assert "as given" not in roof(f).get_suptitle()
    with workshop.solve(STEEL + "[form_finding]\n", *grid()) as f:
        assert "in plan as given, with the areas of the form" in roof(f).get_suptitle()


def test_mean_pressure_of_a_table_is_that_of_its_mean_speed(workshop):
    """Speeds alternate between 10 and 30 m/s, so the mean is 20 m/s."""
    (workshop.folder / "gust.csv").write_text("time,speed\n0,10\n0.01,30\n")
    text = STEEL + ZONED.replace("speed = 20.0\nsurface_drag = 0.0", 'file = "gust.csv"')
    with workshop.solve(text, *grid()) as f:
        expected = np.where(f["net/zone"][:] == 0, -2.2, -1.0) * SUCTION
        assert f["wind/mean_pressure"][:] == pytest.approx(expected, rel=1e-14)


SECTORS = "direction,pressure_coefficient,Edge\n30,-1,2\n90,-2,2\n350,0.5,-4\n"
BY_SECTORS = ZONED.replace("pressure_coefficient = -1.0", 'sectors = "cp.csv"').split("[wind.zone")[0]
BY_SECTORS += square("Edge", 0, 0, 1, 5)


def sectors_job(workshop, text=BY_SECTORS, table=SECTORS, *overrides):
    (workshop.folder / "cp.csv").write_text(table)
    return grid_job(workshop, text, *overrides)


@pytest.mark.parametrize(
    "direction, roof, edge",
    [
        (30.0, -1.0, 2.0),
        (60.0, -1.5, 2.0),  # half way
        (-300.0, -1.5, 2.0),  # the same direction
        (220.0, -0.75, -1.0),  # half way from 90 to 350
        (350.0, 0.5, -4.0),
        (10.0, -0.25, -1.0),  # half way from 350 to 390
        (0.0, 0.125, -2.5),  # a quarter of it
        (360.0, 0.125, -2.5),
    ],
)
def test_sectors_are_linear_in_the_direction(workshop, direction, roof, edge):
    """The roof and a zone with a column agree with hand calculations, also across 360 degrees."""
    model = model_of(sectors_job(workshop, BY_SECTORS, SECTORS, f"wind.direction={direction}"))
    expected = np.where(model.roof.zones.of_node == 0, edge, roof)
    assert model.layout.pressure_coefficient == pytest.approx(expected, abs=1e-15)  # rounding near 1


def test_a_zone_without_a_column_has_its_own_value_or_that_of_the_roof(workshop):
    table = "direction,pressure_coefficient\n0,-1\n180,-2\n"
    job = sectors_job(workshop, BY_SECTORS, table, "wind.direction=90")
    assert make_layout(job, 1).pressure_coefficient.tolist() == [-1.5] * SIDE**2
    job = sectors_job(workshop, BY_SECTORS, table, "wind.zone.Edge.pressure_coefficient=-3")
    assert sorted(set(make_layout(job, 1).pressure_coefficient)) == [-3.0, -1.0]


@pytest.mark.parametrize(
    "old, new, line",
    [
        ("350", "80", "line 4: direction = 80: not above the row before (90)"),
        ("350", "360", "line 4: direction = '360': expected a number of degrees >= 0 and < 360"),
        ("350", "north", "line 4: direction = 'north': expected a number in degrees"),
        (",2\n90", ",\n90", "line 2: edge is empty; expected a number"),
        ("Edge", "rim", "line 1: 'rim': unknown column; known: direction, edge, pressure_"),
        ("Edge", "egde", "line 1: 'egde': unknown column; did you mean \"edge\"?"),
        (SECTORS, "direction,edge\n0,1\n", "column pressure_coefficient is missing; expected direction, pre"),
    ],
)
def test_a_wrong_table_of_sectors_is_one_line(workshop, old, new, line):
    job = sectors_job(workshop, BY_SECTORS, SECTORS.replace(old, new))
    assert error_lines(make_layout, job, 1)[0].startswith(f"{workshop.folder / 'cp.csv'}: {line}")


def test_a_coefficient_is_given_once(workshop):
    with pytest.raises(InputError, match="pressure_coefficient and sectors exclude each other"):
        sectors_job(workshop, BY_SECTORS, SECTORS, "wind.pressure_coefficient=-1")
    both = sectors_job(workshop, BY_SECTORS, SECTORS, "wind.zone.Edge.pressure_coefficient=-3")
    with pytest.raises(InputError, match=r"column edge and \[wind.zone.Edge\] pressure_coefficient exclude"):
        read_sectors(both, ["Edge"])


def test_zones_and_directions_without_effect_are_notes(workshop):
    idle = 'note: zone "{}": no effect: neither [wind] nor [load] nor a case has a value for it. [N459]'
    follow = "note: [wind] direction = 0 (from 180 degrees): the pressure coefficients do not depend on it. "
    follow += "For coefficients by direction give a table, sectors. [N457]"
    notes = notes_of(workshop, ZONED + square("b", 4, 4, 5, 5))
    assert idle.format("b") in notes and idle.format("edge") not in notes and follow in notes
    notes = make_layout(sectors_job(workshop), 1).notes
    assert idle.format("Edge") not in notes and follow not in notes
    # the wind and the case read the same table, whose note is given once
    more = BY_SECTORS + '[[case]]\nname = "w"\nset = {wind.direction = 90}\n'
    remarks = "direction,pressure_coefficient,rim\n30,-1,a\n90,-2,b\n350,0.5,\n"
    notes = make_layout(sectors_job(workshop, more, remarks), 1).notes
    left = 'unknown columns, which netfall ignores: "rim"; known: direction, pressure_coefficient, edge'
    assert idle.format("Edge") in notes
    assert notes.count(f"note: {workshop.folder / 'cp.csv'}: {left}. [N184]") == 1


def test_a_zone_without_roof_area_is_a_warning(workshop):
    """All four faces around its only node are openings. With one of them it carries a quarter."""
    text = "[load]\nself_weight = false\ndead = 1.0\n[load.zone.a]\nsnow = 2.0\n"
    text += square("a", 0.9, 0.9, 1.1, 1.1)
    bare = 'warning: zone "a": no effect: its nodes have no roof area, on which its values act. '
    around = [[x + 0.5, y + 0.5] for x in (0, 1) for y in (0, 1)]
    for openings, warns in ((around, True), (around[1:], False)):
        notes = model_of(grid_job(workshop, f"{text}[roof]\nopenings = {openings}\n")).start_notes
        assert any(note.startswith(bare) for note in notes) == warns


def test_loads_of_a_zone_alone_need_areas_and_normals(workshop):
    """A zone has the only pressure, or the only coefficient that is not 0."""
    text = "[load]\nself_weight = false\nsteps = 1\n[load.zone.a]\npressure = 2.0\n" + square("a", 1, 1, 2, 2)
    nodes, elements = grid()
    with pytest.raises(InputError, match="cross in plan without a node"):
        make_layout(read_job(workshop.job(STEEL + text, nodes, elements + CROSSED_CELL)), 1)
    zero = ZONED.replace("pressure_coefficient = -1.0", "pressure_coefficient = 0.0")
    assert not any("pressure_coefficient = 0" in note for note in notes_of(workshop, zero))


# --- polygons that cut


def cut(name: str, x0, y0, x1, y1) -> str:
    """Return a rectangle that cuts the areas of nodes."""
    return rectangle(name, x0, y0, x1, y1) + "cut = true\n"


SNOW = "[load]\nself_weight = false\nsteps = 1\n[load.zone.half]\nsnow = 100.0\n"


def test_snow_on_half_of_a_roof_is_half_of_the_load(workshop):
    """Whole nodes give 12.5 m2 to x = 2.5 and x = 2; cut zones (default) 12.5 and 10 m2, with a note."""
    loads = {}
    for edge in (2.5, 2.0):
        for shape in (square, cut, rectangle):
            model = model_of(grid_job(workshop, SNOW + shape("half", 0, 0, edge, 5)))
            loads[edge, shape] = -model.loading.live.sum(0)[2]
            notes = [note for note in model.layout.notes if "cut = true" in note]
            fact = "of its 12.5 m2 in plan 2.5 m2 (20.0%) lie outside its polygon; 0 m2 inside do not belong"
            assert [fact in note for note in notes] == ([True] if (edge, shape) == (2.0, square) else [])
    check = workshop.check(workshop.job(STEEL + SNOW + rectangle("half", 0, 0, 2.0, 5), *grid()))
    assert "\nzones, of surface and in plan: half 10.0 and 10.0 m2\n" in check
    assert loads == {
        (edge, shape): 1000.0 if edge == 2.0 and shape != square else 1250.0 for edge, shape in loads
    }
    mixed = model.roof.zones.mixed
    assert mixed.tolist() == [node(2, y) for y in range(SIDE)]
    assert model.roof.zones.of_node.tolist() == [0 if x < 3 else -1 for x in range(SIDE) for _ in range(SIDE)]
    assert (model.loading.live[mixed, 2] == -50.0 * model.roof.plan_area[mixed]).all()


@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("slope", [0.0, 0.75])
def test_a_concave_polygon_cuts_faces_of_any_corners(workshop, parts, slope):
    """An L at an angle, its area by the shoelace formula; inclined faces of 4, 8 and 12 corners."""
    corners = np.array([[0.3, 0.4], [4.1, 0.9], [3.9, 2.2], [2.2, 1.8], [1.7, 4.6], [0.6, 4.2]])
    area = 0.5 * sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(corners, np.roll(corners, -1, axis=0)))
    text = SNOW + f'[[zone]]\nname = "half"\npolygon = {corners.tolist()}\ncut = true\n'
    nodes, elements = grid()
    raised = (row.split(",") for row in nodes.splitlines()[1:])
    nodes = table("id,x,y,z,fixed,zone", ((i, x, y, slope * float(x), f, z) for i, x, y, _, f, z in raised))
    model = model_of(read_job(workshop.job(STEEL + text, nodes, elements), [f"net.subdivide={parts}"]))
    # sums of hundreds of pieces
    assert -model.loading.live[:, 2].sum() == pytest.approx(100.0 * area, rel=1e-12)


def test_the_order_of_the_tables_does_not_matter_to_cuts_of_warped_faces(workshop):
    """A steep hyperbolic paraboloid in faces of 8 corners that a polygon cuts, 24 m2 in plan, in any order.

    Cells are bisected in an inclined plane that the corners do not lie in, so that their area is not exact.
    """
    zone = '[[zone]]\nname = "half"\ncut = true\npolygon = [[0, 0], [3, 0], [3, 8], [0, 8]]\n'
    places = [(x, y) for x in range(3) for y in range(3)]
    nodes = [(3 * x + y, 4 * x, 4 * y, 2 * (x - 1) * (y - 1) + 2.8 * x, 1) for x, y in places]
    elements = [(3 * x + y, 3 * x + y + 3) for x, y in places if x < 2]
    elements += [(3 * x + y, 3 * x + y + 1) for x, y in places if y < 2]
    snow, rng = [], np.random.default_rng(1)
    for _ in range(6):
        points = table("id,x,y,z,fixed", (nodes[k] for k in rng.permutation(9)))
        tables = points, table("start,end", (elements[k] for k in rng.permutation(12)))
        model = model_of(read_job(workshop.job(STEEL + SNOW + zone, *tables), ["net.subdivide=2"]))
        snow.append(-model.loading.live[:, 2].sum())
    assert snow == pytest.approx([snow[0]] * 6, rel=1e-12) and snow[0] == pytest.approx(2400.0, rel=0.02)


def test_the_overlap_of_cut_zones_belongs_to_the_last(workshop):
    """A row of nodes at x = 2, 1.5 to 2.5 m: a has x < 2, b all from 1.75 m on; one zone is not cut."""
    text = cut("a", 0, 0, 2, 5) + cut("b", 1.75, 0, 5, 5)
    zoned = zones_on_faces(workshop, text)
    row = [node(2, y) for y in range(SIDE)]
    assert zoned.share[row] == pytest.approx(np.tile([0.25, 0.75, 0.0], (SIDE, 1)), abs=1e-14)
    assert (zoned.of_node[row] == 1).all() and (zoned.share[:, :2].sum(1) == 1.0).all()
    text = cut("a", 0, 0, 2, 5) + square("whole", 1.9, 0, 2.1, 2) + cut("b", 1.75, 0, 5, 1)
    shares = zones_on_faces(workshop, text).share[row, :3]
    # at y = 0 and 1: b over the whole; at 1 it ends in the middle of the node; 2 belongs to the zone whole
    expected = [[0, 0.25, 0.75], [0, 0.625, 0.375], [0, 1, 0], [0.5, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]
    assert shares == pytest.approx(np.array(expected), abs=1e-14)


@pytest.mark.parametrize("first, share", [("west", 20), ("rim", 40)])  # 2 m2 of 10 and of 5
def test_the_overlap_of_cut_zones_is_stated_as_area(workshop, first, share):
    """Counted by whole nodes it would be 30 % and 50 %."""
    text = {"west": cut("west", 0, 0, 2, 5), "rim": cut("rim", 0, 0, 5, 1)}
    text = text.pop(first) + text.popitem()[1] + f"[load]\nsteps = 1\n[load.zone.{first}]\nsnow = 900\n"
    (line,) = zones_on_faces(workshop, text).notes
    assert f"cover {share}% of it" in line


def test_values_of_cut_zones_are_means_by_area(workshop):
    """Wind, pressure as a number and along axes, and dead load, also in the result: half at x = 2."""
    text = ZONED.replace(square("edge", 0, 0, 1, 5), cut("edge", 0, 0, 2, 5))
    text += "[load]\nself_weight = false\nsteps = 1\npressure = 3.0\ndead = 8.0\n[load.zone.edge]\n"
    text += "pressure = [0, 0, -1]\nsnow = 5\n"
    job = workshop.job(STEEL + text, *grid())
    model = model_of(read_job(job))
    assert (model.wind.sum(0) * 20.0**2)[2] == pytest.approx(SUCTION * (2.2 * 10 + 1.0 * 15), rel=1e-14)
    assert model.loading.live.sum(0)[2] == pytest.approx(-(10 * 1.0 + 15 * 3.0 + 10 * 5.0), rel=1e-14)
    assert model.loading.carried.sum() == pytest.approx((25 * 8.0 + 10 * 5.0) / 9.81, rel=1e-14)
    with workshop.run(job) as f:
        x = f["net/particles"][:, 0]
        share = np.select([x < 2, x == 2], [1.0, 0.5], 0.0)
        assert f["net/zone_share"][:, 0] == pytest.approx(share, abs=1e-14)
        assert f["wind/shape_coefficient"][:] == pytest.approx(-1.0 - 1.2 * share, rel=1e-14)
        assert f["load/snow"][:] == pytest.approx(5.0 * share, rel=1e-14)
        pressure = f["load/pressure"][:]
        assert np.isnan(pressure[x <= 2]).all() and (pressure[x > 2] == 3.0).all()


def test_loads_of_cut_zones_act_on_the_areas_of_the_form(workshop):
    """The zone has the faces on one side of x = 2: 10 m2, which the form makes twice as wide."""
    text = "[load]\nself_weight = false\n[load.zone.edge]\ndead = 98.1\nadded_mass = 10.0\n" + STILL
    job = grid_job(workshop, text + cut("edge", 0, 0, 2, 5))
    layout = make_layout(job, 1)
    x = layout.net.x.copy()
    x[:, 0] = np.minimum(x[:, 0], 2.0 * x[:, 0] - 2.0)
    model = make_model(job, layout, x, None)
    assert [model.loading.carried.sum(), model.air_mass.sum()] == pytest.approx([200.0, 200.0], rel=1e-12)


@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("given", [0, 1, 2, 15])
@pytest.mark.parametrize("roof", ["", "[roof]\nnormal = [0, 0, 1]\n"])
def test_zones_that_meet_at_a_fold_keep_the_directions_of_their_faces(workshop, roof, given, parts):
    """A roof of 8 x 4 m with a slope of 0.5: a vertical area of 2 x 4 m on each side, at +1 and -1 kN/m2.

    Also if nodes.csv gives areas of nodes, and a normal. A node without a face then has 3 m2.
    """
    places = [(x, y) for x in range(0, 9, 2) for y in range(0, 5, 2)]
    area = {p: 5.0**0.5 * (1 + (0 < p[0] < 8)) * (1 + (0 < p[1] < 4)) / 2 for p in places[:given]}
    normal = dict.fromkeys(places[1:given:15], f"{-(0.2**0.5)},0,{0.8**0.5}")
    rows = [f"{10 * x + y},{x},{y},{0.5 * (4 - abs(x - 4))},{int(x in (0, 8))}" for x, y in places]
    rows = [f"{row},{area.get(p, '')},{normal.get(p, ',,')}" for row, p in zip(rows, places)]
    rows.append(f"99,-2,0,0,1,{3 if given else ''},0,0,1")
    head = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z"
    lines = [f"{10 * x + y},{10 * x + y + 20},x" for x, y in places if x < 8]
    lines += ["99,0,x", *(f"{10 * x + y},{10 * x + y + 2},y" for x, y in places if y < 4)]
    tables = "\n".join([head, *rows]), "\n".join(["start,end,group", *lines])
    zones = rectangle("left", -2, 0, 4, 4) + rectangle("right", 4, 0, 8, 4)
    pressures = "[load.zone.left]\npressure = 1000.0\n[load.zone.right]\npressure = -1000.0\n"
    wind = "[wind.zone.left]\npressure_coefficient = 1.0\n[wind.zone.right]\npressure_coefficient = -1.0\n"
    text = STEEL + STILL + "[load]\nself_weight = false\nsteps = 1\n" + pressures + WIND + wind + zones + roof
    model = model_of(read_job(workshop.job(text, *tables), [f"net.subdivide={parts}"]))
    expected = np.array([16.0, 0.0, -3.0 * (given > 0)])
    assert model.loading.live.sum(0) == pytest.approx(1e3 * expected, abs=1e-9)
    assert model.wind.sum(0) / (0.5 * 1.25) == pytest.approx(expected, abs=1e-12)


def test_a_cut_without_faces_has_no_effect(workshop):
    nodes, elements = grid()
    first, *rows = nodes.splitlines()
    tables = "\n".join([first + ",area", *(row + ",1.0" for row in rows)]), elements + CROSSED_CELL
    model = model_of(read_job(workshop.job(STEEL + SNOW + cut("half", 0, 0, 2, 5), *tables)))
    assert 'note: zone "half": cut: no effect: the net has no faces. [N200]' in model.layout.notes
    assert model.loading.live[:, 2].sum() == -100.0 * 3 * SIDE


def test_panels_have_the_loads_of_cut_zones(workshop):
    """All panels at a node together carry the node's wind, pressure and mass."""
    text = ZONED.replace(square("edge", 0, 0, 1, 5), cut("edge", 0, 0, 2.3, 5))
    text = text.replace("[wind]\n", '[wind]\nafter_fracture = "panels"\n')
    text += "[load]\nself_weight = false\npressure = 3.0\ndead = 8.0\n[load.zone.edge]\n"
    text += "pressure = [0, 2, -1]\nsnow = 5\n"
    model = model_of(grid_job(workshop, text))
    panels, loading = model.panels, model.loading
    at_nodes = lambda values: np.bincount(panels.node, values, model.net.n)
    assert at_nodes(panels.mass) == pytest.approx(model.loading.carried, rel=1e-13)
    for axis in range(3):
        expected = loading.live[:, axis] + (9.81 * loading.carried - 8.0 * model.roof.area) * (axis == 2)
        assert at_nodes(panels.pressure[:, axis]) == pytest.approx(expected, rel=1e-12, abs=1e-12)
        assert at_nodes(panels.wind[:, axis]) == pytest.approx(model.wind[:, axis], rel=1e-13, abs=1e-14)
