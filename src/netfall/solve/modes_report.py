"""The net's modes in a run and in `check`: about which rest, their periods, what damps them."""

from types import SimpleNamespace

import numpy as np

from netfall.errors import DivergedError
from netfall.functions import lengths
from netfall.job.read import Job
from netfall.net.areas import unit_normals
from netfall.net.plan import listed
from netfall.solve.committed import committed, put_back
from netfall.solve.model import Model
from netfall.solve.modes import Modes, modes_at
from netfall.solve.setup import Setup
from netfall.solve.statics import (
    equilibria,
    has_statics,
    reference_force,
    rests_at_loss,
    settle,
)
from netfall.stop import NEVER

MODES = 6  # that `check` prints
LARGEST = 50_000  # elements up to which it does
MOVING = 0.5  # of the largest displacement: nodes that a mode without stiffness is named by
REST = {"step": "the static loads", "at once": "the constant loads", "rest": "the mean wind"}


def modes_now(setup: Setup, count: int) -> Modes | None:
    """The lowest modes of the net as it stands, on rank 0, None elsewhere. Collective."""
    distribution, state, model = setup.distribution, setup.state, setup.model
    x = distribution.gather_particles(state.x)
    N = distribution.gather_elements(state.elements_now().N)
    if model is None:
        return None
    return modes_at(x, model.net, N, model.L0, model.mass, count, state.scene.logarithmic)


def modes_section(job: Job, modes: Modes) -> dict[str, np.ndarray]:
    """The datasets of /modes."""
    section = {"period": modes.period, "shape": modes.shape}
    return section | ({"damping_ratio": modes.damping_ratio(job.dynamics.damping)} if job.dynamics else {})


def mode_lines(job: Job, setup: Setup) -> list[str]:
    """The lines of `check` on modes and damping. Changes the state. One rank."""
    if setup.model.net.m > LARGEST:
        return [f"modes: left out, for the net has more than {LARGEST} elements"]
    where = go_to_rest(job, setup)
    modes = modes_now(setup, MODES)
    if not len(modes.period):
        return []
    lines = [f"modes {where}: periods {_row(modes.period)} s"] + _notes(setup.model, modes)
    return lines + (_damping_lines(job, setup.model, modes) if job.dynamics else [])


def go_to_rest(job: Job, setup: Setup) -> str:
    """Bring the state to where the run's last equilibrium is, if it has any; where that is, in words.

    At once, where a run takes its steps. One rank.
    """
    run = SimpleNamespace(comm=setup.distribution.comm, job=job, setup=setup)
    last = [each for each in equilibria(run) if each.kind in REST] if has_statics(job) else []
    if not last:
        return "in the initial state, without loads"
    start, loads = committed(setup.state), "all loads" if rests_at_loss(job) else REST[last[-1].kind]
    try:
        settle(run, last[-1], reference_force(run, last[-1]), NEVER)
    except DivergedError:
        put_back(setup.state, start)
        return f"in the initial state, for no rest was found under {loads},"
    return f"at rest under {loads}"


def _notes(model: Model, modes: Modes) -> list[str]:
    """What has no stiffness, or less than none."""
    notes = []
    for which, words in (
        (np.isinf(modes.period), "have no stiffness (mechanisms)"),
        (np.isnan(modes.period), "are not stable"),
    ):
        if which.any():
            moved = (np.linalg.norm(modes.shape[which], axis=2) > MOVING).any(0)
            more = f" ({modes.unstable} of the net)" if np.isnan(modes.period[which]).any() else ""
            notes.append(
                f"modes: {int(which.sum())} of these {words}{more}: "
                f"nodes {listed(model.net.node_id[moved])} move most"
            )
    return notes


def _damping_lines(job: Job, model: Model, modes: Modes) -> list[str]:
    zeta = job.dynamics.damping
    lines = [
        f"damping: damping = {zeta:g} 1/s is {_row(100.0 * modes.damping_ratio(zeta))} % of the critical in "
        "them (damping x period / 4 pi)"
    ]
    if job.wind is not None and not job.wind.pressures and np.isfinite(modes.period).any():
        air = 100.0 * air_damping(job, model, modes)
        lines.append(
            f"damping: the air's own is left out; it would be of the order of {_row(air)} % "
            "(rho U on the speed along the normal)"
        )
    return lines


def air_damping(job: Job, model: Model, modes: Modes) -> np.ndarray:
    """Order (k,) of the share of the critical damping that the air would give.

    A force rho U on each m2 of roof for each m/s along its normal (quasi-steady, slope of the coefficient
    over the angle of attack of 2): sum rho U A (phi n)^2 / (2 omega sum M phi^2).
    """
    gust = model.history.mean_gust
    speed = model.wind_field.mean + np.sum(model.wind_field.weight * gust[model.wind_field.corner], axis=1)
    size = lengths(model.vector_area)
    along = np.sum(modes.shape * unit_normals(model.vector_area), axis=2) ** 2
    taken = along @ (job.wind.air_density * speed * size)
    modal = np.sum(modes.shape**2, axis=2) @ model.mass
    return taken / modal * modes.period / (4.0 * np.pi)


def _row(values: np.ndarray) -> str:
    """Numbers of a line."""
    return ", ".join(f"{value:.4g}" for value in values)
