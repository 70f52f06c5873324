"""Access to the frames of a result file one at a time, since a file may exceed the memory."""

from typing import Any

import numpy as np

from netfall.results.states import absent, equilibrium_groups, group_equilibria


class Frames:
    """Time steps of /VTKHDF: positions, connectivity, point fields and cell fields."""

    def __init__(self, f: Any):
        self.g = f["VTKHDF"]
        self.times = self.g["Steps/Values"][:]
        self.cells = len(f["net/elements"])
        self.there = ~absent(f)

    def cell(self, name: Any, step: Any, low: Any = 0, high: Any = None) -> Any:
        """Return a cell field (m,) at a step, or its rows low to high."""
        start = int(self.g[f"Steps/CellDataOffsets/{name}"][step])
        high = self.cells if high is None else high
        return self.g[f"CellData/{name}"][start + low : start + high]

    def tension(self, step: Any) -> Any:
        """Return the tensions (m,) [N] at a step."""
        return self.cell("tension", step)

    def present(self, step: Any) -> Any:
        """Return which elements (m,) are part of the net after erection."""
        return self.there

    def broken(self, step: Any) -> Any:
        """Return which elements (m,) are broken or removed at a step."""
        return self.cell("broken", step).astype(bool) & self.there

    def point(self, name: Any, step: Any, low: Any = 0, high: Any = None) -> Any:
        """Return a point field (points, ...) at a step, or its rows low to high.

        The nodes of the net come first.
        """
        start = int(self.g[f"Steps/PointDataOffsets/{name}"][step])
        high = self._points(step) if high is None else high
        return self.g[f"PointData/{name}"][start + low : start + high]

    def _points(self, step: Any) -> Any:
        return int(self.g["NumberOfPoints"][int(self.g["Steps/PartOffsets"][step])])

    def positions(self, step: Any) -> Any:
        """Return the positions (points, 3) [m] at a step."""
        first = int(self.g["Steps/PointOffsets"][step])
        return self.g["Points"][first : first + self._points(step)]

    def ends(self, step: Any) -> Any:
        """Return the rows (m, 2) of the points at the ends of the elements at a step."""
        link = int(self.g["Steps/ConnectivityIdOffsets"][step, 0])
        return self.g["Connectivity"][link : link + 2 * self.cells].reshape(-1, 2)

    def lines(self, step: Any) -> Any:
        """Return the end points (m, 2, 3) [m] of the elements at a step."""
        return self.positions(step)[self.ends(step)]


class StageFrames:
    """Stages of erection with the interface of frames; `times` are the numbers of the stages, from 1."""

    def __init__(self, f: Any):
        stages = [name for name in equilibrium_groups(f) if name.startswith("stages/")]
        self.states = [state for name in stages for state in group_equilibria(f, name)]
        self.times = np.arange(1.0, len(self.states) + 1.0)
        self.elements, self.absent = f["net/elements"][:], [absent(f, state.place) for state in self.states]
        self.cells = len(self.elements)

    def tension(self, step: Any) -> Any:
        """Return the tensions (m,) [N] in a stage."""
        return self.states[step].tension()

    def present(self, step: Any) -> Any:
        """Return which elements (m,) are part of the net in a stage."""
        return ~self.absent[step]

    def broken(self, step: Any) -> Any:
        """Return which elements (m,) are broken in a stage: none, since nothing breaks during erection."""
        return np.zeros(self.cells, bool)

    def positions(self, step: Any) -> Any:
        """Return the positions (n, 3) [m] in a stage."""
        return self.states[step].position()

    def lines(self, step: Any) -> Any:
        """Return the end points (m, 2, 3) [m] of the elements in a stage."""
        return self.positions(step)[self.elements]
