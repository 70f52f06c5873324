"""Drawings for the tests of `netfall import`: a net of 4 x 3 fields in any unit."""

import ezdxf
import numpy as np

FIELD = 2.0  # m
UNITS = {"mm": (4, 1000.0), "m": (6, 1.0), "in": (1, 1 / 0.0254), "": (0, 1.0)}  # $INSUNITS, for each metre


class Sketch:
    """Drawing of a net of cables along x and y on named layers, with additions."""

    def __init__(self, unit="mm", cells=(4, 3)):
        self.number, self.scale = UNITS[unit]
        self.document = ezdxf.new("R2010", units=self.number)
        self.space = self.document.modelspace()
        self.cells = cells
        for name in ("x", "y"):
            self.document.layers.add(name)

    def at(self, *metres):
        """Return a position in the unit of the drawing."""
        return tuple(self.scale * value for value in (*metres, 0.0, 0.0)[:3])

    def corner(self, i, j):
        """Return a node of the net [m], on a saddle."""
        return FIELD * i, FIELD * j, 0.1 * (i - 2) ** 2 - 0.1 * (j - 1.5) ** 2

    def line(self, a, b, layer="x", space=None):
        """Draw a line between two positions [m]."""
        (space or self.space).add_line(self.at(*a), self.at(*b), dxfattribs={"layer": layer})

    def pieces(self):
        """Return the ends and layers of all elements."""
        nx, ny = self.cells
        for i in range(nx + 1):
            for j in range(ny + 1):
                if i < nx:
                    yield (i, j), (i + 1, j), "x"
                if j < ny:
                    yield (i, j), (i, j + 1), "y"

    def net(self, skip=()):
        """Draw all elements except some."""
        for k, (a, b, layer) in enumerate(self.pieces()):
            if k not in skip:
                self.line(self.corner(*a), self.corner(*b), layer)
        return self

    def save_at_once(self, path):
        """Write the net in the format of CAD programs without ezdxf, which is slow for many lines."""
        self.document.saveas(path)
        lines = []
        for number, (a, b, layer) in enumerate(self.pieces(), 0x1000):
            (x, y, z), (u, v, w) = self.at(*self.corner(*a)), self.at(*self.corner(*b))
            lines.append(
                f"  0\nLINE\n  5\n{number:X}\n330\n1F\n100\nAcDbEntity\n  8\n{layer}\n100\nAcDbLine\n"
                f" 10\n{x!r}\n 20\n{y!r}\n 30\n{z!r}\n 11\n{u!r}\n 21\n{v!r}\n 31\n{w!r}\n"
            )
        head, rest = path.read_text().split("  2\nENTITIES\n")
        path.write_text(head + "  2\nENTITIES\n" + "".join(lines) + rest)
        return path

    def save(self, path):
        self.document.saveas(path)
        return path


def places(sketch) -> np.ndarray:
    """Return all nodes (n, 3) [m]."""
    nx, ny = sketch.cells
    return np.array([sketch.corner(i, j) for i in range(nx + 1) for j in range(ny + 1)])
