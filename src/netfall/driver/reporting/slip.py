"""Lines on sliding cables in the dynamic stage."""

from collections.abc import Iterator

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.core.messages import mm
from netfall.driver import messages
from netfall.geometry.slip_points import SlidingCables
from netfall.model.model import Model
from netfall.model.schedule import slip_movers
from netfall.physics.slip.inertia import MOST_ADDED, added_share, slip_inertia
from netfall.physics.slip.law import MIN_SEGMENT_SHARE

MAX_EXCESS = 0.01  # share of the tension; below it a difference beyond the slip resistance gives no warning
CHANGED = 0.1  # share of the length of a free segment; a larger change by slip gives a warning


def inertia_line(model: Model, slides: SlidingCables, dt: float) -> str:
    """Say whether slips get more inertia, for steps of dt [s], than the cable has."""
    movers = slip_movers(model)
    ratio = slip_inertia(movers.own, movers.stiffness, dt) / movers.own
    increased, worst, share = int((ratio > 1.0).sum()), int(np.argmax(ratio)), added_share(movers, dt)
    if not increased:
        return f"slip: {slides.count} slip points, with the inertia of the cable there"
    node = model.net.node_id[slides.node[worst]]
    if share > MOST_ADDED:
        return messages.SLIP_INERTIA(
            count=increased, total=slides.count, ratio=ratio[worst], node=node, share=share, limit=MOST_ADDED
        )
    return (
        f"slip: the step adds inertia at {increased} of {slides.count} slip points, up to {ratio[worst]:.3g} "
        f"times that of the cable (node {node}), in all at most {share:.2%} of the moving mass"
    )


def form_slip_warnings(model: Model, slides: SlidingCables) -> list[str]:
    """Return a warning of slip points where tensions of the form differ by more than the slip resistance."""
    net, x = model.net, model.x
    u, w = (x[net.elements[e].sum(1) - slides.node] - x[slides.node] for e in (slides.before, slides.after))
    u, w = (vector / lengths(vector)[:, None] for vector in (u, w))
    turn = 2.0 * np.arctan2(lengths(u + w), lengths(u - w))
    N = model.N[np.stack([slides.before, slides.after])]
    slip_resistance = slides.resistance + np.maximum(N.min(0), 0.0) * np.expm1(slides.friction * turn)
    excess = np.abs(N[1] - N[0]) - slip_resistance
    slips, worst = excess > MAX_EXCESS * np.abs(N).max(0), int(np.argmax(excess))
    if not slips.any():
        return []
    (before, after), node = N[:, worst], net.node_id[slides.node[worst]]
    return [
        messages.FORM_SLIPS(count=int(slips.sum()), total=slides.count, node=node, before=before, after=after)
    ]


def slip_lines(model: Model, slides: SlidingCables, time: np.ndarray, slide: h5py.Group) -> Iterator[str]:
    """Yield lines on slip in the dynamic stage, strongly changed free segments and cables that ran out.

    time : (t,) [s]; slide : datasets of /slide
    """
    net = model.net
    slip, stopped = slide["slip"][:] - slide["slip"][0], slide["stopped"][:]
    row, point = np.unravel_index(np.argmax(np.abs(slip)), slip.shape)
    if slip[row, point] == 0.0:
        yield "slip in the dynamic stage: none"
        return
    slipped = int((slip != 0.0).any(0).sum())
    yield (
        f"slip in the dynamic stage: at {slipped} of {slides.count} slip points, at most "
        f"{mm(slip[row, point])}, over node {net.node_id[slides.node[point]]} by t = {time[row]:.4g} s"
    )
    adjoining, inside = np.concatenate([slides.before, slides.after]), slides.segment >= 0
    length = np.bincount(slides.segment[inside], model.L0[inside])
    change = np.zeros((len(length), len(time)))
    np.add.at(change, slides.segment[adjoining], np.concatenate([-slip.T, slip.T]))
    share = np.abs(change).max(1) / length
    worst = int(np.argmax(share))
    if share[worst] > CHANGED:
        name = model.element_name(int(adjoining[slides.segment[adjoining] == worst][0]))
        yield messages.SEGMENT_CHANGED(element=name, share=share[worst], limit=CHANGED)
    if not np.isnan(stopped).all():
        first = int(np.nanargmin(stopped))
        node = net.node_id[slides.node[first]]
        yield messages.CABLE_RAN_OUT(
            time=stopped[first], node=node, count=int((~np.isnan(stopped)).sum()), share=MIN_SEGMENT_SHARE
        )
