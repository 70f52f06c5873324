"""Sentences on cables that slip over nodes in the dynamic stage."""

import numpy as np

from netfall.mechanics.slip.law import LEAST
from netfall.mechanics.slip.motion import slip_inertia
from netfall.model.model import Model

CHANGED = 0.1  # of its length: a strand of which more has slipped is told


def inertia_line(model: Model, dt: float) -> str:
    """Whether slips get more inertia, for steps of dt [s], than the cable has."""
    slides, net = model.layout.slides, model.net
    own = model.half_mass[slides.before] + model.half_mass[slides.after]
    inertia = slip_inertia(slides, net.EA, model.L0, model.half_mass, dt)
    more, most = int((inertia > own).sum()), int(np.argmax(inertia - own))
    line = f"slip: {slides.count} places, with the inertia of the cable there"
    if not more:
        return line
    node, times = slides.node[most], inertia[most] / max(own[most], 1e-300)
    return (
        f"{line}, at {more} with more for the step, up to {inertia[most]:.4g} kg, {times:.2g} times as much "
        f"(node {net.node_id[node]}, mass {model.mass[node]:.4g} kg); half the step needs a quarter"
    )


def slip_lines(model: Model, time: np.ndarray, slide: dict[str, np.ndarray]) -> list[str]:
    """What has slipped in the dynamic stage, strands that it changed much, where a cable ran out.

    time : (t,) [s]; slide : datasets of /slide
    """
    slides, net = model.layout.slides, model.net
    passed, stopped = slide["slip"] - slide["slip"][0], slide["stopped"]
    row, place = np.unravel_index(np.argmax(np.abs(passed)), passed.shape)
    if passed[row, place] == 0.0:
        return ["slip: none"]
    slipped = int((passed != 0.0).any(0).sum())
    lines = [
        f"slip: at {slipped} of {slides.count} places, at most {passed[row, place]:.4g} m, over node "
        f"{net.node_id[slides.node[place]]} by t = {time[row]:.4g} s"
    ]
    element, rows = np.unique(np.concatenate([slides.before, slides.after]), return_inverse=True)
    change = np.zeros((len(element), len(time)))
    np.add.at(change, rows, np.concatenate([-passed.T, passed.T]))
    share = np.abs(change).max(1) / model.L0[element]
    worst = int(np.argmax(share))
    if share[worst] > CHANGED:
        name = model.element_name(int(element[worst]))
        lines.append(
            f"note: slip changed the length of element {name} by {share[worst]:.0%}: "
            "masses, weights and the limit of the step are those of the lengths at the start"
        )
    if not np.isnan(stopped).all():
        first = int(np.nanargmin(stopped))
        node = net.node_id[slides.node[first]]
        lines.append(
            f"note: at t = {stopped[first]:.6g} s a cable had run over node {node} "
            f"until {LEAST:.0%} of a strand was left, where its end stops it; so at "
            f"{int((~np.isnan(stopped)).sum())} places in all"
        )
    return lines
