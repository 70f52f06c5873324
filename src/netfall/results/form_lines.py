"""What form finding did to the geometry that was given, in sentences; no file is opened here."""

import numpy as np

from netfall.numerics.functions import lengths

FAR = 0.05  # of the span: a node that moved farther is told


def form_lines(given, found, free, node_id, area_given: float, area: float) -> list[str]:
    """How far the nodes moved, what became of the roof, and a note where nodes moved far.

    given, found : (n, 3) [m]; free : (n,) bool, nodes that can move on some axis; area_given, area : [m2]
    """
    moved = np.where(free, lengths(found - given), 0.0)
    if not free.any():
        return []
    most = int(np.argmax(moved))
    line = (
        f"form: nodes moved by up to {moved[most]:.4g} m (node {node_id[most]}), "
        f"{moved[free].mean():.4g} m on the mean"
    )
    if area_given > 0.0:
        line += (
            f"; roof {area_given:.1f} m2 as given, {area:.1f} m2 in the form ({area / area_given - 1.0:+.1%})"
        )
    span = float(np.ptp(given, axis=0).max())
    far = int((moved > FAR * span).sum())
    return [line] + _far(far, len(moved), span, node_id[most], moved[most]) if far else [line]


def _far(far: int, n: int, span: float, node: int, moved: float) -> list[str]:
    """A note on nodes that moved by more than FAR of the span [m]."""
    return [
        f"note: form finding moved {far} of {n} nodes by more than a twentieth of the span of {span:.4g} m, "
        f"node {node} most, by {moved:.4g} m: the form is not the geometry that was given; what is built and "
        "loaded is the form: look at it, and at supports, prestress and force densities"
    ]
