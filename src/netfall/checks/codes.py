"""Checks of cables by codes: resistances from strengths, by factors that are data (codes.toml beside)."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.keys import keys_of
from netfall.job.validate import Validation
from netfall.job.values import nearest
from netfall.results.cases import KINDS

SHIPPED = Path(__file__).with_name("codes.toml")
IN_TENSION, IN_COMPRESSION = ("breaking_load", "yield_force"), ("buckling", "euler_load")
STRENGTHS = IN_TENSION + IN_COMPRESSION
KEYS = keys_of(f"""
[file]
check | tables | | required | the checks
[check]
name | text | | required | of the check
title | text | | required | what it is, in reports
kind | choice {" ".join(KINDS)} | | "" | of the combinations that it is of; absent: of every state
resistance | tables | | required | the least one counts
[check.resistance]
of | choice {" ".join(STRENGTHS)} | | required | strength that it begins with
factor | tables | | [] | on that strength
[factor]
name | text | | required | of the factor
use | choice multiply divide | | required | how it acts
value | number | > 0 | required | the factor
edition | text | | required | where it stands
meaning | text | | "" | in words
groups | values | > 0 | {{}} | values of groups of elements
""")


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
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise InputError(f"{path}: {reason}; expected a file in the form of {SHIPPED}") from None
    validation, tables = Validation(str(path), []), data.get("check")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise InputError(f"{path}: no [[check]]; expected a file in the form of {SHIPPED}")
    validation.table("", KEYS["file"], data)
    checks = [_check(table, f"[[check]] {k}:", validation) for k, table in enumerate(tables, 1)]
    if len({check.name for check in checks}) < len(checks):
        validation.wrong("", "two checks have one name; names are unique")
    if validation.errors:
        raise InputError(validation.errors)
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


def _check(table: dict, place: str, validation: Validation) -> Check:
    own = validation.table(place, KEYS["check"], table)
    each = [validation.table(place, KEYS["check.resistance"], one) for one in own.resistance or []]
    if len({one.of in IN_COMPRESSION for one in each if one.of}) > 1:
        names = " beside ".join(repr(one.of) for one in each)
        what = "a check is of tension or of compression; make two of it"
        validation.wrong(place, f"of = {names}: {what}")
    known = lambda factor: validation.table(f"{place} factor {factor.get('name')}:", KEYS["factor"], factor)
    found = [(one.of, [Factor(**vars(known(factor))) for factor in one.factor]) for one in each]
    return Check(own.name, own.title, own.kind, found)
