"""Random roofs with all features, described in other base units, have the same results to the last bit.

Their unit of length is a quarter of a metre, that of time half a second, and that of mass a sixteenth of a
kilogram. These are powers of two, so nothing is rounded differently, and g is the same number. Each key, each
column and each dataset is converted by the unit that it states: a wrong unit, or a hidden constant with a
unit, is a difference. Left out are features with such constants: ice (its density), the profile of the wind
(its reference height), the intervals at which a steady wind is sampled and detached parts are sought.
"""

import csv
import io
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import hypothesis
import numpy as np
import pytest
from conftest import run_on_standing_ranks
from drawn_jobs import QUIET, SCENES, jobs

from netfall.job.keys.fields import keys_of
from netfall.job.keys.models import Group
from netfall.job.keys.schema import CASE_KEYS, LIST_KEYS, SECTIONS, ZONE_KEYS
from netfall.job.toml_text import toml_text

EXPONENTS = {"m": 2, "s": 1, "kg": 4, "N": 4, "Pa": 0, "J": 6, "W": 5, "Hz": -1, "K": 0, "degrees": 0, "1": 0}
COLUMNS = {
    **{f"{name}_{k}": unit for k in "xyz" for name, unit in (("load", "N"), ("spring", "N/m"))},
    **dict.fromkeys(("x", "y", "z", "unstressed_length"), "m"),
    **dict.fromkeys(("prestress", "breaking_load", "axial_stiffness"), "N"),
    **dict.fromkeys(("modulus", "yield_stress"), "Pa"),
    "mass": "kg",
    "area": "m2",
    "force_density": "N/m",
    "mass_per_length": "kg/m",
    "time": "s",
    "speed": "m/s",
}
WITH_CONSTANTS = r"provenance|detached|wind/|history/(attached_energy|balance_error_attached)"
AUTOMATIC = ("ramp", "duration", "time_step")  # keys whose default is not a number with a unit


def factor(unit: str) -> float:
    """The number of new units in one of the old ones."""
    total = 0
    for sign, part in zip((1, -1), unit.split("/")):
        for name, power in re.findall(r"([A-Za-z]+|1)(\d*)", part):
            total += sign * EXPONENTS[name] * int(power or 1)
    return 2.0**total


def converted(value, unit: str):
    """A value of a key; ids of nodes in lists of places are integers."""
    if isinstance(value, list):
        return [converted(each, unit) for each in value]
    return value * factor(unit) if isinstance(value, float) else value


def with_units(values: dict, keys, defaults: bool = False) -> dict:
    """Values of a section; defaults : whether those that have a unit are written out too."""
    units = {key.name: key.unit for key in keys}
    given = {key.name: key.default for key in keys if defaults and key.name not in AUTOMATIC}
    given = {name: float(value) for name, value in given.items() if units[name] and is_number(value)}
    return {name: converted(value, units.get(name, "")) for name, value in (given | values).items()}


def is_number(value) -> bool:
    """Whether a default is a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def converted_settings(settings: dict) -> dict:
    """The keys that a case sets, as "load.snow"."""
    return {name: converted(value, CASE_KEYS[name].unit) for name, value in settings.items()}


def converted_job(job: dict) -> dict:
    """A job in the new units."""
    new = {}
    for name, values in job.items():
        if name == "group":
            keys = tuple(keys_of(Group).values())
            new[name] = {group: with_units(each, keys) for group, each in values.items()}
        elif name == "case":
            new[name] = [case | {"set": converted_settings(case["set"])} for case in values]
        elif name in LIST_KEYS:
            new[name] = [with_units(each, LIST_KEYS[name]) for each in values]
        elif name in SECTIONS:
            new[name] = with_units(values, SECTIONS[name], defaults=True)
            zones = values.get("zone", {})
            if zones:
                new[name]["zone"] = {zone: with_units(each, ZONE_KEYS[name]) for zone, each in zones.items()}
        else:
            new[name] = values
    return new


def converted_table(name: str, text: str) -> str:
    """A table in the new units; a record of an earthquake in g has another interval."""
    if name.endswith(".AT2"):
        return re.sub(r"DT= (\S+)", lambda match: f"DT= {float(match[1]) * factor('s')!r}", text)
    head, *rows = csv.reader(io.StringIO(text))
    units = [COLUMNS.get(column, "") for column in head]
    if name in ("wind.csv", "pressures.csv"):
        units = ["s"] + ["m/s" if name == "wind.csv" else "Pa"] * (len(head) - 1)
    cells = ((repr(float(c) * factor(u)) if c and u else c for c, u in zip(row, units)) for row in rows)
    return "\n".join(map(",".join, [head, *cells])) + "\n"


def without_constants(job: dict) -> dict:
    """A job without the features that have constants with a unit."""
    job = {name: dict(each) if isinstance(each, dict) else each for name, each in job.items()}
    job.get("load", {}).pop("ice", None)
    if "wind" in job:
        job["wind"] |= {"profile_exponent": 0.0}
        if "file" not in job["wind"]:
            job["wind"].setdefault("time_step", job["dynamics"]["duration"] / 13.0)
        if job["wind"].get("after_fracture", "detached") == "detached":
            job["wind"]["after_fracture"] = "particle"
        if job["wind"].get("spectrum"):
            job["wind"]["spectrum"] = "davenport"
    if job["dynamics"]["time_step"] == "auto":
        job["dynamics"]["time_step"] = job["dynamics"]["duration"] / 100.0
    return job


def different(old: h5py.File, new: h5py.File) -> list[str]:
    """The datasets whose values, converted by their unit, are not equal."""
    wrong = []

    def compare(name, item):
        if (
            not isinstance(item, h5py.Dataset)
            or item.dtype.kind not in "fiu"
            or re.match(WITH_CONSTANTS, name)
        ):
            return
        values, unit = item[()], item.attrs.get("unit", "1")
        if item.dtype.kind == "f":
            values = values * factor(unit)
        if not np.array_equal(values, new[name][()], equal_nan=item.dtype.kind == "f"):
            wrong.append(f"{name} [{unit}]")

    old.visititems(compare)
    return wrong


def run(job: dict, tables: dict, folder: Path) -> int:
    """The exit code of a job, with its result in r.vtkhdf."""
    for name, text in (tables | {"job.toml": toml_text(job)}).items():
        (folder / name).write_text(text)
    line = ("run", "job.toml", "-o", "r.vtkhdf", "--quiet")
    return run_on_standing_ranks(*line, cwd=folder, code=None).returncode


@pytest.mark.parametrize("count", [16, pytest.param(300, marks=pytest.mark.long)])
def test_a_roof_in_other_base_units_has_the_same_result(count):
    """Each example has a random scene; some are refused, or have no equilibrium."""
    codes = []

    @hypothesis.settings(max_examples=count, derandomize=True, **QUIET)
    @hypothesis.given(jobs(SCENES.filter(lambda scene: scene["wind"] not in ("taps", "points"))))
    def compare(drawn):
        hypothesis.assume("unit" not in drawn.job["net"])
        job = without_constants(drawn.job)
        tables = {name: converted_table(name, text) for name, text in drawn.tables.items()}
        with TemporaryDirectory() as old, TemporaryDirectory() as new:
            code, new_code = run(job, drawn.tables, Path(old)), run(converted_job(job), tables, Path(new))
            assert code == new_code
            codes.append(code)
            if code == 0:
                with h5py.File(f"{old}/r.vtkhdf") as a, h5py.File(f"{new}/r.vtkhdf") as b:
                    assert not (wrong := different(a, b)), (wrong[:5], toml_text(job))

    compare()
    assert codes.count(0) > 0.5 * count
