"""VTU, the XML file of VTK's unstructured grids: reading lines of every encoding but LZ4, and writing them.

meshio, which reads it too, leaves out polylines without a word (5.3).
Format: VTK User's Guide, "XML file formats"; a block of data is its size, then its bytes.
"""

import base64
import lzma
import re
import xml.etree.ElementTree as xml
import zlib
from pathlib import Path

import numpy as np

from netfall.exchange.drawings.drawing import Drawing, depth, edges_of, is_among
from netfall.ground.errors import InputError

# Types of cells (vtkCellType.h).
EMPTY, LINE, POLY_LINE, POLYGON, PIXEL, QUADRATIC_POLYGON = 0, 3, 4, 7, 8, 36
CURVES = (21, 35, 68, 75)  # quadratic, cubic, Lagrange, Bezier: points between the ends come last
CORNERS = dict.fromkeys((LINE, *CURVES), 2) | dict.fromkeys((5, 22, 34, 69, 76), 3)
CORNERS |= dict.fromkeys((PIXEL, 9, 23, 28, 30, 70, 77), 4)
OTHERS = {1: "vertex", 2: "poly vertex", 6: "triangle strip", 10: "tetra", 11: "voxel", 12: "hexahedron"}
OTHERS |= {13: "wedge", 14: "pyramid", 24: "quadratic tetra", 25: "quadratic hexahedron", 42: "polyhedron"}
TYPES = {"Float32": "f4", "Float64": "f8", "Int8": "i1", "Int16": "i2", "Int32": "i4", "Int64": "i8"}
TYPES |= {
    name.replace("Int", "UInt"): kind.replace("i", "u") for name, kind in TYPES.items() if "Int" in name
}
INFLATE = {"vtkZLibDataCompressor": zlib.decompress, "vtkLZMADataCompressor": lzma.decompress}
GHOSTS = ("vtkGhostType",)
GHOST_CELL, HIDDEN_POINT = 1 | 8 | 32, 2  # bits: duplicate, refined, hidden (vtkDataSetAttributes)
SUPPORTS, GROUPS, IDS = ("held", "fixed", "is_anchor", "is_fixed"), ("group",), ("node_id",)
APPENDED = re.compile(rb"<AppendedData[^>]*>\s*_", re.S)


def read_vtu(path: Path, supports: list[str], wanted: list[str] | None) -> Drawing:
    """Read the lines, polylines and sides of faces of a grid. supports, wanted : as of `read_dxf`, of groups

    Raises InputError for another file.
    """
    try:
        file = _File(path.read_bytes())
        x = file.array("Points").reshape(-1, 3).astype(float)
        cells = map(file.array, ("connectivity", "offsets", "types"))
        connectivity, offsets, types = (values.astype(np.int64) for values in cells)
        if len(connectivity) and not 0 <= connectivity.min() <= connectivity.max() < len(x):
            raise ValueError(
                f"cells name points from {connectivity.min()} to {connectivity.max()} of {len(x)}"
            )
        drawn = _drawn(file, connectivity, offsets)
        types = np.where(drawn, types, EMPTY)
        ends, cell = _cells(connectivity, offsets, types)
        left_out = _left_out(x, connectivity, offsets, types)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected a VTU file") from None
    except (xml.ParseError, KeyError, ValueError, zlib.error, lzma.LZMAError) as error:
        raise InputError(f"{path}: not a VTU file that can be read: {error}") from None
    number = file.first("CellData", GROUPS)
    group = np.zeros(len(ends), np.int64) if number is None else number.astype(np.int64)[cell]
    names = [f"group {k}" if number is not None else "cables" for k in np.unique(group).tolist()]
    _, layer = np.unique(group, return_inverse=True)
    if wanted is not None:
        kept = np.isin(layer, [k for k, name in enumerate(names) if is_among(name, (*wanted, *supports))])
        ends, layer = ends[kept], layer[kept]
    held, keys = file.first("PointData", SUPPORTS), file.first("PointData", IDS)
    axes = np.zeros((len(x), 1), bool) if held is None else held.reshape(len(x), -1) != 0
    return Drawing(
        lines=x[ends],
        layer=layer,
        layers=names,
        held=x[axes.all(1)],
        in_part=x[axes.any(1) & ~axes.all(1)],
        keys=None if keys is None else keys.astype(np.int64)[ends],
        read=[f"{len(x)} points, {len(ends)} lines"],
        left_out=left_out + ([f"{int((~drawn).sum())} cells, ghosts or hidden"] if not drawn.all() else []),
    )


def _cells(connectivity, offsets, types) -> tuple[np.ndarray, np.ndarray]:
    """Return lines (k, 2) as rows of points, and the cell (k,) of each; sides of faces once.

    Cells of higher order count with their ends or corners.
    """
    starts, corners = np.append(0, offsets[:-1]), _corners(offsets, types)
    plain = np.flatnonzero(np.isin(types, (LINE, *CURVES)))
    ends = [np.column_stack([connectivity[starts[plain]], connectivity[starts[plain] + 1]])]
    cells, faces = [plain], []
    for cell in np.flatnonzero(types == POLY_LINE).tolist():
        points = connectivity[starts[cell] : offsets[cell]]
        ends.append(np.column_stack([points[:-1], points[1:]]))
        cells.append(np.full(len(points) - 1, cell))
    surfaces = np.flatnonzero((corners > 0) & ~np.isin(types, (LINE, POLY_LINE, *CURVES))).tolist()
    for cell in surfaces:
        points = connectivity[starts[cell] : starts[cell] + corners[cell]].tolist()
        faces.append([points[k] for k in (0, 1, 3, 2)] if types[cell] == PIXEL else points)
    if faces:
        sides, of = edges_of(faces)
        ends.append(sides)
        cells.append(np.array([surfaces[faces[0]] for faces in of]))
    return np.concatenate(ends), np.concatenate(cells)


def _corners(offsets, types) -> np.ndarray:
    """Return how many points of each cell are ends or corners, 0 if it is no line and no face.

    Raises ValueError for a cell that has fewer.
    """
    count = np.diff(offsets, prepend=0)
    corners = np.array([CORNERS.get(kind, 0) for kind in types.tolist()], np.int64)
    whole = np.isin(types, (POLY_LINE, POLYGON))
    corners[whole] = count[whole]
    corners[types == QUADRATIC_POLYGON] = count[types == QUADRATIC_POLYGON] // 2
    if (count < corners).any():
        cell = int(np.argmax(count < corners))
        raise ValueError(f"cell {cell} has {count[cell]} points; expected {corners[cell]}, by its type")
    return corners


def _left_out(x: np.ndarray, connectivity, offsets, types) -> list[str]:
    """Say what has no lines: points between ends and corners, and cells that are neither lines nor faces."""
    corners, told = _corners(offsets, types), []
    between = np.where(corners > 0, np.diff(offsets, prepend=0) - corners, 0)
    curves = np.flatnonzero(np.isin(types, CURVES))
    points = [x[connectivity[offsets[cell] - between[cell] - 2 : offsets[cell]]] for cell in curves.tolist()]
    if between.any():
        beside = max((depth(each[2:], *each[:2]) for each in points), default=0.0)
        told.append(
            f"{between.sum()} points between the ends or corners of {(between > 0).sum()} cells of higher "
            f"order, those of curves up to {beside:.4g} beside the straight lines that were read"
        )
    others, counts = np.unique(
        types[(corners == 0) & (types != EMPTY) & (types != POLY_LINE)], return_counts=True
    )
    names = [OTHERS.get(kind, f"{kind} (vtkCellType.h)") for kind in others.tolist()]
    return told + [
        f"{n} cells of type {name}, which is no line and no face" for name, n in zip(names, counts)
    ]


def _drawn(file, connectivity, offsets) -> np.ndarray:
    """Cells (c,) bool that VTK draws: not those of another piece or hidden, nor those at hidden points."""
    of_cell, of_point = file.first("CellData", GHOSTS), file.first("PointData", GHOSTS)
    drawn = np.ones(len(offsets), bool)
    if of_cell is not None:
        drawn &= of_cell.astype(np.int64) & GHOST_CELL == 0
    if of_point is not None:
        cell = np.repeat(np.arange(len(offsets)), np.diff(offsets, prepend=0))
        drawn[cell[(of_point.astype(np.int64) & HIDDEN_POINT != 0)[connectivity]]] = False
    return drawn


class _File:
    """A VTU file: its arrays by name."""

    def __init__(self, data: bytes):
        found = APPENDED.search(data)
        self.bytes = data[found.end() : data.rindex(b"</AppendedData>")] if found else b""
        text = data[: found.start()] + b"</VTKFile>" if found else data
        self.raw = bool(found) and b'encoding="raw"' in found.group()
        self.root = xml.fromstring(text)
        if self.root.tag != "VTKFile" or self.root.get("type") != "UnstructuredGrid":
            raise ValueError("it holds no UnstructuredGrid")
        if len(self.root.findall(".//Piece")) != 1:
            raise ValueError("it has several pieces; save it as one")
        self.order = "<" if self.root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        self.size = np.dtype(self.order + TYPES[self.root.get("header_type", "UInt32")])
        self.compressor = self.root.get("compressor")

    def array(self, name: str) -> np.ndarray:
        """Points, connectivity, offsets or types."""
        place = ".//Points/DataArray" if name == "Points" else f".//Cells/DataArray[@Name='{name}']"
        element = self.root.find(place)
        if element is None:
            raise KeyError(f"{name} is missing")
        return self._values(element)

    def first(self, data: str, names: tuple[str, ...]) -> np.ndarray | None:
        """The first array there is of these names; None: none."""
        for name in names:
            element = self.root.find(f".//{data}/DataArray[@Name='{name}']")
            if element is not None and element.get("type") in TYPES:
                return self._values(element)
        return None

    def _values(self, element) -> np.ndarray:
        kind = np.dtype(TYPES[element.get("type")])
        form = element.get("format", "ascii")
        if form == "ascii":
            return np.array((element.text or "").split(), dtype=kind)
        if form == "appended":
            data, raw = self.bytes[int(element.get("offset")) :], self.raw
        else:
            data, raw = (element.text or "").strip().encode(), False
        return np.frombuffer(self._decoded(data, raw), kind.newbyteorder(self.order)).astype(kind)

    def _decoded(self, data: bytes, raw: bool) -> bytes:
        """The bytes of a block. Of a compressed one in base64 the sizes at its head are encoded apart."""
        width = self.size.itemsize
        if not self.compressor:
            block = data if raw else _base64(data, width)
            length = int(np.frombuffer(block, self.size, 1)[0])
            return (block if raw else _base64(data, width + length))[width : width + length]
        if self.compressor not in INFLATE:
            raise ValueError(f"compressed by {self.compressor}; save it with zlib, or without compression")
        blocks = int(np.frombuffer(data if raw else _base64(data, width), self.size, 1)[0])
        head = (3 + blocks) * width
        sizes = np.frombuffer(data if raw else _base64(data, head), self.size, 3 + blocks)[3:].astype(int)
        start = head if raw else 4 * -(-head // 3)
        packed = data[start : start + sizes.sum()] if raw else _base64(data[start:], int(sizes.sum()))
        stops = np.cumsum(sizes)
        inflate = INFLATE[self.compressor]
        return b"".join(inflate(packed[a:b]) for a, b in zip(stops - sizes, stops, strict=True))


def _base64(data: bytes, length: int) -> bytes:
    """The first bytes that are encoded there."""
    return base64.b64decode(data[: 4 * -(-length // 3)])[:length]


def write_vtu(path: Path, x: np.ndarray, ends: np.ndarray, point_data: dict, cell_data: dict, comment: str):
    """Write lines between points x (p, 3), with arrays of points and cells by name; all digits, as text."""
    m = len(ends)
    cells = {"connectivity": ends.astype(np.int64).ravel()}
    cells |= {"offsets": 2 * np.arange(1, m + 1), "types": np.full(m, LINE, np.uint8)}
    sections = {"PointData": point_data, "CellData": cell_data, "Points": {"Points": x}, "Cells": cells}
    lines = [
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f"<!-- {comment} -->",
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(x)}" NumberOfCells="{m}">',
    ]
    for section, arrays in sections.items():
        lines += [
            f"<{section}>",
            *(_data_array(name, np.asarray(a)) for name, a in arrays.items()),
            f"</{section}>",
        ]
    path.write_text("\n".join([*lines, "</Piece></UnstructuredGrid></VTKFile>", ""]), encoding="ascii")


def _data_array(name: str, values: np.ndarray) -> str:
    kind = next(name for name, code in TYPES.items() if np.dtype(code) == values.dtype)
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    text = " ".join(map(repr, values.ravel().tolist()))
    return f'<DataArray type="{kind}" Name="{name}"{width} format="ascii">{text}</DataArray>'
