"""Cables that are cut with errors: what each error does to all tensions, and the net with drawn ones.

To first order the tension N_e has the standard deviation sqrt(sum over pieces k of (dN_e/da_k s_k)^2), a_k
the unstressed length of the piece and s_k its deviation: independent errors, influence from the tangent.
"""

from typing import NamedTuple

import numpy as np

from netfall.erection.tension import elastic, of_form, responses
from netfall.ground.stop import NEVER
from netfall.job.values import shown
from netfall.mechanics.slip.law import set_strands
from netfall.net.net import Net
from netfall.stages.scene import Scene
from netfall.stages.settle import reference_force, settle
from netfall.stages.static_outcome import EQUILIBRIUM, NONE, UNDECIDED, undecided

NAMED = 3  # pieces that matter most


class Deviated(NamedTuple):
    """A net whose pieces of cable have drawn errors, on rank 0: x (n, 3) [m], L0 (m,) [m].

    tension : (m,) [N] standard deviation by linear influence; effect : (k,) [N] of each piece of cable, the
        largest change of a tension by one standard deviation of its length; lines : to say
    failed : why there is no equilibrium with them, "": there is; x is then how far it came
    state : of the equilibrium, as of `StaticOutcome`
    """

    x: np.ndarray
    L0: np.ndarray
    tension: np.ndarray
    effect: np.ndarray
    lines: list[str]
    failed: str = ""
    state: str = EQUILIBRIUM

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays, by name."""
        return {name: getattr(self, name) for name in ("x", "L0", "tension", "effect")}


def shares(net: Net, L0: np.ndarray) -> np.ndarray:
    """What each element (m,) has of its piece of cable, at unstressed lengths L0 (m,) [m]."""
    return L0 / np.bincount(net.cable, L0)[net.cable]


def deviate(scene: Scene) -> Deviated | None:
    """Draw the errors of length and go to the equilibrium with them. Collective.

    Without a form, what is given is no equilibrium without load, and nodes stay where they are. On rank 0
    what came of it, None elsewhere.
    """
    model, spread, failed, state = scene.model, scene.distribution, "", EQUILIBRIUM
    each = of_form(scene, "deviation", "errors of length")
    tension, effect = _influence(scene, each.load)
    L0 = model and model.cut_length + model.net.length_error * shares(model.net, model.cut_length)
    set_strands(scene.state, spread.elements(L0))
    if scene.form is not None:
        outcome = elastic(scene, settle(scene, each, reference_force(scene, each), NEVER))
        state = outcome.state
        if state == UNDECIDED:
            failed = undecided(each.words, outcome)
        elif state == NONE:
            failed = f"{each.words}: there is no equilibrium with them: {outcome.reason}"
    x = spread.gather_particles(scene.state.x)
    if model is None:
        return None
    most = np.argsort(-effect, kind="stable")[:NAMED]
    names = ", ".join(f"{shown(model.net.cable_names[k])} {effect[k]:.4g} N" for k in most if effect[k] > 0.0)
    lines = [
        f"errors of length: tensions scatter by up to {tension.max():.4g} N (standard deviation, linear); "
        f"the pieces that matter most, by one deviation of each: {names}"
    ]
    return Deviated(x, L0, tension, effect, lines, failed, state)


def _influence(scene: Scene, load: np.ndarray) -> tuple:
    """Standard deviations (m,) [N] of tensions, effects (k,) [N] of the pieces, on rank 0. Collective."""
    net = scene.model and scene.model.net
    deviation = scene.comm.bcast(net and _of_pieces(net))
    square, effect = np.zeros(scene.distribution.m), np.zeros(len(deviation))
    drawn = np.flatnonzero(deviation)
    respond = responses(scene, load)
    for k in drawn:
        change = net and np.where(net.cable == k, shares(net, scene.model.cut_length), 0.0)
        _, N = respond(scene.distribution.elements(change))
        if net:
            square += (deviation[k] * N) ** 2
            effect[k] = deviation[k] * np.abs(N).max()
    return np.sqrt(square), effect


def _of_pieces(net: Net) -> np.ndarray:
    """Deviation (k,) [m] of the length of each piece of cable."""
    deviation = np.zeros(len(net.cable_names))
    np.maximum.at(deviation, net.cable, net.length_deviation)
    return deviation
