"""Arguments of the kernels: numbers and arrays of several nets, and their conversion to records.

The first axis of every array on the device counts the nets. Nets share arrays if all their shapes are equal.
Only the number of particles with drag may differ.
"""

from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numba import types

from netfall.core.records import RecordType
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels
from netfall.gpu.target import tuple_of

# the records of `Work`, by their places in `LoopState`; records in `Rows` precede it
RECORDS = {name: name for name in ("particles", "elements", "slots", "law", "chunks", "spare")}
RECORDS |= {"rules": "fractures.rules", "events": "fractures.events", "relative": "relative", "rows": "rows"}
WHOLES, FLOATS = types.Array(types.int64, 1, "C"), types.Array(types.float64, 2, "C")
# arrays only on the device
DEVICE_ARRAYS: dict[str, tuple[str, types.Array]] = {"y": ("particles.x", FLOATS)}
DEVICE_ARRAYS |= dict.fromkeys(("counts", "best", "which"), ("", WHOLES))
# arrays that a trial changes, in the order of `kernels.copy_changes`
CHANGES = {
    "particles": ("x", "v", "work", "other_work"),
    "elements": ("highest", "lowest", "eps_p", "dissipated"),
    "slots": ("eps_p", "highest", "lowest"),
    "rows": ("last", "tension", "displacement", "reaction"),
}
LOADS = tuple(
    f"particles.{name}" for name in ("load_before", "load_after", "speed_before", "speed_after")
)  # arrays that change between launches
# arrays with two names
ALIASES = {"fractures.events.count": "spare.events", "rows.observed.rows": "spare.rows"}
HOST_CHANGES = (*LOADS, "rows.made", "spare.events")  # between launches, too: the device has older values
TABLE, EVENTS = "rows.table.", "fractures.events."


class Leaf(NamedTuple):
    """An array of `Work`. path : its place in a `LoopState`, or of an array with its shape; "": three numbers

    copied : whether the host has it too; cut : whether nets may have different numbers of rows
    """

    path: str
    kind: types.Array
    copied: bool = True
    cut: bool = False


class Layout:
    """Order of all numbers and arrays of `Work`.

    reals, wholes : paths of numbers; groups : places of the arrays of each type, the arguments of kernels,
    because tuples of mixed types take longer to compile
    source : of `work_at`
    """

    def __init__(self) -> None:
        self.reals: list[str] = []
        self.wholes: list[str] = []
        self.arrays: list[Leaf] = []
        self.groups: dict[types.Array, list[int]] = {}
        self._tuples: dict[str, Any] = {"Work": kernels.Work}
        self._shared: dict[RecordType, str] = {}
        self._expressions: dict[str, str] = {}  # of arrays, by path
        kinds: dict[str, Any] = LoopState.kind.fields
        lines = ["def work_at(place, reals, wholes, arrays):"]
        lines.append("    net = np.uint64(place)")  # unsigned, so no code for negative numbers is needed
        for name, path in RECORDS.items():
            first, _, second = path.partition(".")
            kind = kinds[first].fields[second] if second else kinds[first]
            lines.append(f"    {name} = {self._record(path, kind, name == 'relative')}")
            self._shared[kind] = name
        numbers = {"traits": "traits", "breaks": "breaks", "width": ""}
        values = {name: self._number(path, self.wholes, "wholes") for name, path in numbers.items()}
        values |= {name: self._array(Leaf(path, kind, False)) for name, (path, kind) in DEVICE_ARRAYS.items()}
        saved = [
            self._array(Leaf(f"{name}.{field}", kinds[name].fields[field], False))
            for name, fields in CHANGES.items()
            for field in fields
        ]
        values |= {"saved": f"({', '.join(saved)})"} | {name: name for name in RECORDS}
        lines.append(f"    return Work({', '.join(f'{name}={value}' for name, value in values.items())})")
        self.source = "\n".join(lines)

    def work_at(self) -> Callable[..., Any]:
        """Return the function that returns the `Work` of a net, to be compiled."""
        namespace = self._tuples | {"np": np}
        exec(self.source, namespace)
        made: Callable[..., Any] = namespace["work_at"]
        return made

    def _record(self, path: str, kind: RecordType, cut: bool = False) -> str:
        """Return the expression of a record's named tuple, and list its contents."""
        if kind in self._shared:
            return self._shared[kind]
        made = tuple_of(kind)
        self._tuples[made.__name__] = made
        fields = []
        for name, field in kind.fields.items():
            at = f"{path}.{name}"
            if isinstance(field, RecordType):
                fields.append(self._record(at, field, cut))
            elif isinstance(field, types.Array):
                fields.append(self._array(Leaf(at, field, True, cut)))
            else:
                is_real = field == types.float64
                listed = (self.reals, "reals") if is_real else (self.wholes, "wholes")
                fields.append(self._number(at, *listed))
        return f"{made.__name__}({', '.join(fields)})"

    def _number(self, path: str, listed: list[str], table: str) -> str:
        listed.append(path)
        return f"{table}[net, {len(listed) - 1}]"

    def _array(self, leaf: Leaf) -> str:
        if leaf.path in ALIASES:
            return self._expressions[ALIASES[leaf.path]]
        group = self.groups.setdefault(leaf.kind, [])
        group.append(len(self.arrays))
        self.arrays.append(leaf)
        expression = f"arrays[{list(self.groups).index(leaf.kind)}][{len(group) - 1}][net"
        if leaf.cut:
            expression += f", : {self._number(f'len {leaf.path}', self.wholes, 'wholes')}"
        if leaf.copied:
            self._expressions[leaf.path] = f"{expression}]"
        return f"{expression}]"


@cache
def layout() -> Layout:
    """Return the layout, which is the same for all nets."""
    return Layout()


def value_at(work: LoopState, path: str) -> Any:
    """Return a number or an array of a `LoopState`."""
    return attrgetter(path)(work)


def numbers_of(work: LoopState) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of a net in the order of `Layout.reals` and `Layout.wholes`."""
    width = int(work.chunks.width[: work.chunks.owned].max(initial=0))
    wholes = []
    for path in layout().wholes:
        if path.startswith("len "):
            wholes.append(len(value_at(work, path.removeprefix("len "))))
        else:
            wholes.append(int(value_at(work, path)) if path else width)
    return np.array([value_at(work, path) for path in layout().reals]), np.array(wholes, np.int64)


def filled_rows(leaf: Leaf, work: LoopState) -> int | None:
    """Return how many rows of an array of a net are in use; None: all."""
    if leaf.cut:
        return len(value_at(work, leaf.path))
    if leaf.path.startswith(TABLE):
        return int(work.rows.made[1])
    return int(work.spare.events[0]) if leaf.path.startswith(EVENTS) else None


def shapes_of(work: LoopState) -> tuple[tuple[int, ...], ...]:
    """Return the shapes on the device of the arrays of a net."""
    rows = work.particles.x.shape[1]

    def shape(leaf: Leaf) -> tuple[int, ...]:
        if leaf.cut:
            return (rows,)
        if leaf.path:
            return tuple(value_at(work, leaf.path).shape)
        return (3,)

    return tuple(map(shape, layout().arrays))
