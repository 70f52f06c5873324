"""What [[remove]] asks for: which elements are lost at which step, and which particles go with them."""

from dataclasses import dataclass

import numpy as np

from netfall.errors import InputError
from netfall.job.read import Job
from netfall.job.values import nearest, shown
from netfall.net.net import Net

MOST_NAMED = 8  # ids in one message


@dataclass(frozen=True)
class Loss:
    """What is lost in one step, by global numbers.

    step : before which it happens, at x(step); entries : of [[remove]], from 0
    elements : (k,) ascending; entry : (k,) which of the entries names it first
    particles : that leave with them, for nothing else holds them and they carry nothing
    """

    step: int
    entries: tuple[int, ...]
    elements: np.ndarray
    entry: np.ndarray
    particles: np.ndarray


def named_elements(job: Job, net: Net) -> list[np.ndarray]:
    """The rows of the elements that each entry of [[remove]] names. Raises InputError."""
    errors, found = [], []
    for number, entry in enumerate(job.removes, 1):
        place = f"{job.path}: [[remove]] {number}:"
        if entry.elements is not None:
            rows = np.flatnonzero(np.isin(net.element_id, entry.elements))
            unknown = sorted(set(entry.elements) - set(net.element_id[rows].tolist()))
            if unknown:
                few = ", ".join(map(str, unknown[:MOST_NAMED]))
                ids = f"{net.element_id.min()} to {net.element_id.max()}"
                errors.append(f"{place} elements = {shown(entry.elements)}: no element {few}; ids are {ids}")
        else:
            names = net.group_names
            rows = np.flatnonzero(net.group == names.index(entry.group)) if entry.group in names else []
            if not len(rows):
                there = [name for g, name in enumerate(names) if name and (net.group == g).any()]
                advice = nearest(entry.group, there) if there else "the net has no groups"
                errors.append(f"{place} group = {shown(entry.group)}: no such group of elements; {advice}")
        found.append(np.asarray(rows, np.int64))
    if errors:
        raise InputError(errors)
    return found


def losses_of(job: Job, model, schedule) -> list[Loss]:
    """What is lost in the dynamic stage, step by step; nothing that lies beyond its end. Rank 0.

    model : `model.Model`; schedule : `schedule.Schedule`. An element is lost once, to the first entry.
    """
    step = [schedule.step_at(entry.time) for entry in job.removes]
    there = np.ones(model.net.m, bool)
    found = []
    for at in sorted(s for s in set(step) if s < schedule.steps):
        entries = tuple(k for k, s in enumerate(step) if s == at)
        entry = np.full(model.net.m, -1)
        for k in reversed(entries):
            entry[model.lost[k]] = k
        elements = np.flatnonzero((entry >= 0) & there)
        there[elements] = False
        particles = particles_with(model, elements, there)
        found.append(Loss(at, entries, elements, entry[elements], particles))
    return found


def particles_with(model, elements: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Particles that nothing holds but the elements (k,) that go now, and that carry nothing of their own.

    there : (m,) bool, which elements remain
    """
    net = model.net
    held = np.bincount(net.elements[there].ravel(), minlength=net.n) > 0
    carries = (net.mass > 0) | (model.carried > 0) | net.load.any(1) | net.held.any(1)
    touched = np.zeros(net.n, bool)
    touched[net.elements[elements]] = True
    return np.flatnonzero(touched & ~held & ~carries)


def comes_loose(net: Net, there: np.ndarray, load: np.ndarray, gone: np.ndarray) -> bool:
    """Whether a part of the net that a force acts on hangs on no support: it has no rest.

    there : (m,) bool, the elements that remain; load : (n, 3) [N]; gone : (n,) bool, particles that left
    """
    label = np.arange(net.n)
    ends = net.elements[there]
    while True:  # the least number of each part spreads by doubling steps
        low = np.minimum(label[ends[:, 0]], label[ends[:, 1]])
        new = label.copy()
        np.minimum.at(new, ends[:, 0], low)
        np.minimum.at(new, ends[:, 1], low)
        np.minimum.at(new, label[ends[:, 0]], low)
        np.minimum.at(new, label[ends[:, 1]], low)
        new = new[new]
        if (new == label).all():
            break
        label = new
    supported = np.zeros(net.n, bool)
    supported[label[net.held.any(1)]] = True
    return bool((load.any(1) & ~gone & ~supported[label]).any())
