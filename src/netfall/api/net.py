"""A net from arrays in Python, and its tables."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from netfall.api import messages
from netfall.core.errors import InputError
from netfall.job.csv_table import write_table

AXES = ("x", "y", "z")

OF_NODES = {"id": "node_id"} | dict.fromkeys(AXES, "nodes")  # array of a Net by column of the table
OF_NODES |= dict.fromkeys(("fixed", *(f"fixed_{k}" for k in AXES)), "fixed")
ELEMENT_COLUMN_SOURCES = {"id": "element_id", "start": "elements", "end": "elements"}


@dataclass
class Net:
    """A net of n nodes and m elements from arrays, for the "net" of a job that is a dict.

    nodes : (n, 3) [m]; elements : (m, 2) nodes at the ends, by their ids
    fixed : (n,) or (n, 3) bool, held in all directions or by axis; groups : (m,) names, or one for all
    node_id : (n,), default 0 to n - 1; element_id : (m,), default 0 to m - 1
    node_columns, element_columns : further columns by name, (n,) or (m,), None: empty, or one value for all:
        {"mass": ..., "load_z": ...} and {"prestress": ..., "force_density": ..., "unstressed_length": ...}
    """

    nodes: np.ndarray
    elements: np.ndarray
    fixed: np.ndarray | None = None
    groups: list[str] | str | None = None
    node_id: np.ndarray | None = None
    element_id: np.ndarray | None = None
    node_columns: dict[str, Any] = field(default_factory=dict)
    element_columns: dict[str, Any] = field(default_factory=dict)

    def node_table(self) -> dict[str, np.ndarray]:
        """Return the columns of nodes.csv. Raises InputError if the arrays do not fit each other."""
        x = _array("nodes", self.nodes, 3, float)
        n = len(x)
        table = {"id": _ids("node_id", self.node_id, n), **{k: x[:, i] for i, k in enumerate(AXES)}}
        fixed = np.zeros(n, bool) if self.fixed is None else _as_array("fixed", self.fixed)
        if fixed.shape not in ((n,), (n, 3)) or not np.isin(fixed, (0, 1)).all():
            raise _array_error("fixed", fixed, f"({n},) or ({n}, 3) of True or False, for each node")
        names = ["fixed"] if fixed.ndim == 1 else [f"fixed_{k}" for k in AXES]
        table |= zip(names, np.atleast_2d(fixed.astype(int).T))
        return table | _columns("node_columns", self.node_columns, n, OF_NODES)

    def element_table(self) -> dict[str, np.ndarray]:
        """Return the columns of elements.csv. Raises InputError if the arrays do not fit each other."""
        ends = _array("elements", self.elements, 2, int)
        m = len(ends)
        table = {"id": _ids("element_id", self.element_id, m), "start": ends[:, 0], "end": ends[:, 1]}
        given = ELEMENT_COLUMN_SOURCES
        if self.groups is not None:
            table |= _columns("groups", {"group": self.groups}, m, {})
            given = given | {"group": "groups"}
        return table | _columns("element_columns", self.element_columns, m, given)

    def write(self, folder: str | Path) -> dict[str, str]:
        """Write nodes.csv and elements.csv into a folder, and return the [net] of a job in that folder."""
        folder = Path(folder)
        tables = {"nodes.csv": self.node_table(), "elements.csv": self.element_table()}
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            write_table(folder / name, table)
        return {"nodes": "nodes.csv", "elements": "elements.csv"}


def _array(name: str, values: Any, columns: int, kind: type) -> np.ndarray:
    """Return values as an array with this number of columns. Raises InputError."""
    array = _as_array(name, values)
    expected, kinds = ("(n, 3) of numbers [m]", "iuf") if kind is float else ("(m, 2) of ids of nodes", "iu")
    if array.ndim != 2 or array.shape[1] != columns or array.dtype.kind not in kinds:
        raise _array_error(name, array, expected)
    return array.astype(kind)


def _as_array(name: str, values: Any) -> np.ndarray:
    """Return values as an array, None for masked cells. Raises InputError if its rows differ in length."""
    try:
        if np.ma.is_masked(values):
            return np.array(np.ma.asarray(values).tolist(), object)
        return np.asarray(values)
    except ValueError:
        raise InputError(messages.RAGGED_ARRAY(name=name)) from None


def _array_error(name: str, array: np.ndarray, expected: str) -> InputError:
    """Build the error for an array of a wrong shape or type."""
    return InputError(messages.WRONG_ARRAY(name=name, shape=array.shape, type=array.dtype, expected=expected))


def _ids(name: str, values: Any, rows: int) -> np.ndarray:
    if values is None:
        return np.arange(rows)
    array = _as_array(name, values)
    if array.shape != (rows,) or array.dtype.kind not in "iu":
        raise _array_error(name, array, f"{rows} integers")
    return array


def _columns(name: str, given: dict[str, Any], rows: int, arrays: dict[str, str]) -> dict[str, np.ndarray]:
    """Return columns with `rows` rows; a single value applies to all rows, and None is an empty cell.

    arrays : names of arrays of a Net by the columns that they provide. Raises InputError for these columns,
    nan and line breaks.
    """
    provided = {column: arrays.get(str(column).strip().lower()) for column in given}
    errors = [
        messages.ARRAY_AS_COLUMN(name=name, column=column, array=array)
        for column, array in provided.items()
        if array
    ]
    if errors:
        raise InputError(errors)
    columns = {}
    for column, values in given.items():
        array = _as_array(f"{name} {column!r}", values)
        if array.shape not in ((), (rows,)):
            shape = array.shape
            raise InputError(messages.WRONG_COLUMN(name=name, column=column, shape=shape, rows=rows))
        for row, value in enumerate(array.reshape(-1).tolist()):
            if value != value or (isinstance(value, str) and len(value.splitlines()) > 1):
                expected = "a number, or None for an empty cell" if value != value else "one line"
                cell = messages.WRONG_CELL(name=name, column=column, row=row, value=value, expected=expected)
                raise InputError(cell)
        columns[column] = np.broadcast_to(array, rows)
    return columns
