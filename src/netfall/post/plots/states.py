"""Pictures of equilibria: the form, the states under loads, a page for one of them, and natural modes.

A picture for which the result file has no data is None.
"""

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from netfall.core.errors import InputError
from netfall.core.functions import along_axes, lengths
from netfall.core.messages import count_of
from netfall.post import messages
from netfall.post.checks.nodes import held_axes
from netfall.post.plots import canvas, force
from netfall.results import states as results
from netfall.results.file import result_title, roof_axes
from netfall.results.states import StateView, absent

MOST_PANELS = 24  # panels of states, those of `_governing`; of more stages, every k-th and the last are drawn
DRAWN_DEFLECTION = 0.06  # largest deflection drawn / largest extent of the net
MIN_DEFLECTION = 1e-6  # largest deflection / largest extent; smaller ones are errors, drawn as they are
MAX_LABELLED_GROUPS = 16  # groups with labels


def form(f: h5py.File) -> Figure | None:
    """Draw the form, its elements coloured by axial force."""
    iterations, residual = f["form_finding/iterations"][()], f["form_finding/residual"][()]
    subtitle = f"form, iterations: {iterations}, residual {residual:.1e} of the prestress"
    return _panels(f, [next(results.equilibria(f))], subtitle)


def states(f: h5py.File) -> Figure | None:
    """Draw the equilibria under loads in space on one scale: permanent, full load, cases, mean wind.

    All panels have the same colour scale of forces and the same magnification of deflections. Of a load path
    the first and the last state are drawn. The permanent state of cases has no panel.
    """
    loaded = [
        state
        for state in results.equilibria(f)
        if not state.place.startswith("stages/")
        and state.place not in ("", results.FORM_GROUP, results.PERMANENT)
    ]
    steps = len(f["statics/load_factor"]) if "statics" in f else 0
    loaded = loaded[: min(steps, 1)] + loaded[max(steps - 1, 1) if steps else 0 :]
    left_out, x0 = len(loaded) - MOST_PANELS, results.start_position(f)
    remark = f" (those that govern most elements; {left_out} more: --case NAME)" if left_out > 0 else ""
    chosen = _governing(f, loaded) if left_out > 0 else loaded
    largest = max((float(np.nanmax(lengths(state.position() - x0))) for state in chosen), default=0.0)
    factor = max(1.0, deflection_scale(largest, float(np.ptp(x0, axis=0).max())))
    scale = f"one scale of forces in all panels, deflections from {results.start_name(f)}"
    return _panels(f, chosen, f"axial forces in equilibrium{remark}; {scale} drawn {factor:g} times", factor)


def _governing(f: h5py.File, loaded: list[StateView]) -> list[StateView]:
    """Return, in order, states without equilibrium and those with the largest forces of most elements."""
    forces = np.nan_to_num(np.abs([state.tension() for state in loaded]))
    governed = np.bincount(forces.argmax(0), minlength=len(loaded))
    governed[[results.no_equilibrium(f[state.place]) for state in loaded]] = forces.shape[1] + 1
    return [loaded[k] for k in sorted(np.argsort(-governed, kind="stable")[:MOST_PANELS])]


def stages(f: h5py.File) -> Figure | None:
    """Draw the stages of erection in space on one scale."""
    erection = [state for state in results.equilibria(f) if state.place.startswith("stages/")]
    stride = max(1, -(-len(erection) // MOST_PANELS))
    remark = f" (one in {stride} of {len(erection)}; others: --case NAME)" if stride > 1 else ""
    return _panels(f, erection[::-stride][::-1], f"axial forces in the stages of erection{remark}")


def _panels(f: h5py.File, chosen: list[StateView], subtitle: str, factor: float = 1.0) -> Figure | None:
    """Draw equilibria in space on one scale; factor : on the deflections."""
    if not chosen:
        return None
    forces, x0 = [state.tension() for state in chosen], results.start_position(f)
    positions = [x0 + factor * (state.position() - x0) for state in chosen]
    all_forces = np.concatenate(forces)
    scale = force.ForceScale.of(all_forces, np.tile(force.moving_elements(f), len(chosen)))
    elements = f["net/elements"][:]
    figure, panels = canvas.open_space_panels(np.concatenate(positions), len(chosen))
    largest = float(np.abs(all_forces).max())
    for axes, state, x, N in zip(panels, chosen, positions, forces):
        present = ~absent(f, state.place)
        shown = force.shown_forces(f, N)[present]
        force.add_by_force(axes, x[elements[present]], shown, scale, canvas.line_width(len(N)))
        force.add_supports(f, axes, x, state.place)
        if state.place != results.FORM_GROUP:
            separator = "\n" if len(chosen) > canvas.MAX_IN_TWO_COLUMNS else ": "
            axes.set_title(force_words(f, state, separator, largest))
    force.add_force_scales(panels, scale, all_forces)
    canvas.add_legend_below(figure, *panels)
    canvas.set_figure_title(figure, result_title(f), f": {subtitle}")
    return figure


def force_words(f: h5py.File, state: StateView, then: str = ": ", largest: float = 0.0) -> str:
    """Describe a state: name, separator `then`, smallest and largest force, number of slack cables.

    largest : [N], of all states of a picture, which have one unit
    """
    N, present = state.tension(), ~absent(f, state.place)
    factor, unit = canvas.unit_of(max(largest, float(np.abs(N).max())), "N")
    least, most = factor * N[present].min(), factor * N[present].max()
    return f"{results.state_title(f, state)}{then}{least:.4g} to {most:.4g} {unit}{_slack_words(f, state)}"


def _slack_words(f: h5py.File, state: StateView) -> str:
    """Return the number of slack elements of a state as text; empty if none."""
    count = results.count_slack(f, state.tension(), ~absent(f, state.place))
    return f", {count_of(count, 'element')} slack (grey)" if count else ""


def find_equilibrium(f: h5py.File, name: str) -> StateView:
    """Return the equilibrium with a name: a case, combination or stage, or initial_state, statics or form.

    Of a load path, this is the last state. Raises InputError for an unknown name.
    """
    first, groups = next(results.equilibria(f)), results.equilibrium_groups(f)
    if name == first.name:
        return first
    for group in groups:
        if name in (group, group.split("/", 1)[-1], results.group_title(f, group)):
            return list(results.group_equilibria(f, group))[-1]
    known = [first.name] * (first.place not in groups) + [group.split("/", 1)[-1] for group in groups]
    raise InputError(messages.UNKNOWN_STATE(name=name, names=", ".join(known)))


def one_state(f: h5py.File, state: StateView) -> Figure:
    """Draw a state on one page: axial forces with the extremes of each group, and deflections."""
    x0, x, N = results.start_position(f), state.position(), state.tension()
    present, displacement = ~absent(f, state.place), x - x0
    elements = f["net/elements"][:][present]
    figure, (left, right) = canvas.open_space_panels(np.concatenate([x0, x]), 2)
    scale, width = force.ForceScale.of(N, force.moving_elements(f)), canvas.line_width(len(N))
    for axes in (left, right):
        force.add_supports(f, axes, x, state.place)
    force.add_by_force(left, x[elements], force.shown_forces(f, N)[present], scale, width)
    size = np.linalg.norm(displacement, axis=1)
    largest = float(np.nanmax(size, initial=0.0))
    factor = deflection_scale(largest, float(np.ptp(x0, axis=0).max()))
    drawn = x0 + factor * displacement
    canvas.add_lines(right, x0[elements], colors=canvas.NO_VALUE_COLOUR, linewidths=0.5)
    norm, deflection = Normalize(0.0, 1e3 * largest or 1.0), 1e3 * size[elements].mean(1)
    canvas.add_coloured(right, drawn[elements], deflection, norm, "viridis", width)
    left.set_title(f"axial forces{_slack_words(f, state)}")
    right.set_title(f"deflection from {results.start_name(f)} (grey), drawn {factor:g} times")
    force.add_force_scales(left, scale, N)
    canvas.add_scale(right, norm, "viridis", "deflection [mm]")
    canvas.set_figure_title(figure, result_title(f), f": {results.state_title(f, state)}")
    _label_forces(f, left, x, N, present)
    _label_deflection(f, right, drawn, displacement, size)
    return figure


def deflection_scale(largest: float, extent: float) -> float:
    """Return the magnification of deflections, 1, 2 or 5 times a power of ten.

    largest : largest deflection [m]; extent : of the net [m]
    """
    fitting = DRAWN_DEFLECTION * extent / largest if largest > MIN_DEFLECTION * extent else 1.0
    scales = canvas.ROUND_NUMBERS
    return float(scales[max(int(np.searchsorted(scales, fitting, side="right")) - 1, 0)])


def _label_forces(f: h5py.File, axes: Axes, x: np.ndarray, N: np.ndarray, present: np.ndarray) -> None:
    """Label the largest and smallest force of each group at their elements; present : (m,) bool."""
    group, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    middle, element_of = x[f["net/elements"][:]].mean(1), dict[str, int]()
    for g in np.unique(group)[:MAX_LABELLED_GROUPS]:
        members = np.flatnonzero((group == g) & present)
        for extreme in (np.nanargmax, np.nanargmin) if len(members) else ():
            e = members[extreme(N[members])]
            factor, unit = canvas.unit_of(abs(N[e]), "N")
            text = f"{names[g]} {factor * N[e]:.4g} {unit}".strip()
            element_of.setdefault(text, e)  # all elements of a group may have the same force
    canvas.add_labels(axes, middle[list(element_of.values())], list(element_of))


def _label_deflection(
    f: h5py.File, axes: Axes, positions: np.ndarray, displacement: np.ndarray, size: np.ndarray
) -> None:
    """Label the largest deflection, and the largest ones down and up, at their nodes."""
    down, up = int(np.nanargmin(displacement[:, 2])), int(np.nanargmax(displacement[:, 2]))
    rows = [p for p in dict.fromkeys([int(np.nanargmax(size)), down, up]) if size[p] > 0.0]
    node = f["net/node_id"][:]
    vectors = [", ".join(f"{1e3 * value:.1f}" for value in displacement[p]) for p in rows]
    texts = [f"node {node[p]}: ({vector}) mm" for p, vector in zip(rows, vectors)]
    canvas.add_labels(axes, positions[rows], texts)


DRAWN, COLUMNS = 6, 3  # modes drawn, and modes in a row
DRAWN_DISPLACEMENT = 0.06  # largest displacement drawn / extent of the net
MIN_DRAWN = 0.05  # share of the largest displacement; elements with less are not drawn displaced in space
WIDTH = 4.6  # inches; largest width and height of a panel
LABEL_ROOM = 0.06  # share of the height of a panel
COLOURS = "RdBu_r"
DAMPING_RATIOS = "damping_ratio", "band_damping_ratio", "air_damping_ratio"  # datasets, whose sum is shown


def modes(f: h5py.File) -> Figure | None:
    """Draw the first modes over the net in grey, and each of them in plan below.

    The colour is the displacement along the axis on which the mode moves most. None without modes.
    """
    if not len(f["modes/period"]):
        return None
    (x, about), elements, seen = results.modes_equilibrium(f), f["net/elements"][:], roof_axes(f)
    flat = along_axes(x, seen)[:, :2]
    lines = elements[:: max(1, len(elements) // canvas.MAX_DRAWN)]
    shape, held = f["modes/shape"][:DRAWN], np.any(held_axes(f), 1)
    swing = DRAWN_DISPLACEMENT * float(np.ptp(x, axis=0).max())
    columns, rows = min(COLUMNS, len(shape)), -(-len(shape) // COLUMNS)
    figure = plt.figure(figsize=(columns * WIDTH, 2 * rows * WIDTH), layout="compressed")
    if seen is not None:  # labels below upright axes need room
        figure.set_layout_engine("compressed", hspace=LABEL_ROOM)
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
        canvas.add_lines(space, x[lines], colors=canvas.NO_VALUE_COLOUR, linewidths=0.5)
        is_moved = np.abs(u[lines]).max((1, 2)) > MIN_DRAWN  # unmoved elements would hide the net in white
        canvas.add_coloured(space, displaced[is_moved], component[is_moved], norm, COLOURS, width)
        canvas.add_lines(plan, flat[lines], colors=canvas.NO_VALUE_COLOUR, linewidths=0.5)
        canvas.add_coloured(plan, along_axes(displaced, seen)[..., :2], component, norm, COLOURS, 1.4 * width)
        plan.set_facecolor("0.93")  # contrasts with unmoved elements, which are white
        canvas.add_support_dots(plan, flat, held)
        space.set_title(_words(f, k, "xyz"[axis]))
    label = "displacement along the axis that a title names, of the largest of a node [-]"
    canvas.add_scale(panels, norm, COLOURS, label)
    subtitle = f": lowest modes {about}, largest displacement drawn as {swing:.3g} m"
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
    damping = [f["modes"][name][k] for name in DAMPING_RATIOS if name in f["modes"]]
    if damping and np.isfinite(damping).all():
        lines.append(f"damped by {100.0 * sum(damping):.2g} % of the critical")
    return "\n".join(lines)
