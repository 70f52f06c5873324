"""The arrays of one rank, allocated from one table of fields.

A field is added by adding a row. Particles: owned first, then halo, then those that split off (owned too);
arrays have spare rows for the latter and grow when these are used up. What a scene does not have is None.
"""

from dataclasses import dataclass

import numpy as np

from netfall.mechanics.kernels import element_state


@dataclass(frozen=True)
class Field:
    """One array: what it holds, for each particle or element, and which scenes have it."""

    name: str
    entity: str  # "particle" | "element"
    tail: tuple[int, ...]
    dtype: type
    unit: str
    meaning: str
    needs: str = ""  # "" always, or a feature of `Scene`
    kept: bool = False  # changes in the course of a run, so a checkpoint holds it


FIELDS = (
    Field("x", "particle", (3,), np.float64, "m", "position", kept=True),
    Field("v", "particle", (3,), np.float64, "m/s", "velocity, half a step behind the position", kept=True),
    Field("x_start", "particle", (3,), np.float64, "m", "position in the initial state, from which displacements count", kept=True),
    Field("free", "particle", (3,), np.uint8, "", "1 where the axis can move", kept=True),
    Field("mass", "particle", (), np.float64, "kg", "lumped mass: halves of the elements and what is carried", kept=True),
    Field("load", "particle", (3,), np.float64, "N", "constant external force", kept=True),
    Field("wind", "particle", (3,), np.float64, "N s2/m2", "wind force at 1 m/s", "wind", kept=True),
    Field("speed_before", "particle", (), np.float64, "m/s", "wind speed at the last sample", "wind"),
    Field("speed_after", "particle", (), np.float64, "m/s", "wind speed at the next sample", "wind"),
    Field("valence", "particle", (), np.int32, "", "elements attached", "fracture", kept=True),
    Field("work", "particle", (3,), np.float64, "J", "work of external, internal and damping forces", kept=True),
    Field("gid", "particle", (), np.int64, "", "global number"),
    Field("f", "particle", (3,), np.float64, "N", "total force"),
    Field("f_int", "particle", (3,), np.float64, "N", "internal force"),
    Field("ends", "element", (2,), np.uint32, "", "local numbers of the two particles"),
    Field("L0", "element", (), np.float64, "m", "unstressed length"),
    Field("EA", "element", (), np.float64, "N", "axial stiffness"),
    Field("bar", "element", (), np.uint8, "", "1 where compression is carried"),
    Field("half_mass", "element", (), np.float64, "kg", "half of the element's own mass"),
    Field("owned", "element", (), np.uint8, "", "1 on the one rank that reports the element"),
    Field("broken", "element", (), np.uint8, "", "1 once it has parted", kept=True),
    Field("yield_force", "element", (), np.float64, "N", "axial force at yield", "plastic"),
    Field("eps_p", "element", (), np.float64, "", "plastic strain", "plastic", kept=True),
    Field("dissipated", "element", (), np.float64, "J", "energy turned into heat by flow", "plastic", kept=True),
    Field("eps_u", "element", (), np.float64, "", "strain at fracture, inf once broken", "fracture", kept=True),
    Field("pending", "element", (), np.int32, "", "elements that reached eps_u in a step", "fracture"),
)


@dataclass(frozen=True)
class Scene:
    """What a scene has; the rest costs neither time nor memory."""

    plastic: bool = False
    fracture: bool = False
    wind: bool = False
    logarithmic: bool = False


class State:
    """Arrays of one rank as attributes, named as in FIELDS; absent ones are None."""

    def __init__(self, scene: Scene, n_owned: int, n_halo: int, m: int):
        self.scene = scene
        self.n_owned, self.n_halo, self.m = n_owned, n_halo, m
        self.n_local = n_owned + n_halo  # rows of particles in use; more after splits
        for field in FIELDS:
            rows = m if field.entity == "element" else self.n_local
            there = not field.needs or getattr(scene, field.needs)
            setattr(self, field.name, np.zeros((rows, *field.tail), field.dtype) if there else None)

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
            if field.entity == "particle" and array is not None:
                grown = np.zeros((self.n_local + spare, *field.tail), field.dtype)
                grown[: self.n_local] = array[: self.n_local]
                setattr(self, field.name, grown)

    def copy(self) -> "State":
        """A copy of all arrays."""
        other = object.__new__(State)
        other.__dict__ = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in self.__dict__.items()}
        return other

    def elements_now(self):
        """Axial force [N], strain, plastic strain and length [m] of the elements (m,) at the present positions."""
        N, eps, eps_p_now, L = (np.empty(self.m) for _ in range(4))
        element_state(self.x, self.ends, self.L0, self.EA, self.scene.logarithmic, self.bar, self.yield_force, self.eps_p, N, eps, eps_p_now, L)
        return N, eps, eps_p_now, L
