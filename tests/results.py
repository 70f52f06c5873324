"""Read results: all datasets and attributes of a file, and the differences between two files."""

import csv
from pathlib import Path

import h5py
import numpy as np


def contents(file: h5py.File) -> dict[str, np.ndarray]:
    """Return all datasets and attributes ("name@attribute") except those of /provenance."""
    result = {f"/@{key}": np.asarray(value) for key, value in file.attrs.items()}

    def add(name, item):
        if name.split("/")[0] == "provenance":
            return
        result.update({f"{name}@{key}": np.asarray(value) for key, value in item.attrs.items()})
        if isinstance(item, h5py.Dataset):
            result[name] = np.asarray(item[()])

    file.visititems(add)
    return result


def differences(old: Path | h5py.File, new: Path | h5py.File) -> list[str]:
    """Return a line for each dataset or attribute that differs."""
    if not isinstance(old, h5py.File):
        with h5py.File(old, "r") as a, h5py.File(new, "r") as b:
            return differences(a, b)
    one, other = contents(old), contents(new)
    lines = [f"{name}: only in one of them" for name in sorted(one.keys() ^ other.keys())]
    return lines + [
        line for name in one if name in other for line in difference(name, one[name], other[name])
    ]


def difference(name: str, a: np.ndarray, b: np.ndarray) -> list[str]:
    """Return a line on the difference of two arrays, [] if they are equal."""
    if (a.dtype, a.shape) != (b.dtype, b.shape):
        return [f"{name}: {b.dtype} {b.shape}, was {a.dtype} {a.shape}"]
    if a.dtype == object:
        return [] if a.tolist() == b.tolist() else [f"{name}: another text"]
    if a.tobytes() == b.tobytes():
        return []
    rows = lambda v: np.frombuffer(v.tobytes(), np.uint8).reshape(v.size, -1)
    wrong = np.flatnonzero((rows(a) != rows(b)).any(1))
    return [f"{name}: {len(wrong)} of {a.size} values differ, {b.flat[wrong[0]]!r}, was {a.flat[wrong[0]]!r}"]


def assert_same_results(one: h5py.File, other: h5py.File) -> int:
    """Check that all bits except /provenance are equal; return the number of datasets."""
    lines = differences(one, other)
    assert not lines, "; ".join(lines[:8])
    return sum("@" not in name for name in contents(one))


def figures(result: Path) -> dict[str, int]:
    """Return the numbers of broken and yielded elements, and the largest number of slack cables."""
    with h5py.File(result, "r") as file:
        last = lambda name: int(np.max(file[name][()], initial=0)) if name in file else 0
        yielded = int(np.count_nonzero(file["final/plastic_strain"])) if "final/plastic_strain" in file else 0
        return dict(broken=last("history/broken"), yielded=yielded, slack=last("history/slack"))


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table that netfall has written."""
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


class Report:
    """Files that `netfall report` has written to a folder."""

    def __init__(self, folder: Path):
        self.folder = folder

    @property
    def page(self) -> str:
        """The summary."""
        return (self.folder / "summary.md").read_text()

    def rows(self, name: str) -> list[dict[str, str]]:
        """Return the rows of one of the tables."""
        return rows_of(self.folder / f"{name}.csv")
