"""A study file, NAME.study.h5, read into memory for what is told and drawn of it."""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.job.schema import SECTIONS
from netfall.results.outcomes import BY_NAME, OUTCOMES
from netfall.study.table import MARK, read_columns

ASKED = ("fragility", "hazard", "failures")
EVENTS = ("member", "time", "element")
NET = {"particles": (0, 3), "elements": (0, 2), "element_id": (0,), "node_id": (0,), "fixed": (0, 3)}


@dataclass
class Study:
    """What a study file holds.

    name : of the file, without .study.h5
    members, events, net, fragility, hazard, failures : datasets by name; texts as str; fragility:
        empty without several speeds; the three that follow: empty where the study file asks for none
    first_breaks, breaks : (m,) runs in which an element broke first, or at all
    """

    name: str
    title: str
    members: dict[str, np.ndarray]
    events: dict[str, np.ndarray]
    net: dict[str, np.ndarray]
    fragility: dict[str, np.ndarray]
    hazard: dict[str, np.ndarray]
    failures: dict[str, np.ndarray]
    first_breaks: np.ndarray
    breaks: np.ndarray

    def element(self, e: int) -> str:
        """An element by its id, with the ids of its nodes."""
        a, b = self.net["node_id"][self.net["elements"][e]]
        return f"{self.net['element_id'][e]} ({a}-{b})"

    @property
    def finished(self) -> np.ndarray:
        """Which members (N,) came to their end."""
        return self.members["state"] == "finished"

    @property
    def moves(self) -> bool:
        """Whether members have a dynamic stage."""
        return bool(np.isfinite(self.members["duration"]).any())

    @property
    def exposure(self) -> str:
        """How long the wind blows in each member, in words."""
        seconds = np.unique(self.members["duration"][np.isfinite(self.members["duration"])])
        if not len(seconds):
            return "unknown"
        least, most = f"{seconds[0]:g}", f"{seconds[-1]:g}"
        return f"{least} s" if least == most else f"{least} to {most} s"


def is_study(path: Path) -> bool:
    """Whether a file is that of a study; false also where it cannot be read."""
    try:
        with h5py.File(path, "r") as file:
            return MARK in file.attrs
    except OSError:
        return False


def read_study(path: Path) -> Study:
    """A study file in memory. Raises InputError where something of it is missing."""
    with h5py.File(path, "r") as file:
        missing = [name for name in _needed(file) if name not in file]
        if missing:
            raise InputError([f"{path}: no /{name}; expected a study file that is whole" for name in missing])
        nothing = {name: np.zeros(shape, int) for name, shape in NET.items()}
        return Study(
            path.name.removesuffix(".h5").removesuffix(".study"),
            str(file.attrs.get("title", "")) or path.name,
            read_columns(file["members"]),
            read_columns(file["events"]),
            read_columns(file["net"]) if "net" in file else nothing,
            *(read_columns(file[name]) if name in file else {} for name in ASKED),
            *(file[name][:] if name in file else np.zeros(0, int) for name in ("first_breaks", "breaks")),
        )


def _needed(file: h5py.File) -> list[str]:
    """What must be in a file, whatever its members lose; and a net only if a run had one."""
    names = [f"members/{each.name}" for each in OUTCOMES if not (each.of_losses or each.of_depth)]
    names += [f"events/{name}" for name in EVENTS]
    return names + [f"net/{name}" for name in NET] * ("net" in file)


def unit_of_column(name: str) -> str:
    """The unit of a column of /members, "" if it has none: of a result, or of a key of the job."""
    if name in BY_NAME:
        return BY_NAME[name].unit
    section, _, key = name.partition(".")
    return next((row.unit for row in SECTIONS.get(section, ()) if row.name == key.split(".")[-1]), "")


def with_unit(name: str) -> str:
    """A column's name with its unit: "wind.speed [m/s]"."""
    unit = unit_of_column(name)
    return f"{name} [{unit}]" if unit else name
