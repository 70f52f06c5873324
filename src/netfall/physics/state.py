"""Arrays of one rank, allocated from the table of fields.

Owned particles come first, then the halo, then those that split off, which are owned too. Arrays have spare
rows for the latter, and grow when these are used up. Fields that the problem lacks are None.
"""

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from netfall.core.arrays import AnyArray, allocate_columns
from netfall.core.records import Record, empty
from netfall.core.vectors import LANES
from netfall.physics import fields
from netfall.physics.air import RelativeWind
from netfall.physics.bending import Joints, joint_moments
from netfall.physics.elements import ElementState, compute_element_state
from netfall.physics.law.law import LawParameters, build_law, check_forces, check_stretches

MIN_SPARE_ROWS = 64  # rows allocated at once for particles that may split off
SAVED_FIELDS = ("x", "eps_p", "dissipated", "L0", "spring_rest", "strand", "slip")


AnyRecord = TypeVar("AnyRecord", bound=Record)


class State:
    """Arrays of one rank as attributes, named as in FIELDS; absent ones are None."""

    if TYPE_CHECKING:

        def __getattr__(self: Any, name: str) -> AnyArray:
            """Return an array of FIELDS. Whether it can be None is not checked."""

    def __init__(
        self, features: fields.Features, n_owned: int, n_halo: int, m: int, width: int = fields.SLOTS
    ):
        """Allocate the arrays; width : largest number of elements at a particle."""
        self.features = features
        self.width = max(width, fields.SLOTS)
        self.n_owned, self.n_halo, self.m = n_owned, n_halo, m
        self.rows = np.array([n_owned + n_halo])  # particle rows in use; splits add more
        # by name: arrays as kernels take them, padded at the end of each row
        self._whole: dict[str, AnyArray] = {}
        for field in fields.FIELDS:
            rows = m if field.entity == "element" else self.n_local
            if features.has(field):
                self._hold(field, self._zeros(field, rows), rows)
            else:
                setattr(self, field.name, None)
        # joints of bending chains; (m, 2) joints at the ends of elements, see `geometry.cables`
        self.joints: Joints | None = None
        self.joint_at: np.ndarray | None = None
        self.slip_points: Any = None  # in the step, `slip.motion.SlipPoints`; None: no sliding cable
        self.wind_along = (1.0, 0.0)  # horizontal direction of the wind
        self.branches = None
        if features.band:
            alpha_tau = np.reshape(features.band, (2, -1))
            self.branches = np.vstack([alpha_tau, np.zeros((3, alpha_tau.shape[1]))])
        self._records: dict[str, Any] = {}

    @property
    def n_local(self) -> int:
        """Number of particle rows in use."""
        return int(self.rows[0])

    @n_local.setter
    def n_local(self, rows: int) -> None:
        self.rows[0] = rows

    def _zeros(self, field: fields.Field, rows: int) -> np.ndarray:
        """Allocate zeros for elements or particles as kernels take them; slot arrays have `width` rows."""
        if field.entity == "element":
            return np.zeros((rows, *field.tail), field.dtype)
        count = self.width if field.entity == "slot" else int(np.prod(field.tail))
        return allocate_columns(count, rows + LANES, field.dtype, fields.FIELDS.index(field))

    def _hold(self, field: fields.Field, array: np.ndarray, rows: int) -> None:
        """Set an array of kernels as attribute; those of particles become views (rows, axes)."""
        if field.entity == "particle":
            setattr(self, field.name, array[:, :rows].T if field.tail else array[0, :rows])
            array = array if field.tail else array[0]
        else:
            setattr(self, field.name, array)
        self._whole[field.name] = array

    # --- what kernels take

    @property
    def particles(self) -> fields.Particles:
        """Fields of the particles for kernels."""
        return self._record(fields.Particles, "particle")

    @property
    def elements(self) -> fields.Elements:
        """Fields of the elements for kernels."""
        return self._record(fields.Elements, "element")

    @property
    def slots(self) -> fields.Slots:
        """Fields of the slots for kernels."""
        return self._record(fields.Slots, "slot")

    def _record(self, kind: type[AnyRecord], entity: str) -> AnyRecord:
        """Return a record of arrays, cached until they grow: building it takes tens of microseconds."""
        if entity not in self._records:
            arrays = {field.short: self._whole.get(field.name) for field in fields.fields_of(entity)}
            kinds = kind.kind.fields
            fields_given = {
                name: empty(kinds[name]) if array is None else array for name, array in arrays.items()
            }
            self._records[entity] = kind(**fields_given)
        record: AnyRecord = self._records[entity]
        return record

    @property
    def law(self) -> LawParameters:
        """Law parameters that all elements share; cached until `renew_law`."""
        if "law" not in self._records:
            self.renew_law()
        return self._records["law"]

    @property
    def elements_and_law(self) -> tuple[fields.Elements, LawParameters]:
        """Elements and law, the arguments for forces at given positions."""
        return self.elements, self.law

    def renew_law(self) -> LawParameters:
        """Recompute the law without the broken elements."""
        min_eps_u = None if self.eps_u is None else self.eps_u.min(initial=np.inf)
        if self.yield_strain is not None:
            self.yield_strain[:] = np.inf
            np.divide(self.yield_force, self.EA, out=self.yield_strain, where=self.EA > 0.0)
        if self.check_stretch is not None:
            self.check_stretch[:] = check_stretches(self.eps_u, self.features.strain)
        yields = self.yield_force if self.features.plastic else None
        check_force = check_forces(self.EA, yields, self.eps_u, self.euler, self.features.strain)
        if self.near is not None:
            self.near[:] = check_force
        self._records["law"] = build_law(
            self.features.strain,
            self.features.plastic,
            _common_value(self.EA, self.slot_EA),
            _common_value(self.yield_force, self.slot_yield_force),
            min_eps_u,
            float(check_force.min(initial=np.inf, where=self.EA > 0.0)),
            self.branches,
        )
        return self._records["law"]

    def present_element_state(self) -> ElementState:
        """Compute axial force [N], strain, plastic strain and length [m] (m,) at the present positions."""
        now = ElementState(*(np.empty(self.m) for _ in range(4)))
        compute_element_state(self.x, self.elements, self.law, now)
        return now

    def bending_moments(self) -> np.ndarray:
        """Return moments (m, 2) [N m] of owned joints at both element ends; nan: without bending."""
        assert self.joints is not None
        moment, hold = np.empty((2, len(self.joints.stiffness)))
        joint_moments(self.x, self.joints, moment, hold)
        at_joint = np.append(moment, [np.nan, 0.0])  # joints -2, without bending, and -1, the end of a chain
        return at_joint[self.joint_at]

    def include_extremes(self, N: np.ndarray) -> None:
        """Include the present N (m,) [N] of unbroken elements in the extremes of the axial forces."""
        whole = self.broken == 0
        np.maximum(self.highest, N, out=self.highest, where=whole)
        np.minimum(self.lowest, N, out=self.lowest, where=whole)

    def reset_extremes(self, N: np.ndarray) -> None:
        """Restart the extremes of the axial forces from the present N (m,) [N]; the slots must be new."""
        now = np.where(self.broken != 0, 0.0, N)  # fragments do not count
        self.highest[:] = now
        if self.lowest is not None:
            self.lowest[:] = now

    def reset_history(self) -> None:
        """Remove slips and plastic strains; the caller then sets the lengths without slip."""
        if self.slip is not None:
            self.slip[:] = 0.0
        if self.features.plastic:
            self.eps_p[:] = self.dissipated[:] = 0.0

    # --- what follows from other fields

    def relative_wind(self) -> RelativeWind | None:
        """Return the data for the drag on detached particles; None: the problem has none."""
        if self.drag is None:
            return None
        owned = slice(self.n_owned)  # particles that split off have no surface
        rows = np.flatnonzero((self.detached[owned] != 0) & (self.drag_size[owned] > 0.0))
        steady = np.zeros(0) if self.steady_speed is None else self.steady_speed[rows]
        return RelativeWind(rows, self.drag_size[rows], steady, *self.wind_along)

    def invert_masses(self) -> None:
        """Recompute per_mass."""
        moves = self.free.any(1) & (self.mass > 0.0)
        self.per_mass[:] = np.divide(1.0, self.mass, out=np.zeros_like(self.mass), where=moves)

    def place_springs(self) -> None:
        """Recompute the positions at which elastic supports carry nothing."""
        if self.features.springs:
            self.spring_zero[:] = self.spring_rest + self.x_start

    # --- rows

    @property
    def first_split(self) -> int:
        """Local row of the first particle that split off."""
        return self.n_owned + self.n_halo

    def own(self, p: int) -> bool:
        """Return whether this rank owns the particle in local row p."""
        return p < self.n_owned or p >= self.first_split

    def owned_rows(self) -> np.ndarray:
        """Return the local rows of the particles that this rank owns."""
        return np.concatenate([np.arange(self.n_owned), np.arange(self.first_split, self.n_local)])

    def reserve(self, particles: int) -> None:
        """Reserve rows for more particles to split off; their initial values are in the table of fields."""
        capacity = len(self.x)
        if self.n_local + particles <= capacity:
            return
        spare = max(MIN_SPARE_ROWS, 2 * particles, capacity // 8)
        for field in fields.FIELDS:
            array = getattr(self, field.name)
            if field.entity != "element" and array is not None:
                self._hold(field, self._zeros(field, self.n_local + spare), self.n_local + spare)
                enlarged = getattr(self, field.name)
                used = (slice(None), slice(self.n_local)) if field.entity == "slot" else slice(self.n_local)
                enlarged[used] = array[used]
                if field.entity == "particle" and field.split != fields.COPY_PARENT:
                    enlarged[self.n_local :] = field.split
        self._records = {}

    def sort_splits(self) -> None:
        """Sort the rows of split-off particles by their far ends, for locality in memory."""
        first, rows = self.first_split, slice(self.first_split, self.n_local)
        order = np.argsort(self.other[0, rows], kind="stable")
        for field in fields.FIELDS:
            array = getattr(self, field.name)
            if field.entity != "element" and array is not None:
                index = (slice(None), rows) if field.entity == "slot" else rows
                array[index] = array[:, first + order] if field.entity == "slot" else array[first + order]
        new = np.empty_like(order)
        new[order] = np.arange(len(order))
        for rows in (self.ends, self.other[:, : self.n_local]):
            split = rows >= first
            rows[split] = first + new[rows[split] - first]


def _common_value(values: np.ndarray | None, slot_values: np.ndarray | None) -> float | None:
    """Return the largest value, which all present elements share.

    It is None if the slots have their own values, or there is no value.
    """
    if slot_values is not None or values is None:
        return None
    return float(values.max(initial=0.0))


def save_state(state: State) -> dict[str, np.ndarray]:
    """Return copies of the fields that an equilibrium changes, for `restore_saved`."""
    arrays = ((name, getattr(state, name)) for name in SAVED_FIELDS)
    return {name: array.copy(order="K") for name, array in arrays if array is not None}


def restore_saved(state: State, saved: dict[str, np.ndarray]) -> None:
    """Restore the state saved by `save_state`."""
    for name, array in saved.items():
        getattr(state, name)[:] = array
