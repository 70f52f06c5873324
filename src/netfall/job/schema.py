"""Sections and lists of a job file by name, and rules between their keys."""

from netfall.job.cases import settable_keys
from netfall.job.entries import Case, Combination, Motion, Remove, Slide, Stage, Target, Zone
from netfall.job.fields import Key, Section, keys_of
from netfall.job.models import (
    Cable,
    Dynamics,
    FormFinding,
    Group,
    Limits,
    Load,
    LoadZone,
    Modes,
    Output,
    Roof,
    Top,
    Wind,
    WindZone,
)
from netfall.job.net import Dome, Net, Ring, Saddle, Stadium, Wheel

EXCLUSIVE_KEYS = (
    ("modulus", "axial_stiffness"),
    ("density", "mass_per_length"),
    ("prestress", "horizontal_force"),
)  # at most one of each pair is given in one place
REQUIRED_ALTERNATIVES = {  # for each required key, the keys of which one must be given, unless a type is
    "modulus": ("modulus", "axial_stiffness"),
    "area": ("area", "axial_stiffness"),
    "density": ("density", "mass_per_length"),
}
MODELS: dict[str, type[Section]] = {
    "net": Net,
    "cable": Cable,
    "form_finding": FormFinding,
    "load": Load,
    "roof": Roof,
    "wind": Wind,
    "dynamics": Dynamics,
    "limits": Limits,
    "output": Output,
    "modes": Modes,
}
GENERATORS: dict[str, type[Section]] = {  # dimensions of each generator, [net.saddle]
    "saddle": Saddle,
    "stadium": Stadium,
    "ring": Ring,
    "wheel": Wheel,
    "dome": Dome,
}
LIST_MODELS: dict[str, type[Section]] = {
    "zone": Zone,
    "case": Case,
    "combination": Combination,
    "motion": Motion,
    "slide": Slide,
    "remove": Remove,
    "target": Target,
    "stage": Stage,
}


def _rows(models: dict[str, type[Section]]) -> dict[str, tuple[Key, ...]]:
    """Return the keys of each model."""
    return {name: tuple(keys_of(model).values()) for name, model in models.items()}


SECTIONS = _rows({"": Top, **MODELS})
GENERATOR_KEYS = {name: tuple(keys_of(model)) for name, model in GENERATORS.items()}
_DIMENSIONS = {f"net.{name}": model for name, model in GENERATORS.items()}
# Keys of every table of a job file by its name, in the order of the pages.
TABLES = _rows({"": Top, "net": Net, **_DIMENSIONS, **MODELS})
LIST_KEYS = _rows(LIST_MODELS)
GROUP_KEYS = tuple(keys_of(Group).values())  # of [group.NAME], which override those of [cable]
ZONE_KEYS = _rows({"load": LoadZone, "wind": WindZone})  # of [load.zone.NAME], [wind.zone.NAME]
CASE_KEYS = settable_keys(SECTIONS, ZONE_KEYS)  # keys that a case can set
STAGE_KEYS = {name: key for name, key in CASE_KEYS.items() if name.startswith("load.")}  # the same of a stage
BREAKING_KEYS = {"fracture_strain", "breaking_load"}  # of [cable] and of groups


def find_key(section: str, name: str) -> Key:
    """Return a key of a section."""
    return keys_of(MODELS[section])[name]


def key_of(name: str) -> Key | None:
    """Return the key of a dotted name, None if it is unknown.

    Examples: "wind.speed", "net.saddle.side", "load.zone.NAME.snow", "group.NAME.area".
    """
    section, _, key = name.rpartition(".")
    top = section.partition(".")[0]
    if top == "group":
        section = "cable"
    elif section.startswith(("load.zone.", "wind.zone.")):
        section = top
    return next((each for each in TABLES.get(section, ()) if each.name == key), None)


CURVES = find_key("cable", "buckling_curve").choices  # of EN 1993-1-1


def may_break(properties: Section) -> bool:
    """Tell whether a key of [cable] or of a group lets elements break."""
    return bool(properties.given().keys() & BREAKING_KEYS)
