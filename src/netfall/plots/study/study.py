"""Pictures and the table of a study file: which come depends on what it holds. No MPI, no solver."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from netfall.plots.canvas import save
from netfall.plots.study.breaks import breaks
from netfall.plots.study.fragility import fragility
from netfall.plots.study.inputs import inputs
from netfall.plots.study.losses import loss_chart, loss_map
from netfall.plots.study.spread import spread
from netfall.study.answers.correlation import drawn_inputs, responses
from netfall.study.answers.losses import elements_lost, losses_of
from netfall.study.answers.read import RESULTS, Study, read_study, with_unit
from netfall.write.locks import whole


def pictures_of(study: Study) -> dict[str, Callable]:
    """The pictures that a study has data for, by name: what draws each from the study."""
    losses = losses_of(study)
    broke = bool(study.breaks.any())
    pictures = [
        ("fragility", fragility, bool(study.fragility)),
        ("breaks", breaks, broke),
        ("spread", spread, broke),
        ("loss_map", loss_map, losses is not None and (elements_lost(study, losses) >= 0).any()),
        ("losses", loss_chart, losses is not None),
        ("inputs", inputs, bool(drawn_inputs(study)) and bool(responses(study))),
    ]
    return {name: draw for name, draw, there in pictures if there}


def plot_study(path: Path, folder: Path) -> list[Path]:
    """Write every picture that the study has data for, and the members as a table; their paths."""
    study = read_study(path)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, draw in pictures_of(study).items():
        written.append(save(draw(study), folder / f"{study.name}_{name}.png"))
    written.append(folder / f"{study.name}_members.csv")
    with whole(written[-1]) as place:
        write_members(study, place)
    return written


def write_members(study: Study, path: Path) -> None:
    """Write /members as a table: units in the first line, then names, then a row for each; nan: empty."""
    names = [*(n for n in study.members if n not in RESULTS), *(n for n in RESULTS if n in study.members)]
    columns = [study.members[name] for name in names]
    with open(path, "w", newline="", encoding="utf-8") as file:
        file.write(f"# {', '.join(with_unit(name) for name in names)}; elements are ids of the tables\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow(names)
        for k in range(len(columns[0])):
            table.writerow([_cell(column[k]) for column in columns])


def _cell(value):
    """A value as text that gives the same number when read back; nan: nothing."""
    if isinstance(value, str):
        return value
    number = value.item() if isinstance(value, np.generic) else value
    return "" if number != number else repr(number)
