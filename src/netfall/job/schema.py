"""Every key of a job file: its type, unit, range, default and meaning, in one table.

Validation, the messages for wrong input and the tests read this table; a key is added by adding a row here
and in jobs/README.md (a test compares the two).
"""

from dataclasses import dataclass

REQUIRED = object()  # the key must stand in the job file if its section does
ABSENT = None  # the key may be missing: the thing that it describes is then not there


@dataclass(frozen=True)
class Key:
    """One key of a section.

    kind : "number" | "integer" | "flag" | "text" | "choice" | "vector" | "pressure" | "points" | "words"
    low, high : bounds of a number; low_open, high_open : the bound itself is excluded
    """

    name: str
    kind: str
    default: object
    unit: str
    meaning: str
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    high_open: bool = False
    choices: tuple[str, ...] = ()
    also: tuple[str, ...] = ()  # words that stand in place of a number ("auto")

    def expected(self) -> str:
        """What is allowed, in words: "a number of m/s > 0"."""
        if self.kind == "choice":
            return "one of " + ", ".join(f'"{c}"' for c in self.choices)
        if self.kind == "flag":
            return "true or false"
        if self.kind == "text":
            return f"a text in quotes ({self.meaning})"
        of = f" of {self.unit}" if self.unit else ""
        if self.kind == "vector":
            return f"three numbers{of}, [x, y, z]" + self._range()
        if self.kind == "pressure":
            return f"three numbers{of}, [x, y, z], or one number along the normals"
        if self.kind == "points":
            return f"a list of [x, y] pairs{of}"
        if self.kind == "words":
            return f"a list of names in quotes ({self.meaning})"
        noun = "an integer" if self.kind == "integer" else "a number"
        words = "".join(f' or "{w}"' for w in self.also)
        return f"{noun}{of}{self._range()}{words}"

    def _range(self) -> str:
        parts = []
        if self.low is not None:
            parts.append(f"{'>' if self.low_open else '>='} {self.low:g}")
        if self.high is not None:
            parts.append(f"{'<' if self.high_open else '<='} {self.high:g}")
        return (" " if parts else "") + " and ".join(parts)


def between(low, high, name, unit, default, meaning):
    """Row of a number within what is physically possible; far beyond, products overflow."""
    return Key(name, "number", default, unit, meaning, low=low, high=high)


def positive(name, unit, default, meaning, high=None, also=()):
    """Row of a number > 0."""
    return Key(name, "number", default, unit, meaning, low=0.0, low_open=True, high=high, also=also)


def not_negative(name, unit, default, meaning, high=None):
    """Row of a number >= 0."""
    return Key(name, "number", default, unit, meaning, low=0.0, high=high)


def count(name, default, meaning, low=1, high=None):
    """Row of an integer."""
    return Key(name, "integer", default, "", meaning, low=low, high=high)


SECTIONS: dict[str, tuple[Key, ...]] = {
    "": (Key("title", "text", "", "", "what the job is"),),
    "net": (
        Key("generator", "choice", ABSENT, "", "a net made from dimensions", choices=("saddle", "stadium")),
        Key("nodes", "text", ABSENT, "", "path of nodes.csv, relative to the job file"),
        Key("elements", "text", ABSENT, "", "path of elements.csv, relative to the job file"),
        Key(
            "unit",
            "choice",
            "m",
            "",
            "in which the coordinates of nodes.csv stand; all else is in SI units",
            choices=("m", "cm", "mm", "ft", "in"),
        ),
        count(
            "subdivide",
            1,
            "elements for each net segment; new nodes between two fixed ones are fixed",
            high=10_000,
        ),
        between(1e-3, 1e6, "side", "m", 73.2, "saddle: side of the square in plan"),
        between(
            -1e6, 1e6, "rise", "m", 3.66, "saddle: height of the boundary's high points above the middle"
        ),
        count("cells", 8, "saddle: cells along a side", low=2, high=20_000),
        between(1e-3, 1e6, "length", "m", 88.0, "stadium: long axis of the ellipse"),
        between(1e-3, 1e6, "width", "m", 66.0, "stadium: short axis of the ellipse"),
        between(-1e6, 1e6, "arch_rise", "m", 10.0, "stadium: rise of the parabolic arch"),
        positive("spacing", "m", 2.2, "stadium: distance of the cables"),
    ),
    "cable": (
        Key(
            "kind",
            "choice",
            "cable",
            "",
            "cable: tension only; bar: tension and compression",
            choices=("cable", "bar"),
        ),
        between(1.0, 1e15, "modulus", "Pa", REQUIRED, "Young's modulus"),
        between(1e-12, 1e4, "area", "m2", REQUIRED, "cross-section"),
        between(1e-3, 1e6, "density", "kg/m3", REQUIRED, "mass density"),
        between(-1e12, 1e12, "prestress", "N", 0.0, "axial force to form-find with, tension positive"),
        positive("yield_stress", "Pa", ABSENT, "yield stress; absent: elastic"),
        positive("fracture_strain", "", ABSENT, "total strain at fracture; absent: nothing breaks"),
        Key("strain", "choice", "engineering", "", "strain measure", choices=("engineering", "logarithmic")),
    ),
    "form_finding": (
        Key(
            "method",
            "choice",
            "fpm",
            "",
            "fpm: relaxation of particles; force_density: linear",
            choices=("fpm", "force_density"),
        ),
        Key(
            "start",
            "choice",
            "given",
            "",
            "fpm: start from the given geometry or from the force-density one",
            choices=("given", "force_density"),
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
        Key("self_weight", "flag", False, "", "weight of the elements"),
        not_negative(
            "dead", "N/m2", 0.0, "weight of the roof's cladding, downward; its mass moves with the particles"
        ),
        Key(
            "pressure",
            "pressure",
            ABSENT,
            "N/m2",
            "static load of the roof: positive presses on it, against the upward normal, negative lifts; "
            "or [x, y, z]",
        ),
        count("steps", 0, "load steps of the static analysis; 0: none", low=0, high=100_000),
        not_negative(
            "ramp",
            "s",
            0.0,
            "time over which the pressure grows from zero in the dynamic stage, without load steps; 0: none",
        ),
        Key(
            "tolerance",
            "number",
            1e-6,
            "",
            "largest residual force / largest of prestress and nodal load of what can move",
            low=1e-12,
            high=0.1,
        ),
        count("max_iterations", 500_000, "iterations of a load step after which the run gives up"),
    ),
    "roof": (
        Key(
            "groups", "words", ABSENT, "", "groups of elements whose faces carry loads and wind; absent: all"
        ),
        Key("openings", "points", (), "m", "x, y of a point in each face that is an opening"),
    ),
    "wind": (
        between(0.1, 200.0, "speed", "m/s", ABSENT, "U0, mean at 10 m above ground"),
        Key("file", "text", ABSENT, "", "path of a table time, speed, instead of a generated wind"),
        Key("roughness", "number", 0.03, "", "k of Davenport's spectrum; 0: no gusts", low=0.0, high=0.2),
        Key(
            "shape_coefficient",
            "number",
            REQUIRED,
            "",
            "u_s: positive presses on the roof, against the upward normal; negative is suction, which lifts",
        ),
        positive("air_density", "kg/m3", 1.25, "density of the air"),
        between(1e-4, 60.0, "time_step", "s", 0.05, "time step of the generated histories"),
        count("ar_order", 4, "lags of the autoregressive model", high=30),
        count("seed", 1, "number that the random histories are a function of", low=0, high=2**63 - 1),
        count(
            "control_points", 25, "largest number of points at which histories are generated", low=1, high=400
        ),
        Key(
            "coherence_decay",
            "vector",
            (8.0, 16.0, 10.0),
            "",
            "C of Davenport's coherence along the wind (x), across, vertical",
            low=0.0,
        ),
        not_negative("profile_exponent", "", 0.16, "of the mean speed over height", high=1.0),
        Key("base_height", "number", 10.0, "m", "height of z = 0 above ground"),
        Key(
            "after_fracture",
            "choice",
            "particle",
            "",
            "what loses the wind at a fracture",
            choices=("particle", "all", "none"),
        ),
    ),
    "dynamics": (
        positive("duration", "s", REQUIRED, "simulated time"),
        positive("time_step", "s", "auto", "step of the particles", also=("auto",)),
        positive("safety", "", 0.8, 'of the stable step, for "auto"', high=1.0),
        not_negative("damping", "1/s", 0.0, "mass-proportional damping zeta"),
        not_negative(
            "fragment_mass",
            "",
            0.05,
            "largest share of what a particle carries (dead load, `mass`) that one fragment takes along if "
            "the step needs it; 0: its half element alone, as in the paper",
            high=0.5,
        ),
        Key(
            "fragments",
            "flag",
            True,
            "",
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
        Key(
            "precision",
            "choice",
            "double",
            "",
            "of the steps; mixed: single for forces and velocities; single: for displacements too",
            choices=("double", "mixed", "single"),
        ),
    ),
    "output": (
        count("frames", 120, "states written over the duration", low=1, high=1_000_000),
        positive("history", "s", 0.01, "between rows of /history"),
        Key(
            "energy",
            "flag",
            True,
            "",
            "audit of the energies; "
            "false saves its cost, and leaves the works and both errors of /history nan",
        ),
        Key("probes", "points", (), "m", "x, y of particles whose histories are kept"),
        not_negative("checkpoint", "s", 0.0, "simulated time between checkpoints; 0: none"),
    ),
}

GENERATOR_KEYS = {"saddle": ("side", "rise", "cells"), "stadium": ("length", "width", "arch_rise", "spacing")}
GROUP_KEYS = tuple(k for k in SECTIONS["cable"] if k.name != "strain")
