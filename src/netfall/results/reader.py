"""Python interface to a result file: tables by name, histories by the ids of the tables."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.core.messages import count_of
from netfall.job.values import suggest
from netfall.results import messages
from netfall.results.datasets import DIMENSIONLESS, GROUPS, ORDER_ATTRIBUTE, find_group
from netfall.results.file import Frames, open_result, provenance_text, result_title, warnings_of_run
from netfall.results.states import warm_lengths

# Datasets and groups that version 0.5 renamed: old name, new name.
RENAMED = {
    "rest": "initial_state",
    "identity_error": "work_identity_error",
    "balance_error": "energy_balance_error",
}


def renamed_text(old: str) -> str:
    """Return the message for the old name of a dataset or group."""
    return f"{old!r} is {RENAMED[old]!r} since version 0.5"


class Columns(Mapping[str, np.ndarray]):
    """Arrays by name. Each is read at its first use.

    `dict(columns)` reads all of them; pandas.DataFrame accepts the mapping.
    read : a function for each column, in order, that returns its array; units : of some columns, as text
    """

    def __init__(self, place: str, read: Mapping[str, Callable[[], np.ndarray]], units: dict[str, str]):
        """place : the source of the table, for messages"""
        self._place, self._read, self.units = place, read, units
        self._kept: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._read and RENAMED.get(name) in self._read:
            raise KeyError(f"{self._place}: {renamed_text(name)}")
        if name not in self._read:
            raise KeyError(f"{self._place}: no column {name!r}; {suggest(str(name), [*self._read])}")
        if name not in self._kept:
            self._kept[name] = self._read[name]()
        return self._kept[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._read)

    def __len__(self) -> int:
        return len(self._read)

    def __repr__(self) -> str:
        shapes = {name: str(np.shape(self[name])).replace(",)", ")") for name in self}
        lines = [f"  {name} {shape} {self.units.get(name, '')}".rstrip() for name, shape in shapes.items()]
        return "\n".join([f"{self._place}:", *lines])


def group_columns(place: str, group: Any, renamed: dict[str, str] | None = None) -> Columns:
    """Return the datasets of a group as columns; renamed : dataset by column, None: the same names"""
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

    return Columns(place, {name: partial(read, name) for name in names}, units)


# Dataset of /events by column; nodes and elements are given by the ids of the tables.
EVENT_COLUMNS = {"time": "time", "step": "step", "element": "element_id", "node": "node_id"}
EVENT_COLUMNS |= {"strain": "strain", "mass": "mass", "element_row": "element"}
EVENT_COLUMNS |= {"particle": "particle", "new_particle": "new_particle"}


@dataclass(frozen=True)
class Frame:
    """The state at one time, with p points and m elements. The n nodes of the net come first.

    time : [s]; position, displacement : (p, 3) [m]; velocity : (p, 3) [m/s]
    node : (p,) ids; a fragment end has the id of the node from which it separated
    ends : (m, 2) rows of the points at the ends of the elements; element : (m,) ids
    tension : (m,) [N]; strain, plastic_strain : (m,); broken : (m,) bool
    """

    time: float
    position: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    node: np.ndarray
    ends: np.ndarray
    element: np.ndarray
    tension: np.ndarray
    strain: np.ndarray
    plastic_strain: np.ndarray
    broken: np.ndarray


def _group_property(name: str) -> property:
    """Return a property of Result for a group of the file; its help is the group's table of datasets."""
    group = find_group(name)
    shapes = [
        f"{dataset.name} ({dataset.shape}) [{dataset.unit or DIMENSIONLESS}] {dataset.meaning}"
        for dataset in group.datasets
    ]

    def read(result: "Result") -> Columns:
        return group_columns(f"{result.path}: {name}", result._group(name))

    return property(read, doc="\n".join([group.meaning, "", *shapes]))


class Result:
    """A result file, open for reading, as `netfall.open` and `netfall.run` return it.

    Nodes and elements are identified by the ids of the tables (of a generator: numbers from 0). The elements
    of a subdivided cable share its id. SI units throughout; forces in cables are positive in tension. A part
    that the job did not request raises AttributeError; `hasattr(result, "wind")` tests for it.
    """

    def __init__(self, path: str | Path):
        """Open a file. Raises InputError if it is not a result of netfall."""
        self.path = Path(path)
        self._file = open_result(self.path)
        self._frames = Frames(self.file)
        self._keeps: TemporaryDirectory[str] | None = None  # temporary folder that `close` removes

    @property
    def file(self) -> Any:
        """The open h5py.File. Raises ValueError after the result is closed."""
        self._check_open()
        return self._file

    def _check_open(self) -> None:
        if not self._file:
            remedy = f"netfall.open({str(self.path)!r}) opens it again"
            if self._keeps is not None:
                remedy = "its file was temporary. Run the job with an output to keep it"
            raise ValueError(f"{self.path}: this result is closed; {remedy}")

    # --- tables

    @property
    def nodes(self) -> Columns:
        """A row for each node of the net (n,): id, x, y, z [m] as given, fixed (n, 3), area [m2] of surface
        (also as tributary_area), plan_area [m2], vector_area (n, 3) [m2] (upward), zone (its name, "": none).
        """
        columns = {
            "id": lambda: self._net("node_id")[:],
            "x": lambda: self._net("particles")[:, 0],
            "y": lambda: self._net("particles")[:, 1],
            "z": lambda: self._net("particles")[:, 2],
            "fixed": lambda: self._net("fixed")[:].astype(bool),
            **dict.fromkeys(("area", "tributary_area"), lambda: self._net("tributary_area")[:]),
            "plan_area": lambda: self._net("plan_area")[:],
            "vector_area": lambda: self._net("vector_area")[:],
            "zone": self._zone_of_node,
        }
        units = dict.fromkeys("xyz", "[m]")
        units |= dict.fromkeys(("area", "tributary_area", "plan_area", "vector_area"), "[m2]")
        return Columns(f"{self.path}: nodes", columns, units)

    def _net(self, name: str) -> Any:
        """Return a dataset of /net."""
        return self.file[f"net/{name}"]

    def _zone_of_node(self) -> np.ndarray:
        names = np.append(self._net("zone_names").asstr()[:], "")  # zone -1: none
        return names[self._net("zone")[:]].astype(str)

    @property
    def elements(self) -> Columns:
        """A row for each element (m,): id, start, end (ids of nodes), group (its name), axial_stiffness [N],
        unstressed_length [m] at the temperature of form finding, unstressed_length_warm [m] at that of the
        loads, bar (1: it carries compression).
        """
        columns = {
            "id": lambda: self._net("element_id")[:],
            "start": lambda: self._net("node_id")[:][self._net("elements")[:, 0]],
            "end": lambda: self._net("node_id")[:][self._net("elements")[:, 1]],
            "group": lambda: self._net("group_names").asstr()[:][self._net("group")[:]].astype(str),
            "axial_stiffness": lambda: self._net("axial_stiffness")[:],
            "unstressed_length": lambda: self._net("unstressed_length")[:],
            "bar": lambda: self._net("bar")[:],
            "unstressed_length_warm": lambda: warm_lengths(self.file),
        }
        units = {"axial_stiffness": "[N]", "unstressed_length": "[m]", "unstressed_length_warm": "[m]"}
        return Columns(f"{self.path}: elements", columns, units)

    form_finding, statics, modes = map(_group_property, ("form_finding", "statics", "modes"))
    initial_state, history, envelope = map(_group_property, ("initial_state", "history", "envelope"))
    removal, wind, permanent = map(_group_property, ("removal", "wind", "permanent"))

    @property
    def rest(self) -> Columns:
        """The old name of `initial_state`. Raises KeyError."""
        raise KeyError(f"{self.path}: " + renamed_text("rest"))

    @property
    def events(self) -> Columns:
        """A row for each fracture: time [s], step, element and node (ids of the broken element and its end),
        strain, mass [kg] of the separated particle; rows of /net: element_row, particle, new_particle.
        """
        return group_columns(f"{self.path}: events", self._group("events"), EVENT_COLUMNS)

    @property
    def cases(self) -> dict[str, Columns]:
        """The static cases by name: displacement (n, 3) [m], load (n, 3) [N], tension (m,) [N], ..."""
        return self._named("cases", "case")

    @property
    def stages(self) -> dict[str, Columns]:
        """The stages of erection by name, in order: displacement (n, 3) [m] from the form, tension (m,) [N],
        unstressed_length (m,) [m], reaction (n, 3) [N] on the foundation, residual, slack.
        """
        return self._named("stages", "stage")

    def _named(self, name: str, words: str) -> dict[str, Columns]:
        """Return the equilibria of a group in the order of computation."""
        group = self._group(name)
        order = sorted(group, key=lambda key: group[key].attrs.get(ORDER_ATTRIBUTE, 0))
        return {key: group_columns(f"{self.path}: {words} {key}", group[key]) for key in order}

    def _group(self, name: str) -> Any:
        if name not in self.file:
            lacking = find_group(name).lacking
            raise AttributeError(f"{self.path}: there is no /{name}: the job has no {lacking}")
        return self.file[name]

    # --- over the frames

    @property
    def time(self) -> np.ndarray:
        """Times of the frames (f,) [s]; a job without [dynamics] has one frame, its final state, at 0."""
        self._check_open()
        return self._frames.times

    def tension(self, element: Any = None) -> np.ndarray:
        """Tension [N] over the frames `time`: (f,) of the element with this id, (f, k) of a list of ids or a
        cable of k elements, (f, m) of all.
        """
        return self._over_frames(self._frames.cell, "tension", self._rows("element", element), element)

    def strain(self, element: Any = None) -> np.ndarray:
        """Strain over the frames, shaped as `tension`."""
        return self._over_frames(self._frames.cell, "strain", self._rows("element", element), element)

    def displacement(self, node: Any = None) -> np.ndarray:
        """Displacement [m], as in `/VTKHDF`, over the frames `time`: (f, 3) of the node with this id,
        (f, k, 3) of a list of ids, (f, n, 3) of all.
        """
        return self._over_frames(self._frames.point, "displacement", self._rows("node", node), node)

    def velocity(self, node: Any = None) -> np.ndarray:
        """Velocity [m/s] over the frames, shaped as `displacement`."""
        return self._over_frames(self._frames.point, "velocity", self._rows("node", node), node)

    def _over_frames(self, read: Any, name: str, rows: Any, ids: Any) -> np.ndarray:
        low, high = (int(rows.min()), int(rows.max()) + 1) if len(rows) else (0, 0)
        values = np.array([read(name, step, low, high)[rows - low] for step in range(len(self.time))])
        return values[:, 0] if ids is not None and np.ndim(ids) == 0 and len(rows) == 1 else values

    def _rows(self, what: str, numbers: Any) -> np.ndarray:
        """Return the rows of /net of some ids, None: all.

        what : "node" or "element". Raises KeyError for unknown ids, TypeError if an id is not a number.
        """
        ids = self.file[f"net/{what}_id"][:]
        if numbers is None:
            return np.arange(len(ids))
        if np.asarray(numbers).dtype.kind not in "iuf":
            raise TypeError(f"{what} {numbers!r}: expected an id, which is a whole number, or a list of ids")
        rows_of_each = [np.flatnonzero(ids == number) for number in np.atleast_1d(numbers)]
        for number, rows in zip(np.atleast_1d(numbers), rows_of_each):
            if not len(rows):
                raise KeyError(
                    f"{what} {number}: there is no such id; they are from {ids.min()} to {ids.max()}"
                )
        return np.concatenate([np.zeros(0, np.int64), *rows_of_each])

    def frame(self, time: float) -> Frame:
        """Return the frame nearest to a time [s]; its attribute `time` is its exact time.

        Raises InputError if the run did not reach the time.
        """
        frames, times = self._frames, self.time
        if not times[0] <= time <= times[-1] * (1 + 1e-9):
            raise InputError(
                messages.TIME_OUTSIDE_FRAMES(path=self.path, time=time, first=times[0], last=times[-1])
            )
        step = int(np.abs(times - time).argmin())
        return Frame(
            time=float(times[step]),
            position=frames.positions(step),
            node=frames.point("node_id", step),
            ends=frames.ends(step),
            element=frames.cell("element_id", step),
            broken=frames.broken(step),
            **{name: frames.point(name, step) for name in ("displacement", "velocity")},
            **{name: frames.cell(name, step) for name in ("tension", "strain", "plastic_strain")},
        )

    # --- origin

    @property
    def title(self) -> str:
        """The job's title, or its name if it has no title."""
        return result_title(self.file)

    @property
    def job(self) -> str:
        """The text of the job that was run, without overrides."""
        return provenance_text(self.file, "job")

    @property
    def warnings(self) -> list[str]:
        """The warnings of the run, as `netfall info` prints them."""
        return warnings_of_run(self.file)

    def close(self) -> None:
        """Close the file; a temporary file is removed."""
        self._file.close()
        if self._keeps is not None:
            self._keeps.cleanup()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        if not self._file:
            return f"Result {self.path}, closed"
        n, m = len(self.file["net/particles"]), len(self.file["net/elements"])
        broken = f", {self.history['broken'][-1]} broken" if "history" in self.file else ""
        groups = (group.name.partition("/")[0] for group in GROUPS if group.lacking)
        stages = [top for top in groups if top in self.file]
        return (
            f"Result {self.path}: {self.title}: {n} nodes, {count_of(m, 'element')}, "
            f"{count_of(len(self.time), 'frame')} to {self.time[-1]:g} s{broken}; has {', '.join(stages)}"
        )
