"""Pictures from a result file (matplotlib, no display needed). Reads the file alone, never the solver.

Which pictures come depends on what the file holds: the form (paper Fig. 6, 10), the load-displacement curve
(Fig. 6), stages of the collapse (Fig. 7, 11), energies (Fig. 8, 15), tensions and displacements of the probes
(Fig. 13, 14), wind.
"""

from pathlib import Path

import h5py
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.output.frames import Frames
from netfall.output.info import open_result, title_of

STAGES = 6  # pictures of the collapse
MOST_DRAWN = 60_000  # elements in a picture; of larger nets every k-th is drawn
MOST_CURVES = 6
LONGEST_TITLE = 90  # characters


def plot_all(result: Path, folder: Path) -> list[Path]:
    """Write every picture that the result file has data for; their paths.

    Raises InputError for a wrong file.
    """
    with open_result(result) as f:
        folder.mkdir(parents=True, exist_ok=True)
        pictures = [
            ("form", form, "form_finding" in f),
            ("load_displacement", load_displacement, "statics" in f),
            ("collapse", collapse, "history" in f),
            ("energies", energies, "history" in f),
            ("tensions", tensions, "history" in f),
            ("displacements", displacements, "history" in f and len(f["history/probe_displacement"][0])),
            ("wind", wind, "wind" in f),
        ]
        written = []
        for name, draw, there in pictures:
            if there:
                figure = draw(f)
                path = folder / f"{result.stem}_{name}.png"
                figure.savefig(path, dpi=130)
                plt.close(figure)
                written.append(path)
    return written


def _title(f: h5py.File) -> str:
    """The title, cut to what fits above a picture."""
    title = " ".join(title_of(f).split())
    return title if len(title) <= LONGEST_TITLE else title[: LONGEST_TITLE - 3] + "..."


def _unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of a unit that keeps numbers readable: N, kN, MN."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if largest >= 2 * factor:
            return 1 / factor, prefix + unit
    return 1.0, unit


def _space(figure, place, points):
    """Axes in space with equal scales around the points (n, 3), labelled in metres."""
    axes = figure.add_subplot(*place, projection="3d")
    low, high = points.min(0), points.max(0)
    extent = np.maximum(high - low, 0.02 * (high - low).max() + 1e-9)
    middle = 0.5 * (low + high)
    for k, limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        limits(middle[k] - 0.5 * extent[k], middle[k] + 0.5 * extent[k])
    axes.set_box_aspect(extent, zoom=1.1)
    axes.view_init(elev=28, azim=-60)
    axes.set_xlabel("x [m]", labelpad=6)
    axes.set_ylabel("y [m]", labelpad=6)
    axes.set_zlabel("z [m]", labelpad=0)
    axes.xaxis.set_major_locator(plt.MaxNLocator(5))
    axes.yaxis.set_major_locator(plt.MaxNLocator(4))
    axes.zaxis.set_major_locator(plt.MaxNLocator(3))
    axes.tick_params(labelsize=7, pad=1)
    return axes


def form(f):
    """The form that was found, its elements coloured by tension."""
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    elements = f["net/elements"][:]
    every = max(1, len(elements) // MOST_DRAWN)
    figure = plt.figure(figsize=(9, 6.2))
    axes = _space(figure, (1, 1, 1), x)
    factor, unit = _unit(np.abs(N).max(), "N")
    lines = Line3DCollection(x[elements[::every]], array=factor * N[::every], cmap="viridis", linewidths=1.4)
    if np.ptp(N) <= 1e-6 * np.abs(N).max():
        lines.set_clim(factor * N.mean() * 0.99, factor * N.mean() * 1.01)
    axes.add_collection3d(lines)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.98, bottom=0.14)
    bar = figure.colorbar(lines, cax=figure.add_axes((0.3, 0.1, 0.4, 0.025)), orientation="horizontal")
    bar.set_label(f"axial force [{unit}], {factor * N.min():.4g} to {factor * N.max():.4g}")
    figure.suptitle(
        f"{_title(f)}: form, {f['form_finding/iterations'][()]} iterations, "
        f"residual {f['form_finding/residual'][()]:.1e} of the prestress",
        fontsize=10,
    )
    return figure


def load_displacement(f):
    """Displacement of the particle that moves most, and the extremes of tension, over the load."""
    g = f["statics"]
    share = np.concatenate([[0.0], g["load_factor"][:]])
    last = g["displacement"][-1]
    p = int(np.linalg.norm(last, axis=1).argmax())
    k = int(np.abs(last[p]).argmax())
    path = np.concatenate([[0.0], g["displacement"][:, p, k]])
    T = g["tension"][:]
    start = f["form_finding/tension"][:][None] if "form_finding" in f else None
    groups, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    left.plot(path, share, "o-", color="C0")
    left.set_xlabel(f"displacement along {'xyz'[k]} of particle {p} [m]")
    left.set_ylabel("load factor [-]")
    left.grid(alpha=0.3)
    factor, unit = _unit(np.abs(T).max(), "N")
    for j, name in enumerate(names):
        mine = T[:, groups == j]
        steps = g["load_factor"][:]
        if start is not None:
            mine, steps = np.concatenate([start[:, groups == j], mine]), share
        right.fill_between(
            steps,
            factor * mine.min(1),
            factor * mine.max(1),
            alpha=0.35,
            color=f"C{j}",
            label=f"group {name or '(none)'}",
        )
    right.set_xlabel("load factor [-]")
    right.set_ylabel(f"tension, least to largest [{unit}]")
    right.set_ylim(bottom=min(0.0, right.get_ylim()[0]))
    right.grid(alpha=0.3)
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=4, frameon=False)
    figure.suptitle(f"{_title(f)}: static load")
    return figure


def stage_steps(frames: Frames, events: np.ndarray) -> list[int]:
    """Steps to show: the start, just before the first fracture, then evenly over the fractures.

    Evenly in time where there is no fracture.
    """
    last = len(frames.times) - 1
    if not len(events):
        return sorted(set(np.linspace(0, last, STAGES).astype(int).tolist()))
    after = lambda t: int(min(np.searchsorted(frames.times, t), last))
    shares = np.quantile(events, [0.0, 0.1, 0.35, 0.7])
    chosen = [0, max(0, after(events[0]) - 1)] + [after(t) for t in shares]
    steps = sorted(set(chosen))
    for extra in np.linspace(after(events[0]), last, STAGES + 2).astype(int).tolist():
        if len(steps) >= STAGES:
            break
        steps = sorted(set(steps) | {extra})
    return steps


def collapse(f):
    """Stages of the collapse: intact elements grey, slack ones pale, broken ones red."""
    frames = Frames(f)
    events = f["events/time"][:]
    steps = stage_steps(frames, events)
    start = frames.lines(0).reshape(-1, 3)
    low, high = start.min(0), start.max(0)
    reach = 0.25 * (high - low).max()
    window = np.array([low - [0, 0, 0.3 * reach], high + [0, 0, reach]])
    rows = -(-len(steps) // 2)
    figure = plt.figure(figsize=(11, 3.6 * rows + 0.7))
    every = max(1, frames.cells // MOST_DRAWN)
    styles = (("taut", "#30507a", 0.8), ("slack", "#9ab8d8", 0.6), ("broken", "#d62728", 1.1))
    for k, step in enumerate(steps):
        axes = _space(figure, (rows, 2, k + 1), window)
        lines, broken, N = (
            frames.lines(step)[::every],
            frames.cell("broken", step)[::every].astype(bool),
            frames.cell("tension", step)[::every],
        )
        inside = ((lines >= window[0] - reach) & (lines <= window[1] + reach)).all((1, 2))
        for (_, colour, width), which in zip(styles, (~broken & (N != 0), ~broken & (N == 0), broken)):
            if (which & inside).any():
                axes.add_collection3d(
                    Line3DCollection(lines[which & inside], colors=colour, linewidths=width)
                )
        count = int(frames.cell("broken", step).sum())
        away = int((~inside).sum())
        axes.set_title(
            f"t = {frames.times[step]:.2f} s: {count} broken" + (f", {away} out of view" if away else ""),
            fontsize=9,
        )
    handles = [plt.Line2D([], [], color=colour, lw=2, label=name) for name, colour, _ in styles]
    figure.legend(handles=handles, loc="lower center", ncols=3, frameon=False)
    figure.suptitle(f"{_title(f)}: {'collapse' if len(events) else 'motion'}")
    figure.subplots_adjust(
        left=0.02,
        right=0.98,
        top=1 - 0.9 / figure.get_figheight(),
        bottom=0.5 / figure.get_figheight(),
        hspace=0.12,
        wspace=0.02,
    )
    return figure


def _first_fracture(axes, f):
    events = f["events/time"][:]
    if len(events):
        axes.axvline(events[0], color="0.5", lw=0.8, ls=":")
        axes.annotate(
            f"first fracture {events[0]:.3f} s",
            (events[0], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 3),
            textcoords="offset points",
            fontsize=7,
            color="0.4",
        )


def _below(axes, ncols=4):
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=ncols, frameon=False, fontsize=8)


def energies(f):
    """Energies over time, their sum against the external work, and the two audits (paper Fig. 8, 15)."""
    h = f["history"]
    t = h["time"][:]
    names = (
        ("external_work", "external work", "k", "-"),
        ("kinetic_energy", "kinetic", "C0", "-"),
        ("strain_energy", "strain (since t = 0)", "C1", "-"),
        ("plastic_dissipation", "plastic dissipation", "C3", "-"),
        ("damping_work", "damping", "C2", "-"),
    )
    total = sum(h[name][:] for name, *_ in names[1:])
    factor, unit = _unit(max(np.abs(h[name][:]).max() for name, *_ in names), "J")
    figure, (top, below) = plt.subplots(
        2, 1, figsize=(9, 7), sharex=True, height_ratios=(3, 1), layout="constrained"
    )
    for name, label, colour, style in names:
        top.plot(t, factor * h[name][:], color=colour, ls=style, lw=1.3, label=label)
    top.plot(t, factor * total, color="0.6", ls="--", lw=2.2, zorder=0, label="sum of the four")
    top.set_ylabel(f"energy [{unit}]")
    top.grid(alpha=0.3)
    top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.04), ncols=3, frameon=False, fontsize=8)
    _first_fracture(top, f)
    floor = 1e-17
    below.semilogy(
        t, np.maximum(np.abs(h["balance_error"][:]), floor), color="C4", lw=1, label="physical balance"
    )
    below.semilogy(
        t, np.maximum(np.abs(h["identity_error"][:]), floor), color="C5", lw=1, label="work identity"
    )
    below.set_xlabel("time [s]")
    below.set_ylabel("error / external work [-]")
    below.grid(alpha=0.3)
    below.legend(loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=2, frameon=False, fontsize=8)
    figure.suptitle(f"{_title(f)}: energy")
    return figure


def tensions(f):
    """Tension histories of the probes' elements, or of the elements that break first (paper Fig. 13)."""
    figure, axes = plt.subplots(figsize=(9, 4.8), layout="constrained")
    h = f["history"]
    elements = f["net/elements"][:]
    curves = []
    if "probe_tension" in h and h["probe_tension"].shape[1]:
        chosen = h["probe_element"][:MOST_CURVES]
        curves = [(h["time"][:], h["probe_tension"][:, k], e) for k, e in enumerate(chosen)]
    frames = Frames(f)
    first = list(dict.fromkeys(f["events/element"][:].tolist()))[: max(2, MOST_CURVES - len(curves))]
    if len(frames.times) > 1:
        values = {
            e: np.array([frames.cell("tension", s)[e] for s in range(len(frames.times))]) for e in first
        }
        curves += [(frames.times, values[e], e) for e in first]
    if not curves:
        N = np.array([frames.cell("tension", s) for s in (0, len(frames.times) - 1)])
        e = int(np.abs(N).max(0).argmax())
        curves = [
            (frames.times, np.array([frames.cell("tension", s)[e] for s in range(len(frames.times))]), e)
        ]
    factor, unit = _unit(max(np.abs(c[1]).max() for c in curves), "N")
    broken = dict(zip(f["events/element"][:].tolist(), f["events/time"][:].tolist()))
    for t, N, e in curves:
        a, b = elements[e]
        note = f", breaks at {broken[e]:.3f} s" if e in broken else ""
        axes.plot(t, factor * N, lw=1, label=f"element {e} ({a}-{b}){note}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"tension [{unit}]")
    axes.grid(alpha=0.3)
    _first_fracture(axes, f)
    _below(axes, 3)
    axes.set_title(f"{_title(f)}: tensions", pad=16)
    return figure


def displacements(f):
    """Displacement histories of the probes (paper Fig. 14)."""
    h = f["history"]
    d, particles = h["probe_displacement"][:], h["probe_particle"][:]
    x = f["net/particles"][:]
    figure, axes = plt.subplots(3, 1, figsize=(9, 7), sharex=True, layout="constrained")
    for k, axis in enumerate(axes):
        for j, p in enumerate(particles[:MOST_CURVES]):
            axis.plot(
                h["time"][:], d[:, j, k], lw=1, label=f"particle {p} at ({x[p, 0]:.1f}, {x[p, 1]:.1f}) m"
            )
        axis.set_ylabel(f"displacement {'xyz'[k]} [m]")
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    _first_fracture(axes[0], f)
    axes[-1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3, frameon=False, fontsize=8)
    figure.suptitle(f"{_title(f)}: displacements")
    return figure


def wind(f):
    """Wind speeds at a few control points, and their spectrum."""
    g = f["wind"]
    t, u, points = g["time"][:], g["speed"][:], g["control_point"][:]
    figure, axes = plt.subplots(figsize=(9, 4.2), layout="constrained")
    for k in np.unique(np.linspace(0, u.shape[1] - 1, 3).astype(int)):
        axes.plot(
            t, u[:, k], lw=0.9, label=f"at ({points[k, 0]:.0f}, {points[k, 1]:.0f}, {points[k, 2]:.0f}) m"
        )
    axes.axhline(g["mean_speed"][:].mean(), color="0.5", lw=0.8, ls="--", label="mean")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("wind speed [m/s]")
    axes.grid(alpha=0.3)
    _below(axes)
    axes.set_title(f"{_title(f)}: wind", pad=16)
    return figure
