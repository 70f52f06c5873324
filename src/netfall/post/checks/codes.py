"""Checks of cables by codes: resistances computed from strengths by factors, which codes.toml lists."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from netfall.core.errors import InputError
from netfall.job.keys.fields import GroupValues, Section, SomeTables, Tables, Text, Title, key
from netfall.job.validate import Validator
from netfall.job.values import suggest
from netfall.post import messages

SHIPPED = Path(__file__).with_name("codes.toml")
IN_TENSION = "breaking_load", "yield_force"
IN_COMPRESSION = "buckling", "euler_load", "member"
ERECTION_KIND = "erection"  # kind of checks of the stages of erection
BENDING_KIND = "ULS"  # kind of the combinations for which a report lists moments
WITH_MOMENT = "section", "member"  # checks of these add M / M_Rd to N / N_Rd


class CodeFile(Section):
    """File of checks."""

    check: Tables = key("the checks", ...)


class CheckTable(Section):
    """Entry [[check]] of a file of checks."""

    name: Text = key("of the check", ...)
    title: Text = key("what it is, in reports", ...)
    kind: Literal["ULS", "SLS", "erection", ""] = key(
        "of the combinations that it is of, or erection; absent: of every state", ""
    )
    resistance: SomeTables = key("the least one counts", ...)


class ResistanceTable(Section):
    """Entry [[check.resistance]] of a file of checks."""

    of: Literal["breaking_load", "yield_force", "buckling", "euler_load", "section", "member"] = key(
        "strength that it begins with", ...
    )
    factor: Tables = key("on that strength", [])


class Factor(Section):
    """Factor on a strength."""

    name: Text = key("of the factor", ...)
    use: Literal["multiply", "divide"] = key("how it acts", ...)
    value: float = key("the factor", ..., gt=0.0)
    edition: Text = key("where it stands", ...)
    meaning: Title = key("in words", "")
    groups: GroupValues = key("values of groups of elements", {})


@dataclass(frozen=True)
class Check:
    """Check of tension, of compression, or of axial force with bending.

    kind : one of COMBINATION_KINDS, the combinations of the check, or ERECTION_KIND; "": every state
    resistances : strength and factors of each resistance; the smallest resistance counts
    """

    name: str
    title: str
    kind: str
    resistances: list[tuple[str, list[Factor]]]

    @property
    def compression(self) -> bool:
        """Whether the check is for compression, not for tension."""
        return self.resistances[0][0] in IN_COMPRESSION

    @property
    def with_moment(self) -> bool:
        """Whether the check adds the bending moment over its resistance."""
        return self.resistances[0][0] in WITH_MOMENT

    @property
    def of(self) -> str:
        """Kind of force that is compared with the resistance."""
        return "compression" if self.compression else "axial_force" if self.with_moment else "tension"

    def resistance(self, strengths: dict[str, np.ndarray], groups: np.ndarray) -> np.ndarray:
        """Compute the resistance (m,) [N], nan if the element has none of the strengths.

        strengths : (m,) [N] by name, inf: none; groups : (m,) names
        """
        least = np.full(len(groups), np.inf)
        for strength, factors in self.resistances:
            value = strengths[strength].copy()
            for factor in factors:
                values = np.full(len(groups), factor.value)
                for group, group_value in factor.groups.items():
                    values[groups == group] = group_value
                value = value * values if factor.use == "multiply" else value / values
            least = np.minimum(least, value)
        return np.where(np.isfinite(least), least, np.nan)


def read_codes(path: Path | None = None) -> list[Check]:
    """Read the checks of a file, by default the shipped file. Raises InputError with all errors."""
    path = path or SHIPPED
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise InputError(messages.UNREADABLE_CODES(path=path, reason=reason, shipped=SHIPPED)) from None
    validation, tables = Validator(str(path), []), data.get("check")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise InputError(messages.NO_CHECKS(path=path, shipped=SHIPPED))
    validation.table("", CodeFile, data)
    checks = [_read_check(table, f"[[check]] {k}:", validation) for k, table in enumerate(tables, 1)]
    if len({check.name for check in checks}) < len(checks):
        validation.wrong("", messages.CHECK_TWICE())
    if validation.errors:
        raise InputError(validation.errors)
    return checks


def check_groups(path: Path | None, checks: list[Check], names: list[str]) -> None:
    """Check that the net has all groups with factors.

    names : groups of the net. Raises InputError.
    """
    groups, errors = sorted(set(names) - {""}), []
    for k, check in enumerate(checks, 1):
        for factor in (factor for _, factors in check.resistances for factor in factors):
            for group in [name for name in factor.groups if name not in groups]:
                name, value, file = factor.name, factor.groups[group], path or SHIPPED
                advice = suggest(group, groups) if groups else "its net has no groups"
                error = messages.UNKNOWN_GROUP(
                    path=file, number=k, factor=name, group=group, value=value, advice=advice
                )
                errors.append(error)
    if errors:
        raise InputError(errors)


def _read_check(table: dict[str, Any], place: str, validation: Validator) -> Check:
    """Read a check, and collect its errors; place : prefix of the messages."""
    check = validation.table(place, CheckTable, table)
    given = [validation.table(place, ResistanceTable, item) for item in check.resistance or []]
    if len({(item.of in IN_COMPRESSION, item.of in WITH_MOMENT) for item in given if item.of}) > 1:
        names = " and ".join(repr(item.of) for item in given)
        validation.wrong(place, messages.TENSION_AND_COMPRESSION(names=names))
    resistances: list[tuple[str, list[Factor]]] = [
        (item.of, [validation.table(f"{place} factor {t.get('name')}:", Factor, t) for t in item.factor])
        for item in given
    ]
    return Check(check.name, check.title, check.kind, resistances)
