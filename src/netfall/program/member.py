"""One run of a study: a job from form finding to the end of its dynamic stage, and what is told of it."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from netfall.ground.errors import DivergedError, InputError, NoRest, OutputError
from netfall.ground.progress import Progress
from netfall.ground.timings import Phases
from netfall.job.job import Job
from netfall.job.memory import Memory
from netfall.mechanics.events import EventLog
from netfall.model.model import Model
from netfall.net.net import Net
from netfall.net.parts import parts_of
from netfall.parallel.agree import on_root
from netfall.program.run import desk_for, raise_failure, run_stages, scheduled
from netfall.program.setup import prepare
from netfall.results.loss_lines import MUCH, states_of_rest, worst_rest
from netfall.results.outcomes import NOTHING
from netfall.stages import dynamics
from netfall.write.locks import check_place
from netfall.write.result import Result
from netfall.write.unwritten import Unwritten


def run_member(
    comm: MPI.Comm,
    read: Callable[[], Job],
    path: Path | None,
    memory: Memory,
    profile: bool = False,
    depth: float | None = None,
) -> dict | None:
    """Run a job; what came of it, on rank 0: the outcomes and `exit_code`, as of `netfall run`. Collective.

    read : reads the job, on every rank; path : of a result file, None: none is written
    memory : of runs before in this process; profile : time the parts of a step
    depth : [m], of the outcome `sunk_area`

    A run without a rest, or that diverges, or whose input is wrong, is a result too.
    """
    begin = time.perf_counter()
    try:
        outcome = _outcome(comm, read(), path, memory, Phases(profile), depth)
        found = (outcome or {}) | {"state": "finished", "exit_code": 0}
    except NoRest as error:  # it fails before the first gust
        found = _ended("no_rest", error) | {"first_fracture": 0.0, "roof_lost": 1.0, "sunk_area": 1.0}
    except DivergedError as error:
        found = _ended("diverged", error)
    except InputError as error:
        found = _ended("failed", error)
    except OutputError as error:
        if not getattr(error, "on_every_rank", comm.size == 1):
            raise
        found = _ended("failed", error)
    return found | {"seconds": time.perf_counter() - begin} if comm.rank == 0 else None


def _ended(state: str, error: Exception) -> dict:
    """What is told of a run that did not come to its end."""
    reason = "; ".join(getattr(error, "lines", [str(error)]))
    return NOTHING | {"state": state, "reason": reason, "exit_code": error.exit_code}


def _outcome(
    comm: MPI.Comm, job: Job, path: Path | None, memory: Memory, phases: Phases, depth: float | None
) -> dict | None:
    """Run the stages; what came of them, on rank 0. Collective."""
    if path:
        on_root(comm, lambda: check_place(path))
    scene = scheduled(prepare(comm, job, phases, memory=memory)[0])
    log, own = EventLog(scene.distribution.n), scene.model and scene.model.net
    result = Result(comm, path, scene.distribution, own, log) if path else Unwritten(comm)
    desk = desk_for(scene, result, log, Progress(False), phases, memory=memory)
    try:
        outcomes = run_stages(scene, desk)
        raise_failure(desk, outcomes)
        simulation = outcomes[dynamics.NAME].result
    except (InputError, DivergedError):  # on every rank alike
        scene.halo.free()
        raise
    scene.halo.free()
    spread, state = scene.distribution, simulation.state
    mine, n = state.owned.astype(bool), state.n_owned
    plastic = np.zeros(state.m) if state.eps_p is None else state.eps_p
    extremes = Extremes(
        spread.gather_elements(simulation.envelope.tension[0], mine),
        spread.gather_elements(plastic, mine),
        spread.gather_particles(simulation.envelope.displacement[0][:, None]),
        spread.gather_particles((state.x_start[:n, 2] - state.x[:n, 2])[:, None]),
    )
    if comm.rank > 0:
        return None
    told = NOTHING | _told(scene.model, simulation, extremes, depth)
    return told | {"dynamic_seconds": phases.seconds["dynamics"]}


class Extremes(NamedTuple):
    """Of a run, on rank 0, over the rows of the history and at the end.

    tension : (m,) [N] the largest; plastic : (m,) plastic strain at the end
    displacement : (n, 1) [m] the largest; sunk : (n, 1) [m] downwards, at the end
    """

    tension: np.ndarray
    plastic: np.ndarray
    displacement: np.ndarray
    sunk: np.ndarray


def _told(model: Model, simulation, extremes: Extremes, depth: float | None) -> dict:
    """What is told of a run that came to its end. depth : [m] of `sunk_area`. Rank 0."""
    log, tension = simulation.log, extremes.tension
    removal = simulation.removal.columns() if simulation.removal else None
    gone = np.zeros(model.net.m, bool)
    gone[log.broken] = True
    found = {
        "times": log.time.tolist(),
        "elements": log.element.tolist(),
        "broken": len(log.broken),
        "displacement_max": float(extremes.displacement.max()),
        "balance_error": simulation.history.largest("balance_error"),
    }
    if len(log):
        found |= {"first_fracture": float(log.time[0]), "first_element": int(log.element[0])}
    if removal:
        gone[removal["element"]] = True
        tension = np.fmax(tension, np.fmax.reduce(removal["tension_highest"], 0))
        found |= {} if len(log) else _largest_factor(removal)  # the rest is that of a net that holds
        found["rest_after_loss"] = worst_rest(states_of_rest(removal))
        found["gusts"] = int(model.wind_field is not None and model.wind_field.varies)
    strength = np.where(np.isfinite(model.net.breaking_load), model.net.breaking_load, model.net.yield_force)
    known = np.isfinite(strength) & (strength > 0.0)
    used = tension[known] / strength[known]
    area = simulation.removal.area if removal else model.area
    if depth is not None and area.sum() > 0.0:
        found["sunk_area"] = float(area[extremes.sunk[:, 0] > depth].sum() / area.sum())
    return found | {
        "roof_lost": roof_lost(model.net, area, gone),
        "utilisation_before_break": utilisation_before_break(model.net, log, extremes),
        "tension_max": float(tension.max()),
        "utilisation_max": float(used.max()) if len(used) else np.nan,
    }


def utilisation_before_break(net: Net, log: EventLog, extremes: Extremes) -> float:
    """Largest strain over that at which the element breaks; at a breaking load that is tension over it.

    With a first fracture that of the element that breaks, which is above 1. Of a cable the largest strain is
    what its largest tension and its plastic strain, which only grows, make. nan: nothing can break.
    """
    limit = net.fracture_strain
    if len(log):
        return float(log.strain[0] / limit[log.element[0]])
    can = np.isfinite(limit)
    strain = extremes.tension[can] / net.EA[can] + extremes.plastic[can]
    return float(np.max(strain / limit[can])) if can.any() else np.nan


def net_of(comm: MPI.Comm, read: Callable[[], Job], memory: Memory) -> dict[str, np.ndarray] | None:
    """The datasets of /net in a study file, of a job in its form, on rank 0; None: no form. Collective."""
    try:
        scene = prepare(comm, read(), Phases(), memory=memory)[0]
    except (InputError, DivergedError):
        return None
    scene.halo.free()
    if comm.rank > 0:
        return None
    net, area = scene.model.net, scene.model.area
    return {
        "particles": scene.model.x,
        "elements": net.elements,
        "fixed": net.fixed.astype(np.uint8),
        "node_id": net.node_id,
        "element_id": net.element_id,
        "group": net.group.astype(np.int32),
        "cable": np.array(net.cable_names)[net.cable],
        "tributary_area": area,
    }


def _largest_factor(removal: dict[str, np.ndarray]) -> dict:
    """The largest dynamic factor among elements whose tension a loss changes by much, and its element."""
    change = np.abs(removal["tension_after"] - removal["tension_before"])
    largest = np.fmax.reduce(removal["tension_before"], axis=None, initial=0.0)
    factors = np.where(change > MUCH * largest, removal["dynamic_factor"], np.nan)
    if np.isnan(factors).all():
        return {}
    largest = np.nanargmax(factors)
    element = int(largest % factors.shape[1])
    return {"dynamic_factor_max": float(factors.flat[largest]), "dynamic_factor_element": element}


def roof_lost(net: Net, area: np.ndarray, gone: np.ndarray) -> float:
    """Share of the roof's area (n,) [m2] at particles that no path of elements connects to a support.

    gone : (m,) bool, elements that broke or were removed; nan: there is no roof
    """
    label = parts_of(net.elements[~gone], net.n)
    supported = np.zeros(net.n, bool)
    supported[label[net.held.any(1)]] = True
    total = float(area.sum())
    return float(area[~supported[label]].sum()) / total if total > 0.0 else np.nan
