"""A picture of the lowest modes: the net where it rests, and displaced in each."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.plots.canvas import MOST_DRAWN, NOTHING, add_coloured, add_lines, heading, space_panels
from netfall.results.file import title_of

DRAWN = 6  # modes
SWING = 0.06  # of the net's length: the largest displacement drawn
RESTS = ("rest/position", "form_finding/position", "net/particles")


def modes(f):
    """The first modes, coloured by how far their nodes move, over the net in grey."""
    x, elements = _rest(f), f["net/elements"][:]
    lines = elements[:: max(1, len(elements) // MOST_DRAWN)]
    period, shape = f["modes/period"][:DRAWN], f["modes/shape"][:DRAWN]
    swing = SWING * float(np.ptp(x, axis=0).max())
    window = np.array([x.min(0) - [0, 0, swing], x.max(0) + [0, 0, swing]])
    figure, panels = space_panels(window, len(period), 0.3)
    for k, (axes, T, u) in enumerate(zip(panels, period, shape)):
        add_lines(axes, x[lines], colors=NOTHING, linewidths=0.5)
        moved = np.linalg.norm(u, axis=1)[lines].mean(1)
        add_coloured(axes, (x + swing * u)[lines], moved, plt.Normalize(0.0, 1.0), "viridis", 0.9)
        axes.set_title(f"mode {k + 1}: {_named(T)}{_damped(f, k)}")
    heading(figure, title_of(f), f": lowest modes, largest displacement drawn as {swing:.3g} m")
    return figure


def _rest(f) -> np.ndarray:
    """Positions (n, 3) [m] that the modes are about; after static steps without wind, where these ended."""
    x = f[next(name for name in RESTS if name in f)][:]
    return x + f["statics/displacement"][-1] if "statics" in f and "rest" not in f else x


def _named(period: float) -> str:
    if np.isinf(period):
        return "no stiffness"
    return "not stable" if np.isnan(period) else f"{period:.4g} s"


def _damped(f, k: int) -> str:
    """What the damping is of the critical, in words."""
    if "modes/damping_ratio" not in f or not np.isfinite(f["modes/damping_ratio"][k]):
        return ""
    return f", damped by {100.0 * f['modes/damping_ratio'][k]:.2g} % of the critical"
