"""Histories of nodes and elements that the job names: [output] probes and elements."""

from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import refuse
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
    probes, wanted = job.output.probes, job.output.elements or []
    errors = []
    for key, what, asked, ids in (
        ("probes", "node", [each for each in probes if isinstance(each, int)], net.node_id),
        ("elements", "element", wanted, net.element_id),
    ):
        if unknown := sorted(set(asked) - set(ids.tolist())):
            there = f"ids are {ids.min()} to {ids.max()}"
            errors.append(f"{job.path}: [output] {key}: no {what} {listed(unknown)}; {there}")
    refuse(errors)
    particles = np.array([_particle(net, each) for each in probes], np.int64)
    rows = [np.flatnonzero(net.element_id == one) for one in dict.fromkeys(wanted)]
    named = np.concatenate([np.zeros(0, np.int64), *rows])
    met = np.flatnonzero(np.isin(net.elements, particles).any(1))
    return Probes(particles, met, named, net.element_id[named])


def _particle(net: Net, probe) -> int:
    """The node of an id, or the one nearest to a place: [x, y] in plan, [x, y, z] in space."""
    if isinstance(probe, int):
        return int(np.flatnonzero(net.node_id == probe)[0])
    return int(np.argmin(np.sum((net.x[:, : len(probe)] - np.array(probe)) ** 2, axis=1)))
