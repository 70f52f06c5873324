"""Pictures of equilibria: the form that was found, and the states under static loads, by axial force."""

import numpy as np

from netfall.plots.canvas import heading, line_width, space_panels
from netfall.plots.force import ForceScale, add_by_force, add_supports, force_bars
from netfall.results.file import title_of
from netfall.results.states import ShownState, equilibria, state_groups

MOST_PANELS = 6
BELOW = 0.9  # inches under the panels, for the scales


def form(f):
    """The form that was found, its elements coloured by axial force."""
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    scale = ForceScale.of(N)
    figure, (axes,) = space_panels(x, 1, BELOW)
    add_by_force(axes, x[f["net/elements"][:]], N, scale, line_width(len(N)))
    add_supports(f, axes, x)
    _add_bars(figure, scale, N)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.0, 0.95))
    iterations, residual = f["form_finding/iterations"][()], f["form_finding/residual"][()]
    heading(figure, title_of(f), f": form, {iterations} iterations, residual {residual:.1e} of the prestress")
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
    figure, panels = space_panels(np.concatenate(places), len(chosen), BELOW)
    bar = f["net/bar"][:].astype(bool)
    for axes, stage, x, N in zip(panels, chosen, places, forces):
        add_by_force(axes, x[f["net/elements"][:]], N, scale, line_width(len(N)))
        add_supports(f, axes, x)
        slack, factor = int(((N == 0.0) & ~bar).sum()), scale.factor
        title = f"{stage.name}: {factor * N.min():.4g} to {factor * N.max():.4g} {scale.unit}"
        axes.set_title(title + (f", {slack} slack (grey)" if slack else ""))
    _add_bars(figure, scale, everything)
    edge = len(axes.get_legend_handles_labels()[0]) > 1
    marks = "squares: supports" + ", dashed: their edge" * edge
    more = f" ({left_out} more are in the file)" if left_out else ""
    heading(figure, title_of(f), f": axial forces at rest{more}; {marks}")
    return figure


def _add_bars(figure, scale: ForceScale, N: np.ndarray) -> None:
    """The scales of the forces N (k,) [N], in the room below the panels."""
    height = figure.get_figheight()
    force_bars(figure, scale, N, 0.6 * BELOW / height, 0.14 / height)


def _loaded(f) -> tuple[list[ShownState], int]:
    """The equilibria to draw, of a load path the first and the last, and how many were left out."""
    found = list(equilibria(f))[1:]  # without the form, or the net as given
    steps = len(f["statics/load_factor"]) if "statics" in f else 0
    found = found[: min(steps, 1)] + found[max(steps - 1, 1) if steps else 0 :]
    return found[:MOST_PANELS], max(0, len(found) - MOST_PANELS)
