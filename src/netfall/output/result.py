"""The result file of a run: frames while it goes on, everything small at the end. Layout: README, "The result file"."""

import os
import re
import secrets
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from mpi4py import MPI

from netfall.errors import InputError
from netfall.mechanics.state import State
from netfall.net.net import Net
from netfall.output.h5 import SharedFile, publish
from netfall.output.place import writing
from netfall.output.vtkhdf import VtkSeries
from netfall.parallel.distribute import Distribution
from netfall.parallel.root import on_root

HISTORY = {  # column of /history: unit
    "time": "s",
    "time_step": "s",
    "kinetic_energy": "J",
    "strain_energy": "J",
    "plastic_dissipation": "J",
    "damping_work": "J",
    "external_work": "J",
    "identity_error": "share of the largest external work",
    "balance_error": "share of the largest external work",
    "slack": "cables",
    "broken": "elements",
}
COPY_BYTES = 1 << 26  # held at once while segments are joined


class Event(NamedTuple):
    """One fracture at one end of an element, in global numbers; new_particle = -1: nothing split, at a loose end or without fragments."""

    step: int
    element: int
    particle: int
    new_particle: int
    strain: float
    mass: float  # kg, of the new particle


EVENTS = {
    "time": np.float64,
    "step": np.int64,
    "element": np.int64,
    "particle": np.int64,
    "new_particle": np.int64,
    "strain": np.float64,
    "mass": np.float64,
}


class Result:
    """Collects what a run reports. Methods are collective; what is kept in memory is the same on every rank."""

    def __init__(self, comm: MPI.Comm, path: Path, distribution: Distribution, group: np.ndarray):
        """group : (m_local,) group of the rank's elements."""
        self.comm = comm
        self.path = path
        self.distribution = distribution
        self.group = group
        self.file = SharedFile(comm, path)
        self.segments: list[Path] = []  # whole parts of the file so far, if there are checkpoints
        self.token = comm.bcast(secrets.token_hex(4))  # keeps this run's segments apart from another's
        self.series = VtkSeries(self.file, distribution.n, distribution.m)
        self.split_gid = np.zeros(0, np.int64)  # numbers of the particles that have split off, ascending
        self.events: list[tuple] = []  # (time, Event)
        self.broken: set[int] = set()
        self._drawn_events = -1
        self.history: list[list[float]] = []
        self.probes: list[np.ndarray] = []

    # --- segments, records

    def cut(self) -> dict[str, int]:
        """Close what has been written as a segment and go on in a new one; the rows so far, on ranks that write."""
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
        self.series.continue_in(self.file)

    def record(self) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, for `restore`: small values and arrays."""
        arrays = {f"events_{name}": values for name, values in self._event_columns().items()}
        arrays |= {"history": np.array(self.history), "probes": np.array(self.probes)}
        return {
            "series": self.series.record(),
            "drawn_events": self._drawn_events,
            "segments": [os.path.relpath(s, self.path.parent) for s in self.segments],
        }, arrays

    def restore(
        self, record: dict, arrays: dict[str, np.ndarray], rows: dict[str, int], segments: list[Path]
    ) -> None:
        """Take up the record of an earlier run, whose segments are those given."""
        self.file.discard_all()
        events = zip(*(arrays[f"events_{name}"].tolist() for name in EVENTS))
        self.add_events([(time, Event(*rest)) for time, *rest in events])
        self.history, self.probes = arrays["history"].tolist(), list(arrays["probes"])
        self.segments = segments
        self._begin_segment(rows)
        self.series.restore(record["series"])
        self._drawn_events = record["drawn_events"]

    # --- numbering

    def add_events(self, events: list[tuple]) -> None:
        """Fractures since the last call, from all ranks: (time, Event)."""
        self.events += sorted(events, key=lambda e: (e[1].step, e[1].element, e[1].particle))
        self.broken.update(e.element for _, e in events)
        new = [e.new_particle for _, e in events if e.new_particle >= 0]
        self.split_gid = np.sort(np.concatenate([self.split_gid, np.array(new, np.int64)]))

    def row_of(self, gid: np.ndarray) -> np.ndarray:
        """Global rows of particles: the net's by number, then those that split off by number."""
        n = self.distribution.n
        return np.where(gid < n, gid, n + np.searchsorted(self.split_gid, gid))

    # --- states

    def _points(self, state: State, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return self.file.blocks.collect(
            self.row_of(state.gid[rows]), columns, self.distribution.n + len(self.split_gid)
        )

    def _cells(self, state: State, columns: np.ndarray) -> np.ndarray:
        mine = state.owned.astype(bool)
        return self.file.blocks.collect(
            self.distribution.piece.element_gid[mine], columns[mine], self.distribution.m
        )

    def write_frame(self, time: float, state: State, snapshot) -> None:
        """One step of /VTKHDF."""
        points, cells = self.distribution.n + len(self.split_gid), self.distribution.m
        rows = snapshot.rows
        if self._drawn_events != len(self.events):
            gid = state.gid[rows]
            ends = self.row_of(
                state.gid[np.where(state.EA[:, None] > 0.0, state.ends, state.ends[:, :1])]
            )  # what is out of the net is drawn as a point
            mesh = self._cells(
                state, np.column_stack([ends, self.group, self.distribution.piece.element_gid])
            )
            number = self._points(state, rows, gid[:, None])
            self.series.write_mesh(
                mesh[:, :2],
                {"GlobalPointId": number[:, 0]},
                {"group": mesh[:, 2], "GlobalCellId": mesh[:, 3]},
                points,
                cells,
            )
            self._drawn_events = len(self.events)
        x = state.x[rows]
        p = self._points(state, rows, np.column_stack([x, x - state.x_start[rows], snapshot.velocity]))
        c = self._cells(state, np.column_stack([snapshot.N, snapshot.eps, snapshot.eps_p, state.broken]))
        self.series.write_step(
            time,
            p[:, :3],
            {"displacement": p[:, 3:6], "velocity": p[:, 6:9]},
            {"tension": c[:, 0], "strain": c[:, 1], "plastic_strain": c[:, 2], "broken": c[:, 3]},
            points,
            cells,
        )

    def write_static_step(self, state: State, snapshot) -> None:
        """One load step of /statics."""
        n, m = self.distribution.n, self.distribution.m
        if "statics/displacement" not in (self.file.file if self.file.writes else ()):
            self.file.create("statics/displacement", np.float64, (n, 3))
            self.file.create("statics/tension", np.float64, (m,))
        rows = snapshot.rows
        self.file.append_state(
            "statics/displacement", self._points(state, rows, state.x[rows] - state.x_start[rows]), n
        )
        self.file.append_state("statics/tension", self._cells(state, snapshot.N[:, None])[:, 0], m)

    def write_final(self, state: State, snapshot) -> None:
        """The last state in full precision, /final."""
        points, cells = self.distribution.n + len(self.split_gid), self.distribution.m
        rows = snapshot.rows
        p = self._points(state, rows, np.column_stack([state.gid[rows], state.x[rows], snapshot.velocity]))
        c = self._cells(state, np.column_stack([snapshot.N, snapshot.eps_p]))
        for name, dtype, tail, block, total in (
            ("particle_id", np.int64, (), p[:, 0], points),
            ("position", np.float64, (3,), p[:, 1:4], points),
            ("velocity", np.float64, (3,), p[:, 4:], points),
            ("element_id", np.int64, (), None, cells),
            ("tension", np.float64, (), c[:, 0], cells),
            ("plastic_strain", np.float64, (), c[:, 1], cells),
        ):
            self.file.create(f"final/{name}", dtype, tail, total)
            if block is None:
                low, high = self.file.blocks.bounds(cells)[self.comm.rank : self.comm.rank + 2]
                block = np.arange(low, high)
            self.file.append(f"final/{name}", block, total)

    # --- the end

    def close(self, sections: dict[str, dict], provenance: dict, phases: dict[str, np.ndarray]) -> None:
        """Write what is small and give the file its name.

        sections : on rank 0, datasets by group ("net", "form_finding", ...); provenance : attributes and texts; phases : of `Phases.over_ranks`
        """

        def finish(file: h5py.File):
            self.series.finish(file)
            if self.history:
                columns = np.array(self.history)
                for k, (name, unit) in enumerate(HISTORY.items()):
                    values = columns[:, k].astype(np.int64) if name in ("slack", "broken") else columns[:, k]
                    file.create_dataset(f"history/{name}", data=values).attrs["unit"] = unit
                self._write_events(file)
            for group, datasets in sections.items():
                for name, values in datasets.items():
                    file.create_dataset(f"{group}/{name}", data=values)
            _write_provenance(file.create_group("provenance"), provenance, phases)

        if not self.segments:
            self.file.close(finish)
            return
        self._end_segment()
        on_root(self.comm, lambda: join_segments(self.segments, self.file.temporary, self.path, finish))

    def _event_columns(self) -> dict[str, np.ndarray]:
        rows = [(time, *event) for time, event in self.events]
        return {
            name: np.array([row[k] for row in rows], dtype) for k, (name, dtype) in enumerate(EVENTS.items())
        }

    def _write_events(self, file):
        for name, values in self._event_columns().items():
            file.create_dataset(f"events/{name}", data=values)


def append_rows(source: h5py.File, target: h5py.File, limit: dict[str, int] | None = None) -> None:
    """Append the rows of every dataset of one file to the other's, up to `limit` rows of it where given."""

    def copy(name, item):
        if not isinstance(item, h5py.Dataset) or limit is not None and name not in limit:
            return
        rows = item.shape[0] if limit is None else limit[name]
        if name not in target:
            target.create_dataset(
                name,
                (0, *item.shape[1:]),
                maxshape=(None, *item.shape[1:]),
                chunks=item.chunks,
                dtype=item.dtype,
            )
        out, first = target[name], target[name].shape[0]
        out.resize(first + rows, axis=0)
        slab = max(
            1, COPY_BYTES // max(1, item.dtype.itemsize * int(np.prod(item.shape[1:], dtype=np.int64)))
        )
        for begin in range(0, rows, slab):
            end = min(begin + slab, rows)
            out[first + begin : first + end] = item[begin:end]

    source.visititems(copy)


def join_segments(segments: list[Path], temporary: Path, path: Path, finish) -> None:
    """The result file from its segments and the small datasets; the segments are then removed. Rank 0."""
    with writing(path):
        with h5py.File(temporary, "w") as file:
            for segment in segments:
                with h5py.File(segment, "r") as part:
                    append_rows(part, file)
            finish(file)
        publish(temporary, path)
    for segment in segments_of(path):
        segment.unlink(missing_ok=True)


def segments_of(path: Path) -> list[Path]:
    """The segments of a result file, of this run and of earlier ones that were killed."""
    name = re.compile(re.escape(f".{path.name}.segment-") + r"[0-9a-f]{8}-(\d{6,}|recovered)")
    return [segment for segment in path.parent.iterdir() if name.fullmatch(segment.name)]


def find_segments(
    folder: Path, names: list[str], rows: dict[str, int], results: list[Path], digest: str, target: Path
) -> list[Path]:
    """The segments of an interrupted run; or, if it went on and finished, one made from its result file. Rank 0.

    results : where that may be; target : name of the segment that is then made. Raises InputError if there is neither.
    """
    found = [folder / name for name in names]
    if all(segment.exists() for segment in found):
        return found
    for result in results:
        try:
            with h5py.File(result, "r") as file:
                if file["provenance"].attrs["job_digest"] == digest:
                    with h5py.File(target, "w") as part:
                        append_rows(file, part, rows)
                    return [target]
        except (OSError, KeyError):
            continue
    missing = next(segment for segment in found if not segment.exists())
    raise InputError(
        f"{missing}: this part of the interrupted run's result is missing, and {results[0]} is not that run's result; "
        "keep both beside the checkpoint"
    )


def _write_provenance(group, values, phases):
    for name, value in values.items():
        if isinstance(value, str) and len(value) > 200 or name in ("job", "overrides"):
            group.create_dataset(name, data=value, dtype=h5py.string_dtype())
        else:
            group.attrs[name] = value
    timings = group.create_group("timings")
    for name, seconds in phases.items():
        timings.attrs[name] = seconds  # least, mean and largest of the ranks


def net_section(net: Net, area: np.ndarray) -> dict[str, np.ndarray]:
    """The datasets of /net."""
    return {
        "particles": net.x,
        "elements": net.elements,
        "fixed": net.fixed.astype(np.uint8),
        "group": net.group.astype(np.int32),
        "group_names": np.array(net.group_names, h5py.string_dtype()),
        "tributary_area": area,
        "node_id": net.node_id,
        "element_id": net.element_id,
    }
