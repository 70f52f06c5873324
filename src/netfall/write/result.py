"""The result file of a run: frames while it goes on, everything small at the end (README.md beside)."""

import itertools
import math
import os
import secrets
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import OutputError
from netfall.mechanics.events import EventLog
from netfall.mechanics.state import State
from netfall.net.bars import CURVES, FLAGS, buckling_lengths, euler_load
from netfall.net.net import Net
from netfall.net.slides import Slides
from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.results.datasets import ORDER, unit_of
from netfall.roof.zones import Roof
from netfall.write.h5 import SharedFile
from netfall.write.ids import LocalIds
from netfall.write.segments import join_segments
from netfall.write.vtkhdf import VtkSeries


class Result:
    """Writes what a run reports. Methods are collective.

    log : of the fractures, which numbers the rows of particles; it belongs to the run, as the history does
    """

    kept = True

    def __init__(
        self, comm: MPI.Comm, path: Path, distribution: Distribution, net: Net | None, log: EventLog
    ):
        """net : on rank 0"""
        self.comm = comm
        self.path = path
        self.distribution = distribution
        self.group = distribution.elements(net.group if net else None)
        self.ids = LocalIds(distribution, net)
        self.file = SharedFile(comm, path)
        self.segments: list[Path] = []  # whole parts of the file so far, if there are checkpoints
        self.token = comm.bcast(secrets.token_hex(4))  # keeps this run's segments apart from another's
        try:
            bends = comm.bcast(net is not None and net.bending is not None)
            self.series = VtkSeries(self.file, distribution.n, distribution.m, bends)
        except OutputError as error:
            self.file.discard_after(error)
            raise
        self.log = log
        self._drawn_events = -1  # fractures and losses that the mesh written last shows
        self.losses = 0  # so far, in which elements left the net

    # --- segments, records

    def cut(self) -> dict[str, int]:
        """Close what has been written as a segment, go on in a new one; the rows so far, where it writes."""
        rows = self.file.rows()
        self._end_segment()
        self._begin_segment(rows)
        return rows

    def _end_segment(self) -> None:
        segment = self.path.with_name(f".{self.path.name}.segment-{self.token}-{len(self.segments):06d}")
        self.file.path = segment
        self.file.close()
        self.segments.append(segment)

    def _begin_segment(self, rows: dict[str, int]) -> None:
        self.file = SharedFile(self.comm, self.path, rows)
        self.series.continue_in(self.file)  # if there is no room, the run discards the file

    def record(self) -> dict:
        """What a continuation needs, for `restore`."""
        return {
            "series": self.series.record(),
            "drawn_events": self._drawn_events,
            "segments": [os.path.relpath(s, self.path.parent) for s in self.segments],
        }

    def restore(self, record: dict, rows: dict[str, int], segments: list[Path]) -> None:
        """Take up the record of an earlier run, whose segments are those given."""
        self.file.discard_all()
        self.segments = segments
        self._begin_segment(rows)
        self.series.restore(record["series"])
        self._drawn_events = record["drawn_events"]

    # --- states

    def _points(
        self, state: State, rows: np.ndarray, columns: dict[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Columns of the reported particles as this rank's blocks of the global rows, by name."""
        stacked, split = _stacked(columns)
        return split(self.file.slabs.collect(self.log.row_of(state.gid[rows]), stacked, self.log.points))

    def _cells(self, state: State, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The same of the elements."""
        mine, (stacked, split) = state.owned.astype(bool), _stacked(columns)
        gid = self.distribution.subdomain.element_gid[mine]
        return split(self.file.slabs.collect(gid, stacked[mine], self.distribution.m))

    def write_frame(self, time: float, state: State, snapshot) -> None:
        """One step of /VTKHDF."""
        points, cells, rows = self.log.points, self.distribution.m, snapshot.rows
        if self._drawn_events != len(self.log) + self.losses:
            self._write_mesh(state, rows)
        x, moved = state.x[rows], state.x[rows] - state.x_start[rows]
        velocity = snapshot.velocity
        p = self._points(state, rows, {"position": x, "displacement": moved, "velocity": velocity})
        c = {"tension": snapshot.N, "strain": snapshot.eps, "plastic_strain": snapshot.eps_p}
        c = self._cells(state, c | {"broken": state.broken} | _moments(state))
        self.series.write_step(time, p.pop("position"), p, c, points, cells)

    def _write_mesh(self, state: State, rows: np.ndarray) -> None:
        """What changes only when elements break: connectivity, numbers, ids."""
        in_net = state.EA[:, None] > 0.0  # what is out of the net is drawn as a point
        ends = self.log.row_of(state.gid[np.where(in_net, state.ends, state.ends[:, :1])])
        gid = self.distribution.subdomain.element_gid
        c = {"ends": ends, "group": self.group, "element_id": self.ids.element, "GlobalCellId": gid}
        c = self._cells(state, c)
        p = {"node_id": self.ids.node(state, rows), "GlobalPointId": state.gid[rows]}
        p = self._points(state, rows, p)
        self.series.write_mesh(c.pop("ends"), p, c, self.log.points, self.distribution.m)
        self._drawn_events = len(self.log) + self.losses

    def _equilibrium(self, state: State, snapshot, place: str, reaction: np.ndarray):
        """Name, this rank's block and rows in all, of what is kept; arguments as of `write_equilibrium`."""
        rows = snapshot.rows
        columns = {place: state.x[rows] - (state.x_start[rows] if place == "displacement" else 0.0)}
        points = self._points(state, rows, columns | {"reaction": reaction})
        cells = self._cells(state, {"tension": snapshot.N} | _moments(state))
        yield from ((name, block, self.distribution.n) for name, block in points.items())
        yield from ((name, block, self.distribution.m) for name, block in cells.items())

    def write_static_step(self, state: State, snapshot, reaction: np.ndarray) -> None:
        """One load step of /statics; reaction : (r, 3) [N], as of `Balance`."""
        for name, block, total in self._equilibrium(state, snapshot, "displacement", reaction):
            name = f"statics/{name}"
            if name not in (self.file.file if self.file.writes else ()):
                self.file.create(name, np.float64, (total, *block.shape[1:]))
            self.file.append_state(name, block, total)

    def write_equilibrium(self, group: str, state: State, snapshot, place: str, reaction: np.ndarray) -> None:
        """One equilibrium, in a group of its own; place : "position" or "displacement" of its nodes.

        reaction : (r, 3) [N], as of `Balance`
        """
        for name, block, total in self._equilibrium(state, snapshot, place, reaction):
            self.file.put(f"{group}/{name}", block, total)

    def write_whole(self, group: str, datasets: dict[str, np.ndarray] | None) -> None:
        """Datasets that rank 0 gives whole, None elsewhere, kept from now on."""
        for name, values in self.comm.bcast(datasets).items():
            low, high = self.file.slabs.bounds(len(values))[self.comm.rank : self.comm.rank + 2]
            self.file.put(f"{group}/{name}", values[low:high], len(values), values.dtype)

    def write_envelope(self, state: State, tension: dict, displacement: dict) -> None:
        """The datasets of /envelope. tension : (m,), displacement : (n_owned,), of this rank, by name"""
        n, m, subdomain = self.distribution.n, self.distribution.m, self.distribution.subdomain
        stacked, split = _stacked(displacement)
        points = split(self.file.slabs.collect(subdomain.particle_gid[: subdomain.n_owned], stacked, n))
        for columns, total in ((self._cells(state, tension), m), (points, n)):
            for name, block in columns.items():
                self.file.put(f"envelope/{name}", block, total)

    def write_final(self, state: State, snapshot) -> None:
        """The last state in full precision, /final."""
        points, cells = self.log.points, self.distribution.m
        rows = snapshot.rows
        gid = self.distribution.subdomain.element_gid
        p = {"particle_id": state.gid[rows], "position": state.x[rows], "velocity": snapshot.velocity}
        c = {"element_id": gid, "tension": snapshot.N, "plastic_strain": snapshot.eps_p}
        c |= _moments(state)
        blocks = (self._points(state, rows, p), p, points), (self._cells(state, c), c, cells)
        for found, columns, total in blocks:
            for name, block in found.items():
                self.file.put(f"final/{name}", block, total, columns[name].dtype)

    # --- the end

    def discard_after(self, error: OutputError, saved: bool) -> None:
        """Leave nothing behind that no checkpoint needs. saved : whether there is one"""
        self.file.discard_after(error)
        if self.comm.rank == 0 and not saved:
            for segment in self.segments:
                segment.unlink(missing_ok=True)

    def close(self, sections: dict[str, dict], provenance: dict, phases: dict, labels: dict) -> None:
        """Write what is small, name the unit of every dataset, and give the file its name.

        sections : on rank 0, datasets by group ("net", "history", ...)
        provenance : attributes and texts; phases : of `Phases.over_ranks`; labels : attributes of groups
        """

        def finish(file: h5py.File):
            self.series.finish(file)
            for group, datasets in sections.items():
                for name, values in datasets.items():
                    file.create_dataset(f"{group}/{name}", data=values)
            states = [group for group in sections if group != "form_finding" and f"{group}/tension" in file]
            for order, group in enumerate(states):
                file[group].attrs[ORDER] = order
            for group, attributes in labels.items():
                file.require_group(group).attrs.update(attributes)
            _write_provenance(file.create_group("provenance"), provenance, phases)
            label(file)

        if not self.segments:
            self.file.close(finish)
            return
        self._end_segment()
        on_root(self.comm, lambda: join_segments(self.segments, self.file.temporary, self.path, finish))


def _moments(state: State) -> dict[str, np.ndarray]:
    """Bending moments of the elements, where chains bend."""
    return {"bending_moment": state.bending_moments()} if state.features.bending else {}


def _stacked(columns: dict[str, np.ndarray]):
    """Columns (k,) or (k, w) beside one another, to be moved at once; and what takes them apart again."""
    wide = [values.reshape(len(values), math.prod(values.shape[1:])) for values in columns.values()]
    bounds = np.cumsum([0] + [values.shape[1] for values in wide])
    shapes = [values.shape[1:] for values in columns.values()]

    def split(block: np.ndarray) -> dict[str, np.ndarray]:
        parts = (block[:, low:high] for low, high in itertools.pairwise(bounds))
        return {name: part.reshape(len(block), *tail) for name, part, tail in zip(columns, parts, shapes)}

    return np.column_stack(wide), split


def label(file: h5py.File) -> None:
    """Name the unit of every dataset of numbers, by the table. Raises KeyError for one that has no row."""

    def add(path: str, item) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind != "O":
            item.attrs["unit"] = unit_of(path)

    file.visititems(add)


def _write_provenance(group, values, phases):
    for name, value in values.items():
        if isinstance(value, str):  # names of files may hold bytes that are no letters here
            value = value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
        if isinstance(value, dict):
            for column, array in value.items():
                group.create_dataset(f"{name}/{column}", data=array)
        elif (isinstance(value, str) and len(value) > 200) or name in ("job", "overrides", "notes"):
            group.create_dataset(name, data=value, dtype=h5py.string_dtype())
        else:
            group.attrs[name] = value
    timings = group.create_group("timings")
    for name, seconds in phases.items():
        timings.attrs[name] = seconds  # least, mean and largest of the ranks


def net_section(net: Net, roof: Roof, cut_length: np.ndarray) -> dict[str, np.ndarray]:
    """The datasets of /net. cut_length : (m,) [m], unstressed, at the temperature of form finding"""
    zones = roof.zones
    shared = {"zone_share": zones.share[:, :-1]} if len(zones.mixed) else {}
    shared |= {} if net.second_moment is None else _bar_section(net, cut_length)
    found = {
        "particles": net.x,
        "elements": net.elements,
        "fixed": net.fixed.astype(np.uint8),
        "group": net.group.astype(np.int32),
        "group_names": texts(net.group_names),
        "tributary_area": roof.area,
        "plan_area": roof.plan_area,
        "vector_area": roof.vector,
        "node_id": net.node_id,
        "element_id": net.element_id,
        "unstressed_length": cut_length,
        "cable": net.cable.astype(np.int32),
        "cable_names": texts(net.cable_names),
        "zone": zones.of_node.astype(np.int32),
        "zone_names": texts(zones.names),
    }
    return _strength_section(net) | shared | found


def _bar_section(net: Net, cut_length: np.ndarray) -> dict[str, np.ndarray]:
    """How bars buckle; cut_length : as of `net_section`."""
    return {
        "second_moment": net.second_moment,
        "buckling_length": buckling_lengths(net, cut_length),
        "euler_load": euler_load(net, cut_length),
        "buckling_curve": net.buckling_curve.astype(np.int32),
        "buckling_curve_names": texts(list(CURVES)),
        **{name: flags.astype(np.uint8) for name in FLAGS if (flags := getattr(net, name)) is not None},
    }


def texts(words: list[str]) -> np.ndarray:
    """Words as a dataset."""
    return np.array(words, h5py.string_dtype())


def slide_section(net: Net, slides: Slides) -> dict[str, np.ndarray]:
    """The places where cables may slip, /slide."""
    names = ("before", "after", "friction", "resistance")
    found = {"node": net.node_id[slides.node], "cable": texts([net.cable_names[k] for k in slides.cable])}
    return found | {name: getattr(slides, name) for name in names}


def _strength_section(net: Net) -> dict[str, np.ndarray]:
    """What elements are made of, springs; strengths as given, and beside them what was drawn, a factor."""
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
        section |= {"type": net.type.astype(np.int32), "type_names": texts(net.type_names)}
    return section
