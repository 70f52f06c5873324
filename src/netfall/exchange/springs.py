"""The elastic supports of a result, as other programs take them."""

from typing import NamedTuple

import numpy as np

from netfall.exchange.state import RECORD
from netfall.results.result import Result
from netfall.results.states import start_position


class Springs(NamedTuple):
    """Elastic supports of nodes (k,), rows of the net, out of start (n, 3) [m], where displacements begin.

    stiffness : (k, 3) [N/m]; rest : (k, 3) [m], displacement at which they carry nothing
    """

    nodes: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    start: np.ndarray

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Forces (n, 3) [N] on the nodes, which are at x (n, 3) [m]."""
        force = np.zeros_like(x)
        force[self.nodes] = self.stiffness * (self.rest - (x - self.start)[self.nodes])
        return force


def springs_of(result: Result) -> Springs:
    """The springs of a net; none where it has none."""
    f, start, none = result.file, start_position(result.file), np.zeros((0, 3))
    if "spring" not in f["net"]:
        return Springs(np.zeros(0, int), none, none, start)
    nodes = np.flatnonzero(f["net/spring"][:].any(1))
    k, rest = f["net/spring"][:][nodes], np.broadcast_to(f[f"{RECORD}/spring_rest"][:], start.shape)[nodes]
    return Springs(nodes, k, rest, start)
