"""Picture of responses over the random inputs of the samples, with rank correlations."""

import numpy as np

from netfall.post.plots.canvas import SMALL, open_charts, set_figure_title, unit_of
from netfall.study.answers.correlation import drawn_inputs, responses, spearman
from netfall.study.answers.read import Study, unit_of_column

MOST_INPUTS = 6  # columns of the picture


def inputs(study: Study):
    """Draw a column for each random input and a row for each response, with a dot for each sample."""
    names, response_values = drawn_inputs(study)[:MOST_INPUTS], responses(study)
    width, height = 2.2 + 3.2 * len(names), 1.0 + 2.3 * len(response_values)
    figure, panels = open_charts(len(response_values), len(names), width, height, sharex="col", sharey="row")
    for j, name in enumerate(names):
        x, label = _scaled(name, study.samples[name].astype(float), name)
        for i, response in enumerate(response_values):
            y, response_label = _scaled(response, response_values[response], response.replace("_", " "))
            _draw(panels[i, j], x, y)
            if j == 0:
                panels[i, j].set_ylabel(response_label)
        panels[-1, j].set_xlabel(label)
    set_figure_title(
        figure, study.title, ": what was drawn, and what came of it (grey: within what chance gives)"
    )
    return figure


def _draw(axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw dots and their rank correlation, in grey if it is not significant at 5 %."""
    axes.plot(x, y, "o", ms=2.5, alpha=0.5, mew=0, color="C0")
    rho, n = spearman(x, y)
    if np.isfinite(rho):
        significant = abs(rho) * np.sqrt(n - 1) > 1.96
        text = f"rank correlation {rho:+.2f}, n = {n}"
        axes.set_title(text, fontsize=SMALL, color="k" if significant else "0.6", loc="right")


def _scaled(name: str, values: np.ndarray, description: str) -> tuple[np.ndarray, str]:
    """Return the values of a column in a readable unit, and its description with that unit."""
    unit = unit_of_column(name)
    if unit not in ("N", "Pa", "N/m2"):
        return values, f"{description} [{unit}]" if unit else description
    factor, unit_name = unit_of(np.nanmax(np.abs(values)), unit)
    return factor * values, f"{description} [{unit_name}]"
