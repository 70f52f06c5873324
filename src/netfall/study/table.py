"""Table of a study's runs: a row per sample, from journals and study files, written as HDF5."""

import base64
from collections import Counter
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.errors import InputError, other_version_error
from netfall.job.toml_text import toml_value
from netfall.results.datasets import OUTCOME_BY_NAME, RUN_OUTCOMES
from netfall.results.file import STUDY_ATTRIBUTE
from netfall.results.locks import atomic_h5, sync, writing
from netfall.study import messages
from netfall.study.answers.fragility import curve_sections, failure_section
from netfall.study.file import Plan

FORMAT = 2  # version of the layout of a study file
DIGESTS = {"study": "the study file", "job": "the job or its tables", "program": "the program"}
TEXT = h5py.string_dtype()


class Table:
    """Rows by number of the sample; `there` : whether each is finished; `tries` : number of attempts."""

    def __init__(self, count: int, nets_differ: bool = False):
        """nets_differ : samples have different nets, so that their elements cannot be compared"""
        self.columns: dict[str, np.ndarray] = {
            column.name: np.full(count, column.empty, column.dtype) for column in RUN_OUTCOMES
        }
        self.there = np.zeros(count, bool)
        self.tries = np.zeros(count, np.int64)
        self.times: dict[int, np.ndarray] = {}  # times of fractures, by sample
        self.elements: dict[int, np.ndarray] = {}
        # None: not requested yet; empty: no form, or nets differ
        self.net: dict[str, np.ndarray] | None = {} if nets_differ else None
        self.nets_differ = nets_differ
        self.counts: Counter[str] = Counter()  # number of samples by state

    def add(self, record: dict[str, Any]) -> None:
        """Include a record of a journal."""
        if "try" in record:
            self.tries[record["try"]] += 1
        if "done" in record:
            self._add_row(record["done"], record)
        if "net" in record:
            self.net = {name: _unpacked(packed) for name, packed in record["net"].items()}

    def _add_row(self, number: int, outcomes: dict[str, Any]) -> None:
        if self.there[number]:
            if self.columns["state"][number] != "failed":
                return
            self.counts["failed"] -= 1  # a failed run that was repeated
        self.there[number] = True
        for name, column in self.columns.items():
            column[number] = outcomes[name]
        self.counts[outcomes["state"]] += 1
        if outcomes["times"]:
            self.times[number] = np.array(outcomes["times"])
            self.elements[number] = np.array(outcomes["elements"], np.int64)

    def add_file(self, path: Path) -> None:
        """Add the rows of a study file, of a shard or the whole study."""
        with h5py.File(path) as f:
            numbers = f["samples/sample"][:]
            failed = self.there[numbers] & (self.columns["state"][numbers] == "failed")
            self.counts.subtract(self.columns["state"][numbers[failed]].tolist())  # these runs were repeated
            is_new = ~self.there[numbers] | failed
            for name, values in read_columns(f["samples"]).items():
                if name in self.columns:
                    self.columns[name][numbers[is_new]] = values[is_new]
            self.tries[numbers[is_new]] += f["provenance/attempts"][:][is_new]
            self.counts.update(self.columns["state"][numbers[is_new]].tolist())
            sample, time, element = (f[f"events/{name}"][:] for name in ("sample", "time", "element"))
            bounds = np.searchsorted(sample, np.arange(len(numbers) + 1))
            for row in np.flatnonzero(is_new & (np.diff(bounds) > 0)):
                span = slice(bounds[row], bounds[row + 1])
                self.times[int(numbers[row])] = time[span]
                self.elements[int(numbers[row])] = element[span]
            self.there[numbers] = True
            if self.net is None:
                self.net = read_columns(f["net"]) if "net" in f else {}

    def reset_failed(self) -> None:
        """Treat failed runs as missing, and a net that failed with them."""
        failed = self.there & (self.columns["state"] == "failed")
        if failed.any() and not self.net and not self.nets_differ:
            self.net = None
        self.there[failed] = False
        self.counts["failed"] = 0

    # --- the study file

    def write(self, path: Path, plan: Plan, title: str, provenance: dict[str, Any]) -> None:
        """Write the finished rows in the order of the samples. Raises OutputError.

        provenance : texts and numbers
        """
        rows = np.flatnonzero(self.there)
        samples = self._sample_columns(rows, plan)
        with atomic_h5(path) as f:
            f.attrs[STUDY_ATTRIBUTE], f.attrs["title"] = FORMAT, title
            write_columns(f, "samples", samples)
            for name in OUTCOME_BY_NAME.keys() & samples.keys():
                if OUTCOME_BY_NAME[name].unit:
                    f[f"samples/{name}"].attrs["unit"] = OUTCOME_BY_NAME[name].unit
            self._write_events(f, rows)
            if self.net:
                write_columns(f, "net", self.net)
                self._write_counts(f, rows, len(self.net["elements"]))
            sections = curve_sections(samples, plan.failures, plan.hazard, plan.distributions)
            if plan.failures:
                sections["failures"] = failure_section(samples, plan.failures)
            for name, columns in sections.items():
                write_columns(f, name, columns)
            write_columns(f, "provenance", provenance | {"attempts": self.tries[rows]})
        with writing(path):
            sync(path.parent)  # before the journal is removed

    def _sample_columns(self, rows: np.ndarray, plan: Plan) -> dict[str, np.ndarray]:
        """Return the columns of /samples."""
        samples = [plan.sample(int(number)) for number in rows]
        inputs = {name: _column([sample.values[name] for sample in samples]) for name in plan.inputs}
        columns = {"sample": rows} | inputs
        for name, values in self.columns.items():
            lacks_depth = OUTCOME_BY_NAME[name].needs_depth and plan.depth is None
            if not lacks_depth and (plan.loss or not OUTCOME_BY_NAME[name].needs_removal):
                columns[name] = values[rows]
        if plan.loss:
            columns["removed"] = np.array([sample.removed for sample in samples], object)
        columns["duration"] = np.array([plan.duration(sample) for sample in samples])
        return columns

    def _write_events(self, f: h5py.File, rows: np.ndarray) -> None:
        broken_samples = [(row, int(number)) for row, number in enumerate(rows) if int(number) in self.times]
        columns = {
            "sample": _joined([np.full(len(self.times[n]), row) for row, n in broken_samples], np.int64),
            "time": _joined([self.times[n] for _, n in broken_samples], float),
            "element": _joined([self.elements[n] for _, n in broken_samples], np.int64),
        }
        write_columns(f, "events", columns)

    def _write_counts(self, f: h5py.File, rows: np.ndarray, elements: int) -> None:
        """Write how often each element broke first, and how often it broke."""
        first, at_all = np.zeros((2, elements), np.int64)
        for number in rows.tolist():
            if number in self.elements and self.columns["state"][number] == "finished":
                first[self.elements[number][0]] += 1
                at_all[np.unique(self.elements[number])] += 1
        f["first_breaks"], f["breaks"] = first, at_all


def _joined(parts: list[np.ndarray], dtype: type) -> np.ndarray:
    """Concatenate arrays, possibly none."""
    return np.concatenate([np.zeros(0, dtype), *parts])


def check_digests(path: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Check that a journal or study file belongs to this study, job and program. Raises InputError."""
    changed = [words for name, words in DIGESTS.items() if found.get(name) != wanted[name]]
    if changed:
        raise InputError(messages.OTHER_STUDY(path=path, changed=" and ".join(changed)))


def check_format(f: h5py.File, path: Path) -> None:
    """Check that a study file has the layout that this version writes. Raises InputError."""
    if f.attrs[STUDY_ATTRIBUTE] != FORMAT:
        version = f["provenance/netfall"].asstr()[()] if "provenance/netfall" in f else None
        remedy = "move it away and run the study again, or read it with that version"
        raise other_version_error(path, version, remedy)


def read_digests(path: Path) -> dict[str, Any] | None:
    """Return the digests in a study file; None for another file."""
    try:
        with h5py.File(path) as f:
            if STUDY_ATTRIBUTE not in f.attrs:
                return None
            check_format(f, path)
            return {name: f[f"provenance/{name}_digest"].asstr()[()] for name in DIGESTS}
    except (OSError, KeyError):
        return None


def text_of(path: Path) -> str:
    """Return the text of the study file from which a result was computed."""
    with h5py.File(path) as f:
        return str(f["provenance/study"].asstr()[()])


def _unpacked(packed: dict[str, Any]) -> np.ndarray:
    """Decode an array from `driver.worker.encode_array`."""
    return np.frombuffer(base64.b64decode(packed["bytes"]), packed["type"]).reshape(packed["shape"])


def _column(values: list[Any]) -> np.ndarray:
    """Return values of a key of the job as a column: numbers if all are numbers, otherwise text of TOML."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return np.array(values, np.int64)
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values, float)
    return np.array([value if isinstance(value, str) else toml_value(value) for value in values], object)


def write_columns(f: h5py.File, group: str, columns: dict[str, Any]) -> None:
    """Write datasets by name into a new group; text as UTF-8 strings."""
    place = f.create_group(group)
    for name, values in columns.items():
        values = np.asarray(values)
        dtype = TEXT if values.dtype == object or values.dtype.kind == "U" else values.dtype
        place.create_dataset(name, data=values.astype(object) if dtype is TEXT else values, dtype=dtype)


def read_columns(group: h5py.Group) -> dict[str, np.ndarray]:
    """Return all datasets of a group; text as str. A key with "/" is a dataset in groups of its parts."""
    names: list[str] = []
    group.visit(names.append)
    return {
        name: data.asstr()[()] if h5py.check_string_dtype(data.dtype) else data[()]
        for name, data in ((name, group[name]) for name in names)
        if isinstance(data, h5py.Dataset)
    }
