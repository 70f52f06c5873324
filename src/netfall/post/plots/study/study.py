"""Pictures and the table of a study file, depending on its content; without MPI and solver."""

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from netfall.core.messages import count_of
from netfall.job.csv_table import write_table
from netfall.post.plots import canvas
from netfall.post.plots.canvas import remove_earlier, save
from netfall.post.plots.study.fragility import fragility, hazard
from netfall.post.plots.study.maps import breaks, loss_map, removal_chart
from netfall.results.datasets import OUTCOME_BY_NAME
from netfall.results.locks import whole
from netfall.study.answers.losses import losses_of, removal_of_element
from netfall.study.answers.read import Study, read_study, unit_of_column, with_unit
from netfall.study.answers.samples import SPEED
from netfall.study.answers.statistics import (
    chosen_inputs,
    combination_codes,
    draw_codes,
    drawn_inputs,
    responses,
    spearman,
)

MOST_LINES = 300  # samples that are drawn
POINTS = 200  # points in time
SHOWN_FRACTURES = 0.995  # share of all fractures within the time range of the picture
MOST_INPUTS = 6  # columns of the picture of inputs


def spread(study: Study) -> Figure:
    """Draw a thin line for each sample that broke, with the median and the 5 to 95 % band.

    The lines show the broken elements over the time since the first fracture, coloured by wind speed. Of many
    samples, some are drawn, evenly chosen. A sample whose exposure has ended keeps its last count.
    """
    e = study.events
    ids, element = study.net["element_id"], e["element"]
    element = ids[element] if len(ids) else element  # a subdivided element counts as one
    _, first = np.unique(np.stack([e["sample"], element], 1), axis=0, return_index=True)  # first breaks
    first = first[study.finished[e["sample"][first]]]
    order = first[np.lexsort((e["time"][first], e["sample"][first]))]
    samples, start = np.unique(e["sample"][order], return_index=True)
    courses = [times - times[0] for times in np.split(e["time"][order], start[1:])]
    remaining = study.samples["duration"][samples] - study.samples["first_fracture"][samples]
    span = max(1.05 * np.quantile(np.concatenate(courses), SHOWN_FRACTURES), 0.05 * remaining.max(), 1e-3)
    figure, ((axes,),) = canvas.open_charts(1, 1, 9, 5.4)
    speeds = study.samples.get(SPEED)
    colours, shades = None, np.full(len(samples), "C0", object)
    if speeds is not None and len(np.unique(speeds)) > 1:
        colours = plt.cm.ScalarMappable(Normalize(speeds.min(), speeds.max()), "viridis")
        shades = colours.to_rgba(speeds[samples])
    for i in np.unique(np.linspace(0, len(courses) - 1, MOST_LINES).astype(int)):
        t = np.append(courses[i], max(remaining[i], courses[i][-1]))
        count = np.append(np.arange(1, len(t)), len(t) - 1)
        axes.plot(t, count, drawstyle="steps-post", color=shades[i], lw=0.5, alpha=0.5)
    grid = np.linspace(0.0, span, POINTS)
    counts = np.array([np.searchsorted(t, grid, side="right") for t in courses], float)
    low, middle, high = np.quantile(counts, (0.05, 0.5, 0.95), axis=0)
    label = f"5 to 95 % of {len(courses)} samples (to the end of the exposure)"
    axes.fill_between(grid, low, high, color="k", alpha=0.12, lw=0, label=label)
    axes.plot(grid, middle, color="k", lw=2.2, label="median")
    axes.set(xlim=(0, span), xlabel="time since the first fracture [s]", ylabel="elements broken")
    axes.set_ylim(bottom=0)
    if colours is not None:
        figure.colorbar(colours, ax=axes, label="mean wind speed [m/s]")
    canvas.add_legend_below(figure, axes, ncols=2)
    subtitle = f": spread of the collapse in {len(courses)} samples that broke"
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure


def inputs(study: Study) -> Figure:
    """Draw a column for each random input and a row for each response, with a dot for each sample.

    A rank correlation that is not significant at 5 % is grey.
    """
    names, outcomes = drawn_inputs(study)[:MOST_INPUTS], responses(study)
    width, height = 2.2 + 3.2 * len(names), 1.0 + 2.3 * len(outcomes)
    rows, columns = len(outcomes), len(names)
    figure, panels = canvas.open_charts(rows, columns, width, height, sharex="col", sharey="row")
    draws, combinations = draw_codes(study), [combination_codes(study, name) for name in names]
    drawn = [_scaled(name, study.samples[name].astype(float), name) for name in names]
    answers = [_scaled(name, values, name.replace("_", " ")) for name, values in outcomes.items()]
    for (i, j), axes in np.ndenumerate(panels):
        (x, xlabel), (y, ylabel) = drawn[j], answers[i]
        axes.plot(x, y, "o", ms=2.5, alpha=0.5, mew=0, color="C0")
        rho, n, significant = spearman(x, y, draws, combinations[j])
        if np.isfinite(rho):
            colour = "k" if significant else "0.6"
            text = f"rank correlation {rho:+.2f}, n = {n}"
            axes.set_title(text, fontsize=canvas.SMALL, color=colour, loc="right")
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.label_outer()
    fixed = chosen_inputs(study)
    within = f"; correlations within each {' and '.join(fixed)}" if fixed else ""
    if failed := int((study.samples["state"] == "no_equilibrium").sum()):
        within += (
            f"; {count_of(failed, 'sample')} without equilibrium as the worst, infinite ones without a dot"
        )
    subtitle = f": random inputs and outcomes (grey: not significant{within})"
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure


def _scaled(name: str, values: np.ndarray, description: str) -> tuple[np.ndarray, str]:
    """Return the values of a column in a readable unit, and its description with that unit."""
    unit, factor = unit_of_column(name), 1.0
    if unit in ("N", "Pa", "N/m2"):
        factor, unit = canvas.unit_of(np.max(np.abs(values), where=np.isfinite(values), initial=0.0), unit)
    return factor * values, f"{description} [{unit}]" if unit else description


def pictures_of(study: Study) -> dict[str, Callable[[Study], Figure] | None]:
    """Return the pictures of a study: the drawing functions by name, None without data for it."""
    losses = losses_of(study)
    has_breaks = bool(study.breaks.any())
    pictures = [
        ("fragility", fragility, bool(study.fragility)),
        ("hazard", hazard, bool(study.hazard) and np.isfinite(study.hazard["annual_probability"]).any()),
        ("breaks", breaks, has_breaks),
        ("spread", spread, bool(len(study.events["time"])) and study.finished[study.events["sample"]].any()),
        ("loss_map", loss_map, losses is not None and (removal_of_element(study, losses) >= 0).any()),
        ("losses", removal_chart, losses is not None),
        ("inputs", inputs, bool(drawn_inputs(study)) and bool(responses(study))),
    ]
    return {name: draw if present else None for name, draw, present in pictures}


def plot_study(path: Path, folder: Path) -> list[Path]:
    """Write every picture for which the study has data, and the table of samples; return their paths.

    Pictures of an earlier study of this name for which it has none are removed.
    """
    study = read_study(path)
    pictures = {folder / f"{study.name}_{name}.png": draw for name, draw in pictures_of(study).items()}
    written = [save(draw(study), picture) for picture, draw in pictures.items() if draw]
    remove_earlier(pictures.keys() - {*written})
    written.append(folder / f"{study.name}_samples.csv")
    with whole(written[-1]) as temporary:
        drawn_names = [name for name in study.samples if name not in OUTCOME_BY_NAME]
        names = *drawn_names, *(name for name in OUTCOME_BY_NAME if name in study.samples)
        columns = {name: study.samples[name] for name in names}
        units = ", ".join(map(with_unit, columns))
        write_table(temporary, columns, f"{units}; ..._id: ids of the tables, others: rows of /net")
    return written
