"""What is read of a drawing or mesh, whatever its format: lines, points, layers."""

from dataclasses import dataclass, field

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
    """k lines and p points.

    lines : (k, 2, 3), in the unit of the drawing until `scaled`; layer : (k,) rows of `layers`
    curves : splines of ezdxf, with the row of the layer of each; `curves.cut_curves` makes lines of them
    points : (p, 3) that may mark supports; point_layer : (p,) rows of `layers`
    held : (q, 3) supports that the file itself names; in_part : (r, 3) those along some axes alone
    keys : (k, 2) ids of nodes at the ends, None: the file has none
    columns : of the elements by name, (k,)
    unit : that of the coordinates; said : what the file says, None: nothing; unit_from : where it says so
    read, left_out : what was found, in words and numbers
    """

    lines: np.ndarray
    layer: np.ndarray
    layers: list[str]
    curves: list = field(default_factory=list)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    point_layer: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    held: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    in_part: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    keys: np.ndarray = None
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    unit: str | None = None
    said: str | None = None
    unit_from: str = ""
    read: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def scaled(self, unit: str) -> None:
        """Bring all coordinates to metres."""
        factor = METRES[unit]
        times, by = (1.0, round(1.0 / factor)) if factor in (0.1, 0.01, 0.001) else (factor, 1.0)
        for name in ("lines", "points", "held", "in_part"):
            setattr(self, name, getattr(self, name) * times / by)  # 2200 mm are 2.2 m to the last bit


def counted(words: dict[str, int]) -> str:
    """Counts by name, in words: "12 LINE, 3 ARC"."""
    return ", ".join(f"{count} {name}" for name, count in sorted(words.items()))


def edges_of(faces) -> tuple[np.ndarray, list[list[int]]]:
    """The sides (k, 2) of faces, each a list of nodes, once; and for each the faces that it belongs to."""
    of: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(faces):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            of.setdefault((min(a, b), max(a, b)), []).append(number)
    pairs = sorted(of)
    return np.array(pairs, np.int64).reshape(-1, 2), [of[pair] for pair in pairs]


def depth(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Return how far points (f, 3) are from the segment between two places, at most."""
    along = end - start
    share = np.clip((points - start) @ along / max(along @ along, np.finfo(float).tiny), 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * along - points, axis=1).max(initial=0.0))


def rows_called(name: str | None, names: list[str]) -> list[int]:
    """Rows of the names that are this one, upper and lower case alike."""
    return [] if name is None else [k for k, other in enumerate(names) if other.lower() == name.lower()]


def is_among(name: str, names) -> bool:
    """Whether a name is one of these, upper and lower case alike; None among them: nothing."""
    return name.lower() in {other.lower() for other in names if other is not None}


def alike(names) -> list[str]:
    """A line for names that differ by upper and lower case alone."""
    told, known = [], {}
    for name in sorted(names):
        known.setdefault(name.lower(), []).append(name)
    for several in known.values():
        if len(several) > 1:
            told.append(
                " and ".join(f'"{name}"' for name in several) + " differ by upper and lower case alone"
            )
    return told
