"""Import of DXF: lines, polylines, curves and faces of the model space, with blocks exploded.

ezdxf provides the geometry of entities: corners, splines, faces, and the matrices of block references.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from netfall.exchange.drawings.drawing import MAX_COORDINATE, Drawing, alike, counted

POLYLINES = ("LWPOLYLINE", "POLYLINE")
CURVED_ENTITIES = ("ARC", "CIRCLE", "ELLIPSE")
SPLINES = ("SPLINE", "HELIX")
FACES = ("3DFACE", "SOLID", "TRACE", "MESH")
UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 10: "yd", 14: "dm"}  # usual ones, by $INSUNITS
FRAME = 16  # vertex flag: control point of a fitted polyline, which is not on the polyline
STRAIGHT_BULGE = 1e-6  # bulge = 2 x depth of an arc / chord; ezdxf.path has the same limit
STRAIGHT_ARC = 1e-6  # degrees; ezdxf takes a smaller arc for a circle
MOST_WORDS = 100  # characters of an ezdxf error that are shown


def read_dxf(path: Path, supports: list[str]) -> Drawing:
    """Read the lines of a DXF file, in its own unit.

    supports : names of layers whose circles and blocks are points

    Raises errors as in `reading.READERS`.
    """
    import ezdxf

    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError, ValueError, IndexError, StopIteration) as error:
        if isinstance(error, OSError) and error.strerror:  # an error of the system, not of ezdxf
            raise
        raise ValueError(str(error) or "it is cut short") from None  # ezdxf says nothing of first sections
    reader = _Reader(document, supports)
    for entity in document.modelspace():
        reader.add(entity)
    return reader.drawing()


class _Reader:
    """Collector of the lines, points and curves of a DXF file, with counts of omitted entities."""

    def __init__(self, document: Any, supports: list[str]):
        self.document, self.supports = document, [name.lower() for name in supports]
        self.lines: list[tuple[str, Any]] = []  # layer and content of each line, point and curve
        self.points: list[tuple[str, Any]] = []
        self.curves: list[tuple[str, Any]] = []
        self.kinds: Counter[Any] = Counter()
        self.blocks: Counter[int] = Counter()
        self.left: Counter[Any] = Counter()
        self.spelled = {layer.dxf.name.lower(): layer.dxf.name for layer in document.layers}
        self.spellings: set[Any] = set()
        self.frozen = {layer.dxf.name.lower() for layer in document.layers if layer.is_frozen()}
        self.dark = self.frozen | {layer.dxf.name.lower() for layer in document.layers if layer.is_off()}

    def layer_name(self, layer: str) -> str:
        """Return the first spelling of a layer's name, because DXF ignores upper and lower case."""
        self.spellings.add(layer)
        return self.spelled.setdefault(layer.lower(), layer)

    def holds(self, layer: str) -> bool:
        """Whether a layer marks supports."""
        return layer.lower() in self.supports

    def is_shown(self, layer: str) -> bool:
        """Whether a layer is shown; if not, count the entity as omitted."""
        if layer.lower() in self.dark:
            self.left[f'on layer "{layer}", which is off or frozen'] += 1
            return False
        return True

    def add(
        self, entity: Any, layer: str | None = None, blocks: tuple[str, ...] = (), matrix: Any = None
    ) -> None:
        """Add an entity, or count the reason for its omission.

        layer : of the block reference that draws it, None: the entity is in the model space
        blocks : names of the blocks that contain it, the outermost first
        matrix : from the coordinates of its block to those of the drawing, None: the same
        """
        try:
            self._add(entity, layer, blocks, matrix)
        except Exception as error:  # ezdxf raises errors of many kinds for a faulty entity
            reason = f"{type(error).__name__}: {error}"[:MOST_WORDS]
            self.left[f"{entity.dxftype()}, which cannot be read ({reason})"] += 1

    def _add(self, entity: Any, layer: str | None, blocks: tuple[str, ...], matrix: Any) -> None:
        """Add an entity by its type; raises errors of ezdxf."""
        kind, own_layer = entity.dxftype(), entity.dxf.layer
        layer = self.layer_name(own_layer if layer is None or own_layer != "0" else layer)
        if entity.dxf.get("invisible", 0):
            self.left[f"{kind}, which is invisible"] += 1
        elif kind == "INSERT" and not self.holds(layer) and layer.lower() not in self.frozen:
            self._explode(entity, layer, blocks, matrix)
        elif not self.is_shown(layer):
            return
        elif kind == "POINT" or (self.holds(layer) and kind in ("CIRCLE", "INSERT")):
            grid = entity.multi_insert() if kind == "INSERT" and entity.mcount > 1 else [entity]
            points = _finite_points(_transformed([_marked_point(copy) for copy in grid], matrix))
            self.points += [(layer, point) for point in points]
            self.kinds[kind] += 1
        elif kind == "MESH" and entity.dxf.subdivision_levels:
            self.left["MESH, of which a smoothed surface is drawn: set its smoothness to 0"] += 1
        elif kind in ("LINE", *POLYLINES, *CURVED_ENTITIES, *SPLINES, *FACES):
            parts, undrawn = _parts(entity)
            self._draw([_transformed(part, matrix) for part in parts], layer)
            self.left += undrawn
            self.kinds[kind] += 1
        else:
            self.left[f"{kind}, not a line"] += 1

    def _explode(self, insert: Any, layer: str, blocks: tuple[str, ...], matrix: Any) -> None:
        """Add the entities of a block reference, or count the reason why it has none."""
        from ezdxf.xclip import XClip

        name, block = insert.dxf.name, insert.block()
        if block is None:
            self.left[f'INSERT of block "{name}", which the file does not hold'] += 1
        elif block.block.is_xref or block.block.is_xref_overlay:
            file = block.block.dxf.xref_path
            advice = "bind it in the drawing, or import that file"
            self.left[f'INSERT of "{name}", which is another file ({file}): {advice}'] += 1
        elif name.lower() in blocks:
            self.left[f'INSERT of block "{name}" within itself'] += 1
        else:
            if XClip(insert).is_clipping_enabled:
                self.left[f'edge that clips block "{name}" (XCLIP): the block is read whole'] += 1
            for copy in insert.multi_insert() if insert.mcount > 1 else [insert]:
                self.blocks[len(blocks) + 1] += 1
                to_drawing = copy.matrix44() if matrix is None else copy.matrix44() * matrix
                for entity in block:
                    if entity.dxftype() != "ATTDEF":  # a template of texts
                        self.add(entity, layer, (*blocks, name.lower()), to_drawing)

    def _draw(self, parts: list[Any], layer: str) -> None:
        """Add polylines, given as lists of corners, and splines."""
        for part in parts:
            if isinstance(part, list):
                self.lines += [(layer, ends) for ends in pairwise(_finite_points(part))]
            else:
                _finite_points(part.control_points)
                self.curves.append((layer, part))

    def drawing(self) -> Drawing:
        """Return the drawing that was read."""
        names = sorted({layer for layer, _ in (*self.lines, *self.points, *self.curves)})
        row = {name: k for k, name in enumerate(names)}
        number = int(self.document.header.get("$INSUNITS", 0))
        return Drawing(
            lines=np.array([ends for _, ends in self.lines], float).reshape(-1, 2, 3),
            layer=np.array([row[layer] for layer, _ in self.lines], np.int64),
            layers=names,
            curves=[(row[layer], spline) for layer, spline in self.curves],
            points=np.array([point for _, point in self.points], float).reshape(-1, 3),
            point_layer=np.array([row[layer] for layer, _ in self.points], np.int64),
            unit=UNITS.get(number),
            unit_from=f"$INSUNITS = {number}",
            read=self._read(),
            left_out=self._left_out(),
        )

    def _read(self) -> list[str]:
        """Return lines on the entities that were read."""
        lines = [counted(self.kinds)]
        if self.blocks:
            inserts = f"{sum(self.blocks.values())} blocks exploded"
            depth = f", blocks in blocks to depth {max(self.blocks)}" if max(self.blocks) > 1 else ""
            lines.append(inserts + depth)
        return lines + [f"layers {names}, and are one" for names in alike(self.spellings)]

    def _left_out(self) -> list[str]:
        """Return lines on the entities that were omitted."""
        lines = [f"{count} {reason}" for reason, count in sorted(self.left.items())]
        paper = sum(len(layout) for layout in self.document.layouts if layout.name != "Model")
        return lines + ([f"{paper} in paper space"] if paper else [])


def _parts(entity: Any) -> tuple[list[Any], Counter[str]]:
    """Return the lists of corners and splines that an entity draws, and count its undrawn parts."""
    from ezdxf.entities import Spline
    from ezdxf.math import Vec3

    kind = entity.dxftype()
    undrawn: Counter[str] = Counter()
    if kind == "LINE":
        return [[entity.dxf.start, entity.dxf.end]], undrawn
    if kind == "ARC" and 0.0 < (entity.dxf.end_angle - entity.dxf.start_angle) % 360.0 < STRAIGHT_ARC:
        return [[entity.start_point, entity.end_point]], undrawn
    if kind in CURVED_ENTITIES:
        return [Spline.from_arc(entity).construction_tool()], undrawn
    if kind in SPLINES:
        fit = entity.fit_points
        if entity.closed and not entity.control_points and not Vec3(fit[0]).isclose(fit[-1]):
            entity = entity.copy()  # ezdxf would leave it open
            entity.fit_points.append(fit[0])
        spline = entity.construction_tool()
        return [list(spline.control_points) if spline.degree == 1 else spline], undrawn
    if kind in POLYLINES:
        entity, frame = _without_spline_frame(entity)
        undrawn["vertex of the frame of a fitted polyline, which is not drawn"] = frame
        if kind == "LWPOLYLINE" or entity.is_2d_polyline or entity.is_3d_polyline:
            return [part for side in entity.virtual_entities() for part in _parts(side)[0]], +undrawn
    sides = _sides(entity)
    undrawn["side of a face, which is invisible"] = sum(not visible for visible in sides.values())
    return [list(side) for side, visible in sides.items() if visible], +undrawn


def _without_spline_frame(polyline: Any) -> Any:
    """Return a polyline or mesh without the frame of its spline, and the number of vertices in that frame.

    Bulges due to rounding become zero: the radius of such arcs would be unbounded.
    """
    drawn = polyline.copy()
    if drawn.dxftype() == "LWPOLYLINE":
        drawn.set_points([(*point[:4], _bulge(point[4])) for point in drawn.get_points()])
        return drawn, 0
    drawn.vertices[:] = [vertex for vertex in drawn.vertices if not vertex.dxf.flags & FRAME]
    for vertex in drawn.vertices:
        vertex.dxf.bulge = _bulge(vertex.dxf.bulge)
    frame = len(polyline.vertices) - len(drawn.vertices)
    if frame and drawn.is_polygon_mesh:
        drawn.dxf.m_count, drawn.dxf.n_count = drawn.dxf.m_smooth_density, drawn.dxf.n_smooth_density
    return drawn, frame


def _bulge(value: float) -> float:
    """Replace a bulge due to rounding by zero."""
    return value if abs(value) >= STRAIGHT_BULGE else 0.0


def _sides(entity: Any) -> dict[tuple[Any, ...], bool]:
    """Return the sides of faces, each once, as pairs of corners, and whether a face shows the side."""
    sides: dict[tuple[Any, ...], bool] = {}
    for face, visible in _faces(entity):
        corners = [tuple(corner) for corner in face]
        for a, b, side_visible in zip(corners, [*corners[1:], corners[0]], visible, strict=True):
            side = (b, a) if (b, a) in sides else (a, b)
            if a != b:
                sides[side] = sides.get(side, False) or side_visible
    return sides


def _faces(entity: Any) -> Iterator[tuple[list[Any], list[bool]]]:
    """Yield the corners of each face, and whether the side from each corner to the next is visible."""
    from ezdxf.render import MeshBuilder

    kind = entity.dxftype()
    if kind == "POLYLINE" and entity.is_poly_face_mesh:
        for face in entity.indexed_faces()[1]:
            yield list(face.points()), [face.is_edge_visible(k) for k in range(len(face))]
    elif kind == "POLYLINE":
        for face in entity.virtual_entities():
            yield from _faces(face)
    elif kind == "MESH":
        for face in MeshBuilder.from_mesh(entity).faces_as_vertices():
            yield list(face), [True] * len(face)
    else:
        corners = entity.wcs_vertices()
        visible = entity.get_edges_visibility() if kind == "3DFACE" else [True] * 4
        if len(corners) == 3 and entity.dxf.hasattr("vtx3"):
            del visible[2]  # the third side, from a corner to itself, has no length
        yield corners, visible[: len(corners)]


def _transformed(part: Any, matrix: Any) -> Any:
    """Return a list of corners, or a spline, in the coordinates of the drawing.

    A matrix may shear: a block in a block that is scaled unequally. Points and splines remain exact; ezdxf
    loses the shear of an INSERT or a circle (version 1.4).
    """
    if matrix is None:
        return part
    return list(matrix.transform_vertices(part)) if isinstance(part, list) else part.transform(matrix)


def _finite_points(corners: list[Any]) -> list[tuple[float, float, float]]:
    """Return corners as numbers. Raises ValueError if one is not finite or too large."""
    points = [tuple(corner) for corner in corners]
    if not all(abs(value) <= MAX_COORDINATE for point in points for value in point):
        raise ValueError(f"a coordinate is not a number, or larger than {MAX_COORDINATE:g}")
    return points


def _marked_point(entity: Any) -> Any:
    """Return the position that a point, a circle or a block reference marks."""
    if entity.dxftype() == "POINT":
        return entity.dxf.location
    return entity.ocs().to_wcs(entity.dxf.center if entity.dxftype() == "CIRCLE" else entity.dxf.insert)
