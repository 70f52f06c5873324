"""Content of a drawing or mesh in any format: lines, points, layers."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

METRES = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "dm": 0.1,
    "km": 1000.0,
    "in": 0.0254,
    "ft": 0.3048,
    "yd": 0.9144,
}


@dataclass
class Drawing:
    """Drawing of k lines and p points.

    lines : (k, 2, 3), in the unit of the drawing until `scaled`; layer : (k,) rows of `layers`
    curves : splines of ezdxf, with the row of the layer of each; `curves.cut_curves` makes lines of them
    points : (p, 3) that may mark supports; point_layer : (p,) rows of `layers`
    held : (q, 3) supports that the file itself names; in_part : (r, 3) those along some axes alone
    keys : (k, 2) ids of nodes at the ends, None: the file has none
    columns : columns of the elements by name, (k,)
    unit : unit of the coordinates; file_unit : unit that the file names, None: none
    unit_from : where it names it
    read, left_out : counts of what was read and left out, in words
    """

    lines: np.ndarray
    layer: np.ndarray
    layers: list[str]
    curves: list[Any] = field(default_factory=list)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    point_layer: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    held: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    in_part: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    keys: np.ndarray | None = None
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    unit: str | None = None
    file_unit: str | None = None
    unit_from: str = ""
    read: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def scaled(self, unit: str) -> None:
        """Convert all coordinates to metres."""
        factor = METRES[unit]
        multiplier, divisor = (1.0, round(1.0 / factor)) if factor in (0.1, 0.01, 0.001) else (factor, 1.0)
        for name in ("lines", "points", "held", "in_part"):
            setattr(
                self, name, getattr(self, name) * multiplier / divisor
            )  # dividing makes 2200 mm exactly 2.2 m


def counted(counts: dict[str, int]) -> str:
    """Format counts by name: "12 LINE, 3 ARC" for {"LINE": 12, "ARC": 3}."""
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))


def edges_of(faces: Any) -> tuple[np.ndarray, list[list[int]]]:
    """Return the sides (k, 2) of faces, each side once, and the faces that each side belongs to."""
    faces_of: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(faces):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            faces_of.setdefault((min(a, b), max(a, b)), []).append(number)
    pairs = sorted(faces_of)
    return np.array(pairs, np.int64).reshape(-1, 2), [faces_of[pair] for pair in pairs]


def largest_offset(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Compute the largest distance of points (f, 3) from the segment between two points."""
    direction = end - start
    share = np.clip((points - start) @ direction / max(direction @ direction, np.finfo(float).tiny), 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * direction - points, axis=1).max(initial=0.0))


def rows_with_name(name: str | None, names: list[str]) -> list[int]:
    """Return the rows of the names that equal a name, in upper or lower case."""
    return [] if name is None else [k for k, other in enumerate(names) if other.lower() == name.lower()]


def is_among(name: str, names: Any) -> bool:
    """Whether a name is one of some names, in upper or lower case; None among them is ignored."""
    return name.lower() in {other.lower() for other in names if other is not None}


def alike(names: Iterable[str]) -> list[str]:
    """Return a line for each set of names that differ by upper and lower case alone."""
    lines = []
    spellings: dict[str, list[str]] = {}
    for name in sorted(names):
        spellings.setdefault(name.lower(), []).append(name)
    for variants in spellings.values():
        if len(variants) > 1:
            lines.append(
                " and ".join(f'"{name}"' for name in variants) + " differ by upper and lower case alone"
            )
    return lines
