"""Pictures and the table of a study file, depending on its content; without MPI and solver."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from netfall.core.messages import count_of
from netfall.job.csv_table import write_table
from netfall.post.plots import canvas
from netfall.post.plots.canvas import remove_earlier, save
from netfall.post.plots.study.fragility import fragility, hazard
from netfall.post.plots.study.maps import breaks, loss_map
from netfall.results.datasets import OUTCOME_BY_NAME
from netfall.results.locks import whole
from netfall.study.answers.read import Study, read_study, unit_of_column, with_unit
from netfall.study.answers.removals import removal_of_element, removals_of
from netfall.study.answers.statistics import (
    chosen_inputs,
    combination_codes,
    draw_codes,
    drawn_inputs,
    responses,
    spearman,
)

MOST_INPUTS = 6  # columns of the picture of inputs


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
        within += f"; {count_of(failed, 'sample')} without equilibrium: the worst, without a dot if infinite"
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
    removals = removals_of(study)
    has_breaks = bool(study.breaks.any())
    pictures = [
        ("fragility", fragility, bool(study.fragility)),
        ("hazard", hazard, bool(study.hazard) and np.isfinite(study.hazard["annual_probability"]).any()),
        ("breaks", breaks, has_breaks),
        ("loss_map", loss_map, removals is not None and (removal_of_element(study, removals) >= 0).any()),
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
