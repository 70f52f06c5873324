"""Arrays and records of a `LoopState` in one piece of memory on a device."""

from collections.abc import Iterator
from threading import get_ident
from typing import Any

import numpy as np

from netfall.core.records import Record, i8
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels
from netfall.gpu.target import cuda_module
from netfall.physics.events import COLUMNS

MEMORY_SHARE = 0.9  # share of the free memory of the device for nets; kernels also need some
LINE = 64  # bytes to whose multiples arrays are aligned
# Groups of arrays, in their order in memory. INPUTS : which the host changes between launches, and the device
# too in part; EVENTS, TABLE : log of fractures, history rows; REST : all others, of which a trial has a copy
INPUTS, EVENTS, TABLE, REST = range(4)
LOADS = ("load_before", "load_after", "speed_before", "speed_after")


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


def free_memory() -> float:
    """Return the free memory of the device in bytes."""
    context = cuda_module().current_context()
    context.deallocations.clear()
    return float(context.get_memory_info().free)


class NetMemory(Record):
    """Net in the memory of a device. inputs, rest, saved : groups of arrays and copy of REST, in words"""

    work: LoopState
    inputs: i8
    rest: i8
    saved: i8


class GpuNet:
    """A net whose arrays and tables have places in one piece of memory, and the order of its next launch.

    order : columns of `kernels`; thread : that steps the net
    memory : on the device, empty if released; address : of its `NetMemory`, which comes first
    staged : memory on the host, also for the copy of REST at the end, which begins at `size` [bytes]
    offsets : [bytes] of arrays and tables, by their addresses on the host
    bounds : [bytes] of the groups, after which tables follow
    groups : pairs of an array and its place in `staged`
    """

    def __init__(self) -> None:
        self.order, self.thread = np.zeros(kernels.COLUMNS, np.int64), get_ident()
        self.work: LoopState | None = None
        self.release()

    def release(self) -> None:
        """Release the memory on the device."""
        self.memory: Any = np.zeros(0, np.uint8)

    def give_places(self, work: LoopState) -> None:
        """Give all arrays and tables of a net their places."""
        self.work, self.size, self.offsets = work, LINE, dict[int, int]()
        particles, rows, events = work.particles, work.rows, work.fractures.events
        records = list(records_in(work))
        groups = (
            [*(getattr(particles, name) for name in LOADS), rows.made, work.spare.events],
            [getattr(events, name) for name in COLUMNS],
            list(arrays_in(rows.table)),
            [array for record in records for array in arrays_in(record)],
        )
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
        self.offsets |= {part.ctypes.data: begin for part, begin in zip(parts, begins)}
        self.offsets[self.net.address] = 0
        self.groups = [[(array, self.view(array, self.staged)) for array in group] for group in placed]

    def _place(self, array: np.ndarray) -> bool:
        """Give an array a place, unless it has one or is empty; return whether it now has a new one."""
        is_new = array.size > 0 and array.ctypes.data not in self.offsets
        if is_new:
            self.offsets[array.ctypes.data] = self.size
            self.size += -(-array.nbytes // LINE) * LINE
        return is_new

    def view(self, array: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Return an array's place in a memory (size,) uint8 of the host."""
        return np.ndarray(array.shape, array.dtype, memory.data, self.offsets[array.ctypes.data])

    def write_tables(self, address: int) -> None:
        """Write the tables of the records, with the addresses of a memory that begins at an address."""
        for record in records_in(self.net):
            table = self.view(record.words, self.staged)
            table[:] = record.words
            for name, word in record.kind.places.items():
                if isinstance(getattr(record, name), np.ndarray | Record):
                    table[word] = address + self.offsets.get(int(table[word]), 0)

    def allocate(self, work: LoopState) -> bool:
        """Allocate memory for a net, and for the copy of a trial; return whether that is possible."""
        if self.work is work and self.memory.size:
            return True
        self.give_places(work)
        needed = self.staged.size
        if self.memory.size != needed:
            self.release()
            if needed > MEMORY_SHARE * free_memory():
                return False
            self.memory = cuda_module().device_array(needed, np.uint8)
        self.address: int = self.memory.__cuda_array_interface__["data"][0]
        self.write_tables(self.address)
        return True

    def stage(self, last: int) -> None:
        """Copy the groups of arrays up to the last to the memory of the host."""
        for pairs in self.groups[: last + 1]:
            for array, place in pairs:
                place[...] = array

    def upload(self) -> None:
        """Copy all arrays and tables to the device."""
        self.stage(REST)
        self.memory[: self.size].copy_to_device(self.staged[: self.size])

    def fetch(self, group: int) -> None:
        """Copy a group of arrays from the device."""
        begin, end = self.bounds[group], self.bounds[group + 1]
        self.memory[begin:end].copy_to_host(self.staged[begin:end])
        for array, place in self.groups[group]:
            array[...] = place

    def fetch_array(self, array: np.ndarray) -> None:
        """Copy a single array from the device."""
        begin = self.offsets[array.ctypes.data]
        self.memory[begin : begin + array.nbytes].copy_to_host(array.view(np.uint8).reshape(-1))

    def revert(self) -> None:
        """Return to what the last trial saved."""
        self.memory[self.bounds[REST] : self.bounds[REST + 1]].copy_to_device(self.memory[self.size :])
