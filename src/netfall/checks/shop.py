"""The shop list: what is made, in mm. Equal cables together, with deductions at their ends, marks of clamps.

A cable runs from node to node; the rigid parts at its ends, a plate up to the pin and the socket on it, are
deducted from its length in the form, with the force that it has there. What is left, of unstressed length L0,
measures L0 (1 + expansion T) (1 + N / EA) at a temperature T above that of form finding under the load N;
marks are where its inner nodes then lie.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from netfall.checks.cables import Cutting, groups_of, measured_lengths, types_of
from netfall.ground.errors import InputError
from netfall.job.table import Table
from netfall.job.values import nearest
from netfall.results.states import absent, start_position

MM = 1e3
ALIKE = 0.5e-3  # m: cables whose lengths and marks differ by no more are equal
COLUMNS = ("group", "type", "pin", "socket")  # of a table of deductions


@dataclass(frozen=True)
class Deduction:
    """Rigid parts at each end of a cable [m]: from its node to the pin, and from the pin to the rope.

    group, type : which cables, "": all
    """

    group: str
    type: str
    pin: float
    socket: float


class Chain(NamedTuple):
    """A piece of cable: its elements in order from one end to the other; closed : a ring.

    in_order : whether they are a chain at all; without that, as they stand in the table
    """

    elements: np.ndarray
    closed: bool
    in_order: bool


class Piece(NamedTuple):
    """A piece of cable as it is made, [m] under its measuring load.

    system : from node to node; pins : from pin to pin; cut : of the rope; marks : (k,) on it, from its start
    """

    cable: int
    group: str
    type: str
    chain: Chain
    system: float
    pins: float
    cut: float
    marks: np.ndarray
    load: float
    mass: float

    def alike(self, other: "Piece") -> bool:
        """Whether both are made alike, either way round."""
        if len(self.marks) != len(other.marks) or abs(self.cut - other.cut) > ALIKE:
            return False
        if abs(self.pins - other.pins) > ALIKE or abs(self.system - other.system) > ALIKE:
            return False
        ways = other.marks, (other.cut - other.marks)[::-1]
        return any(np.abs(self.marks - marks).max(initial=0.0) <= ALIKE for marks in ways)


def read_deductions(path: Path | None, groups: list[str], types: list[str]) -> list[Deduction]:
    """The rows of a table of deductions, [mm] there. Raises InputError for what is wrong in it."""
    if path is None:
        return []
    if not path.is_file():
        raise InputError(f"--deductions {path}: no such file")
    table = Table(path, COLUMNS, ())
    pin, socket = (table.numbers(name, 0.0, low=0.0, unit="mm") / MM for name in COLUMNS[2:])
    words = {name: table.words(name) for name in COLUMNS[:2]}
    for name, known in (("group", groups), ("type", types)):
        for row, word in enumerate(words[name]):
            if word and word not in known:
                there = nearest(word, known) if known else "the net has none"
                table.wrong(f"{table.at(row)}: {name} = {word[:40]!r}: no such {name} in the result; {there}")
    table.finish()
    return [Deduction(*row) for row in zip(words["group"], words["type"], pin.tolist(), socket.tolist())]


def shop_columns(f, cutting: Cutting, deductions: list[Deduction]) -> dict[str, np.ndarray]:
    """A row for each sort of piece, [mm]; equal ones together, in each group the longest first.

    Raises InputError for a cable that is no longer than what is deducted of it.
    """
    names, of_group, rows = f["net/cable_names"].asstr()[:], {}, []
    for same in equal_pieces(pieces_of(f, cutting, deductions)):
        first = same[0]
        number = of_group[first.group] = of_group.get(first.group, 0) + 1
        rows.append(
            {
                "mark": f"{first.group or 'cable'}-{number}",
                "count": len(same),
                "group": first.group,
                "type": first.type,
                "length_node_to_node": MM * first.system,
                "deduction_pins": MM * (first.system - first.pins),
                "length_pin_to_pin": MM * first.pins,
                "deduction_sockets": MM * (first.pins - first.cut),
                "cut_length": MM * first.cut,
                "clamps": "; ".join(f"{MM * mark:.1f}" for mark in first.marks),
                "form": "ring" if first.chain.closed else "" if first.chain.in_order else "no chain",
                "measuring_load": first.load,
                "temperature": float(cutting.temperature),
                "mass": first.mass,
                "cables": "; ".join(names[each.cable] for each in same),
            }
        )
    return {name: np.array([row[name] for row in rows], object) for name in rows[0]}


def pieces_of(f, cutting: Cutting, deductions: list[Deduction]) -> list[Piece]:
    """Every piece of cable as it is made. Raises InputError where nothing of one is left."""
    cable, ends, x = f["net/cable"][:], f["net/elements"][:], start_position(f)
    there = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    L = np.where(absent(f), f["net/unstressed_length"][:], there)  # its nodes are where it does not hold them
    load, _, measured = measured_lengths(f, cutting)
    mass, group, kind = f["net/unstressed_length"][:] * f["net/mass_per_length"][:], groups_of(f), types_of(f)
    order = np.argsort(cable, kind="stable")
    found, errors = [], []
    for k, mine in enumerate(np.split(order, np.cumsum(np.bincount(cable))[:-1])):
        chain = chain_of(ends, mine)
        e = chain.elements
        rigid = _deducted(deductions, group[e[0]], kind[e[0]], chain)
        if rigid[1] >= min(L[e[0]], L[e[-1]]) / (1 + (len(e) == 1)):
            errors.append(_too_much(f["net/cable_names"].asstr()[k], group[e[0]], rigid[1], L[e].sum()))
        ends_at = np.bincount([0, len(e) - 1], minlength=len(e))  # of the cable, at each of its elements
        rope = 1.0 - rigid[1] / L[e] * ends_at  # share of each element that is rope
        shortened = np.outer(rigid, measured[e[[0, -1]]] / L[e[[0, -1]]])
        system = float(measured[e].sum())
        pins, cut = system - shortened.sum(1)
        marks = np.cumsum(measured[e])[: len(e) - 1] - shortened[1, 0]
        at = (marks if chain.in_order else np.zeros(0), float(load[k]), float(rope @ mass[e]))
        found.append(Piece(k, group[e[0]], kind[e[0]], chain, system, float(pins), float(cut), *at))
    if errors:
        raise InputError(errors)
    return found


def _too_much(name: str, group: str, rigid: float, length: float) -> str:
    return (
        f"--deductions: cable {name} ({group}) of {MM * length:.5g} mm: {MM * rigid:g} mm at each end are "
        "more than its end segments; expected less"
    )


def _deducted(deductions: list[Deduction], group: str, kind: str, chain: Chain) -> np.ndarray:
    """What is deducted at each end of a cable [m], up to the pin and to the rope; a ring has no ends.

    The first row of the table counts that is of the cable.
    """
    rows = [] if chain.closed else deductions
    own = (each for each in rows if each.group in ("", group) and each.type in ("", kind))
    first = next(own, Deduction("", "", 0.0, 0.0))
    return np.array([first.pin, first.pin + first.socket])


def chain_of(ends: np.ndarray, mine: np.ndarray) -> Chain:
    """Elements from one end of a cable to the other. ends : (m, 2) nodes; mine : (k,) elements of the cable

    An open one begins at the end that comes first in the table, a ring with its first element.
    """
    at: dict[int, list[int]] = {}
    for e in mine.tolist():
        for node in ends[e].tolist():
            at.setdefault(node, []).append(e)
    if any(len(of) > 2 for of in at.values()):
        return Chain(mine, False, False)
    loose = [node for node, of in at.items() if len(of) == 1]
    node, e = loose[0] if loose else int(ends[mine[0], 0]), int(mine[0])
    if loose:
        e = at[node][0]
    order = []
    while e is not None and (not order or e != order[0]):
        order.append(e)
        node = int(ends[e].sum()) - node
        e = next((other for other in at[node] if other != e), None)
    whole = len(order) == len(mine)
    return Chain(np.array(order) if whole else mine, whole and not loose, whole)


def equal_pieces(pieces: list[Piece]) -> list[list[Piece]]:
    """The pieces that are made alike together, in the order of their groups, the longest first."""
    sorts: dict[tuple, list[list[Piece]]] = {(p.group, p.type, p.chain.closed): [] for p in pieces}
    for piece in sorted(pieces, key=lambda piece: (-round(piece.cut, 6), piece.cable)):
        same = sorts[piece.group, piece.type, piece.chain.closed]
        fitting = next((row for row in reversed(same) if row[0].alike(piece)), None)
        if fitting is None:
            same.append([piece])
        else:
            fitting.append(piece)
    return [row for rows in sorts.values() for row in rows]
