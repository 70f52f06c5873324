"""The history of a dynamic stage: rows by name, and those of the probes. The same on every rank.

A column is added in `COLUMNS` and `columns_at`, and by a row in results/README.md, which has units and
meanings; the file, Python and checkpoints follow.
"""

import numpy as np

from netfall.mechanics.fields import Features
from netfall.mechanics.state import State
from netfall.model.probes import Probes
from netfall.parallel.mpi import MPI
from netfall.record.energy import Energies
from netfall.step.rows import MOST_STRAIN

AT_REST = 1e-4  # of the energy stored at the start: what moves with less is at rest, and rounding counts
DAMPING = ("damping_work", "air_work", "band_damping_work")
PROBE_ROWS = "probe_rows"
COLUMNS = (
    *("time", "time_step", "kinetic_energy", "strain_energy", "plastic_dissipation", "damping_work"),
    *("air_work", "band_damping_work", "slip_dissipation", "support_work", "external_work"),
    *("attached_energy", "identity_error", "balance_error", "balance_error_attached", "slack", "broken"),
)
COUNTS = ("slack", "broken")
# The feature of `mechanics.fields.Features` without which there is no such column.
NEEDS = {
    "air_work": "air",
    "band_damping_work": "band",
    "slip_dissipation": "sliding",
    "support_work": "motion",
}


def columns_at(time: np.ndarray, time_step: np.ndarray, e: Energies, start: tuple[float, float]) -> dict:
    """What rows (k,) have of energies [J], errors not yet as shares.

    time, time_step : (k,) [s]; start : strain energy and dissipation [J] at the start
    """
    strain, plastic = e.strain - start[0], e.plastic - start[1]
    gone = e.kinetic + strain + plastic + e.damping + e.air + e.band + e.slip
    balance = gone - e.external - e.support
    return {
        "time": time,
        "time_step": time_step,
        "kinetic_energy": e.kinetic,
        "strain_energy": strain,
        "plastic_dissipation": plastic,
        "damping_work": e.damping,
        "air_work": e.air,
        "band_damping_work": e.band,
        "slip_dissipation": e.slip,
        "support_work": e.support,
        "external_work": e.external,
        "attached_energy": e.attached,
        "identity_error": e.kinetic + e.internal + e.damping + e.air + e.slip - e.external - e.support,
        "balance_error": balance,
        "balance_error_attached": balance,
    }


def energy_in_play(rows: dict[str, np.ndarray]) -> np.ndarray:
    """The energy [J] that takes part at each row: external work, or where energy has gone if that is more.

    It goes into motion, strain, yield and damping; else it comes from the strain at the start.
    """
    gone = rows["kinetic_energy"] + np.maximum(rows["strain_energy"], 0.0) + rows["plastic_dissipation"]
    damped = sum(rows[name] for name in DAMPING if name in rows)
    given = np.maximum(np.abs(rows["external_work"]), np.abs(rows.get("support_work", 0.0)))
    energy = np.maximum(given, gone + damped)
    return np.where(np.isnan(energy), 0.0, energy)  # nan without the audit


# Energies [J] at each row whose largest so far errors are shares of, by the name that columns have for them.
SCALES = {"in_play": energy_in_play, "attached": lambda rows: np.nan_to_num(rows["attached_energy"])}
SHARES = {"identity_error": "in_play", "balance_error": "in_play", "balance_error_attached": "attached"}
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
    """Rows so far; each has a value for every one of COLUMNS that the scene has.

    scales : [J] largest energies so far, by name, which errors are shares of
    """

    def __init__(self, probes: Probes, features: Features):
        self.probes, self.scales = probes, dict.fromkeys(SCALES, 0.0)
        self.names = [name for name in COLUMNS if name not in NEEDS or getattr(features, NEEDS[name])]
        self.blocks: list[dict[str, np.ndarray]] = []  # of rows, with what was kept of the probes
        self.most_strained = NOT_STRAINED  # of this rank, and of all before a checkpoint

    def begin(self, stored: float) -> None:
        """At the start, where so much [J] is stored in the elements."""
        self.scales["in_play"] = AT_REST * stored

    def __len__(self) -> int:
        return sum(len(block["time"]) for block in self.blocks)

    def add(self, probe_rows: np.ndarray, columns: dict[str, np.ndarray]) -> None:
        """Add rows (k,): columns as of `columns_at`, and COUNTS.

        probe_rows : (k, p), as `step.rows.Table` has them
        """
        block = {name: np.asarray(columns[name]) for name in self.names}
        scales = {
            name: np.maximum.accumulate(np.append(self.scales[name], energy(block)))
            for name, energy in SCALES.items()
        }
        for name, share in SHARES.items():
            scale = scales[share][1:]
            block[name] = block[name] / np.where(scale > 0.0, scale, 1.0)
        self.scales = {name: float(scale[-1]) for name, scale in scales.items()}
        self.blocks.append(block | {PROBE_ROWS: probe_rows})

    def largest(self, name: str) -> float:
        """Largest absolute value of a column; nan if any is."""
        return float(np.abs(self.columns()[name]).max())

    def columns(self) -> dict[str, np.ndarray]:
        """The rows as columns, for the result file and for checkpoints."""
        return {name: self._whole(name, np.int64 if name in COUNTS else np.float64) for name in self.names}

    def _whole(self, name: str, dtype=np.float64) -> np.ndarray:
        """What was kept under a name, of all rows."""
        return np.concatenate([block[name] for block in self.blocks]) if self.blocks else np.zeros(0, dtype)

    def probe_columns(self) -> dict[str, np.ndarray]:
        """What was kept of nodes and elements by name, as datasets of /history."""
        probes, rows = self.probes, len(self)
        at_nodes, met = 3 * len(probes.particles), len(probes.elements)
        values = self._whole(PROBE_ROWS).reshape(rows, -1)[:, : at_nodes + met + len(probes.named)]
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

    def slip_columns(self) -> dict[str, np.ndarray]:
        """Of all places where cables slip, (t, k) as datasets of /slide."""
        probes = self.probes
        first = 3 * len(probes.particles) + len(probes.elements) + len(probes.named)
        slip, difference = np.hsplit(self._whole(PROBE_ROWS).reshape(len(self), -1)[:, first:], 2)
        return {"slip": slip, "difference": difference}

    def record(self) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, for `restore`."""
        return {"scales": self.scales}, self.columns() | {PROBE_ROWS: self._whole(PROBE_ROWS)}

    def restore(self, small: dict, arrays: dict[str, np.ndarray]) -> None:
        """Take up the rows of an earlier run."""
        self.scales = small["scales"]
        self.blocks = [{name: arrays[name] for name in (*self.names, PROBE_ROWS)}]
