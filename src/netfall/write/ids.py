"""The ids of the tables, for elements and for particles, those that split off included.

A particle that split off has the id of the node that it split off from; the elements of a cable that was
subdivided share its id.
"""

import numpy as np

from netfall.mechanics.state import State
from netfall.net.net import Net
from netfall.parallel.subdomain import Distribution


def origin(numbers: np.ndarray, elements: np.ndarray, n: int) -> np.ndarray:
    """Rows of the net of n particles that particles (k,) are, or split off from.

    elements : (m, 2) rows of the particles at their ends, as the net was built
    """
    element, end = np.divmod(np.maximum(numbers - n, 0), 2)
    return np.where(numbers < n, numbers, elements[element, end])


def event_ids(net: Net, events: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns of /events that name what its `element` and `particle` are in the tables."""
    return {
        "element_id": net.element_id[events["element"]],
        "node_id": net.node_id[origin(events["particle"], net.elements, net.n)],
    }


class LocalIds:
    """The ids of what one rank holds. element : (m_local,)"""

    def __init__(self, distribution: Distribution, net: Net | None):
        """net : on rank 0. Collective."""
        self.n, self.subdomain = distribution.n, distribution.subdomain
        self.element = distribution.elements(net.element_id if net else None)
        self._node = distribution.particles(net.node_id if net else None)

    def node(self, state: State, rows: np.ndarray) -> np.ndarray:
        """Ids (k,) for rows (k,) of the rank's particles."""
        number = state.gid[rows]
        new = number >= self.n
        element, end = np.divmod(number[new] - self.n, 2)
        row = rows.copy()
        row[new] = self.subdomain.ends[np.searchsorted(self.subdomain.element_gid, element), end]
        return self._node[row]
