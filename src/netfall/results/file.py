"""Result file: its opening, title, job, notes, names of elements, static cases, and frames one at a time."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import InputError, other_version_error
from netfall.core.functions import surface_axes
from netfall.core.messages import is_note, is_warning
from netfall.job.job import parse_tables
from netfall.results import messages, states
from netfall.results.datasets import BEYOND_LIMIT_POINT, EQUILIBRIUM

FORMAT = 2  # version of the layout of a result file, in /provenance; files of netfall 0.4 have no number
STUDY_ATTRIBUTE = "netfall_study"  # attribute of the root that identifies a study file
OF_MOTION = ("events", "envelope", "final")  # groups that a dynamic stage writes together with /history


def open_result(path: Path) -> h5py.File:
    """Open a result file of netfall for reading. Raises InputError if the file is not one."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        if path.is_dir():
            raise InputError(messages.FOLDER_AS_RESULT(path=path)) from None
        if not path.exists():
            raise InputError(messages.MISSING_RESULT(path=path)) from None
        reason = str(error).split("(")[-1].rstrip(")")
        raise InputError(messages.UNREADABLE_RESULT(path=path, reason=reason)) from None
    missing = [name for name in ("VTKHDF", *OF_MOTION * ("history" in file)) if name not in file]
    if "provenance" not in file or "net" not in file:
        wrong = InputError(messages.OTHER_HDF5_FILE(path=path))
    elif STUDY_ATTRIBUTE in file.attrs:
        wrong = InputError(messages.STUDY_AS_RESULT(path=path))
    elif file["provenance"].attrs.get("format") != FORMAT:
        version = file["provenance"].attrs.get("netfall")
        wrong = other_version_error(path, version, "run the job again, or read the file with that version")
    elif missing:
        wrong = InputError(messages.MISSING_DATASET(path=path, name=missing[0]))
    else:
        return file
    file.close()
    raise wrong


def is_study(path: Path) -> bool:
    """Return whether a file is a study file; false also if it cannot be read."""
    try:
        with h5py.File(path, "r") as file:
            return STUDY_ATTRIBUTE in file.attrs
    except OSError:
        return False


def provenance_text(file: h5py.File, name: str) -> str:
    """Return a text of /provenance. A long text is a dataset there, a short one an attribute."""
    group = file["provenance"]
    return group[name].asstr()[()] if name in group else str(group.attrs[name])


def read_job_tables(file: h5py.File) -> dict[str, Any]:
    """Return the tables of the job, with the overrides of the run."""
    return parse_tables(provenance_text(file, "job"), provenance_text(file, "overrides").splitlines())


def roof_axes(file: h5py.File) -> FloatArray | None:
    """Return the axes (3, 3) in which the roof is drawn, of `[roof] normal`; None: x, y, z."""
    return surface_axes(read_job_tables(file).get("roof", {}).get("normal"))


def warnings_of_run(file: h5py.File) -> list[str]:
    """Return all warnings that the run printed."""
    return provenance_text(file, "warnings").splitlines()


def notes_of_run(file: h5py.File) -> list[str]:
    """Return the notes on the job that the run printed before it started."""
    return [line for line in provenance_text(file, "notes").splitlines() if is_note(line)]


def result_title(file: h5py.File) -> str:
    """Return the title of the job, or its name if it has no title."""
    return provenance_text(file, "title") or provenance_text(file, "job_name")


@contextmanager
def missing_dataset_errors(path: Path) -> Iterator[None]:
    """Convert the KeyError of h5py for a dataset that a result file lacks into an InputError."""
    try:
        yield
    except KeyError as error:
        quoted = re.search(r"(?:object|attribute:) '([^']+)'", str(error.args[0]))
        name = quoted[1] if quoted else "a group"
        raise InputError(messages.MISSING_DATASET(path=path, name=name)) from None


@contextmanager
def open_checked(path: Path) -> Iterator[h5py.File]:
    """Open a result file for reading. Raises InputError also if a dataset is found missing later."""
    with open_result(path) as file, missing_dataset_errors(path):
        yield file


def element_name(net: Any, e: int) -> str:
    """Return the id of an element with the ids of its nodes; net : datasets of /net by name.

    The elements of a subdivided cable share its id and differ in their nodes.
    """
    a, b = (net["node_id"][p] for p in net["elements"][e])
    return f"{net['element_id'][e]} ({a}-{b})"


def form_finding_lines(f: h5py.File) -> list[str]:
    """Return the text on form finding that the run printed, without its warnings (`warnings_of_run`)."""
    return [line for line in provenance_text(f, "form").splitlines() if not is_warning(line)]


# a load case on its own; kinds of a combination
PLAIN, COMBINATION_KINDS = "case", ("ULS", "SLS")


class Case(NamedTuple):
    """A static load case or combination and its equilibrium.

    name : as in the job; kind : PLAIN, or one of COMBINATION_KINDS
    shown : the equilibrium, or the last state that the load path reached
    state : equilibrium | no_equilibrium | unstable | undecided | beyond_limit_point
    load_factor : the largest reached, or that of a limit point; 0: permanent loads, 1: the whole case
    reason : why the load path ended there, "" if it did not
    """

    name: str
    kind: str
    shown: states.StateView
    state: str
    load_factor: float
    reason: str

    @property
    def carries(self) -> bool:
        """Whether an equilibrium exists under the full load, stable or not."""
        return self.state not in states.FAILED_STATES


def read_cases(f: Any) -> list[Case]:
    """Return the static load cases and combinations in the order of the job."""
    combinations = read_job_tables(f).get("combination", [])
    kinds = {
        combination["name"]: combination.get("kind", COMBINATION_KINDS[0]) for combination in combinations
    }
    places = [place for place in states.equilibrium_groups(f) if place.startswith("cases/")]
    return [_case(f, place, kinds.get(place.removeprefix("cases/"), PLAIN)) for place in places]


def _case(f: Any, place: str, kind: str) -> Case:
    attrs, (shown,) = f[place].attrs, states.group_equilibria(f, place)
    name = place.removeprefix("cases/")
    state, factor, reason = str(attrs["state"]), float(attrs["load_factor"]), str(attrs["reason"])
    if states.passes_limit_point(f, place):
        state = BEYOND_LIMIT_POINT if state == EQUILIBRIUM else state
        factor = float(np.fmin(factor, attrs.get(states.LIMIT_POINT, 0.0)))  # 0: before the load of the case
        reason = reason or "the path from the form passes a limit point, where the net snaps through"
    return Case(name, kind, shown, state, factor, reason)


def moves(f: Any) -> bool:
    """Return whether a result file has snapshots of a motion."""
    return "history" in f and len(f["VTKHDF/Steps/Values"]) > 1


class Frames:
    """Time steps of /VTKHDF: positions, connectivity, point fields and cell fields."""

    def __init__(self, f: Any):
        self.g = f["VTKHDF"]
        self.times = self.g["Steps/Values"][:]
        self.cells = len(f["net/elements"])
        self.there = ~states.absent(f)
        self.element_id = f["net/element_id"][:]

    def cell(self, name: Any, step: Any, low: Any = 0, high: Any = None) -> Any:
        """Return a cell field (m,) at a step, or its rows low to high."""
        start = int(self.g[f"Steps/CellDataOffsets/{name}"][step])
        high = self.cells if high is None else high
        return self.g[f"CellData/{name}"][start + low : start + high]

    def tension(self, step: Any) -> Any:
        """Return the tensions (m,) [N] at a step."""
        return self.cell("tension", step)

    def present(self, step: Any) -> Any:
        """Return which elements (m,) are part of the net after erection."""
        return self.there

    def broken(self, step: Any) -> Any:
        """Return which elements (m,) are broken or removed at a step."""
        return self.cell("broken", step).astype(bool) & self.there

    def broken_count(self, step: Any) -> int:
        """Count the broken or removed elements at a step; a subdivided element counts as one."""
        return len(np.unique(self.element_id[self.broken(step)]))

    def point(self, name: Any, step: Any, low: Any = 0, high: Any = None) -> Any:
        """Return a point field (points, ...) at a step, nodes of the net first, or its rows low to high."""
        start = int(self.g[f"Steps/PointDataOffsets/{name}"][step])
        high = self._points(step) if high is None else high
        return self.g[f"PointData/{name}"][start + low : start + high]

    def _points(self, step: Any) -> Any:
        return int(self.g["NumberOfPoints"][int(self.g["Steps/PartOffsets"][step])])

    def positions(self, step: Any) -> Any:
        """Return the positions (points, 3) [m] at a step."""
        first = int(self.g["Steps/PointOffsets"][step])
        return self.g["Points"][first : first + self._points(step)]

    def ends(self, step: Any) -> Any:
        """Return the rows (m, 2) of the points at the ends of the elements at a step."""
        link = int(self.g["Steps/ConnectivityIdOffsets"][step, 0])
        return self.g["Connectivity"][link : link + 2 * self.cells].reshape(-1, 2)

    def lines(self, step: Any) -> Any:
        """Return the end points (m, 2, 3) [m] of the elements at a step."""
        return self.positions(step)[self.ends(step)]
