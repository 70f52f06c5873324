"""Shop list: pieces to be made, with lengths in mm.

Equal cables share a row, with end deductions and marks of clamps.

A cable runs from node to node. Rigid parts at its ends, a plate up to the pin and the socket on it,
are deducted from its length in the form-found geometry, under its force there. The remaining cable has the
unstressed length L0. It measures L0 (1 + expansion T) (1 + N / EA) under the load N, at a temperature T above
that of form finding. Bars are measured without a load. Rigid parts measure the same under any load. Marks
are the positions on the cable of its inner nodes of the table, not of `subdivide`.
Members of concrete are not included.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.job import messages as job_messages
from netfall.job.csv_table import Table
from netfall.job.values import suggest
from netfall.post import messages
from netfall.post.checks.bending import is_concrete
from netfall.post.checks.cables import Cutting, element_groups, element_types, joined_words, measured_lengths
from netfall.results.states import absent, start_position

MM = 1e3
LENGTH_DIGITS, LOAD_DIGITS, MASS_DIGITS = 1, 0, 2  # decimals of lengths [mm], loads [N] and masses [kg]
LENGTH_TOLERANCE = 0.5e-3  # m; cables are equal if no length without load and no mark differs by more
COLUMNS = ("group", "type", "pin", "socket")  # columns of a table of deductions
SHOP_COLUMNS = (
    *("mark", "count", "group", "type", "length_node_to_node", "deduction_pins", "length_pin_to_pin"),
    *("deduction_sockets", "cut_length", "clamps", "form", "measuring_load", "temperature", "mass", "cables"),
)


@dataclass(frozen=True)
class Deduction:
    """Rigid parts at an end of a cable [m]: from its node to the pin, and from the pin to the rope.

    group, type : of the element at that end; "": all
    """

    group: str
    type: str
    pin: float
    socket: float


class CableOrder(NamedTuple):
    """Elements of a cable in order from one end to the other; closed : a ring.

    in_order : False if the elements are not a chain; they then have the order of their ids
    """

    elements: np.ndarray
    closed: bool
    in_order: bool


class Piece(NamedTuple):
    """Cable as it is made, [m] under its measuring load.

    system : from node to node; pins : from pin to pin; cut : of the rope; marks : (k,) on it, from its start
    unstressed, unstressed_marks : length of the rope, and marks (k,) on it, without load [m]
    segments : (k, 3) EA [N], mass per length [kg/m] and expansion [1/K] along it
    """

    cable: int
    group: str
    type: str
    chain: CableOrder
    system: float
    pins: float
    cut: float
    unstressed: float
    marks: np.ndarray
    unstressed_marks: np.ndarray
    segments: np.ndarray
    load: float
    mass: float

    def alike(self, other: "Piece") -> bool:
        """Whether both cables have equal lengths, marks and sections, in either direction, without load."""
        if len(self.marks) != len(other.marks) or len(self.segments) != len(other.segments):
            return False
        directions = (other.unstressed_marks, 1), (other.unstressed - other.unstressed_marks[::-1], -1)
        return any(
            np.abs(self._lengths(self.unstressed_marks) - other._lengths(marks)).max() <= LENGTH_TOLERANCE
            and np.allclose(self.segments, other.segments[::step])
            for marks, step in directions
        )

    def _lengths(self, marks: np.ndarray) -> np.ndarray:
        """Return the lengths (3 + k,) [m] that are the same in equal cables; marks : (k,) from either end."""
        return np.array([self.system - self.pins, self.pins - self.cut, self.unstressed, *marks])


def read_deductions(
    path: Path | None, groups: list[str], types: list[str]
) -> tuple[list[Deduction], list[str]]:
    """Read a table of deductions given in mm, and notes. Raises InputError with all errors."""
    if path is None:
        return [], []
    if not path.is_file():
        raise InputError(messages.NO_DEDUCTIONS(path=path))
    table = Table(path, COLUMNS, ())
    for names in (COLUMNS[:2], COLUMNS[2:]):
        if not any(name in table for name in names):
            table.wrong(job_messages.MISSING_ONE_OF(keys=f"columns {' and '.join(names)}"))
    pin, socket = (table.numbers(name, 0.0, low=0.0, unit="mm") / MM for name in COLUMNS[2:])
    words = {name: table.words(name) for name in COLUMNS[:2]}
    for name, names in (("group", groups), ("type", types)):
        for row, word in enumerate(words[name]):
            if word and word not in names:
                place, hint = table.at(row), suggest(word, names) if names else "the net has none"
                table.wrong(messages.UNKNOWN_WORD(row=place, name=name, word=word[:40], advice=hint))
    table.finish()
    rows = zip(words["group"], words["type"], pin.tolist(), socket.tolist())
    return [Deduction(*row) for row in rows], table.notes


def shop_columns(f: h5py.File, cutting: Cutting, deductions: list[Deduction]) -> dict[str, np.ndarray]:
    """Return the shop list in mm: one row for each set of equal cables, in each group the longest first.

    Raises InputError for a cable that is no longer than its deductions.
    """
    names, rows = f["net/cable_names"].asstr()[:], []
    numbers: Counter[str] = Counter()
    for equal in group_equal_cables(shop_cables(f, cutting, deductions)):
        first = equal[0]
        numbers[first.group] += 1
        lengths = (first.system, first.system - first.pins, first.pins, first.pins - first.cut, first.cut)
        clamps = "; ".join(f"{_in_mm(mark):.{LENGTH_DIGITS}f}" for mark in first.marks)
        form = "ring" if first.chain.closed else "" if first.chain.in_order else "no chain"
        cables = "; ".join(names[piece.cable] for piece in equal)
        mark = f"{first.group or 'cable'}-{numbers[first.group]}"
        rows.append([mark, len(equal), first.group, first.type, *map(_in_mm, lengths), clamps, form])
        load, mass = round(first.load, LOAD_DIGITS), round(first.mass, MASS_DIGITS)
        rows[-1] += [load, float(cutting.temperature), mass, cables]
    columns = zip(*rows) if rows else [()] * len(SHOP_COLUMNS)
    return {name: np.array(values, object) for name, values in zip(SHOP_COLUMNS, columns)}


def _in_mm(length: float) -> float:
    """Return a length [m] in mm, with the digits of a workshop."""
    return round(MM * length, LENGTH_DIGITS)


def shop_cables(f: h5py.File, cutting: Cutting, deductions: list[Deduction]) -> list[Piece]:
    """Return every cable made in a shop, in the order of their smallest element ids.

    Raises InputError if one is not longer than its deductions.
    """
    cable, ends, x = f["net/cable"][:], f["net/elements"][:], start_position(f)
    end_ids = f["net/node_id"][:][ends]
    distance = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    L0, names = f["net/unstressed_length"][:], f["net/cable_names"].asstr()[:]
    load, warm, measured = measured_lengths(f, cutting)
    distance[absent(f)] = L0[absent(f)]  # their nodes are elsewhere
    lengths = np.column_stack([distance, L0, measured])
    section = np.column_stack(
        [f[f"net/{key}"][:] for key in ("axial_stiffness", "mass_per_length", "expansion")]
    )
    ids, groups, types = f["net/element_id"][:], element_groups(f), element_types(f)
    group_names, type_names = joined_words(groups, cable), joined_words(types, cable)
    order = np.lexsort((ids, cable))
    concrete, pieces, errors = is_concrete(f), [], []
    for k, elements in enumerate(np.split(order, np.cumsum(np.bincount(cable))[:-1])):
        if concrete[elements].all():
            continue
        chain = order_elements(end_ids, elements)
        e = chain.elements
        first = np.flatnonzero(np.diff(ids[e], prepend=ids[e[0]] - 1))  # the parts of an element share its id
        form, unstressed, under_load = np.add.reduceat(lengths[e], first).T  # of the elements of the table
        e = e[first]
        at_ends = [_end_deduction(deductions, groups[end], types[end], chain) for end in e[[0, -1]]]
        pin, rigid = np.array(at_ends).T
        rigid_of = np.bincount([0, len(e) - 1], rigid, len(e))  # length of the rigid parts in each element
        if (rigid_of >= form).any():
            length, (start, end) = MM * form.sum(), MM * rigid
            errors.append(
                messages.DEDUCTION_TOO_LONG(
                    name=names[k], group=group_names[k], length=length, start=start, end=end
                )
            )
        rope = (1.0 - rigid_of / form) * unstressed  # of the rope in each element
        stretch = (under_load / form)[[0, -1]]  # of the elements at both ends
        heat = (warm / L0)[e[[0, -1]]]  # rigid parts expand with the temperature, but not with the load
        cut = float(under_load.sum() - rigid @ stretch)
        system, pins = float(cut + rigid @ heat), float(cut + (rigid - pin) @ heat)
        marks = np.cumsum(under_load)[:-1] - rigid[0] * stretch[0] if chain.in_order else np.zeros(0)
        mass, total = float(rope @ section[e, 1]), float(rope.sum())
        words, sizes = (group_names[k], type_names[k], chain), (system, pins, cut, total)
        unstressed_marks = np.cumsum(rope)[:-1] if chain.in_order else np.zeros(0)
        pieces.append(Piece(k, *words, *sizes, marks, unstressed_marks, section[e], float(load[k]), mass))
    if errors:
        raise InputError(errors)
    return sorted(pieces, key=lambda piece: ids[piece.chain.elements].min())


def _end_deduction(
    deductions: list[Deduction], group: str, kind: str, chain: CableOrder
) -> tuple[float, float]:
    """Return the deductions at an end of a cable [m]: up to the pin, and up to the rope; a ring has none.

    group, kind : of the element at that end

    The first matching row of the table counts.
    """
    for row in () if chain.closed else deductions:
        if row.group in ("", group) and row.type in ("", kind):
            return row.pin, row.pin + row.socket
    return 0.0, 0.0


def order_elements(ends: np.ndarray, elements: np.ndarray) -> CableOrder:
    """Order the elements of a cable from one end to the other; ends : (m, 2) node ids of all elements.

    elements : (k,) elements of the cable. An open cable starts at its end of the smaller id, a ring with its
    first element.
    """
    elements_at: dict[int, list[int]] = {}
    for e in elements.tolist():
        for node in ends[e].tolist():
            elements_at.setdefault(node, []).append(e)
    if any(len(incident) > 2 for incident in elements_at.values()):
        return CableOrder(elements, False, False)
    free_ends = [node for node, incident in elements_at.items() if len(incident) == 1]
    node = min(free_ends) if free_ends else int(ends[elements[0], 0])
    e = elements_at[node][0] if free_ends else int(elements[0])
    order: list[int] = []
    while e is not None and (not order or e != order[0]):
        order.append(e)
        node = int(ends[e].sum()) - node
        e = next((other for other in elements_at[node] if other != e), None)
    complete = len(order) == len(elements)
    return CableOrder(np.array(order) if complete else elements, complete and not free_ends, complete)


def group_equal_cables(pieces: list[Piece]) -> list[list[Piece]]:
    """Group the cables that are equal, in the order of the first cables of groups, the longest first."""
    sorts: dict[tuple[str, str, bool], list[list[Piece]]] = {
        (p.group, p.type, p.chain.closed): [] for p in pieces
    }
    for piece in sorted(pieces, key=lambda piece: -round(piece.cut, 6)):
        same = sorts[piece.group, piece.type, piece.chain.closed]
        fitting = next((row for row in reversed(same) if row[0].alike(piece)), None)
        if fitting is None:
            same.append(fitting := [])
        fitting.append(piece)
    return [row for rows in sorts.values() for row in rows]
