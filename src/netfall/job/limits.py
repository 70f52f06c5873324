"""Limits of displacements in service: of [limits], and of [limits.group.NAME] for the nodes of groups."""

from typing import Any

from netfall.job.groups import group_values
from netfall.job.models import Limits

EVERYWHERE = ""  # in place of a group: the nodes without a limit of a group


def displacement_limits(limits: Limits, names: list[str]) -> dict[str, float]:
    """Return the largest displacements [m] by group, and by `EVERYWHERE`. names : of all groups"""
    tables = {EVERYWHERE: limits.given()} | {name: group_values(limits.group, name) for name in names if name}
    resolved = {name: _resolve(limits, table) for name, table in tables.items() if table}
    return {name: value for name, value in resolved.items() if value is not None}


def _resolve(limits: Limits, table: dict[str, Any]) -> float | None:
    """Return a limit [m]; table : keys that take precedence over those of [limits]."""
    limit: str | float | None = table.get("displacement", limits.displacement)
    span: Any = table.get("span", limits.span)
    return float(span / float(limit.partition("/")[2])) if isinstance(limit, str) else limit
