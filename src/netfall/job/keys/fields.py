"""Types of the keys of a job, and what a key expects.

Each key is one field of a model (`models`, `entries`), which states type, unit, range, default and meaning.
Validation, messages, generated pages, `netfall init` and `netfall schema` are made from the field.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
)
from pydantic.fields import FieldInfo

from netfall.job.values import range_text

MAX_INT64 = 2**63 - 1
MAX_SHIFT = 1e6  # m: largest displacement of a support in a job
STRICT = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Section(BaseModel):
    """Section of a job file, or an entry of a list of tables. Its fields are the keys."""

    model_config = STRICT

    def given(self) -> dict[str, Any]:
        """Return the values of the keys that the file gives, by name."""
        return {name: getattr(self, name) for name in self.model_fields_set}

    def replaced(self, **values: Any) -> Self:
        """Return a copy with other values of some keys, which are not checked again."""
        return self.model_copy(update=values)


class ZonedSection(Section):
    """Section with a field `zone`: values that differ in zones of the roof, by their names."""

    zone: dict[str, Any]

    def zone_values(self, key: str) -> dict[str, Any]:
        """Return the values of a key in the zones that give it."""
        return {name: getattr(zone, key) for name, zone in self.zone.items() if key in zone.model_fields_set}

    def all_values(self, key: str) -> list[Any]:
        """Return the value of a key in the section, and its values in zones."""
        return [getattr(self, key), *self.zone_values(key).values()]


def key(
    meaning: str,
    default: Any = None,
    *,
    unit: str = "",
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    name: str | None = None,
) -> Any:
    """Return the field of a key.

    default : ... for a key that must be given; None for a key without which its feature is absent
    name : of the key, if Python reserves it
    unit : of the number, or of the numbers in the file that a path names; ge, gt, le : bounds of a number
    """
    extra: Any = {"unit": unit} if unit else None
    return Field(default, alias=name, description=meaning, ge=ge, gt=gt, le=le, json_schema_extra=extra)


@dataclass(frozen=True)
class Kind:
    """Kind of values. `expected` describes it, with {within} the range and unit, and {meaning}."""

    name: str
    expected: str


def _without_nul(text: str) -> str:
    """Refuse a text that no path or dataset can hold."""
    if "\x00" in text:
        raise ValueError("contains a NUL character")
    return text


def _valid_name(text: str) -> str:
    """Refuse a name that cannot be part of a path."""
    if text in (".", "..") or set(text) & set("/\x00"):
        raise ValueError("cannot be part of a path")
    return text


def _ascending(band: list[float]) -> list[float]:
    """Refuse a band whose second frequency is not the larger one."""
    if not band[0] < band[1]:
        raise ValueError("does not ascend")
    return band


def _plain_id(number: Any) -> Any:
    """Refuse an id such as "01", which would replace the value of "1"."""
    if str(int(number)) != str(number):
        raise ValueError("not in its usual form")
    return number


Filled = Annotated[str, Field(min_length=1), AfterValidator(_without_nul)]
Title = Annotated[str, AfterValidator(_without_nul), Kind("text", "a text in quotes ({meaning})")]
Text = Annotated[Filled, Kind("text", "a text in quotes ({meaning})")]
TablePath = Annotated[Filled, Kind("path", "a text in quotes ({meaning})")]
Name = Annotated[
    str,
    Field(min_length=1),
    AfterValidator(_valid_name),
    Kind("name", "a name in quotes, without / ({meaning})"),
]
Word = Annotated[str, Field(min_length=1)]
Words = Annotated[list[Word], Field(min_length=1), Kind("words", "a list of names in quotes ({meaning})")]
Ids = Annotated[list[int], Field(min_length=1), Kind("integers", "a list of integers ({meaning})")]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
Vector = Annotated[
    list[Coordinate],
    Field(min_length=3, max_length=3),
    Kind("vector", "three numbers [x, y, z]{within}"),
]
Decay = Annotated[
    list[Annotated[float, Field(ge=0.0, le=1e6)]],
    Field(min_length=3, max_length=3),
    Kind("vector", "three numbers [x, y, z]{within}"),
]
Band = Annotated[
    list[Annotated[float, Field(ge=1e-6, le=1e6)]],
    Field(min_length=2, max_length=2),
    AfterValidator(_ascending),
    Kind("band", "two numbers [low, high]{within}, the second larger"),
]
Pressure = Annotated[
    Coordinate | Vector,
    Kind("pressure", "three numbers [x, y, z], or one number along the normals,{within}"),
]
ShareOfSpan = Annotated[str, Field(pattern=r"^span */ *[1-9]\d*(\.\d+)?$")]
Deflection = Annotated[
    Annotated[float, Field(gt=0.0, le=1e6)] | ShareOfSpan,
    Kind("deflection", 'a number{within}, or a share of the span such as "span/250"'),
]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Points = Annotated[list[Point], Kind("points", "a list of [x, y] pairs{within}")]
Places = Annotated[
    list[int | Annotated[list[Coordinate], Field(min_length=2, max_length=3)]],
    Kind("places", "a list of places [x, y] or [x, y, z]{within}, or of ids of nodes"),
]
Polygon = Annotated[
    list[Point],
    Field(min_length=3),
    Kind("polygon", "a list of three or more [x, y] corners{within}"),
]
Factors = Annotated[
    dict[str, Annotated[float, Field(ge=-1e3, le=1e3)]],
    Kind("factors", "a table of numbers{within}, {{permanent = 1.35, NAME = 1.5}}"),
]
Positive = Annotated[float, Field(gt=0.0)]
GroupValues = Annotated[dict[str, Positive], Kind("values", "a table of numbers{within} ({meaning})")]
Tables = Annotated[list[dict[str, Any]], Kind("tables", "a list of tables ({meaning})")]
SomeTables = Annotated[Tables, Field(min_length=1)]
Shift = Annotated[
    list[Annotated[float, Field(ge=-MAX_SHIFT, le=MAX_SHIFT)]], Field(min_length=3, max_length=3)
]
Id = Annotated[int, Strict(False), BeforeValidator(_plain_id)]
Shifts = Annotated[
    dict[Id, Shift],
    Kind(
        "shifts",
        "a table of [x, y, z]{within} by ids of nodes without leading zeros, {{17 = [0.0, 0.0, -0.05]}}",
    ),
]
Moves = Annotated[
    dict[Word, Shift],
    Field(min_length=1),
    Kind(
        "moves",
        "a table of [x, y, z]{within} by ids of nodes, groups, zones or all, {{17 = [0.0, 0.0, -0.05]}}",
    ),
]
Axes = Annotated[str, Field(min_length=1, pattern="^x?y?z?$")]
Supports = Annotated[
    Word
    | Annotated[list[int | Word], Field(min_length=1)]
    | Annotated[dict[Word, Axes], Field(min_length=1)],
    Kind(
        "supports",
        'ids of nodes, groups, zones or "all" in a list, or a table of their axes, {{17 = "xy", ring = "z"}}',
    ),
]
Settings = Annotated[dict[str, Any], Kind("loads", 'a table of loads, {{"load.snow" = 750.0, ...}}')]
SCALARS = {
    float: Kind("number", "a number{within}{words}"),
    int: Kind("integer", "an integer{within}{words}"),
    bool: Kind("flag", "true or false"),
}
CHOICE = Kind("choice", "{choices}")


def is_whole(value: object) -> bool:
    """Return whether a value is an integer; true and false are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_finite_number(value: object) -> bool:
    """Return whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


@dataclass(frozen=True)
class Key:
    """Key of a section as messages and pages describe it.

    required : whether the section needs it; default : None for a key that is absent by default
    low, high : bounds of the number or numbers; low_open : whether the lower bound is excluded
    choices : allowed words; special_words : words allowed instead of a number ("auto")
    """

    name: str
    kind: str
    description: str
    annotation: Any
    required: bool
    default: Any
    unit: str
    meaning: str
    low: float | None
    high: float | None
    low_open: bool
    choices: tuple[str, ...]
    special_words: tuple[str, ...]

    def expected(self) -> str:
        """Describe the allowed values: "a number > 0 m/s"."""
        return self.description.format(
            within=range_text(self.low, self.high, self.unit, self.low_open),
            words="".join(f' or "{word}"' for word in self.special_words),
            choices="one of " * (len(self.choices) > 1) + ", ".join(f'"{word}"' for word in self.choices),
            meaning=self.meaning,
        )

    @property
    def takes_units(self) -> bool:
        """Whether a value may be a text of a number and a unit."""
        return bool(self.unit) and self.kind != "path"

    def fits(self, value: Any) -> bool:
        """Return whether the key allows a value."""
        try:
            self.checked(value)
        except ValidationError:
            return False
        return True

    def checked(self, value: Any) -> Any:
        """Return a value as the type of the key. Raises pydantic.ValidationError."""
        return self._adapter.validate_python(value)

    @cached_property
    def _adapter(self) -> TypeAdapter[Any]:
        """Validator of the type, built once: that takes a hundred times as long as its use."""
        return TypeAdapter(self.annotation, config=ConfigDict(strict=True, allow_inf_nan=False))


@cache
def keys_of(model: type[Section]) -> dict[str, Key]:
    """Return the keys of a section by name, in the order of the model; without its inner tables."""
    hints = get_type_hints(model, include_extras=True)
    fields = model.model_fields.items()
    keys = [_key(field.alias or name, field, hints[name]) for name, field in fields]
    return {each.name: each for each in keys if each is not None}


@cache
def inner_models(model: type[Section]) -> dict[str, type[Section]]:
    """Return the models of the inner tables of a section, [SECTION.FIELD.NAME], by field."""
    hints = get_type_hints(model)
    of_tables = {name: hint for name, hint in hints.items() if name not in keys_of(model)}
    return {name: get_args(hint)[1] for name, hint in of_tables.items() if get_origin(hint) is dict}


def _key(name: str, field: FieldInfo, hint: Any) -> Key | None:
    """Return the key of a field; None for a field of inner tables."""
    alternatives = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    parts = [part for part in alternatives if part is not NoneType]
    words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
    values = [part for part in parts if get_origin(part) is not Literal]
    kind = CHOICE if words and not values else _kind(values[0])
    if kind is None:
        return None
    bounds = [bound for source in (*field.metadata, *values) for bound in _bounds(source)]
    low: Any = next((bound for bound in bounds if isinstance(bound, Ge | Gt)), None)
    high: Any = next((bound.le for bound in bounds if isinstance(bound, Le)), None)
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    return Key(
        name,
        kind.name,
        kind.expected,
        Annotated[hint, field.description, *field.metadata],
        required=field.is_required(),
        default=None if field.is_required() else field.default,
        unit=str(extra.get("unit", "")),
        meaning=field.description or "",
        low=None if low is None else getattr(low, "ge" if isinstance(low, Ge) else "gt"),
        high=high,
        low_open=isinstance(low, Gt),
        choices=tuple(words) if kind is CHOICE else (),
        special_words=() if kind is CHOICE else tuple(words),
    )


def _kind(hint: Any) -> Kind | None:
    """Return the kind of a type; None for a model or a table of models."""
    if get_origin(hint) is Annotated:
        return next((item for item in hint.__metadata__ if isinstance(item, Kind)), None) or _kind(
            get_args(hint)[0]
        )
    return SCALARS.get(hint)


def _bounds(source: Any) -> Iterator[Ge | Gt | Le]:
    """Yield the bounds of numbers in the metadata of a type."""
    if isinstance(source, Ge | Gt | Le):
        yield source
    elif isinstance(source, FieldInfo):
        for item in source.metadata:
            yield from _bounds(item)
    else:
        for part in (*getattr(source, "__metadata__", ()), *get_args(source)):
            yield from _bounds(part)
