"""Arrays and records of a `LoopState` in one piece of memory on a device."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.core.records import Record, i8
from netfall.explicit.loop import LoopState
from netfall.physics.events import COLUMNS

LINE = 64  # bytes to whose multiples arrays are aligned
# Groups of arrays, in their order in memory. INPUTS : which the host changes between launches, and the device
# too in part; EVENTS, TABLE : log of fractures, history rows; REST : all others, of which a trial has a copy
INPUTS, EVENTS, TABLE, REST = range(4)
LOADS = ("load_before", "load_after", "speed_before", "speed_after")


def address_of(array: np.ndarray) -> int:
    """Return the address of the first element of an array."""
    return int(array.__array_interface__["data"][0])


def records_in(record: Record) -> Iterator[Record]:
    """Yield a record and all records in it; some repeatedly."""
    yield record
    for name in record.kind.fields:
        value = getattr(record, name)
        if isinstance(value, Record):
            yield from records_in(value)


def arrays_in(record: Record) -> Iterator[np.ndarray]:
    """Yield the arrays among the fields of a record."""
    values = (getattr(record, name) for name in record.kind.fields)
    return (value for value in values if isinstance(value, np.ndarray) and value.size)


class NetMemory(Record):
    """Net in the memory of a device. inputs, rest, saved : groups of arrays and copy of REST, in words"""

    work: LoopState
    inputs: i8
    rest: i8
    saved: i8


class MemoryMap:
    """Places of all arrays and tables of a `LoopState` in one piece of memory, after the table of `net`.

    offsets : [bytes] of arrays and tables, by their addresses on the host
    size : [bytes] without the copy of REST at the end
    bounds : [bytes] of the groups, after which tables follow
    staged : memory of the host; groups : pairs of an array and its place there
    """

    def __init__(self, work: LoopState):
        self.work, self.size = work, LINE
        particles, rows, events = work.particles, work.rows, work.fractures.events
        records = list(records_in(work))
        groups = (
            [*(getattr(particles, name) for name in LOADS), rows.made, work.spare.events],
            [getattr(events, name) for name in COLUMNS],
            list(arrays_in(rows.table)),
            [array for record in records for array in arrays_in(record)],
        )
        self.offsets: dict[int, int] = {}
        self.bounds, placed = [self.size], []
        for group in groups:
            placed.append([array for array in group if self._place(array)])
            self.bounds.append(self.size)
        for record in records:
            self._place(record.words)
        self.staged = np.zeros(self.size + self.bounds[REST + 1] - self.bounds[REST], np.uint8)
        begins = self.bounds[INPUTS], self.bounds[REST], self.size
        ends = self.bounds[INPUTS + 1], self.bounds[REST + 1], len(self.staged)
        parts = [self.staged[begin:end].view(np.int64) for begin, end in zip(begins, ends)]
        self.net = NetMemory(work, *parts)
        self.offsets |= dict(zip(map(address_of, parts), begins)) | {self.net.address: 0}
        self.groups = [[(array, self.view(array, self.staged)) for array in group] for group in placed]

    def _place(self, array: np.ndarray) -> bool:
        """Give an array a place, unless it has one or is empty; return whether it now has a new one."""
        is_new = array.size > 0 and address_of(array) not in self.offsets
        if is_new:
            self.offsets[address_of(array)] = self.size
            self.size += -(-array.nbytes // LINE) * LINE
        return is_new

    def view(self, array: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Return an array's place in a memory (size,) uint8 of the host."""
        return np.ndarray(array.shape, array.dtype, memory.data, self.offsets[address_of(array)])

    def record_in(self, memory: np.ndarray, record: Record) -> Any:
        """Return a record whose arrays are in a memory (size,) uint8 of the host."""
        fields: dict[str, Any] = {name: getattr(record, name) for name in record.kind.fields}
        for name, value in fields.items():
            if isinstance(value, Record):
                fields[name] = self.record_in(memory, value)
            elif isinstance(value, np.ndarray) and value.size:
                fields[name] = self.view(value, memory)
        return type(record)(**fields)

    def write_tables(self, address: int) -> None:
        """Write the tables of the records, with the addresses of a memory that begins at an address."""
        for record in records_in(self.net):
            table = self.view(record.words, self.staged)
            table[:] = record.words
            for name, word in record.kind.places.items():
                if isinstance(getattr(record, name), np.ndarray | Record):
                    table[word] = address + self.offsets.get(int(table[word]), 0)
