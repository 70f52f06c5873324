"""Axial forces at the ends of elements, for checks and studies.

The computed force of an element is that of its middle, because half of its weight and half of its line
load act at each end. The part of this half along the element adds to the force at one end:

N_start, N_end = N +- L0 / 2 q t        q: weight of element and ice, and line load, per unstressed length

In a form a subdivided bar has one force, and its load at its two ends: there L0 is that of the whole bar.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.geometry.net import GRAVITY
from netfall.geometry.slender import ICE_DENSITY
from netfall.job.keys.entries import action_factor
from netfall.job.keys.models import Load

FORM, PERMANENT, STAGES, CASES = "form_finding", "permanent", "stages", "cases"  # groups of a result file


def start_weights(
    job: Any,
    ends: np.ndarray,
    L0: np.ndarray,
    L0_in_form: np.ndarray,
    own: np.ndarray,
    diameter: np.ndarray | None,
    line_loads: dict[str, np.ndarray],
) -> Callable[[str, np.ndarray, float], np.ndarray]:
    """Return a function for what N_start exceeds N by, (m,) [N]; N_end is as much below N.

    Its arguments are a state's group, its nodes (n, 3) [m], and the share of its live loads that acts.

    job : sections of a `Job`; ends : (m, 2) nodes; L0, L0_in_form : (m,) [m], unstressed
    own : (m,) [N/m], self weight; diameter : (m,) [m], 0 or None: without ice; line_loads : (m, 3) [N/m] of
    each table of loads
    """
    diameter = np.zeros(len(own)) if diameter is None else diameter

    def at_start(place: str, x: np.ndarray, live: float) -> np.ndarray:
        own_factor, layers, tables = _factors(job, place)
        w = own_factor * own
        for factor, t in layers:
            mass = ICE_DENSITY * np.pi * (diameter * t + t * t)
            w += np.where(diameter > 0.0, live * factor * GRAVITY * mass, 0.0)
        chord = x[ends[:, 1]] - x[ends[:, 0]]
        along = -w * chord[:, 2]
        for factor, name in tables:
            along += live * factor * (line_loads.get(name, np.zeros(3)) * chord).sum(1)
        half = 0.5 * (L0_in_form if place == FORM else L0)
        return half * along / np.maximum(lengths(chord), np.finfo(float).tiny)

    return at_start


def _factors(job: Any, place: str) -> tuple[float, list[Any], list[Any]]:
    """Return the factors on the loads of elements in a state.

    The factor on their weight, then factors with thicknesses [m] of ice, and with names of tables of loads
    (None: no table).
    """
    load, (kind, _, name) = job.load or Load(self_weight=False), place.partition("/")
    own, form, cases = float(load.self_weight), job.form_finding, job.cases
    if place == FORM:
        return own * (form is not None and form.loads == "permanent"), [], []
    if place == PERMANENT:
        return own, [], []
    if kind == STAGES:
        names = [stage.name for stage in job.stages]
        stages = job.stages[names.index(name) :: -1]  # the last value counts
        ice = next((stage.set["load.ice"] for stage in stages if "load.ice" in stage.set), load.ice)
        table = next((stage.load_table for stage in stages if stage.load_table), None)
        return own, [(1.0, ice)], [(1.0, load.load_table), (1.0, table)]
    ice_of = {case.name: case.set.get("load.ice", load.ice) for case in cases}
    table_of = {case.name: case.load_table for case in cases}
    combination = next((one for one in job.combinations if (kind, one.name) == (CASES, name)), None)
    if combination is None:
        name = name if kind == CASES else ""
        tables = [(1.0, load.load_table), (1.0, table_of.get(name))]
        return own, [(1.0, ice_of.get(name, load.ice))], tables
    factor = partial(action_factor, combination)
    base = factor("load") - sum(map(factor, ice_of))
    layers = [(base, load.ice), *((factor(case), t) for case, t in ice_of.items())]
    tables = [(factor("load"), load.load_table), *((factor(case), table) for case, table in table_of.items())]
    return own * factor("permanent"), layers, tables
