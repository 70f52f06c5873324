"""The states in a result file, one at a time: a file may be larger than the memory."""


class Frames:
    """Steps of /VTKHDF: positions, connectivity and cell fields."""

    def __init__(self, f):
        self.g = f["VTKHDF"]
        self.times = self.g["Steps/Values"][:]
        self.cells = len(f["net/elements"])

    def cell(self, name, step):
        """A cell field (m,) at a step."""
        start = int(self.g[f"Steps/CellDataOffsets/{name}"][step])
        return self.g[f"CellData/{name}"][start : start + self.cells]

    def point(self, name, step):
        """A point field (points, ...) at a step."""
        start, n = int(self.g[f"Steps/PointDataOffsets/{name}"][step]), self._points(step)
        return self.g[f"PointData/{name}"][start : start + n]

    def _points(self, step):
        return int(self.g["NumberOfPoints"][int(self.g["Steps/PartOffsets"][step])])

    def lines(self, step):
        """End points (m, 2, 3) [m] of the elements at a step."""
        s = self.g["Steps"]
        n = self._points(step)
        first, link = int(s["PointOffsets"][step]), int(s["ConnectivityIdOffsets"][step, 0])
        points = self.g["Points"][first : first + n]
        return points[self.g["Connectivity"][link : link + 2 * self.cells].reshape(-1, 2)]
