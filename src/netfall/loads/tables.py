"""Loads that tables give to nodes and elements: columns of the nodes, and tables of loads (`load_table`)."""

from dataclasses import dataclass, replace

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.geometry.net import Net
from netfall.job.csv_table import COLUMNS, UNITS, Table, open_load_table
from netfall.job.job import Job
from netfall.loads import messages


@dataclass(frozen=True)
class GivenLoads:
    """Loads of nodes (n, 3) [N], and of elements (m, 3) [N/m of unstressed length], None: none."""

    nodes: np.ndarray
    elements: np.ndarray | None = None

    def forces(self, net: Net, L0: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Compute the forces (n, 3) [N] on the nodes: their own loads, and half of each element's load.

        L0 : (m,) [m], unstressed lengths; present : (m,) bool, elements that are there
        """
        if self.elements is None:
            return self.nodes
        force, half = self.nodes.copy(), 0.5 * self.elements * np.where(present, L0, 0.0)[:, None]
        for end in net.elements.T:
            np.add.at(force, end, half)
        return force


def read_given_loads(job: Job, net: Net) -> tuple[GivenLoads, dict[str, GivenLoads], list[str]]:
    """Return the loads of the nodes' table and of [load], those of each table of loads, and notes.

    Tables of zones are left out: `job.csv_table` makes values of them. Raises InputError with all errors.
    """
    loads, errors, notes = {}, [], []
    for name in dict.fromkeys(name for _, name in job.load_tables()):
        try:
            table, of_rows = open_load_table(job.path.parent / name)
            notes += table.notes
            if of_rows != "zone":
                loads[name] = _read_loads(table, of_rows, net)
        except InputError as error:
            errors += error.lines
    raise_errors(errors)
    everywhere = GivenLoads(net.load)
    if job.load and job.load.load_table in loads:
        own = loads[job.load.load_table]
        everywhere = replace(own, nodes=net.load + own.nodes)
    return everywhere, loads, notes


def _read_loads(table: Table, of_rows: str, net: Net) -> GivenLoads:
    """Read the loads of nodes or elements; rows of one node or element add up. Raises InputError."""
    ids = net.node_id if of_rows == "node" else net.element_id[:: net.parts]
    row_of = {number: row for row, number in enumerate(ids.tolist())}
    values = table.stacked(COLUMNS[of_rows], 0.0, unit=UNITS[of_rows])
    rows = []
    for k, number in enumerate(table.integers(of_rows).tolist()):
        rows.append(row_of.get(number, -1))
        if number not in row_of:
            message = messages.NO_SUCH_LOADED_NODE if of_rows == "node" else messages.NO_SUCH_LOADED_ELEMENT
            table.wrong(message(row=table.at(k), number=number))
    table.finish()
    total = np.zeros((len(ids), 3))
    np.add.at(total, rows, values)
    if of_rows == "node":
        return GivenLoads(total)
    return GivenLoads(np.zeros((net.n, 3)), np.repeat(total, net.parts, axis=0))
