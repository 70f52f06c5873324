"""Charts over time, load and length: load-displacement curve, energies, tensions, displacements, slip, wind.

A picture for which the result file has no data is None. `run.PICTURES` names the group that each needs.
"""

from typing import Any

import h5py
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from netfall.core.functions import lengths
from netfall.post.checks.nodes import FRICTION_SAFETY, slip_point_columns
from netfall.post.plots import canvas
from netfall.results.file import Frames, element_name, result_title
from netfall.results.removals import fracture_times, removal_times
from netfall.results.states import group_equilibria, start_position, start_tension, state_title

MIN_CHANGE = 1e-6  # share of the largest displacement or tension; less is the tolerance of equilibria
NEGLIGIBLE_ENERGY = 1e-12  # share of the sum of force x length; smaller energies are rounding
MOST_CURVES = 6
DOMINANT_RATIO = 5.0  # peak / median of the peaks of all curves; larger curves get a separate panel
MOST_NAMED = 10  # curves of elements that the job names
LEAST_ROWS = 10  # number of history rows before the first fracture that justifies a panel
BULK_PERCENTILES = 0.5, 99.5  # percentiles of the values that a scale shows
OUTLIER_RANGE = 1.0  # distance / range of the bulk; values further out are outside the scale
FLOOR = 1e-17  # smallest error that is drawn
LEAST_SPAN = 0.02  # smallest range of an axis / largest displacement; smaller motions would look as large
ENERGIES = (  # dataset of /history, description, line
    ("external_work", "external work", "k-"),
    ("kinetic_energy", "kinetic", "C0-"),
    ("strain_energy", "strain (since t = 0)", "C1-"),
    ("plastic_dissipation", "plastic dissipation", "C3-"),
    ("damping_work", "damping", "C2-"),
    ("air_work", "damping by the air", "C8-"),
    ("band_damping_work", "damping over the band", "C5-"),
    ("slip_dissipation", "friction of slips", "C6-"),
    ("support_work", "work of supports", "C9-"),
)
ENERGY_ERRORS = (
    ("energy_balance_error", "energy balance", "C4"),
    ("balance_error_attached", "energy balance, relative to attached parts", "C3"),
    ("work_identity_error", "work identity", "C7"),
)
LABEL_DISTANCE = 0.14  # share of the width that separates two labelled times
MOST_CABLES, MOST_STATES = 2, 6  # number of drawn cables and states with slip, those with the largest slip
SLIP_UTILISATION = 1.0  # utilisation at which a clamp slips


def load_displacement(f: h5py.File) -> Figure | None:
    """Draw the displacement of the particle that moves most, and the extremes of tension, over the load.

    None if the load steps neither move nor stress the net more than the first one.
    """
    if len(f["statics/load_factor"]) < 2:
        return None
    load_factor, T, u = (f[f"statics/{name}"][:] for name in ("load_factor", "tension", "displacement"))
    if all(np.abs(a[-1] - a[0]).max() <= MIN_CHANGE * np.abs(a).max() for a in (u, T)):  # 0: permanent loads
        return None
    p = int(np.linalg.norm(u[-1] - u[0], axis=1).argmax())
    k = int(np.abs(u[-1, p] - u[0, p]).argmax())
    groups, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    figure, ((left, right),) = canvas.open_charts(1, 2, 10, 4.2)
    left.plot(u[:, p, k], load_factor, "o-", color="C0")
    left.set_xlabel(f"displacement along {'xyz'[k]} of node {f['net/node_id'][p]} [m]")
    left.xaxis.set_major_locator(MaxNLocator(5))
    left.xaxis.set_major_formatter("{x:.8g}")  # without an offset, which would cover the label
    left.set_ylabel("load factor [-]")
    factor, unit = canvas.unit_of(np.abs(T).max(), "N")
    for j, name in enumerate(names):
        group_tension = factor * T[:, groups == j]
        style = {"label": f"group {name or '(none)'}", "alpha": 0.5, "color": f"C{j % 10}", "lw": 1.5}
        right.fill_between(load_factor, group_tension.min(1), group_tension.max(1), **style)
    right.set(xlabel="load factor [-]", ylabel=f"tension, least to largest [{unit}]")
    right.set_ylim(bottom=min(0.0, right.get_ylim()[0]))
    canvas.add_legend_below(figure, right)
    *_, last = group_equilibria(f, "statics")
    canvas.set_figure_title(figure, result_title(f), f": {state_title(f, last)}")
    return figure


def energies(f: h5py.File) -> Figure | None:
    """Draw energies, their sum and the external work over time, and both energy errors (paper Fig. 8, 15).

    None if the energies are not known or are rounding.
    """
    h = {name: f["history"][name][:] for name in f["history"]}
    largest = max(np.nanmax(np.abs(h[name]), initial=0.0) for name in ("external_work", "kinetic_energy"))
    if not largest > NEGLIGIBLE_ENERGY * (np.abs(start_tension(f)) * f["net/unstressed_length"][:]).sum():
        return None
    # works and errors are nan with [output] energy = false
    known = [row for row in ENERGIES if row[0] in h and np.isfinite(h[row[0]]).any()]
    errors = [row for row in ENERGY_ERRORS if np.isfinite(f["history"][row[0]][:]).any()]
    total = sum(h[name] for name, *_ in known if name not in ("external_work", "support_work"))
    total = total - h.get("support_work", 0.0)
    heights = (3, 1) if errors else (1,)
    figure, panels, columns = _time_charts(f, len(heights), height_ratios=heights)
    for charts, rows in columns:
        (upper, lowest), t = charts[[0, -1]], h["time"][rows]
        for name, label, colour in errors:
            lowest.semilogy(t, np.maximum(np.abs(h[name][rows]), FLOOR), color=colour, lw=1, label=label)
        scale, unit = canvas.unit_of(max(np.abs(h[name][rows]).max() for name, *_ in known), "J")
        for name, label, style in known:
            upper.plot(t, scale * h[name][rows], style, lw=1.3, label=label)
        if errors:
            upper.plot(t, scale * total[rows], color="0.6", ls="--", lw=2.2, zorder=0, label="sum of these")
            lowest.set_ylabel("share of the energy [-]")
        upper.set_ylabel(f"energy [{unit}]")
    canvas.add_legend_below(figure, *panels[:, 0], ncols=6)
    mark_events(panels[0, -1], f)
    canvas.set_figure_title(figure, result_title(f), ": energy")
    return figure


def _time_charts(
    f: h5py.File, rows: int, **more: Any
) -> tuple[Figure, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Open charts over time, and if useful others on the left for the time before the first fracture.

    Returns the figure, all charts, and for each column its charts and the history rows (t,) that they show.
    """
    t, events = f["history/time"][:], f["events/time"][:]
    first = float(events[0]) if len(events) else 0.0  # flying fragments then determine the scales
    if np.count_nonzero(t <= first) < LEAST_ROWS or first >= 0.95 * t[-1]:
        first = 0.0
    width, columns = (11, 2) if first else (9, 1)
    figure, panels = canvas.open_charts(rows, columns, width, 7, sharex="col", **more)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    if first:
        panels[0, 0].set_title("until the first fracture")
    ends = (first, np.inf) if first else (np.inf,)
    return figure, panels, [(charts, t <= end) for charts, end in zip(panels.T, ends)]


def mark_events(axes: Axes, f: h5py.File) -> None:
    """Draw a line at each removal and at the first fracture, labelled with its time if there is room."""
    removal_time = removal_times(f)
    marks = [(t, f"first fracture {t:.3f} s", ":") for t in f["events/time"][:1]]
    marks += [(t, f"removal {t:.3f} s", "--") for t in np.unique(removal_time[~np.isnan(removal_time)])]
    low, high = axes.get_xlim()
    labelled: list[float] = []
    for t, text, style in marks:
        axes.axvline(t, color="0.5", lw=0.8, ls=style)
        if all(abs(t - other) > LABEL_DISTANCE * (high - low) for other in labelled):
            labelled.append(t)
            look: dict[str, Any] = {"fontsize": canvas.SMALL, "color": "0.4", "textcoords": "offset points"}
            axes.annotate(text, (t, 1.0), (3, 3), xycoords=axes.get_xaxis_transform(), **look)


def tensions(f: h5py.File) -> Figure:
    """Draw the axial force of the elements that the job names, or of probes and of the first to break.

    After its fracture an element has a thin line, because it swings freely (paper Fig. 13). Curves that are
    much larger than the others have a separate panel.
    """
    curves = _tension_curves(f)
    peak = np.array([np.abs(N).max() for _, N, _ in curves])
    large = peak > DOMINANT_RATIO * np.median(peak[peak > 0.0]) if peak.any() else np.zeros(len(peak), bool)
    parts = [rows for rows in (np.flatnonzero(large), np.flatnonzero(~large)) if len(rows)]
    height = 4.8 if len(parts) == 1 else 7.0
    figure, panels = canvas.open_charts(len(parts), 1, 9, height, sharex="col")
    broken, removal_time = fracture_times(f), removal_times(f)
    group = f["net/group_names"].asstr()[:][f["net/group"][:]]
    for axes, rows in zip(panels[:, 0], parts):
        factor, unit = canvas.unit_of(peak[rows].max(), "N")
        for k in rows:
            t, N, e = curves[k]
            end = np.fmin(broken[e], removal_time[e])
            note = f", {'breaks' if end == broken[e] else 'removed'} at {end:.3f} s" if end >= 0 else ""
            intact, colour = ~(t > end), f"C{k % 10}"
            label = " ".join(f"{group[e]} element {element_name(f['net'], e)}{note}".split())
            axes.plot(t[intact], factor * N[intact], lw=1, color=colour, label=label)
            axes.plot(t[~intact], factor * N[~intact], lw=0.5, color=colour, alpha=0.35)
        values = factor * np.concatenate([curves[k][1] for k in rows])
        low, high = np.percentile(values, BULK_PERCENTILES)
        margin, far = 0.08 * max(high - low, 1e-9 * abs(high)), OUTLIER_RANGE * (high - low)
        if values.max() > high + far or values.min() < low - far:
            axes.set_ylim(low - margin, high + 3 * margin)
        axes.set_ylabel(f"axial force, positive in tension [{unit}]")
    panels[-1, 0].set_xlabel("time [s]")
    mark_events(panels[0, 0], f)
    canvas.add_legend_below(figure, *panels[:, 0], ncols=3)
    canvas.set_figure_title(figure, result_title(f), ": axial forces")
    return figure


def _tension_curves(f: h5py.File) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Return times, tensions and element of each curve.

    The elements are those named in the job; otherwise elements at probes and the first to break; otherwise
    those with the largest force of their group.
    """
    h, frames, curves = f["history"], Frames(f), []
    if "element_tension" in h:
        elements = h["element"][:MOST_NAMED]
        return [(h["time"][:], h["element_tension"][:, k], e) for k, e in enumerate(elements)]
    if "probe_tension" in h and h["probe_tension"].shape[1]:
        chosen = h["probe_element"][:MOST_CURVES].tolist()
        curves = [(h["time"][:], h["probe_tension"][:, k], e) for k, e in enumerate(chosen)]
    steps, chosen = range(len(frames.times)), [e for *_, e in curves]
    elements = list(dict.fromkeys(e for e in f["events/element"][:].tolist() if e not in chosen))
    elements = elements[: max(2, MOST_CURVES - len(curves))] if len(steps) > 1 else []
    if not curves and not elements:
        elements = _most_stressed(f)
    N = np.array([frames.cell("tension", s)[elements] for s in steps])
    return curves + [(frames.times, N[:, k], e) for k, e in enumerate(elements)]


def _most_stressed(f: h5py.File) -> list[int]:
    """Return the element with the largest force in motion of each group, the largest forces first."""
    peak, group = np.fmax(f["envelope/tension_max"][:], -f["envelope/tension_min"][:]), f["net/group"][:]
    rows = np.argsort(-peak, kind="stable")
    first = np.unique(group[rows], return_index=True)[1]
    return rows[np.sort(first)][:MOST_CURVES].tolist()


def displacements(f: h5py.File) -> Figure | None:
    """Draw displacement histories of the probes (paper Fig. 14), also those before the first fracture.

    None without probes.
    """
    if "history/probe_displacement" not in f or not f["history/probe_displacement"].shape[1]:
        return None
    h, x = f["history"], f["net/particles"][:]
    t, d = h["time"][:], h["probe_displacement"][:]
    figure, panels, columns = _time_charts(f, 3)
    for charts, rows in columns:
        least = LEAST_SPAN * float(np.abs(d[rows]).max(initial=0.0))
        for k, axes in enumerate(charts):
            for j, p in enumerate(h["probe_particle"][:MOST_CURVES]):
                at = ", ".join(f"{value:.1f}" for value in x[p])
                axes.plot(t[rows], d[rows, j, k], lw=1, label=f"node {f['net/node_id'][p]} at ({at}) m")
            low, high = axes.get_ylim()
            if high - low < least:
                axes.set_ylim(0.5 * (low + high - least), 0.5 * (low + high + least))
    for k, axes in enumerate(panels[:, 0]):
        axes.set_ylabel(f"displacement {'xyz'[k]} [m]")
    mark_events(panels[0, -1], f)
    canvas.add_legend_below(figure, panels[0, 0], ncols=3)
    canvas.set_figure_title(figure, result_title(f), ": displacements")
    return figure


def slips(f: h5py.File) -> Figure:
    """Draw slip and utilisation at the slip points along cables; a ring goes once around."""
    table, cable = slip_point_columns(f), f["slide/cable"].asstr()[:]
    stages = list(dict.fromkeys(table["stage"]))
    slip, use = (
        np.abs(np.nan_to_num(table[name].reshape(len(stages), -1))) for name in ("slip", "utilisation")
    )
    row = {number: k for k, number in enumerate(f["net/node_id"][:].tolist())}
    ranked = sorted(set(cable), key=lambda name: (-slip[:, cable == name].max(), name))
    cables = ranked[:MOST_CABLES]
    states = sorted(np.lexsort((-use.max(1), -slip.max(1)))[:MOST_STATES])
    width = 5.5 * len(cables) + 2.0
    figure, panels = canvas.open_charts(2, len(cables), width, 6.4, sharex="col", sharey="row")
    for (upper, lower), name in zip(panels.T, cables):
        points = np.flatnonzero(cable == name)
        gaps = lengths(np.diff(start_position(f)[[row[node] for node in f["slide/node"][:][points]]], axis=0))
        distance = np.append(0.0, np.cumsum(gaps))
        for k in states:
            rows = k * len(cable) + points
            label = "dynamics, the largest" if stages[k] == "dynamics" else stages[k]
            upper.plot(distance, 1e3 * table["slip"][rows], ".-", lw=1.2, label=label)
            lower.plot(distance, table["utilisation"][rows], ".-", lw=1.2)
        upper.set_title(f"cable {name}")
        lower.axhline(SLIP_UTILISATION, color="0.5", lw=0.8, ls="--")
        lower.set_xlabel(f"from point to point, from node {f['slide/node'][points[0]]} [m]")
    panels[0, 0].set_ylabel("slip along the cable [mm]")
    panels[1, 0].set_ylabel(f"utilisation, friction / {FRICTION_SAFETY:g} [-]")
    canvas.add_legend_below(figure, panels[0, 0], ncols=3)
    selection = f", {len(cables)} of {len(ranked)} cables" if len(ranked) > len(cables) else ""
    canvas.set_figure_title(figure, result_title(f), f": slip over nodes{selection}")
    return figure


def wind(f: h5py.File) -> Figure | None:
    """Draw wind speeds at a few control points, or pressures at a few taps. None if they are constant."""
    g = f["wind"]
    tapped = "pressure" in g
    t, values = g["time"][:], g["pressure" if tapped else "speed"][:]
    if not np.ptp(values, axis=0).any():
        return None
    points = g["tap" if tapped else "control_point"][:]
    figure, ((axes,),) = canvas.open_charts(1, 1, 9, 4.2)
    for k in np.unique(np.linspace(0, values.shape[1] - 1, 3).astype(int)):
        position = ", ".join(f"{coordinate:.0f}" for coordinate in points[k])
        axes.plot(t, values[:, k], lw=0.9, label=f"at ({position}) m")
    if not tapped:
        axes.axhline(g["mean_speed"][:].mean(), color="0.5", lw=0.8, ls="--", label="mean of all points")
    ylabel = "pressure, positive presses [N/m2]" if tapped else "wind speed [m/s]"
    axes.set(xlabel="time [s]", ylabel=ylabel)
    canvas.add_legend_below(figure, axes)
    canvas.set_figure_title(figure, result_title(f), ": wind")
    return figure
