"""Errors of cable lengths: the effect of each error on all tensions, and the net with random errors.

To first order the tension N_e has the standard deviation sqrt(sum over cables k of (dN_e/da_k s_k)^2). Here
a_k is the unstressed length of cable k and s_k its standard deviation. Errors are independent, and the
influence follows from the tangent.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.messages import kN
from netfall.core.timings import NEVER_STOP
from netfall.driver import messages
from netfall.driver.equilibrium import reference_force, settle
from netfall.driver.erection.tension import elastic, form_load, gathered_responses
from netfall.driver.problem import Problem
from netfall.driver.static_outcome import EQUILIBRIUM, NO_EQUILIBRIUM, UNDECIDED, undecided
from netfall.geometry.net import Net
from netfall.job.values import format_value
from netfall.physics.slip.law import set_slipless_lengths

MAX_LISTED_CABLES = 3  # most important cables in a message


class LengthErrors(NamedTuple):
    """Net whose cables have random errors of length, on rank 0: x (n, 3) [m], L0 (m,) [m].

    tension : (m,) [N] standard deviation by linear influence; effect : (k,) [N] of each cable, the largest
        change of a tension by one standard deviation of its length; lines : to print
    failed : why there is no equilibrium with them, "": there is; x is then the last position
    state : of the equilibrium, as in `StaticOutcome`
    """

    x: np.ndarray
    L0: np.ndarray
    tension: np.ndarray
    effect: np.ndarray
    lines: list[str]
    failed: str = ""
    state: str = EQUILIBRIUM

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays, by name."""
        return {name: getattr(self, name) for name in ("x", "L0", "tension", "effect")}


def cable_shares(net: Net, L0: np.ndarray) -> np.ndarray:
    """Compute the share of each element (m,) in its cable, at unstressed lengths L0 (m,) [m]."""
    return L0 / np.bincount(net.cable, L0)[net.cable]


def apply_length_errors(problem: Problem) -> LengthErrors | None:
    """Draw random errors of length and find the equilibrium with them. Collective.

    Without form finding the given geometry is not in equilibrium without load, so nodes are not moved.
    Returns the result on rank 0, None elsewhere.
    """
    model, distribution, failed, state = problem.model, problem.distribution, "", EQUILIBRIUM
    load_case = form_load(problem, "deviation", "errors of length")
    tension, effect = _influence(problem, load_case.load)
    L0 = None
    if model:
        L0 = model.cut_length + model.net.length_error * cable_shares(model.net, model.cut_length)
    set_slipless_lengths(problem.state, distribution.elements(L0))
    if problem.form is not None:
        outcome = elastic(
            problem, settle(problem, load_case, reference_force(problem, load_case), NEVER_STOP)
        )
        state = outcome.state
        if state == UNDECIDED:
            failed = undecided(load_case.words, outcome)
        elif state == NO_EQUILIBRIUM:
            failed = messages.ERRORS_WITHOUT_EQUILIBRIUM(what=load_case.words, reason=outcome.reason)
    x = distribution.gather_particles(problem.state.x)
    if model is None or x is None or L0 is None:
        return None
    largest = np.argsort(-effect, kind="stable")[:MAX_LISTED_CABLES]
    names = ", ".join(
        f"{format_value(model.net.cable_names[k])} {kN(effect[k])}" for k in largest if effect[k] > 0.0
    )
    lines = [
        f"errors of length: tensions have a standard deviation of up to {kN(tension.max())} (linear); "
        f"largest effect of one standard deviation of a cable: {names}"
    ]
    return LengthErrors(x, L0, tension, effect, lines, failed, state)


def _influence(problem: Problem, load: np.ndarray) -> tuple[Any, ...]:
    """Compute standard deviations (m,) [N] of tensions and effects (k,) [N] of cables, on rank 0.

    Collective.
    """
    model = problem.model
    net = model and model.net
    deviation = problem.comm.bcast(net and _cable_deviations(net))
    square, effect = np.zeros(problem.distribution.m), np.zeros(len(deviation))
    drawn = np.flatnonzero(deviation)
    respond = gathered_responses(problem, load)
    for k in drawn:
        change = None
        if model:
            change = np.where(model.net.cable == k, cable_shares(model.net, model.cut_length), 0.0)
        _, N = respond(problem.distribution.elements(change))
        if net:
            square += (deviation[k] * N) ** 2
            effect[k] = deviation[k] * np.abs(N).max()
    return np.sqrt(square), effect


def _cable_deviations(net: Net) -> np.ndarray:
    """Return the standard deviation (k,) [m] of the length of each cable."""
    deviation = np.zeros(len(net.cable_names))
    np.maximum.at(deviation, net.cable, net.length_std)
    return deviation
