"""Picture of the lowest natural modes: the net in equilibrium, displaced by each, in space and in plan."""

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from netfall.core.functions import along_axes
from netfall.post.checks.reactions import held_axes
from netfall.post.plots import canvas
from netfall.results.file import result_title, roof_axes

DRAWN, COLUMNS = 6, 3  # modes drawn, and modes in a row
DRAWN_DISPLACEMENT = 0.06  # largest displacement drawn / extent of the net
STILL = 0.05  # share of the largest displacement; elements with less are not drawn displaced in space
WIDTH = 4.6  # inches; largest width and height of a panel
COLOURS = "RdBu_r"
EQUILIBRIUM_PATHS = ("initial_state/position", "form_finding/position", "net/particles")


def modes(f: h5py.File) -> Figure | None:
    """Draw the first modes over the net in grey, and each of them in plan below.

    The colour is the displacement along the axis on which the mode moves most. None without modes.
    """
    if "modes" not in f or not len(f["modes/period"]):
        return None
    x, elements = f[next(name for name in EQUILIBRIUM_PATHS if name in f)][:], f["net/elements"][:]
    if (
        "statics" in f and "initial_state" not in f
    ):  # without wind, modes refer to the end of the static steps
        x = x + f["statics/displacement"][-1]
    seen = roof_axes(f)
    flat = along_axes(x, seen)[:, :2]
    lines = elements[:: max(1, len(elements) // canvas.MAX_DRAWN)]
    shape, held = f["modes/shape"][:DRAWN], np.any(held_axes(f), 1)
    swing = DRAWN_DISPLACEMENT * float(np.ptp(x, axis=0).max())
    columns, rows = min(COLUMNS, len(shape)), -(-len(shape) // COLUMNS)
    figure = plt.figure(figsize=(columns * WIDTH, 2 * rows * WIDTH), layout="compressed")
    grid, panels = figure.add_gridspec(2 * rows, columns), []
    push = swing * (np.array([0.0, 0.0, 1.0]) if seen is None else np.abs(seen[2]))
    window = np.array([x.min(0) - push, x.max(0) + push])
    norm, width = Normalize(-1.0, 1.0), canvas.line_width(len(lines))
    for k, u in enumerate(shape):
        row, column = 2 * (k // columns), k % columns
        space = canvas.add_space_axes(figure, (grid[row, column],), window)
        plan = figure.add_subplot(grid[row + 1, column])
        canvas.set_plan(plan, flat, 1.1 * swing, seen)
        panels += [space, plan]
        axis = int((u**2).sum(0).argmax())
        component, displaced = u[:, axis][lines].mean(1), (x + swing * u)[lines]
        canvas.add_lines(space, x[lines], colors=canvas.NOTHING, linewidths=0.5)
        is_moved = np.abs(u[lines]).max((1, 2)) > STILL  # unmoved elements would hide the net in white
        canvas.add_coloured(space, displaced[is_moved], component[is_moved], norm, COLOURS, width)
        canvas.add_lines(plan, flat[lines], colors=canvas.NOTHING, linewidths=0.5)
        canvas.add_coloured(plan, along_axes(displaced, seen)[..., :2], component, norm, COLOURS, 1.4 * width)
        plan.set_facecolor("0.93")  # contrasts with unmoved elements, which are white
        canvas.add_support_dots(plan, flat, held)
        space.set_title(_words(f, k, "xyz"[axis]))
    label = "displacement along the axis that a title names, of the largest of a node [-]"
    canvas.add_scale(panels, norm, COLOURS, label)
    subtitle = f": lowest modes, largest displacement drawn as {swing:.3g} m"
    canvas.set_figure_title(figure, result_title(f), subtitle)
    return figure


def _words(f: h5py.File, k: int, axis: str) -> str:
    """Describe a mode: period (inf: no stiffness, nan: unstable), mass and damping; axis : of its colours."""
    period = f["modes/period"][k]
    known = {np.inf: "no stiffness"}.get(period, "not stable" if np.isnan(period) else f"{period:.4g} s")
    lines = [f"mode {k + 1}: {known}, colour: along {axis}"]
    if "modes/effective_mass" in f:
        share = " / ".join(f"{100.0 * part:.3g}" for part in f["modes/effective_mass"][k].round(6))
        lines.append(f"effective mass {share} % (x / y / z)")
    if "modes/damping_ratio" in f and np.isfinite(f["modes/damping_ratio"][k]):
        lines.append(f"damped by {100.0 * f['modes/damping_ratio'][k]:.2g} % of the critical")
    return "\n".join(lines)
