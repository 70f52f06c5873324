"""What one run of a trade gave, and the journal that keeps it."""

from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from netfall.results.frames import Frames
from netfall.study.journal import Journal, read_journal

NAN = float("nan")
STATES = {0: "finished", 2: "refused", 3: "diverged"}  # by exit code: what a further try would give again


class Outcome(NamedTuple):
    """What one run gave, in SI units; nan where there is nothing of the kind."""

    state: str  # finished | refused | diverged | failed
    reason: str = ""
    seconds: float = NAN  # of the dynamic stage, the slowest rank
    time_step: float = NAN
    largest_displacement: float = NAN  # up to the reference's first fracture
    largest_tension: float = NAN  # the same
    first_fracture: float = NAN  # time
    first_element: int = -1
    broken: int = -1
    balance_error: float = NAN
    broken_elements: str = ""  # ids, for the overlap


def outcome_of(told: dict, file: h5py.File | None, until: float | None) -> Outcome:
    """The outcome of a run from what its worker told and its result file, None where there is none.

    until : time [s] up to which displacement and tension count, None: the run's own first fracture
    """
    if file is None:
        return Outcome(STATES.get(told["exit_code"], "failed"), told["reason"])
    frames, events, ids = Frames(file), file["events"], file["net/element_id"][:]
    first = float(events["time"][0]) if len(events["time"]) else NAN
    if until is None:
        until = end_of_comparison(first)
    displacement = tension = 0.0
    for step in np.flatnonzero(frames.times <= until):
        moved = np.linalg.norm(frames.point("displacement", step), axis=1)
        displacement = max(displacement, moved.max(initial=0.0))
        tension = max(tension, frames.cell("tension", step).max(initial=0.0))
    broken = np.unique(events["element"][:])
    return Outcome(
        "finished",
        "",
        float(file["provenance/timings"].attrs["dynamics"][2]),
        float(file["provenance"].attrs["shortest_time_step"]),
        float(displacement),
        float(tension),
        first,
        int(ids[events["element"][0]]) if len(broken) else -1,
        len(broken),
        float(np.abs(file["history/balance_error"][:]).max()),
        " ".join(map(str, ids[broken].tolist())),
    )


def end_of_comparison(first_fracture: float) -> float:
    """Until when [s] runs are compared: the reference's first fracture, the end if it has none."""
    return first_fracture if np.isfinite(first_fracture) else np.inf


class Outcomes:
    """Outcomes so far by what was run, in a journal; a trade that was stopped goes on where it was."""

    def __init__(self, path: Path, header: dict):
        """header : what all of them depend on; if it has changed, the journal begins anew"""
        records = read_journal(path)[0] if path.exists() else []
        if records[:1] != [header]:
            path.unlink(missing_ok=True)
        self.there: dict[str, list[Outcome]] = {}
        for record in records[1:] if path.exists() else []:
            self.there.setdefault(record["run"], []).append(Outcome(**record["outcome"]))
        self.journal = Journal(path, header)

    def add(self, key: str, outcome: Outcome) -> None:
        """Take in an outcome; one that another try may better stays for this session."""
        self.there.setdefault(key, []).append(outcome)
        if outcome.state in STATES.values():
            self.journal.add({"run": key, "outcome": outcome._asdict()})

    def best(self, key: str, repeats: int) -> Outcome | None:
        """The fastest of so many runs, fewer if one did not come to its end; None: more are to be made."""
        found = self.there.get(key, [])
        finished = [outcome for outcome in found if outcome.state == "finished"]
        if len(finished) == len(found) < repeats:
            return None
        return min(finished, key=lambda outcome: outcome.seconds, default=found[-1])

    def close(self) -> None:
        """The end of writing."""
        self.journal.sync()
        self.journal.close()
