"""Table of fields: every array of the solver's state, in one place.

A new row of the table adds a field. The table defines the arrays of a rank (`state.State`) and the records
that kernels take (`Particles`, `Elements`, `Slots`). It also defines the initial values of a particle that
splits off, the content of a checkpoint, and the content of the slots of the step.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types

from netfall.core.records import Record
from netfall.core.text import table_rows

SLOTS = 4  # minimum number of slots per particle; loops over exactly this many are unrolled
EMPTY = np.uint32(0xFFFFFFFF)  # element number of an empty slot
COPY_PARENT = "as the particle that it splits off"
REMOVED_BY_ERECTION = 2  # value of `broken` for an element that an erection stage has removed
OTHER_WORKS = ("air", "band", "support")  # in addition to external, internal and damping work


@dataclass(frozen=True, eq=False)
class Field:
    """Description of one array: its content per particle or element, and the features that need it.

    entity : "particle" | "element" | "slot" (an element at one of its ends: rows of (slots, particles))
    feature : "" always, a feature of `Features`, or cable.KEY: the job gives this key of [cable]
    kept : changes during a run, so a checkpoint holds it
    split : value for a particle that splits off, COPY_PARENT: that of its parent
    slot_of : the element field that a slot field repeats at both ends
    given : initialised from the model's array of that name; with cable.KEY from the values of that key
    """

    name: str
    entity: str
    tail: tuple[int, ...]
    dtype: type[np.generic]
    unit: str
    meaning: str
    feature: str = ""
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

    The mark `split` without a value is COPY_PARENT. The mark `repeats` refers to the element field of the
    same name.
    """
    fields = []
    for name, numbers, unit, needs, mark_text, meaning in table_rows(text):
        dtype, *columns = numbers.split()
        marks = dict(word.partition("=")[::2] for word in mark_text.split())
        split = marks.get("split", "0") or COPY_PARENT
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
free | u1 3 | | | kept given split=1 | 1 if the axis is free
mass | f8 | kg | | kept given | lumped mass: half of each element, and carried mass
per_mass | f8 | 1/kg | | | 1 / mass; 0 without mass, or if every axis is fixed
load | f8 3 | N | | kept given | constant external force
spring | f8 3 | N/m | springs | given | stiffness of the elastic support
spring_rest | f8 3 | m | springs | given | displacement at which the spring carries nothing
turned | f8 3 | | turned | given | supports with rotated axes: unit vector in plan along which the particle is
    held, 0: none; and the x-y coupling stiffness [N/m] of its springs
spring_zero | f8 3 | m | springs | | position at which the spring carries nothing
load_before | f8 3 | N | varying | | time-dependent forces at the last sample
load_after | f8 3 | N | varying | | time-dependent forces at the next sample
wind | f8 3 | N s2/m2 | wind | kept given | wind force at 1 m/s
speed_before | f8 | m/s | wind | | wind speed at the last sample
speed_after | f8 | m/s | wind | | wind speed at the next sample
tapped | u1 | | tapped | | 1 if `speed_before` and `speed_after` are pressures [N/m2] instead
air | f8 3 | (kg/m)^1/2 | air | kept given | c of `physics.air`
air_pull | f8 2 | m/s | air | | factors of `air.set_air_damping_at`, at both samples
air_mass | f8 | kg | air_mass | kept given | added mass of the air
detached | u1 | | detaches | kept | 1 once no path of unbroken elements leads to a support
drag | f8 3 | N | drags | | drag of the relative wind on a detached particle
drag_size | f8 | kg/m | drags | kept given | rho A / 2 of its surface
steady_speed | f8 | m/s | steady_drag | given | mean wind speed, if the wind is given as pressures
slip | f8 3 | m | slip | kept | length that has passed, for each cable that slides here
slip_v | f8 3 | m/s | sliding | kept | velocity of each slip, half a step behind
slip_mass | f8 3 | kg | sliding | kept | inertia of each slip, for steps of any length
slip_load | f8 3 | N | sliding | kept | constant force on each slip: of own weight
slip_locked | f8 3 | s | sliding | kept | time at which a segment became too short; 0: never
slip_work | f8 3 | J | slip_works | kept | work of external and internal forces on slips, and heat of their
    friction
friction | f8 3 | | slip | given | coefficient of friction of each slip
resistance | f8 3 | N | slip | given | slip resistance of the clamp of each slip
valence | i4 | | fracture | kept given split=1 | number of attached elements
loaded | u1 | | fracture | given | 1 if constant forces other than weight act
work | f8 3 | J | energy | kept | work of external, internal and damping forces
other_work | f8 3 | J | other_works | kept | works named in `OTHER_WORKS`
ground | f8 3 | m/s | motion | | velocity of the ground: of a fixed axis half a step later, of a free axis now
bend | f8 3 | N | bending | | force of bending chains at x(n)
course | i4 | | motion | kept given split | course of the ground, a row of `supports.Ground`; -1: none
gid | i8 | | | | global number
f | f8 3 | N | | | total force; current only in boundary chunks and in chunks with an element near a limit
"""
ELEMENTS = """
ends | u4 2 | | | | local numbers of the two particles
L0 | f8 | m | | kept given | unstressed length
EA | f8 | N | | given | axial stiffness; 0: removed, or held by another rank
bar | u1 | | | given | 1 if compression is carried
euler | f8 | N | buckling | given | compression at buckling; inf: never
half_mass | f8 | kg | | given | half of the element's own mass
half_ice | f8 | kg | iced | given | half of the ice on the element
strand | f8 | m | slip | kept given | unstressed length without slip
stage_slip | f8 | | slip | | share of `strand` that slips in the stages of the erection added
slip_place | i1 2 | | slip | given | number of its cable at the slip points at the start and the end of its
    free segment, along the cable; -1: no slip point
slip_at | i8 2 | | slip | | local numbers of the particles of these slip points
slip_share | f8 | | slip | given | share of the unstressed length of its segment
slip_along | i1 | | slip | given | 1 or -1: runs along or against its cable
fading_before | f8 | N | slip_fades | | fading tension of a removed element, at the last sample
fading_after | f8 | N | slip_fades | | fading tension of a removed element, at the next sample
owned | u1 | | | | 1 on the one rank that reports the element
broken | u1 | | | kept | 1 if broken or removed; `REMOVED_BY_ERECTION` by an erection stage
lost | u1 | | losses | kept | 1 if removed
highest | f8 | N | tracks_maxima | kept | largest axial force of a step since the last removal
lowest | f8 | N | tracks_minima | kept | smallest axial force of a step since the last removal
yield_force | f8 | N | plastic | kept given | axial force at yield; inf: never
yield_strain | f8 | | plastic_sections | | strain at first yield
eps_p | f8 | | plastic | kept | plastic strain
dissipated | f8 | J | dissipating | kept | energy dissipated by yield, and by removal of the element
eps_u | f8 | | fracture | kept given | fracture strain; a fragment grows longer at it; inf: never
eps_c | f8 | | crushing | kept given | fracture strain in compression; -inf: never
check_stretch | f8 | | strengths | | L / L0 from which it is checked for fracture
near | f8 | N | varied_limits | | size of the elastic axial force from which it is checked for any limit
branch_a | f8 | N | band | kept | H of a Maxwell branch
branch_b | f8 | N | band | kept | H of a Maxwell branch
branch_c | f8 | N | third_branch | kept | H of a Maxwell branch
pending | i4 | | fracture | | elements that reached eps_u in a step
breaks | u1 | | fracture | | ends at which these break, from `fracture.choose_ends`
"""
SLOTS_OF_ELEMENTS = """
other | u4 | | | | local number of the far end; in an empty slot that of the particle itself
inv_L0 | f8 | 1/m | | | 1 / unstressed length, 0 in an empty slot
slot_element | u4 | | | | local number of the element
slot_EA | f8 | N | sections | repeats | axial stiffness, if it varies
slot_bar | u1 | | bars | repeats | 1 if compression is carried
slot_euler | f8 | N | buckling | repeats | compression at buckling
slot_yield_force | f8 | N | plastic_sections | repeats | axial force at yield, if it varies
slot_yield_strain | f8 | | plastic_sections | repeats | strain at first yield, if it varies
slot_highest | f8 | N | tracks_maxima | | largest axial force of a step since the slot was filled
slot_lowest | f8 | N | tracks_minima | | smallest axial force of a step since the slot was filled
slot_branch_a | f8 | N | band | repeats | H of a Maxwell branch
slot_branch_b | f8 | N | band | repeats | H of a Maxwell branch
slot_branch_c | f8 | N | third_branch | repeats | H of a Maxwell branch
slot_eps_p | f8 | | plastic | repeats | plastic strain
slot_check_stretch | f8 | | strengths | repeats | L / L0 from which the element is checked, if it varies
slot_near | f8 | N | varied_limits | repeats | size of the elastic axial force from which the element is
    checked, if it varies
"""
FIELDS = _fields("particle", PARTICLES) + _fields("element", ELEMENTS) + _fields("slot", SLOTS_OF_ELEMENTS)


def fields_of(entity: str) -> tuple[Field, ...]:
    """Return the rows of the table for particles, elements or slots."""
    return tuple(field for field in FIELDS if field.entity == entity)


def _kinds(entity: str) -> dict[str, types.Type]:
    """Return the types in kernels of an entity's arrays; particles and slots: (axes or slots, particles)."""
    kinds: dict[str, types.Type] = {}
    for field in fields_of(entity):
        axes = 2 if field.tail or entity == "slot" else 1
        kinds[field.short] = types.Array(from_dtype(np.dtype(field.dtype)), axes, "C")
    return kinds


class _Table(Record, fields={}):
    """Record whose fields are rows of the table."""

    if TYPE_CHECKING:

        def __getattr__(self: Any, name: str) -> Any: ...


class Particles(_Table, fields=_kinds("particle")):
    """Arrays of particles, (axes, particles) or (particles,)."""


class Elements(_Table, fields=_kinds("element")):
    """Arrays of elements, (elements, columns) or (elements,)."""


class Slots(_Table, fields=_kinds("slot")):
    """Arrays of slots (slots, particles)."""


@dataclass(frozen=True)
class Features:
    """Features of a problem; absent features cost neither time nor memory."""

    plastic: bool = False
    fracture: bool = False
    wind: bool = False
    air: bool = False  # air damping
    air_mass: bool = False
    band: tuple[float, ...] = ()  # Maxwell branches, from `law.branches.band_branches`
    tapped: bool = False  # the wind is given as pressures, which are not squared
    varying: bool = False  # other forces than wind that vary in time
    strain: str = "engineering"  # strain measure
    cable: tuple[str, ...] = ()  # keys of [cable] that the job gives, also those of its groups alone
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
    shaken: bool = False  # loads act at once, or supports move
    part_held: bool = False  # some particle is fixed on some axes only
    energy: bool = True  # energy checks
    fragments: bool = True  # a particle splits off where an element breaks
    detaches: bool = False  # parts may be cut free
    iced: bool = False  # ice on elements that may break
    drags: bool = False  # relative wind acts on detached parts
    steady_drag: bool = False  # with a mean speed, because the wind is given as pressures

    @property
    def inelastic(self) -> bool:
        """Whether elements yield or break."""
        return self.plastic or self.fracture

    @property
    def tracks_maxima(self) -> bool:
        """Whether the largest forces of all steps are stored, because vibrations may be short."""
        return self.shaken or self.inelastic or self.losses

    @property
    def tracks_minima(self) -> bool:
        """Whether the smallest forces of all steps are stored too."""
        return self.losses or (self.tracks_maxima and self.bars)

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
    def varied_limits(self) -> bool:
        """Whether the limit force from which an element is checked differs between elements."""
        return self.buckling or (self.inelastic and (self.sections or self.strengths))

    @property
    def plastic_sections(self) -> bool:
        """Whether the yield force differs between elements."""
        return self.plastic and self.sections

    def has(self, field: Field) -> bool:
        """Return whether the problem has a field."""
        _, is_key, key = field.feature.partition("cable.")
        if is_key:
            return key in self.cable
        return not field.feature or bool(getattr(self, field.feature))
