"""History of a dynamic stage: rows by name, and rows of the probes. Every rank has the same rows.

To add a column, extend `COLUMNS` of `explicit.history_columns` and `history_columns` below. Nothing else is
needed for the result file, Python, checkpoints and the page of the result file.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.explicit.energy import Energies
from netfall.explicit.history_columns import COLUMNS
from netfall.explicit.sampling import REPORTED_STRAIN, Table
from netfall.model.layout import Probes
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import LIMBS, round_over_ranks
from netfall.physics.fields import Features
from netfall.physics.state import State

# steps n after which the balance error of a motion from rest is at most 2.5 / n^2 = 1e-3 of its energy: the
# work of a row includes that on the way dt^2 a / 8 beyond its position
START_STEPS = 50
NEGLIGIBLE_ENERGY = 1e-4  # of the initial stored energy, the smallest reference of errors
ROUNDING_FACTOR = 4e3  # smallest reference over the rounding error: four such errors are 1e-3 of it (W735)
DAMPING = ("damping_work", "air_work", "band_damping_work")
PROBE_ROWS = "probe_rows"
COUNTS = ("slack", "broken")


class ReducedRows(NamedTuple):
    """Rows of `explicit.sampling.Table` over all ranks, except size and who, which are of this rank.

    sums : (k, s) [J], rounded, in the order of `explicit.energy_check.ObservationArrays`
    """

    number: np.ndarray
    time_step: np.ndarray
    slack: np.ndarray
    sums: np.ndarray
    probes: np.ndarray
    size: np.ndarray
    who: np.ndarray


def reduce_rows(comm: MPI.Comm, rows: Table) -> ReducedRows:
    """Combine the rows of all ranks. Collective."""
    slack, probes, limbs = rows.slack.copy(), rows.probes.copy(), rows.sums
    comm.Allreduce(MPI.IN_PLACE, slack, MPI.SUM)
    comm.Allreduce(MPI.IN_PLACE, probes, MPI.SUM)  # exact: one rank has the value, the others 0
    sums = round_over_ranks(comm, limbs.reshape(-1, LIMBS)).reshape(limbs.shape[:2])
    return ReducedRows(rows.number.copy(), rows.time_step.copy(), slack, sums, probes, rows.size, rows.who)


def history_columns(
    rows: ReducedRows, time: np.ndarray, e: Energies, broken: np.ndarray, start: tuple[float, float]
) -> dict[str, Any]:
    """Compute the columns of rows (k,) from energies [J], with errors in [J], not yet relative.

    time : (k,) [s]; broken : (k,) elements broken before
    start : strain energy and dissipation [J] at the start
    """
    strain, plastic = e.strain - start[0], e.plastic - start[1]
    expended = e.kinetic + strain + plastic + e.damping + e.air + e.band + e.slip
    balance = expended - e.external - e.support
    return {
        "time": time,
        "time_step": rows.time_step,
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
        "work_identity_error": e.kinetic + e.internal + e.damping + e.air + e.slip - e.external - e.support,
        "energy_balance_error": balance,
        "balance_error_attached": balance,
        "slack": rows.slack,
        "broken": broken,
    }


def energy_in_play(rows: dict[str, np.ndarray]) -> np.ndarray:
    """Compute the energy [J] that takes part at each row.

    This is the external work, or the expended energy if that is larger. Expended energy is motion, strain,
    plastic dissipation and damping. It exceeds external work if it comes from the initial strain energy.
    Friction heat of slips does not count.
    """
    expended = rows["kinetic_energy"] + np.maximum(rows["strain_energy"], 0.0) + rows["plastic_dissipation"]
    damped = sum(rows[name] for name in DAMPING if name in rows)
    given = np.maximum(np.abs(rows["external_work"]), np.abs(rows.get("support_work", 0.0)))
    energy = np.maximum(given, expended + damped)
    return np.where(np.isnan(energy), 0.0, energy)  # nan without the energy check


# Reference energy of each error: an error is relative to the largest value up to its row, and in the first
# START_STEPS of a motion to the largest up to START_STEPS later.
ERROR_REFERENCE = {
    "work_identity_error": "in_play",
    "energy_balance_error": "in_play",
    "balance_error_attached": "attached",
}
NO_LARGE_STRAIN = (0.0, 0.0, -1)


def most_strained(
    state: State, time: float, eps: np.ndarray, N: np.ndarray, gid: np.ndarray
) -> tuple[Any, ...]:
    """Find the largest strain above REPORTED_STRAIN of this rank's elements that have no fracture limit.

    Return it with its time and its element. time : [s]; eps, N : (m,) strains and axial forces [N]
    gid : (m,) global numbers of the elements
    """
    if max(eps.max(initial=0.0), -eps.min(initial=0.0)) <= REPORTED_STRAIN:
        return NO_LARGE_STRAIN
    unbreakable = np.ones(len(eps), bool) if state.eps_u is None else ~np.isfinite(state.eps_u)
    unbreakable &= state.broken == 0
    # The strain of a slack cable has no meaning.
    strain = np.where(unbreakable & (N != 0.0), np.abs(eps), 0.0)
    e = int(np.argmax(strain))
    return (float(strain[e]), time, int(gid[e])) if strain[e] > REPORTED_STRAIN else NO_LARGE_STRAIN


def largest_unlimited_strain_of_ranks(comm: MPI.Comm, local: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the result of `most_strained` with the largest strain of all ranks. Collective."""
    return max(comm.allgather(local), key=lambda candidate: (candidate[0], -candidate[2]))


class History:
    """The rows so far. Each has a value for all of COLUMNS that the problem has.

    keeps_probes : whether this rank writes the values of probes; other ranks discard them
    scales : [J] smallest reference energies of errors, by name; the blocks hold errors in [J]
    """

    def __init__(self, probes: Probes, features: Features, keeps_probes: bool):
        self.probes, self.scales = probes, {"in_play": 0.0, "attached": 0.0}
        self.keeps_probes = keeps_probes
        self.names = [
            column.name for column in COLUMNS if not column.needs or getattr(features, column.needs)
        ]
        self.blocks: list[dict[str, np.ndarray]] = []  # blocks of rows, with those of the probes
        self.most_strained = NO_LARGE_STRAIN  # of this rank; of all ranks for the time before a checkpoint

    def begin(self, stored: float, rounding: float) -> None:
        """Set the initial reference energies from the energy [J] stored in the elements at the start.

        rounding : [J], of all steps, see `explicit.energy.rounding_energy`
        """
        least = ROUNDING_FACTOR * rounding
        self.scales = {"in_play": max(NEGLIGIBLE_ENERGY * stored, least), "attached": least}

    def __len__(self) -> int:
        return sum(len(block["time"]) for block in self.blocks)

    def add(self, probe_rows: np.ndarray, columns: dict[str, np.ndarray]) -> None:
        """Append rows (k,); columns : those of `history_columns`.

        probe_rows : (k, p), in the layout of `explicit.sampling.Table`
        """
        self._append({name: np.asarray(columns[name]) for name in self.names}, probe_rows)

    def _append(self, block: dict[str, np.ndarray], probe_rows: np.ndarray) -> None:
        self.blocks.append(block | ({PROBE_ROWS: probe_rows} if self.keeps_probes else {}))

    def columns(self) -> dict[str, np.ndarray]:
        """Return the rows as columns, with errors relative to the reference energies."""
        columns = self._raw_columns()
        if not len(self):
            return columns
        time, soon = columns["time"], columns["time"] + START_STEPS * columns["time_step"]
        last = np.searchsorted(time, soon, side="right") - 1
        energies = {"in_play": energy_in_play(columns), "attached": np.nan_to_num(columns["attached_energy"])}
        for name, share in ERROR_REFERENCE.items():
            energy, least = energies[share], self.scales[share]
            scale = np.maximum.accumulate(np.maximum(energy, least))
            first = np.argmax(scale > least)  # row of the motion
            scale = np.where(time <= soon[first], scale[last], scale)
            columns[name] = columns[name] / np.where(scale > 0.0, scale, 1.0)
        return columns

    def _raw_columns(self) -> dict[str, np.ndarray]:
        """Return the rows as columns, with errors in [J]."""
        return {name: self._whole(name, np.int64 if name in COUNTS else np.float64) for name in self.names}

    def _whole(self, name: str, dtype: type = np.float64) -> np.ndarray:
        """Concatenate the values of a name over all rows."""
        return np.concatenate([block[name] for block in self.blocks]) if self.blocks else np.zeros(0, dtype)

    def probe_columns(self) -> dict[str, np.ndarray]:
        """Return the values of probed nodes and elements as datasets of /history."""
        probes, rows = self.probes, len(self)
        node_values, tensions = 3 * len(probes.particles), len(probes.elements)
        values = self._whole(PROBE_ROWS).reshape(rows, -1)[:, : node_values + tensions + len(probes.named)]
        columns = {"probe_displacement": values[:, :node_values].reshape(rows, len(probes.particles), 3)}
        if node_values:
            columns |= {
                "probe_tension": values[:, node_values : node_values + tensions],
                "probe_particle": probes.particles,
                "probe_element": probes.elements,
            }
        if len(probes.named):
            named = {"element": probes.named, "element_id": probes.named_id}
            columns |= {"element_tension": values[:, node_values + tensions :], **named}
        return columns

    def slip_columns(self) -> dict[str, np.ndarray]:
        """Return slip and force difference (t, k) of all slip points, as datasets of /slide."""
        probes = self.probes
        first = 3 * len(probes.particles) + len(probes.elements) + len(probes.named)
        slip, difference = np.hsplit(self._whole(PROBE_ROWS).reshape(len(self), -1)[:, first:], 2)
        return {"slip": slip, "difference": difference}

    def record(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the data for `restore`."""
        probe_rows = {PROBE_ROWS: self._whole(PROBE_ROWS)} if self.keeps_probes else {}
        return {"scales": self.scales}, self._raw_columns() | probe_rows

    def restore(self, small: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore the rows of an earlier run."""
        self.scales = small["scales"]
        self.blocks = []
        self._append({name: arrays[name] for name in self.names}, arrays[PROBE_ROWS])
