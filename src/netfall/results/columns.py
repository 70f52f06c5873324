"""Tables of a result for the Python interface: arrays by column name."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from netfall.job.values import suggest

# Datasets and groups that version 0.5 renamed: old name, new name.
RENAMED = {
    "rest": "initial_state",
    "identity_error": "work_identity_error",
    "balance_error": "energy_balance_error",
}


def renamed_text(old: str) -> str:
    """Return the message on the old name of a dataset or group."""
    return f"{old!r} is {RENAMED[old]!r} since version 0.5"


class Columns(Mapping[str, np.ndarray]):
    """Arrays by name. Each is read at its first use.

    `dict(columns)` reads all of them; pandas.DataFrame accepts the mapping.
    names : of the columns, in order; read : returns the array of a name; units : of some columns, as text
    """

    def __init__(self, place: str, names: list[str], read: Callable[[str], np.ndarray], units: Any = None):
        """place : the source of the table, for messages"""
        self._place, self._names, self._read, self.units = place, list(names), read, units or {}
        self._kept: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names and RENAMED.get(name) in self._names:
            raise KeyError(f"{self._place}: {renamed_text(name)}")
        if name not in self._names:
            raise KeyError(f"{self._place}: no column {name!r}; {suggest(str(name), self._names)}")
        if name not in self._kept:
            self._kept[name] = self._read(name)
        return self._kept[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        shapes = {name: str(np.shape(self[name])).replace(",)", ")") for name in self}
        lines = [f"  {name} {shape} {self.units.get(name, '')}".rstrip() for name, shape in shapes.items()]
        return "\n".join([f"{self._place}:", *lines])


def group_columns(place: str, group: Any, renamed: dict[str, str] | None = None) -> Columns:
    """Return the datasets of an HDF5 group as columns.

    renamed : dataset by column name; None: each dataset keeps its name
    """
    names = renamed or {name: name for name in group if hasattr(group[name], "shape")}
    units = {}
    for name, dataset in names.items():
        if (unit := group[dataset].attrs.get("unit")) is not None:
            units[name] = f"[{unit.decode() if isinstance(unit, bytes) else unit}]"

    def read(name: str) -> np.ndarray:
        if not group:
            raise ValueError(f"{place}: {name}: the result is closed; read what you need before")
        dataset = group[names[name]]
        return np.array(dataset.asstr()[()], str) if dataset.dtype.kind == "O" else dataset[()]

    return Columns(place, list(names), read, units)


def array_columns(place: str, arrays: dict[str, Callable[[], np.ndarray]], units: Any = None) -> Columns:
    """Return columns that functions compute when they are read."""
    return Columns(place, list(arrays), lambda name: arrays[name](), units)
