"""One sample of a study: a job from form finding to the end of its dynamic stage, and its outcomes."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from netfall.core import errors
from netfall.core.messages import code_of, is_error
from netfall.core.progress import Progress
from netfall.core.timings import PhaseTimes
from netfall.driver.dynamics import stage as dynamics
from netfall.driver.problem import Problem
from netfall.driver.reporting.run import run_notes
from netfall.driver.run import make_context, raise_failure, run_stages
from netfall.driver.setup import prepare_problem
from netfall.driver.statics import stage as statics
from netfall.explicit.energy import Snapshot
from netfall.explicit.plan import StepPlan
from netfall.geometry.build import TOO_WEAK
from netfall.geometry.net import Net, connected_parts, part_is_supported
from netfall.job.cache import ResultCache
from netfall.job.job import Job
from netfall.loads.start_weights import start_weights
from netfall.model.messages import STARTS_BEYOND_LIMIT
from netfall.model.model import Model, compressive_fracture_strain
from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.physics.fields import Features
from netfall.physics.state import State
from netfall.results.datasets import EQUILIBRIUM, NO_EQUILIBRIUM, NO_OUTCOMES, UNDECIDED
from netfall.results.h5 import check_one_folder
from netfall.results.locks import check_output_path
from netfall.results.removals import OUTCOME_TEXT, removal_states, significant_dynamic_factors, tension_ratios
from netfall.results.states import LIMIT_POINT
from netfall.results.warning_text import BALANCE_COLUMNS
from netfall.results.writer import net_section

ROUNDING = 1e-9  # relative tolerance of a strain at the yield force


class Extremes(NamedTuple):
    """Largest values of a run, on rank 0: over the history rows and at the end, or over all equilibria.

    tension, at_end : (m,) [N] in the middle and at the end of elements, as of `loads.start_weights`
    strain : (m,) the largest strain in tension, force over EA plus plastic strain; in equilibria at the end
    compressed : (m,) the largest shortening, positive; in the dynamic stage at most that at the Euler load
    displacement : (n, 1) [m]; sunk : (n, k) [m] downwards, at the end of the dynamic stage, or in each of the
        equilibria
    """

    tension: np.ndarray
    at_end: np.ndarray
    strain: np.ndarray
    compressed: np.ndarray
    displacement: np.ndarray
    sunk: np.ndarray


def elastic_strain(N: np.ndarray, EA: np.ndarray) -> np.ndarray:
    """Compute the elastic strain of forces N (m,) [N]; 0 for removed elements."""
    return np.divide(N, EA, out=np.zeros(len(N)), where=EA > 0.0)


def gather_extremes(problem: Problem, rows: Extremes) -> Extremes | None:
    """Gather the extremes of all ranks on rank 0; rows : of this rank, (m,), (n_owned,). Collective."""
    gather_particles = problem.distribution.gather_particles
    of_elements = [problem.gather_elements(values) for values in rows[:4]]
    of_particles = [gather_particles(np.column_stack([values])) for values in rows[4:]]
    gathered = [values for values in of_elements + of_particles if values is not None]
    return Extremes(*gathered) if gathered else None


def local_start_weights(problem: Problem) -> Callable[[str, np.ndarray, float], np.ndarray]:
    """Return the function of `start_weights` for the elements and particles of this rank. Collective."""
    columns, names, distribution = None, None, problem.distribution
    if problem.model:
        net, tables = problem.model.net, problem.model.layout.load_tables.items()
        lines = {name: loads.elements for name, loads in tables if loads.elements is not None}
        L0 = np.where(net.is_there, problem.model.cut_length, 0.0)
        diameter = np.zeros(net.m) if net.diameter is None else net.diameter
        columns, names = np.column_stack([L0, net.own_weight, diameter, *lines.values()]), [*lines]
    L0, own, diameter, *forces = distribution.elements(columns).T
    names = problem.comm.bcast(names)
    line_loads = {name: np.column_stack(forces[3 * k : 3 * k + 3]) for k, name in enumerate(names)}
    return start_weights(problem.job, distribution.subdomain.ends, L0, L0, own, diameter, line_loads)


def extremes_of_motion(problem: Problem, simulation: dynamics.Simulation) -> Extremes:
    """Return the extremes of a dynamic stage, rows of this rank. Collective.

    The plastic strain of a cable never decreases, so the last value is the largest.
    """
    state, n, (tension, _, least, _) = simulation.state, simulation.state.n_owned, simulation.envelope.tension
    plastic = 0.0 if state.eps_p is None else state.eps_p
    strain = elastic_strain(tension, state.EA) + plastic
    compressed = -np.minimum(0.0, elastic_strain(least, state.EA) + plastic)
    displacement, sunk = simulation.envelope.displacement[0], state.x_start[:n, 2] - state.x[:n, 2]
    at_end = tension + np.abs(local_start_weights(problem)("", state.x_start, 1.0))
    return Extremes(tension, at_end, strain, compressed, displacement, sunk)


class EquilibriumExtremes:
    """Accumulates the largest values over equilibria, rows of this rank; sunk : of each equilibrium."""

    def __init__(self, problem: Problem):
        self.start_weights, subdomain = local_start_weights(problem), problem.distribution.subdomain
        m, n = len(subdomain.element_gid), subdomain.n_owned
        tension, at_end, strain = np.full((3, m), np.nan)  # nan: no equilibrium yet
        self.rows = Extremes(tension, at_end, strain, np.zeros(m), np.zeros(n), np.zeros(n))
        self.sunk = [self.rows.sunk]

    def include(self, state: State, snapshot: Snapshot, place: str, live: float) -> None:
        """Include an equilibrium; place, live : as in `start_weights`."""
        largest, displacement = self.rows, (state.x - state.x_start)[snapshot.rows]
        at_end = snapshot.N + np.abs(self.start_weights(place, state.x, live))
        np.fmax(largest.tension, snapshot.N, out=largest.tension)
        np.fmax(largest.at_end, at_end, out=largest.at_end)
        np.fmax(largest.strain, elastic_strain(at_end, state.EA) + snapshot.eps_p, out=largest.strain)
        np.fmax(largest.compressed, np.where(state.EA > 0.0, -snapshot.eps, 0.0), out=largest.compressed)
        np.maximum(
            largest.displacement, np.sqrt((displacement * displacement).sum(1)), out=largest.displacement
        )
        self.sunk.append(-displacement[:, 2])

    def complete(self) -> Extremes:
        """Return the extremes over all equilibria."""
        return self.rows._replace(sunk=np.column_stack(self.sunk))


def run_sample(
    comm: MPI.Comm,
    read: Callable[[], Job],
    path: Path | None,
    cache: ResultCache,
    profile: bool = False,
    depth: float | None = None,
    choose_plan: Callable[[Features], Callable[..., StepPlan]] = lambda features: StepPlan,
    say: Callable[[list[str]], None] = lambda lines: None,
) -> dict[str, Any] | None:
    """Run a job. Return its outcomes and `exit_code`, as of `netfall run`, on rank 0. Collective.

    read : reads the job, on every rank; path : of a result file, None: no file
    cache : cache of earlier runs in this process; profile : whether to time the parts of a step
    depth : [m], of the outcome `sunk_area`
    choose_plan : returns the function that makes the `StepPlan` of a problem; raises InputError without one
    say : receives the warnings, on rank 0

    A run that has no equilibrium, diverges or has wrong input is also a result.
    """
    begin, progress = time.thread_time(), Progress(False)
    try:
        phases = PhaseTimes(profile)
        outcome = _run_outcomes(comm, read(), path, cache, phases, depth, choose_plan, progress)
        outcomes = (outcome or {}) | {"exit_code": 0}
        outcomes["state"] = outcomes.get("state") or "finished"
    except (errors.InputError, errors.DivergedError, errors.OutputError) as error:
        if isinstance(error, errors.OutputError) and comm.size > 1 and not errors.is_on_every_rank(error):
            raise
        outcomes = _outcomes_of_failure(error)
        error.__traceback__ = None  # its frames refer to the error, and to all arrays of the run
    say(progress.warnings)
    return outcomes | {"seconds": time.thread_time() - begin} if comm.rank == 0 else None


def _outcomes_of_failure(error: errors.InputError | errors.RunError) -> dict[str, Any]:
    """Return the outcomes of a run that ended early. Without an equilibrium the roof fails at 0 s."""
    state = _state_of(error)
    reason = "; ".join(error.lines) if isinstance(error, errors.InputError) else str(error)
    lost = {"first_fracture": 0.0, "detached_area": 1.0, "sunk_area": 1.0} if state == NO_EQUILIBRIUM else {}
    return NO_OUTCOMES | lost | {"state": state, "reason": reason, "exit_code": error.exit_code}


def _state_of(error: errors.InputError | errors.RunError) -> str:
    """Return the state of a run that ended early.

    If the prestress breaks or yields an element, possibly with a random strength, no equilibrium exists.
    """
    if isinstance(error, errors.InputError):
        codes = {code_of(line) for line in filter(is_error, error.lines)}
        return NO_EQUILIBRIUM if codes <= {*TOO_WEAK, STARTS_BEYOND_LIMIT.code} else "failed"
    return error.state


def _run_outcomes(
    comm: MPI.Comm,
    job: Job,
    path: Path | None,
    cache: ResultCache,
    phases: PhaseTimes,
    depth: float | None,
    choose_plan: Callable[[Features], Callable[..., StepPlan]],
    progress: Progress,
) -> dict[str, Any] | None:
    """Run the stages. Return the outcomes on rank 0. Collective."""
    if path:
        on_root(comm, lambda: check_output_path(path))
        check_one_folder(comm, path)
    problem = prepare_problem(comm, job, phases, cache=cache)[0]
    if comm.rank == 0:
        progress.say(*problem.build_up.lines, *([] if problem.failure else run_notes(problem)))
    context, accumulator = make_context(problem, path, progress, phases, cache=cache), None
    if job.dynamics is None:
        accumulator = EquilibriumExtremes(problem)
        context = replace(context, on_equilibrium=accumulator.include)
    try:
        if job.dynamics:
            context = replace(context, make_plan=choose_plan(problem.state.features))
        outcomes = run_stages(problem, context)
        if job.dynamics or problem.failure:
            raise_failure(context, outcomes)
    except (errors.InputError, errors.DivergedError):  # every rank raises the same
        problem.halo.free()
        raise
    problem.halo.free()
    last = statics.NAME if accumulator else dynamics.NAME
    rows = accumulator.complete() if accumulator else extremes_of_motion(problem, outcomes[last].result)
    extremes = gather_extremes(problem, rows)
    if problem.model is None or extremes is None:
        return None
    if accumulator:
        measured = _net_outcomes(problem.model.net, problem.model.roof.area, extremes, depth)
        measured["utilisation_before_break"] = utilisation(problem.model, extremes)
    else:
        measured = _dynamic_outcomes(problem.model, outcomes[last].result, extremes, depth)
    before = outcomes[statics.NAME].result if statics.NAME in outcomes else statics.StaticPath()
    return NO_OUTCOMES | measured | _failed_search(problem, before)


def _failed_search(problem: Problem, path: statics.StaticPath) -> dict[str, str]:
    """Return the state and the reason of a run in which an equilibrium does not carry its loads; {}: all do.

    The state is "no_equilibrium" if the equilibrium of a case does not exist, is unstable, or lies beyond a
    limit point. It is "undecided" if the outcome of a case is undecided. Stages of erection need not be
    stable, and no case precedes a dynamic stage.
    """
    reasons: dict[str, list[str]] = {NO_EQUILIBRIUM: [], UNDECIDED: []}
    for group, label in {**problem.build_up.labels, **path.labels}.items():
        state, factor = label["state"], label.get(LIMIT_POINT)
        holds = state == EQUILIBRIUM or group.startswith("stages/")
        if (holds and factor is None) or (problem.job.dynamics and group.startswith("cases/")):
            continue
        snap = "" if factor is None else f"limit point at the load factor {factor:.4g}"
        words = f"{group}: {label['reason'] or snap or state}"
        reasons[UNDECIDED if state == UNDECIDED else NO_EQUILIBRIUM].append(words)
    if not any(reasons.values()) and not path.failed:
        return {}
    state = NO_EQUILIBRIUM if reasons[NO_EQUILIBRIUM] else UNDECIDED
    return {"state": state, "reason": path.failed or "; ".join(reasons[state])}


def _net_outcomes(net: Net, area: np.ndarray, extremes: Extremes, depth: float | None) -> dict[str, Any]:
    """Return the outcomes that every run has. area : (n,) [m2]; depth : [m] of `sunk_area`"""
    strength = np.where(np.isfinite(net.breaking_load), net.breaking_load, net.yield_force)
    has_strength = np.isfinite(strength) & (strength > 0.0)
    ratios = extremes.at_end[has_strength] / strength[has_strength]
    beyond_yield = extremes.strain[has_strength] * (net.EA / net.yield_force)[has_strength]
    ratios = np.where(beyond_yield > 1.0 + ROUNDING, np.fmax(ratios, beyond_yield), ratios)
    outcomes = {
        "displacement_max": float(extremes.displacement.max()),
        "tension_max": float(extremes.tension.max()),
        "utilisation_max": float(ratios.max()) if len(ratios) else np.nan,
    }
    if depth is not None and area.sum() > 0.0:
        deeper = (extremes.sunk > depth).T
        outcomes["sunk_area"] = float(max(area[rows].sum() for rows in deeper) / area.sum())
    return outcomes


def _dynamic_outcomes(
    model: Model, simulation: dynamics.Simulation, extremes: Extremes, depth: float | None
) -> dict[str, Any]:
    """Return the outcomes of a dynamic stage that ran to its end. depth : [m] of `sunk_area`. Rank 0."""
    net, log, area, history = model.net, simulation.log, model.roof.area, simulation.history.columns()
    removal = simulation.removal.columns() if simulation.removal else {}
    failed = np.zeros(net.m, bool)
    failed[log.broken] = True
    used = utilisation(model, extremes)
    outcomes = {
        "times": log.time.tolist(),
        "elements": log.element.tolist(),
        "broken": len(np.unique(net.element_id[log.element])),
        **{name: float(np.abs(history[name]).max()) for name in BALANCE_COLUMNS},
    }
    if len(log):
        # abs, because bars also break in compression
        used = abs(float(log.strain[0] / net.fracture_strain[log.element[0]]))
        first = int(log.element[0])
        outcomes |= {"first_fracture": float(log.time[0]), "first_element": first}
        outcomes["first_element_id"] = int(net.element_id[first])
    if simulation.removal and simulation.removal.area is not None:
        failed[removal["element"]], area = True, simulation.removal.area
        highest = np.fmax(extremes.tension, np.fmax.reduce(removal["tension_highest"], 0))
        extremes = extremes._replace(tension=highest, at_end=highest + extremes.at_end - extremes.tension)
        outcomes |= _largest(net, removal, "tension_ratio", tension_ratios)
        if not len(log):  # as in `significant_dynamic_factors`
            outcomes |= _largest(net, removal, "dynamic_factor", significant_dynamic_factors)
        states = removal_states(removal)
        outcomes["equilibrium_after_removal"] = next((state for state in OUTCOME_TEXT if state in states), "")
        outcomes["gusts"] = int(model.wind_field is not None and model.wind_field.varies)
    outcomes |= {"detached_area": detached_area(net, area, failed), "utilisation_before_break": used}
    return outcomes | _net_outcomes(net, area, extremes, depth)


def utilisation(model: Model, extremes: Extremes) -> float:
    """Compute the largest ratio of strain to fracture strain, or of tension to breaking force if given.

    Bars that break in compression are also checked for shortening. nan: no element can break
    """
    strain, breakable = extremes.strain, np.isfinite(model.eps_u)
    if model.net.buckling is not None:
        breaks = np.isfinite(compressive_fracture_strain(model))
        strain = np.fmax(strain, np.where(breaks, extremes.compressed, 0.0))
    return float(np.max(strain[breakable] / model.eps_u[breakable])) if breakable.any() else np.nan


def study_net(
    comm: MPI.Comm,
    read: Callable[[], Job],
    cache: ResultCache,
    say: Callable[[list[str]], None] = lambda lines: None,
) -> dict[str, np.ndarray] | None:
    """Return the datasets of /net in a study file for the form-found net of a job, on rank 0. Collective.

    None if the job has no form. say : receives the warnings and notes before the run
    """
    try:
        problem = prepare_problem(comm, read(), PhaseTimes(), cache=cache)[0]
    except (errors.InputError, errors.DivergedError):
        return None
    problem.halo.free()
    if comm.rank > 0:
        return None
    names = ("elements", "fixed", "node_id", "element_id", "group", "tributary_area")
    model = problem.root_model
    say([] if problem.failure else run_notes(problem))
    net = net_section(model.net, model.roof, model.cut_length)
    datasets = {"particles": model.x, "cable": np.array(model.net.cable_names)[model.net.cable]}
    if model.net.roof_axes is not None:
        datasets["roof_axes"] = model.net.roof_axes
    return datasets | {name: net[name] for name in names}


def _largest(net: Net, removal: dict[str, np.ndarray], name: str, of: Callable[..., Any]) -> dict[str, Any]:
    """Return the largest value of `of` over all removals and elements, with its element; {} without one."""
    values = np.array([of(removal, k) for k in range(len(removal["time"]))])
    if np.isnan(values).all():
        return {}
    largest = np.nanargmax(values)
    element = int(largest % values.shape[1])
    return {
        f"{name}_max": float(values.flat[largest]),
        f"{name}_element": element,
        f"{name}_element_id": int(net.element_id[element]),
    }


def detached_area(net: Net, area: np.ndarray, gone: np.ndarray) -> float:
    """Compute the share of the roof's area (n,) [m2] without a connection to a vertical support.

    gone : (m,) bool, elements that broke or were removed; nan: no roof
    """
    label, total = connected_parts(net.elements[net.is_there & ~gone], net.n), float(area.sum())
    return float(area[~part_is_supported(net, label)].sum()) / total if total > 0.0 else np.nan
