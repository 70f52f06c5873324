"""Histories of nodes and elements that the job names: [output] probes and elements."""

from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.job import Job
from netfall.job.values import listed
from netfall.net.net import Net


@dataclass(frozen=True)
class Probes:
    """Whose histories are kept, in global numbers.

    particles : displacements; elements : tensions of those that meet there
    named : (k,) elements by id, tensions; named_id : (k,) their ids
    """

    particles: np.ndarray
    elements: np.ndarray
    named: np.ndarray
    named_id: np.ndarray


def find_probes(job: Job, net: Net) -> Probes:
    """The nodes and elements that [output] names. Raises InputError where there is none of an id."""
    nodes, wanted = job.output.probes, job.output.elements or ()
    node_id, element_id = net.node_id, net.element_id
    errors = _unknown(job, "probes", "node", [v for v in nodes if isinstance(v, int)], node_id)
    errors += _unknown(job, "elements", "element", wanted, element_id)
    if errors:
        raise InputError(errors)
    particles = np.array([_particle(net, each) for each in nodes], np.int64)
    rows = [np.flatnonzero(element_id == one) for one in dict.fromkeys(wanted)]
    named = np.concatenate([np.zeros(0, np.int64), *rows])
    met = np.flatnonzero(np.isin(net.elements, particles).any(1))
    return Probes(particles, met, named, element_id[named])


def _particle(net: Net, probe) -> int:
    """The node of an id, or the one nearest to a place: [x, y] in plan, [x, y, z] in space."""
    if isinstance(probe, int):
        return int(np.flatnonzero(net.node_id == probe)[0])
    return int(np.argmin(np.sum((net.x[:, : len(probe)] - np.array(probe)) ** 2, axis=1)))


def _unknown(job: Job, key: str, what: str, wanted, ids: np.ndarray) -> list[str]:
    """A line on the ids that there are not."""
    unknown = sorted(set(wanted) - set(ids.tolist()))
    line = f"{job.path}: [output] {key}: no {what} {listed(unknown)}; ids are {ids.min()} to {ids.max()}"
    return [line] if unknown else []
