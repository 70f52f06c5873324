"""Pictures of the roof in plan, coloured by how often each element breaks first, and breaks at all."""

import numpy as np

from netfall.post.plots.canvas import set_figure_title
from netfall.post.plots.study.parts import draw_values, roof_panels
from netfall.study.answers.read import Study


def breaks(study: Study):
    """Draw two maps of how often elements break.

    Left: first to break, as a share of the samples that broke. Right: breaks at all, as a share of those that
    finished.
    """
    figure, (left, right) = roof_panels(study)
    set_figure_title(figure, study.title, ": where it breaks (grey: never; dots: supports; numbers: ids)")
    finished, broke = int(study.finished.sum()), int(study.first_breaks.sum())
    for axes, counts, total, label in (
        (left, study.first_breaks, broke, f"first to break, share of the {broke} samples that broke"),
        (right, study.breaks, finished, f"breaks at all, share of the {finished} samples that finished"),
    ):
        shares = np.where(counts > 0, counts / max(total, 1), np.nan)
        draw_values(study, axes, shares, label, percent=True)
    return figure
