"""The result file of a run: frames while it goes on, everything small at the end. Layout: README, "The result file"."""

from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI

from netfall.mechanics.state import State
from netfall.net.net import Net
from netfall.output.h5 import SharedFile
from netfall.output.vtkhdf import VtkSeries
from netfall.parallel.distribute import Distribution

HISTORY = {  # column of /history: unit
    "time": "s", "time_step": "s", "kinetic_energy": "J", "strain_energy": "J", "plastic_dissipation": "J", "damping_work": "J",
    "external_work": "J", "identity_error": "share of the largest external work", "balance_error": "share of the largest external work",
    "slack": "cables", "broken": "elements"}
EVENTS = {"time": np.float64, "step": np.int64, "element": np.int64, "particle": np.int64, "new_particle": np.int64, "strain": np.float64}


class Result:
    """Collects what a run reports. Methods are collective; what is kept in memory is the same on every rank."""

    def __init__(self, comm: MPI.Comm, path: Path, distribution: Distribution, group: np.ndarray):
        """group : (m_local,) group of the rank's elements."""
        self.comm = comm
        self.distribution = distribution
        self.group = group
        self.file = SharedFile(comm, path)
        self.series = VtkSeries(self.file)
        self.split_gid = np.zeros(0, np.int64)  # numbers of the particles that have split off, ascending
        self.events: list[tuple] = []  # (time, Event)
        self.broken: set[int] = set()
        self._drawn_events = -1
        self.history: list[list[float]] = []
        self.probes: list[np.ndarray] = []

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
        return self.file.blocks.collect(self.row_of(state.gid[rows]), columns, self.distribution.n + len(self.split_gid))

    def _cells(self, state: State, columns: np.ndarray) -> np.ndarray:
        mine = state.owned.astype(bool)
        return self.file.blocks.collect(self.distribution.piece.element_gid[mine], columns[mine], self.distribution.m)

    def write_frame(self, time: float, state: State, snapshot) -> None:
        """One step of /VTKHDF."""
        points, cells = self.distribution.n + len(self.split_gid), self.distribution.m
        rows = snapshot.rows
        if self._drawn_events != len(self.events):
            gid = state.gid[rows]
            ends = self.row_of(state.gid[state.ends])
            mesh = self._cells(state, np.column_stack([ends, self.group, self.distribution.piece.element_gid]))
            number = self._points(state, rows, gid[:, None])
            self.series.write_mesh(mesh[:, :2], {"GlobalPointId": number[:, 0]}, {"group": mesh[:, 2], "GlobalCellId": mesh[:, 3]}, points, cells)
            self._drawn_events = len(self.events)
        x = state.x[rows]
        p = self._points(state, rows, np.column_stack([x, x - state.x_start[rows], snapshot.velocity]))
        c = self._cells(state, np.column_stack([snapshot.N, snapshot.eps, snapshot.eps_p, state.broken]))
        self.series.write_step(time, p[:, :3], {"displacement": p[:, 3:6], "velocity": p[:, 6:9]},
                               {"tension": c[:, 0], "strain": c[:, 1], "plastic_strain": c[:, 2], "broken": c[:, 3]}, points, cells)

    def write_static_step(self, state: State, snapshot) -> None:
        """One load step of /statics."""
        n, m = self.distribution.n, self.distribution.m
        if "statics/displacement" not in (self.file.file if self.file.writes else ()):
            self.file.create("statics/displacement", np.float64, (n, 3))
            self.file.create("statics/tension", np.float64, (m,))
        rows = snapshot.rows
        self.file.append_state("statics/displacement", self._points(state, rows, state.x[rows] - state.x_start[rows]), n)
        self.file.append_state("statics/tension", self._cells(state, snapshot.N[:, None])[:, 0], m)

    def write_final(self, state: State, snapshot) -> None:
        """The last state in full precision, /final."""
        points, cells = self.distribution.n + len(self.split_gid), self.distribution.m
        rows = snapshot.rows
        p = self._points(state, rows, np.column_stack([state.gid[rows], state.x[rows], snapshot.velocity]))
        c = self._cells(state, np.column_stack([snapshot.N, snapshot.eps_p]))
        for name, dtype, tail, block, total in (
                ("particle_id", np.int64, (), p[:, 0], points), ("position", np.float64, (3,), p[:, 1:4], points),
                ("velocity", np.float64, (3,), p[:, 4:], points), ("element_id", np.int64, (), None, cells),
                ("tension", np.float64, (), c[:, 0], cells), ("plastic_strain", np.float64, (), c[:, 1], cells)):
            self.file.create(f"final/{name}", dtype, tail)
            if block is None:
                low, high = self.file.blocks.bounds(cells)[self.comm.rank:self.comm.rank + 2]
                block = np.arange(low, high)
            self.file.append(f"final/{name}", block, total)

    # --- the end

    def close(self, sections: dict[str, dict], provenance: dict, phases: dict[str, float]) -> None:
        """Write what is small and give the file its name.

        sections : on rank 0, datasets by group ("net", "form_finding", ...); provenance : attributes and texts
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

        self.file.close(finish)

    def _write_events(self, file):
        rows = [(time, e.step, e.element, e.particle, e.new_particle, e.strain) for time, e in self.events]
        for k, (name, dtype) in enumerate(EVENTS.items()):
            file.create_dataset(f"events/{name}", data=np.array([row[k] for row in rows], dtype))


def _write_provenance(group, values, phases):
    for name, value in values.items():
        if isinstance(value, str) and len(value) > 200 or name in ("job", "overrides"):
            group.create_dataset(name, data=value, dtype=h5py.string_dtype())
        else:
            group.attrs[name] = value
    timings = group.create_group("timings")
    for name, seconds in phases.items():
        timings.attrs[name] = seconds


def net_section(net: Net, area: np.ndarray) -> dict[str, np.ndarray]:
    """The datasets of /net."""
    return {"particles": net.x, "elements": net.elements, "fixed": net.fixed.astype(np.uint8), "group": net.group.astype(np.int32),
            "group_names": np.array(net.group_names, h5py.string_dtype()), "tributary_area": area,
            "node_id": net.node_id, "element_id": net.element_id}
