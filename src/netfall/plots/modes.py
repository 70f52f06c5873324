"""A picture of the lowest modes: the net where it rests, and displaced in each."""

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.plots.net import MOST_DRAWN, _space
from netfall.plots.style import short_title

DRAWN = 6  # modes
SWING = 0.06  # of the net's length: the largest displacement drawn
RESTS = ("rest/position", "form_finding/position", "net/particles")


def modes(f):
    """The first modes, coloured by how far their nodes move, over the net in grey."""
    x, elements = _rest(f), f["net/elements"][:]
    lines = elements[:: max(1, len(elements) // MOST_DRAWN)]
    period, shape = f["modes/period"][:DRAWN], f["modes/shape"][:DRAWN]
    rows = -(-len(period) // 2)
    figure = plt.figure(figsize=(11, 3.6 * rows + 0.9))
    swing = SWING * float(np.ptp(x, axis=0).max())
    window = np.array([x.min(0) - [0, 0, swing], x.max(0) + [0, 0, swing]])
    for k, (T, u) in enumerate(zip(period, shape)):
        axes = _space(figure, (rows, 2, k + 1), window)
        axes.add_collection3d(Line3DCollection(x[lines], colors="#c8c8c8", linewidths=0.5))
        moved = np.linalg.norm(u, axis=1)[lines].mean(1)
        drawn = Line3DCollection((x + swing * u)[lines], array=moved, cmap="viridis", linewidths=0.9)
        drawn.set_clim(0.0, 1.0)
        axes.add_collection3d(drawn)
        axes.set_title(f"mode {k + 1}: {_named(T)}{_damped(f, k)}", fontsize=9)
    figure.suptitle(f"{short_title(f)}: lowest modes, largest displacement drawn as {swing:.3g} m")
    height = figure.get_figheight()
    margins = {"top": 1 - 0.9 / height, "bottom": 0.3 / height, "hspace": 0.12, "wspace": 0.02}
    figure.subplots_adjust(left=0.02, right=0.98, **margins)
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
