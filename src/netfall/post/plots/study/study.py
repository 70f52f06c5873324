"""Pictures and the table of a study file, depending on its content; without MPI and solver."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from netfall.job.csv_table import write_table
from netfall.post.plots.canvas import save
from netfall.post.plots.study.fragility import fragility, hazard
from netfall.post.plots.study.maps import breaks, loss_map, removal_chart
from netfall.post.plots.study.samples import inputs, spread
from netfall.results.locks import whole
from netfall.results.outcomes import OUTCOME_BY_NAME
from netfall.study.answers.correlation import drawn_inputs, responses
from netfall.study.answers.losses import losses_of, removal_of_element
from netfall.study.answers.read import Study, read_study, with_unit


def pictures_of(study: Study) -> dict[str, Callable[[Study], Figure]]:
    """Return the pictures that a study has data for: the drawing functions by name."""
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
    return {name: draw for name, draw, present in pictures if present}


def plot_study(path: Path, folder: Path) -> list[Path]:
    """Write every picture that the study has data for, and the table of samples; return their paths."""
    study = read_study(path)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, draw in pictures_of(study).items():
        written.append(save(draw(study), folder / f"{study.name}_{name}.png"))
    written.append(folder / f"{study.name}_samples.csv")
    with whole(written[-1]) as temporary:
        drawn_names = [name for name in study.samples if name not in OUTCOME_BY_NAME]
        names = *drawn_names, *(name for name in OUTCOME_BY_NAME if name in study.samples)
        columns = {name: study.samples[name] for name in names}
        units = ", ".join(map(with_unit, columns))
        write_table(temporary, columns, f"{units}; ..._id: of the tables, beside rows of /net")
    return written
