"""The table of a study's runs: a row for each member, from journals and study files, written as HDF5."""

import base64
from collections import Counter
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.results.outcomes import BY_NAME, OF_RUN, OUTCOMES
from netfall.study.answers.fragility import curve_sections
from netfall.study.answers.measures import failure_section
from netfall.write.locks import h5_whole, sync, writing

FORMAT = 1
MARK = "netfall_study"  # the attribute of the root that says what the file is
DIGESTS = {"study": "the study file", "job": "the job or its tables", "program": "the program"}
TEXT = h5py.string_dtype()


class Table:
    """Rows by the number of the member; `there` : which are known; `tries` : how often each was begun."""

    def __init__(self, count: int, nets_differ: bool = False):
        """nets_differ : between members, so that no element is that of another"""
        self.columns = {each.name: np.full(count, each.empty, each.dtype) for each in OF_RUN}
        self.there = np.zeros(count, bool)
        self.tries = np.zeros(count, np.int64)
        self.times: dict[int, np.ndarray] = {}  # of fractures, by member
        self.elements: dict[int, np.ndarray] = {}
        # None: not asked for yet; empty: it has no form, or is not one
        self.net: dict[str, np.ndarray] | None = {} if nets_differ else None
        self.counts: Counter[str] = Counter()  # of states

    def add(self, record: dict) -> None:
        """Take in a record of a journal."""
        if "try" in record:
            self.tries[record["try"]] += 1
        if "done" in record:
            self._add_row(record["done"], record)
        if "net" in record:
            array = lambda told: np.frombuffer(base64.b64decode(told["bytes"]), told["type"])
            self.net = {name: array(told).reshape(told["shape"]) for name, told in record["net"].items()}

    def _add_row(self, number: int, told: dict) -> None:
        if self.there[number]:
            if self.columns["state"][number] != "failed":
                return
            self.counts["failed"] -= 1  # it was run again
        self.there[number] = True
        for name, column in self.columns.items():
            column[number] = told[name]
        self.counts[told["state"]] += 1
        if told["times"]:
            self.times[number] = np.array(told["times"])
            self.elements[number] = np.array(told["elements"], np.int64)

    def add_file(self, path: Path) -> None:
        """Take in the rows of a study file, of a part or whole."""
        with h5py.File(path) as f:
            numbers = f["members/member"][:]
            new = ~self.there[numbers]
            for name, values in read_columns(f["members"]).items():
                if name in self.columns:
                    self.columns[name][numbers[new]] = values[new]
            self.tries[numbers[new]] += f["provenance/attempts"][:][new]
            self.counts.update(self.columns["state"][numbers[new]].tolist())
            member, time, element = (f[f"events/{name}"][:] for name in ("member", "time", "element"))
            bounds = np.searchsorted(member, np.arange(len(numbers) + 1))
            for row in np.flatnonzero(new & (np.diff(bounds) > 0)):
                part = slice(bounds[row], bounds[row + 1])
                self.times[int(numbers[row])] = time[part]
                self.elements[int(numbers[row])] = element[part]
            self.there[numbers] = True
            if self.net is None:
                self.net = read_columns(f["net"]) if "net" in f else {}

    def forget_failed(self) -> None:
        """Runs that failed count as not made."""
        failed = self.there & (self.columns["state"] == "failed")
        self.there[failed] = False
        self.counts["failed"] = 0

    # --- the study file

    def write(self, path: Path, plan, title: str, provenance: dict) -> None:
        """Write the rows that are known, in the order of the members. Raises OutputError.

        provenance : texts and numbers
        """
        rows = np.flatnonzero(self.there)
        members = self._members(rows, plan)
        with h5_whole(path) as f:
            f.attrs[MARK], f.attrs["title"] = FORMAT, title
            write_columns(f, "members", members)
            for name in BY_NAME.keys() & members.keys():
                if BY_NAME[name].unit:
                    f[f"members/{name}"].attrs["unit"] = BY_NAME[name].unit
            self._write_events(f, rows)
            if self.net:
                write_columns(f, "net", self.net)
                self._write_counts(f, rows)
            sections = curve_sections(members, plan.failures, plan.hazard)
            if plan.failures:
                sections["failures"] = failure_section(members, plan.failures)
            for name, columns in sections.items():
                write_columns(f, name, columns)
            write_columns(f, "provenance", provenance | {"attempts": self.tries[rows]})
        with writing(path):
            sync(path.parent)  # before the journal goes

    def _members(self, rows: np.ndarray, plan) -> dict[str, np.ndarray]:
        """The columns of /members."""
        found = [plan.member(int(number)) for number in rows]
        inputs = {name: _column([member.values[name] for member in found]) for name in plan.inputs}
        of_depth = {each.name for each in OUTCOMES if each.of_depth}
        columns = {"member": rows} | inputs | {name: values[rows] for name, values in self.columns.items()}
        if plan.depth is None:
            columns = {name: v for name, v in columns.items() if name not in of_depth}
        if plan.loss:
            columns["removed"] = np.array([member.removed for member in found], object)
        else:
            of_losses = {each.name for each in OUTCOMES if each.of_losses}
            columns = {name: values for name, values in columns.items() if name not in of_losses}
        columns["duration"] = np.array([plan.duration(member) for member in found])
        return columns

    def _write_events(self, f: h5py.File, rows: np.ndarray) -> None:
        broke = [(row, int(number)) for row, number in enumerate(rows) if int(number) in self.times]
        join = lambda parts, dtype: np.concatenate([np.zeros(0, dtype), *parts])
        columns = {
            "member": join([np.full(len(self.times[n]), row) for row, n in broke], np.int64),
            "time": join([self.times[n] for _, n in broke], float),
            "element": join([self.elements[n] for _, n in broke], np.int64),
        }
        write_columns(f, "events", columns)

    def _write_counts(self, f: h5py.File, rows: np.ndarray) -> None:
        """How often each element was the first to break, and broke at all."""
        first, at_all = np.zeros((2, len(self.net["elements"])), np.int64)
        for number in rows.tolist():
            if number in self.elements and self.columns["state"][number] == "finished":
                first[self.elements[number][0]] += 1
                at_all[np.unique(self.elements[number])] += 1
        f["first_breaks"], f["breaks"] = first, at_all


def check_digests(path: Path, found: dict, wanted: dict) -> None:
    """Raises InputError if a journal or a study file was made by another study, job or program."""
    changed = [words for name, words in DIGESTS.items() if found.get(name) != wanted[name]]
    if changed:
        raise InputError(
            f"{path}: was made before {' and '.join(changed)} changed, and its runs are not those of now; "
            "move it away to run the study from its start, or give another name with -o"
        )


def digests_of(path: Path) -> dict | None:
    """The digests in a study file; None if it is none."""
    try:
        with h5py.File(path) as f:
            if MARK not in f.attrs:
                return None
            return {name: f[f"provenance/{name}_digest"].asstr()[()] for name in DIGESTS}
    except (OSError, KeyError):
        return None


def text_of(path: Path) -> str:
    """The study file whose runs are in a file of results."""
    with h5py.File(path) as f:
        return f["provenance/study"].asstr()[()]


def _column(values: list) -> np.ndarray:
    """Values of a key of the job as a column: numbers where all are, else texts."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return np.array(values, np.int64)
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values, float)
    return np.array([value if isinstance(value, str) else str(value) for value in values], object)


def write_columns(f: h5py.File, group: str, columns: dict) -> None:
    """Write datasets by name into a new group; texts as such."""
    place = f.create_group(group)
    for name, values in columns.items():
        values = np.asarray(values)
        dtype = TEXT if values.dtype == object or values.dtype.kind == "U" else values.dtype
        place.create_dataset(name, data=values.astype(object) if dtype is TEXT else values, dtype=dtype)


def read_columns(group: h5py.Group) -> dict[str, np.ndarray]:
    """All datasets of a group; texts as str."""
    read = lambda d: d.asstr()[()] if h5py.check_string_dtype(d.dtype) else d[()]
    return {name: read(data) for name, data in group.items() if isinstance(data, h5py.Dataset)}
