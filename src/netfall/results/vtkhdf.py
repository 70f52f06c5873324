"""The /VTKHDF group: a temporal UnstructuredGrid of lines, one part per step, as ParaView opens it.

Rows are in the order of global numbers: the net's particles, then the fragment ends; the elements. Every step
has its own Points. The connectivity is written again only if elements have broken since the last step.
(VTKHDF 2.2; the reader needs one more entry in Offsets than cells, for each part.)
"""

from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.core.arrays import FloatArray
from netfall.results.h5 import SharedFile

LINE = 3  # VTK_LINE, cell type of VTK


class VtkField(NamedTuple):
    """A column of points or cells, see results/datasets.py. bends : present only with bending chains"""

    name: str
    dtype: type
    tail: tuple[int, ...] = ()
    bends: bool = False


VTK_FIELDS = {
    "PointData": (
        VtkField("displacement", np.float32, (3,)),
        VtkField("velocity", np.float32, (3,)),
        VtkField("node_id", np.int64),
        VtkField("GlobalPointId", np.int64),
    ),
    "CellData": (
        VtkField("tension", np.float32),
        VtkField("strain", np.float32),
        VtkField("plastic_strain", np.float32),
        VtkField("broken", np.uint8),
        VtkField("bending_moment", np.float32, (2,), True),
        VtkField("group", np.int32),
        VtkField("element_id", np.int64),
        VtkField("GlobalCellId", np.int64),
    ),
}


class VtkSeries:
    """Appends steps to /VTKHDF, whose offsets stay in memory until `finish`. Methods are collective."""

    def __init__(self, file: SharedFile, points: int, cells: int, bends: bool = False):
        """points, cells : numbers per step, points at the start; bends : whether there are bending chains"""
        self.fields = {
            group: [field for field in fields if bends or not field.bends]
            for group, fields in VTK_FIELDS.items()
        }
        self.sizes = {"PointData": points, "CellData": cells}
        self.parts: list[tuple[int, int]] = []  # points and cells of each part
        self.steps: list[dict[str, Any]] = []
        self._mesh: dict[str, Any] = {}
        self.append_to(file)

    def append_to(self, file: SharedFile) -> None:
        """Append to this file from now on: the first, or one that continues it."""
        self.file = file
        file.create("VTKHDF/Points", np.float64, (3,), self.sizes["PointData"])
        for name, dtype in (("Connectivity", np.int64), ("Offsets", np.int64), ("Types", np.uint8)):
            file.create(f"VTKHDF/{name}", dtype, (), self.sizes["CellData"])
        for group, fields in self.fields.items():
            for field in fields:
                file.create(f"VTKHDF/{group}/{field.name}", field.dtype, field.tail, self.sizes[group])

    def record(self) -> dict[str, Any]:
        """Return the data for `restore`."""
        return {"parts": self.parts, "steps": self.steps, "mesh": self._mesh}

    def restore(self, record: dict[str, Any]) -> None:
        """Restore the record of an earlier run."""
        self.parts = [tuple(p) for p in record["parts"]]
        self.steps, self._mesh = record["steps"], record["mesh"]

    def write_mesh(
        self, connectivity: np.ndarray, point_data: dict[str, Any], cell_data: dict[str, Any], points: int
    ) -> None:
        """Append a new connectivity and the fields that change only with it.

        connectivity : this rank's block (c, 2) of global point rows; points : of all ranks
        """
        cells = self.sizes["CellData"]
        low = int(self.file.slabs.bounds(cells)[self.file.comm.rank])
        self._mesh = {
            "part": len(self.parts),
            "cells": self.file.append("VTKHDF/Types", np.full(len(connectivity), LINE), cells),
        }
        pairs = connectivity.reshape(-1)
        self._mesh["connectivity"] = self.file.append("VTKHDF/Connectivity", pairs, 2 * cells, 2 * low)
        first = 0 if low == 0 and self.file.comm.rank == 0 else 1
        offsets = 2 * np.arange(low + first, low + len(connectivity) + 1)
        self.file.append("VTKHDF/Offsets", offsets, cells + 1, low + first)
        self._mesh |= self._append_fields(point_data, cell_data, points)
        self.parts.append((points, cells))

    def _append_fields(
        self, point_data: dict[str, FloatArray], cell_data: dict[str, FloatArray], points: int
    ) -> dict[str, int]:
        groups = ("PointData", point_data, points), ("CellData", cell_data, self.sizes["CellData"])
        return {
            f"{group}/{name}": self.file.append(f"VTKHDF/{group}/{name}", block, total)
            for group, data, total in groups
            for name, block in data.items()
        }

    def write_step(
        self,
        time: float,
        positions: np.ndarray,
        point_data: dict[str, Any],
        cell_data: dict[str, Any],
        points: int,
    ) -> None:
        """Append a step on the latest mesh, from blocks of this rank; points : number on all ranks"""
        start = self.file.append("VTKHDF/Points", positions, points)
        fields = self._append_fields(point_data, cell_data, points)
        self.steps.append({"time": time, "points": start, **self._mesh, **fields})

    def finish(self, file: h5py.File) -> None:
        """Write attributes, part sizes and step offsets into the reopened file. Rank 0."""
        group = file.require_group("VTKHDF")
        group.attrs["Version"] = np.array([2, 2], np.int64)
        kind = b"UnstructuredGrid"
        group.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
        sizes = np.array(self.parts, np.int64).reshape(-1, 2)
        for name, values in (
            ("NumberOfPoints", sizes[:, 0]),
            ("NumberOfCells", sizes[:, 1]),
            ("NumberOfConnectivityIds", 2 * sizes[:, 1]),
        ):
            _growing(group, name, values)
        steps = group.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(len(self.steps))

        def column(key: str) -> np.ndarray:
            return np.array([step[key] for step in self.steps], np.int64)

        _growing(steps, "Values", np.array([s["time"] for s in self.steps], np.float64))
        _growing(steps, "PartOffsets", column("part"))
        _growing(steps, "NumberOfParts", np.ones(len(self.steps), np.int64))
        _growing(steps, "PointOffsets", column("points"))
        _growing(steps, "CellOffsets", column("cells")[:, None])
        _growing(steps, "ConnectivityIdOffsets", column("connectivity")[:, None])
        for data, fields in self.fields.items():
            for field in fields:
                _growing(steps, f"{data}Offsets/{field.name}", column(f"{data}/{field.name}"))


def _growing(group: h5py.Group, name: str, values: Any) -> None:
    shape, tail = (None, *values.shape[1:]), values.shape[1:]
    group.create_dataset(name, data=values, maxshape=shape, chunks=(max(1, min(len(values), 1024)), *tail))
