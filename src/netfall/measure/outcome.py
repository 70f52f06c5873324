"""What one run of a study gave, and the file that keeps it."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.launch import RunFailed, passing_result, run_job_command
from netfall.results.frames import Frames
from netfall.write.locks import h5_updated

LASTING = ("finished", "refused", "diverged")  # what a further try would give again


@dataclass
class Outcome:
    """What one run gave, in SI units; nan where there is nothing of the kind."""

    state: str  # finished | refused | diverged | failed
    reason: str
    seconds: float  # of the dynamic stage, the slowest rank
    time_step: float
    largest_displacement: float  # up to the reference's first fracture
    largest_tension: float  # the same
    first_fracture: float  # time
    first_element: int
    broken: int
    balance_error: float
    broken_elements: str  # ids, for the overlap


def best_of(repeats: int, run: Callable[[], Outcome]) -> Outcome:
    """The fastest of several runs; one alone if it did not finish."""
    found = run()
    for _ in range(repeats - 1):
        if found.state == "finished":
            found = min(found, run(), key=lambda outcome: outcome.seconds)
    return found


def measure(
    path: Path, overrides: list[str], ranks: int, launcher: str, folder: Path, until: float
) -> Outcome:
    """The outcome of one run; displacements and tensions up to the time `until` [s]."""
    nothing = {field.name: np.nan for field in fields(Outcome)} | {
        "first_element": -1,
        "broken": -1,
        "broken_elements": "",
    }
    with passing_result(folder) as result:
        try:
            run_job_command(launcher, ranks, path, result, overrides)
        except RunFailed as failed:
            return Outcome(**{**nothing, "state": failed.state, "reason": failed.reason})
        with h5py.File(result, "r") as file:
            return read_outcome(file, until)


def read_outcome(file: h5py.File, until: float) -> Outcome:
    """The quantities of one result file."""
    frames = Frames(file)
    displacement = tension = 0.0
    for step in np.flatnonzero(frames.times <= until):
        displacement = max(
            displacement, np.linalg.norm(frames.point("displacement", step), axis=1).max(initial=0.0)
        )
        tension = max(tension, frames.cell("tension", step).max(initial=0.0))
    events, ids = file["events"], file["net/element_id"][:]
    broken = np.unique(events["element"][:])
    first = events["time"][0] if len(events["time"]) else np.nan
    return Outcome(
        "finished",
        "",
        float(file["provenance/timings"].attrs["dynamics"][2]),
        float(file["provenance"].attrs["time_step"]),
        float(displacement),
        float(tension),
        float(first),
        int(ids[events["element"][0]]) if len(broken) else -1,
        len(broken),
        float(np.abs(file["history/balance_error"][:]).max()),
        " ".join(map(str, ids[broken].tolist())),
    )


class Store:
    """Outcomes so far, in one HDF5 file; a study that was stopped goes on where it was.

    digest : of what all outcomes depend on; if it has changed, none of them is used
    """

    def __init__(self, path: Path, digest: str):
        self.path, self.digest = path, digest

    def outcome(self, key: str, run: Callable[[], Outcome]) -> Outcome:
        """The outcome that is stored under a key, else that of a run, which is stored if it lasts."""
        key = key.replace("/", "|")
        if not self.path.exists() or self._other():
            with h5_updated(self.path) as file:
                file.clear()
                file.attrs["digest"] = self.digest
        with h5py.File(self.path, "r") as file:
            stored = file.get("outcomes", {})
            if key in stored:
                return Outcome(**json.loads(stored[key][()]))
        found = run()
        if found.state in LASTING:
            with h5_updated(self.path) as file:
                file.require_group("outcomes")[key] = json.dumps(asdict(found))
        return found

    def _other(self) -> bool:
        """Whether what is there is of another study."""
        with h5py.File(self.path, "r") as file:
            return file.attrs.get("digest") != self.digest
