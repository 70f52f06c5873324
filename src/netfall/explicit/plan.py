"""Arguments of the time loop on one rank, prepared from the state."""

from typing import Any

import numpy as np

from netfall.core.arrays import allocate_columns
from netfall.core.records import empty, f8, f8_2
from netfall.core.vectors import LANES
from netfall.explicit import loop
from netfall.explicit.forces import Scratch
from netfall.explicit.incidence import fill_slots, particles_in_line
from netfall.explicit.loop import Chunks, Interval, LoopState, SplitCapacity
from netfall.explicit.motion import HORIZONTAL_LOAD, PARTLY_FIXED
from netfall.explicit.sampling import Table, make_row, no_rows
from netfall.parallel.halo import Halo, check
from netfall.physics.air import RelativeWind, set_air_forces
from netfall.physics.bending import Joints
from netfall.physics.events import COLUMNS, allocate_events
from netfall.physics.fields import FIELDS
from netfall.physics.fracture import FractureRules, Fractures, remove_broken_element, split_particles
from netfall.physics.slip.motion import SlipPoints, update_slip_velocities
from netfall.physics.state import State
from netfall.physics.supports import Ground

STEPPED_FIELDS = (  # fields that steps without fracture change
    *("x", "v", "work", "other_work", "highest", "lowest", "eps_p", "dissipated"),
    *("slot_eps_p", "slot_highest", "slot_lowest", "slot_branch_a", "slot_branch_b", "slot_branch_c"),
)
# fields that they also change if cables slide
SLIDING_FIELDS = ("slip", "slip_v", "slip_locked", "slip_work", "L0", "inv_L0")
CHUNK = 1024  # particles, a multiple of LANES: their forces fit the first-level cache
UNLIMITED_ROWS = 1 << 62  # particle rows; an unreachable capacity


def halo_width(state: State) -> int:
    """Return the count of numbers sent for each boundary particle, as `halo.pack_forces` packs them."""
    if not state.features.fracture:
        return 3 + state.features.sliding
    return (6 if state.features.air_mass else 5) + state.features.sliding


def feature_bits(state: State) -> int:
    """Return the features of a rank that select statements in `motion`, as bits."""
    sideways = bool(state.load[:, :2].any())
    return HORIZONTAL_LOAD * sideways | PARTLY_FIXED * (state.features.part_held or state.features.motion)


def step_routines(state: State) -> dict[str, int]:
    """Return addresses of the routines that step the chunks of a rank, by their names in `LoopState`."""
    f, slots, law = state.features, state.slots, state.law
    plain = not (f.band or law.logarithmic)
    needs_inelastic = not plain or law.plastic or slots.euler.size or state.slot_eps_p is not None
    inelastic = loop.yielding_forces if plain and not slots.bar.size else loop.general_forces
    rare = f.varying or f.drags or f.springs or f.turned or f.motion or f.part_held
    rare = rare or f.air or f.air_mass or f.bending or f.band
    return {
        "elastic_forces": loop.elastic_forces.address_if(plain),
        "inelastic_forces": inelastic.address_if(needs_inelastic),
        "move_chunk": (loop.move_any if rare else loop.move_plain).address,
    }


def make_scratch(state: State) -> Scratch:
    """Allocate the force arrays for the particles of a chunk."""
    rows = CHUNK + LANES
    return Scratch(
        f=allocate_columns(3, rows, float),
        band=allocate_columns(3, rows, float) if state.features.band else empty(f8_2),
        margin=np.zeros(rows),
        external=allocate_columns(3, rows, float),
        total=allocate_columns(3, rows, float),
        pull=np.zeros(rows),
    )


class StepPlan:
    """Arguments of the time loop for a state, updated when anything outside the loop changes the state."""

    def __init__(
        self,
        state: State,
        halo: Halo,
        rules: FractureRules | None = None,
        rows: Any | None = None,
        ground: Ground | None = None,
        capacity: int = 0,
    ):
        """Divide the owned particles into chunks and build the arguments.

        rules : of fractures; None: nothing breaks; rows : as `explicit.rows.RowTable`, None: no history
        ground : only if supports move; capacity : number of fractures that fit without new arrays
        """
        boundary = min(-(-halo.boundary // LANES) * LANES, state.n_owned)  # a vector lies in one chunk
        before, after = np.arange(0, boundary, CHUNK), np.arange(boundary, state.n_owned, CHUNK)
        self.halo, self.boundary, self.rules, self.rows, self.ground = halo, len(before), rules, rows, ground
        self._low = np.concatenate([before, after])
        self._high = np.append(self._low[1:], state.n_owned)[: len(self._low)]
        self.scratch = make_scratch(state)
        valence = np.bincount(state.ends.ravel(), minlength=state.n_local)[: state.n_owned]
        self._width = np.zeros(len(self._low), np.int64)
        chunk = np.searchsorted(self._low, np.arange(state.n_owned), side="right") - 1
        np.maximum.at(self._width, chunk, valence)
        if capacity and state.features.fragments:
            state.reserve(2 * capacity)
        self.events = allocate_events(2 * capacity)
        self._attach(state)

    def attach(self, state: State) -> None:
        """Update chunks, slots and masses after a change of connectivity."""
        self.collect()
        self._attach(state)

    def _attach(self, state: State, filled: bool = False) -> None:
        """Build the arguments for a state; filled : whether its slots are already up to date"""
        self.state = state
        state.renew_law()
        if not filled:
            fill_slots(state)
        state.invert_masses()
        state.place_springs()
        self._works = {False: self._work(state)}

    def _work(self, state: State) -> LoopState:
        """Build the record that the loop works on."""
        fragments = self.rules is not None and state.features.fragments
        most_rows = len(state.x) if fragments else UNLIMITED_ROWS
        particles, f = state.particles, state.features
        second = allocate_columns(3, particles.x.shape[1], float, len(FIELDS))
        exchanges = self.halo.boundary > 0 or state.n_halo > 0
        return LoopState(
            traits=feature_bits(state),
            chunks=self._chunks_of(state),
            particles=particles,
            y=second,
            elements=state.elements,
            slots=state.slots,
            law=state.law,
            scratch=self.scratch,
            spare=SplitCapacity(state.rows, most_rows, self.events.count, len(self.events.step)),
            fractures=self._fractures(state),
            breaks=f.fracture,
            bends=state.joints or Joints.absent(),
            slip_points=state.slip_points or SlipPoints.absent(),
            ground=self.ground or Ground.absent(),
            relative=state.relative_wind() or RelativeWind.absent(),
            rows=self.rows.of(state, second) if self.rows else no_rows(),
            buffers=self.halo.buffers,
            counts=np.zeros(3, np.int64),
            seconds=empty(f8),
            **step_routines(state),
            make_row=make_row.address_if(self.rows),
            break_pending=loop.break_pending.address_if(f.fracture),
            collect_slots=loop.collect_slots.address,
            set_branch_factors=loop.set_branch_factors.address_if(f.band),
            set_air_forces=set_air_forces.address_if(f.air or f.drags),
            move_supports=loop.move_supports.address_if(self.ground),
            update_slip_velocities=update_slip_velocities.address_if(f.sliding),
            shift_slips=loop.shift_slips.address_if(f.sliding),
            bend_joints=loop.bend_joints.address_if(f.bending),
            send_forces=loop.send_forces.address_if(exchanges),
            receive_forces=loop.receive_forces.address_if(exchanges),
        )

    def _fractures(self, state: State) -> Fractures:
        """Build the record of fractures."""
        if not self.rules:
            return Fractures.absent()
        breaking = split_particles if self.rules.stable_dt > 0.0 else remove_broken_element
        return Fractures(self.rules, state.particles, state.rows, self.events, breaking.address)

    def _chunks_of(self, state: State) -> Chunks:
        """Build the chunks for the present particles."""
        new = np.arange(state.first_split, len(state.x), CHUNK)
        low = np.concatenate([self._low, new])
        high = np.concatenate([self._high, np.clip(state.n_local, new, new + CHUNK)])
        support_at = self.rows.envelope.support_at if self.rows else np.zeros(0, np.int64)
        first_support = np.searchsorted(np.flatnonzero(support_at >= 0), np.append(low, state.n_local))
        has_yielded = np.zeros(len(low), np.uint8)
        if state.slot_eps_p is not None:
            has_yielded[:] = [state.slot_eps_p[:, a:b].any() for a, b in zip(low, high)]
        return Chunks(
            state.n_owned,
            state.n_halo,
            self.boundary,
            len(self._low),
            CHUNK,
            low,
            high,
            np.concatenate([self._width, np.ones(len(new), np.int64)]),
            first_support,
            has_yielded,
            particles_in_line(state),
        )

    def read(self, *arrays: np.ndarray) -> None:
        """Bring arrays of the state, or all, up to date before Python only reads them.

        The loop changes plastic strain, heat and extremes of the elements in slots alone.
        """
        loop.collect_slots_now(self._works[False])

    def collect(self) -> None:
        """Bring the state up to date before Python reads or changes it."""
        self.read()

    def take_rows(self) -> Table:
        """Remove the rows so far from the table, and return them. Only with a history."""
        assert self.rows is not None
        return self.rows.take_rows()

    @property
    def event_count(self) -> int:
        """Number of entries in the log of fractures."""
        return int(self.events.count[0])

    def logged_events(self) -> dict[str, np.ndarray]:
        """Return the entries in the log of fractures, by column."""
        return {name: getattr(self.events, name)[: self.event_count] for name in COLUMNS}

    def run(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Advance the state by up to the steps of an interval; return the number of steps done.

        It stops early if the fragments exceed the capacity. It then enlarges the capacity and breaks the
        pending elements. Collective among neighbours.
        """
        done, count, error = self._steps(interval, seconds)
        check(error)
        if count:
            self.collect()
            if self.state.features.fragments:
                self.state.sort_splits()
                self.state.reserve(2 * count)
            needed = self.event_count + 2 * max(count, len(self.state.x) - self.state.n_local)
            if needed > len(self.events.step):
                self.events = allocate_events(2 * needed, self.events)
            self._attach(self.state, filled=True)
            remainder = interval._replace(first=interval.first + done, steps=0, pending=count)
            check(self._steps(remainder, seconds)[2])
        return done

    def run_trial(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Run a trial; return the steps before the one in which an element fractures, or all of them."""
        moving = STEPPED_FIELDS + SLIDING_FIELDS if self.state.features.sliding else STEPPED_FIELDS
        saved = {name: getattr(self.state, name) for name in moving}
        saved = {name: array.copy(order="K") for name, array in saved.items() if array is not None}
        rows = self.rows and self.rows.copies()
        done, tried, error = self._steps(interval, seconds)
        check(error)
        self.before = saved, rows
        return max(0, tried - 2) if tried else done  # it is checked a step later

    def _steps(self, interval: Interval, seconds: np.ndarray | None) -> tuple[int, int, int]:
        """Call `loop.time_loop` for an interval, timed if `seconds` is given."""
        timed = seconds is not None
        if timed not in self._works:
            self._works[timed] = self._works[False].with_values(seconds=seconds)
        return loop.time_loop(interval, self._works[timed])

    def revert_trial(self) -> None:
        """Restore the state to the start of the last trial."""
        moving, rows = self.before
        for name, array in moving.items():
            getattr(self.state, name)[:] = array
        if self.rows:
            self.rows.restore(rows)
