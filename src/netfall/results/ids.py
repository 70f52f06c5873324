"""Ids of the tables for elements and particles, fragment ends included.

A fragment end has the id of the node from which it separated. The elements of a subdivided cable share its
id.
"""

import numpy as np

from netfall.geometry.net import Net
from netfall.parallel.subdomain import Distribution
from netfall.physics.state import State


def origin(numbers: np.ndarray, elements: np.ndarray, n: int) -> np.ndarray:
    """Return rows of the net of n particles for particles (k,); for a fragment end the node that it left.

    elements : (m, 2) rows of the particles at their ends, as the net was built
    """
    element, end = np.divmod(np.maximum(numbers - n, 0), 2)
    return np.where(numbers < n, numbers, elements[element, end])


def event_ids(net: Net, events: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of /events with the table ids of `element` and `particle`."""
    return {
        "element_id": net.element_id[events["element"]],
        "node_id": net.node_id[origin(events["particle"], net.elements, net.n)],
    }


class LocalIds:
    """Table ids of the elements and particles of one rank. element : (m_local,)"""

    def __init__(self, distribution: Distribution, net: Net | None):
        """Distribute the ids. net : on rank 0. Collective."""
        self.n, self.subdomain = distribution.n, distribution.subdomain
        self.element = distribution.elements(net.element_id if net else None)
        self._node = distribution.particles(net.node_id if net else None)

    def node(self, state: State, rows: np.ndarray) -> np.ndarray:
        """Return the ids (k,) for rows (k,) of the rank's particles."""
        number = state.gid[rows]
        is_fragment = number >= self.n
        element, end = np.divmod(number[is_fragment] - self.n, 2)
        row = rows.copy()
        row[is_fragment] = self.subdomain.ends[np.searchsorted(self.subdomain.element_gid, element), end]
        return self._node[row]
