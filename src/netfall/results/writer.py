"""Writer of the result file: snapshots during the run, all small datasets at its end."""

import itertools
import math
import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.arrays import AnyArray, FloatArray
from netfall.core.errors import OutputError
from netfall.explicit.energy import Snapshot
from netfall.geometry.bars import BAR_FLAGS, buckling_lengths, euler_load
from netfall.geometry.net import Net
from netfall.geometry.slip_points import SlidingCables
from netfall.geometry.zones import RoofAreas
from netfall.job.keys.schema import CURVES
from netfall.parallel.agree import on_root
from netfall.parallel.subdomain import Distribution
from netfall.physics.events import EventLog
from netfall.physics.state import State
from netfall.results.datasets import ORDER_ATTRIBUTE, dataset_unit
from netfall.results.file import FORMAT
from netfall.results.h5 import SharedFile, join_segments
from netfall.results.vtkhdf import VtkSeries


def event_ids(net: Net, events: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of /events with the table ids of `element` and `particle`.

    A fragment end has the id of the node from which it separated.
    """
    number = events["particle"]
    element, end = np.divmod(np.maximum(number - net.n, 0), 2)
    row = np.where(number < net.n, number, net.elements[element, end])
    return {"element_id": net.element_id[events["element"]], "node_id": net.node_id[row]}


class Result:
    """Writes the results of a run. Methods are collective.

    log : log of fractures, which numbers the rows of particles; the run owns it
    """

    is_stored = True

    def __init__(self, path: Path, distribution: Distribution, net: Net | None, log: EventLog):
        """net : on rank 0"""
        self.comm = comm = distribution.comm
        self.path = path
        self.distribution = distribution
        self.group = distribution.elements(net.group if net else None)
        self.element_id = distribution.elements(net.element_id if net else None)
        self.node_id = distribution.particles(net.node_id if net else None)
        self.file = SharedFile(comm, path)
        self.segments: list[Path] = []  # complete parts of the file, one per checkpoint
        self.token = comm.bcast(secrets.token_hex(4))  # distinguishes the segments of different runs
        try:
            bends = comm.bcast(net is not None and net.bending is not None)
            self.series = VtkSeries(self.file, distribution.n, distribution.m, bends)
        except OutputError as error:
            self.file.discard_after(error)
            raise
        self.log = log
        self._drawn_events = -1  # number of fractures and removals in the latest mesh
        self.removals = 0  # number of member removals so far

    # --- segments, records

    def cut(self) -> dict[str, int]:
        """Continue in a new file after a segment; return the rows so far, on ranks that write."""
        rows = self.file.rows()
        self._end_segment()
        self._begin_segment(rows)
        return rows

    def _end_segment(self) -> None:
        segment = self.path.with_name(f".{self.path.name}.segment-{self.token}-{len(self.segments):06d}")
        self.file.path = segment
        self.file.close(seal=True)
        self.segments.append(segment)

    def _begin_segment(self, rows: dict[str, int]) -> None:
        self.file = SharedFile(self.comm, self.path, rows)
        self.series.append_to(self.file)  # if this raises an error, the run discards the file

    def record(self) -> dict[str, Any]:
        """Return the data for `restore`."""
        return {
            "series": self.series.record(),
            "drawn_events": self._drawn_events,
            "segments": [os.path.relpath(s, self.path.parent) for s in self.segments],
        }

    def restore(self, record: dict[str, Any], rows: dict[str, int], segments: list[Path]) -> None:
        """Restore the record of an earlier run with these segments."""
        self.file.discard_all()
        self.segments = segments
        self._begin_segment(rows)
        self.series.restore(record["series"])
        self._drawn_events = record["drawn_events"]

    # --- states

    def _points(
        self, state: State, rows: np.ndarray, columns: dict[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return columns of the reported particles as this rank's blocks of the global rows, by name."""
        stacked, split = _stacked(columns)
        return split(self.file.slabs.collect(self.log.row_of(state.gid[rows]), stacked, self.log.points))

    def _cells(self, state: State, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return columns of the elements as this rank's blocks of the global rows, by name."""
        owned, (stacked, split) = state.owned.astype(bool), _stacked(columns)
        gid = self.distribution.subdomain.element_gid[owned]
        return split(self.file.slabs.collect(gid, stacked[owned], self.distribution.m))

    def write_frame(self, time: float, state: State, snapshot: Snapshot) -> None:
        """Write one step of /VTKHDF."""
        rows = snapshot.rows
        if self._drawn_events != len(self.log) + self.removals:
            self._write_mesh(state, rows)
        point_fields = {"displacement": state.x[rows] - state.x_start[rows], "velocity": snapshot.velocity}
        point_fields = self._points(state, rows, {"position": state.x[rows], **point_fields})
        cell_fields = {"tension": snapshot.N, "strain": snapshot.eps, "plastic_strain": snapshot.eps_p}
        cell_fields = self._cells(state, cell_fields | {"broken": state.broken} | _moments(state))
        self.series.write_step(time, point_fields.pop("position"), point_fields, cell_fields, self.log.points)

    def _write_mesh(self, state: State, rows: np.ndarray) -> None:
        """Write the fields that change only when elements break: connectivity, numbers, ids."""
        in_net = state.EA[:, None] > 0.0  # an element outside the net is shown as a point
        ends = self.log.row_of(state.gid[np.where(in_net, state.ends, state.ends[:, :1])])
        gid = self.distribution.subdomain.element_gid
        cell_fields = {"ends": ends, "group": self.group, "element_id": self.element_id, "GlobalCellId": gid}
        cell_fields = self._cells(state, cell_fields)
        point_fields = {"node_id": self._node_ids(state, rows), "GlobalPointId": state.gid[rows]}
        point_fields = self._points(state, rows, point_fields)
        self.series.write_mesh(cell_fields.pop("ends"), point_fields, cell_fields, self.log.points)
        self._drawn_events = len(self.log) + self.removals

    def _node_ids(self, state: State, rows: np.ndarray) -> np.ndarray:
        """Return the table ids (k,) for rows (k,) of the rank's particles, as `event_ids` does."""
        n, subdomain = self.distribution.n, self.distribution.subdomain
        number, row = state.gid[rows], rows.copy()
        is_fragment = number >= n
        element, end = np.divmod(number[is_fragment] - n, 2)
        row[is_fragment] = subdomain.ends[np.searchsorted(subdomain.element_gid, element), end]
        return self.node_id[row]

    def _blocks(
        self,
        state: State,
        rows: np.ndarray,
        particles: dict[str, np.ndarray],
        elements: dict[str, np.ndarray],
    ) -> list[tuple[str, FloatArray, int, Any]]:
        """Return name, this rank's block, total rows and type of columns of particles and of elements."""
        points, cells = self._points(state, rows, particles), self._cells(state, elements)
        n, m = self.log.points, self.distribution.m
        of_points = [(name, block, n, particles[name].dtype) for name, block in points.items()]
        return of_points + [(name, block, m, elements[name].dtype) for name, block in cells.items()]

    def _equilibrium(
        self, state: State, snapshot: Snapshot, place: str, forces: dict[str, np.ndarray]
    ) -> list[tuple[str, FloatArray, int, Any]]:
        """Return the `_blocks` of an equilibrium; see `write_equilibrium`."""
        rows = snapshot.rows
        x = state.x[rows] - (state.x_start[rows] if place == "displacement" else 0.0)
        return self._blocks(state, rows, {place: x} | forces, {"tension": snapshot.N} | _moments(state))

    def write_static_step(self, state: State, snapshot: Snapshot, reaction: np.ndarray) -> None:
        """Write one load step of /statics; reaction : (r, 3) [N], see `Balance`."""
        blocks = self._equilibrium(state, snapshot, "displacement", {"reaction": reaction})
        for name, block, total, _ in blocks:
            name = f"statics/{name}"
            if name not in (self.file.file if self.file.writes else ()):
                self.file.create(name, np.float64, (total, *block.shape[1:]))
            self.file.append_state(name, block, total)

    def write_equilibrium(
        self, group: str, state: State, snapshot: Snapshot, place: str, forces: dict[str, np.ndarray]
    ) -> None:
        """Write one equilibrium into a separate group; place : "position" or "displacement" of its nodes.

        forces : (r, 3) [N] at the owned nodes, by the names of their datasets
        """
        for name, block, total, dtype in self._equilibrium(state, snapshot, place, forces):
            self.file.put(f"{group}/{name}", block, total, dtype)

    def write_whole(self, group: str, datasets: dict[str, np.ndarray] | None) -> None:
        """Write complete datasets (rows, ...) of rank 0; None on other ranks."""
        for name, values in self.comm.bcast(datasets).items():
            low, high = self.file.slabs.bounds(len(values))[self.comm.rank : self.comm.rank + 2]
            self.file.put(f"{group}/{name}", values[low:high], len(values), values.dtype)

    def write_envelope(self, state: State, tension: dict[str, Any], displacement: dict[str, Any]) -> None:
        """Write /envelope. tension : (m,), displacement : (n_owned,), datasets of this rank, by name"""
        n, m, subdomain = self.distribution.n, self.distribution.m, self.distribution.subdomain
        stacked, split = _stacked(displacement)
        points = split(self.file.slabs.collect(subdomain.particle_gid[: subdomain.n_owned], stacked, n))
        for columns, total in ((self._cells(state, tension), m), (points, n)):
            for name, block in columns.items():
                self.file.put(f"envelope/{name}", block, total)

    def write_final(self, state: State, snapshot: Snapshot) -> None:
        """Write the last state in full precision, /final."""
        rows, gid = snapshot.rows, self.distribution.subdomain.element_gid
        particles = {"particle_id": state.gid[rows], "position": state.x[rows], "velocity": snapshot.velocity}
        elements = {"element_id": gid, "tension": snapshot.N, "plastic_strain": snapshot.eps_p}
        for name, block, total, dtype in self._blocks(state, rows, particles, elements | _moments(state)):
            self.file.put(f"final/{name}", block, total, dtype)

    # --- end of the run

    def discard_after(self, error: OutputError, saved: bool) -> None:
        """Remove all files that no checkpoint needs. saved : whether there is a checkpoint"""
        self.file.discard_after(error)
        if self.comm.rank == 0 and not saved:
            for segment in self.segments:
                segment.unlink(missing_ok=True)

    def close(
        self,
        sections: dict[str, dict[str, Any]],
        provenance: dict[str, Any],
        phases: dict[str, Any],
        labels: dict[str, Any],
        warnings: Callable[[h5py.File], list[str]] = lambda file: [],
    ) -> None:
        """Write the small datasets and the unit of every dataset, and rename the file to its path.

        sections : on rank 0, datasets by group ("net", "history", ...)
        provenance : attributes and texts; phases : of `PhaseTimes.over_ranks`; labels : attributes of groups
        warnings : on rank 0, returns all warnings of the run from the otherwise complete file
        """

        def finish(file: h5py.File) -> None:
            self.series.finish(file)
            write_sections(file, sections)
            for group, attributes in labels.items():
                file.require_group(group).attrs.update(attributes)
            _write_provenance(file.create_group("provenance"), provenance, phases)
            label(file)  # also here, so that its size is included

        def conclude(file: h5py.File) -> None:
            write_order(file, sections)
            label(file)
            _write_text(file["provenance"], "warnings", "\n".join(warnings(file)))

        if not self.segments:
            self.file.close(finish, conclude)
            return
        self._end_segment()
        places = self.file.temporary, self.path
        on_root(self.comm, lambda: join_segments(self.segments, *places, finish, conclude))


def write_sections(file: h5py.File, sections: dict[str, dict[str, Any]]) -> None:
    """Write datasets by group; see `Result.close`."""
    for group, datasets in sections.items():
        parent = file.require_group(group) if datasets else file
        for name, values in datasets.items():
            parent.create_dataset(name, data=values)


def write_order(file: h5py.File, sections: dict[str, dict[str, Any]]) -> None:
    """Write the order of the equilibria, which is that of the sections."""
    states = [group for group in sections if group != "form_finding" and f"{group}/tension" in file]
    for order, group in enumerate(states):
        file[group].attrs[ORDER_ATTRIBUTE] = order


def _moments(state: State) -> dict[str, np.ndarray]:
    """Return the bending moments of the elements, if there are bending chains."""
    return {"bending_moment": state.bending_moments()} if state.features.bending else {}


def _stacked(columns: dict[str, np.ndarray]) -> tuple[AnyArray, Callable[..., Any]]:
    """Return columns (k,) or (k, w) side by side in one array, and a function that separates them again."""
    wide = [values.reshape(len(values), math.prod(values.shape[1:])) for values in columns.values()]
    bounds = np.cumsum([0] + [values.shape[1] for values in wide])
    shapes = [values.shape[1:] for values in columns.values()]

    def split(block: np.ndarray) -> dict[str, np.ndarray]:
        parts = (block[:, low:high] for low, high in itertools.pairwise(bounds))
        return {name: part.reshape(len(block), *tail) for name, part, tail in zip(columns, parts, shapes)}

    return np.column_stack(wide), split


def label(file: h5py.File) -> None:
    """Write the unit of each numerical dataset that has none. Raises KeyError if the table lacks one."""

    paths: list[str] = []
    file.visit(paths.append)  # the high-level interface of h5py takes three times as long
    text = h5py.string_dtype()
    kind, scalar = h5py.h5t.py_create(text, logical=True), h5py.h5s.create(h5py.h5s.SCALAR)
    for path in paths:
        item = h5py.h5o.open(file.id, path.encode())
        is_number = isinstance(item, h5py.h5d.DatasetID) and item.get_type().get_class() != h5py.h5t.STRING
        if is_number and not h5py.h5a.exists(item, b"unit"):
            unit = h5py.h5a.create(item, b"unit", kind, scalar)
            unit.write(np.array(dataset_unit(path), text))


def _write_text(group: h5py.Group, name: str, text: str) -> None:
    group.create_dataset(name, data=text, dtype=h5py.string_dtype())


def _write_provenance(group: h5py.Group, values: Any, phases: dict[str, FloatArray]) -> None:
    group.attrs["format"] = FORMAT
    for name, value in values.items():
        if isinstance(value, str):  # file names may contain bytes that are not valid UTF-8
            value = value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
        if isinstance(value, dict):
            for column, array in value.items():
                group.create_dataset(f"{name}/{column}", data=array)
        elif (isinstance(value, str) and len(value) > 200) or name in ("job", "overrides", "notes"):
            _write_text(group, name, value)
        else:
            group.attrs[name] = value
    timings = group.create_group("timings")
    for name, seconds in phases.items():
        timings.attrs[name] = seconds  # minimum, mean and maximum over the ranks


def net_section(net: Net, roof: RoofAreas, cut_length: np.ndarray) -> dict[str, np.ndarray]:
    """Return the datasets of /net. cut_length : (m,) [m], unstressed, at the temperature of form finding"""
    zones = roof.zones
    optional: dict[str, Any] = {"zone_share": zones.share[:, :-1]} if len(zones.mixed) else {}
    if net.diameter is not None:
        optional |= {name: getattr(net, name) for name in ("diameter", "drag_coefficient")}
    if net.second_moment is not None:  # buckling properties of bars
        flags = {name: getattr(net, name) for name in BAR_FLAGS}
        optional |= {name: values.astype(np.uint8) for name, values in flags.items() if values is not None}
        optional |= {
            "second_moment": net.second_moment,
            "buckling_length": buckling_lengths(net, cut_length),
            "euler_load": euler_load(net, cut_length),
            "buckling_curve": np.asarray(net.buckling_curve, np.int32),
            "buckling_curve_names": text_dataset(list(CURVES)),
        }
    datasets = {
        "particles": net.x,
        "elements": net.elements,
        "fixed": net.fixed.astype(np.uint8),
        "group": net.group.astype(np.int32),
        "group_names": text_dataset(net.group_names),
        "tributary_area": roof.area,
        "plan_area": roof.plan_area,
        "vector_area": roof.vector,
        "node_id": net.node_id,
        "element_id": net.element_id,
        "unstressed_length": cut_length,
        "cable": net.cable.astype(np.int32),
        "cable_names": text_dataset(net.cable_names),
        "zone": zones.of_node.astype(np.int32),
        "zone_names": text_dataset(zones.names),
    }
    return _strength_section(net) | optional | datasets


def text_dataset(words: list[str]) -> np.ndarray:
    """Return words as a dataset."""
    return np.array(words, h5py.string_dtype())


def slide_section(net: Net, slides: SlidingCables) -> dict[str, np.ndarray]:
    """Return the slip points of cables, /slide."""
    names = ("before", "after", "friction", "resistance")
    datasets = {
        "node": net.node_id[slides.node],
        "cable": text_dataset([net.cable_names[k] for k in slides.cable]),
    }
    return datasets | {name: getattr(slides, name) for name in names}


def _strength_section(net: Net) -> dict[str, np.ndarray]:
    """Return sections, materials and springs; strengths as given, and the factors of random strengths."""
    section = {
        "axial_stiffness": net.EA,
        "mass_per_length": net.density * net.section,
        "expansion": net.expansion,
        "bar": net.bar.astype(np.uint8),
    }
    strengths = {
        "breaking_load": net.breaking_load / net.strength,
        "yield_force": net.yield_force / net.strength,
        "fracture_strain": net.fracture_strain / net.strength,
    }
    section |= {name: values for name, values in strengths.items() if np.isfinite(values).any()}
    if (net.strength != 1.0).any():
        section["strength"] = net.strength
    if net.spring.any():
        section["spring"] = net.spring
    if net.angle is not None:
        section["angle"] = net.angle
    if net.type_names:
        section |= {"type": net.type.astype(np.int32), "type_names": text_dataset(net.type_names)}
    return section
