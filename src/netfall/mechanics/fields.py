"""Table of fields: every array of the solver's state, in one place.

A new row of the table adds a field. The table defines the arrays of a rank (`state.State`) and the records
that kernels take (`Particles`, `Elements`, `Slots`). It also defines the initial values of a particle that
splits off, the content of a checkpoint, and the content of the slots of the step.
"""

from dataclasses import dataclass

import numpy as np
from numba import from_dtype, types

from netfall.core.records import Record
from netfall.ground.text_tables import rows_of

SLOTS = 4  # minimum number of slots per particle; loops over exactly this many are unrolled
EMPTY = np.uint32(0xFFFFFFFF)  # element number of an empty slot
LIKE_PARENT = "as the particle that it splits off"
TAKEN_OUT = 2  # value of `broken` for an element that an erection stage has removed
OTHER_WORKS = ("air", "band", "support")  # in addition to external, internal and damping work


@dataclass(frozen=True, eq=False)
class Field:
    """Description of one array: its content per particle or element, and the features that need it.

    entity : "particle" | "element" | "slot" (an element at one of its ends: rows of (slots, particles))
    needs : "" always, or a feature of `Features`
    kept : changes during a run, so a checkpoint holds it
    split : value for a particle that splits off, LIKE_PARENT: that of its parent
    slot_of : the element field that a slot field repeats at both ends
    given : initialised from the model's array of that name
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
        """Name in the records of kernels."""
        return self.name.removeprefix("slot_")


def _fields(entity: str, text: str) -> tuple[Field, ...]:
    """Parse the rows of an entity. Their cells: name; dtype, columns; unit; needs; marks; meaning.

    The mark `split` without a value is LIKE_PARENT. The mark `repeats` refers to the element field of the
    same name.
    """
    fields = []
    for name, numbers, unit, needs, mark_text, meaning in rows_of(text):
        dtype, *columns = numbers.split()
        marks = dict(word.partition("=")[::2] for word in mark_text.split())
        split = marks.get("split", "0") or LIKE_PARENT
        fields.append(
            Field(
                name,
                entity,
                tuple(map(int, columns)),
                np.dtype(dtype).type,
                unit,
                meaning,
                needs,
                "kept" in marks,
                int(split) if split.isdecimal() else split,
                name.removeprefix("slot_") if "repeats" in marks else "",
                "given" in marks,
            )
        )
    return tuple(fields)


PARTICLES = """
x | f8 3 | m | | kept given split | position
v | f8 3 | m/s | | kept split | velocity, half a step behind the position
x_start | f8 3 | m | | kept given split | position from which displacements count
free | u1 3 | | | kept given split=1 | 1 where the axis can move
mass | f8 | kg | | kept given | lumped mass: halves of the elements, and what is carried
per_mass | f8 | 1/kg | | | 1 / mass; 0 without mass, and where every axis is held
load | f8 3 | N | | kept given | constant external force
spring | f8 3 | N/m | springs | given | stiffness of the elastic support
spring_rest | f8 3 | m | springs | given | displacement at which it carries nothing
turned | f8 3 | | turned | given | of supports in axes of their own: unit vector in plan along which it is
    held, 0: none; and the stiffness [N/m] of its springs between x and y
spring_zero | f8 3 | m | springs | | position at which it carries nothing
load_before | f8 3 | N | varying | | forces that vary, at the last sample
load_after | f8 3 | N | varying | | forces that vary, at the next sample
wind | f8 3 | N s2/m2 | wind | kept given | wind force at 1 m/s
speed_before | f8 | m/s | wind | | wind speed at the last sample
speed_after | f8 | m/s | wind | | wind speed at the next sample
tapped | u1 | | tapped | | there where these are pressures [N/m2] instead
air | f8 3 | (kg/m)^1/2 | air | kept given | c of `mechanics.air`
air_pull | f8 2 | m/s | air | | of `air.set_air`, at both samples
air_mass | f8 | kg | air_mass | kept given | air that moves along
detached | u1 | | detaches | kept | 1 once no path of unbroken elements leads to a support
drag | f8 3 | N | drags | | force of the relative wind, where it is detached
drag_size | f8 | kg/m | drags | kept given | rho A / 2 of its surface
steady_speed | f8 | m/s | drags_steadily | given | mean wind speed, where the wind is given as pressures
slip | f8 3 | m | slip | kept | length that has passed, of each cable that slips here
slip_v | f8 3 | m/s | sliding | kept | its velocity, half a step behind
slip_mass | f8 3 | kg | sliding | kept | inertia of each, for steps of any length
slip_load | f8 3 | N | sliding | kept | constant force on each: of own weight
slip_locked | f8 3 | s | sliding | kept | time at which a strand was used up there; 0: none was
slip_work | f8 3 | J | slip_works | kept | of external and internal forces on slips, and heat of their
    friction
friction | f8 3 | | slip | given | coefficient of friction of each
resistance | f8 3 | N | slip | given | resistance of the clamp of each
valence | i4 | | fracture | kept given split=1 | elements attached
work | f8 3 | J | energy | kept | work of external, internal and damping forces
other_work | f8 3 | J | other_works | kept | work of what `OTHER_WORKS` names
ground | f8 3 | m/s | motion | | velocity of the ground below: of an axis that is held half a step on, else
    now
bend | f8 3 | N | bending | | force of chains that bend, at x(n)
course | i4 | | motion | kept given split | how that moves, a row of `ground.Ground`; -1: not at all
gid | i8 | | | | global number
f | f8 3 | N | | | total force; of all particles if something can break, else of those sent
"""
ELEMENTS = """
ends | u4 2 | | | | local numbers of the two particles
L0 | f8 | m | | kept given | unstressed length
EA | f8 | N | | given | axial stiffness; 0: out of the net, or kept by another rank
bar | u1 | | | given | 1 where compression is carried
euler | f8 | N | buckling | given | compression at which it buckles; inf: never
half_mass | f8 | kg | | given | half of the element's own mass
strand | f8 | m | slip | kept given | unstressed length without slip
slip_place | i1 2 | | slip | given | which of the cables over the slip points at the begin and the end of its
    free segment, along the cable, it is of, -1: there is none
slip_at | i8 2 | | slip | | local numbers of the particles of these slip points
slip_share | f8 | | slip | given | of the unstressed length of its segment
slip_along | i1 | | slip | given | 1, -1: it runs along its cable, against it
hold_before | f8 | N | slip_fades | | what is left of a lost tension, at the last sample
hold_after | f8 | N | slip_fades | | the same at the next sample
owned | u1 | | | | 1 on the one rank that reports the element
broken | u1 | | | kept | 1 once it has broken, or is lost; `TAKEN_OUT`
lost | u1 | | losses | kept | 1 once it is lost
highest | f8 | N | peaks | kept | largest axial force of a step since the last loss
lowest | f8 | N | dips | kept | smallest axial force of a step since then
yield_force | f8 | N | plastic | given | axial force at yield
yield_strain | f8 | | plastic_sections | | strain at yield before any
eps_p | f8 | | plastic | kept | plastic strain
dissipated | f8 | J | dissipating | kept | energy lost by yield, and by taking the element out
eps_u | f8 | | fracture | kept given | strain at fracture, and at which what is left grows longer; inf: never
eps_c | f8 | | crushing | kept given | strain at fracture in compression; -inf: never
reach | f8 | | strengths | | L / L0 from which it is looked at for fracture
near | f8 | N | unlike_limits | | size of the elastic axial force from which it is looked at for any limit
branch_a | f8 | N | band | kept | H of a branch of the damping over a band
branch_b | f8 | N | band | kept | H of a branch of the damping over a band
branch_c | f8 | N | third_branch | kept | H of a branch of the damping over a band
pending | i4 | | fracture | | elements that reached eps_u in a step
breaks | u1 | | fracture | | where those break, as `fracture.decide` has it
"""
SLOTS_OF_ELEMENTS = """
other | u4 | | | | local number of the far end; in an empty slot the particle's own
inv_L0 | f8 | 1/m | | | 1 / unstressed length, 0 in an empty slot
slot_element | u4 | | numbered | | local number of the element
slot_EA | f8 | N | sections | repeats | axial stiffness, unless it is the same everywhere
slot_bar | u1 | | bars | repeats | 1 where compression is carried
slot_euler | f8 | N | buckling | repeats | compression at which it buckles
slot_yield_force | f8 | N | plastic_sections | repeats | axial force at yield, unless it is the same
    everywhere
slot_yield_strain | f8 | | plastic_sections | repeats | strain at yield before any, unless it is the
    same everywhere
slot_highest | f8 | N | peaks | | largest axial force of a step since it was filled
slot_lowest | f8 | N | dips | | smallest axial force of a step since then
slot_branch_a | f8 | N | band | repeats | H of a branch
slot_branch_b | f8 | N | band | repeats | H of a branch
slot_branch_c | f8 | N | third_branch | repeats | H of a branch
slot_eps_p | f8 | | plastic | repeats | plastic strain
slot_reach | f8 | | strengths | repeats | L / L0 from which the element is looked at, unless it is the same
    everywhere
slot_near | f8 | N | unlike_limits | repeats | size of the elastic axial force from which the element is
    looked at, unless it is the same everywhere
"""
FIELDS = _fields("particle", PARTICLES) + _fields("element", ELEMENTS) + _fields("slot", SLOTS_OF_ELEMENTS)


def fields_of(entity: str) -> tuple[Field, ...]:
    """Return the rows of the table for particles, elements or slots."""
    return tuple(field for field in FIELDS if field.entity == entity)


def _record(name: str, entity: str) -> type[Record]:
    """Create the record class of an entity's arrays; particles and slots: (axes or slots, particles)."""
    kinds = {}
    for field in fields_of(entity):
        axes = 2 if field.tail or entity == "slot" else 1
        kinds[field.short] = types.Array(from_dtype(np.dtype(field.dtype)), axes, "C")
    return type(name, (Record,), {"__annotations__": kinds, "__module__": __name__})


Particles = _record("Particles", "particle")
Elements = _record("Elements", "element")
Slots = _record("Slots", "slot")


@dataclass(frozen=True)
class Features:
    """Features of a problem; what it lacks costs neither time nor memory."""

    plastic: bool = False
    fracture: bool = False
    wind: bool = False
    air: bool = False  # air damping
    air_mass: bool = False
    band: tuple[float, ...] = ()  # Maxwell branches, from `law.branches.band_branches`
    tapped: bool = False  # the wind is given as pressures, which are not squared
    varying: bool = False  # other forces than wind that vary in time
    strain: str = "engineering"  # strain measure
    bars: bool = False
    bending: bool = False  # bending chains
    buckling: bool = False  # bars buckle, and may break in compression too
    sections: bool = False  # different stiffnesses or yield forces
    strengths: bool = False  # different fracture strains
    springs: bool = False  # elastic supports
    turned: bool = False  # supports with rotated axes
    losses: bool = False  # members are removed at given times
    motion: bool = False  # supports move
    slip: bool = False  # sliding cables
    sliding: int = 0  # largest number over one node, in the dynamic stage
    part_held: bool = False  # some particle is fixed on some axes only
    energy: bool = True  # energy checks
    fragments: bool = True  # a particle splits off where an element breaks
    detaches: bool = False  # parts may be cut free
    drags: bool = False  # relative wind acts on detached parts
    drags_steadily: bool = False  # with a mean speed, because the wind is given as pressures

    @property
    def inelastic(self) -> bool:
        """Whether elements yield or break."""
        return self.plastic or self.fracture

    @property
    def peaks(self) -> bool:
        """Whether the largest forces of all steps are stored: fracture and removal cause short waves."""
        return self.fracture or self.losses

    @property
    def dips(self) -> bool:
        """Whether the smallest forces of all steps are stored too."""
        return self.losses or (self.fracture and self.bars)

    @property
    def dissipating(self) -> bool:
        """Whether elements dissipate energy."""
        return self.plastic or self.losses or self.fracture

    @property
    def other_works(self) -> bool:
        """Whether the energy check has other works than external, internal and damping."""
        return self.energy and bool(self.air or self.band or self.motion)

    @property
    def third_branch(self) -> bool:
        """Whether the axial damping has three Maxwell branches, not two."""
        return len(self.band) == 6

    @property
    def numbered(self) -> bool:
        """Whether slots store the numbers of their elements."""
        return self.inelastic or self.peaks or bool(self.sliding or self.band)

    @property
    def slip_works(self) -> bool:
        """Whether the energy check includes the work of slips."""
        return self.energy and bool(self.sliding)

    @property
    def slip_fades(self) -> bool:
        """Whether the tension of a removed element next to a slip point fades over time."""
        return bool(self.sliding) and self.losses and self.varying

    @property
    def crushing(self) -> bool:
        """Whether elements may break in compression."""
        return self.buckling and self.fracture

    @property
    def unlike_limits(self) -> bool:
        """Whether the limit force from which an element is checked differs between elements."""
        return self.buckling or (self.inelastic and (self.sections or self.strengths))

    @property
    def plastic_sections(self) -> bool:
        """Whether the yield force differs between elements."""
        return self.plastic and self.sections

    def has(self, field: Field) -> bool:
        """Return whether the problem has a field."""
        return not field.needs or getattr(self, field.needs)
