"""The history of a dynamic stage: rows by name, and those of the probes. The same on every rank."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.fields import Features
from netfall.mechanics.state import State
from netfall.model.probes import Probes
from netfall.record.columns import HISTORY, Moment

AT_REST = 1e-4  # of the energy stored at the start: what moves with less is at rest, and rounding counts
DAMPING = ("damping_work", "air_work", "band_damping_work")
MOST_STRAIN = 0.1  # that any cable bears; what is beyond it without a limit of its own is told


def energy_in_play(row: dict[str, float]) -> float:
    """The energy [J] that takes part at one time: external work, or where energy has gone if that is more.

    It goes into motion, strain, yield and damping; else it comes from the strain at the start.
    """
    gone = row["kinetic_energy"] + max(row["strain_energy"], 0.0) + row["plastic_dissipation"]
    damped = sum(row.get(name, 0.0) for name in DAMPING)
    energy = max(abs(row["external_work"]), abs(row.get("support_work", 0.0)), gone + damped)
    return energy if energy == energy else 0.0  # nan without the audit


NOT_STRAINED = (0.0, 0.0, -1)


def most_strained(state: State, time: float, eps: np.ndarray, N: np.ndarray, gid: np.ndarray) -> tuple:
    """Largest strain beyond MOST_STRAIN of this rank's elements that nothing ever breaks, time, and element.

    time : [s]; eps, N : (m,) strains and axial forces [N]; gid : (m,) global numbers of the elements
    """
    if max(eps.max(initial=0.0), -eps.min(initial=0.0)) <= MOST_STRAIN:
        return NOT_STRAINED
    endless = np.ones(len(eps), bool) if state.eps_u is None else ~np.isfinite(state.eps_u)
    endless &= state.broken == 0  # what hangs on after a fracture has no limit any more
    strain = np.where(endless & (N != 0.0), np.abs(eps), 0.0)  # a slack cable may hang as it likes
    e = int(np.argmax(strain))
    return (float(strain[e]), time, int(gid[e])) if strain[e] > MOST_STRAIN else NOT_STRAINED


def most_strained_of_all(comm: MPI.Comm, here: tuple) -> tuple:
    """The one of all ranks with the largest strain, as of `most_strained`. Collective."""
    return max(comm.allgather(here), key=lambda found: (found[0], -found[2]))


class History:
    """Rows so far; each has a value for every column of HISTORY that the scene has.

    scale : [J] largest energy that took part so far, which both errors are shares of
    """

    def __init__(self, probes: Probes, features: Features):
        self.probes, self.scale = probes, 0.0
        self.table = [column for column in HISTORY if not column.needs or getattr(features, column.needs)]
        self.rows: dict[str, list] = {column.name: [] for column in self.table}
        self.probe_rows: list[np.ndarray] = []
        self.most_strained = NOT_STRAINED  # of this rank, and of all before a checkpoint

    def begin(self, stored: float) -> None:
        """At the start, where so much [J] is stored in the elements."""
        self.scale = AT_REST * stored

    def __len__(self) -> int:
        return len(self.rows["time"])

    def add(self, probe_row: np.ndarray, now: Moment) -> None:
        """The row of a moment. probe_row : as `LocalProbes.values` gives it"""
        values = {column.name: column.value(now) for column in self.table}
        self.scale = max(self.scale, energy_in_play(values))
        for column in self.table:
            value = values[column.name]
            self.rows[column.name].append(value / (self.scale or 1.0) if column.share else value)
        self.probe_rows.append(probe_row)

    def largest(self, name: str) -> float:
        """Largest absolute value of a column; nan if any is."""
        return float(np.abs(self.rows[name]).max())

    def columns(self) -> dict[str, np.ndarray]:
        """The rows as columns, for the result file and for checkpoints."""
        return {column.name: np.array(self.rows[column.name], column.dtype) for column in self.table}

    def probe_columns(self) -> dict[str, np.ndarray]:
        """What was kept of nodes and elements by name, as datasets of /history."""
        probes, rows = self.probes, len(self)
        at_nodes, met = 3 * len(probes.particles), len(probes.elements)
        values = np.array(self.probe_rows).reshape(rows, at_nodes + met + len(probes.named))
        columns = {"probe_displacement": values[:, :at_nodes].reshape(rows, len(probes.particles), 3)}
        if at_nodes:
            columns |= {
                "probe_tension": values[:, at_nodes : at_nodes + met],
                "probe_particle": probes.particles,
                "probe_element": probes.elements,
            }
        if len(probes.named):
            named = {"element": probes.named, "element_id": probes.named_id}
            columns |= {"element_tension": values[:, at_nodes + met :], **named}
        return columns

    def record(self) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, for `restore`."""
        return {"scale": self.scale}, self.columns() | {"probe_rows": np.array(self.probe_rows)}

    def restore(self, small: dict, arrays: dict[str, np.ndarray]) -> None:
        """Take up the rows of an earlier run."""
        self.scale = small["scale"]
        self.rows = {column.name: arrays[column.name].tolist() for column in self.table}
        self.probe_rows = list(arrays["probe_rows"])


class LocalProbes:
    """Local rows of the probes that this rank has, each with its place among all."""

    def __init__(self, subdomain, probes: Probes):
        rows = lambda numbers, sought: [
            (k, int(row)) for k, gid in enumerate(sought) for row in np.flatnonzero(numbers == gid)
        ]
        elements = np.concatenate([probes.elements, probes.named])
        self.count = len(probes.particles), len(elements)
        self.particles = rows(subdomain.particle_gid[: subdomain.n_owned], probes.particles)
        self.elements = rows(subdomain.element_gid, elements)

    def values(self, comm: MPI.Comm, state: State, snapshot) -> np.ndarray:
        """Displacements (p, 3) [m], tensions [N] of what meets there and of what is named, in one row.

        The same on every rank. Collective.
        """
        particles, elements = self.count
        values = np.zeros(3 * particles + elements)
        for k, row in self.particles:
            values[3 * k : 3 * k + 3] = state.x[row] - state.x_start[row]
        for k, row in self.elements:
            if state.owned[row]:
                values[3 * particles + k] = snapshot.N[row]
        values += 0.0  # no negative zeros
        comm.Allreduce(MPI.IN_PLACE, values, MPI.SUM)  # one term each but for zeros, so exact
        return values
