"""Pictures over time and load: load-displacement curve, energies, tensions, displacements, wind."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.output.frames import Frames
from netfall.output.info import element_name
from netfall.output.plot_style import legend_below, mark_first_fracture, short_title, unit_of

MOST_CURVES = 6


def load_displacement(f):
    """Displacement of the particle that moves most, and the extremes of tension, over the load."""
    g = f["statics"]
    share, T = g["load_factor"][:], g["tension"][:]  # the first row: the permanent loads alone
    last = g["displacement"][-1]
    p = int(np.linalg.norm(last, axis=1).argmax())
    k = int(np.abs(last[p]).argmax())
    groups, names = f["net/group"][:], f["net/group_names"].asstr()[:]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    left.plot(g["displacement"][:, p, k], share, "o-", color="C0")
    left.set_xlabel(f"displacement along {'xyz'[k]} of node {f['net/node_id'][p]} [m]")
    left.set_ylabel("load factor [-]")
    left.grid(alpha=0.3)
    factor, unit = unit_of(np.abs(T).max(), "N")
    for j, name in enumerate(names):
        mine = factor * T[:, groups == j]
        label = f"group {name or '(none)'}"
        right.fill_between(share, mine.min(1), mine.max(1), alpha=0.35, color=f"C{j}", label=label)
    right.set_xlabel("load factor [-]")
    right.set_ylabel(f"tension, least to largest [{unit}]")
    right.set_ylim(bottom=min(0.0, right.get_ylim()[0]))
    right.grid(alpha=0.3)
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=4, frameon=False)
    figure.suptitle(f"{short_title(f)}: static load")
    return figure


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
    factor, unit = unit_of(max(np.abs(h[name][:]).max() for name, *_ in names), "J")
    figure, (top, below) = plt.subplots(
        2, 1, figsize=(9, 7), sharex=True, height_ratios=(3, 1), layout="constrained"
    )
    for name, label, colour, style in names:
        top.plot(t, factor * h[name][:], color=colour, ls=style, lw=1.3, label=label)
    top.plot(t, factor * total, color="0.6", ls="--", lw=2.2, zorder=0, label="sum of the four")
    top.set_ylabel(f"energy [{unit}]")
    top.grid(alpha=0.3)
    top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.04), ncols=3, frameon=False, fontsize=8)
    mark_first_fracture(top, f)
    floor = 1e-17
    below.semilogy(
        t, np.maximum(np.abs(h["balance_error"][:]), floor), color="C4", lw=1, label="physical balance"
    )
    below.semilogy(
        t, np.maximum(np.abs(h["identity_error"][:]), floor), color="C5", lw=1, label="work identity"
    )
    below.set_xlabel("time [s]")
    below.set_ylabel("share of the energy [-]")
    below.grid(alpha=0.3)
    below.legend(loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=2, frameon=False, fontsize=8)
    figure.suptitle(f"{short_title(f)}: energy")
    return figure


def tensions(f):
    """Tension histories of the probes' elements, or of the elements that break first (paper Fig. 13)."""
    figure, axes = plt.subplots(figsize=(9, 4.8), layout="constrained")
    curves = _tension_curves(f)
    factor, unit = unit_of(max(np.abs(N).max() for _, N, _ in curves), "N")
    broken = dict(zip(f["events/element"][:].tolist(), f["events/time"][:].tolist()))
    for t, N, e in curves:
        note = f", breaks at {broken[e]:.3f} s" if e in broken else ""
        axes.plot(t, factor * N, lw=1, label=f"element {element_name(f, e)}{note}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"tension [{unit}]")
    axes.grid(alpha=0.3)
    mark_first_fracture(axes, f)
    legend_below(axes, 3)
    axes.set_title(f"{short_title(f)}: tensions", pad=16)
    return figure


def _tension_curves(f) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Times, tensions and element of each curve: probes, then what breaks first, else the largest tension."""
    h, frames, curves = f["history"], Frames(f), []
    if "probe_tension" in h and h["probe_tension"].shape[1]:
        chosen = h["probe_element"][:MOST_CURVES]
        curves = [(h["time"][:], h["probe_tension"][:, k], e) for k, e in enumerate(chosen)]
    steps = range(len(frames.times))
    of_frames = lambda e: (frames.times, np.array([frames.cell("tension", s)[e] for s in steps]), e)
    first = list(dict.fromkeys(f["events/element"][:].tolist()))[: max(2, MOST_CURVES - len(curves))]
    if len(steps) > 1:
        curves += [of_frames(e) for e in first]
    if not curves:
        N = np.array([frames.cell("tension", s) for s in (0, len(steps) - 1)])
        curves = [of_frames(int(np.abs(N).max(0).argmax()))]
    return curves


def displacements(f):
    """Displacement histories of the probes (paper Fig. 14)."""
    h = f["history"]
    d, particles = h["probe_displacement"][:], h["probe_particle"][:]
    x = f["net/particles"][:]
    figure, axes = plt.subplots(3, 1, figsize=(9, 7), sharex=True, layout="constrained")
    name = lambda p: f"node {f['net/node_id'][p]} at ({x[p, 0]:.1f}, {x[p, 1]:.1f}) m"
    for k, axis in enumerate(axes):
        for j, p in enumerate(particles[:MOST_CURVES]):
            axis.plot(h["time"][:], d[:, j, k], lw=1, label=name(p))
        axis.set_ylabel(f"displacement {'xyz'[k]} [m]")
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    mark_first_fracture(axes[0], f)
    axes[-1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3, frameon=False, fontsize=8)
    figure.suptitle(f"{short_title(f)}: displacements")
    return figure


def wind(f):
    """Wind speeds at a few control points, or pressures at a few taps."""
    g = f["wind"]
    tapped = "pressure" in g
    t, values = g["time"][:], g["pressure" if tapped else "speed"][:]
    points = g["tap" if tapped else "control_point"][:]
    figure, axes = plt.subplots(figsize=(9, 4.2), layout="constrained")
    for k in np.unique(np.linspace(0, values.shape[1] - 1, 3).astype(int)):
        place = ", ".join(f"{coordinate:.0f}" for coordinate in points[k])
        axes.plot(t, values[:, k], lw=0.9, label=f"at ({place}) m")
    if not tapped:
        axes.axhline(g["mean_speed"][:].mean(), color="0.5", lw=0.8, ls="--", label="mean")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("pressure, positive presses [N/m2]" if tapped else "wind speed [m/s]")
    axes.grid(alpha=0.3)
    legend_below(axes)
    axes.set_title(f"{short_title(f)}: wind", pad=16)
    return figure
