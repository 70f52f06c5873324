"""Every key of a job file: its type, unit, range, default and meaning, in one table.

Validation, the messages for wrong input, the page jobs/KEYS.md and the tests read this table: a key is added
by adding a row here.
"""

from types import SimpleNamespace

from netfall.job.cases import LIMITS, rows_of_set
from netfall.job.dimensions import DIMENSIONS, GENERATOR_KEYS
from netfall.job.keys import ABSENT, REQUIRED, Key, between, choice, count, flag, not_negative, positive, seed

CURVES = ("a0", "a", "b", "c", "d")  # buckling curves of EN 1993-1-1
CABLE = (
    choice("kind", ("cable", "bar"), "cable", "cable: tension only; bar: tension and compression"),
    between(1.0, 1e15, "modulus", "Pa", ABSENT, "Young's modulus; with area, or axial_stiffness instead"),
    between(1e-12, 1e4, "area", "m2", ABSENT, "cross-section"),
    between(1e-3, 1e6, "density", "kg/m3", ABSENT, "mass density; with area, or mass_per_length instead"),
    between(1.0, 1e15, "axial_stiffness", "N", ABSENT, "EA, instead of modulus and area"),
    between(1e-9, 1e7, "mass_per_length", "kg/m", ABSENT, "mass of a metre of cable, instead of density"),
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
        "strength_deviation", "", 0.0, "scatter of strength from cable to cable, share of its mean", high=0.5
    ),
    not_negative(
        "length_deviation", "m", 0.0, "scatter of the unstressed length of each piece of cable", high=10.0
    ),
    seed("length_seed", "seed of the drawn errors of length: the same seed draws the same"),
    seed("strength_seed", "seed of the drawn strengths: the same seed draws the same strengths"),
    positive(
        "second_moment",
        "m4",
        ABSENT,
        "of the area of a bar's section, about any axis: Euler's load",
        high=1e4,
    ),
    positive(
        "buckling_length",
        "m",
        ABSENT,
        "of a bar between what holds it, for Euler's load; absent: the length of the table's element",
        high=1e5,
    ),
    flag("bending", False, "chains of bars resist bending, by second_moment"),
    flag(
        "buckling",
        False,
        "bars carry at most Euler's load in compression, and break by their strength both ways",
    ),
    choice("buckling_curve", CURVES, "c", "of EN 1993-1-1, 6.3.1.2, for the check of a compressed bar"),
    between(-1e-3, 1e-3, "expansion", "1/K", 12e-6, "coefficient of thermal expansion: strain for each K"),
    choice("strain", ("engineering", "logarithmic"), "engineering", "strain measure"),
)
OF_THE_WHOLE = ("strain", "catalogue", "strength_seed", "length_seed")  # no group has its own
EITHER = (("modulus", "axial_stiffness"), ("density", "mass_per_length"))  # one of the two
NEEDED = {"modulus": ("modulus", "axial_stiffness"), "area": ("area", "axial_stiffness")} | {
    "density": ("density", "mass_per_length")
}  # what each key stands for, unless another of these or a type is given
PRECISION = "(jobs/trade/README.md, Precision)"  # where the figures are of what went

WIND: tuple[Key, ...] = (
    between(0.1, 200.0, "speed", "m/s", ABSENT, "U0, mean wind speed at 10 m above ground"),
    Key("file", "path", ABSENT, "", "path of a table time, speed, instead of a generated wind"),
    Key(
        "points",
        "path",
        ABSENT,
        "",
        "path of a table name, x, y, z: where the speeds of file were measured, a column each by name",
    ),
    Key(
        "pressures", "path", ABSENT, "N/m2", "path of a table of pressures in time at taps, instead of a wind"
    ),
    Key("taps", "path", ABSENT, "", "path of a table name, x, y: where the taps of pressures are"),
    between(
        -360.0,
        360.0,
        "direction",
        "degrees",
        0.0,
        "where the wind blows to, counted from x towards y: 30 is a wind from 210",
    ),
    Key(
        "roughness",
        "number",
        0.03,
        "",
        "roughness factor k of the gusts: their variance is 6 k U0^2; 0: no gusts",
        low=0.0,
        high=0.2,
    ),
    Key(
        "turbulence",
        "number",
        ABSENT,
        "",
        "turbulence intensity I at 10 m, instead of roughness: k = I^2 / 6; 0: no gusts",
        low=0.0,
        high=1.0,
    ),
    Key(
        "spectrum",
        "choice",
        "davenport",
        "",
        "spectrum of the gusts along the wind",
        choices=("davenport", "kaimal", "von_karman", "en1991"),
    ),
    Key(
        "gust_length",
        "number",
        "auto",
        "m",
        "L of the spectrum at 10 m; auto: 1200 (davenport), 56.7 (kaimal), 63.2 (von_karman, en1991)",
        low=0.1,
        high=1e5,
        also=("auto",),
    ),
    Key(
        "shape_coefficient",
        "number",
        ABSENT,
        "",
        "u_s, the pressure coefficient: positive presses on the roof, against the upward normal; "
        "negative is suction, which lifts",
        low=-1e4,
        high=1e4,
    ),
    Key(
        "sectors",
        "path",
        ABSENT,
        "",
        "path of a table direction, shape_coefficient and columns named as zones are, instead of "
        "shape_coefficient",
    ),
    positive("air_density", "kg/m3", 1.25, "density of the air", high=1e4),
    not_negative(
        "air_damping",
        "",
        0.0,
        "kappa: a surface that moves along its normal at v is pressed on by kappa rho U v; half the slope of "
        "the normal force coefficient over the angle of attack; 1: attached flow; 0: no air damping",
        high=10.0,
    ),
    between(1e-4, 60.0, "time_step", "s", 0.05, "time step of the generated histories"),
    count("ar_order", 14, "largest number of lags of the autoregressive model of the gusts", high=30),
    seed("seed", "seed of the gusts: the same seed gives the same gusts"),
    count("control_points", 25, "largest number of points at which histories are generated", low=1, high=400),
    Key(
        "coherence_decay",
        "vector",
        (8.0, 16.0, 10.0),
        "",
        "decay C of Davenport's coherence along the wind, across it and vertically",
        low=0.0,
        high=1e6,
    ),
    not_negative(
        "profile_exponent", "", 0.16, "exponent of the power law of the mean speed over height", high=1.0
    ),
    between(-1e6, 1e6, "base_height", "m", 10.0, "height of z = 0 above ground"),
    Key(
        "onset",
        "choice",
        "static",
        "",
        "static: the roof rests under its loads and the mean wind, then the gusts grow in; "
        "sudden: all of the wind at t = 0",
        choices=("static", "sudden"),
    ),
    not_negative(
        "ramp", "s", 2.0, "time over which the gusts grow in after a static onset; 0: at once", high=1e9
    ),
    Key(
        "after_fracture",
        "choice",
        "particle",
        "",
        "on what the wind no longer acts after a fracture; particle: the node where an element broke; "
        "panels: the torn faces; all: the whole roof; none: it acts on as before",
        choices=("particle", "panels", "all", "none"),
    ),
)


SECTIONS: dict[str, tuple[Key, ...]] = {
    "": (Key("title", "text", "", "", "what the job is"),),
    "net": (
        choice("generator", tuple(GENERATOR_KEYS), ABSENT, "a net made from dimensions"),
        Key("nodes", "path", ABSENT, "", "path of nodes.csv, relative to the job file"),
        Key("elements", "path", ABSENT, "", "path of elements.csv, relative to the job file"),
        choice(
            "unit",
            ("m", "cm", "mm", "ft", "in"),
            "m",
            "unit of the coordinates in nodes.csv; everything else is in SI units",
        ),
        count(
            "subdivide",
            1,
            "elements for each net segment; new nodes between two fixed ones are fixed, and go with them",
            high=10_000,
        ),
        *DIMENSIONS,
    ),
    "cable": CABLE,
    "form_finding": (
        choice(
            "method",
            ("fpm", "force_density", "keep"),
            "fpm",
            "fpm: relaxation of particles; force_density: linear; keep: the geometry stays, and carries the "
            "self-stress nearest to the prestress, equal within a group",
        ),
        choice(
            "loads",
            ("none", "permanent"),
            "none",
            "permanent: the form is in equilibrium with self weight and dead load; none: with no load",
        ),
        choice(
            "start",
            ("given", "force_density"),
            "given",
            "fpm: start from the given geometry or from the force-density one",
        ),
        not_negative("modulus_factor", "", 1e-3, "fpm: share of the modulus; 0: constant tension", high=1.0),
        Key(
            "tolerance",
            "number",
            1e-6,
            "",
            "largest residual force over the largest prestress of the elements that can move",
            low=1e-12,
            high=0.1,
        ),
        count("max_iterations", 200_000, "fpm: iterations after which the run gives up"),
    ),
    "load": (
        flag("self_weight", False, "weight of the elements"),
        not_negative(
            "dead",
            "N/m2",
            0.0,
            "weight of the roof's cladding, downward; its mass moves with the particles",
            high=1e9,
        ),
        not_negative(
            "snow",
            "N/m2",
            0.0,
            "snow load on the area in plan, downward; its mass moves with the particles",
            high=1e9,
        ),
        Key(
            "pressure",
            "pressure",
            ABSENT,
            "N/m2",
            "static load of the roof: positive presses on it, against the upward normal, negative lifts; "
            "or [x, y, z]",
            low=-1e9,
            high=1e9,
        ),
        not_negative(
            "air_mass",
            "kg/m2",
            0.0,
            "air that moves with the surface: inertia without weight, on which `damping` does not act",
            high=1e6,
        ),
        between(-273.0, 1000.0, "temperature", "K", 0.0, "change of all elements from that of form finding"),
        flag(
            "breaking",
            False,
            "whether a strength that is passed breaks an equilibrium of statics; false: it is reported",
        ),
        count("steps", 0, "load steps of the static analysis; 0: none", low=0, high=100_000),
        not_negative(
            "ramp",
            "s",
            0.0,
            "time over which the pressure grows from zero in the dynamic stage, without load steps; 0: none",
            high=1e9,
        ),
        Key(
            "tolerance",
            "number",
            1e-6,
            "",
            "estimated error of an equilibrium, of displacements and tensions, as shares of the largest",
            low=1e-12,
            high=0.1,
        ),
        count(
            "max_iterations",
            500_000,
            "iterations after which the run gives up, where an equilibrium has to be relaxed",
        ),
    ),
    "roof": (
        Key(
            "groups", "words", ABSENT, "", "groups of elements whose faces carry loads and wind; absent: all"
        ),
        Key(
            "openings",
            "points",
            (),
            "m",
            "x, y of a point in each face that is an opening",
            low=-1e9,
            high=1e9,
        ),
        Key(
            "lines",
            "path",
            ABSENT,
            "",
            "path of a table start, end: ids of nodes between which a face has an edge without an element",
        ),
        Key("faces", "path", ABSENT, "", "path of a table of the faces; absent: those of the plan"),
    ),
    "wind": WIND,
    "dynamics": (
        positive("duration", "s", REQUIRED, "simulated time", high=1e9),
        positive(
            "time_step",
            "s",
            "auto",
            "time step of the dynamic stage; auto: from the stable step of the net as it is",
            high=1e9,
            also=("auto",),
        ),
        positive("safety", "", 0.8, 'share of the stable step that time_step = "auto" takes', high=1.0),
        not_negative("damping", "1/s", 0.0, "mass-proportional damping zeta", high=1e9),
        positive("damping_ratio", "", ABSENT, "damping of axial strain, share of the critical", high=0.2),
        Key("damping_band", "band", ABSENT, "Hz", "over which it has that ratio", low=1e-6, high=1e6),
        not_negative(
            "fragment_mass",
            "",
            0.05,
            "largest share of what a particle carries (dead load, `mass`) that one fragment takes along if "
            "the step needs it; 0: its half element alone, as in the paper",
            high=0.5,
        ),
        flag(
            "fragments",
            True,
            "whether a particle splits off where an element breaks, as in the paper; "
            "false: the element is taken out of the net, its mass stays with its ends",
        ),
        not_negative(
            "mass_scaling",
            "",
            0.0,
            "largest share of the moving mass that is added, as inertia alone, where the stiffest elements "
            "ask for a short step; with fracture only without fragments",
            high=1.0,
        ),
        choice(
            "precision",
            ("double",),
            "double",
            "of the numbers that are stepped; double: eight bytes each",
            gone=(
                ("mixed", f"it was slower than double, 1.61 s for 1.53 s of the stadium {PRECISION}"),
                ("single", f"it took 3 % off the time of the stadium, for accuracy {PRECISION}"),
            ),
        ),
    ),
    "limits": LIMITS,
    "output": (
        count("frames", 120, "states written over the duration", low=1, high=1_000_000),
        positive("history", "s", 0.01, "time between rows of /history", high=1e9),
        flag(
            "energy",
            True,
            "audit of the energies; "
            "false saves its cost, and leaves the works and both errors of /history nan",
        ),
        Key(
            "probes",
            "places",
            (),
            "m",
            "[x, y], [x, y, z] or ids of nodes whose histories are kept",
            low=-1e9,
            high=1e9,
        ),
        Key("elements", "integers", ABSENT, "", "ids of elements whose tensions are kept"),
        not_negative("checkpoint", "s", 0.0, "simulated time between checkpoints; 0: none", high=1e9),
        count(
            "modes",
            0,
            "natural modes and frequencies where dynamics begins: how many, lowest first; 0: none",
            low=0,
            high=1000,
        ),
    ),
}


def may_break(cable: dict) -> bool:
    """Whether a key of [cable] or of a group lets elements break."""
    tables = [table for table in (cable, *cable.values()) if isinstance(table, dict)]
    return any(table.get(key) is not None for table in tables for key in ("fracture_strain", "breaking_load"))


def _rows(section: str, *names: str) -> tuple[Key, ...]:
    return tuple(key for key in SECTIONS[section] if key.name in names)


# Sections with tables inside that override some of their keys: where these stand, and which keys.
OVERRIDES: dict[str, tuple[str, tuple[Key, ...]]] = {
    "cable": ("", tuple(key for key in CABLE if key.name not in OF_THE_WHOLE)),  # [cable.GROUP]
    "load": ("zone", _rows("load", "dead", "snow", "pressure", "air_mass")),  # [load.zone.NAME]
    "wind": ("zone", _rows("wind", "shape_coefficient", "air_damping")),  # [wind.zone.NAME]
}

IN_CASES = rows_of_set(SECTIONS, OVERRIDES)  # what a case can set
IN_STAGES = {name: row for name, row in IN_CASES.items() if name.startswith("load.")}  # what a stage can


def defaults(section: str) -> SimpleNamespace:
    """A section with the defaults of its keys."""
    return SimpleNamespace(**{key.name: key.default for key in SECTIONS[section]}, zone={})
