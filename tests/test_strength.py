"""Cables as pieces, and their strength: breaking loads, catalogues, scatter."""

import numpy as np
import pytest
from conftest import STEEL

from netfall.errors import InputError
from netfall.job.read import read_job
from netfall.net.build import build_net

# Two lines that cross at node 5: 1-5-2 and 3-5-4; from 2 on the first bends by 20 degrees to node 6, and
# by 40 more to node 7; node 4 is a support, behind which the second goes on to node 8.
NODES = """id,x,y,z,fixed
1,-2,0,0,1
2,2,0,0,0
3,0,-2,0,1
4,0,2,0,1
5,0,0,0,0
6,3.87938524,0.68404029,0,0
7,4.87938524,2.41609110,0,1
8,0,4,0,1
"""
ENDS = [(1, 5), (3, 5), (5, 2), (4, 5), (2, 6), (6, 7), (4, 8)]


def net_of(workshop, elements: str, nodes=NODES, section=STEEL, overrides=()):
    """The net of two tables."""
    return build_net(read_job(workshop.job(section, nodes, elements), list(overrides)))


def table(columns: str, rows) -> str:
    """elements.csv, a row for each of the elements."""
    return f"start,end,{columns}\n" + "\n".join(f"{a},{b},{more}" for (a, b), more in zip(ENDS, rows)) + "\n"


def pieces(net) -> list[str]:
    """The name of the piece of each element."""
    return [net.cable_names[k] for k in net.cable]


def test_a_cable_runs_straight_through_and_ends_at_bends_and_supports(workshop):
    """At a crossing each line goes on; 20 degrees are straight, 40 are not; a support is an anchor."""
    net = net_of(workshop, table("id", range(20, 27)))
    assert pieces(net) == ["e20", "e21", "e20", "e21", "e20", "e25", "e26"]
    assert net.cable.tolist() == [0, 1, 0, 1, 0, 2, 3]  # numbered as they come in the rows


def test_groups_part_cables_and_subdivision_does_not(workshop):
    """Where the group changes the piece ends; three elements of one segment are one piece."""
    groups = ["a", "b", "c", "b", "c", "c", "c"]
    net = net_of(workshop, table("group", groups), overrides=["net.subdivide=3"])
    assert pieces(net)[::3] == ["e0", "e1", "e2", "e1", "e2", "e5", "e6"]
    assert (net.cable.reshape(-1, 3) == net.cable[::3, None]).all()


def test_the_column_cable_names_pieces(workshop):
    """What is named is one piece, however it bends; what is not is a chain of its own, not through it."""
    net = net_of(workshop, table("cable", ["", "main", "main", "", "", "main", ""]))
    assert pieces(net) == ["e0", "main", "main", "e3", "e4", "main", "e6"]
    with pytest.raises(InputError) as raised:
        net_of(workshop, table("cable", ["", "e0", "", "", "", "", ""]))
    (line,) = raised.value.lines
    assert "elements.csv: cable = e0: so a piece without a name is called" in line


def test_lines_of_a_generated_net_are_its_cables(tmp_path):
    """A saddle of 32 cells, whose start is steep at its edge, has 31 cables each way; a wheel 36 radials."""
    cells = 32
    path = tmp_path / "job.toml"
    path.write_text(f'[net]\ngenerator = "saddle"\ncells = {cells}\n{STEEL}')
    net = build_net(read_job(path, []))
    across = np.unique(np.column_stack([net.group, net.cable]), axis=0)
    assert np.bincount(across[:, 0]).tolist() == [cells - 1] * 2
    assert (np.bincount(net.cable) == cells).all()
