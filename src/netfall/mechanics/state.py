"""The arrays of one rank, allocated from one table of fields.

A field is added by adding a row. Particles: owned first, then halo, then those that split off (owned too);
arrays have spare rows for the latter and grow when these are used up. What a scene does not have is None.
"""

from dataclasses import dataclass

import numpy as np

from netfall.mechanics.kernels import (
    REGISTER,
    SLOTS,
    align_slots,
    attach_slots,
    element_state,
    empty_slots,
    fill_slots,
)
from netfall.mechanics.material import NEARLY, NEARLY_SINGLE

STEPPED, SUMMED = (
    "precision of the steps",
    "precision of the displacements",
)  # instead of a data type: `Scene` has it


@dataclass(frozen=True)
class Field:
    """One array: what it holds, for each particle or element, and which scenes have it."""

    name: str
    entity: str  # "particle" | "element" | "slot" (an element at one of its ends: rows of (slots, particles))
    tail: tuple[int, ...]
    dtype: type | str
    unit: str
    meaning: str
    needs: str = ""  # "" always, or a feature of `Scene`
    kept: bool = False  # changes in the course of a run, so a checkpoint holds it


FIELDS = (
    Field(
        "x",
        "particle",
        (3,),
        np.float64,
        "m",
        "position; if displacements are stepped, brought up to date at the end of a block of steps",
        kept=True,
    ),
    Field("u", "particle", (3,), SUMMED, "m", "displacement", "displaced", kept=True),
    Field(
        "u_rounded",
        "particle",
        (3,),
        STEPPED,
        "m",
        "the same in the precision of the steps, for the forces",
        "mixed",
    ),
    Field("v", "particle", (3,), STEPPED, "m/s", "velocity, half a step behind the position", kept=True),
    Field(
        "x_start",
        "particle",
        (3,),
        np.float64,
        "m",
        "position in the initial state, from which displacements count",
        kept=True,
    ),
    Field("free", "particle", (3,), np.uint8, "", "1 where the axis can move", kept=True),
    Field(
        "mass",
        "particle",
        (),
        np.float64,
        "kg",
        "lumped mass: halves of the elements and what is carried",
        kept=True,
    ),
    Field(
        "per_mass", "particle", (), STEPPED, "1/kg", "1 / mass; 0 without mass, and where every axis is held"
    ),
    Field("stepped_mass", "particle", (), STEPPED, "kg", "mass in the precision of the steps", "block_work"),
    Field("load", "particle", (3,), STEPPED, "N", "constant external force", kept=True),
    Field("wind", "particle", (3,), STEPPED, "N s2/m2", "wind force at 1 m/s", "wind", kept=True),
    Field("speed_before", "particle", (), STEPPED, "m/s", "wind speed at the last sample", "wind"),
    Field("speed_after", "particle", (), STEPPED, "m/s", "wind speed at the next sample", "wind"),
    Field("valence", "particle", (), np.int32, "", "elements attached", "fracture", kept=True),
    Field(
        "work",
        "particle",
        (3,),
        np.float64,
        "J",
        "work of external, internal and damping forces",
        "energy",
        kept=True,
    ),
    Field(
        "block_work", "particle", (3,), STEPPED, "J", "the same in the present block of steps", "block_work"
    ),
    Field("gid", "particle", (), np.int64, "", "global number"),
    Field(
        "f",
        "particle",
        (3,),
        STEPPED,
        "N",
        "total force; kept of all particles if something can break, else of those that are sent",
    ),
    Field("ends", "element", (2,), np.uint32, "", "local numbers of the two particles"),
    Field("L0", "element", (), np.float64, "m", "unstressed length"),
    Field("EA", "element", (), np.float64, "N", "axial stiffness"),
    Field("bar", "element", (), np.uint8, "", "1 where compression is carried"),
    Field("half_mass", "element", (), np.float64, "kg", "half of the element's own mass"),
    Field("owned", "element", (), np.uint8, "", "1 on the one rank that reports the element"),
    Field("broken", "element", (), np.uint8, "", "1 once it has parted", kept=True),
    Field("yield_force", "element", (), np.float64, "N", "axial force at yield", "plastic"),
    Field("eps_p", "element", (), np.float64, "", "plastic strain", "plastic", kept=True),
    Field(
        "dissipated",
        "element",
        (),
        np.float64,
        "J",
        "energy turned into heat by flow, and what was stored in an element that was taken out",
        "dissipating",
        kept=True,
    ),
    Field(
        "eps_u", "element", (), np.float64, "", "strain at fracture, inf once broken", "fracture", kept=True
    ),
    Field("pending", "element", (), np.int32, "", "elements that reached eps_u in a step", "fracture"),
    Field(
        "other", "slot", (), np.uint32, "", "local number of the far end; the particle's own in an empty slot"
    ),
    Field("inv_L0", "slot", (), STEPPED, "1/m", "1 / unstressed length, 0 in an empty slot"),
    Field(
        "start_x",
        "slot",
        (),
        STEPPED,
        "m",
        "from x_start of the particle to that of the far end",
        "displaced",
    ),
    Field("start_y", "slot", (), STEPPED, "m", "the same along y", "displaced"),
    Field("start_z", "slot", (), STEPPED, "m", "the same along z", "displaced"),
    Field("start_excess", "slot", (), STEPPED, "", "(L / L0)^2 - 1 there", "displaced"),
    Field("slot_element", "slot", (), np.uint32, "", "local number of the element", "inelastic"),
    Field(
        "slot_EA", "slot", (), STEPPED, "N", "axial stiffness, unless it is the same everywhere", "sections"
    ),
    Field("slot_bar", "slot", (), np.uint8, "", "1 where compression is carried", "bars"),
    Field(
        "slot_yield",
        "slot",
        (),
        STEPPED,
        "N",
        "axial force at yield, unless it is the same everywhere",
        "plastic_sections",
    ),
    Field("slot_eps_p", "slot", (), STEPPED, "", "plastic strain", "plastic"),
)


@dataclass(frozen=True)
class Scene:
    """What a scene has; the rest costs neither time nor memory."""

    plastic: bool = False
    fracture: bool = False
    wind: bool = False
    logarithmic: bool = False
    bars: bool = False
    sections: bool = False  # more than one stiffness or yield force
    part_held: bool = False  # some particle is held on some axes and not on others
    energy: bool = True  # the audit of work
    fragments: bool = True  # a particle splits off where an element breaks
    precision: str = "double"  # mixed: forces and velocities in single precision; single: displacements too

    @property
    def displaced(self) -> bool:
        """Whether displacements are stepped, not positions, whose digits single precision would lose."""
        return self.precision != "double"

    @property
    def mixed(self) -> bool:
        """Whether displacements are summed up in another precision than the rest."""
        return self.precision == "mixed"

    @property
    def block_work(self) -> bool:
        """Whether work is summed up in single precision within a block of steps."""
        return self.energy and self.displaced

    def number(self, dtype) -> np.dtype:
        """The data type of a field."""
        if dtype in (STEPPED, SUMMED):
            return np.dtype(
                np.float32 if self.precision == "single" or self.mixed and dtype == STEPPED else np.float64
            )
        return np.dtype(dtype)

    @property
    def lanes(self) -> int:
        """Numbers of a register in the precision of the steps."""
        return REGISTER // self.number(STEPPED).itemsize

    @property
    def inelastic(self) -> bool:
        """Whether elements flow or break."""
        return self.plastic or self.fracture

    @property
    def dissipating(self) -> bool:
        """Whether elements turn energy into heat."""
        return self.plastic or self.fracture and not self.fragments

    @property
    def plastic_sections(self) -> bool:
        """Whether elements flow at different forces."""
        return self.plastic and self.sections


class State:
    """Arrays of one rank as attributes, named as in FIELDS; absent ones are None."""

    def __init__(self, scene: Scene, n_owned: int, n_halo: int, m: int, width: int = SLOTS):
        """width : most elements at a particle"""
        self.scene = scene
        self.width = max(width, SLOTS)
        self.n_owned, self.n_halo, self.m = n_owned, n_halo, m
        self.n_local = n_owned + n_halo  # rows of particles in use; more after splits
        for field in FIELDS:
            rows = m if field.entity == "element" else self.n_local
            there = not field.needs or getattr(scene, field.needs)
            setattr(self, field.name, self._zeros(field, rows) if there else None)

    def _zeros(self, field: Field, rows: int) -> np.ndarray:
        """An array of that many elements or particles; a particle's axes stand apart, each contiguous, for vector loops."""
        dtype = self.scene.number(field.dtype)
        if field.entity == "slot":
            return np.zeros((self.width, rows), dtype)
        return np.zeros((rows, *field.tail), dtype, order="C" if field.entity == "element" else "F")

    def fill_slots(self, chunks) -> None:
        """Put the elements, as they are attached now, into the slots of the particles that this rank steps.

        chunks : first and last particle of each stretch that is stepped at once, in which runs are worth having
        """
        s = self
        filled = np.zeros(s.n_local, np.int32)
        slot_element = np.empty_like(s.other) if s.slot_element is None else s.slot_element
        attach_slots(s.n_owned, s.first_split, s.n_local, s.ends, s.EA, s.other, slot_element, filled)
        for low, high in chunks:
            align_slots(low + 1, high, 1, s.n_local, s.other, slot_element, filled)
            align_slots(high - 2, low - 1, -1, s.n_local, s.other, slot_element, filled)
        fill_slots(
            s.n_local,
            slot_element,
            s.L0,
            s.EA,
            s.bar,
            s.yield_force,
            s.eps_p,
            s.x_start,
            s.other,
            s.start,
            s.inv_L0,
            s.slot_EA,
            s.slot_bar,
            s.slot_yield,
            s.slot_eps_p,
        )

    def empty_slots(self, e: int) -> None:
        """Take element e out of the slots of its ends, where nothing else changes."""
        for p in self.ends[e].tolist():
            empty_slots(np.uint32(e), p, self.slot_element, self.start, self.inv_L0, self.slot_bar)

    def invert_masses(self) -> None:
        """Bring per_mass up to date."""
        moves = self.free.any(1) & (self.mass > 0.0)
        self.per_mass[:] = np.divide(1.0, self.mass, out=np.zeros_like(self.mass), where=moves)
        if self.stepped_mass is not None:
            self.stepped_mass[:] = self.mass

    @property
    def start(self) -> tuple[np.ndarray, ...] | None:
        """What the forces of displacements count from, as in `kernels.kick_rows`; None if positions are stepped."""
        return (self.start_x, self.start_y, self.start_z, self.start_excess) if self.scene.displaced else None

    def count_displacements(self) -> None:
        """Bring displacements up to date with positions that something else than the steps has changed."""
        if self.scene.displaced:
            self.u[:] = self.x - self.x_start
            self.place()
        self.round_displacements()

    def round_displacements(self) -> None:
        """Bring the displacements that the forces read up to date."""
        if self.u_rounded is not None:
            self.u_rounded[:] = self.u

    def place(self) -> None:
        """Bring positions up to date with the displacements that were stepped."""
        if self.scene.displaced:
            np.add(self.x_start, self.u, out=self.x)

    def end_block(self) -> None:
        """At the end of a block of steps, the same for all ranks: positions, and the work done in it."""
        self.place()
        if self.block_work is not None:
            self.work += self.block_work
            self.block_work[:] = 0.0

    @property
    def reach(self) -> float | None:
        """L / L0 beyond which some element may break; None if nothing can."""
        if self.eps_u is None:
            return None
        least = self.eps_u.min(initial=np.inf)
        return float(np.exp(least) if self.scene.logarithmic else 1.0 + least) * (
            NEARLY_SINGLE if self.scene.displaced else NEARLY
        )

    @property
    def first_split(self) -> int:
        """Local row of the first particle that split off."""
        return self.n_owned + self.n_halo

    def own(self, p: int) -> bool:
        """Whether this rank owns the particle in local row p."""
        return p < self.n_owned or p >= self.first_split

    def owned_rows(self) -> np.ndarray:
        """Local rows of the particles that this rank owns."""
        return np.concatenate([np.arange(self.n_owned), np.arange(self.first_split, self.n_local)])

    def reserve(self, particles: int) -> None:
        """Make room for more particles to split off."""
        capacity = len(self.x)
        if self.n_local + particles <= capacity:
            return
        spare = max(64, particles, capacity // 8)
        for field in FIELDS:
            array = getattr(self, field.name)
            if field.entity != "element" and array is not None:
                grown = self._zeros(field, self.n_local + spare)
                used = (slice(None), slice(self.n_local)) if field.entity == "slot" else slice(self.n_local)
                grown[used] = array[used]
                setattr(self, field.name, grown)

    def copy(self) -> "State":
        """A copy of all arrays."""
        other = object.__new__(State)
        other.__dict__ = {
            k: v.copy(order="K") if isinstance(v, np.ndarray) else v for k, v in self.__dict__.items()
        }
        return other

    def elements_now(self):
        """Axial force [N], strain, plastic strain and length [m] of the elements (m,) at the present positions."""
        N, eps, eps_p_now, L = (np.empty(self.m) for _ in range(4))
        element_state(
            self.x,
            self.ends,
            self.L0,
            self.EA,
            self.scene.logarithmic,
            self.bar,
            self.yield_force,
            self.eps_p,
            N,
            eps,
            eps_p_now,
            L,
        )
        return N, eps, eps_p_now, L
