"""Reading DXF: lines, polylines and curves of the model space, blocks exploded."""

import io
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np

from netfall.exchange.drawings.drawing import Drawing, alike, counted
from netfall.ground.errors import InputError

CURVES = ("LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
FACES = ("3DFACE", "SOLID", "TRACE", "MESH")
CUBICS = 16  # cubic curves that stand for a circle, an arc, an ellipse: within 7e-8 of the radius
DEEPEST = 32  # blocks in blocks
PLACES = {10: (0, 0), 20: (0, 1), 30: (0, 2), 11: (1, 0), 21: (1, 1), 31: (1, 2)}  # group code: end, axis
LAYER, PAPER, INVISIBLE = 8, 67, 60


def read_dxf(path: Path, supports: list[str], wanted: list[str] | None) -> Drawing:
    """The lines of a DXF file, in its own unit.

    supports : names of layers whose circles and blocks are points; wanted : layers to read, None: all

    Raises InputError for a file that is no DXF.
    """
    import ezdxf

    try:
        document, plain = _open(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected a DXF file") from None
    except (ezdxf.DXFError, ValueError, IndexError) as error:
        raise InputError(f"{path}: not a DXF file that can be read: {error}") from None
    reader = _Reader(document, supports, wanted)
    reader.add_lines(*plain)
    for entity in document.modelspace():
        reader.add(entity, None, 0)
    return reader.drawing()


def _open(path: Path):
    """The document, and its plain lines: ends (k, 2, 3), layers; ezdxf takes ten times as long for these."""
    import ezdxf
    from ezdxf.filemanagement import dxf_file_info

    with open(path, "rb") as file:
        binary = file.read(22).startswith(b"AutoCAD Binary DXF")
    if binary:
        return ezdxf.readfile(path), (np.zeros((0, 2, 3)), [])
    text = path.read_text(encoding=dxf_file_info(str(path)).encoding, errors="surrogateescape")
    lines, layers, rest = split_lines(text)
    return ezdxf.read(io.StringIO(rest)), (lines, layers)


class _Reader:
    """What has been found so far, layer by layer."""

    def __init__(self, document, supports, wanted):
        self.document, self.supports = document, [name.lower() for name in supports]
        self.wanted = None if wanted is None else {name.lower() for name in wanted}
        self.lines, self.line_layers, self.points, self.point_layers = [], [], [], []
        self.plain = np.zeros((0, 2, 3))
        self.kinds, self.skipped, self.hidden, self.blocks = Counter(), Counter(), Counter(), Counter()
        self.others, self.invisible, self.curves = Counter(), Counter(), []
        self.spelled = {layer.dxf.name.lower(): layer.dxf.name for layer in document.layers}
        self.spellings = set()
        off = [layer for layer in document.layers if layer.is_off() or layer.is_frozen()]
        self.off = {layer.dxf.name.lower() for layer in off}

    def called(self, layer: str) -> str:
        """The one name of a layer: upper and lower case are alike in a DXF."""
        self.spellings.add(layer)
        return self.spelled.setdefault(layer.lower(), layer)

    def holds(self, layer: str) -> bool:
        """Whether it is a layer of supports."""
        return layer.lower() in self.supports

    def shows(self, layer: str) -> bool:
        """Whether a layer is to be read; if not, that is counted."""
        if layer.lower() in self.off:
            self.hidden[layer] += 1
        elif self.wanted is not None and layer.lower() not in self.wanted and not self.holds(layer):
            self.others[layer] += 1
        else:
            return True
        return False

    def add_lines(self, lines: np.ndarray, layers: list[str]) -> None:
        """The plain lines."""
        layers = [self.called(layer) for layer in layers]
        shown = [self.shows(layer) for layer in layers]
        self.plain = lines[np.array(shown, bool)]
        self.line_layers = [layer for layer, there in zip(layers, shown, strict=True) if there]
        self.kinds["LINE"] += len(self.plain)

    def add(self, entity, layer: str | None, depth: int) -> None:
        """An entity of the model space, or of a block that stands on `layer`, at so many blocks' depth."""
        kind, own = entity.dxftype(), entity.dxf.layer
        layer = self.called(own if layer is None or own != "0" else layer)
        if entity.dxf.get("invisible", 0):
            self.invisible[kind] += 1
            return
        if kind == "INSERT" and not self.holds(layer) and layer.lower() not in self.off:
            self._explode(entity, layer, depth)
            return
        if not self.shows(layer):
            return
        self.kinds[kind] += 1
        if kind == "POINT" or (self.holds(layer) and kind in ("CIRCLE", "INSERT")):
            self.points.append(_middle(entity))
            self.point_layers.append(layer)
        elif kind == "LINE":
            self._segments([entity.dxf.start, entity.dxf.end], layer)
        elif kind in CURVES and not (kind == "POLYLINE" and _has_faces(entity)):
            self._curve(entity, layer)
        elif kind in FACES or kind == "POLYLINE":
            sides, invisible = _sides(entity)
            for side in sides:
                self._segments(side, layer)
            if invisible:
                self.invisible["side of a face"] += invisible
        else:
            self.kinds[kind] -= 1
            self.skipped[kind] += 1

    def _explode(self, insert, layer: str, depth: int) -> None:
        if depth >= DEEPEST:
            raise InputError(
                f"block {insert.dxf.name}: more than {DEEPEST} blocks in blocks; does it hold itself?"
            )
        self.blocks[depth + 1] += 1
        for one in insert.multi_insert() if insert.mcount > 1 else [insert]:
            for entity in one.virtual_entities():
                self.add(entity, layer, depth + 1)

    def _curve(self, entity, layer: str) -> None:
        """A polyline by its straight sides and its arcs; whatever is smooth as it is."""
        from ezdxf import path

        way = path.make_path(entity, segments=CUBICS)
        if not way.has_curves:
            self._segments(list(way.control_vertices()), layer)
        elif entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
            for part in entity.virtual_entities():
                self._curve(part, layer)
        else:
            self.curves.append((layer, way))

    def _segments(self, points, layer: str) -> None:
        places = [tuple(point) for point in points]
        for a, b in pairwise(places):
            self.lines.append((a, b))
            self.line_layers.append(layer)

    def drawing(self) -> Drawing:
        """All that was read."""
        names = sorted({*self.line_layers, *self.point_layers, *(layer for layer, _ in self.curves)})
        row = {name: k for k, name in enumerate(names)}
        unit, unit_from = _unit(self.document)
        return Drawing(
            lines=np.concatenate([self.plain, np.array(self.lines, float).reshape(-1, 2, 3)]),
            layer=np.array([row[name] for name in self.line_layers], np.int64),
            layers=names,
            curves=[(row[layer], way) for layer, way in self.curves],
            points=np.array(self.points, float).reshape(-1, 3),
            point_layer=np.array([row[name] for name in self.point_layers], np.int64),
            unit=unit,
            unit_from=unit_from,
            read=self._read(),
            left_out=self._left_out(),
        )

    def _read(self) -> list[str]:
        told = [counted(+self.kinds)]
        if self.blocks:
            inserts = f"{sum(self.blocks.values())} blocks exploded"
            deep = f", blocks in blocks to depth {max(self.blocks)}" if max(self.blocks) > 1 else ""
            told.append(inserts + deep)
        return told + [f"layers {words}, and are one" for words in alike(self.spellings)]

    def _left_out(self) -> list[str]:
        told = [f"{count} {kind}, which is no line" for kind, count in sorted(self.skipped.items())]
        told += [f"{n} {kind}, which is invisible" for kind, n in sorted(self.invisible.items())]
        told += [f'{n} on layer "{name}", which is off or frozen' for name, n in sorted(self.hidden.items())]
        others = sorted(self.others.items())
        told += [f'{n} on layer "{name}", which --layers does not name' for name, n in others]
        paper = sum(len(layout) for layout in self.document.layouts if layout.name != "Model")
        return told + ([f"{paper} in paper space"] if paper else [])


def _middle(entity):
    place = entity.dxf.center if entity.dxftype() == "CIRCLE" else None
    place = entity.dxf.location if entity.dxftype() == "POINT" else place
    place = entity.dxf.insert if entity.dxftype() == "INSERT" else place
    return tuple(place if entity.dxftype() == "POINT" else entity.ocs().to_wcs(place))


def _has_faces(entity) -> bool:
    return entity.is_poly_face_mesh or entity.is_polygon_mesh


def _sides(entity) -> tuple[list, int]:
    """Sides of faces as pairs of points, each once; and how many are drawn invisible."""
    corners, faces = _faces(entity)
    seen: dict[frozenset, bool] = {}
    for face, visible in faces:
        for pair, shown in zip(zip(face, [*face[1:], face[0]], strict=True), visible, strict=True):
            if len(set(pair)) == 2:
                seen[frozenset(pair)] = seen.get(frozenset(pair), False) or shown
    sides = [[corners[k] for k in sorted(pair)] for pair, shown in seen.items() if shown]
    return sides, len(seen) - len(sides)


def _faces(entity):
    """Corners, and faces: rows of corners, and whether the side from each to the next is visible."""
    from ezdxf.render import MeshBuilder

    kind = entity.dxftype()
    if kind == "3DFACE":
        corners, flags = entity.wcs_vertices(), entity.get_edges_visibility()
        if len(corners) == 3 and entity.dxf.hasattr("vtx3"):
            flags = [flags[0], flags[1], flags[3]]  # the third side of four has no length
        return corners, [(range(len(corners)), flags[: len(corners)])]
    if kind == "POLYLINE" and entity.is_poly_face_mesh:
        vertices, faces = entity.indexed_faces()
        faces = [(face.indices, [face.is_edge_visible(k) for k in range(len(face))]) for face in faces]
        return [vertex.dxf.location for vertex in vertices], faces
    if kind in ("MESH", "POLYLINE"):
        mesh = (MeshBuilder.from_mesh if kind == "MESH" else MeshBuilder.from_polyface)(entity)
        return mesh.vertices, [(face, [True] * len(face)) for face in mesh.faces]
    corners = entity.wcs_vertices()
    return corners, [(range(len(corners)), [True] * len(corners))]


def _unit(document) -> tuple[str | None, str]:
    """The unit of the drawing, as $INSUNITS has it; None for no unit, or one that no roof is drawn in."""
    number = int(document.header.get("$INSUNITS", 0))
    name = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 10: "yd", 14: "dm"}.get(number)
    return name, f"$INSUNITS = {number}"


def split_lines(text: str) -> tuple[np.ndarray, list[str], str]:
    """The LINE entities of the model space, their ends (k, 2, 3) and layers, and the text without them.

    A DXF file is pairs of lines, a group code and a value; an entity begins with the code 0. (DXF Reference,
    Autodesk, "ENTITIES section".)
    """
    words = text.split("\n")
    words = words[: len(words) // 2 * 2]
    codes = np.array([int(word) for word in words[0::2]], np.int64)
    values = np.array(words[1::2], dtype=object)
    starts = np.flatnonzero(codes == 0)
    inside = _entities(codes, values, starts)
    kinds = np.array([value.strip() == "LINE" for value in values[starts].tolist()], bool) & inside
    entity = np.searchsorted(starts, np.arange(len(codes)), "right") - 1  # of each pair
    hidden = np.isin(codes, (PAPER, INVISIBLE)) & (entity >= 0)
    hidden[hidden] = [int(value) != 0 for value in values[hidden].tolist()]
    kinds[entity[hidden]] = False
    of_line = (entity >= 0) & kinds[entity]
    number = np.cumsum(kinds) - 1
    lines = np.zeros((int(kinds.sum()), 2, 3))
    for code, (end, axis) in PLACES.items():
        here = of_line & (codes == code)
        lines[number[entity[here]], end, axis] = values[here].astype(float)
    layers = np.full(len(lines), "0", dtype=object)
    here = of_line & (codes == LAYER)
    layers[number[entity[here]]] = values[here]
    return lines, layers.tolist(), _without(words, of_line)


def _entities(codes: np.ndarray, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Which of the starts stand in the section ENTITIES."""
    inside = np.zeros(len(starts), bool)
    named = np.flatnonzero((codes == 2) & (values == "ENTITIES"))
    if len(named):
        ends = starts[np.array([value.strip() == "ENDSEC" for value in values[starts].tolist()], bool)]
        end = ends[ends > named[0]]
        inside = (starts > named[0]) & (starts < (end[0] if len(end) else len(codes)))
    return inside


def _without(words: list[str], of_line: np.ndarray) -> str:
    kept = np.repeat(~of_line, 2)
    return "\n".join(np.array(words, dtype=object)[kept].tolist()) + "\n"
