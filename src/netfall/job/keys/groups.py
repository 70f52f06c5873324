"""Sections of groups of elements and what they give to each group: properties and limits in service.

NAME in [group.NAME] and [limits.group.NAME] may be a pattern: [group."strut*"].
"""

from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

from netfall.job import messages
from netfall.job.keys.fields import Section
from netfall.job.keys.models import Limits
from netfall.job.keys.schema import EXCLUSIVE_KEYS
from netfall.job.values import format_value

Groups = Mapping[str, Section | dict[str, Any]]  # by the NAME of [group.NAME]; also as written in a file


def _given(table: Section | dict[str, Any]) -> dict[str, Any]:
    """Return the keys that a section gives."""
    return table.given() if isinstance(table, Section) else table


def is_pattern(name: str) -> bool:
    """Return whether the name of a section [group.NAME] is a pattern."""
    return not set(name).isdisjoint("*?[")


def matching_patterns(groups: Groups, name: str) -> list[str]:
    """Return the patterns that match the name of a group."""
    return [key for key in groups if key != name and is_pattern(key) and fnmatchcase(name, key)]


def own_values(groups: Groups, name: str) -> dict[str, Any]:
    """Return the keys that the section of a group's own name gives."""
    return _given(groups[name]) if name in groups else {}


def pattern_values(groups: Groups, name: str) -> dict[str, Any]:
    """Return the keys that patterns give to a group."""
    patterns = matching_patterns(groups, name)
    return {key: value for each in patterns for key, value in _given(groups[each]).items()}


def group_values(groups: Groups, name: str) -> dict[str, Any]:
    """Return the keys that a group overrides: those of its own section go before those of patterns."""
    return pattern_values(groups, name) | own_values(groups, name)


def section_of_key(groups: Groups, name: str, key: str) -> str:
    """Return the name of the section that gives a group one of its keys."""
    if key in own_values(groups, name):
        return name
    return next(each for each in matching_patterns(groups, name) if key in _given(groups[each]))


def unmatched_sections(groups: Groups, names: Iterable[str]) -> list[str]:
    """Return the names of sections that are of no group. names : of all groups"""
    known = {*names} - {""}
    return [
        key
        for key in groups
        if key not in known and not (is_pattern(key) and any(fnmatchcase(name, key) for name in known))
    ]


def pattern_errors(groups: Groups, names: Iterable[str], section: str) -> Iterator[str]:
    """Yield an error for each pair of patterns that give a group the same key.

    names : of all groups; section : that holds the patterns
    """
    clashes: dict[tuple[str, str, str], str] = {}  # name of a group by both patterns and the key
    for name in names:
        giver: dict[str, str] = {}  # by key; the keys of a pair, of which only one is given, count as one
        for pattern in matching_patterns(groups, name):
            for key in _given(groups[pattern]):
                quantity = next((pair[0] for pair in EXCLUSIVE_KEYS if key in pair), key)
                other = giver.setdefault(quantity, pattern)
                if other != pattern:
                    clashes.setdefault((other, pattern, key), name)
    for (one, other, key), name in clashes.items():
        yield messages.CLASHING_PATTERNS(
            section=section, one=one, other=other, key=key, group=format_value(name)
        )


ANY_GROUP = ""  # in place of a group: the nodes without a limit of a group


def displacement_limits(limits: Limits, names: list[str]) -> dict[str, float]:
    """Return the largest displacements [m] by group, and by `ANY_GROUP`. names : of all groups"""
    named = [name for name in names if name in limits.group or matching_patterns(limits.group, name)]
    tables = {ANY_GROUP: limits.given()} | {name: group_values(limits.group, name) for name in named if name}
    resolved = {}
    for name, table in tables.items():
        values = limits.given() | table  # those of a group take precedence
        limit = values.get("displacement")
        if limit is not None:
            is_share = isinstance(limit, str)  # of the span
            resolved[name] = values["span"] / float(limit.partition("/")[2]) if is_share else limit
    return resolved
