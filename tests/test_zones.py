"""Zones of the roof: which nodes belong to which, what holds there, and what is answered to mistakes."""

import numpy as np
import pytest
from conftest import ROOT, STEEL

from netfall.errors import InputError
from netfall.job.read import read_job
from netfall.job.schema import LISTS
from netfall.net.build import build_net
from netfall.net.zones import zones_of

SIDE = 6  # nodes along a side of the flat grid: 5 x 5 cells of 1 m
STILL = "[dynamics]\nduration = 0.01\n"
WIND = "[wind]\nspeed = 20.0\nroughness = 0.0\nshape_coefficient = -1.0\n"


def node(x: int, y: int) -> int:
    """Row, and id, of the node at a place."""
    return SIDE * x + y


def grid(zone=lambda x, y: "") -> tuple[str, str]:
    """Tables of the flat grid, its rim fixed, its cables along x and y in groups of these names."""
    places = [(x, y) for x in range(SIDE) for y in range(SIDE)]
    rim = (0, SIDE - 1)
    nodes = [f"{node(x, y)},{x},{y},0,{int(x in rim or y in rim)},{zone(x, y)}" for x, y in places]
    elements = [f"{node(x, y)},{node(x + 1, y)},x" for x, y in places if x < SIDE - 1]
    elements += [f"{node(x, y)},{node(x, y + 1)},y" for x, y in places if y < SIDE - 1]
    return "\n".join(["id,x,y,z,fixed,zone", *nodes]), "\n".join(["start,end,group", *elements])


def square(name: str, x0, y0, x1, y1) -> str:
    """An entry for the nodes of a rectangle."""
    return f'[[zone]]\nname = "{name}"\npolygon = [[{x0}, {y0}], [{x1}, {y0}], [{x1}, {y1}], [{x0}, {y1}]]\n'


def zones(workshop, text: str, *overrides, column=lambda x, y: ""):
    """Job, net and zones of a text, on the flat grid."""
    job = read_job(workshop.job(STEEL + text, *grid(column)), list(overrides))
    net = build_net(job)
    return job, net, zones_of(job, net)


def places(net, found, name: str) -> set[tuple[float, float]]:
    """Where the nodes of a zone are, in plan."""
    return {tuple(p) for p in net.x[found.of_node == found.names.index(name), :2].tolist()}


def lines_of(workshop, text: str, *overrides, column=lambda x, y: "") -> list[str]:
    """The errors, without the name of the file."""
    with pytest.raises(InputError) as raised:
        zones(workshop, text, *overrides, column=column)
    return [line.removeprefix(f"{workshop.folder / 'job.toml'}: ") for line in raised.value.lines]


def test_a_polygon_has_the_nodes_inside_and_on_its_border(workshop):
    """Of a triangle the corners and the slope too: 6 nodes; what is 1e-9 m outside lies on it."""
    text = '[[zone]]\nname = "t"\npolygon = [[1, 1], [2.999999999, 1], [1, 2.999999999]]\n'
    _, net, found = zones(workshop, text)
    assert places(net, found, "t") == {(1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (1, 3)}
    assert (found.of_node == -1).sum() == SIDE**2 - 6


def test_a_polygon_may_be_concave_and_closed(workshop):
    """An L, its first corner given again at the end."""
    corners = "[[0, 0], [3, 0], [3, 0.5], [0.5, 0.5], [0.5, 2], [0, 2], [0, 0]]"
    _, net, found = zones(workshop, f'[[zone]]\nname = "L"\npolygon = {corners}\n')
    assert places(net, found, "L") == {(0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (0, 2)}


def test_a_polygon_is_in_metres_whatever_the_table(workshop):
    """[net] unit is that of nodes.csv alone."""
    path = workshop.job(STEEL, *grid())
    path.write_text(path.read_text().replace("[net]\n", '[net]\nunit = "cm"\n') + square("a", 0, 0, 0.02, 0))
    path.write_text(path.read_text().replace("[0.02, 0]", "[0.02, 0.001]", 1))
    job = read_job(path, [])
    net = build_net(job)
    assert (zones_of(job, net).of_node == 0).sum() == 3


def test_groups_have_the_nodes_of_their_elements(workshop):
    """Each node of the grid is an end of a cable along x; of a group of one cable, its two ends."""
    _, _, found = zones(workshop, '[[zone]]\nname = "a"\ngroups = ["x"]\n')
    assert (found.of_node == 0).all()
    nodes, elements = grid()
    path = workshop.job(STEEL + '[[zone]]\nname = "a"\ngroups = ["ridge"]\n', nodes, elements[:-1] + "ridge")
    job = read_job(path, [])
    found = zones_of(job, build_net(job))
    assert np.flatnonzero(found.of_node == 0).tolist() == [node(5, 4), node(5, 5)]


def test_the_column_names_zones_with_and_without_an_entry(workshop):
    """By themselves, or at the place of an entry with the name alone."""
    column = lambda x, y: {0: "west", 5: "east"}.get(x, "")
    _, net, found = zones(workshop, "", column=column)
    assert found.names == ["east", "west"]
    assert places(net, found, "west") == {(0, y) for y in range(SIDE)}
    _, _, named = zones(workshop, '[[zone]]\nname = "west"\n', column=column)
    assert named.names == ["west", "east"]


def test_of_several_zones_a_node_belongs_to_the_last(workshop):
    """In the order of the entries; zones of the column after all others, unless an entry says where."""
    both = square("low", 0, 0, 3, 3), square("high", 2, 2, 5, 5)
    _, net, found = zones(workshop, "".join(both))
    assert (2, 2) in places(net, found, "high") and len(places(net, found, "low")) == 16 - 4
    _, net, found = zones(workshop, "".join(both[::-1]))
    assert (2, 2) in places(net, found, "low") and len(places(net, found, "high")) == 16 - 4
    column = lambda x, y: "own" if (x, y) == (2, 2) else ""
    _, net, found = zones(workshop, "".join(both), column=column)
    assert places(net, found, "own") == {(2, 2)}
    _, net, found = zones(workshop, '[[zone]]\nname = "own"\n' + "".join(both), column=column)
    assert places(net, found, "own") == set()
    assert found.notes == [
        "[[zone]] own: all of its nodes lie in zones after it too, and belong to these",
    ]


def test_subdivision_continues_the_zones(workshop):
    """By place in a polygon, by element in groups, in the column where both ends are in the zone."""
    halves = "net.subdivide=2"
    _, net, found = zones(workshop, square("a", 0, 0, 1.5, 0.1), halves)
    assert places(net, found, "a") == {(0, 0), (0.5, 0), (1, 0), (1.5, 0)}
    _, net, found = zones(workshop, '[[zone]]\nname = "a"\ngroups = ["x"]\n', halves)
    half = {(x / 2, float(y)) for x in range(2 * SIDE - 1) for y in range(SIDE)}
    assert places(net, found, "a") == half
    column = lambda x, y: {0: "a", 1: "b"}.get(y, "") if x < 2 else ""
    _, net, found = zones(workshop, "", halves, column=column)
    assert places(net, found, "a") == {(0, 0), (0.5, 0), (1, 0)}
    assert places(net, found, "b") == {(0, 1), (0.5, 1), (1, 1)}


def test_values_of_zones_stand_in_for_those_of_the_section(workshop):
    """By node, and as parts with the same value; a zone that says nothing of a key has the section's."""
    text = (
        "[load]\ndead = 5.0\n[load.zone.a]\nsnow = 750.0\npressure = [0, 0, -1]\n[load.zone.b]\nsnow = 0.0\n"
        + square("a", 0, 0, 0.5, 0.5)
        + square("b", 5, 5, 6, 6)
    )
    job, _, found = zones(workshop, text)
    snow = np.zeros(SIDE**2)
    snow[node(0, 0)] = 750.0
    assert found.spread(job.load, "snow").tolist() == snow.tolist()
    assert found.spread(job.load, "dead").tolist() == [5.0] * SIDE**2
    parts = found.parts(job.load, "snow")
    assert [(value, int(nodes.sum())) for value, nodes in parts] == [(0.0, SIDE**2 - 1), (750.0, 1)]
    parts = found.parts(job.load, "pressure")
    assert [(value, int(nodes.sum())) for value, nodes in parts] == [(None, SIDE**2 - 1), ([0, 0, -1], 1)]
    assert np.flatnonzero(parts[1][1]).tolist() == [node(0, 0)]
    assert job.loads("pressure") == [None, [0, 0, -1]]


def test_set_reaches_the_values_of_zones(workshop):
    """Those that the file has and those that it has not."""
    text = STILL + WIND + "[wind.zone.a]\nshape_coefficient = -2.2\n" + square("a", 0, 0, 1, 1)
    job, _, found = zones(workshop, text, "wind.zone.a.shape_coefficient=-2", "load.zone.a.snow=1500")
    assert job.wind.zone == {"a": {"shape_coefficient": -2.0}} and job.load.zone == {"a": {"snow": 1500.0}}
    assert found.spread(job.wind, "shape_coefficient").tolist().count(-2.0) == 4


def test_zones_are_part_of_the_digest(workshop):
    """A corner that moves, and a value of a zone, make another job."""
    text = "[load]\n[load.zone.a]\nsnow = 750.0\n" + square("a", 0, 0, 1, 1)
    digests = {
        zones(workshop, *case)[0].digest()
        for case in ((text,), (text.replace("[1, 1]", "[1, 1.1]"),), (text, "load.zone.a.snow=751"))
    }
    assert len(digests) == 3


def test_a_zone_without_nodes_is_told(workshop):
    """A polygon beside the roof."""
    _, _, found = zones(workshop, square("a", 0, 0, 1, 1) + square("off", 100, 0, 101, 1))
    assert found.notes == ["[[zone]] off: no node lies in it; the polygon is in metres, in plan"]


@pytest.mark.parametrize(
    "text, line",
    [
        (
            '[[zone]]\nname = "a"\npolygon = [[0, 0], [2, 2], [2, 0], [0, 2]]\n',
            "[[zone]] a: polygon: Self-intersection[1 1]; expected corners in order around an area, "
            "without sides that cross",
        ),
        (
            '[[zone]]\nname = "a"\ngroups = ["z"]\n',
            '[[zone]] a: groups: no element is of group "z"; known: x, y',
        ),
        (
            '[[zone]]\nname = "a"\n',
            "[[zone]] a: polygon or groups: missing; a name alone is for a zone of the column zone of "
            "nodes.csv, which does not have it",
        ),
        (
            square("edge", 0, 0, 1, 1) + STILL + WIND + "[wind.zone.egde]\nshape_coefficient = 1\n",
            '[wind.zone.egde]: there is no zone "egde"; did you mean "edge"?',
        ),
        (
            "[load]\n[load.zone.edge]\nsnow = 1\n",
            '[load.zone.edge]: there is no zone "edge"; the job has none: give a [[zone]], or the column '
            "zone in nodes.csv",
        ),
        (
            square("edge", 0, 0, 1, 1)
            + '[load]\nsteps = 1\n[[case]]\nname = "c"\nset = {"load.zone.edges.snow" = 1}\n',
            '[[case]] c: set: load.zone.edges.snow: there is no zone "edges"; did you mean "edge"?',
        ),
    ],
)
def test_zones_that_there_are_not_are_refused(workshop, text, line):
    """One line: the place, what is wrong, the nearest name."""
    assert lines_of(workshop, text) == [line]


def test_a_zone_of_the_column_has_no_polygon_too(workshop):
    """Which of the two would hold is not to be guessed."""
    lines = lines_of(workshop, square("a", 0, 0, 1, 1), column=lambda x, y: "a")
    assert lines == [
        "[[zone]] a: the column zone of nodes.csv has nodes of it already; give the name alone",
    ]


@pytest.mark.parametrize(
    "text, line",
    [
        (
            "[[zone]]\npolygon = 3\n",
            "[[zone]] 1: polygon = 3: expected a list of three or more [x, y] corners of m",
        ),
        ("[[zone]]\n", "[[zone]] 1: name: missing; expected a name in quotes, without / "),
        ('[[zone]]\nname = "a/b"\n', '[[zone]] a/b: name = "a/b": expected a name in quotes, without / '),
        ('[[zone]]\nname = "a"\npoligon = 1\n', '[[zone]] a: poligon: unknown key; did you mean "polygon"?'),
        ('[[zone]]\nname = "a"\n' * 2, "[[zone]] a: name: stands in entry 1 already; names are unique"),
        (
            '[[zone]]\nname = "a"\ngroups = ["x"]\npolygon = [[0, 0], [1, 0], [1, 1]]\n',
            "[[zone]] a: polygon and groups exclude each other; keep one of the two",
        ),
        ('[zone]\nname = "a"\n', "zone = {'name': 'a'}: expected entries, [[zone]], each with its keys"),
        ("[load]\nzone = 3\n", "[load] zone = 3: expected tables, [load.zone.NAME]"),
        ("[load.zone.a]\nsnow = -1\n", "[load.zone.a] snow = -1: expected a number of N/m2 >= 0"),
        ("[load.zone.a]\nsteps = 1\n", "[load.zone.a] steps: unknown key; known: dead, pressure, snow"),
        ('[[case]]\nname = "c"\n', "[[case]] c: set: missing; expected a table of loads"),
        (
            '[[case]]\nname = "c"\nset = {"load.dead" = 1}\n',
            '[[case]] c: set: load.dead: not what a case can set; did you mean "load.snow"?',
        ),
        (
            '[[case]]\nname = "c"\nset = {"load.zone.a.snow" = "deep"}\n',
            '[[case]] c: set: load.zone.a.snow = "deep": expected a number of N/m2 >= 0',
        ),
        (
            '[[case]]\nname = "c"\nset = {}\n',
            "[[case]] there is no static stage that the cases could be part of",
        ),
    ],
)
def test_a_wrong_entry_is_one_line(workshop, text, line):
    """The entry by its name, or its number where it has none, and what is allowed."""
    lines = lines_of(workshop, text)
    assert any(error.startswith(line) for error in lines), lines


def test_all_errors_of_zones_come_at_once(workshop):
    """Of the job file, then of the zones with the net."""
    text = '[[zone]]\npolygon = 3\n[[zone]]\nname = "a"\ngroups = 1\n[load]\nsnow = -1\n'
    assert len(lines_of(workshop, text)) == 4
    text = '[[zone]]\nname = "a"\ngroups = ["z", "w"]\n[load]\n[load.zone.b]\nsnow = 1\n'
    assert len(lines_of(workshop, text)) == 3


def test_set_does_not_reach_into_lists(workshop):
    """It says so."""
    lines = lines_of(workshop, square("a", 0, 0, 1, 1), "zone.a.polygon=3")
    assert lines == [
        "--set zone.a.polygon=3: zone is a list, [[zone]], which --set does not reach, not a section"
    ]


def test_a_case_sets_loads_and_those_of_zones(workshop):
    """Names with dots in quotes or without, numbers as the schema has them."""
    text = '[load]\nsteps = 2\n[[case]]\nname = "a"\n'
    text += 'set = {"load.snow" = 750, "load.zone.e.pressure" = [0, 0, 1]}\n'
    text += '[[case]]\nname = "b"\nset = {load.snow = 1, load.zone.e.snow = 2}\n' + square("e", 0, 0, 1, 1)
    job, _, _ = zones(workshop, text)
    assert [case.name for case in job.cases] == ["a", "b"]
    assert job.cases[0].set == {"load.snow": 750.0, "load.zone.e.pressure": [0, 0, 1]}
    assert job.cases[1].set == {"load.snow": 1.0, "load.zone.e.snow": 2.0}
    assert job.loads("snow") == [0.0, 750.0, 1.0, 2.0]


def test_readme_lists_the_keys_of_every_list():
    """The tables of jobs/README.md are those of the schema."""
    text = (ROOT / "jobs" / "README.md").read_text()
    for name, keys in LISTS.items():
        part = text.split(f"**[[{name}]]**")[1].split("\n\n")[1]
        rows = [line for line in part.splitlines() if line.startswith("| `")]
        assert len(rows) == len(keys)
        assert all(f"| `{key.name}`" in row and key.meaning in row for key, row in zip(keys, rows))
