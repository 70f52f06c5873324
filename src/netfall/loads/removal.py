"""Member removals of [[remove]]: the elements removed at each step, and the particles that leave too."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.errors import raise_errors
from netfall.geometry.connected_parts import connected_parts, part_contains
from netfall.geometry.net import Net, elements_of_cables, elements_of_group
from netfall.geometry.turned import reaction_axes
from netfall.job.derived import moves_supports
from netfall.job.job import Job
from netfall.job.keys.entries import REMOVED_MEMBER_KEYS
from netfall.job.values import MOST_NAMED, counted, format_list, format_value
from netfall.loads import messages
from netfall.loads.redistribution import Redistribution, redistribute


@dataclass(frozen=True)
class Loss:
    """Members removed before one step, in global numbers.

    step : number of the step, the removal happens at x(step); entries : of [[remove]], from 0
    elements : (k,) ascending; entry : (k,) first of the entries that names each; ends : (k, 2) particles
    particles : that leave too, because nothing else holds them and they carry nothing or pass it on
    redistribution : redistribution of what these particles carry
    """

    step: int
    entries: tuple[int, ...]
    elements: np.ndarray
    entry: np.ndarray
    ends: np.ndarray
    particles: np.ndarray
    redistribution: Redistribution


def find_removed_elements(job: Job, net: Net) -> list[np.ndarray]:
    """Return the rows of the elements that each entry of [[remove]] names. Raises InputError."""
    errors, named = [], []
    by_name: dict[str, Callable[..., Any]] = {
        "elements": _elements_by_id,
        "group": elements_of_group,
        "cables": elements_of_cables,
    }
    for number, entry in enumerate(job.removes, 1):
        key = next(key for key in REMOVED_MEMBER_KEYS if getattr(entry, key) is not None)
        rows, problems = by_name[key](net, getattr(entry, key))
        if not problems and net.bending is not None and net.bending[rows].any():
            problems = [messages.BENDING_BARS_REMOVED()]
        label = f"{job.path}: [[remove]] {number}: {key} = {format_value(getattr(entry, key))}"
        errors += [f"{label}: {problem}" for problem in problems[:MOST_NAMED]]
        named.append(rows)
    raise_errors(errors)
    return named


def _elements_by_id(net: Net, wanted_ids: list[int]) -> tuple[np.ndarray, list[str]]:
    """Return the rows of elements by their ids, and the errors."""
    ids, unknown = net.element_id, sorted(set(wanted_ids) - set(net.element_id.tolist()))
    problem = messages.UNKNOWN_ELEMENTS(ids=format_list(unknown), first=ids.min(), last=ids.max())
    return np.flatnonzero(np.isin(ids, wanted_ids)), [problem] if unknown else []


def absent_member_notes(job: Job, net: Net) -> Iterator[str]:
    """Yield notes on removals of elements that an erection stage took out; net : after the last stage."""
    for number, rows in enumerate(find_removed_elements(job, net), 1):
        if len(ids := net.element_id[rows[~net.is_there[rows]]]):
            yield messages.ALREADY_ABSENT(number=number, elements=counted("element", ids))


def superposed_excitation_notes(job: Job, varies: bool) -> Iterator[str]:
    """Yield notes on causes other than the removal that contribute to dynamic factors.

    varies : whether the wind has gusts
    """
    if job.removes and varies:
        yield messages.GUSTS_WITH_REMOVAL()
    if job.removes and job.wind and job.wind.onset == "sudden":
        yield messages.SUDDEN_WIND_WITH_REMOVAL()
    if job.removes and moves_supports(job):
        yield messages.MOTION_WITH_REMOVAL()


def make_removals(job: Job, model: Any, schedule: Any) -> list[Loss]:
    """Return the removals of the dynamic stage, step by step, up to its end. Rank 0.

    model : `model.Model`; schedule : `schedule.Schedule`. An element is removed once, by the first entry.
    """
    steps = [schedule.step_at(entry.time) for entry in job.removes]
    present = model.net.is_there
    losses = []
    for step in sorted(s for s in set(steps) if s < schedule.steps):
        entries = tuple(k for k, s in enumerate(steps) if s == step)
        entry = np.full(model.net.m, -1)
        for k in reversed(entries):
            entry[model.layout.lost[k]] = k
        elements = np.flatnonzero((entry >= 0) & present)
        if not len(elements):  # an earlier entry removed all of them
            continue
        present[elements] = False
        particles, handed = particles_removed_with(model, elements, present)
        ends = model.net.elements[elements]
        losses.append(Loss(step, entries, elements, entry[elements], ends, particles, handed))
    return losses


def particles_removed_with(
    model: Any, elements: np.ndarray, there: np.ndarray, torn: Iterable[int] = ()
) -> tuple[np.ndarray, Redistribution]:
    """Return the particles that only the removed elements (k,) hold, and where their loads go.

    Particles inside a removed cable pass on all that they carry. The others leave only if they carry nothing.
    there : (m,) bool, elements that remain; torn : as in `redistribute`
    """
    net = model.net
    held = (np.bincount(net.elements[there].ravel(), minlength=net.n) > 0) | net.held.any(1)
    carries = (net.mass > 0) | (model.loading.carried > 0) | model.layout.loads.nodes.any(1)
    unheld = np.zeros(net.n, bool)
    unheld[net.elements[elements]] = True
    unheld &= ~held
    redistribution = redistribute(net, model.L0, elements, unheld, torn)
    return np.union1d(np.flatnonzero(unheld & ~carries), redistribution.particles), redistribution


def particles_removed_after_breaks(
    model: Any, losses: list[Loss], k: int, torn: Any
) -> tuple[np.ndarray, Redistribution]:
    """Return `particles_removed_with` for removal k of a run in which the elements `torn` broke before it.
    Rank 0."""
    present = model.net.is_there
    for loss in losses[: k + 1]:
        present[loss.elements] = False
    return particles_removed_with(model, losses[k].elements, present, torn)


def is_unsupported(net: Net, there: np.ndarray, load: np.ndarray, gone: np.ndarray) -> bool:
    """Tell whether a force acts on a part of the net along an axis that none of its supports holds.

    Such a part has no equilibrium. there : (m,) bool, elements that remain; load : (n, 3) [N]
    gone : (n,) bool, particles that left
    """
    label = connected_parts(net.elements[there], net.n)
    supported = np.column_stack([part_contains(label, held) for held in reaction_axes(net).T])
    return bool(((load != 0.0) & ~gone[:, None] & ~supported).any())
