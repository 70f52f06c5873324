"""Axial forces at the ends of elements, for checks.

The force of an element in a result is that of its middle, because half of its weight and half of its line
load act at each end. The part of this half along the element adds to the force at one end:

N_end = N + L0 / 2 |q t|        q: weight of element and ice, and line load, per unstressed length

In a form a subdivided bar has one force, and its load at its two ends: there L0 is that of the whole bar.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.geometry.net import GRAVITY
from netfall.geometry.slender import ICE_DENSITY
from netfall.job.keys.entries import action_factor
from netfall.job.keys.models import Load
from netfall.job.validate import Validator
from netfall.results.file import read_job_tables
from netfall.results.states import FORM_GROUP, PERMANENT


def end_weights(f: h5py.File) -> Callable[[str, np.ndarray], np.ndarray]:
    """Return a function of a state's group and nodes (n, 3) [m] for what N_end exceeds N by, (m,) [N]."""
    sections = Validator("", []).sections(read_job_tables(f))
    ends, L0 = f["net/elements"][:], f["net/unstressed_length"][:]
    own = GRAVITY * f["net/mass_per_length"][:]
    diameter = f["net/diameter"][:] if "diameter" in f["net"] else np.zeros(len(own))
    record, line_load = f["provenance/net"], {}
    if "line_load" in record:
        line_load = dict(zip(record["line_load_table"].asstr()[:].tolist(), record["line_load"][:]))
    _, element, parts = np.unique(f["net/element_id"][:], return_inverse=True, return_counts=True)
    L0_in_form = L0 * np.where(f["net/bar"][:] == 1, parts[element], 1)

    def at_ends(place: str, x: np.ndarray) -> np.ndarray:
        own_factor, layers, tables = _factors(sections, place)
        w = own_factor * own
        for factor, t in layers:
            mass = ICE_DENSITY * np.pi * (diameter * t + t * t)
            w += np.where(diameter > 0.0, factor * GRAVITY * mass, 0.0)
        chord = x[ends[:, 1]] - x[ends[:, 0]]
        along = -w * chord[:, 2]
        for factor, name in tables:
            along += factor * (line_load.get(name, np.zeros(3)) * chord).sum(1)
        half = 0.5 * (L0_in_form if place == FORM_GROUP else L0)
        return np.abs(half * along) / np.maximum(lengths(chord), np.finfo(float).tiny)

    return at_ends


def _factors(sections: dict[str, Any], place: str) -> tuple[float, list[Any], list[Any]]:
    """Return the factors on the loads of elements in a state.

    The factor on their weight, then factors with thicknesses [m] of ice, and with names of tables of loads
    (None: no table).
    """
    load, (kind, _, name) = sections["load"] or Load(self_weight=False), place.partition("/")
    own, form, cases = float(load.self_weight), sections["form_finding"], sections["cases"]
    if place == FORM_GROUP:
        return own * (form is not None and form.loads == "permanent"), [], []
    if place == PERMANENT:
        return own, [], []
    if kind == "stages":
        names = [stage.name for stage in sections["stages"]]
        stages = sections["stages"][names.index(name) :: -1]  # the last value counts
        ice = next((stage.set["load.ice"] for stage in stages if "load.ice" in stage.set), load.ice)
        table = next((stage.load_table for stage in stages if stage.load_table), None)
        return own, [(1.0, ice)], [(1.0, load.load_table), (1.0, table)]
    ice_of = {case.name: case.set.get("load.ice", load.ice) for case in cases}
    table_of = {case.name: case.load_table for case in cases}
    combination = next((one for one in sections["combinations"] if (kind, one.name) == ("cases", name)), None)
    if combination is None:
        name = name if kind == "cases" else ""
        tables = [(1.0, load.load_table), (1.0, table_of.get(name))]
        return own, [(1.0, ice_of.get(name, load.ice))], tables
    factor = partial(action_factor, combination)
    base = factor("load") - sum(map(factor, ice_of))
    layers = [(base, load.ice), *((factor(case), t) for case, t in ice_of.items())]
    tables = [(factor("load"), load.load_table), *((factor(case), table) for case, table in table_of.items())]
    return own * factor("permanent"), layers, tables
