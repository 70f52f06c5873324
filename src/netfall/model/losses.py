"""What [[remove]] asks for: which elements are lost at which step, and which particles go with them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import refuse
from netfall.job.asks import moves_supports
from netfall.job.entries import LOST
from netfall.job.job import Job
from netfall.job.values import MOST_NAMED, counted, listed, shown
from netfall.model.redistribution import Redistribution, redistribute
from netfall.net.net import Net, elements_of_cables, elements_of_group
from netfall.net.parts import part_has, parts_of
from netfall.net.turned import borne_along


@dataclass(frozen=True)
class Loss:
    """What is lost in one step, by global numbers.

    step : before which it happens, at x(step); entries : of [[remove]], from 0
    elements : (k,) ascending; entry : (k,) which of the entries names it first; ends : (k, 2) particles
    particles : that leave with them, for nothing else holds them, and they carry nothing or hand it over
    handed : what these leave to others
    """

    step: int
    entries: tuple[int, ...]
    elements: np.ndarray
    entry: np.ndarray
    ends: np.ndarray
    particles: np.ndarray
    handed: Redistribution


def named_elements(job: Job, net: Net) -> list[np.ndarray]:
    """The rows of the elements that each entry of [[remove]] names. Raises InputError."""
    errors, found = [], []
    by_name = {"elements": _of_ids, "group": elements_of_group, "cables": elements_of_cables}
    for number, entry in enumerate(job.removes, 1):
        key = next(key for key in LOST if getattr(entry, key) is not None)
        rows, wrong = by_name[key](net, getattr(entry, key))
        if not wrong and net.bending is not None and net.bending[rows].any():
            what = "bars of a chain that bends, whose loss is not computed; remove others, or bending = true"
            wrong = [what]
        if wrong:
            place = f"[[remove]] {number}: {key} = {shown(getattr(entry, key))}"
            errors.append(f"{job.path}: {place}: {'; '.join(wrong[:MOST_NAMED])}")
        found.append(rows)
    refuse(errors)
    return found


def _of_ids(net: Net, asked: list[int]) -> tuple[np.ndarray, list[str]]:
    """Rows of elements by their ids, and what is wrong with these."""
    ids, unknown = net.element_id, sorted(set(asked) - set(net.element_id.tolist()))
    wrong = [f"no element {listed(unknown)}; ids are {ids.min()} to {ids.max()}"] if unknown else []
    return np.flatnonzero(np.isin(ids, asked)), wrong


def absent_notes(job: Job, net: Net) -> Iterator[str]:
    """Losses of what a stage of erection took out before. net : as the last stage left it"""
    for number, rows in enumerate(named_elements(job, net), 1):
        if len(ids := net.element_id[rows[~net.is_there[rows]]]):
            gone = f"{counted('element', ids)} that a stage of erection took out"
            yield f"[[remove]] {number}: {gone}: nothing is lost"


def shaken_notes(job: Job, varies: bool) -> Iterator[str]:
    """What dynamic factors hold besides the loss. varies : whether the wind has gusts"""
    both = "so largest tensions and dynamic factors are of both"
    if job.removes and varies:
        yield (
            f"[[remove]]: gusts blow on after a loss, {both}; those of the loss alone come in the mean wind "
            "([wind] turbulence = 0, or a table that stays at its mean)"
        )
    if job.removes and job.wind and job.wind.onset == "sudden":
        yield f'[[remove]]: the wind came at once, {both} (onset = "static": it does not)'
    if job.removes and moves_supports(job):
        yield (
            f"[[remove]]: supports move, {both}, and the rest after a loss is that of supports where they "
            "were at the start; those of the loss alone come without [[motion]]"
        )


def losses_of(job: Job, model, schedule) -> list[Loss]:
    """What is lost in the dynamic stage, step by step; nothing that lies beyond its end. Rank 0.

    model : `model.Model`; schedule : `schedule.Schedule`. An element is lost once, to the first entry.
    """
    step = [schedule.step_at(entry.time) for entry in job.removes]
    there = model.net.is_there
    found = []
    for at in sorted(s for s in set(step) if s < schedule.steps):
        entries = tuple(k for k, s in enumerate(step) if s == at)
        entry = np.full(model.net.m, -1)
        for k in reversed(entries):
            entry[model.layout.lost[k]] = k
        elements = np.flatnonzero((entry >= 0) & there)
        if not len(elements):  # lost before: nothing happens
            continue
        there[elements] = False
        leaving = leaving_with(model, elements, there)
        found.append(Loss(at, entries, elements, entry[elements], model.net.elements[elements], *leaving))
    return found


def leaving_with(
    model, elements: np.ndarray, there: np.ndarray, torn=()
) -> tuple[np.ndarray, Redistribution]:
    """Particles that nothing holds but the elements (k,) that go now, and what they hand over.

    Those inside a lost cable hand over all that they carry; of the others those leave that carry nothing.
    there : (m,) bool, which elements remain; torn : as in `redistribute`
    """
    net = model.net
    held = (np.bincount(net.elements[there].ravel(), minlength=net.n) > 0) | net.held.any(1)
    carries = (net.mass > 0) | (model.loading.carried > 0) | net.load.any(1)
    loose = np.zeros(net.n, bool)
    loose[net.elements[elements]] = True
    loose &= ~held
    handed = redistribute(net, model.L0, elements, loose, torn)
    return np.union1d(np.flatnonzero(loose & ~carries), handed.particles), handed


def leaving_then(model, losses: list[Loss], k: int, torn) -> tuple[np.ndarray, Redistribution]:
    """As `leaving_with`, at loss k of a run in which some elements had broken before. Rank 0."""
    there = model.net.is_there
    for loss in losses[: k + 1]:
        there[loss.elements] = False
    return leaving_with(model, losses[k].elements, there, torn)


def comes_loose(net: Net, there: np.ndarray, load: np.ndarray, gone: np.ndarray) -> bool:
    """Whether a force acts on a part of the net along an axis that no support of it holds: it has no rest.

    there : (m,) bool, the elements that remain; load : (n, 3) [N]; gone : (n,) bool, particles that left
    """
    label = parts_of(net.elements[there], net.n)
    supported = np.column_stack([part_has(label, borne) for borne in borne_along(net).T])
    return bool(((load != 0.0) & ~gone[:, None] & ~supported).any())
