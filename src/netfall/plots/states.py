"""Pictures of equilibria: the form that was found, and the states under static loads, by axial force."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.plots.force import ForceScale, add_by_force, add_supports, force_bars
from netfall.plots.net import _space
from netfall.plots.style import short_title
from netfall.results.states import ShownState, equilibria, state_groups

MOST_PANELS = 6


def form(f):
    """The form that was found, its elements coloured by axial force."""
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    scale = ForceScale.of(N)
    figure = plt.figure(figsize=(9, 6.2))
    axes = _space(figure, (1, 1, 1), x)
    add_by_force(axes, x[f["net/elements"][:]], N, scale, _width(len(N), 1.4))
    add_supports(f, axes, x)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.98, bottom=0.14)
    force_bars(figure, scale, N, 0.1, 0.025)
    below_title = {"loc": "upper left", "bbox_to_anchor": (0.0, 0.95)}
    figure.legend(*axes.get_legend_handles_labels(), **below_title, frameon=False, fontsize=8)
    figure.suptitle(
        f"{short_title(f)}: form, {f['form_finding/iterations'][()]} iterations, "
        f"residual {f['form_finding/residual'][()]:.1e} of the prestress",
        fontsize=10,
    )
    return figure


def has_states(f) -> bool:
    """Whether there is an equilibrium under loads."""
    return bool(state_groups(f))


def states(f):
    """The equilibria under loads in space, all on one scale: permanent, at full load, cases, rest."""
    chosen, left_out = _loaded(f)
    forces = [stage.tension() for stage in chosen]
    everything = np.concatenate(forces)
    scale, places = ForceScale.of(everything), [stage.position() for stage in chosen]
    columns = min(2, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = plt.figure(figsize=(5.6 * columns + 1.0, 3.7 * rows + 1.3))
    bar = f["net/bar"][:].astype(bool)
    for k, (stage, x, N) in enumerate(zip(chosen, places, forces)):
        axes = _space(figure, (rows, columns, k + 1), np.concatenate(places))
        add_by_force(axes, x[f["net/elements"][:]], N, scale, _width(len(N), 1.2))
        add_supports(f, axes, x)
        slack, factor = int(((N == 0.0) & ~bar).sum()), scale.factor
        title = f"{stage.name}: {factor * N.min():.4g} to {factor * N.max():.4g} {scale.unit}"
        axes.set_title(title + (f", {slack} slack (grey)" if slack else ""), fontsize=9)
    height = figure.get_figheight()
    margins = {"top": 1 - 0.75 / height, "bottom": 0.95 / height, "hspace": 0.15, "wspace": 0.02}
    figure.subplots_adjust(left=0.02, right=0.98, **margins)
    force_bars(figure, scale, everything, 0.55 / height, 0.13 / height)
    edge = len(axes.get_legend_handles_labels()[0]) > 1
    marks = "squares: supports" + ", dashed: their edge" * edge
    more = f" ({left_out} more are in the file)" if left_out else ""
    figure.suptitle(f"{short_title(f)}: axial forces at rest{more}; {marks}", fontsize=10)
    return figure


def _loaded(f) -> tuple[list[ShownState], int]:
    """The equilibria to draw, of a load path the first and the last, and how many were left out."""
    found = list(equilibria(f))[1:]  # without the form, or the net as given
    steps = len(f["statics/load_factor"]) if "statics" in f else 0
    found = found[: min(steps, 1)] + found[max(steps - 1, 1) if steps else 0 :]
    return found[:MOST_PANELS], max(0, len(found) - MOST_PANELS)


def _width(elements: int, most: float) -> float:
    """Width of lines that leaves as many elements apart."""
    return float(np.clip(50.0 / np.sqrt(elements), 0.4, most))
