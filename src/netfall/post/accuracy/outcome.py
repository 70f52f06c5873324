"""Outcome of one run of an accuracy study, and the journal of outcomes."""

from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.results.file import Frames
from netfall.study.journal import Journal, read_journal

NAN = float("nan")
REPRODUCIBLE_STATES = {0: "finished", 2: "refused", 3: "diverged"}  # by exit code: a repeated run ends alike


class AccuracyOutcome(NamedTuple):
    """Outcome of one run in SI units; nan if a quantity does not exist."""

    state: str  # finished | refused | diverged | failed
    reason: str = ""
    seconds: float = NAN  # run time of the dynamic stage on the slowest rank
    time_step: float = NAN
    largest_displacement: float = NAN  # up to the reference's first fracture
    largest_tension: float = NAN  # up to the reference's first fracture
    first_fracture: float = NAN  # time [s]
    first_element: int = -1
    broken: int = -1
    energy_balance_error: float = NAN
    broken_elements: str = ""  # ids, for the overlap


def read_outcome(answer: dict[str, Any], file: h5py.File | None, until: float | None) -> AccuracyOutcome:
    """Return the outcome of a run from its worker's answer and its result file, None without a file.

    until : time [s] up to which displacement and tension count, None: the run's own first fracture
    """
    if file is None:
        return AccuracyOutcome(REPRODUCIBLE_STATES.get(answer["exit_code"], "failed"), answer["reason"])
    frames, events, ids = Frames(file), file["events"], file["net/element_id"][:]
    first = float(events["time"][0]) if len(events["time"]) else NAN
    if until is None:
        until = end_of_comparison(first)
    steps, broken = np.flatnonzero(frames.times <= until), np.unique(events["element"][:])
    displacements = [np.linalg.norm(frames.point("displacement", step), axis=1).max() for step in steps]
    tensions = [frames.tension(step).max() for step in steps]
    return AccuracyOutcome(
        "finished",
        seconds=float(file["provenance/timings"].attrs["dynamics"][2]),
        time_step=float(file["provenance"].attrs["shortest_time_step"]),
        largest_displacement=float(max([0.0, *displacements])),
        largest_tension=float(max([0.0, *tensions])),
        first_fracture=first,
        first_element=int(ids[events["element"][0]]) if len(broken) else -1,
        broken=len(broken),
        energy_balance_error=float(np.abs(file["history/energy_balance_error"][:]).max()),
        broken_elements=" ".join(map(str, ids[broken].tolist())),
    )


def end_of_comparison(first_fracture: float) -> float:
    """Return the time [s] up to which runs are compared: the reference's first fracture, or the end."""
    return first_fracture if np.isfinite(first_fracture) else np.inf


class OutcomeJournal:
    """Outcomes so far by run key, in a journal, so that an interrupted accuracy study can continue."""

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """header : inputs of all outcomes; if it has changed, the journal starts again"""
        records = read_journal(path)[0] if path.exists() else []
        if records[:1] != [header]:
            path.unlink(missing_ok=True)
        self.there: dict[str, list[AccuracyOutcome]] = {}
        for record in records[1:] if path.exists() else []:
            self.there.setdefault(record["run"], []).append(AccuracyOutcome(**record["outcome"]))
        self.journal = Journal(path, header)

    def add(self, key: str, outcome: AccuracyOutcome) -> None:
        """Include an outcome. One that a repeated run may improve is not written to the journal."""
        self.there.setdefault(key, []).append(outcome)
        if outcome.state in REPRODUCIBLE_STATES.values():
            self.journal.add({"run": key, "outcome": outcome._asdict()})

    def best(self, key: str, repeats: int) -> AccuracyOutcome | None:
        """Return the fastest of so many runs; None if more are needed.

        A key with an unfinished run needs no more.
        """
        outcomes = self.there.get(key, [])
        finished = [outcome for outcome in outcomes if outcome.state == "finished"]
        if len(finished) == len(outcomes) < repeats:
            return None
        return min(finished, key=lambda outcome: outcome.seconds, default=outcomes[-1])

    def close(self) -> None:
        """Close the journal."""
        self.journal.sync()
        self.journal.close()
