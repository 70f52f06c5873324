"""Sections and lists of a job file by name, rules between their keys, and their JSON schema for editors."""

import json
from typing import Any, Literal

from pydantic import Field, create_model

from netfall.job.keys import entries, models, net
from netfall.job.keys.fields import Key, Section, keys_of

EXCLUSIVE_KEYS = (
    ("modulus", "axial_stiffness"),
    ("density", "mass_per_length"),
    ("prestress", "horizontal_force"),
)  # at most one of each pair is given in one place
REQUIRED_ALTERNATIVES = {  # for each required key, the keys of which one must be given, unless a type is
    "modulus": ("modulus", "axial_stiffness"),
    "area": ("area", "axial_stiffness"),
    "density": ("density", "mass_per_length"),
}
MODELS: dict[str, type[Section]] = {
    "net": net.Net,
    "cable": models.Cable,
    "form_finding": models.FormFinding,
    "load": models.Load,
    "roof": models.Roof,
    "wind": models.Wind,
    "dynamics": models.Dynamics,
    "limits": models.Limits,
    "output": models.Output,
    "modes": models.Modes,
}


def _by_name(*named: type[Section]) -> dict[str, type[Section]]:
    """Return models by the names of their classes in lower case."""
    return {model.__name__.lower(): model for model in named}


GENERATORS = _by_name(net.Saddle, net.Stadium, net.Ring, net.Wheel, net.Dome)  # dimensions, [net.saddle]
LIST_MODELS = _by_name(
    *(entries.Zone, entries.Case, entries.Combination, entries.Motion, entries.Slide, entries.Remove),
    *(entries.Target, entries.Stage),
)


def _rows(by_name: dict[str, type[Section]]) -> dict[str, tuple[Key, ...]]:
    """Return the keys of each model."""
    return {name: tuple(keys_of(model).values()) for name, model in by_name.items()}


SECTIONS = _rows({"": models.Top, **MODELS})
GENERATOR_KEYS = {name: tuple(keys_of(model)) for name, model in GENERATORS.items()}
_DIMENSIONS = {f"net.{name}": model for name, model in GENERATORS.items()}
# Keys of every table of a job file by its name, in the order of the pages.
TABLES = _rows({"": models.Top, "net": net.Net, **_DIMENSIONS, **MODELS})
LIST_KEYS = _rows(LIST_MODELS)
ZONE_KEYS = _rows({"load": models.LoadZone, "wind": models.WindZone})  # of [load.zone.NAME], [wind.zone.NAME]
CASE_KEYS = entries.settable_keys()  # keys that a case can set
STAGE_KEYS = {name: key for name, key in CASE_KEYS.items() if name.startswith("load.")}  # the same of a stage
REQUIRED_SECTIONS = ("net", "cable")
BREAKING_KEYS = {"fracture_strain", "breaking_load"}  # of [cable] and of groups


def key_of(name: str) -> Key | None:
    """Return the key of a dotted name, None if it is unknown.

    Examples: "wind.speed", "net.saddle.side", "load.zone.NAME.snow", "group.NAME.area".
    """
    section, _, key = name.rpartition(".")
    top = section.partition(".")[0]
    if top == "group":
        section = "cable"
    elif section.startswith(("load.zone.", "wind.zone.")):
        section = top
    return next((each for each in TABLES.get(section, ()) if each.name == key), None)


CURVES = keys_of(models.Cable)["buckling_curve"].choices  # of EN 1993-1-1


def job_schema() -> dict[str, Any]:
    """Return the schema: each section with type, unit, range, default and meaning of its keys."""
    fields: dict[str, Any] = {}
    for name, model in MODELS.items():
        fields[name] = (model, ... if name in REQUIRED_SECTIONS else None)
    for name, model in LIST_MODELS.items():
        fields[name] = (list[model], Field([], description=f"entries [[{name}]]"))  # type: ignore[valid-type]
    groups = dict[str, models.Group]  # type: ignore[valid-type]
    fields["group"] = (groups, Field({}, description="properties of groups, by name or pattern"))
    fields["combinations"] = (
        dict[str, dict[str, float | Literal["ULS", "SLS"]]],
        Field({}, description="combinations in a table: kind, and factors of actions and cases"),
    )
    job = create_model("Job", __base__=models.Top, __doc__="Job file of netfall.", **fields)
    schema: dict[str, Any] = _with_units(job.model_json_schema())
    return schema


def schema_text() -> str:
    """Return the schema as the text of a file."""
    return json.dumps(job_schema(), indent=1) + "\n"


def _with_units(node: Any) -> Any:
    """Return a schema in which each number with a unit may be a text, without titles and without null."""
    if isinstance(node, list):
        return [_with_units(item) for item in node if item != {"type": "null"}]
    if not isinstance(node, dict):
        return node
    unit = node["unit"] if isinstance(node.get("unit"), str) else ""
    dropped = {name for name in ("unit", "title") if isinstance(node.get(name), str)}
    if node.get("default", "") is None:
        dropped.add("default")
    result = {name: _with_units(item) for name, item in node.items() if name not in dropped}
    if len(result.get("anyOf", ())) == 1:
        result |= result.pop("anyOf")[0]
    if unit:
        result["description"] = f"[{unit}] {result.get('description', '')}"
        return _number_or_text(result)
    return result


def _number_or_text(node: Any) -> Any:
    """Return a schema in which each number may be a text of a number and a unit; bounds hold for numbers."""
    if isinstance(node, list):
        return [_number_or_text(item) for item in node]
    if not isinstance(node, dict):
        return node
    items = {name: item if name == "default" else _number_or_text(item) for name, item in node.items()}
    return items | ({"type": ["number", "string"]} if node.get("type") == "number" else {})
