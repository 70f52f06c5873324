"""The states in a result file, one at a time: a file may be larger than the memory."""


class Frames:
    """Steps of /VTKHDF: positions, connectivity and cell fields."""

    def __init__(self, f):
        self.g = f["VTKHDF"]
        self.times = self.g["Steps/Values"][:]
        self.cells = len(f["net/elements"])

    def cell(self, name, step, low=0, high=None):
        """A cell field (m,) at a step, or its rows low to high."""
        start, high = int(self.g[f"Steps/CellDataOffsets/{name}"][step]), high or self.cells
        return self.g[f"CellData/{name}"][start + low : start + high]

    def point(self, name, step, low=0, high=None):
        """A point field (points, ...) at a step, or its rows low to high; the nodes of the net come first."""
        start, high = int(self.g[f"Steps/PointDataOffsets/{name}"][step]), high or self._points(step)
        return self.g[f"PointData/{name}"][start + low : start + high]

    def _points(self, step):
        return int(self.g["NumberOfPoints"][int(self.g["Steps/PartOffsets"][step])])

    def positions(self, step):
        """Positions (points, 3) [m] at a step."""
        first = int(self.g["Steps/PointOffsets"][step])
        return self.g["Points"][first : first + self._points(step)]

    def ends(self, step):
        """Rows (m, 2) of the points at the ends of the elements at a step."""
        link = int(self.g["Steps/ConnectivityIdOffsets"][step, 0])
        return self.g["Connectivity"][link : link + 2 * self.cells].reshape(-1, 2)

    def lines(self, step):
        """End points (m, 2, 3) [m] of the elements at a step."""
        return self.positions(step)[self.ends(step)]
