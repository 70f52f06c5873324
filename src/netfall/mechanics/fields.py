"""The table of fields: every array of the solver's state, in one place.

A field is added by adding a row. From the table follow the arrays of a rank (`state.State`), the named tuples
that kernels take (`Particles`, `Elements`, `Slots`), what a particle that splits off starts with, what a
checkpoint holds, and what goes into the slots of the step.
"""

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

SLOTS = 4  # elements of a particle in the vector loop; particles with more have layers of their own
EMPTY = np.uint32(0xFFFFFFFF)  # in place of an element's number
LIKE_PARENT = "as the particle that it splits off"
TAKEN_OUT = 2  # in `broken`, of what an erection has taken out of the net
OTHER_WORKS = ("air", "band", "support")  # beside external, internal and damping: of few scenes


@dataclass(frozen=True)
class Field:
    """One array: what it holds, for each particle or element, and which scenes have it.

    entity : "particle" | "element" | "slot" (an element at one of its ends: rows of (slots, particles))
    needs : "" always, or a feature of `Features`
    kept : changes in the course of a run, so a checkpoint holds it
    split : value of a particle that splits off, LIKE_PARENT: its parent's
    slot_of : the field of elements that a field of slots repeats at both ends
    given : starts with what the model has under that name
    """

    name: str
    entity: str
    tail: tuple[int, ...]
    dtype: type
    unit: str
    meaning: str
    needs: str = ""
    kept: bool = False
    split: float | str = 0
    slot_of: str = ""
    given: bool = False

    @property
    def short(self) -> str:
        """Name in the named tuples of kernels."""
        return self.name.removeprefix("slot_")


def _particle(name, tail, dtype, unit, meaning, needs="", kept=False, split=0, given=False):
    return Field(name, "particle", tail, dtype, unit, meaning, needs, kept, split, given=given)


def _element(name, dtype, unit, meaning, needs="", kept=False, tail=(), given=False):
    return Field(name, "element", tail, dtype, unit, meaning, needs, kept, given=given)


def _slot(name, dtype, unit, meaning, needs="", of=""):
    return Field(name, "slot", (), dtype, unit, meaning, needs, slot_of=of)


AXES, ONE = (3,), ()
BRANCHES = (("a", "band"), ("b", "band"), ("c", "third_branch"))  # of the damping over a band
FIELDS = (
    _particle("x", AXES, np.float64, "m", "position", kept=True, split=LIKE_PARENT, given=True),
    _particle(
        "v",
        AXES,
        np.float64,
        "m/s",
        "velocity, half a step behind the position",
        kept=True,
        split=LIKE_PARENT,
    ),
    _particle(
        "x_start",
        AXES,
        np.float64,
        "m",
        "position from which displacements count",
        kept=True,
        split=LIKE_PARENT,
        given=True,
    ),
    _particle("free", AXES, np.uint8, "", "1 where the axis can move", kept=True, split=1, given=True),
    _particle(
        "mass",
        ONE,
        np.float64,
        "kg",
        "lumped mass: halves of the elements, and what is carried",
        kept=True,
        given=True,
    ),
    _particle("per_mass", ONE, np.float64, "1/kg", "1 / mass; 0 without mass, and where every axis is held"),
    _particle("load", AXES, np.float64, "N", "constant external force", kept=True, given=True),
    _particle("spring", AXES, np.float64, "N/m", "stiffness of the elastic support", "springs", given=True),
    _particle(
        "spring_rest",
        AXES,
        np.float64,
        "m",
        "displacement at which it carries nothing",
        "springs",
        given=True,
    ),
    _particle(
        "turned",
        AXES,
        np.float64,
        "",
        "of supports in axes of their own: unit vector in plan along which it is held, 0: none; and the "
        "stiffness [N/m] of its springs between x and y",
        "turned",
        given=True,
    ),
    _particle("spring_zero", AXES, np.float64, "m", "position at which it carries nothing", "springs"),
    _particle("load_before", AXES, np.float64, "N", "forces that vary, at the last sample", "varying"),
    _particle("load_after", AXES, np.float64, "N", "forces that vary, at the next sample", "varying"),
    _particle("wind", AXES, np.float64, "N s2/m2", "wind force at 1 m/s", "wind", kept=True, given=True),
    _particle("speed_before", ONE, np.float64, "m/s", "wind speed at the last sample", "wind"),
    _particle("speed_after", ONE, np.float64, "m/s", "wind speed at the next sample", "wind"),
    _particle("tapped", ONE, np.uint8, "", "there where these are pressures [N/m2] instead", "tapped"),
    _particle("air", AXES, np.float64, "(kg/m)^1/2", "c of `mechanics.air`", "air", kept=True, given=True),
    _particle("air_pull", (2,), np.float64, "m/s", "of `air.set_air`, at both samples", "air"),
    _particle("air_mass", ONE, np.float64, "kg", "air that moves along", "air_mass", kept=True, given=True),
    _particle(
        "slip",
        AXES,
        np.float64,
        "m",
        "length that has passed, of each cable that slips here",
        "slip",
        kept=True,
    ),
    _particle("slip_v", AXES, np.float64, "m/s", "its velocity, half a step behind", "sliding", kept=True),
    _particle(
        "slip_mass", AXES, np.float64, "kg", "inertia of each, for steps of any length", "sliding", kept=True
    ),
    _particle(
        "slip_load", AXES, np.float64, "N", "constant force on each: of own weight", "sliding", kept=True
    ),
    _particle(
        "slip_locked",
        AXES,
        np.float64,
        "s",
        "time at which a strand was used up there; 0: none was",
        "sliding",
        kept=True,
    ),
    _particle(
        "slip_work",
        AXES,
        np.float64,
        "J",
        "of external and internal forces on slips, and heat of their friction",
        "slip_works",
        kept=True,
    ),
    _particle("friction", AXES, np.float64, "", "coefficient of friction of each", "slip", given=True),
    _particle("resistance", AXES, np.float64, "N", "resistance of the clamp of each", "slip", given=True),
    _particle("valence", ONE, np.int32, "", "elements attached", "fracture", kept=True, split=1, given=True),
    _particle(
        "work", AXES, np.float64, "J", "work of external, internal and damping forces", "energy", kept=True
    ),
    _particle(
        "other_work", AXES, np.float64, "J", "work of what `OTHER_WORKS` names", "other_works", kept=True
    ),
    _particle(
        "ground",
        AXES,
        np.float64,
        "m/s",
        "velocity of the ground below: of an axis that is held half a step on, else now",
        "motion",
    ),
    _particle("bend", AXES, np.float64, "N", "force of chains that bend, at x(n)", "bending"),
    _particle(
        "course",
        ONE,
        np.int32,
        "",
        "how that moves, a row of `ground.Ground`; -1: not at all",
        "motion",
        kept=True,
        split=LIKE_PARENT,
        given=True,
    ),
    _particle("gid", ONE, np.int64, "", "global number"),
    _particle(
        "f", AXES, np.float64, "N", "total force; of all particles if something can break, else of those sent"
    ),
    _element("ends", np.uint32, "", "local numbers of the two particles", tail=(2,)),
    _element("L0", np.float64, "m", "unstressed length", kept=True, given=True),
    _element(
        "EA", np.float64, "N", "axial stiffness; 0: out of the net, or kept by another rank", given=True
    ),
    _element("bar", np.uint8, "", "1 where compression is carried", given=True),
    _element("euler", np.float64, "N", "compression at which it buckles; inf: never", "buckling", given=True),
    _element("half_mass", np.float64, "kg", "half of the element's own mass", given=True),
    _element("strand", np.float64, "m", "unstressed length without slip", "slip", kept=True, given=True),
    _element(
        "slip_place",
        np.int8,
        "",
        "which of the cables at each end it is of, -1: it does not slip there",
        "slip",
        tail=(2,),
        given=True,
    ),
    _element("slip_along", np.int8, "", "1, -1: it runs along its cable, against it", "slip", given=True),
    _element(
        "hold_before", np.float64, "N", "what is left of a lost tension, at the last sample", "slip_fades"
    ),
    _element("hold_after", np.float64, "N", "the same at the next sample", "slip_fades"),
    _element("owned", np.uint8, "", "1 on the one rank that reports the element"),
    _element("broken", np.uint8, "", "1 once it has broken, or is lost; `TAKEN_OUT`", kept=True),
    _element("lost", np.uint8, "", "1 once it is lost", "losses", kept=True),
    _element(
        "highest", np.float64, "N", "largest axial force of a step since the last loss", "peaks", kept=True
    ),
    _element("lowest", np.float64, "N", "smallest axial force of a step since then", "dips", kept=True),
    _element("yield_force", np.float64, "N", "axial force at yield", "plastic", given=True),
    _element("yield_strain", np.float64, "", "strain at yield before any", "plastic_sections"),
    _element("eps_p", np.float64, "", "plastic strain", "plastic", kept=True),
    _element(
        "dissipated",
        np.float64,
        "J",
        "energy lost by yield, and by taking the element out",
        "dissipating",
        kept=True,
    ),
    _element(
        "eps_u",
        np.float64,
        "",
        "strain at fracture, and at which what is left grows longer; inf: never",
        "fracture",
        kept=True,
        given=True,
    ),
    _element(
        "eps_c",
        np.float64,
        "",
        "strain at fracture in compression; -inf: never",
        "crushing",
        kept=True,
        given=True,
    ),
    _element("reach", np.float64, "", "L / L0 from which it is looked at for fracture", "strengths"),
    *(
        _element(f"branch_{k}", np.float64, "N", "H of a branch of the damping over a band", needs, kept=True)
        for k, needs in BRANCHES
    ),
    _element("pending", np.int32, "", "elements that reached eps_u in a step", "fracture"),
    _element("breaks", np.uint8, "", "where those break, as `fracture.decide` has it", "fracture"),
    _slot("other", np.uint32, "", "local number of the far end; in an empty slot the particle's own"),
    _slot("inv_L0", np.float64, "1/m", "1 / unstressed length, 0 in an empty slot"),
    _slot("slot_element", np.uint32, "", "local number of the element", "numbered"),
    _slot("slot_EA", np.float64, "N", "axial stiffness, unless it is the same everywhere", "sections", "EA"),
    _slot("slot_bar", np.uint8, "", "1 where compression is carried", "bars", "bar"),
    _slot("slot_euler", np.float64, "N", "compression at which it buckles", "buckling", "euler"),
    _slot(
        "slot_yield_force",
        np.float64,
        "N",
        "axial force at yield, unless it is the same everywhere",
        "plastic_sections",
        "yield_force",
    ),
    _slot(
        "slot_yield_strain",
        np.float64,
        "",
        "strain at yield before any, unless it is the same everywhere",
        "plastic_sections",
        "yield_strain",
    ),
    _slot("slot_highest", np.float64, "N", "largest axial force of a step since it was filled", "peaks"),
    _slot("slot_lowest", np.float64, "N", "smallest axial force of a step since then", "dips"),
    *(
        _slot(f"slot_branch_{k}", np.float64, "N", "H of a branch", needs, f"branch_{k}")
        for k, needs in BRANCHES
    ),
    _slot("slot_eps_p", np.float64, "", "plastic strain", "plastic", "eps_p"),
    _slot(
        "slot_reach",
        np.float64,
        "",
        "L / L0 from which the element is looked at, unless it is the same everywhere",
        "strengths",
        "reach",
    ),
)


def fields_of(entity: str) -> tuple[Field, ...]:
    """The rows of the table for particles, elements or slots."""
    return tuple(field for field in FIELDS if field.entity == entity)


def _named_tuple(name: str, entity: str):
    return namedtuple(name, [field.short for field in fields_of(entity)], module=__name__)


# What kernels take; a field that the scene does not have is None. Particles: the axes of a field of three
# columns stand in a tuple, each contiguous: the compiler then sees that nothing written is read again.
Particles = _named_tuple("Particles", "particle")
Elements = _named_tuple("Elements", "element")
Slots = _named_tuple("Slots", "slot")


@dataclass(frozen=True)
class Features:
    """What a scene has; the rest costs neither time nor memory."""

    plastic: bool = False
    fracture: bool = False
    wind: bool = False
    air: bool = False  # air damping
    air_mass: bool = False
    band: tuple[float, ...] = ()  # `material.band_branches` of the damping over a band
    tapped: bool = False  # the wind is given as pressures in time, which are not squared
    varying: bool = False  # forces besides the wind that vary in time
    strain: str = "engineering"  # its measure
    bars: bool = False
    bending: bool = False  # chains of bars resist it
    buckling: bool = False  # bars do it, and break both ways
    sections: bool = False  # more than one stiffness or yield force
    strengths: bool = False  # more than one strain at fracture
    springs: bool = False  # elastic supports
    turned: bool = False  # supports in axes of their own
    losses: bool = False  # elements leave the net at given times
    motion: bool = False  # supports move
    slip: bool = False  # cables slip over nodes
    sliding: int = 0  # how many over one node at most, in the dynamic stage
    part_held: bool = False  # some particle is held on some axes and not on others
    energy: bool = True  # the audit of work
    fragments: bool = True  # a particle splits off where an element breaks

    @property
    def inelastic(self) -> bool:
        """Whether elements yield or break."""
        return self.plastic or self.fracture

    @property
    def peaks(self) -> bool:
        """Whether the largest forces of all steps are kept: what breaks lets short waves loose."""
        return self.fracture or self.losses

    @property
    def dips(self) -> bool:
        """Whether the smallest are kept too."""
        return self.losses or (self.fracture and self.bars)

    @property
    def dissipating(self) -> bool:
        """Whether elements turn energy into heat."""
        return self.plastic or self.losses or self.fracture

    @property
    def other_works(self) -> bool:
        """Whether the audit has more than external, internal and damping work."""
        return self.energy and bool(self.air or self.band or self.motion)

    @property
    def third_branch(self) -> bool:
        """Whether the damping over a band has three branches, not two."""
        return len(self.band) == 6

    @property
    def numbered(self) -> bool:
        """Whether the slots know their elements."""
        return self.inelastic or self.peaks or bool(self.sliding or self.band)

    @property
    def slip_works(self) -> bool:
        """Whether the audit has the work of slips."""
        return self.energy and bool(self.sliding)

    @property
    def slip_fades(self) -> bool:
        """Whether what is lost beside a slip may pull for a while."""
        return bool(self.sliding) and self.losses and self.varying

    @property
    def crushing(self) -> bool:
        """Whether elements may break in compression."""
        return self.buckling and self.fracture

    @property
    def plastic_sections(self) -> bool:
        """Whether elements yield at different forces."""
        return self.plastic and self.sections

    def has(self, field: Field) -> bool:
        """Whether the scene has a field."""
        return not field.needs or getattr(self, field.needs)
