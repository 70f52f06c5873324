"""Checks of cables by codes: resistances from strengths, by factors that are data (codes.toml beside)."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.values import nearest, shown
from netfall.results.cases import KINDS

SHIPPED = Path(__file__).with_name("codes.toml")
IN_TENSION, IN_COMPRESSION = ("breaking_load", "yield_force"), ("buckling", "euler_load")
STRENGTHS = IN_TENSION + IN_COMPRESSION
USES = ("multiply", "divide")
KEYS = {  # of each kind of table in the file
    "the file": ("check",),
    "[[check]]": ("name", "title", "kind", "resistance"),
    "[[check.resistance]]": ("of", "factor"),
    "factor": ("name", "use", "value", "edition", "meaning", "groups"),
}


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
    """A check; resistances : the strength that each begins with, and its factors. The least one counts.

    kind : of the combinations that it is of, one of KINDS; "": of every state
    """

    name: str
    title: str
    kind: str
    resistances: list[tuple[str, list[Factor]]]

    @property
    def compression(self) -> bool:
        """Whether it is of compression, not of tension."""
        return self.resistances[0][0] in IN_COMPRESSION

    @property
    def of(self) -> str:
        """What is compared with its resistance."""
        return "compression" if self.compression else "tension"

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
    _know_keys(data, "the file", f"{path}:", errors)
    checks = [_check(table, f"{path}: [[check]] {k}:", errors) for k, table in enumerate(tables, 1)]
    if not errors and len({check.name for check in checks}) < len(checks):
        errors.append(f"{path}: two checks have one name; names are unique")
    if errors:
        raise InputError(errors)
    return checks


def check_groups(path: Path | None, checks: list[Check], names: list[str]) -> None:
    """Refuse values for groups that the net does not have. names : of its groups. Raises InputError."""
    there, errors = sorted(set(names) - {""}), []
    for k, check in enumerate(checks, 1):
        for factor in (factor for _, factors in check.resistances for factor in factors):
            for group in [name for name in factor.groups if name not in there]:
                errors.append(
                    f"{path or SHIPPED}: [[check]] {k}: factor {factor.name}: groups: {group} = "
                    f"{factor.groups[group]:g}: no such group of elements in the result; "
                    f"{nearest(group, there) if there else 'its net has no groups'}"
                )
    if errors:
        raise InputError(errors)


def _know_keys(table: dict, kind: str, place: str, errors: list[str]) -> None:
    for key in table:
        if key not in KEYS[kind]:
            advice = nearest(key, KEYS[kind])
            errors.append(f"{place} {key} = {shown(table[key])}: unknown key of {kind}; {advice}")


def _check(table: dict, place: str, errors: list[str]) -> Check:
    _know_keys(table, "[[check]]", place, errors)
    for key in ("name", "title"):
        if not isinstance(table.get(key), str) or not table[key]:
            errors.append(f"{place} {key} = {table.get(key)!r}: expected a text")
    if table.get("kind", "") not in ("", *KINDS):
        errors.append(f"{place} kind = {table['kind']!r}: expected one of {', '.join(KINDS)}")
    given = table.get("resistance")
    if not isinstance(given, list) or not given or not all(isinstance(r, dict) for r in given):
        errors.append(f"{place} resistance: missing; expected [[check.resistance]]")
        given = []
    found = []
    for one in given:
        _know_keys(one, "[[check.resistance]]", place, errors)
        if one.get("of") not in STRENGTHS:
            errors.append(f"{place} of = {one.get('of')!r}: expected one of {', '.join(STRENGTHS)}")
        elif (one["of"] in IN_COMPRESSION) != (given[0].get("of") in IN_COMPRESSION):
            errors.append(
                f"{place} of = {one['of']!r} beside {given[0].get('of')!r}: a check is of tension or of "
                "compression; make two of it"
            )
        factors = one.get("factor", [])
        listed = isinstance(factors, list) and all(isinstance(f, dict) for f in factors)
        if not listed:
            errors.append(f"{place} factor = {factors!r}: expected a list of tables")
        found.append((one.get("of"), [_factor(f, place, errors) for f in factors] if listed else []))
    return Check(table.get("name"), table.get("title"), table.get("kind", ""), found)


def _factor(table: dict, place: str, errors: list[str]) -> Factor:
    place = f"{place} factor {table.get('name')}:"
    _know_keys(table, "factor", place, errors)
    if table.get("use") not in USES:
        errors.append(f"{place} use = {table.get('use')!r}: expected one of {', '.join(USES)}")
    groups = table.get("groups", {})
    if not isinstance(groups, dict):
        errors.append(f"{place} groups = {shown(groups)}: expected a table of values by group")
        groups = {}
    given = [("value", table.get("value")), *((f"groups: {name}", value) for name, value in groups.items())]
    for key, value in given:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < np.inf:
            errors.append(f"{place} {key} = {value!r}: expected a number > 0")
    for key in ("name", "edition"):
        if not isinstance(table.get(key), str) or not table[key]:
            errors.append(f"{place} {key} = {table.get(key)!r}: expected a text")
    rest = (str(table.get("edition", "")), str(table.get("meaning", "")))
    return Factor(str(table.get("name")), str(table.get("use")), table.get("value"), *rest, groups)
