"""Old names of a study file, which version 0.5 accepts with a warning, and their new names."""

import copy
from typing import Any, NamedTuple

from netfall.core.errors import raise_errors
from netfall.study import messages


class Rule(NamedTuple):
    """A change of the name of a section, of a key, or of a value of a key.

    key : "" if the section has another name; value : "" if the key has another name
    """

    section: str
    key: str
    value: str
    new: str


# In the order of application: rules of values follow those of their key.
RULES = (
    Rule("sample", "", "", "sampling"),
    Rule("run", "keep", "", "keep_results"),
    Rule("failure", "of", "", "outcome"),
    Rule("failure", "above", "", "limit"),
    Rule("failure", "by", "", "depth"),
    Rule("failure", "outcome", "roof_lost", "detached_area"),
    Rule("failure", "outcome", "balance_error", "energy_balance_error"),
)


def with_new_names(data: dict[str, Any], place: str) -> tuple[dict[str, Any], list[str]]:
    """Return the tables of a study file with new names, and a warning for each old name.

    place : of the file, for messages

    Raises InputError with a line for each name that stands there in both forms.
    """
    data, warnings, errors = copy.deepcopy(data), [], []
    for rule in RULES:
        old, new = _texts(rule)
        tables = _tables(data, rule)
        if rule.value:
            used = [table for table in tables if table.get(rule.key) == rule.value]
            for table in used:
                table[rule.key] = rule.new
        else:
            name = rule.key or rule.section
            used = [table for table in tables if name in table]
            if any(rule.new in table for table in used):
                errors.append(messages.ONE_NAME_TWICE(place=place, old=old, new=new))
            for table in used:
                table[rule.new] = table.pop(name)
        if used:
            warnings.append(messages.OLD_NAME(place=place, old=old, new=new))
    raise_errors(errors)
    return data, warnings


def _tables(data: dict[str, Any], rule: Rule) -> list[dict[str, Any]]:
    """Return the tables in which the name of a rule stands: that of the file, of a section or of entries."""
    if not rule.key:
        return [data]
    section = data.get(rule.section, [])
    entries = section if isinstance(section, list) else [section]
    return [entry for entry in entries if isinstance(entry, dict)]


def _texts(rule: Rule) -> tuple[str, str]:
    """Return the old and the new name as text."""
    if not rule.key:
        return f"[{rule.section}]", f"[{rule.new}]"
    place = f"[[{rule.section}]]" if rule.section == "failure" else f"[{rule.section}]"
    if rule.value:
        return f'{place} {rule.key} = "{rule.value}"', f'"{rule.new}"'
    return f"{place} {rule.key}", rule.new
