"""The elastic supports of a result, as other programs take them."""

from typing import NamedTuple

import numpy as np

from netfall.exchange.state import RECORD
from netfall.numerics.rotation import from_own, to_own
from netfall.results.result import Result
from netfall.results.states import start_position, support_angles


class Springs(NamedTuple):
    """Elastic supports of nodes (k,), rows of the net, out of start (n, 3) [m], where displacements begin.

    stiffness : (k, 3) [N/m]; rest : (k, 3) [m], displacement at which they carry nothing; both in axes at
        angles (k,) [degrees] about z, None: along x, y and z
    """

    nodes: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    start: np.ndarray
    angle: np.ndarray | None = None

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Forces (n, 3) [N] on the nodes, which are at x (n, 3) [m]."""
        force = np.zeros_like(x)
        moved = to_own((x - self.start)[self.nodes], self.angle)
        force[self.nodes] = from_own(self.stiffness * (self.rest - moved), self.angle)
        return force


def springs_of(result: Result) -> Springs:
    """The springs of a net; none where it has none."""
    f, start, none = result.file, start_position(result.file), np.zeros((0, 3))
    if "spring" not in f["net"]:
        return Springs(np.zeros(0, int), none, none, start)
    nodes = np.flatnonzero(f["net/spring"][:].any(1))
    k, rest = f["net/spring"][:][nodes], np.broadcast_to(f[f"{RECORD}/spring_rest"][:], start.shape)[nodes]
    angle = support_angles(f)
    angle = None if angle is None else angle[nodes]
    return Springs(nodes, k, to_own(rest, angle), start, angle)
