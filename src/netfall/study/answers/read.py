"""Reading of a study file, NAME.study.h5, into memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.job.keys.schema import TABLES
from netfall.results.datasets import OUTCOME_BY_NAME, OUTCOMES
from netfall.study import messages
from netfall.study.table import check_format, read_columns

EVENTS = ("sample", "time", "element")
NET = {"particles": (0, 3), "elements": (0, 2), "element_id": (0,), "node_id": (0,), "fixed": (0, 3)}


@dataclass
class Study:
    """The contents of a study file.

    name : of the file, without .study.h5
    samples, events, net, fragility, hazard, failures : datasets by name, text as str. fragility is empty
        without several speeds; hazard and failures are empty unless the study file requests them
    first_breaks, breaks : (m,) runs in which an element broke first, or at all
    drawn : inputs with random values; None: not known
    removes : kind of the removed parts, "element" or "cable"; "": none, or not known
    notes : warnings and notes on the study and its job
    """

    name: str
    title: str
    samples: dict[str, np.ndarray]
    events: dict[str, np.ndarray]
    net: dict[str, np.ndarray]
    fragility: dict[str, np.ndarray]
    hazard: dict[str, np.ndarray]
    failures: dict[str, np.ndarray]
    first_breaks: np.ndarray
    breaks: np.ndarray
    drawn: list[str] | None = None
    removes: str = ""
    notes: Sequence[str] = ()

    def break_shares(self) -> list[tuple[str, np.ndarray]]:
        """Return the shares (m,) of samples in which each element breaks first, and breaks, with names.

        nan : never
        """
        broke, finished = int(self.first_breaks.sum()), int(self.finished.sum())
        rows = [
            (f"first to break, share of the {broke} samples that broke", self.first_breaks, broke),
            (f"breaks at all, share of the {finished} samples that finished", self.breaks, finished),
        ]
        return [(name, np.where(counts > 0, counts / max(total, 1), np.nan)) for name, counts, total in rows]

    @property
    def finished(self) -> np.ndarray:
        """Whether each sample (N,) ran to its end."""
        return np.asarray(self.samples["state"] == "finished")

    @property
    def moves(self) -> bool:
        """Whether samples have a dynamic stage."""
        return bool(np.isfinite(self.samples["duration"]).any())

    @property
    def exposure(self) -> str:
        """Duration of the wind in each sample, as text; "static wind" for equilibria."""
        seconds = np.unique(self.samples["duration"][np.isfinite(self.samples["duration"])])
        if not len(seconds):
            return "static wind"
        shortest, longest = f"{seconds[0]:g}", f"{seconds[-1]:g}"
        return f"exposure {shortest} s" if shortest == longest else f"exposure {shortest} to {longest} s"


def read_study(path: Path) -> Study:
    """Read a study file. Raises InputError if the layout is another or a part is missing."""
    with h5py.File(path, "r") as file:
        check_format(file, path)
        missing = [name for name in _required_datasets(file) if name not in file]
        if missing:
            raise InputError([messages.INCOMPLETE(path=path, name=name) for name in missing])
        empty_net = {name: np.zeros(shape, int) for name, shape in NET.items()}
        fragility, hazard, failures = (
            read_columns(file[name]) if name in file else {} for name in ("fragility", "hazard", "failures")
        )
        first_breaks, breaks = (
            file[name][:] if name in file else np.zeros(0, int) for name in ("first_breaks", "breaks")
        )
        name = path.name.removesuffix(".h5").removesuffix(".study")
        title = str(file.attrs.get("title", "")) or path.name
        samples, events = read_columns(file["samples"]), read_columns(file["events"])
        net = read_columns(file["net"]) if "net" in file else empty_net
        drawn = file["provenance/drawn"].asstr()[:].tolist() if "provenance/drawn" in file else None
        removes = str(file["provenance/removes"].asstr()[()]) if "provenance/removes" in file else ""
        notes = file["provenance/notes"].asstr()[:].tolist() if "provenance/notes" in file else []
        answers = fragility, hazard, failures, first_breaks, breaks
        return Study(name, title, samples, events, net, *answers, drawn, removes, notes)


def _required_datasets(file: h5py.File) -> list[str]:
    """Return the datasets that a file must contain.

    Outcomes of member removals are optional. The net is needed only if a run has one.
    """
    needed = [row for row in OUTCOMES if not (row.needs_removal or row.needs_depth)]
    names = [f"samples/{row.name}" for row in needed]
    names += [f"events/{name}" for name in EVENTS]
    return names + [f"net/{name}" for name in NET] * ("net" in file)


def unit_of_column(name: str) -> str:
    """Return the unit of a column of /samples, "" if it has none: an outcome, or a key of the job."""
    if name in OUTCOME_BY_NAME:
        return OUTCOME_BY_NAME[name].unit
    section, key = name.split(".")[0], name.split(".")[-1]
    keys = (
        *TABLES.get("cable" if section == "group" else section, ()),
        *TABLES.get(name.rpartition(".")[0], ()),
    )
    return next((row.unit for row in keys if row.name == key), "")


def with_unit(name: str) -> str:
    """Return a column's name with its unit: "wind.speed [m/s]"."""
    unit = unit_of_column(name)
    return f"{name} [{unit}]" if unit else name
