"""Conversion of strings with a number and a unit, such as "400 mm2", to the unit of a key."""

import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING, Any

from netfall.job import messages

if TYPE_CHECKING:
    import pint

QUANTITY = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?![eE][+-]?\d)([^\W\d_].*|°.*|1\s*/.+)"
)
# 907 kg to pint, but 1000 kg or 1016 kg to others
TON = re.compile(r"\b(?:k|M|kilo|mega)?(?:force_)?tons?(?:_force)?\b")
# units that pint lacks
DEFINITIONS = "psf = lbf / ft**2", "ksf = kip / ft**2", "plf = lbf / ft", "klf = kip / ft", "pcf = lb / ft**3"
EXAMPLES = {
    "m": "20 mm",
    "m2": "400 mm2",
    "m3": "650 cm3",
    "m4": "8500 cm4",
    "N": "60 kN",
    "N/m": "2 kN/m",
    "N/m2": "0.3 kN/m2",
    "Pa": "160 GPa",
    "kg/m": "3.2 kg/m",
    "kg/m2": "30 kg/m2",
    "kg/m3": "7.85 t/m3",
    "m/s": "90 km/h",
    "K": "-20 K",
    "degrees": "0.5 rad",
    "s": "50 ms",
    "Hz": "2 Hz",
}


class UnitError(ValueError):
    """Text with an unknown unit, or with a unit of another dimension."""


def to_unit(value: Any, unit: str) -> Any:
    """Return a value with each text of a number and a unit replaced by the number in `unit`.

    Lists and tables are searched; other texts stay. Raises UnitError.
    """
    if isinstance(value, list):
        return [to_unit(item, unit) for item in value]
    if isinstance(value, dict):
        return {name: to_unit(item, unit) for name, item in value.items()}
    match = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    return value if match is None else float(Decimal(match[1]) * factor(match[2].strip(), unit))


@cache
def factor(given: str, unit: str) -> Decimal:
    """Return the number of `unit` in one `given`, exact for decimal multiples. Raises UnitError."""
    import pint

    registry = _registry()
    try:
        if TON.search(given):
            raise ValueError
        root = str(registry.get_root_units(given)[1])
        differs = (root != "radian") if unit == "degrees" else ("radian" in root)  # 1 to pint
        if differs or (unit == "K" and registry.Unit(given) != registry.Unit("K")):
            raise pint.DimensionalityError(given, unit)
        return registry.Quantity(Decimal(1), given).to(unit).magnitude
    except pint.DimensionalityError:
        error = messages.NOT_KELVIN if unit == "K" else messages.OTHER_DIMENSION
    except Exception:  # pint raises errors of many kinds for a malformed unit, such as "kN m-2"
        error = messages.UNKNOWN_UNIT
    raise UnitError(error(given=given, unit=unit, example=example(unit)))


def example(unit: str) -> str:
    """Return an example of a text with a unit."""
    return EXAMPLES.get(unit, f"1.5 {unit}")


@cache
def _registry() -> "pint.UnitRegistry[Decimal]":
    """Return the units, with exact decimal factors; "m2" is the square of "m"."""
    import pint  # takes 0.5 s, so only for jobs with units

    registry: pint.UnitRegistry[Decimal] = pint.UnitRegistry(
        non_int_type=Decimal, preprocessors=[lambda text: re.sub(r"(?<=[A-Za-z])(?=\d)", "**", text)]
    )
    for definition in DEFINITIONS:
        registry.define(definition)
    return registry
