"""Page of a study: break frequencies in space, and the motion of a sample if its result file exists."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.post import messages
from netfall.post.page.page import Page, build_page, net_data, put, quantity_data, round_box, states_data
from netfall.post.page.states import ArrayBlock, StateSeries, drawn_part, support_points
from netfall.results.file import open_checked
from netfall.study.answers.read import Study, read_study
from netfall.study.answers.removals import removal_of_element, removals_of
from netfall.study.files import study_files


def write_study_page(path: Path, page: Path, sample: int | None) -> str:
    """Write the page of a study file, and return its description.

    sample : number of the sample; None: the sample with a result file that loses most of its roof

    Raises InputError for a study without a net, or a sample without a result file.
    """
    study = read_study(path)
    if not len(study.net["elements"]):
        raise InputError(messages.NO_COMMON_NET(path=path))
    folder = study_files(path, path, None).samples
    number = choose_sample(study, folder, sample)
    return put(page, net_page(study) if number is None else sample_page(study, folder, number))


def _sample_path(folder: Path, sample: int) -> Path:
    """Return the path of a sample's result file; folder : of the result files."""
    return folder / f"{sample:06d}.vtkhdf"


def choose_sample(study: Study, folder: Path, sample: int | None) -> int | None:
    """Return the sample to show, None: no sample has a result file."""
    if sample is not None:
        if not _sample_path(folder, sample).exists():
            raise InputError(messages.NO_SAMPLE_FILE(sample=sample, path=_sample_path(folder, sample)))
        return sample
    saved = [int(file.stem) for file in folder.glob("[0-9]*.vtkhdf") if int(file.stem) < len(study.finished)]
    lost = np.nan_to_num(study.samples["detached_area"])
    return max(sorted(saved), key=lambda k: (lost[k], study.samples["broken"][k]), default=None)


def sample_page(study: Study, folder: Path, sample: int) -> Page:
    """Assemble the page of a sample's result, with the results of the study by element."""
    with open_checked(_sample_path(folder, sample)) as f:
        if not np.array_equal(f["net/element_id"][:], study.net["element_id"]):
            raise InputError(messages.OTHER_NET(path=f.filename))
        page = build_page(f)
    page.data["title"] = f"{study.title}, sample {sample}"
    page.data["quantities"] = _choices(study, page) + page.data["quantities"]
    return replace(page, words=f"sample {sample}: {page.words}")


def net_page(study: Study) -> Page:
    """Assemble the page of a study without result files of samples: its static net."""
    x, elements, held = (study.net[name] for name in ("particles", "elements", "fixed"))
    drawn = drawn_part(x, elements, np.arange(len(elements)), np.zeros(len(elements), int))
    numbers, zero, m = ArrayBlock(), np.zeros(1, int), len(drawn.rows)
    taut, displacement = np.ones((1, m)), np.zeros((1, *drawn.start.shape))
    name, none_missing = "initial state of each sample", np.zeros(m, bool)
    marks = support_points(drawn, held.astype(bool), np.zeros(len(x), bool))
    initial = StateSeries(name, np.zeros(0), displacement, taut, None, zero, zero, none_missing, *marks)
    data = net_data(numbers, drawn, study.net["element_id"]) | {
        "title": study.title,
        "net": f"{len(x)} nodes, {len(elements)} elements; no sample was kept",
        "from": "the initial state of each sample",
        "left_out": [f"one in {drawn.every} of the elements"] * (drawn.every > 1),
        "window": round_box(np.array([x.min(0), x.max(0)])).tolist(),
        "group": numbers.add(np.zeros(m, np.int16)),
        "groups": [""],
        "strokes": [],
        "states": [states_data(numbers, initial, taut, 1.0)],
    }
    page = Page(data, numbers, drawn, f"{m} elements; no sample was kept, so there is no motion")
    data["quantities"] = _choices(study, page)
    return page


def _choices(study: Study, page: Page) -> list[dict[str, Any]]:
    """Return the results of the study by element: frequency of breaks, and effects of removals."""
    rows = [(name, "%", 100.0, shares) for name, shares in study.break_shares()]
    removals = removals_of(study)
    if removals is not None:
        row = removal_of_element(study, removals)
        failing = removals.no_equilibrium / np.bincount(removals.place)
        rows += [
            (f"{name} its removal", unit, factor, np.where(row >= 0, values[row], np.nan))
            for name, unit, factor, values in (
                ("largest tension over that before", "-", 1.0, removals.tension_ratio),
                ("largest dynamic factor after", "-", 1.0, removals.dynamic_factor),
                ("share of the roof lost after", "%", 100.0, removals.detached_area),
                ("samples without an equilibrium after", "%", 100.0, np.where(failing, failing, np.nan)),
            )
        ]
    nothing = ("no sample broke", "-", 1.0, np.full(len(study.net["elements"]), np.nan))
    choices = []
    for name, unit, factor, values in [row for row in rows if np.isfinite(row[3]).any()] or [nothing]:
        ends = None if np.isnan(values).all() else (0.0, float(np.nanmax(values)) or 1.0)
        stored = page.numbers.add(values[page.drawn.rows].astype(np.float32))
        choices.append(quantity_data(name, unit, factor, ends, values=stored))
    return choices
