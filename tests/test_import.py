"""Drawings and meshes become nets: the net of each format is the same, and faults are named."""

import itertools
import json
import re
import time

import ezdxf
import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import error_lines, run_on_standing_ranks
from drawings import Sketch, places
from ezdxf.xclip import XClip
from results import rows_of
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import (
    VTK_POLY_LINE,
    VTK_QUAD,
    VTK_QUADRATIC_EDGE,
    VTK_TETRA,
    VTK_TRIANGLE_STRIP,
    VTK_VERTEX,
    vtkUnstructuredGrid,
)
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

import netfall
from netfall.core.errors import InputError
from netfall.driver.check import check_job
from netfall.exchange.drawings.importing import import_file
from netfall.exchange.drawings.reading import ImportOptions, read_net
from netfall.exchange.vtu import write_vtu
from netfall.geometry.build import build_net
from netfall.job.read import read_job
from netfall.post.plots import canvas
from netfall.post.plots.net import add_groups, draw_imported_net

ROUNDING = 1e-12  # m: a coordinate of some metres in mm or inches, and back


def report(path, **options) -> str:
    """Return the report on a drawing."""
    return "\n".join(read_net(path, ImportOptions(**options)).lines)


def imported(path, name="net", **options):
    """Return the first job of an import, its net, and the report."""
    lines = []
    import_file(path, path.parent / name, ImportOptions(**options), lines.append)
    job = read_job(path.parent / name / f"{name}.toml")
    return job, build_net(job), lines


def same_nodes(net, x) -> bool:
    """Return whether a net has these nodes (n, 3), in any order."""
    in_order = lambda points: points[np.lexsort(np.round(points.T, 9))]
    return len(net.x) == len(x) and np.abs(in_order(net.x) - in_order(x)).max() <= ROUNDING


@pytest.mark.parametrize("unit", ["mm", "m", "in"])
def test_an_imported_drawing_is_in_metres(tmp_path, unit):
    """All nodes, elements and groups, for any unit of the file. Its first job is valid."""
    sketch = Sketch(unit).net()
    path = sketch.save(tmp_path / "roof.dxf")
    job, net, lines = imported(path)
    assert same_nodes(net, places(sketch))
    assert net.m == 31 and [net.group_names[g] for g in net.group].count("x") == 16
    edge = [i in (0, 4) or j in (0, 3) for i in range(5) for j in range(4)]
    assert net.fixed.all(1).sum() == sum(edge)
    assert not any(line.startswith(("gap", "crossing", "near", "loose", "dup", "unit: an")) for line in lines)
    assert (tmp_path / "net" / "net.png").stat().st_size > 10_000
    check_job(job, lambda line: None)  # which finds the form


def test_the_import_command_prints_what_it_writes(tmp_path):
    """`netfall check` accepts the job that `netfall import` writes. A drawing without a unit is refused."""
    path = Sketch("").net().save(tmp_path / "roof.dxf")
    done = run_on_standing_ranks("import", path, "-o", tmp_path / "roof", code=2)
    assert "has no unit that is known ($INSUNITS = 0). Give --unit, one of m, cm" in done.stderr
    assert not (tmp_path / "roof").exists()
    options = ["-o", tmp_path / "roof", "--unit", "m", "--supports", "outline"]
    done = run_on_standing_ranks("import", path, *options)
    assert "14 of 20 nodes are held" in done.stdout, done.stdout + done.stderr
    assert done.stdout.startswith((tmp_path / "roof" / "report.txt").read_text()[:-1])
    done = run_on_standing_ranks("check", tmp_path / "roof" / "roof.toml", "-o", tmp_path / "pictures")
    assert "valid" in done.stdout, done.stderr
    picture = tmp_path / "pictures" / "roof_net.png"
    assert done.stdout.startswith(f"picture: {picture}\n") and picture.stat().st_size > 10_000


def test_every_kind_of_line_is_read(tmp_path):
    """Polylines, splines, arcs and circles by segments, faces by their sides, nested blocks."""
    sketch = Sketch("m")
    space = sketch.space
    space.add_lwpolyline([(0, 0), (4, 0), (4, 4)], close=True, dxfattribs={"layer": "a", "elevation": 2.0})
    space.add_polyline3d([(0, 0, 2), (2, 2, 5), (4, 4, 2)], dxfattribs={"layer": "b"})
    space.add_arc((0, 4, 2), radius=4.0, start_angle=-90, end_angle=0, dxfattribs={"layer": "c"})
    space.add_spline([(4, 0, 2), (6, 1, 3), (8, 0, 2)], dxfattribs={"layer": "d"})
    space.add_3dface([(4, 4, 2), (8, 4, 2), (8, 0, 2), (4, 0, 2)], dxfattribs={"layer": "e"})
    inner = sketch.document.blocks.new("inner")
    inner.add_line((0, 0), (1, 0))  # on layer 0, so on that of the block reference
    outer = sketch.document.blocks.new("outer")
    outer.add_blockref("inner", (0, 0), dxfattribs={"rotation": 90, "yscale": 2, "xscale": 2})
    space.add_blockref("outer", (8, 4, 2), dxfattribs={"layer": "f"})
    space.add_text("roof")
    path = sketch.save(tmp_path / "kinds.dxf")
    reading = read_net(path, ImportOptions(supports="outline"))
    net, drawing = reading.net, reading.drawing
    length = np.linalg.norm(np.diff(net.x[net.ends], axis=1)[:, 0], axis=1)
    of = lambda name: length[[drawing.layers[k] == name for k in drawing.layer[net.line]]]
    assert of("a").tolist() == [4.0, 4.0, pytest.approx(32**0.5)]
    assert of("b") == pytest.approx([17**0.5] * 2)
    # a chord of sagitta s = size / 200 on an arc is shorter by 8 s^2 / 3 c^2, here at most 2.5e-4 of it
    assert len(of("c")) >= 4 and of("c").sum() == pytest.approx(2 * np.pi, rel=1e-2)
    assert len(of("d")) >= 4 and of("d").sum() > 2 * 5**0.5
    assert of("e").tolist() == [4.0] * 3  # one side is on the polyline, which comes first
    assert of("f").tolist() == [2.0] and [8, 6, 2] in net.x.round(9).tolist()
    output = "\n".join(reading.lines)
    assert "2 blocks exploded, blocks in blocks to depth 2" in output and "left out: 1 TEXT" in output
    sketch.document.saveas(tmp_path / "binary.dxf", fmt="bin")
    again = read_net(tmp_path / "binary.dxf", ImportOptions(supports="outline"))
    assert (again.net.x == net.x).all() and (again.net.ends == net.ends).all()


@pytest.mark.parametrize("repeated", [0, 1])
def test_closed_splines_through_points_are_closed(tmp_path, repeated):
    """A ring of 5 m far away has 12 points, the first repeated or not. Chords shorten it by 0.3 %."""
    sketch = Sketch("m")
    angle = np.radians(30.0 * np.arange(12 + repeated))
    ring = sketch.space.add_spline(np.column_stack([5e6 + 5.0 * np.cos(angle), 5.0 * np.sin(angle)]))
    ring.closed = True
    net = read_net(sketch.save(tmp_path / "ring.dxf"), ImportOptions(supports="outline")).net
    assert (np.bincount(net.ends.ravel()) == 2).all()
    length = np.linalg.norm(np.diff(net.x[net.ends], axis=1)[:, 0], axis=1)
    assert length.sum() == pytest.approx(10.0 * np.pi, rel=5e-3)


def test_cables_end_on_curves(tmp_path):
    """Joints are on an arc in space, a circle and a rounded corner, far from the chords; no others."""
    sketch = Sketch("in")
    normal, radius = np.array([0.6, 0.0, 0.8]), 25.0
    axes = ezdxf.math.OCS(tuple(normal))
    on_arc = lambda angle, r=radius: np.array(axes.to_wcs(ezdxf.math.Vec3.from_deg_angle(angle, r)))
    middle, on = np.array([3.0, 0.0, -4.0]), dict(layer="edge")
    sketch.space.add_arc((0, 0), radius / 0.0254, 10, 170, dxfattribs=on | dict(extrusion=tuple(normal)))
    sketch.space.add_circle(sketch.at(100.0, 0.0, 0.0), radius / 0.0254, dxfattribs={"layer": "rim"})
    sketch.space.add_point(sketch.at(100.0, 0.0, 0.0), dxfattribs=on)
    corner = sketch.at(200.0, 0.0)[0]
    bulge = np.tan(np.radians(22.5))  # of a quarter
    points = [(corner, 0, bulge), (corner + 1000, 1000, 0), (corner + 1000, 3000, 0)]
    sketch.space.add_lwpolyline(points, format="xyb", dxfattribs=on)
    angles = np.linspace(20.0, 160.0, 23)
    for angle in angles:
        sketch.line(middle, on_arc(angle))
        turned = np.radians(2.3 * angle)
        sketch.line((100.0, 0.0, 0.0), (100.0 + 25 * np.cos(turned), 25 * np.sin(turned), 0.0), "circle")
    turn = np.radians(-35.0)  # of the rounded corner, about its middle at (corner, 1000)
    at = np.array([corner + 1000 * np.cos(turn), 1000 + 1000 * np.sin(turn)]) * 0.0254
    sketch.line((*at, 0.0), (250.0, 0.0, 3.0), "bend")
    sketch.line(on_arc(33.3, radius - 0.004), (30.0, 30.0, 5.0), "beside")
    reading = read_net(sketch.save(tmp_path / "arcs.dxf"), ImportOptions(supports="edge"))
    output, net, drawing = "\n".join(reading.lines), reading.net, reading.drawing
    group = np.array([drawing.layers[k] for k in drawing.layer[net.line]])
    degree = np.bincount(net.ends[np.isin(group, ["edge", "rim"])].ravel(), minlength=len(net.x))
    for name, count in (("x", 23), ("circle", 23), ("bend", 1)):
        tips = net.ends[group == name]
        assert len(tips) == count and (degree[tips].max(1) == 2).all()
        assert name == "circle" or reading.fixed[tips].any(1).all()
    assert "joints at ends of lines that lie on them: 47" in output
    assert "beside" not in group and "layer beside" in output
    flat = np.linalg.norm(net.x[net.ends[group == "edge"]].mean(1) @ normal[:, None], axis=1) < 1e-9
    chords = net.x[net.ends[group == "edge"][flat]].mean(1)
    assert len(chords) == 24 and (np.linalg.norm(chords, axis=1) > radius - 2 * radius / 200).all()


def lengths(reading, layer=None) -> np.ndarray:
    """Return the lengths [m] of the lines of a drawing, or of one layer, in order."""
    drawing = reading.drawing
    length = np.linalg.norm(np.diff(drawing.lines, axis=1)[:, 0], axis=1)
    return length if layer is None else length[drawing.layer == drawing.layers.index(layer)]


def spline(space, degree, control_points, knots=None, weights=None, layer="a"):
    """Add a spline by its control points."""
    made = space.add_spline(degree=degree, dxfattribs={"layer": layer})
    made.control_points = control_points
    if knots is not None:
        made.knots = knots
    if weights is not None:
        made.weights = weights
    return made


def has_nodes(reading, *places) -> bool:
    """Return whether lines end at these positions [m], to a micrometre."""
    ends = reading.drawing.lines.reshape(-1, 3)
    apart = np.linalg.norm(ends[:, None] - np.array(places, float)[None], axis=2)
    return bool((apart.min(0) < 1e-6).all())


@pytest.mark.parametrize("knots", [[0, 0, 1, 2, 3, 3], [0, 1, 2, 3, 4, 5]])
def test_a_spline_of_degree_one_is_a_polyline(tmp_path, knots):
    """Its control points are corners, at which cables have joints: three sides of 3-4-5 triangles."""
    sketch = Sketch("m")
    spline(sketch.space, 1, [(0, 0, 0), (3, 4, 0), (6, 0, 0), (9, 4, 0)], knots)
    sketch.line((3, 4), (3, 9), "b")
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert lengths(reading, "a").tolist() == [5.0, 5.0, 5.0] and len(reading.net.x) == 5


def test_a_straight_curve_is_one_segment_and_a_shallow_one_keeps_its_depth(tmp_path):
    """Splines and a bulge that are straight within rounding; an arc 1.25 m deep over 100 m, in four parts."""
    sketch = Sketch("m")
    spline(sketch.space, 3, [(0, 0, 0), (1, 1, 1), (5, 5, 5), (9, 9, 9)], layer="cubic")
    sketch.space.add_spline([(0, 20, 0), (5, 20, 0), (9, 20, 1e-12)], dxfattribs={"layer": "fit"})
    points = [(0, 40, 1e-13), (10, 40, -1e-9), (20, 40, 1.0), (20, 42, 0)]
    sketch.space.add_lwpolyline(points, format="xyb", dxfattribs={"layer": "bulge"})
    half, radius = np.degrees(np.arcsin(50 / 1000.625)), 1000.625  # s = c^2 / 8 r + s / 2
    arc = dict(radius=radius, start_angle=90 - half, end_angle=90 + half, dxfattribs={"layer": "arc"})
    sketch.space.add_arc((50, 60 - radius), **arc)
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert lengths(reading, "cubic") == pytest.approx([9 * 3**0.5])
    assert lengths(reading, "fit") == pytest.approx([9])
    assert lengths(reading, "bulge")[:2].tolist() == [10.0, 10.0]
    assert np.pi * (1 - 0.01) < lengths(reading, "bulge")[2:].sum() < np.pi  # half a circle of 1 m
    assert len(lengths(reading, "arc")) == 4 and has_nodes(reading, (50, 60, 0))


def test_curves_have_joints_at_their_kinks(tmp_path):
    """At knots of splines of degree 2 and 3 with equal control points, and at vertices of polylines."""
    sketch = Sketch("m")
    double = [(0, 0, 0), (1, 3, 0), (4, 4, 0), (7, 3, 0), (8, 0, 0)]
    spline(sketch.space, 2, double, [0, 0, 0, 1, 1, 2, 2, 2])
    legs = [(x, 10, 0) for x in (0, 2, 4)] + [(6, y, 0) for y in (10, 12, 14, 16)]
    spline(sketch.space, 3, legs, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2], layer="legs")
    stacked = [(0, 20, 0), (2, 20, 0)] + 3 * [(3, 20, 0)] + [(3, 22, 0), (3, 24, 0)]
    spline(sketch.space, 3, stacked, layer="stacked")
    weights = [1, 0.5, 1, 0.5, 1]
    spline(
        sketch.space, 2, [(x, y + 40, 0) for x, y, _ in double], [0, 0, 0, 1, 1, 2, 2, 2], weights, "rational"
    )
    turn = np.tan(np.radians(22.5))  # bulge of a quarter
    wave = [(0, 60, turn), (5, 65, -turn), (10, 70, 0)]  # the first ends upright, and the second begins so
    sketch.space.add_lwpolyline(wave, format="xyb", dxfattribs={"layer": "wave"})
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert has_nodes(reading, (4, 4, 0), (6, 10, 0), (3, 20, 0), (4, 44, 0), (5, 65, 0))
    assert lengths(reading, "legs") == pytest.approx([6.0, 6.0])
    assert lengths(reading, "stacked") == pytest.approx([3.0, 4.0])


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_closed_splines_without_clamped_ends_are_read_whole(tmp_path, degree, rational):
    """Only the inner knots count, like in scipy: joints are on the curve, and its length is right."""
    angle = np.arange(9) * 2 * np.pi / 9
    ring = np.column_stack([30 * np.cos(angle), 20 * np.sin(angle), 3 * np.cos(2 * angle)])
    control = np.vstack([ring, ring[:degree]])
    weights = np.resize([1.0, 2.0, 0.5], 9)
    weights = np.append(weights, weights[:degree]) if rational else np.ones(len(control))
    knots = np.arange(len(control) + degree + 1.0)
    sketch = Sketch("m")
    spline(sketch.space, degree, control.tolist(), knots.tolist(), weights.tolist() if rational else None)
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    homogeneous = BSpline(knots, np.column_stack([control * weights[:, None], weights]), degree)
    x = homogeneous(np.linspace(degree, len(control), 200_001))
    x = x[:, :3] / x[:, 3:]
    apart, _ = cKDTree(x).query(reading.net.x)
    assert apart.max() < 2e-3  # half of what is between points of the curve, and 0.1 mm
    whole = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
    # a chord c with sagitta s = size / 200 <= c / 12 is shorter than its arc by 8 s^2 / 3 c^2
    assert whole * (1 - 0.02) < lengths(reading).sum() < whole


def test_the_frame_of_a_fitted_polyline_is_not_a_cable(tmp_path):
    """Polylines in plane and space and a mesh also store their frame (vertices of flag 16)."""
    sketch = Sketch("m")
    passed = [(0, 0, 8), (1, 3, 8), (2, 4, 8), (3, 3, 8), (4, 0, 8)]
    for y, add in ((0, sketch.space.add_polyline2d), (20, sketch.space.add_polyline3d)):
        drawn = add([], dxfattribs={"layer": f"at {y}"})
        drawn.dxf.flags |= 4
        for a, b, flag in [(0, 0, 16), (2, 8, 16), (4, 0, 16), *passed]:
            drawn.append_vertex((a, y + b, 0), dxfattribs={"flags": flag})
    mesh = sketch.space.add_polymesh((3, 3), dxfattribs={"layer": "mesh"})
    for i, j in np.ndindex(3, 3):
        mesh.set_mesh_vertex((i, j), (10 * i, 40 + 10 * j, 5))
    for vertex in mesh.vertices:
        vertex.dxf.flags |= 16
    mesh.dxf.flags |= 4
    mesh.dxf.m_smooth_density, mesh.dxf.n_smooth_density = 2, 4
    for i, j in np.ndindex(2, 4):
        mesh.append_vertex((20 * i, 40 + 5 * j, 1), dxfattribs={"flags": 8 | 64})
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    sides = [10**0.5, 2**0.5, 2**0.5, 10**0.5]
    assert lengths(reading, "at 0") == pytest.approx(sides)
    assert lengths(reading, "at 20") == pytest.approx(sides)
    assert sorted(lengths(reading, "mesh")) == [5.0] * 6 + [20.0] * 4
    frames = "left out: 15 vertex of the frame of a fitted polyline, which is not drawn"
    assert frames in reading.lines


def test_references_without_entities_are_named(tmp_path):
    """References are to another file, a missing or their own block. Clipped ones are read whole."""
    sketch = Sketch("m")
    sketch.document.add_xref_def("steel/ring.dwg", "ring")
    blocks = {name: sketch.document.blocks.new(name) for name in ("gone", "outer", "own", "cut")}
    for k, block in enumerate(blocks.values()):
        block.add_line((10 * k, 0), (10 * k + 4, 3))
    for name in ("ring", "gone"):
        blocks["outer"].add_blockref(name, (0, 0))
    blocks["own"].add_blockref("OWN", (5, 5))
    for name in ("ring", "gone", "outer", "own", "cut"):
        made = sketch.space.add_blockref(name, (0, 0), dxfattribs={"layer": name})
    XClip(made).set_block_clipping_path([(30, 0), (31, 1)])
    sketch.document.blocks.delete_block("gone", safe=False)
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert lengths(reading).tolist() == [5.0, 5.0, 5.0]
    output = "\n".join(reading.lines)
    advice = "bind it in the drawing, or import that file"
    assert f'left out: 2 INSERT of "ring", which is another file (steel/ring.dwg): {advice}' in output
    assert 'left out: 2 INSERT of block "gone", which the file does not hold' in output
    assert 'left out: 1 INSERT of block "OWN" within itself' in output
    assert 'left out: 1 edge that clips block "cut" (XCLIP): the block is read whole' in output


def test_a_faulty_entity_is_a_line_of_the_report(tmp_path):
    """In the model space and in a block. The entities before and after it are read."""
    sketch = Sketch("m")
    block = sketch.document.blocks.new("block")
    for space, y in ((sketch.space, 0), (block, 10)):
        space.add_line((0, y), (3, y + 4))
        spline(space, 3, [(0, 0, 0), (1, 1, 0)])
        space.add_circle((0, 0), 0.0)
        space.add_line((0, 0), (np.nan, 0))
        space.add_line((0, 0), (1e300, 0))
        spline(space, 3, [(0, 0, 0)] * 5, [0, 1, 2])
        space.add_line((3, y + 4), (6, y))
    sketch.space.add_blockref("block", (0, 0))
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert lengths(reading).tolist() == [5.0] * 4
    left = [line for line in reading.lines if line.startswith("left out")]
    assert len(left) == 4 and all("which cannot be read" in line for line in left)
    kinds = [line.split(":")[1].split(",")[0] for line in left]
    assert kinds == [" 2 CIRCLE", " 4 LINE", " 2 SPLINE", " 2 SPLINE"]


def test_invisible_entities_are_counted(tmp_path):
    """Blocks on frozen layers, lines of blocks on layers that are off, smoothed meshes, paper space."""
    sketch = Sketch("m")
    for name in ("off", "frozen"):
        sketch.document.layers.add(name)
    sketch.document.layers.get("off").off()
    sketch.document.layers.get("frozen").freeze()
    block = sketch.document.blocks.new("block")
    block.add_line((0, 0), (1, 0))  # on layer 0, so on that of the reference
    block.add_line((0, 1), (2, 1), dxfattribs={"layer": "own"})
    for y, on in ((0, {"layer": "off"}), (10, {"layer": "frozen"}), (20, {"layer": "x", "invisible": 1})):
        sketch.space.add_blockref("block", (0, y), dxfattribs=on)
    mesh = sketch.space.add_mesh(dxfattribs={"subdivision_levels": 2})
    with mesh.edit_data() as data:
        data.vertices, data.faces = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]
    sketch.document.layout("Layout1").add_line((0, 0), (1, 1))
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    assert lengths(reading).tolist() == [2.0] and reading.drawing.layers == ["own"]
    left = [line.removeprefix("left out: ") for line in reading.lines if line.startswith("left out")]
    assert left == [
        "1 INSERT, which is invisible",
        "1 MESH, of which a smoothed surface is drawn: set its smoothness to 0",
        '1 on layer "frozen", which is off or frozen',
        '1 on layer "off", which is off or frozen',
        "1 in paper space",
    ]


def test_blocks_have_the_positions_of_their_references(tmp_path):
    """A circle in nested blocks, scaled to an ellipse and turned; and a grid of references."""
    sketch = Sketch("m")
    inner = sketch.document.blocks.new("inner", base_point=(1, 0))
    inner.add_circle((1, 0), 1.0)
    outer = sketch.document.blocks.new("outer")
    outer.add_blockref("inner", (0, 5), dxfattribs={"xscale": 40, "yscale": 20, "rotation": 90})
    sketch.space.add_blockref("outer", (100, 0, 7), dxfattribs={"rotation": 30, "layer": "ring"})
    one = sketch.document.blocks.new("one")
    one.add_line((0, 0), (1, 0))
    grid = {"row_count": 2, "column_count": 3, "row_spacing": 5, "column_spacing": 1, "layer": "grid"}
    sketch.space.add_blockref("one", (0, 0), dxfattribs=grid)
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline"))
    drawing, turn = reading.drawing, np.radians(30)
    ring = drawing.lines[drawing.layer == drawing.layers.index("ring")].reshape(-1, 3)
    centre = np.array([100 - 5 * np.sin(turn), 5 * np.cos(turn), 7])
    along, across = np.array([np.cos(turn + np.pi / 2), np.sin(turn + np.pi / 2), 0]), np.array([0, 0, 1])
    u, v = (ring - centre) @ along / 40, (ring - centre) @ np.cross(across, along) / 20
    # points are on chords within 0.1 mm of the curve, of semi-axes 40 and 20 m
    assert np.abs(u**2 + v**2 - 1).max() < 2 * 1e-4 / 20 and np.ptp(ring[:, 2]) < 1e-12
    assert np.ptp(ring @ along) == pytest.approx(80, rel=1e-3)
    assert lengths(reading, "grid").tolist() == [1.0] * 6 and has_nodes(reading, (3, 5, 0))


def test_a_turned_block_in_a_block_of_unequal_scales_is_sheared(tmp_path):
    """Lines, arcs and marks lie where the product of both transformations takes them."""
    sketch = Sketch("m")
    inner = sketch.document.blocks.new("inner", base_point=(1, 0))
    inner.add_line((1, 0), (2, 0))
    inner.add_circle((1, 0), 1.0)
    inner.add_point((1, 1), dxfattribs={"layer": "marks"})
    outer = sketch.document.blocks.new("outer")
    outer.add_blockref("inner", (0, 5), dxfattribs={"rotation": 45})
    sketch.space.add_blockref("outer", (100, 0), dxfattribs={"xscale": 20, "yscale": 10})
    drawing = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(supports="outline")).drawing
    half = np.sqrt(0.5)
    assert drawing.lines[0] == pytest.approx(np.array([[100, 50, 0], [100 + 20 * half, 50 + 10 * half, 0]]))
    assert drawing.points[0] == pytest.approx([100 - 20 * half, 50 + 10 * half, 0])
    ring = (drawing.lines[1:].reshape(-1, 3) - [100, 50, 0]) / [20, 10, 1]
    assert np.hypot(*ring[:, :2].T) == pytest.approx(1, abs=2e-4)  # within 0.1 mm of the curve


def gaps(s):
    s.net(skip=(4,))
    a, b = s.corner(1, 0), s.corner(2, 0)
    s.line((a[0] + 0.6e-3, a[1] - 0.8e-3, a[2]), b)


def wide_gap(s):
    s.net(skip=(9,))
    (a, b, layer) = list(s.pieces())[9]
    x, y, z = s.corner(*a)
    s.line((x, y + 0.006, z), s.corner(*b), layer)


def inches(s):
    s.net()
    s.document.header["$INSUNITS"] = 6  # the file says metres


def far_away(s):
    s.net()
    for line in s.space:
        line.translate(*s.at(4.5e5, 5.4e6))


COPY = [((4, 2, -0.025), (2, 2, 0.075), "copy")]  # lines outside the net [m], and their layers
CROSS = [((2, 2, 0.075), (4, 4, -0.025), "diagonal"), ((4, 2, -0.025), (2, 4, 0.075), "other")]
STAY = [((3, 2, 0.025), (4, 4, -0.025), "stay")]
SHORT = [((2.0, 2.0, 0.075), (2.0004, 2.0, 0.075), "x")]
FREE = [((4, 2, -0.025), (4.0, 3.1, 1.0), "y")]
TWICE = ["duplicate (1)", '(4, 2, -0.025) to (2, 2, 0.075), layer "copy", as']
CROSSED = ["crossing (1)", "at (3, 3, 0.025), layer", '"diagonal" and layer "other"']
FAULTS = {  # unit, drawing, options, words of the report (with the place)
    "a gap of 1 mm": ("mm", gaps, {}, ["gap (1): ends", "1 mm at (2.0006, -0.0008, -0.125) m"]),
    "a gap of 6 mm": ("mm", wide_gap, {}, ["near miss (1): pairs", "6 mm at (2, 2, 0.075) m"]),
    "a line twice": ("m", COPY, {}, TWICE),
    "a crossing": ("m", CROSS, {}, CROSSED),
    "an end on a line": ("mm", STAY, {}, ["touch (1)", "at (3, 2, 0.025) m, (3000, 2000, 25) mm"]),
    "inches": ("in", inches, {}, ["extent 315 x 236.2 x", "unit: m (from $INSUNITS = 6)"]),
    "inches, said": ("in", inches, {"unit": "in"}, ["extent 8 x 6", "from --unit; the file has m"]),
    "millimetres for metres": ("mm", inches, {}, ["8000 x 6000", "an extent of 8000 m is unusual"]),
    "a line without length": ("mm", SHORT, {}, ["no length (1)", "at (2, 2, 0.075) m"]),
    "a loose end": ("mm", FREE, {"supports": "marks"}, ["loose end (1)", "at (4, 3.1, 1) m"]),
    "far from the origin": ("mm", far_away, {}, ["the drawing is 5.4e+06 m from the origin"]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_faults_of_a_drawing_are_named_with_their_place(tmp_path, fault):
    """The report names each fault, its number and its place. The first job of the net is valid."""
    unit, draw, options, words = FAULTS[fault]
    sketch = Sketch(unit)
    if callable(draw):
        draw(sketch)
    else:
        sketch.net()
        for line in draw:
            sketch.line(*line)
    if options.get("supports") == "marks":
        for i, j in [(i, j) for i in range(5) for j in range(4) if i in (0, 4) or j in (0, 3)]:
            sketch.space.add_circle(sketch.at(*sketch.corner(i, j)), 0.1, dxfattribs={"layer": "marks"})
    path = sketch.save(tmp_path / "faulty.dxf")
    output = report(path, **options)
    assert [word for word in words if word not in output] == [], output
    check_job(imported(path, **options)[0], (lines := []).append)
    assert "form finding" in "\n".join(lines)


def test_a_dense_polyline_that_becomes_one_node_is_a_warning(tmp_path):
    """1.8 m in pieces of 0.9 mm disappear; with a tolerance of 0.1 mm all of it remains."""
    sketch = Sketch("m").net()
    sketch.space.add_polyline3d([(9e-4 * k, 0.0, 0.225 + 1e-3 * k) for k in range(2001)])
    path = sketch.save(tmp_path / "dense.dxf")
    assert "W785" not in report(path, tolerance=1e-4)
    output = report(path, tolerance=2e-3)
    assert "chains of ends became one node over 2.69 m (tolerance 0.002 m)" in output


def test_split_makes_a_joint_at_each_crossing(tmp_path):
    """Cables are drawn as whole lines. With --split each crossing is a node, as if drawn in pieces."""
    sketch = Sketch("mm", cells=(6, 5))
    for k in range(2, 12, 2):
        sketch.line((k, 0), (k, 10), "y")
    for k in range(2, 10, 2):
        sketch.line((0, k), (12, k), "x")
    path = sketch.save(tmp_path / "whole.dxf")
    assert "crossing (20): elements cross without a joint; --split makes joints" in report(path)
    reading = read_net(path, ImportOptions(split=True))
    assert len(reading.net.ends) == 4 * 6 + 5 * 5 and len(reading.net.x) == 20 + 18
    assert reading.held.sum() == 18
    assert "split: joints at 0 touches and 20 crossings" in "\n".join(reading.lines)
    sketch.line((0, 3, 0.002), (12, 3, 0.002), "x")  # above the others
    output = report(sketch.save(path), split=True, supports="y")
    assert "joints at 0 touches and 20 crossings" in output
    assert "near miss (5): pairs of elements cross closer than 20 mm, without a joint" in output
    assert "2 mm at (2, 3, 0" in output


def test_overlapping_parts_of_lines_are_named(tmp_path):
    """Two lines of 6 m overlap by 2 m: 10 m remain. A line of supports over two lines holds its nodes."""
    sketch = Sketch("mm")
    for a, b, layer in (((0, 0), (6, 0), "x"), ((4, 0), (10, 0), "y")):
        sketch.line(a, b, layer)
    reading = read_net(sketch.save(tmp_path / "a.dxf"), ImportOptions(split=True))
    net, output = reading.net, "\n".join(reading.lines)
    assert np.sort(np.linalg.norm(np.diff(net.x[net.ends], axis=1)[:, 0], axis=1)) == pytest.approx([2, 4, 4])
    assert "duplicate (1): parts of lines lie on other lines; left out" in output
    assert 'at (5, 0, 0) m, (5000, 0, 0) mm as drawn, layer "y", as on layer "x"' in output
    sketch = Sketch("m")
    for a, b, layer in (((0, 0), (4, 0), "x"), ((4, 0), (10, 0), "x"), ((0, 0), (10, 0), "edge")):
        sketch.line(a, b, layer)
    for x in (0, 4, 10):
        sketch.line((x, 0), (5, 7), "y")
    reading = read_net(sketch.save(tmp_path / "b.dxf"), ImportOptions(supports="edge"))
    assert sorted(reading.net.x[reading.held].tolist()) == [[0, 0, 0], [4, 0, 0], [10, 0, 0]]


def test_supports_come_from_a_layer_from_points_or_from_the_outline(tmp_path):
    """Points, circles and blocks of a layer; lines of a layer, with joints where the net ends on them."""
    sketch = Sketch("mm").net()
    sketch.document.blocks.new("anchor").add_circle((0, 0), 100)
    at = lambda i, j: sketch.at(*sketch.corner(i, j))
    sketch.space.add_blockref("anchor", at(0, 0), dxfattribs={"layer": "held"})
    sketch.space.add_circle(at(4, 3), 50, dxfattribs={"layer": "held"})
    sketch.space.add_point(at(4, 0), dxfattribs={"layer": "held"})
    sketch.space.add_point(at(0, 3), dxfattribs={"layer": "points"})
    sketch.space.add_point(sketch.at(1, 1, 0), dxfattribs={"layer": "held"})
    path = sketch.save(tmp_path / "held.dxf")
    output = report(path, supports="held")
    assert "supports: 3 of 20 nodes are held" in output
    assert "support (1): points of supports are not at a node" in output and "at (1, 1, 0) m" in output
    with pytest.raises(InputError, match=r'--supports helt: .* did you mean "held"'):
        report(path, supports="helt")
    grid = dict(layer="grid", column_count=2, row_count=2, column_spacing=8000, row_spacing=6000)
    sketch.space.add_blockref("anchor", at(0, 0), dxfattribs=grid)
    assert "supports: 4 of 20 nodes are held" in report(sketch.save(path), supports="grid", layers=["x", "y"])
    edge = Sketch("m")
    for j in range(1, 4):
        edge.line((0, j), (8, j), "x")
    edge.space.add_lwpolyline([(0, 0), (8, 0), (8, 4), (0, 4)], close=True, dxfattribs={"layer": "beam"})
    reading = read_net(edge.save(tmp_path / "edge.dxf"), ImportOptions(supports="beam"))
    assert reading.fixed.all() and len(reading.net.x) == 4 + 6 and len(reading.net.ends) == 3 + 10


def test_springs_and_posts_come_from_layers(tmp_path):
    """Points of a layer are on springs. A layer of vertical lines alone probably contains bars."""
    sketch = Sketch("m").net()
    for i, j in ((0, 0), (4, 3)):
        sketch.space.add_point(sketch.at(*sketch.corner(i, j)), dxfattribs={"layer": "elastic"})
    top = np.array(sketch.corner(2, 2)) + (0.1, 0.0, 1.0)
    sketch.line(sketch.corner(2, 2), top, "post")
    sketch.line(top, sketch.corner(4, 2), "stay")
    options = [sketch.save(tmp_path / "s.dxf"), "-o", "roof", "--springs", "elastic=1e6,2e6,0"]
    done = run_on_standing_ranks("import", *options, cwd=tmp_path)
    assert 'springs: 2 nodes of layer "elastic" on 1e+06 x 2e+06 x 0 N/m' in done.stdout
    assert 'group "post": vertical, imported as kind = "bar"' in done.stdout
    rows = rows_of(tmp_path / "roof" / "nodes.csv")
    assert f"supports: {sum(int(row['fixed']) for row in rows)} of 21 nodes are held" in done.stdout
    sprung = [row for row in rows if float(row["spring_y"])]
    assert [(row["spring_x"], row["fixed"]) for row in sprung] == [("1000000.0", "0")] * 2
    places = sorted([float(row[k]) for k in "xyz"] for row in sprung)
    assert np.array(places) == pytest.approx(np.array([sketch.corner(0, 0), sketch.corner(4, 3)]))
    text = (tmp_path / "roof" / "roof.toml").read_text()
    assert '[group.post]\nkind = "bar"' in text and "# [group.stay]" in text and '# catalogue = "' in text
    check_job(read_job(tmp_path / "roof" / "roof.toml"), lambda line: None)
    for wrong in ("elastic", "elastic=0", "elastic=1,2"):
        done = run_on_standing_ranks("import", "s.dxf", "-o", "no", "--springs", wrong, cwd=tmp_path, code=2)
        assert "expected LAYER=K or LAYER=KX,KY,KZ" in done.stderr


def test_springs_replace_the_axes_of_a_file_that_they_hold(tmp_path):
    """A node of a file that is held along y and z has a spring along y, and keeps its support along z."""
    graph = compas_graph(flag="[false, true, true]", edges='{"1": {"group": "a"}}')
    (tmp_path / "a.json").write_text(graph.replace('"is_anchor": true', '"is_anchor": [1, 0, 1]'))
    reading = read_net(tmp_path / "a.json", ImportOptions(springs=("a", (0.0, 1e6, 0.0))))
    assert reading.fixed.tolist() == [[True, False, True], [False, False, True]]
    assert reading.spring.tolist() == [[0.0, 1e6, 0.0]] * 2


def facade(s):
    """Draw three chains of vertical cables between supports and horizontal ones; return the supports."""
    for i in range(5):
        for j in range(4):
            if i < 4:
                s.line((2 * i, 0, 2 * j), (2 * i + 2, 0, 2 * j), "level")
            if j < 3 and 0 < i < 4:
                s.line((2 * i, 0, 2 * j), (2 * i, 0, 2 * j + 2), "upright")
    return [(x, 0, z) for x in range(0, 10, 2) for z in range(0, 8, 2) if x in (0, 8) or z in (0, 6)]


def hung_deck(s):
    """Draw a sagging cable between two masts with stays, hangers and a deck; return the supports."""
    sag = [(0, 0, 10), (4, 0, 7), (8, 0, 6), (12, 0, 7), (16, 0, 10)]
    for a, b in itertools.pairwise(sag):
        s.line(a, b, "main")
    deck = [(0, 0, 2), *((x, 0, 2) for x, _, _ in sag[1:-1]), (16, 0, 2)]
    for k, (a, b) in enumerate(itertools.pairwise(deck)):
        s.line(a, b, "deck")
        if k:
            s.line(a, sag[k], "hanger")
    for x, away in ((0, -6), (16, 6)):
        s.line((x, 0, 0), (x, 0, 5), "mast")
        s.line((x, 0, 5), (x, 0, 10), "mast")
        s.line((x, 0, 10), (x + away, 0, 0), "stay")
    return [(0, 0, 0), (16, 0, 0), (-6, 0, 0), (22, 0, 0), (0, 0, 2), (16, 0, 2)]


@pytest.mark.parametrize("draw, bars, cables", [(facade, [], ["upright"]), (hung_deck, ["mast"], ["hanger"])])
def test_vertical_cables_are_not_bars(tmp_path, draw, bars, cables):
    """Vertical cables of a facade and hangers. Only a mast, in two parts, carries compression."""
    sketch = Sketch("m")
    for place in draw(sketch):
        sketch.space.add_point(sketch.at(*place), dxfattribs={"layer": "held"})
    _, net, lines = imported(sketch.save(tmp_path / "a.dxf"), supports="held")
    output, text = "\n".join(lines), (tmp_path / "net" / "net.toml").read_text()
    assert (net.prestress[net.bar] == 0.0).all() and (net.prestress[~net.bar] == 50e3).all()
    assert re.findall(r"^\[group\.(.*)\]", text, re.M) == bars
    assert re.findall(r'group "(.*)": vertical, imported as kind', output) == bars
    assert re.findall(r'group "(.*)": vertical, imported as cables; for posts or struts', output) == cables


def test_compas_files_of_both_versions_are_imported(tmp_path):
    """A Graph of COMPAS 2 in inches, a Mesh of COMPAS 1 with edge data: nodes, supports, force densities."""
    x = {"0": (0, 0, 0), "1": (100, 0, 0), "7": (100, 100, 50), "3": (0, 100, 0)}
    attributes = {key: dict(zip("xyz", place), is_anchor=key != "7") for key, place in x.items()}
    edge = {"0": {"1": {"q": 2.0}}, "1": {"7": {"q": 3.0}}, "7": {"3": {"q": 4.0}}, "3": {}}
    graph = {"default_node_attributes": {"x": 0.0, "y": 0.0, "z": 0.0}, "node": attributes, "edge": edge}
    (tmp_path / "graph.json").write_text(json.dumps({"dtype": "compas.datastructures/Graph", "data": graph}))
    _, net, _ = imported(tmp_path / "graph.json", unit="in")
    assert net.node_id.tolist() == [0, 1, 7, 3] and net.fixed.all(1).tolist() == [True, True, False, True]
    assert net.x == pytest.approx(0.0254 * np.array(list(x.values())), abs=ROUNDING)
    assert net.force_density == pytest.approx(np.array([2.0, 3.0, 4.0]) / 0.0254, rel=1e-15)
    mesh = {"attributes": {}, "dva": {"x": 0.0, "y": 0.0, "z": 0.0}, "vertex": attributes}
    mesh |= {"face": {"0": ["0", "1", "7", "3"]}, "edgedata": {"1-7": {"q": 5.0, "group": "edge"}}}
    (tmp_path / "mesh.json").write_text(json.dumps({"dtype": "compas.datastructures/Mesh", "value": mesh}))
    reading = read_net(tmp_path / "mesh.json", ImportOptions(unit="mm"))
    assert len(reading.net.ends) == 4 and reading.drawing.layers == ["cables", "edge"]
    assert np.nansum(reading.drawing.force_density) == 5e3  # N/mm
    assert "force densities in N/mm, written in N/m" in reading.lines[0]


def test_the_first_job_finds_the_form_of_force_densities(tmp_path):
    """q of 2 and 4 kN/m at a node between two supports: it lies at two thirds, and if it is there, it stays
    with q times length as prestress. Without q at a third edge, as without any, the placeholder stays.
    Form finding preloads springs at all nodes. Elements of negative q are bars, upright or not, and the
    cables of their group stay cables.
    """
    nodes = {
        key: {"x": x, "y": 0.0, "z": 0.0, "is_anchor": x != 2.0} for key, x in zip("012", (0.0, 2.0, 6.0))
    }
    edges = {"0": {"1": {"q": 2e3}}, "1": {"2": {"q": 4e3}}}

    def first(name, edges, **options):
        """Import a graph of the nodes; return its first job, its net, and the report."""
        (tmp_path / "a.json").write_text(json.dumps({"node": nodes, "edge": edges}))
        return imported(tmp_path / "a.json", name, **options)

    first("a", edges)
    with netfall.run(tmp_path / "a" / "a.toml") as result:
        assert result.form_finding["position"][1] == pytest.approx([4.0, 0.0, 0.0], abs=1e-9)
        assert result.form_finding["tension"] == pytest.approx([8e3, 8e3], rel=1e-9)
    nodes["1"]["x"] = 4.0
    job, net, _ = first("found", edges)
    assert job.form_finding is None and net.prestress == pytest.approx([8e3, 8e3], rel=1e-12)
    first("sprung", edges, springs=("cables", (1e6, 1e6, 1e6)))
    with netfall.run(tmp_path / "sprung" / "sprung.toml", {"load.self_weight": False}) as result:
        assert result.statics["tension"][-1] == pytest.approx([8e3, 8e3], rel=1e-9)
    struts = {"0": {"1": {"q": -2e3, "group": "strut"}}, "1": {"2": {"q": -4e3, "group": "strut"}}}
    _, net, lines = first("pushed", struts)
    assert net.bar.all() and net.prestress == pytest.approx([-8e3, -8e3], rel=1e-12)
    assert '"strut": the file has negative force densities in it, imported as kind' in "\n".join(lines)
    _, net, _ = first("mixed", {"0": {"1": {"q": 2e3}}, "1": {"2": {"q": -4e3}}})
    assert net.bar.tolist() == [False, True] and net.group_names == ["cables", "cables_struts"]
    taken = {"0": {"1": {"q": 2e3}, "2": {"q": 1e3, "group": "cables_struts"}}, "1": {"2": {"q": -4e3}}}
    _, net, _ = first("taken", taken)
    assert net.bar.tolist() == [False, False, True]
    edges["0"]["2"] = {}
    for q, method in ((2e3, True), (None, False)):
        edges["0"]["1"]["q"] = edges["1"]["2"]["q"] = q
        job, *_ = first(f"{method}", edges)
        assert job.cable.prestress == 50e3
        assert (job.form_finding.method == "force_density") is method


@pytest.mark.parametrize("pz, count", [(0.0, 0), (-1e3, 1)])
def test_omitted_loads_of_compas_nodes_are_named(tmp_path, pz, count):
    """A load of 1 kN at one of two nodes."""
    (tmp_path / "a.json").write_text(compas_graph().replace('{"x": 0.0', f'{{"pz": {pz}, "x": 0.0'))
    left_out = "left out: px, py, pz of 1 nodes: give load_x, load_y, load_z in nodes.csv"
    assert report(tmp_path / "a.json").count(left_out) == count


def test_a_name_of_two_lines_is_one_line_in_the_tables(tmp_path):
    """No cell of a table has a line break, or a blank at its end. Names with one and two blanks differ."""
    nodes = {key: {"x": float(key), "y": 0.0, "z": 0.0, "is_anchor": key != "1"} for key in "012"}
    edges = {"0": {"1": {"group": "a\nb "}}, "1": {"2": {"group": "a  b"}}, "2": {}}
    data = {"default_node_attributes": {}, "node": nodes, "edge": edges}
    (tmp_path / "a.json").write_text(json.dumps({"dtype": "compas.datastructures/Graph", "data": data}))
    job, net, _ = imported(tmp_path / "a.json", unit="m")
    assert net.group_names == ["a  b", "a b"] and '# [group."a b"]' in job.text


def compas_graph(x="4.0", flag="true", edges='{"1": {"q": 2.0}}', unit="m", key="1") -> str:
    """Return a Graph of two held nodes and an edge as JSON, with one of its values replaced."""
    nodes = f'{{"0": {{"x": 0.0, "is_anchor": true}}, "{key}": {{"x": {x}, "is_anchor": {flag}}}}}'
    edge = f'{{"0": {edges}, "1": {{}}}}'.replace('"1"', f'"{key}"')
    return f'{{"node": {nodes}, "edge": {edge}, "attributes": {{"unit": "{unit}"}}}}'


def test_keys_of_more_than_64_bits_get_new_ids(tmp_path):
    """A key of 23 digits cannot be the id of a node."""
    (tmp_path / "a.json").write_text(compas_graph(key="9" * 23))
    reading = read_net(tmp_path / "a.json", ImportOptions())
    assert reading.drawing.keys is None and len(reading.net.ends) == 1


def test_parts_of_a_split_edge_have_its_force(tmp_path):
    """1 kN/m over 8 m are 8 kN in all parts; 0.1 N/m over 3 m are 0.3 N, with 2 m on another edge."""
    corners = {"0": (0, 0), "1": (8, 0), "2": (2, -3), "3": (2, 5), "4": (9, 0), "5": (6, 0)}
    nodes = {key: {"x": x, "y": y, "z": 0.0, "is_anchor": True} for key, (x, y) in corners.items()}
    edges = {"0": {"1": {"q": 1e3}}, "2": {"3": {"q": 500.0}}, "5": {"4": {"q": 0.1}}}
    (tmp_path / "a.json").write_text(json.dumps({"node": nodes, "edge": edges}))
    force = imported(tmp_path / "a.json", split=True)[1].prestress
    assert sorted(force) == pytest.approx([0.3, 4e3, 4e3, 8e3, 8e3, 8e3], rel=1e-15)


def vtk_grid(x, cells) -> vtkUnstructuredGrid:
    """Return a grid of VTK of points (n, 3). cells : kinds, and rows of points"""
    grid, points = vtkUnstructuredGrid(), vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(np.array(x, float), deep=1))
    grid.SetPoints(points)
    for kind, rows in cells:
        grid.InsertNextCell(kind, len(rows), list(rows))
    return grid


def vtk_writer(grid: vtkUnstructuredGrid, path) -> vtkXMLUnstructuredGridWriter:
    """Return VTK's writer of a grid to a file."""
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    return writer


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended raw", "Appended encoded"])
@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZMA"])
def test_vtu_files_of_every_encoding_are_imported(tmp_path, mode, compressor):
    """Polylines and a quadrangle, written by VTK, with several compressed blocks of many points."""
    count = 9000  # 216 kB; VTK compresses blocks of 32 kB
    x = np.column_stack([np.arange(count) * 0.5, np.arange(count) % 7, np.sqrt(np.arange(count))])
    corners = (0, 1, count - 1, count - 2)
    grid = vtk_grid(x, ((VTK_POLY_LINE, range(count - 2)), (VTK_QUAD, corners)))
    fixed = numpy_to_vtk((np.arange(count) % 10 == 0).astype(np.uint8), deep=1)
    fixed.SetName("fixed")
    grid.GetPointData().AddArray(fixed)
    writer = vtk_writer(grid, tmp_path / "net.vtu")
    getattr(writer, f"SetDataModeTo{mode.split()[0]}")()
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.SetEncodeAppendedData("encoded" in mode)
    writer.Write()
    reading = read_net(tmp_path / "net.vtu", ImportOptions())
    assert (reading.net.x == x).all() and reading.held.sum() == count / 10
    assert len(reading.net.ends) == count - 3 + 3  # a side of the quadrangle is an element of the polyline


def test_cells_of_a_grid_are_lines_or_counted(tmp_path):
    """Curves, strips and solids have no straight lines and are counted."""
    x = [(0, 0, 0), (4, 0, 0), (2, 0, 0.25), (4, 3, 0), (6, 10, 0), (6, 18, 0), (0, 18, 0), (0, 10, 0)]
    cells = (
        (VTK_QUADRATIC_EDGE, (0, 1, 2)),
        (VTK_QUAD, (4, 5, 6, 7)),
        (VTK_TRIANGLE_STRIP, (7, 4, 6, 5)),
        (VTK_TETRA, (0, 1, 3, 2)),
        (VTK_VERTEX, (0,)),
    )
    vtk_writer(vtk_grid(x, cells), tmp_path / "grid.vtu").Write()
    reading = read_net(tmp_path / "grid.vtu", ImportOptions(supports="outline"))
    assert sorted(lengths(reading)) == [6.0, 6.0, 8.0, 8.0]
    names = ("vertex", "triangle strip", "tetra", "quadratic edge")
    assert [line for line in reading.lines if line.startswith("left out")] == [
        f"left out: cells of type {name}, no straight line or face: 1" for name in names
    ]


def data_array(name: str, text, kind="Int64", components=1) -> str:
    """Return an array of a VTU file."""
    head = f'type="{kind}" Name="{name}" NumberOfComponents="{components}" format="ascii"'
    return f"<DataArray {head}>{text}</DataArray>"


def vtu(points: int, cells: int, places: str, of_cells, more="") -> str:
    """Return a VTU file with a number of points at these positions and cells. more : arrays of cells"""
    piece = f'<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">'
    places = f"<Points>{data_array('Points', places, 'Float64', 3)}</Points>"
    data = f"<Cells>{''.join(of_cells)}</Cells><CellData>{more}</CellData></Piece>"
    grid = f"<UnstructuredGrid>{piece}{places}{data}</UnstructuredGrid>"
    return f'<VTKFile type="UnstructuredGrid">{grid}</VTKFile>'


def line_grid(connectivity: str, more="") -> str:
    """Return a VTU file of two points and a line between points. more : arrays of cells"""
    offsets = data_array("offsets", len(connectivity.split()))
    cells = data_array("connectivity", connectivity), offsets, data_array("types", "3")
    return vtu(2, 1, "0 0 0 1 0 0", cells, more)


WORD, MET = data_array("group", "97 0", "String"), compas_graph(unit="meters")
REFUSED = [  # a file, its text and the error
    ("a.dxf", "not a drawing\n", "not a DXF file that can be read"),
    ("a.json", '{"vertices": 3}', "no edges. Give a Graph"),
    ("a.vtu", "<VTKFile type='PolyData'/>", "holds no UnstructuredGrid"),
    ("a.stl", "solid", "one of the endings .dxf, .json, .vtu"),
    ("a.json", MET, 'no unit that is known ("meters" in its attributes). Give --unit'),
    ("a.json", compas_graph(x='"far"'), "node 1: expected three coordinates, not ['far', 0.0, 0.0"),
    ("a.json", compas_graph(x="1e300"), "a coordinate is not a number, or larger than 1e+12"),
    ("a.json", compas_graph(flag='"false"'), "node 1, is_anchor: expected a number, true or false, not"),
    ("a.json", compas_graph(flag="[]"), "node 1, is_anchor: expected one flag or three (x, y, z), not []"),
    (
        "a.json",
        compas_graph(flag="[1, 1, 1, 0]"),
        "node 1, is_anchor: expected one flag or three (x, y, z), not [1, 1",
    ),
    ("a.json", compas_graph(edges='{"9": {}}'), "edge 0-9: there is no node 9"),
    ("a.json", compas_graph(edges="[1]"), "edge 0: expected a JSON object, not [1]"),
    ("a.json", compas_graph(edges='{"1": [7]}'), "edge 0-1: expected a JSON object, not [7]"),
    ("a.json", compas_graph(edges='{"1": {"q": "1e4"}}'), "edge 0-1, q: expected a number, true or false"),
    ("a.json", '{"vertex": {"0": {}, "1": {}}, "face": {"5": [0, 1, 7]}}', "face 5: there is no vertex 7"),
    ("a.json", '{"start": [0, 0, 0], "end": [1, 0]}', "a line: expected three coordinates, not [1, 0]"),
    ("a.json", f"[{compas_graph()}, {compas_graph(unit='mm')}]", "expected one unit, not m and mm"),
    ("a.json", "[" * 100_000, "not a JSON file that can be read"),
    ("a.vtu", line_grid("0 9"), "cells name points from 0 to 9 of 2"),
    ("a.vtu", line_grid("0"), "cell 0 has 1 point; expected 2"),
    ("a.vtu", line_grid("0 1", WORD), "array group: expected one whole number"),
]


@pytest.mark.parametrize("name, text, words", REFUSED, ids=itertools.count())
def test_a_file_that_is_no_drawing_is_refused_with_the_place(tmp_path, name, text, words):
    """An unknown suffix, no lines, and values and keys of types that COMPAS and VTK do not write."""
    (tmp_path / name).write_text(text)
    (line,) = error_lines(report, tmp_path / name)
    assert line.startswith(f"{tmp_path / name}: ") and words in line


@pytest.mark.parametrize(
    "name, values, words",
    [
        ("group", [[5, 6]], "group: expected one whole number per"),
        ("group", [np.nan], "group: expected one whole number per"),
        ("node_id", [[1, 0], [2, 0]], "node_id: expected one whole number per"),
        ("node_id", [1.5, 1.0], "node_id: expected one whole number per"),
        ("fixed", [1.0, np.nan], "fixed: expected one or 3 whole numbers per"),
    ],
)
def test_arrays_of_a_grid_must_be_integers(tmp_path, name, values, words):
    """Fractions, values that are not numbers, and several values instead of one."""
    arrays = {name: np.array(values)}
    of_points, of_cells = (arrays, {}) if len(values) == 2 else ({}, arrays)
    write_vtu(tmp_path / "a.vtu", np.eye(3)[:2], np.array([[0, 1]]), of_points, of_cells, "")
    with pytest.raises(InputError, match=f"a.vtu: .* array {words}"):
        report(tmp_path / "a.vtu")


def two_roofs(sketch):
    """Draw the net, and half of it again 20 m away, as a separate part."""
    sketch.net()
    for a, b, layer in sketch.pieces():
        if max(a[0], b[0]) <= 3:
            shifted = [(x + 20.0, y, z) for x, y, z in (sketch.corner(*a), sketch.corner(*b))]
            sketch.line(*shifted, layer)
    return sketch


def test_the_outline_of_each_roof_of_a_drawing_is_held(tmp_path):
    """Nets of 5 x 4 and 4 x 4 nodes have 14 and 12 nodes on outlines. The frame of a sheet is not a roof."""
    sketch = two_roofs(Sketch("m"))
    for a, b in [((-5, -5), (50, -5)), ((50, -5), (50, 20)), ((50, 20), (-5, 20)), ((-5, 20), (-5, -5))]:
        sketch.line(a, b, "frame")
    reading = read_net(sketch.save(tmp_path / "two.dxf"), ImportOptions(supports="outline"))
    text = "\n".join(reading.lines)
    assert "supports: 26 of 40 nodes are held (nodes on the outline of each of 2 parts" in text
    assert reading.held.sum() == 26 and len(reading.net.x) == 36
    assert "(4 of 59 elements) are not joined to the rest of the net, and without a support: LEFT OUT" in text
    assert "LEFT OUT\n    4 elements at (-5, -5, 0), layer frame\n" in text
    assert "(24 of 59 elements) are not joined" in text and "have their own supports" in text


def test_omitted_lines_are_named_for_any_number_of_held_parts(tmp_path):
    """Six small roofs are near a large one, each held. Two stray lines behind them are omitted."""
    sketch = Sketch("m")
    sketch.net()
    for k in range(6):
        square = [(20.0 * (k + 1) + x, y, 0.0) for x, y in ((0, 0), (4, 0), (4, 4), (0, 4), (0, 0))]
        for a, b in itertools.pairwise(square):
            sketch.line(a, b, "small")
            sketch.space.add_point(sketch.at(*a), dxfattribs={"layer": "held"})
    for y in (0.0, 2.0):
        sketch.line((200.0, y, 0.0), (203.0, y, 0.0), "stray")
    sketch.space.add_point(sketch.at(*sketch.corner(0, 0)), dxfattribs={"layer": "held"})
    text = "\n".join(read_net(sketch.save(tmp_path / "many.dxf"), ImportOptions(supports="held")).lines)
    assert "loose part (2): parts (2 of 57 elements) are not joined to the rest of the net" in text
    assert "1 element at (200, 2, 0), layer stray" in text and "loose part (6): parts (24 of 57" in text


def test_the_largest_part_without_a_support_is_a_warning(tmp_path):
    """All points are on the smaller roof. The larger roof is omitted, with a warning."""
    sketch = two_roofs(Sketch("m"))
    for i, j in [(i, j) for i in range(4) for j in range(4) if i in (0, 3) or j in (0, 3)]:
        x, y, z = sketch.corner(i, j)
        sketch.space.add_point((x + 20.0, y, z), dxfattribs={"layer": "held"})
    reading = read_net(sketch.save(tmp_path / "two.dxf"), ImportOptions(supports="held"))
    text = "\n".join(reading.lines)
    assert "warning: largest part left out: 31 of 55 elements have no support. Give --supports" in text
    assert len(reading.net.ends) == 24 and reading.net.x[:, 0].min() == 20.0


def test_invisible_lines_are_omitted_and_counted(tmp_path):
    """Invisible lines and polylines of a DXF, invisible sides of faces, hidden edges of COMPAS."""
    sketch = Sketch("m")
    sketch.line((0, 0, 0), (4, 0, 0), "a")
    sketch.space.add_line((0, 1, 0), (4, 1, 0), dxfattribs={"layer": "a", "invisible": 1})
    sketch.space.add_lwpolyline([(0, 2), (4, 2)], dxfattribs={"layer": "a", "invisible": 1})
    face = sketch.space.add_3dface([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], dxfattribs={"layer": "b"})
    face.set_edge_visibility(2, False)
    triangle = sketch.space.add_3dface([(0, 0, 0), (0, 4, 0), (-4, 0, 0)], dxfattribs={"layer": "c"})
    triangle.set_edge_visibility(3, False)
    mesh = sketch.space.add_polyface(dxfattribs={"layer": "d"})
    mesh.append_face([(8, 0, 0), (12, 0, 0), (12, 4, 0)])
    next(v for v in mesh.vertices if v.is_face_record).dxf.vtx1 *= -1
    reading = read_net(sketch.save(tmp_path / "hidden.dxf"), ImportOptions(supports="outline"))
    drawing = reading.drawing
    of = lambda name: sum(drawing.layers[k] == name for k in drawing.layer.tolist())
    assert (of("a"), of("b"), of("c"), of("d")) == (1, 3, 2, 2)
    output = "\n".join(reading.lines)
    assert "left out: 1 LINE, which is invisible" in output and "1 LWPOLYLINE, which is invisible" in output
    assert "left out: 3 side of a face, which is invisible" in output
    node = {str(k): {"x": float(k), "y": float(k * k), "z": 0.0} for k in range(4)}
    edge = {"0": {"1": {}, "2": {"visible": False}}, "1": {"2": {}, "3": {"hidden": True}}, "2": {"3": {}}}
    graph = {"node": node, "edge": edge, "default_edge_attributes": {"group": "rope", "q": 7.0}}
    graph["edge"]["2"]["3"] = {"group": "mast", "q": -1.0}
    (tmp_path / "g.json").write_text(json.dumps({"data": graph}))
    reading = read_net(tmp_path / "g.json", ImportOptions(supports="outline"))
    assert "left out: 2 edges, which are hidden" in reading.lines
    assert [reading.drawing.layers[k] for k in reading.drawing.layer] == ["rope", "rope", "mast"]
    assert reading.drawing.force_density.tolist() == [7.0, 7.0, -1.0]


def test_sides_of_faces_have_the_group_of_their_face(tmp_path):
    """Three quadrangles in a row have groups 5, 6 and 7. A file with a ghost of another piece is refused."""
    corners = "0 1 5 4 1 2 6 5 2 3 7 6"
    points = " ".join(f"{i} {j} 0" for j in range(2) for i in range(4))
    arrays = (
        data_array("connectivity", corners),
        data_array("offsets", "4 8 12"),
        data_array("types", "9 9 9"),
    )
    groups = data_array("group", "5 6 7", "Int32")
    path = tmp_path / "faces.vtu"
    path.write_text(vtu(8, 3, points, arrays, groups))
    of = lambda drawing: [drawing.layers[k] for k in drawing.layer.tolist()]
    drawing = read_net(path, ImportOptions(supports="outline")).drawing
    assert sorted(of(drawing)) == ["group 5"] * 4 + ["group 6"] * 3 + ["group 7"] * 3
    path.write_text(vtu(8, 3, points, arrays, groups + data_array("vtkGhostType", "0 1 0", "UInt8")))
    with pytest.raises(InputError, match="ghosts or hidden cells"):
        report(path)


def test_names_of_layers_ignore_case(tmp_path):
    """A layer of supports and layers to read in other case. Two spellings are one layer, with a note."""
    sketch = Sketch("m").net()
    sketch.space.add_line(sketch.corner(0, 0), sketch.corner(0, 1), dxfattribs={"layer": "HELD"})
    sketch.space.add_circle(sketch.corner(4, 3), 0.1, dxfattribs={"layer": "Held"})
    sketch.space.add_lwpolyline([(50, 50), (51, 50)], dxfattribs={"layer": "other"})
    path = sketch.save(tmp_path / "case.dxf")
    reading = read_net(path, ImportOptions(supports="held", layers=["X", "Y"]))
    output = "\n".join(reading.lines)
    assert "supports: 3 of 20 nodes are held" in output
    assert 'layers "HELD" and "Held" differ by upper and lower case alone, and are one' in output
    assert [name.lower() for name in reading.drawing.layers] == ["held", "x", "y"]


def test_an_unknown_layer_is_refused_with_all_layers(tmp_path):
    """Layers of a DXF file, groups of COMPAS and VTU. Lines of other layers are counted."""
    path = Sketch("m").net().save(tmp_path / "a.dxf")
    (tmp_path / "a.json").write_text(compas_graph(edges='{"1": {"group": "rope"}}'))
    write_vtu(tmp_path / "a.vtu", np.eye(3)[:2], np.array([[0, 1]]), {}, {"group": [4]}, "")
    for name, known in (("dxf", "x, y"), ("json", "rope"), ("vtu", "group 4")):
        with pytest.raises(InputError, match=f"--layers 123: expected .*; known: {known} "):
            report(tmp_path / f"a.{name}", layers=["123"])
    reading = read_net(path, ImportOptions(layers=["y"], supports="outline"))
    assert reading.drawing.layers == ["y"] and len(reading.net.ends) == 15
    assert 'left out: 16 lines and curves on layer "x", which --layers does not name' in reading.lines


def test_gaps_within_the_digits_of_a_drawing_are_not_faults(tmp_path):
    """Ends 5e-7 mm apart are joined without a message; 5e-3 mm are named."""
    for gap, count in ((5e-7, 0), (5e-3, 1)):
        sketch = Sketch("mm").net(skip=(4,))
        a, b = sketch.corner(1, 0), sketch.corner(2, 0)
        sketch.line((a[0] + 1e-3 * gap, a[1], a[2]), b)
        lines = read_net(sketch.save(tmp_path / "gap.dxf"), ImportOptions()).lines
        assert [line[:13] for line in lines if line.startswith("gap")] == ["gap (1): ends"] * count


def test_missing_and_empty_drawings_are_refused(tmp_path):
    """Also one that is cut short."""
    whole = Sketch().save(tmp_path / "empty.dxf").read_text().splitlines()
    (tmp_path / "cut.dxf").write_text("\n".join(whole[:13]))
    for name, words in (
        ("cut.dxf", "not a DXF file that can be read: it is cut short"),
        ("empty.dxf", "no lines of a net"),
        ("none.dxf", "No such file"),
    ):
        assert words in error_lines(report, tmp_path / name)[0]


def test_tables_made_by_hand_are_not_overwritten(tmp_path):
    """A folder with other tables is refused. A new import of the drawing keeps a changed job."""
    path = Sketch().net().save(tmp_path / "roof.dxf")
    (tmp_path / "nodes.csv").write_text("id, x, y, z\n")
    with pytest.raises(InputError, match="that no import wrote"):
        import_file(path, tmp_path, ImportOptions(), print)
    import_file(path, tmp_path / "roof", ImportOptions(), lambda line: None)
    job = tmp_path / "roof" / "roof.toml"
    job.write_text(job.read_text().replace("50e3", "70e3"))
    lines = []
    import_file(path, tmp_path / "roof", ImportOptions(), lines.append)
    assert "70e3" in job.read_text() and "existing job, not changed" in lines[-2]


def test_the_legend_of_many_groups_is_true():
    """15 groups have 15 to 1 elements. The last 4, with 10 elements, share an entry and a colour."""
    _, axes = plt.subplots()
    group = np.repeat(np.arange(15), np.arange(15, 0, -1))
    add_groups(axes, np.zeros((120, 2, 2)), group, [f"g{k}" for k in range(15)], 1.0)
    drawn = {lines.get_label(): len(lines.get_segments()) for lines in axes.collections}
    assert drawn == {f"g{k}, {15 - k}": 15 - k for k in range(11)} | {"4 more groups, 10": 10}
    assert len({tuple(lines.get_colors()[0]) for lines in axes.collections}) == 12


def test_marks_of_faults_cover_those_of_supports(tmp_path, monkeypatch):
    """A fault at a support is visible."""
    figures = []
    monkeypatch.setattr(canvas, "save", lambda figure, path: figures.append(figure))
    x, fixed = np.eye(3)[:2], np.ones((2, 3), bool)
    draw_imported_net(x, np.array([[0, 1]]), ["a"], fixed, ~fixed, [x[0]], "net", tmp_path / "net.png")
    order = {line.get_label(): line.get_zorder() for line in figures[0].axes[0].lines}
    assert order["faults, 1"] > order["supports, 2"]


def test_a_large_drawing_is_read_in_seconds(tmp_path):
    """25,000 lines with joining and all checks take 2 s of a core; the limit of 8 s allows other load."""
    sketch = Sketch("mm", cells=(112, 111))
    path = sketch.save_at_once(tmp_path / "large.dxf")
    begin = time.process_time()
    reading = read_net(path, ImportOptions())
    assert time.process_time() - begin < 8.0
    assert len(reading.net.ends) > 25_000 and same_nodes(reading.net, places(sketch))
