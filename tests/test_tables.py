"""Tables of users: delimiters, comments, units, further columns, and faults of a drawing."""

import re
import subprocess
import sys
from codecs import BOM_UTF8

import numpy as np
import pytest
from conftest import ENVIRONMENT, ROOT, STEEL, error_lines, run_on_standing_ranks

from netfall.core.errors import InputError
from netfall.geometry.areas import find_roof, tributary_areas
from netfall.geometry.build import build_net
from netfall.geometry.net import SORTING_DIRECTIONS, close_pairs
from netfall.job.keys.fields import keys_of
from netfall.job.keys.models import Cable, Load
from netfall.job.read import read_job

NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1.5,0,0,0\n3,3,0,0,1\n"
ELEMENTS = "start,end,id\n1,2,7\n2,3,8\n"


def net_from(workshop, nodes=NODES, elements=ELEMENTS, overrides=()):
    return build_net(read_job(workshop.job(STEEL, nodes, elements), list(overrides)))


FORMS = {
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "blanks after commas": lambda text: text.replace(",", ", "),
    "comments": lambda text: (
        "# drawn by hand, 3 nodes; metres\n" + text.replace("\n2", "\n  # the middle, free\n2") + "#\n"
    ),
    "mark of byte order": lambda text: "\ufeff" + text,
    "mark of byte order and a comment": lambda text: "\ufeff# x;y\n" + text,
    "first line of Excel": lambda text: "sep=;\n" + text.replace(",", ";"),
    "capitals": lambda text: text.replace("id", "ID").replace("x,y,z", "X, Y ,Z").replace("start", "Start"),
    "line ends of Windows": lambda text: text.replace("\n", "\r\n"),
    "quotes": lambda text: text.replace("id", '"id"').replace("1.5", '"1.5"'),
    "a column more": lambda text: (
        text.replace("\n", ",remark, here\n", 1).replace("0\n", '0,"a, b",\n').replace("1\n", "1,,\n")
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_tables_may_have_any_of_these_forms(workshop, form):
    net = net_from(
        workshop, FORMS[form](NODES), FORMS[form](ELEMENTS) if form != "a column more" else ELEMENTS
    )
    assert net.x[:, 0].tolist() == [0.0, 1.5, 3.0] and net.node_id.tolist() == [1, 2, 3]
    assert net.fixed[:, 0].tolist() == [True, False, True] and net.element_id.tolist() == [7, 8]
    assert ("remark" in "".join(net.notes)) == (form == "a column more")


def test_kind_density_and_expansion_of_a_row_replace_those_of_the_job(workshop):
    """An empty cell has the value of the job. An unknown kind is named with its line."""
    elements = "start,end,kind,density,expansion\n1,2,bar,8000,1e-5\n2,3,,,\n"
    net = net_from(workshop, elements=elements)
    assert net.bar.tolist() == [True, False] and net.density.tolist() == [8000.0, 7850.0]
    assert net.expansion.tolist() == [1e-5, 12e-6]
    lines = error_lines(net_from, workshop, NODES, elements.replace("bar", "rod"))
    assert len(lines) == 1 and 'line 2: kind = \'rod\': expected "cable" or "bar"' in lines[0]


def test_no_temperature_makes_a_length_negative():
    """The unstressed length times 1 + expansion times temperature stays above 0 in both ranges."""
    expansion, temperature = keys_of(Cable)["thermal_expansion"], keys_of(Load)["temperature"]
    assert expansion.low * temperature.high >= -0.5 and expansion.high * temperature.low >= -0.5


def test_a_spring_has_no_force_at_its_initial_position(workshop):
    """k (d0 - d) + 3 kN - EA d / L0 = 0 for a node on a spring of 4e5 N/m with d0 = 10 mm."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_x,spring_rest_x,load_x\n"
    nodes += "1,0,0,0,1,1,1,,,\n2,5,0,0,0,1,1,4e5,0.01,3000\n"
    text = STEEL + "[load]\nself_weight = false\nsteps = 1\ntolerance = 1e-10\n"
    with workshop.solve(text, nodes, "start,end,unstressed_length\n1,2,5\n") as f:
        k = 4e5 + f["net/axial_stiffness"][0] / 5.0
        expected = (4e5 * 0.01 + 3000.0) / k
        assert f["statics/displacement"][-1, 1, 0] == pytest.approx(expected, rel=1e-9)
    form = workshop.job(STEEL + "[form_finding]\n", nodes, "start,end\n1,2\n")
    with pytest.raises(InputError, match=r"spring_rest_x, y, z in nodes.csv and \[form_finding\] exclude"):
        build_net(read_job(form))


def test_an_initial_position_without_spring_is_refused(workshop):
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_x,spring_rest_x,spring_rest_z\n"
    nodes += "1,0,0,0,1,1,1,,,\n2,5,0,0,0,1,1,4e5,0.01,-0.02\n"
    job = workshop.job(STEEL, nodes, "start,end,unstressed_length\n1,2,5\n")
    with pytest.raises(InputError, match="line 3: spring_rest_z: has no effect without spring_z"):
        build_net(read_job(job))


SQUARE = "id,x,y,z,fixed\n1,0,0,0,1\n2,6,0,0,1\n3,6,6,0,1\n4,0,6,0,1\n5,3,3,1,0\n"
SPOKES = "start,end\n1,5\n2,5\n3,5\n4,5\n"
GIVEN = "face,node,x,y,z\n0,1,,,\n0,2,,,\n0,5,,,\n1,2,,,\n1,,9,3,0\n1,3,,,\n1,5,,,\n"


def roofed(workshop, faces, roof="", subdivide=1):
    (workshop.folder / "faces.csv").write_text(faces)
    text = f"subdivide = {subdivide}\n" + STEEL
    text += f'[roof]\nfaces = "faces.csv"\n{roof}[load]\nself_weight = false\ndead = 1.0\n'
    return read_job(workshop.job(text, SQUARE, SPOKES))


def roof_of(job):
    """Return the roof of a job."""
    return find_roof(job, build_net(job))


def share_of_the_corner() -> float:
    """Return the share of the square 2, (9, 3, 0), 3, 5, of which 5 is 1 m high, by its triangles."""
    side, outer, inner = np.array([[6.0, 0.0, 0.0], [9.0, 3.0, 0.0], [3.0, 3.0, 1.0]])

    def halves(middle):  # of the surface on this side of y = 3, at either end of the side from 2
        return [0.5 * np.linalg.norm(np.cross(side - middle, end - middle)) for end in (outer, inner)]

    mean = np.array([6.0, 3.0, 0.25])
    weight = np.array(halves(mean)) / sum(halves(mean))
    middle = (mean + weight @ [side + outer, side + inner]) / 3
    middle[1] = 3.0  # the other side is its mirror image
    outside, within = halves(middle)
    return 0.5 * outside / (outside + within)


def test_faces_of_a_table_carry_the_loads(workshop):
    """A triangle of 9 m2 and a square of 18 m2 with a corner without node. The spokes close no ring."""
    job = roofed(workshop, GIVEN)
    net = build_net(job)
    faces = find_roof(job, net).faces
    assert faces.corner.tolist() == [0, 1, 4, 1, 5, 2, 4] and net.corners.tolist() == [[9.0, 3.0, 0.0]]
    plan = tributary_areas(net.x, net, faces)[1]
    assert plan[0] == pytest.approx(3.0, rel=1e-12)  # a third of the triangle
    assert plan.sum() == pytest.approx(27.0 - 18.0 * share_of_the_corner(), rel=1e-12)
    for parts in (2, 3, 7):  # nodes within the sides are corners too, in order along them
        job = roofed(workshop, GIVEN, subdivide=parts)
        net = build_net(job)
        faces = find_roof(job, net).faces
        assert len(faces.corner) == 7 + 4 * (parts - 1)
        sides = np.diff(np.concatenate([net.x, net.corners])[faces.sides()], axis=1)[:, 0]
        around = 6.0 + 4 * 19.0**0.5 + 2 * 18.0**0.5
        assert np.linalg.norm(sides, axis=1).sum() == pytest.approx(around, rel=1e-12)


@pytest.mark.parametrize("faces, share", [("0,1\n0,2\n0,5\n", 0.25), ("0,1\n0,2\n0,3\n0,4\n", 1.0)])
def test_the_covered_share_is_that_of_the_net(workshop, faces, share):
    """One of the four triangles between the spokes has 9 of 36 m2; the square has all."""
    assert roof_of(roofed(workshop, "face,node\n" + faces)).covered_share == pytest.approx(share, rel=1e-12)


def test_vertical_faces_are_one_error(workshop):
    """Two vertical triangles of 6 m2: one line with the remedy, not one for each face."""
    upright = "face,node,x,y,z\n0,1,,,\n0,2,,,\n0,,3,0,2\n1,2,,,\n1,3,,,\n1,,6,3,2\n"
    (line,) = error_lines(roof_of, roofed(workshop, upright))
    assert line.endswith(
        "faces seen edge-on from above: 2, the first is face = 0 (0 m2 seen, 6 m2 of surface). Give "
        "[roof] normal, the outward direction. [E289]"
    )


def test_given_areas_are_not_called_open(workshop):
    nodes = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n" + "".join(
        f"{k},{x},0,{z},{int(x != 3)},4,0,1,0\n"
        for k, (x, z) in enumerate(((0, 0), (6, 0), (0, 6), (6, 6), (3, 3)))
    )
    text = STEEL + "[load]\nself_weight = false\nsteps = 1\n[[case]]\nname = 'wind'\n"
    job = workshop.job(text + "set = {'load.pressure' = 100.0}\n", nodes, "start,end\n0,4\n1,4\n2,4\n3,4\n")
    done = run_on_standing_ranks("check", job)
    assert (
        "roof: 20.0 m2 of surface, 0.0 m2 in plan; areas and normals of the roof are those of nodes.csv"
        in done.stdout
    )
    assert "no faces" not in done.stdout and "closed faces" not in done.stdout


def test_invalid_faces_are_named(workshop):
    job = roofed(workshop, GIVEN.replace("0,2,,,", "0,7,,,"), subdivide=2)  # 7: in the middle of 2-5
    assert "line 3: node = 7: no such node" in error_lines(roof_of, job)[0]
    for old, new, words in (
        ("0,2,,,", "0,7,,,", "line 3: node = 7: no such node"),
        ("0,2,,,", "0,,,,", "line 3: node is empty; expected an id, or x, y, z"),
        ("0,5,,,\n", "", "face = 0: 2 corners; expected three corners or more, each once"),
        ("0,1,,,\n0,2,,,", "0,2,,,\n0,1,,,", "face = 0: -9 m2 in plan; expected its corners anticlockwise"),
        ("1,,9,3,0\n1,3,,,", "1,3,,,\n1,,7,3,0", "face = 1: Self-intersection[6 3]; expected three corners"),
        ("1,3,,,\n", "1,3,,,\n0,4,,,\n", "face = 0: its rows are not consecutive"),
        ("1,5,,,\n", "1,5,,,\n2,2,,,\n2,5,,,\n2,1,,,\n", "line 9: face = '2': expected other corners"),
        ("1,5,,,\n", "1,5,,,\n2,2,,,\n2,5,,,\n2,1,,,\n", "than those of the face at line 2 [E187]"),
    ):
        assert words in "; ".join(error_lines(roof_of, roofed(workshop, GIVEN.replace(old, new))))
    job = roofed(workshop, GIVEN.replace("0,1,,,", "0,7,,,").replace("0,2,,,", "0,8,,,"))
    lines = error_lines(roof_of, job)  # nothing on the corners of that face
    assert len(lines) == 2 and all("no such node" in line for line in lines)
    (line,) = error_lines(roof_of, roofed(workshop, GIVEN, "openings = [[1.0, 1.0]]\n"))
    assert "faces and openings exclude each other" in line


def test_faces_that_overlap_are_named(workshop):
    """A triangle over halves of two faces, a face with a corner on another's side, and one 3 m above."""
    for more, count in (
        ("2,1,,,\n2,2,,,\n2,3,,,\n", 2),
        ("2,,1,-1,0\n2,,5,-1,0\n2,,3,1,0.2\n", 1),
        ("2,,3,3,4\n2,,3,-3,4\n2,,9,-3,4\n2,,9,3,4\n", 0),
        ("2,1,,,\n2,,3,-1,0\n2,,6,-3,0\n2,2,,,\n2,,3,0,0\n", 0),
    ):
        notes = [note for note in roof_of(roofed(workshop, GIVEN + more)).notes if "faces overlap" in note]
        assert len(notes) == (count > 0)
        assert all(f"faces overlap (pairs: {count}, the first face = 0 and 2 by" in note for note in notes)


ALL_IDS = "id\n1,2,7\n2,3,8"
WRONG = [  # a text of the tables, another one, and the error; see also BAD_TABLES
    ("2,1.5", "# one\n# two\n2,wide", "nodes.csv: line 5: x = 'wide': expected a number in m"),
    ("1.5", "1,5", "line 3: 6 values, but the header has 5 columns. Write one value per column"),
    ("1.5", "1_5", "nodes.csv: line 3: x = '1_5': expected a number in m"),
    ("fixed", "fix", "'fix': unknown column; did you mean \"fixed\"?"),
    ("fixed", "load-z", "'load-z': unknown column; did you mean \"load_z\"?"),
    ("fixed", "mas", "'mas': unknown column; did you mean \"mass\"?"),
    ("0,0,0,1", "0,0,0,true", "line 2: fixed = 'true': expected 0 or 1 [E187]"),
    ("0,0,0,1", f"0,0,0,{99 * 'x'}", f"line 2: fixed = '{40 * 'x'}': expected 0 or 1 [E187]"),
    (ALL_IDS, "expansion\n1,2,12\n2,3,", "expansion = '12': expected a number from -0.0005 to 0.001 1/K"),
    (ALL_IDS, "expansion\n1,2,-1\n2,3,", "expansion = '-1': expected a number from -0.0005 to 0.001 1/K"),
    ("end,id", "end,axial_stiffness", "line 1: 'axial_stiffness': unknown column; this is a key of [cable]"),
    ("end,id", "end,mass_per_length", "line 1: 'mass_per_length': unknown column; this is a key of [cable]"),
    ("end,id", "end,second_moment", "line 1: 'second_moment': unknown column; this is a key of [cable]"),
    ("end,id", "end,thermal_expansion", 'unknown column; its name here is "expansion"'),
]


@pytest.mark.parametrize("old, new, error", WRONG)
def test_a_wrong_cell_or_column_is_one_line(workshop, old, new, error):
    """12 probably means 12e-6 1/K. A stiffness in an unknown column would have no effect."""
    (line,) = error_lines(net_from, workshop, NODES.replace(old, new), ELEMENTS.replace(old, new))
    assert error in line


def test_decimal_commas_are_refused(workshop):
    (line,) = error_lines(net_from, workshop, NODES.replace(",", ";").replace("1.5", "1,5"))
    assert "x = '1,5': expected a number with a decimal point" in line


@pytest.mark.parametrize("rest", ["", "4,2,5,c\n", '4,2,5,"c"\n'])
def test_an_unclosed_quote_is_refused(workshop, rest):
    nodes = NODES + "4,1,1,0,1\n5,1,-1,0,1\n"
    elements = 'id,start,end,group\n1,1,2,a\n# middle\n2,2,3,"b, c"\n3,2,4,"b\n'
    for table in (elements + rest, (elements + rest).replace("\n", "\r\n"), (elements + rest).rstrip("\n")):
        (line,) = error_lines(net_from, workshop, nodes, table)
        assert "elements.csv: line 5: a quote is not closed on the line" in line


def test_the_largest_id_leaves_space_for_new_nodes(workshop):
    """Ids may reach 1e15. Larger ones, up to and above 64 bits, are named with the limit."""
    most = 10**15
    net = net_from(
        workshop, NODES.replace("\n3", f"\n{most}"), ELEMENTS.replace("2,3,8", f"2,{most},-{most}")
    )
    assert net.node_id.max() == most == -net.element_id.min()
    for number in (most + 1, 2**63 - 1, 10**30):
        nodes, elements = NODES.replace("\n3", f"\n-{number}"), ELEMENTS.replace("2,3,8", f"2,3,{number}")
        first, *_, last = error_lines(net_from, workshop, nodes, elements)
        assert f"nodes.csv: line 4: id = '-{number}': expected an integer from -1e+15 to 1e+15" in first
        assert f"elements.csv: line 3: id = '{number}': expected an integer from -1e+15 to 1e+15" in last


def test_numbers_with_underscores_are_refused(workshop):
    """Python reads 0_3 as three. In ids and ends it is refused with its line, like 1_5 in numbers."""
    lines = error_lines(net_from, workshop, NODES.replace("\n3,", "\n0_3,"), ELEMENTS.replace("2,3", "2,0_3"))
    assert "nodes.csv: line 4: id = '0_3': expected an integer" in lines[0]
    assert any("elements.csv: line 3: end = '0_3': expected an integer" in line for line in lines)


UNITS = [("mm", 1000.0), ("cm", 100.0), ("ft", 1 / 0.3048), ("in", 1 / 0.0254)]


@pytest.mark.parametrize("unit, metre", [("m", 1.0), *UNITS])
def test_the_unit_applies_only_to_coordinates(workshop, unit, metre):
    """1 m and 3 m in each unit. Other columns stay in SI units."""
    nodes = f"id,x,y,z,area,mass\n1,0,0,0,2,5\n2,{metre!r},0,0,2,5\n3,{3 * metre!r},0,0,2,5\n"
    elements = "start,end,unstressed_length\n1,2,0.99\n2,3,1.99\n"
    net = net_from(workshop, nodes, elements, [f"net.unit={unit}"])
    assert np.allclose(net.x[:, 0], [0, 1, 3], rtol=1e-15)
    assert net.area.tolist() == [2] * 3 and net.mass.tolist() == [5] * 3
    assert net.unstressed_length.tolist() == [0.99, 1.99]


@pytest.mark.parametrize("unit, metre", UNITS)
def test_unstressed_lengths_in_the_unit_of_the_coordinates_are_refused(workshop, unit, metre):
    """Lengths are in metres: 1500 for 1.5 m in a file in mm is an error, even if a tenth longer."""
    nodes = f"id,x,y,z\n1,0,0,0\n2,{1.5 * metre!r},0,0\n3,{3 * metre!r},0,0\n"
    lengths = lambda per: f"start,end,unstressed_length\n1,2,{1.485 * per!r}\n2,3,{1.65 * per!r}\n"
    wrong = workshop.job(STEEL, nodes, lengths(metre))
    with pytest.raises(InputError, match=f"column unstressed_length: .* elements in {unit}; expected m\\."):
        build_net(read_job(wrong, [f"net.unit={unit}"]))
    assert net_from(workshop, nodes, lengths(1.0), [f"net.unit={unit}"]).unstressed_length[0] == 1.485


def test_whole_millimetres_are_exact(workshop):
    """1500 mm is the double nearest to 1.5 m, and 1 mm that nearest to 0.001 m."""
    net = net_from(workshop, NODES.replace("1.5", "1500").replace("3,3", "3,1"), overrides=["net.unit=mm"])
    assert net.x[1:, 0].tolist() == [1.5, 0.001]


def test_a_unit_without_tables_is_refused(workshop):
    path = workshop.job('[net]\ngenerator = "saddle"\nunit = "mm"\n' + STEEL)
    with pytest.raises(InputError, match=r'\[net\] unit = "mm": only for tables'):
        read_job(path)
    with pytest.raises(InputError, match='unit = "inch": expected one of "m", "cm", "mm", "ft", "in"'):
        net_from(workshop, overrides=["net.unit=inch"])


def test_unknown_columns_are_named_and_ignored(workshop):
    nodes = (
        NODES.replace("\n", ",layer,colour\n", 1).replace("1\n", "1,roof,?\n").replace("0\n", "0,roof,7\n")
    )
    job = workshop.job(STEEL, nodes, ELEMENTS)
    for command in ("check", "run"):
        done = run_on_standing_ranks(command, job, cwd=workshop.folder)
        assert done.stdout.count('unknown columns, which netfall ignores: "layer", "colour"') == 1


def test_parallel_elements_and_unjoined_nodes_are_named(workshop):
    """An element occurs twice, in reverse order, and two nodes are 0.5 mm apart; no others."""
    nodes = NODES + "4,3,0.0005,0,1\n5,1.5,0.0004,0,0\n6,1.5,0.002,0,0\n"
    net = net_from(workshop, nodes, ELEMENTS + "3,2,9\n2,5,10\n5,4,11\n6,4,12\n")
    assert len(net.notes) == 2
    assert net.notes[0].startswith("warning: several elements join the same two nodes (8 and 9). They count")
    assert net.notes[1].startswith(
        "warning: nodes lie close to each other and are not joined (3 and 4, 0.5 mm apart)."
    )


def test_many_pairs_are_counted(workshop):
    nodes = "id,x,y,z\n" + "".join(f"{i},{i},0,0\n" for i in range(9))
    elements = "start,end\n" + 2 * "".join(f"{i},{i + 1}\n" for i in range(8))
    (line,) = net_from(workshop, nodes, elements).notes
    assert "(0 and 8, 1 and 9, 2 and 10, 3 and 11, 4 and 12, ...). They" in line


def test_close_pairs_are_those_of_all_distances():
    rng = np.random.default_rng(5)
    x = rng.integers(0, 4, (300, 3)) + rng.choice([0.0, 1e-3, 3e-3], (300, 3))
    apart = np.linalg.norm(x[:, None] - x[None], axis=2)
    expected = np.argwhere(np.triu(apart <= 2e-3, 1))
    assert len(expected) > 50 and np.array_equal(close_pairs(x, 2e-3), expected)
    assert np.argwhere(np.triu(apart == 0.0, 1)).tolist() == close_pairs(x, 0.0).tolist() != []
    assert close_pairs(x[:1], 1.0).shape == close_pairs(x[:0], 1.0).shape == (0, 2)


@pytest.mark.parametrize("normal", SORTING_DIRECTIONS)
def test_a_flat_net_in_any_plane_has_few_candidates_of_close_pairs(monkeypatch, normal):
    """A grid of 20 x 20 nodes in a plane normal to a direction along which nodes may be sorted."""
    first = np.cross(normal, [1.0, 0.0, 0.0])
    x = np.array([i * first + k * np.cross(normal, first) for i in range(20) for k in range(20)])
    candidates, sort = [], np.sort
    monkeypatch.setattr(np, "sort", lambda pairs, axis: candidates.extend(pairs) or sort(pairs, axis=axis))
    assert len(close_pairs(x, 1e-3)) == 0 and len(candidates) < len(x)


def test_a_check_does_not_load_scipys_trees():
    """The trees would add a tenth to the time of a start."""
    script = "import sys; from netfall.__main__ import main; main(); print('scipy.spatial' in sys.modules)"
    command = [sys.executable, "-c", script, "check", ROOT / "jobs" / "two_cables.toml"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


def test_further_columns_of_faces_and_the_catalogue_are_named(workshop):
    (workshop.folder / "faces.csv").write_text("face,node,remark\n0,1,a\n0,2,b\n0,5,c\n")
    catalogue = "name,mass_per_length,axial_stiffness,breaking_load,price\nA,1,1e7,1e5,9\n"
    (workshop.folder / "types.csv").write_text(catalogue)
    job = '[cable]\ncatalogue = "types.csv"\ntype = "A"\nprestress = 1e4\n[roof]\nfaces = "faces.csv"\n'
    job += "[load]\nself_weight = false\nsteps = 1\nsnow = 500.0\n"
    done = run_on_standing_ranks("check", workshop.job(job, SQUARE, SPOKES))
    assert done.stdout.count('which netfall ignores: "remark"') == 1, done.stdout + done.stderr
    assert done.stdout.count('which netfall ignores: "price"') == 1


def test_further_columns_of_a_wind_table_are_named(workshop):
    (workshop.folder / "gust.csv").write_text("# mast 3\ntime;speed;direction\n0;5;270\n1;6;270\n")
    nodes = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n"
    nodes += "1,0,0,0,1,0,,,\n2,1.5,0,0,0,1,0,0,1\n3,3,0,0,1,0,,,\n"
    wind = '[wind]\nonset = "sudden"\nfile = "gust.csv"\nbase_height = 10.0\npressure_coefficient = -1.0\n'
    wind += "[dynamics]\nduration = 0.01\n"
    done = run_on_standing_ranks("check", workshop.job(STEEL + wind, nodes, ELEMENTS))
    assert 'which netfall ignores: "direction"' in done.stdout, done.stdout + done.stderr


def test_a_table_in_another_encoding_is_refused_with_the_right_one(workshop):
    """Spreadsheets save such tables if names are not in ASCII."""
    job = workshop.job(STEEL, NODES, ELEMENTS)
    beyond_a_block = BOM_UTF8 + 50_000 * b"#\n" + b"\xfc\n"  # of a reader
    umlaut, wide = ("# Stütze\n" + NODES).encode("latin-1"), NODES.encode("utf-16-le")
    for content, line in ((umlaut, 1), (wide, 1), (beyond_a_block, 50_001)):
        (workshop.folder / "nodes.csv").write_bytes(content)
        with pytest.raises(InputError, match=rf"line {line}: not text in UTF-8\. Save the table as UTF-8"):
            build_net(read_job(job))


@pytest.mark.parametrize("cell", ["N{}", "{}.0"])
def test_an_id_that_is_no_integer_is_one_error(workshop, cell):
    """No error follows from the number that takes its place: not one of equal ids, nor of unknown nodes."""
    nodes = re.sub(r"(?m)^(\d)", lambda row: cell.format(row[1]), NODES)
    lines = error_lines(net_from, workshop, nodes)
    assert len(lines) == 3 and all("expected an integer [E187]" in line for line in lines)
    elements = re.sub(r"(?m)^(\d),(\d)", lambda row: f"{cell.format(row[1])},{cell.format(row[2])}", ELEMENTS)
    assert len(error_lines(net_from, workshop, NODES, elements)) == 4
    assert len(error_lines(net_from, workshop, nodes, elements)) == 3 + 4
