"""The keys of [cable] and [cable.GROUP], and what of them goes together."""

from netfall.job.keys import ABSENT, Key, between, choice, count, not_negative, positive

CABLE = (
    choice("kind", ("cable", "bar"), "cable", "cable: tension only; bar: tension and compression"),
    between(1.0, 1e15, "modulus", "Pa", ABSENT, "Young's modulus; with area, or axial_stiffness instead"),
    between(1e-12, 1e4, "area", "m2", ABSENT, "cross-section"),
    between(1e-3, 1e6, "density", "kg/m3", ABSENT, "mass density; with area, or mass_per_length instead"),
    between(1.0, 1e15, "axial_stiffness", "N", ABSENT, "EA, instead of modulus"),
    between(1e-9, 1e7, "mass_per_length", "kg/m", ABSENT, "instead of density"),
    Key("catalogue", "path", ABSENT, "", "path of a table of types, relative to the job file"),
    Key("type", "text", ABSENT, "", "name of a row of the catalogue, for stiffness, mass and breaking load"),
    between(-1e12, 1e12, "prestress", "N", 0.0, "axial force to form-find with, tension positive"),
    positive("yield_stress", "Pa", ABSENT, "yield stress; absent: elastic", high=1e20),
    positive(
        "fracture_strain", "", ABSENT, "total strain at fracture; absent: none breaks by its strain", high=1e6
    ),
    positive(
        "breaking_load", "N", ABSENT, "tension at fracture; absent: none breaks by its tension", high=1e20
    ),
    not_negative(
        "strength_deviation",
        "",
        0.0,
        "scatter of the strength from cable to cable, share of its mean",
        high=0.5,
    ),
    count("strength_seed", 1, "number that the strengths drawn are a function of", low=0, high=2**63 - 1),
    between(-1e-3, 1e-3, "expansion", "1/K", 12e-6, "strain for each K of temperature"),
    choice("strain", ("engineering", "logarithmic"), "engineering", "strain measure"),
)
OF_THE_WHOLE = ("strain", "catalogue", "strength_seed")  # no group has its own
EITHER = (("modulus", "axial_stiffness"), ("density", "mass_per_length"))  # one of the two
NEEDED = {"modulus": ("modulus", "axial_stiffness"), "area": ("area", "axial_stiffness")} | {
    "density": ("density", "mass_per_length")
}  # what each key stands for, unless another of these or a type is given


def wanted(name: str) -> str:
    """What is said of a key that is missing."""
    key = next(key for key in CABLE if key.name == name)
    instead = next(other for other in NEEDED[name] if other != name)
    return f"{name}: missing; expected {key.expected()}, or {instead}, or a type of the catalogue"


def wrong_combinations(cable: dict, tables: bool):
    """Sections and what is wrong in them, of [cable] as it stands; tables : rows of a table may say more."""
    groups = {name: table for name, table in cable.items() if isinstance(table, dict)}
    everywhere = {f"cable.{name}": table for name, table in groups.items()} | {"cable": cable}
    for place, table in everywhere.items():
        for one, other in EITHER:
            if one in table and other in table:
                yield place, f"{one} and {other} exclude each other; keep one of the two"
        if "type" in table and "catalogue" not in cable:
            yield place, "type: needs the table that it stands in; add catalogue = a path to [cable]"
    given = {key for table in everywhere.values() for key in table}
    for name, other in NEEDED.items():
        if not tables and not given & {*other, "type"}:
            yield "cable", wanted(name)


def may_break(cable: dict) -> bool:
    """Whether a key of [cable] or of a group lets elements break."""
    tables = [table for table in (cable, *cable.values()) if isinstance(table, dict)]
    return any(table.get(key) is not None for table in tables for key in ("fracture_strain", "breaking_load"))
