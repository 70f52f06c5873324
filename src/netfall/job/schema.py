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
    Net,
    Output,
    Roof,
    Top,
    Wind,
    WindZone,
)

GENERATOR_KEYS = {
    "saddle": ("side", "rise", "cells"),
    "stadium": ("length", "width", "arch_rise", "spacing", "halves"),
    "ring": ("length", "width", "rise", "spacing"),
    "wheel": (
        *("diameter", "opening", "ring_height", "ring_depth"),
        *("spokes", "hoops", "spoke_force", "hoop_force", "brace_force", "ring_groups"),
    ),
    "dome": ("diameter", "opening", "dome_height", "strut", "spokes", "hoops", "spoke_force", "ring_groups"),
}
EXCLUSIVE_KEYS = (
    ("modulus", "axial_stiffness"),
    ("density", "mass_per_length"),
)  # exactly one of each pair is given
REQUIRED_ALTERNATIVES = {  # for each required key, the keys of which one must be given, unless a type is
    "modulus": ("modulus", "axial_stiffness"),
    "area": ("area", "axial_stiffness"),
    "density": ("density", "mass_per_length"),
}
SINCE = "0.5"  # version from which the defaults and removals of REMOVED and `geometry.section_defaults` hold
# Removed keys by section: the value that is still accepted with a warning, and the reason for the removal.
REMOVED_KEYS = {"dynamics": {"precision": ("double", "numbers have double precision (jobs/trade/README.md)")}}

TABLES: dict[str, type[Section]] = {
    "net": Net,
    "cable": Cable,
    "form_finding": FormFinding,
    "load": Load,
    "roof": Roof,
    "wind": Wind,
    "dynamics": Dynamics,
    "limits": Limits,
    "output": Output,
}
LISTS: dict[str, type[Section]] = {
    "zone": Zone,
    "case": Case,
    "combination": Combination,
    "motion": Motion,
    "slide": Slide,
    "remove": Remove,
    "target": Target,
    "stage": Stage,
}
SECTIONS = {name: tuple(keys_of(model).values()) for name, model in {"": Top, **TABLES}.items()}
LIST_KEYS = {name: tuple(keys_of(model).values()) for name, model in LISTS.items()}
# Sections with inner tables that override some of their keys: name of the tables, and these keys.
OVERRIDES: dict[str, tuple[str, tuple[Key, ...]]] = {
    "cable": ("", tuple(keys_of(Group).values())),  # [cable.GROUP]
    "load": ("zone", tuple(keys_of(LoadZone).values())),  # [load.zone.NAME]
    "wind": ("zone", tuple(keys_of(WindZone).values())),  # [wind.zone.NAME]
}
CASE_KEYS = settable_keys(SECTIONS, OVERRIDES)  # keys that a case can set
STAGE_KEYS = {name: key for name, key in CASE_KEYS.items() if name.startswith("load.")}  # the same of a stage


def find_key(section: str, name: str) -> Key:
    """Return a key of a section."""
    return keys_of(TABLES[section])[name]


BREAKING_KEYS = {"fracture_strain", "breaking_load"}  # of [cable] and of groups
CURVES = find_key("cable", "buckling_curve").choices  # of EN 1993-1-1


def may_break(properties: Section) -> bool:
    """Tell whether a key of [cable] or of a group lets elements break."""
    return bool(properties.given().keys() & BREAKING_KEYS)
