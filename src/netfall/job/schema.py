"""Every key of a job file: its type, unit, range, default and meaning, in one table.

Validation, the messages for wrong input and the tests read this table; a key is added by adding a row here
and in jobs/README.md (a test compares the two).
"""

from types import SimpleNamespace

from netfall.job.cable_keys import CABLE, OF_THE_WHOLE
from netfall.job.dimensions import DIMENSIONS, GENERATOR_KEYS
from netfall.job.keys import ABSENT, REQUIRED, Key, between, choice, count, flag, not_negative, positive
from netfall.job.wind_keys import WIND

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
            "in which the coordinates of nodes.csv stand; all else is in SI units",
        ),
        count(
            "subdivide",
            1,
            "elements for each net segment; new nodes between two fixed ones are fixed",
            high=10_000,
        ),
        *DIMENSIONS,
    ),
    "cable": CABLE,
    "form_finding": (
        choice(
            "method", ("fpm", "force_density"), "fpm", "fpm: relaxation of particles; force_density: linear"
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
            "largest residual force / largest prestress of what can move",
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
        not_negative("snow", "N/m2", 0.0, "in plan, downward; its mass moves with the particles", high=1e9),
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
        between(-273.0, 1000.0, "temperature", "K", 0.0, "change of all elements from that of form finding"),
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
        positive("time_step", "s", "auto", "step of the particles", high=1e9, also=("auto",)),
        positive("safety", "", 0.8, 'of the stable step, for "auto"', high=1.0),
        not_negative("damping", "1/s", 0.0, "mass-proportional damping zeta", high=1e9),
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
            ("double", "mixed", "single"),
            "double",
            "of the steps; mixed: single for forces and velocities; single: for displacements too",
        ),
    ),
    "output": (
        count("frames", 120, "states written over the duration", low=1, high=1_000_000),
        positive("history", "s", 0.01, "between rows of /history", high=1e9),
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
        count("modes", 0, "modes of the net where dynamics begins, lowest first; 0: none", low=0, high=1000),
    ),
}

# Lists of tables, [[zone]]: the keys of each entry.
LISTS: dict[str, tuple[Key, ...]] = {
    "zone": (
        Key("name", "name", REQUIRED, "", "by which [wind.zone.NAME] and [load.zone.NAME] know it"),
        Key(
            "polygon",
            "polygon",
            ABSENT,
            "m",
            "corners in plan of the start geometry, in order around it",
            low=-1e9,
            high=1e9,
        ),
        Key("groups", "words", ABSENT, "", "groups of elements whose nodes belong to it"),
        flag(
            "cut",
            False,
            "whether a polygon takes of each node's area what lies inside; false: nodes inside whole",
        ),
    ),
    "case": (
        Key("name", "name", REQUIRED, "", "of the static case"),
        Key("set", "loads", REQUIRED, "N/m2", "what it sets: snow and pressure of [load] and of its zones"),
    ),
    "remove": (
        Key("elements", "integers", ABSENT, "", "ids of the elements that are lost"),
        Key("group", "text", ABSENT, "", "or the group of elements that is lost"),
        Key("cables", "words", ABSENT, "", "or the names of the pieces of cable that are lost"),
        not_negative("time", "s", REQUIRED, "of the dynamic stage at which their stiffness goes", high=1e9),
        not_negative(
            "duration", "s", 0.0, "over which their tension then falls to zero; 0: at once", high=1e9
        ),
    ),
}

LOST = ("elements", "group", "cables")  # keys of [[remove]] that say what is lost: one of them


def _rows(section: str, *names: str) -> tuple[Key, ...]:
    return tuple(key for key in SECTIONS[section] if key.name in names)


# Sections with tables inside that override some of their keys: where these stand, and which keys.
OVERRIDES: dict[str, tuple[str, tuple[Key, ...]]] = {
    "cable": ("", tuple(key for key in CABLE if key.name not in OF_THE_WHOLE)),  # [cable.GROUP]
    "load": ("zone", _rows("load", "dead", "snow", "pressure")),  # [load.zone.NAME]
    "wind": ("zone", _rows("wind", "shape_coefficient")),  # [wind.zone.NAME]
}

CASE_KEYS = _rows("load", "snow", "pressure")  # of [load] and [load.zone.NAME]: what is not permanent


def defaults(section: str) -> SimpleNamespace:
    """A section with the defaults of its keys."""
    return SimpleNamespace(**{key.name: key.default for key in SECTIONS[section]}, zone={})
