"""Pictures of equilibria: the form, the states under loads, and a page for one of them."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.core.errors import InputError
from netfall.post import messages
from netfall.post.plots import canvas
from netfall.post.plots.force import ForceScale, add_by_force, add_force_scales, add_supports, moving_elements
from netfall.post.plots.labels import add_labels
from netfall.results.file import result_title
from netfall.results.states import (
    FORM_GROUP,
    StateView,
    absent,
    equilibria,
    equilibrium_groups,
    group_equilibria,
    group_title,
    start_name,
    start_position,
    state_title,
)

MOST_PANELS = 24  # panels of states; of more stages, every k-th and the last are drawn
DRAWN_DEFLECTION = 0.06  # largest deflection drawn / largest extent of the net
MAX_LABELLED_GROUPS = 16  # groups with labels


def form(f):
    """Draw the form, its elements coloured by axial force."""
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    scale = ForceScale.of(N, moving_elements(f))
    figure, (axes,) = canvas.open_space_panels(x, 1)
    add_by_force(axes, x[f["net/elements"][:]], N, scale, canvas.line_width(len(N)))
    add_supports(f, axes, x, FORM_GROUP)
    add_force_scales(axes, scale, N)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    iterations, residual = f["form_finding/iterations"][()], f["form_finding/residual"][()]
    text = f"iterations: {iterations}, residual {residual:.1e} of the prestress"
    canvas.set_figure_title(figure, result_title(f), f": form, {text}")
    return figure


def has_states(f) -> bool:
    """Whether there is an equilibrium under loads, after all stages of erection."""
    return any(not _is_stage(name) for name in equilibrium_groups(f))


def has_stages(f) -> bool:
    """Whether there are stages of erection."""
    return "stages" in f


def _is_stage(place: str) -> bool:
    """Whether a group of the result file is a stage of erection."""
    return place.startswith("stages/")


def states(f):
    """Draw the equilibria under loads in space on one scale: permanent, full load, cases, mean wind."""
    chosen, left_out = _loaded(f)
    remark = f" ({left_out} more: --case NAME)" if left_out else ""
    return _panels(f, chosen, f"axial forces at rest{remark}")


def stages(f):
    """Draw the stages of erection in space on one scale."""
    stage_states = [state for state in equilibria(f) if _is_stage(state.place)]
    stride = -(-len(stage_states) // MOST_PANELS)
    chosen = stage_states[::-stride][::-1]
    remark = f" (one in {stride} of {len(stage_states)}; others: --case NAME)" if stride > 1 else ""
    return _panels(f, chosen, f"axial forces in the stages of erection{remark}")


def _panels(f, chosen: list[StateView], subtitle: str):
    """Draw equilibria in space on one scale."""
    forces, positions = [state.tension() for state in chosen], [state.position() for state in chosen]
    all_forces = np.concatenate(forces)
    scale = ForceScale.of(all_forces, np.tile(moving_elements(f), len(chosen)))
    elements = f["net/elements"][:]
    figure, panels = canvas.open_space_panels(np.concatenate(positions), len(chosen))
    for axes, state, x, N in zip(panels, chosen, positions, forces):
        present = ~absent(f, state.place)
        add_by_force(axes, x[elements[present]], N[present], scale, canvas.line_width(len(N)))
        add_supports(f, axes, x, state.place)
        axes.set_title(force_words(f, state, "\n" if len(chosen) > canvas.MAX_IN_TWO_COLUMNS else ": "))
    add_force_scales(panels, scale, all_forces)
    figure.legend(*panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    canvas.set_figure_title(figure, result_title(f), f": {subtitle}")
    return figure


def force_words(f, state: StateView, then: str = ": ") -> str:
    """Describe a state: name, separator `then`, smallest and largest force, number of slack cables."""
    N, present = state.tension(), ~absent(f, state.place)
    factor, unit = canvas.unit_of(np.abs(N).max(), "N")
    slack = _slack(f, state)
    text = (
        f"{state_title(f, state)}{then}{factor * N[present].min():.4g} "
        f"to {factor * N[present].max():.4g} {unit}"
    )
    return text + (f", {slack} slack (grey)" if slack else "")


def _slack(f, state: StateView) -> int:
    """Count the slack cables of a state."""
    return int(((state.tension() == 0.0) & ~f["net/bar"][:].astype(bool) & ~absent(f, state.place)).sum())


def _loaded(f) -> tuple[list[StateView], int]:
    """Return the equilibria to draw, only the first and the last of a load path, and count those left out."""
    loaded = [state for state in equilibria(f) if not _is_stage(state.place)]
    loaded = [state for state in loaded if state.name not in ("form", "as given")]
    steps = len(f["statics/load_factor"]) if "statics" in f else 0
    loaded = loaded[: min(steps, 1)] + loaded[max(steps - 1, 1) if steps else 0 :]
    return loaded[:MOST_PANELS], max(0, len(loaded) - MOST_PANELS)


def find_equilibrium(f, name: str) -> StateView:
    """Return the equilibrium with a name: a case, combination or stage, or initial_state, statics or form.

    The last state of a load path counts. Raises InputError for an unknown name.
    """
    first, groups = next(equilibria(f)), equilibrium_groups(f)
    if name == first.name:
        return first
    for group in groups:
        if name in (group, group.split("/", 1)[-1], group_title(f, group)):
            return list(group_equilibria(f, group))[-1]
    names = ", ".join(
        [first.name] * (first.place not in groups) + [group.split("/", 1)[-1] for group in groups]
    )
    raise InputError(messages.UNKNOWN_STATE(name=name, names=names))


def one_state(f, state: StateView):
    """Draw a state on one page: axial forces with the extremes of each group, and deflections."""
    x0, x, N = start_position(f), state.position(), state.tension()
    present, displacement = ~absent(f, state.place), x - x0
    elements = f["net/elements"][:][present]
    figure, (left, right) = canvas.open_space_panels(np.concatenate([x0, x]), 2)
    scale = ForceScale.of(N, moving_elements(f))
    for axes in (left, right):
        add_supports(f, axes, x, state.place)
    width = canvas.line_width(len(N))
    add_by_force(left, x[elements], N[present], scale, width)
    size = np.linalg.norm(displacement, axis=1)
    largest = float(np.nanmax(size, initial=0.0))
    factor = deflection_scale(largest, float(np.ptp(x0, axis=0).max()))
    canvas.add_lines(right, x0[elements], colors=canvas.NOTHING, linewidths=0.5)
    norm, deflection = plt.Normalize(0.0, 1e3 * largest or 1.0), 1e3 * size[elements].mean(1)
    canvas.add_coloured(right, (x0 + factor * displacement)[elements], deflection, norm, "viridis", width)
    slack = _slack(f, state)
    left.set_title(f"axial forces, {slack} slack (grey)" if slack else "axial forces")
    right.set_title(f"deflection from {start_name(f)} (grey), drawn {factor:g} times")
    add_force_scales(left, scale, N)
    canvas.add_scale(right, norm, "viridis", "deflection [mm]")
    canvas.set_figure_title(figure, result_title(f), f": {state_title(f, state)}")
    _label_forces(f, left, x, N, present)
    _label_deflection(f, right, x0 + factor * displacement, displacement, size)
    return figure


def deflection_scale(largest: float, extent: float) -> float:
    """Return the magnification of deflections, 1, 2 or 5 times a power of ten.

    largest : largest deflection [m]; extent : of the net [m]
    """
    if not largest > 0.0:
        return 1.0
    scales, magnification = (
        canvas.ROUND_NUMBERS,
        max(DRAWN_DEFLECTION * extent / largest, canvas.ROUND_NUMBERS[0]),
    )
    return float(scales[np.searchsorted(scales, magnification, side="right") - 1])


def _label_forces(f, axes, x: np.ndarray, N: np.ndarray, present: np.ndarray) -> None:
    """Label the largest and smallest force of each group at their elements; present : (m,) bool."""
    group, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    middle, texts, rows = x[f["net/elements"][:]].mean(1), [], []
    for g in np.unique(group)[:MAX_LABELLED_GROUPS]:
        members = np.flatnonzero((group == g) & present)
        if not len(members):
            continue
        for e in (members[np.nanargmax(N[members])], members[np.nanargmin(N[members])]):
            factor, unit = canvas.unit_of(abs(N[e]), "N")
            text = f"{names[g]} {factor * N[e]:.4g} {unit}".strip()
            if text not in texts:  # all elements of a group may have the same force
                rows.append(e)
                texts.append(text)
    add_labels(axes, middle[rows], texts)


def _label_deflection(f, axes, positions: np.ndarray, displacement: np.ndarray, size: np.ndarray) -> None:
    """Label the largest deflection, and the largest ones down and up, at their nodes."""
    down, up = int(np.nanargmin(displacement[:, 2])), int(np.nanargmax(displacement[:, 2]))
    rows = [int(np.nanargmax(size)), down, up]
    rows = [p for p in dict.fromkeys(rows) if size[p] > 0.0]
    node = f["net/node_id"][:]
    vectors = [", ".join(f"{1e3 * value:.1f}" for value in displacement[p]) for p in rows]
    texts = [f"node {node[p]}: ({vector}) mm" for p, vector in zip(rows, vectors)]
    add_labels(axes, positions[rows], texts)
