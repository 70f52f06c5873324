"""Reading and writing of VTU, the XML file of VTK's unstructured grids, by vtk.

meshio also reads VTU, but leaves out polylines without a message (version 5.3).
"""

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkObject, vtkPoints
from vtkmodules.vtkCommonDataModel import VTK_LINE, vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter

from netfall.core.messages import count_of
from netfall.exchange.drawings.drawing import Drawing

GHOSTS = "vtkGhostType"
SUPPORTS = ("held", "fixed", "is_anchor", "is_fixed")
VARIABLE = re.compile("Poly|Strip|Lagrange|Bezier")  # classes of cells with any number of points


def read_vtu(path: Path, supports: list[str]) -> Drawing:
    """Read the lines, polylines and sides of faces of a grid; supports : not used.

    Raises errors as `reading.READERS` says.
    """
    grid = _read_grid(path)
    x = vtk_to_numpy(grid.GetPoints().GetData()).astype(float)
    ends, cell, left_out = _lines(grid)
    number, keys = _array(grid.GetCellData(), "group"), _array(grid.GetPointData(), "node_id")
    supported = (_array(grid.GetPointData(), name, 3) for name in SUPPORTS)
    held = next((array for array in supported if array is not None), np.zeros(len(x)))
    group = np.zeros(len(ends), np.int64) if number is None else number[cell]
    names = [f"group {k}" if number is not None else "cables" for k in np.unique(group).tolist()]
    _, layer = np.unique(group, return_inverse=True)
    axes = held.reshape(len(x), -1) != 0
    return Drawing(
        lines=x[ends],
        layer=layer,
        layers=names,
        held=x[axes.any(1)],
        held_axes=np.broadcast_to(axes, (len(x), 3))[axes.any(1)],
        keys=None if keys is None else keys[ends],
        read=[f"{len(x)} points, {len(ends)} lines"],
        left_out=left_out,
    )


def _read_grid(path: Path) -> Any:
    """Read the grid of a file. Raises ValueError if vtk cannot read it, or if its cells are inconsistent."""
    path.open("rb").close()
    reader, displays = vtkXMLUnstructuredGridReader(), vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()  # exceptions below report errors
    try:
        if not reader.CanReadFile(str(path)):
            raise ValueError("it holds no UnstructuredGrid")
        reader.SetFileName(str(path))
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(displays)
    if reader.GetErrorCode() or not reader.GetOutput().GetNumberOfPoints():
        raise ValueError("it is cut short, or an array has another size or type than it should")
    grid = reader.GetOutput()
    points = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    if len(points) and not 0 <= points.min() <= points.max() < grid.GetNumberOfPoints():
        raise ValueError(
            f"cells name points from {points.min()} to {points.max()} of {grid.GetNumberOfPoints()}"
        )
    ghosts = (_array(data, GHOSTS) for data in (grid.GetCellData(), grid.GetPointData()))
    if any(array is not None and array.any() for array in ghosts):
        raise ValueError(f"it has ghosts or hidden cells ({GHOSTS}). Write a file without these cells")
    return grid


def _array(data: Any, name: str, axes: int = 1) -> np.ndarray | None:
    """Return the whole numbers (k,), or (k, axes), of points or cells by name, or None.

    Raises ValueError for text, other numbers, or another number of components.
    """
    array = data.GetAbstractArray(name)
    if array is None:
        return None
    values = vtk_to_numpy(array) if isinstance(array, vtkDataArray) else np.array([np.nan])
    with np.errstate(invalid="ignore"):  # not whole numbers: the comparison below detects them
        numbers = values.astype(np.int64)
    if array.GetNumberOfComponents() not in (1, axes) or (numbers != values).any():
        counts = f"one or {axes} whole numbers" if axes > 1 else "one whole number"
        raise ValueError(f"array {name}: expected {counts} per point or cell")
    return numbers


def _lines(grid: Any) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return lines (k, 2) as rows of points, the cell (k,) of each line, and messages on undrawn content.

    Each side of plane cells is one line. Raises ValueError for a cell with too few points.
    """
    lines: list[Any] = []
    sides: dict[Any, Any] = {}
    others: Counter[Any] = Counter()
    for number in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(number)
        _check_points(cell, number)
        kind = cell.GetClassName().removeprefix("vtk")
        if kind in ("Line", "PolyLine"):
            points = [cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())]
            lines += [(a, b, number) for a, b in pairwise(points)]
        elif cell.GetCellDimension() == 2 and cell.IsLinear() and kind != "TriangleStrip":
            for edge in map(cell.GetEdge, range(cell.GetNumberOfEdges())):  # one object that vtk reuses
                sides.setdefault(tuple(sorted((edge.GetPointId(0), edge.GetPointId(1)))), number)
        elif kind != "EmptyCell":
            others[cell.GetCellType(), kind] += 1
    lines += [(*pair, number) for pair, number in sorted(sides.items())]
    table = np.array(lines, np.int64).reshape(-1, 3)
    names = {kind: re.sub(r"(?<!^)(?=[A-Z])", " ", kind[1]).lower() for kind in sorted(others)}
    left_out = [f"cells of type {name}, no straight line or face: {others[k]}" for k, name in names.items()]
    return table[:, :2], table[:, 2], left_out


def _check_points(cell: Any, number: int) -> None:
    """Raise ValueError if a cell has fewer points than its type requires."""
    count = cell.GetNumberOfPoints()
    expected = 2 if cell.GetCellDimension() == 1 else 0
    if not VARIABLE.search(cell.GetClassName()):
        expected = cell.NewInstance().GetNumberOfPoints()
    if count < expected:
        raise ValueError(f"cell {number} has {count_of(count, 'point')}; expected {expected}, by its type")


def write_vtu(
    path: Path,
    x: np.ndarray,
    ends: np.ndarray,
    point_data: dict[str, Any],
    cell_data: dict[str, Any],
    comment: str,
) -> None:
    """Write lines between points x (p, 3), with arrays of points and cells by name, and a comment."""
    grid, points, cells = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(x, deep=True))
    cells.SetData(2, numpy_to_vtkIdTypeArray(ends.astype(np.int64).ravel(), deep=True))
    grid.SetPoints(points)
    grid.SetCells(VTK_LINE, cells)
    for data, arrays in ((grid.GetPointData(), point_data), (grid.GetCellData(), cell_data)):
        for name, values in arrays.items():
            array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
            array.SetName(name)
            data.AddArray(array)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(f"{writer.GetOutputString()}<!-- {comment} -->\n", encoding="ascii")
