"""Checks of cables by codes: resistances from strengths, by factors that are data (codes.toml beside)."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netfall.errors import InputError

SHIPPED = Path(__file__).with_name("codes.toml")
STRENGTHS = ("breaking_load", "yield_force")
USES = ("multiply", "divide")


@dataclass(frozen=True)
class Factor:
    """A factor on a strength; groups : groups of elements with a value of their own."""

    name: str
    use: str
    value: float
    edition: str
    meaning: str
    groups: dict[str, float]


@dataclass(frozen=True)
class Check:
    """A check; resistances : the strength that each begins with, and its factors. The least one counts."""

    name: str
    title: str
    resistances: list[tuple[str, list[Factor]]]

    def resistance(self, strengths: dict[str, np.ndarray], groups: np.ndarray) -> np.ndarray:
        """Resistance (m,) [N], nan where the element has none of the strengths.

        strengths : (m,) [N] by name, inf: none; groups : (m,) names
        """
        least = np.full(len(groups), np.inf)
        for of, factors in self.resistances:
            value = strengths[of].copy()
            for factor in factors:
                each = np.full(len(groups), factor.value)
                for group, own in factor.groups.items():
                    each[groups == group] = own
                value = value * each if factor.use == "multiply" else value / each
            least = np.minimum(least, value)
        return np.where(np.isfinite(least), least, np.nan)


def read_codes(path: Path | None = None) -> list[Check]:
    """The checks of a file, the shipped ones by default. Raises InputError with all that is wrong in it."""
    path = path or SHIPPED
    try:
        data = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise InputError(f"{path}: {reason}; expected a file in the form of {SHIPPED}") from None
    errors: list[str] = []
    tables = data.get("check")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise InputError(f"{path}: no [[check]]; expected a file in the form of {SHIPPED}")
    checks = [_check(table, f"{path}: [[check]] {k}:", errors) for k, table in enumerate(tables, 1)]
    if not errors and len({check.name for check in checks}) < len(checks):
        errors.append(f"{path}: two checks have one name; names are unique")
    if errors:
        raise InputError(errors)
    return checks


def _check(table: dict, place: str, errors: list[str]) -> Check:
    for key in ("name", "title"):
        if not isinstance(table.get(key), str) or not table[key]:
            errors.append(f"{place} {key} = {table.get(key)!r}: expected a text")
    given = table.get("resistance")
    if not isinstance(given, list) or not given or not all(isinstance(r, dict) for r in given):
        errors.append(f"{place} resistance: missing; expected [[check.resistance]]")
        given = []
    found = []
    for one in given:
        if one.get("of") not in STRENGTHS:
            errors.append(f"{place} of = {one.get('of')!r}: expected one of {', '.join(STRENGTHS)}")
        factors = one.get("factor", [])
        listed = isinstance(factors, list) and all(isinstance(f, dict) for f in factors)
        if not listed:
            errors.append(f"{place} factor = {factors!r}: expected a list of tables")
        found.append((one.get("of"), [_factor(f, place, errors) for f in factors] if listed else []))
    return Check(table.get("name"), table.get("title"), found)


def _factor(table: dict, place: str, errors: list[str]) -> Factor:
    place = f"{place} factor {table.get('name')}:"
    if table.get("use") not in USES:
        errors.append(f"{place} use = {table.get('use')!r}: expected one of {', '.join(USES)}")
    groups = table.get("groups", {})
    values = [table.get("value"), *(groups.values() if isinstance(groups, dict) else [None])]
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < np.inf:
            errors.append(f"{place} value = {value!r}: expected a number > 0")
    for key in ("name", "edition"):
        if not isinstance(table.get(key), str) or not table[key]:
            errors.append(f"{place} {key} = {table.get(key)!r}: expected a text")
    rest = (str(table.get("edition", "")), str(table.get("meaning", "")))
    return Factor(str(table.get("name")), str(table.get("use")), table.get("value"), *rest, groups)
