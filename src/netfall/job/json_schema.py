"""JSON schema of a job file, with which editors complete keys and mark wrong ones."""

import json
from typing import Any, Literal

from pydantic import Field, create_model

from netfall.job.models import Group, Top
from netfall.job.schema import LIST_MODELS, MODELS
from netfall.job.units import example

REQUIRED_SECTIONS = ("net", "cable")
QUANTITY_PATTERN = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*\D.*$"


def job_schema() -> dict[str, Any]:
    """Return the schema: each section with type, unit, range, default and meaning of its keys."""
    fields: dict[str, Any] = {}
    for name, model in MODELS.items():
        fields[name] = (model, ... if name in REQUIRED_SECTIONS else None)
    for name, model in LIST_MODELS.items():
        fields[name] = (list[model], Field([], description=f"entries [[{name}]]"))  # type: ignore[valid-type]
    groups = dict[str, Group]  # type: ignore[valid-type]
    fields["group"] = (groups, Field({}, description="properties of groups, by name or pattern"))
    fields["combinations"] = (
        dict[str, dict[str, float | Literal["ULS", "SLS"]]],
        Field({}, description="combinations in a table: kind, and factors of actions and cases"),
    )
    job = create_model("Job", __base__=Top, __doc__="Job file of netfall.", **fields)
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
        return _number_or_text(result, unit)
    return result


def _number_or_text(node: Any, unit: str) -> Any:
    """Return a schema in which each number may be a text of a number and a unit."""
    if isinstance(node, list):
        return [_number_or_text(item, unit) for item in node]
    if not isinstance(node, dict):
        return node
    if node.get("type") == "number":
        number = {name: item for name, item in node.items() if name not in ("description", "default")}
        others = {name: item for name, item in node.items() if name in ("description", "default")}
        return {
            "anyOf": [number, {"type": "string", "pattern": QUANTITY_PATTERN, "examples": [example(unit)]}],
            **others,
        }
    return {name: item if name == "default" else _number_or_text(item, unit) for name, item in node.items()}
