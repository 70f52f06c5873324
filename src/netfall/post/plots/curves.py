"""Pictures over time and load: load-displacement curve, energies, tensions, displacements, wind."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.post.plots.canvas import SMALL, add_legend_below, open_charts, set_figure_title, unit_of
from netfall.results.file import element_name, result_title
from netfall.results.frames import Frames
from netfall.results.losses import broken_at, lost_at
from netfall.results.states import start_tension

MIN_CHANGE = 1e-9  # share of the net's extent or of the largest force; smaller changes are solver tolerance
ROUNDING = 1e-12  # share of the sum of force x length; smaller energies are rounding
MOST_CURVES = 6
DOMINANT_RATIO = 5.0  # peak / median of the peaks of all curves; larger ones get a panel of their own
MOST_NAMED = 10  # curves of elements that the job names
LEAST_ROWS = 10  # history rows before the first fracture that justify a panel
BULK_PERCENTILES = 0.5, 99.5  # percentiles of the values that a scale shows
OUTLIER_RANGE = 1.0  # distance / range of the bulk; values further out are outside the scale
FLOOR = 1e-17  # smallest error that is drawn
LEAST_SPAN = 1e-6  # smallest range of an axis / largest displacement of the picture
ENERGY_ERRORS = (
    ("energy_balance_error", "energy balance", "C4"),
    ("balance_error_attached", "energy balance, of what attached parts stored", "C3"),
    ("work_identity_error", "work identity", "C7"),
)
LABEL_DISTANCE = 0.14  # share of the width that separates two labelled times


def has_load_path(f) -> bool:
    """Whether load steps move or stress the net more than the first one."""
    if "statics" not in f or len(f["statics/load_factor"]) < 2:
        return False
    u, N = f["statics/displacement"], f["statics/tension"][:]
    is_moved = np.abs(u[-1] - u[0]).max() > MIN_CHANGE * np.ptp(f["net/particles"][:], axis=0).max()
    return bool(is_moved or np.abs(N[-1] - N[0]).max() > MIN_CHANGE * np.abs(N).max())


def has_energies(f) -> bool:
    """Whether energies were computed and exceed the rounding of the energy in the net."""
    h = f["history"]
    largest = max(np.nanmax(np.abs(h[name][:]), initial=0.0) for name in ("external_work", "kinetic_energy"))
    return bool(largest > ROUNDING * (np.abs(start_tension(f)) * f["net/unstressed_length"][:]).sum())


def load_displacement(f):
    """Draw the displacement of the particle that moves most, and the extremes of tension, over the load."""
    g = f["statics"]
    load_factor, T = g["load_factor"][:], g["tension"][:]  # first row: permanent loads alone
    last = g["displacement"][-1]
    p = int(np.linalg.norm(last - g["displacement"][0], axis=1).argmax())
    k = int(np.abs(last[p] - g["displacement"][0, p]).argmax())
    groups, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    figure, ((left, right),) = open_charts(1, 2, 10, 4.2)
    left.plot(g["displacement"][:, p, k], load_factor, "o-", color="C0")
    left.set_xlabel(f"displacement along {'xyz'[k]} of node {f['net/node_id'][p]} [m]")
    left.xaxis.set_major_locator(plt.MaxNLocator(5))
    left.set_ylabel("load factor [-]")
    factor, unit = unit_of(np.abs(T).max(), "N")
    for j, name in enumerate(names):
        group_tension = factor * T[:, groups == j]
        style = {"label": f"group {name or '(none)'}", "alpha": 0.5, "color": f"C{j % 10}", "lw": 1.5}
        right.fill_between(load_factor, group_tension.min(1), group_tension.max(1), **style)
    right.set_xlabel("load factor [-]")
    right.set_ylabel(f"tension, least to largest [{unit}]")
    right.set_ylim(bottom=min(0.0, right.get_ylim()[0]))
    add_legend_below(figure, right)
    set_figure_title(figure, result_title(f), ": static load")
    return figure


def energies(f):
    """Draw energies, their sum and the external work over time, and both energy errors (paper Fig. 8, 15)."""
    h = f["history"]
    t = h["time"][:]
    names = (
        ("external_work", "external work", "k", "-"),
        ("kinetic_energy", "kinetic", "C0", "-"),
        ("strain_energy", "strain (since t = 0)", "C1", "-"),
        ("plastic_dissipation", "plastic dissipation", "C3", "-"),
        ("damping_work", "damping", "C2", "-"),
        ("air_work", "damping by the air", "C8", "-"),
        ("band_damping_work", "damping over the band", "C5", "-"),
        ("slip_dissipation", "friction of slips", "C6", "-"),
    )
    names = tuple(row for row in names if row[0] in h)
    total = sum(h[name][:] for name, *_ in names[1:])
    if "support_work" in h:
        names += (("support_work", "work of supports", "C9", "-"),)
        total = total - h["support_work"][:]
    first = early_panel_end(f)
    figure, panels = open_charts(
        2, 2 if first else 1, 11 if first else 9, 7, height_ratios=(3, 1), sharex="col"
    )
    for (k, column), panel in np.ndenumerate(panels):
        rows = _rows_of_column(t, first, column)
        if k:
            for name, label, colour in ENERGY_ERRORS:
                error = np.maximum(np.abs(h[name][:][rows]), FLOOR)
                panel.semilogy(t[rows], error, color=colour, lw=1, label=label)
            panel.set_xlabel("time [s]")
            continue
        scale, energy_unit = unit_of(max(np.abs(h[name][:][rows]).max() for name, *_ in names), "J")
        for name, label, colour, style in names:
            panel.plot(t[rows], scale * h[name][:][rows], color=colour, ls=style, lw=1.3, label=label)
        style_of_sum = dict(color="0.6", ls="--", lw=2.2, zorder=0, label="sum of these")
        panel.plot(t[rows], scale * total[rows], **style_of_sum)
        panel.set_ylabel(f"energy [{energy_unit}]")
    add_legend_below(figure, *panels[:, 0], ncols=6)
    _mark_events(f, panels[0], first)
    panels[1, 0].set_ylabel("share of the energy [-]")
    set_figure_title(figure, result_title(f), ": energy")
    return figure


def _rows_of_column(t: np.ndarray, first: float, column: int) -> np.ndarray:
    """Select the history rows (t,) that a column of charts shows.

    If there is a first fracture, column 0 shows the time before it and column 1 all rows.
    """
    return t <= first if first and column == 0 else np.full(len(t), True)


def _mark_events(f, panels, first: float) -> None:
    """Mark events in the last of the upper panels; title the first if it ends at the first fracture."""
    mark_events(panels[-1], f)
    if first:
        panels[0].set_title("until the first fracture")


def mark_events(axes, f) -> None:
    """Draw a line at each removal and at the first fracture, labelled with its time if there is room."""
    lost = lost_at(f)
    marks = [(t, f"first fracture {t:.3f} s", ":") for t in f["events/time"][:1]]
    marks += [(t, f"loss {t:.3f} s", "--") for t in np.unique(lost[~np.isnan(lost)])]
    low, high = axes.get_xlim()
    labelled: list[float] = []
    for t, text, style in marks:
        axes.axvline(t, color="0.5", lw=0.8, ls=style)
        if all(abs(t - other) > LABEL_DISTANCE * (high - low) for other in labelled):
            labelled.append(t)
            above = axes.get_xaxis_transform()
            text_style = {"xytext": (3, 3), "textcoords": "offset points", "fontsize": SMALL, "color": "0.4"}
            axes.annotate(text, (t, 1.0), xycoords=above, **text_style)


def tensions(f):
    """Draw tension histories of the elements that the job names, or of probes and of the first to break.

    After its fracture an element is drawn thin, since it swings loose (paper Fig. 13). Curves that dwarf the
    others have a panel of their own.
    """
    curves = _tension_curves(f)
    parts = _separate_dominant(curves)
    height = 4.8 if len(parts) == 1 else 7.0
    figure, panels = open_charts(len(parts), 1, 9, height, sharex="col")
    colour = {e: f"C{k % 10}" for k, (_, _, e) in enumerate(curves)}
    for axes, part in zip(panels[:, 0], parts):
        _draw_tensions(f, axes, part, colour)
    panels[-1, 0].set_xlabel("time [s]")
    mark_events(panels[0, 0], f)
    add_legend_below(figure, *panels[:, 0], ncols=3)
    set_figure_title(figure, result_title(f), ": tensions")
    return figure


def _separate_dominant(curves: list) -> list[list]:
    """Separate the curves that dwarf the others; one list of all if none does."""
    peak = np.array([np.abs(N).max() for _, N, _ in curves])
    large = peak > DOMINANT_RATIO * np.median(peak[peak > 0.0]) if peak.any() else np.zeros(len(peak), bool)
    parts = [[curve for curve, is_large in zip(curves, large) if is_large == size] for size in (True, False)]
    return [part for part in parts if part]


def _draw_tensions(f, axes, curves: list, colour: dict) -> None:
    """Draw curves on axes with a unit of their own; colour : by element."""
    factor, unit = unit_of(max(np.abs(N).max() for _, N, _ in curves), "N")
    broken, lost = broken_at(f), lost_at(f)
    for t, N, e in curves:
        end = np.fmin(broken[e], lost[e])
        note = f", breaks at {end:.3f} s" if end == broken[e] else f", lost at {end:.3f} s" if end > 0 else ""
        intact, label = ~(t > end), f"element {element_name(f, e)}{note}"
        axes.plot(t[intact], factor * N[intact], lw=1, color=colour[e], label=label)
        axes.plot(t[~intact], factor * N[~intact], lw=0.5, color=colour[e], alpha=0.35)
    _limit_scale(axes, factor * np.concatenate([N for _, N, _ in curves]))
    axes.set_ylabel(f"axial force, positive in tension [{unit}]")


def _limit_scale(axes, values: np.ndarray) -> None:
    """Limit the scale to nearly all values if single values are far from them."""
    low, high = np.percentile(values, BULK_PERCENTILES)
    margin = 0.08 * max(high - low, 1e-9 * abs(high))
    if values.max() > high + OUTLIER_RANGE * (high - low) or values.min() < low - OUTLIER_RANGE * (
        high - low
    ):
        axes.set_ylim(low - margin, high + 3 * margin)


def _tension_curves(f) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Return times, tensions and element of each curve.

    The elements are those that the job names; otherwise those at probes and the first to break; otherwise the
    one with the largest force.
    """
    h, frames, curves, chosen = f["history"], Frames(f), [], []
    if "element_tension" in h:
        elements = h["element"][:MOST_NAMED]
        return [(h["time"][:], h["element_tension"][:, k], e) for k, e in enumerate(elements)]
    if "probe_tension" in h and h["probe_tension"].shape[1]:
        chosen = h["probe_element"][:MOST_CURVES].tolist()
        curves = [(h["time"][:], h["probe_tension"][:, k], e) for k, e in enumerate(chosen)]
    steps = range(len(frames.times))

    def snapshot_curve(e: int) -> tuple[np.ndarray, np.ndarray, int]:
        return frames.times, np.array([frames.cell("tension", s)[e] for s in steps]), e

    broken = dict.fromkeys(e for e in f["events/element"][:].tolist() if e not in chosen)
    first = list(broken)[: max(2, MOST_CURVES - len(curves))]
    if len(steps) > 1:
        curves += [snapshot_curve(e) for e in first]
    if not curves:
        N = np.array([frames.cell("tension", s) for s in (0, len(steps) - 1)])
        curves = [snapshot_curve(int(np.abs(N).max(0).argmax()))]
    return curves


def displacements(f):
    """Draw displacement histories of the probes (paper Fig. 14), also those before the first fracture."""
    h, first = f["history"], early_panel_end(f)
    t, d, particles = h["time"][:], h["probe_displacement"][:], h["probe_particle"][:]
    x = f["net/particles"][:]
    figure, axes = open_charts(3, 2 if first else 1, 11 if first else 9, 7, sharex="col")

    def name(p: int) -> str:
        return f"node {f['net/node_id'][p]} at ({', '.join(f'{value:.1f}' for value in x[p])}) m"

    for (k, column), axis in np.ndenumerate(axes):
        rows = _rows_of_column(t, first, column)
        for j, p in enumerate(particles[:MOST_CURVES]):
            axis.plot(t[rows], d[rows, j, k], lw=1, label=name(p))
        if column == 0:
            axis.set_ylabel(f"displacement {'xyz'[k]} [m]")
        least, (low, high) = LEAST_SPAN * float(np.abs(d[rows]).max(initial=0.0)), axis.get_ylim()
        if high - low < least:  # smaller changes are rounding, not motion
            axis.set_ylim(0.5 * (low + high - least), 0.5 * (low + high + least))
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    _mark_events(f, axes[0], first)
    add_legend_below(figure, axes[0, 0], ncols=3)
    set_figure_title(figure, result_title(f), ": displacements")
    return figure


def early_panel_end(f) -> float:
    """Return the time [s] of the first fracture if a panel for the time before it is useful, or 0.

    After the fracture, flying fragments determine the scales.
    """
    events, end = f["events/time"][:], f["history/time"][-1]
    rows = np.count_nonzero(f["history/time"][:] <= events[0]) if len(events) else 0
    return float(events[0]) if rows >= LEAST_ROWS and events[0] < 0.95 * end else 0.0


def wind(f):
    """Draw wind speeds at a few control points, or pressures at a few taps."""
    g = f["wind"]
    tapped = "pressure" in g
    t, values = g["time"][:], g["pressure" if tapped else "speed"][:]
    points = g["tap" if tapped else "control_point"][:]
    figure, ((axes,),) = open_charts(1, 1, 9, 4.2)
    for k in np.unique(np.linspace(0, values.shape[1] - 1, 3).astype(int)):
        position = ", ".join(f"{coordinate:.0f}" for coordinate in points[k])
        axes.plot(t, values[:, k], lw=0.9, label=f"at ({position}) m")
    if not tapped:
        axes.axhline(g["mean_speed"][:].mean(), color="0.5", lw=0.8, ls="--", label="mean")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("pressure, positive presses [N/m2]" if tapped else "wind speed [m/s]")
    add_legend_below(figure, axes)
    set_figure_title(figure, result_title(f), ": wind")
    return figure
