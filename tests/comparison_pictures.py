"""Pictures of the page on verification: `python tests/comparison_pictures.py [wind] [torn]`.

They compare netfall with the stored answers of the other programs. Also prints the values of the page's
tables. Takes minutes; needs netfall[plot].
"""

import sys
import tempfile
from pathlib import Path

import collapse_reference as torn
import matplotlib
import numpy as np
import test_validation_generators as gusts
import wind_reference as wind
from conftest import ROOT, STANDING, Workshop
from test_validation_torn import tear

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FIGURES = ROOT / "src" / "netfall" / "docs" / "pages" / "figures"
NAMES = "deviation", "gust_factor", "spectrum", "across", "load_deviation", "load_peak", "load_spectrum"
CENTRE = wind.OCTAVES * np.sqrt(2.0)


def draw_wind() -> None:
    """Draw spectra of a node and of the load, and coherence, of the three fields and of PyConTurb."""
    with np.load(wind.STORED) as f:
        theirs = {name: f[f"davenport/{name}"].mean(0) for name in NAMES}
    fields = {
        "a point at each node": ("point", gusts.NODES),
        "25 points": ("point", 25),
        "means at 25 points (default)": ("area_mean", 25),
    }
    ours = {
        label: {
            name: values.mean(0)
            for name, values in gusts.realisations(gusts.field_of(*what)[1], wind.REALISATIONS).items()
        }
        for label, what in fields.items()
    }
    for name in ("deviation", "gust_factor", "load_deviation", "load_peak"):
        print(name, round(float(theirs[name]), 4), {k: round(float(v[name]), 4) for k, v in ours.items()})
    figure, panels = plt.subplots(1, 3, figsize=(13.8, 4.0), layout="constrained")
    for axes, name, scale, title in (
        (panels[0], "spectrum", (wind.INTENSITY * wind.SPEED) ** 2, "speed at a node"),
        (panels[1], "load_spectrum", 1.0, "load of the whole roof"),
    ):
        axes.loglog(CENTRE, CENTRE * theirs[name] / scale, "k-", lw=2.5, alpha=0.4, label="PyConTurb")
        for marker, (label, values) in zip("os^", ours.items()):
            axes.loglog(CENTRE, CENTRE * values[name] / scale, marker, ms=5, mfc="none", label=label)
        axes.set(xlabel="frequency [Hz]", title=title)
    panels[0].set_ylabel("n S / variance of the speed")
    panels[1].set_ylabel("n S / (mean load)$^2$")
    panels[0].legend(fontsize=8)
    for k, cells in enumerate(wind.SEPARATIONS):
        apart = cells * wind.SIDE / wind.CELLS
        panels[2].semilogx(
            CENTRE, theirs["across"][k], f"C{k}-", lw=2.5, alpha=0.4, label=f"{apart:g} m, PyConTurb"
        )
        for marker, values in zip("os^", ours.values()):
            text = f"{apart:g} m, netfall" if marker == "o" else None
            panels[2].semilogx(CENTRE, values["across"][k], f"C{k}{marker}", ms=5, mfc="none", label=text)
    panels[2].set(xlabel="frequency [Hz]", ylabel="co-coherence across the wind", title="coherence at nodes")
    panels[2].legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.savefig(FIGURES / "compared-wind.png", dpi=110)


def draw_torn() -> None:
    """Draw fractures, nodes that hang on supports, and the strain energy left, over the load."""
    with np.load(torn.STORED) as f, tempfile.TemporaryDirectory() as folder:
        shop = Workshop(Path(folder), standing=True)
        runs = {"OpenSees": f["opensees/outcomes"], "LAMMPS": f["lammps/outcomes"]}
        for label, fragments in (("netfall, element removed", False), ("netfall, fragments", True)):
            runs[label] = np.array(
                [
                    [tear(shop, load, run, fragments=fragments)[2] for run in range(1 + torn.RUNS)]
                    for load in torn.LOADS.tolist()
                ]
            )
    draw_outcomes(runs)


def draw_outcomes(runs: dict[str, np.ndarray]) -> None:
    """Draw median and range of the outcomes (loads, 1 + runs, 5), and print them."""
    figure, panels = plt.subplots(1, 3, figsize=(12.6, 4.0), layout="constrained")
    columns = (
        (0, "broken elements", 1.0),
        (2, "share of nodes on supports", 1.0),
        (3, "kinetic energy [MJ]", 1e-6),
    )
    for j, (label, values) in enumerate(runs.items()):
        for axes, (column, what, scale) in zip(panels, columns):
            some = scale * values[:, 1:, column]
            middle = np.median(some, axis=1)
            bars = np.array([middle - some.min(1), some.max(1) - middle])
            style = dict(marker="osd^"[j], ms=5, mfc="none", ls="", capsize=2, lw=1)
            axes.errorbar(1e-3 * torn.LOADS * 1.02 ** (j - 1.5), middle, bars, label=label, **style)
            axes.set(xscale="log", xlabel="load on each node [kN]", ylabel=what)
            axes.set_xticks(1e-3 * torn.LOADS, [f"{load / 1e3:g}" for load in torn.LOADS])
            axes.minorticks_off()
        for k, load in enumerate(torn.LOADS.tolist()):
            some = values[k, 1:]
            print(
                label,
                load,
                "median",
                np.median(some, 0).round(3),
                "from",
                some.min(0).round(3),
                "to",
                some.max(0).round(3),
            )
    panels[0].legend(fontsize=8)
    figure.savefig(FIGURES / "compared-torn.png", dpi=110)


if __name__ == "__main__":
    for name in sys.argv[1:] or ("wind", "torn"):
        {"wind": draw_wind, "torn": draw_torn}[name]()
    for ranks in STANDING.values():
        ranks.stop()
