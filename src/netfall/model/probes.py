"""Probes: nodes and elements whose histories the job requests, [output] probes and elements."""

from dataclasses import dataclass

import numpy as np

from netfall.core.errors import raise_errors
from netfall.geometry.net import Net
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.model import messages


@dataclass(frozen=True)
class Probes:
    """Nodes and elements whose histories are recorded, in global numbers.

    particles : displacements; elements : axial forces of the elements that meet the particles
    named : (k,) elements by id, axial forces; named_id : (k,) their ids
    """

    particles: np.ndarray
    elements: np.ndarray
    named: np.ndarray
    named_id: np.ndarray


def find_probes(job: Job, net: Net) -> Probes:
    """Find the nodes and elements that [output] names. Raises InputError for an unknown id."""
    probes, element_ids = job.output.probes, job.output.elements or []
    errors = []
    for key, noun, requested, ids in (
        ("probes", "node", [probe for probe in probes if isinstance(probe, int)], net.node_id),
        ("elements", "element", element_ids, net.element_id),
    ):
        if unknown := sorted(set(requested) - set(ids.tolist())):
            first, last, named = ids.min(), ids.max(), format_list(unknown)
            errors.append(
                messages.UNKNOWN_OUTPUT_IDS(
                    path=job.path, key=key, kind=noun, first=first, last=last, ids=named
                )
            )
    raise_errors(errors)
    particles = np.array([_particle(net, probe) for probe in probes], np.int64)
    rows = [np.flatnonzero(net.element_id == number) for number in dict.fromkeys(element_ids)]
    named_rows = np.concatenate([np.zeros(0, np.int64), *rows])
    adjacent = np.flatnonzero(np.isin(net.elements, particles).any(1))
    return Probes(particles, adjacent, named_rows, net.element_id[named_rows])


def _particle(net: Net, probe: int | list[float]) -> int:
    """Return the node with an id, or the node nearest to a point: [x, y] in plan, [x, y, z] in space."""
    if isinstance(probe, int):
        return int(np.flatnonzero(net.node_id == probe)[0])
    return int(np.argmin(np.sum((net.x[:, : len(probe)] - np.array(probe)) ** 2, axis=1)))
