"""Targets of the form: forces of groups, or heights of nodes, that unstressed lengths are changed for."""

from typing import NamedTuple

import numpy as np

from netfall.erection.lengths import Jack, Wanted, jack_of, rows_named, unknown_name
from netfall.erection.tension import elastic, influences, of_form, tension_to
from netfall.ground.errors import InputError
from netfall.job.job import Job
from netfall.job.values import shown
from netfall.net.net import Net
from netfall.parallel.agree import on_root
from netfall.stages.scene import Scene


class Reached(NamedTuple):
    """Targets that were reached, on rank 0: x (n, 3) [m], unstressed lengths L0 (m,) [m].

    change : (k,) [m] of each cable; influence : (k, k) of these amounts where the targets are
    equilibria : how many were looked for; lines : to say
    failed : why not all of them are reached, "": they are; x and L0 are then how far it came
    """

    x: np.ndarray
    L0: np.ndarray
    change: np.ndarray
    influence: np.ndarray
    equilibria: int
    lines: list[str]
    failed: str = ""

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays, by name."""
        return {name: getattr(self, name) for name in ("x", "L0", "change", "influence")}


def reach_targets(scene: Scene, planned: np.ndarray | None, before: Reached | None) -> Reached | None:
    """Change lengths until all targets are there, under the loads that the form carries. Collective.

    planned : (m,) [m] from which changes count, on rank 0; before : the turn before it, None: it is the first

    On rank 0 what came of it, None elsewhere; the state is left in that equilibrium. Raises InputError for
    names that are wrong.
    """
    job, model, comm = scene.job, scene.model, scene.comm
    wanted, jacks = on_root(comm, lambda: named_targets(job, model.net)) or ([], [])
    each = of_form(scene, "target", "the targets")
    found = tension_to(scene, each, wanted, jacks, model and model.cut_length, lambda L0: L0)
    found = found._replace(outcome=elastic(scene, found.outcome))
    influence = influences(scene, each.load, wanted, jacks, found.L0)
    x = scene.distribution.gather_particles(scene.state.x)
    if model is None:
        return None
    change_of = lambda jack: float((found.L0 - planned)[jack.rows].sum()) / (1 + int(jack.cable.max()))
    change = np.array([change_of(jack) for jack in jacks])  # [m] of each cable
    equilibria = found.equilibria + (before.equilibria if before else 0)
    if not found.outcome.carries:
        more = "what `by` names may not bear on it, or not so far"
        failed = f"{each.words}: {found.outcome.reason}; {more}"
        return Reached(x, found.L0, change, influence, equilibria, [], failed)
    lines = [
        f"target: {want.words} = {want.value:.6g} {'m' if want.node >= 0 else 'N'}: each cable of "
        f"{jack.name} {amount:+.6g} m"
        for want, jack, amount in zip(wanted, jacks, change)
    ]
    lines.append(f"targets: reached in {equilibria} equilibria")
    return Reached(x, found.L0, change, influence, equilibria, lines)


def named_targets(job: Job, net: Net) -> tuple[list[Wanted], list[Jack]]:
    """What is wanted and by which lengths. Raises InputError for names that the net does not have."""
    wanted, jacks, errors = [], [], []
    for number, target in enumerate(job.targets, 1):
        wrong = [line for name in (target.group, target.by) if name and (line := unknown_name(net, name))]
        if target.node is not None and target.node not in net.node_id:
            wrong.append(f"node = {target.node}: no such node")
        twice = [other for other in job.targets[: number - 1] if other.by == target.by]
        if twice:
            wrong.append(
                f"by = {shown(target.by)}: stands in an earlier target; each needs lengths of its own"
            )
        errors += [f"{job.path}: [[target]] {number}: {line}" for line in wrong]
        if not wrong:
            wanted.append(_wanted(net, target))
            jacks.append(jack_of(net, target.by))
    if errors:
        raise InputError(errors)
    return wanted, jacks


def _wanted(net: Net, target) -> Wanted:
    if target.group:
        return Wanted(f"force of {target.group}", target.force, rows_named(net, target.group))
    node = int(np.flatnonzero(net.node_id == target.node)[0])
    return Wanted(f"height of node {target.node}", target.height, np.zeros(0, int), node)
