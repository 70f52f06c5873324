"""What members gave over what was drawn for them, with rank correlations."""

import numpy as np

from netfall.plots.canvas import SMALL, charts, heading, unit_of
from netfall.study.answers.correlation import drawn_inputs, responses, spearman
from netfall.study.answers.read import Study, unit_of_column

MOST_INPUTS = 6  # columns of the picture


def inputs(study: Study):
    """A column for each input that was drawn, a row for each response: a dot for each member."""
    names, given = drawn_inputs(study)[:MOST_INPUTS], responses(study)
    size = 2.2 + 3.2 * len(names), 1.0 + 2.3 * len(given)
    figure, panels = charts(len(given), len(names), *size, sharex="col", sharey="row")
    for j, name in enumerate(names):
        x, label = _scaled(name, study.members[name].astype(float), name)
        for i, what in enumerate(given):
            y, of = _scaled(what, given[what], what.replace("_", " "))
            _draw(panels[i, j], x, y)
            if j == 0:
                panels[i, j].set_ylabel(of)
        panels[-1, j].set_xlabel(label)
    heading(figure, study.title, ": what was drawn, and what came of it (grey: within what chance gives)")
    return figure


def _draw(axes, x: np.ndarray, y: np.ndarray) -> None:
    """Dots, and the correlation of their ranks, grey where chance gives as much."""
    axes.plot(x, y, "o", ms=2.5, alpha=0.5, mew=0, color="C0")
    rho, n = spearman(x, y)
    if np.isfinite(rho):
        strong = abs(rho) * np.sqrt(n - 1) > 1.96
        text = f"rank correlation {rho:+.2f}, n = {n}"
        axes.set_title(text, fontsize=SMALL, color="k" if strong else "0.6", loc="right")


def _scaled(name: str, values: np.ndarray, words: str) -> tuple[np.ndarray, str]:
    """Values of a column in a unit that keeps numbers readable, and words for them with that unit."""
    unit = unit_of_column(name)
    if unit not in ("N", "Pa", "N/m2"):
        return values, f"{words} [{unit}]" if unit else words
    factor, named = unit_of(np.nanmax(np.abs(values)), unit)
    return factor * values, f"{words} [{named}]"
