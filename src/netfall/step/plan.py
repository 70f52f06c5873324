"""How the time loop goes through the particles of a rank, prepared from the state."""

from typing import NamedTuple

import numpy as np

from netfall.ground.apart import Entry
from netfall.ground.columns import columns
from netfall.ground.compile import entry_for
from netfall.ground.handed import laid, types_of
from netfall.mechanics.air import RelativeWind
from netfall.mechanics.bending import Bends
from netfall.mechanics.events import StepDone, events_with_room
from netfall.mechanics.fields import SLOTS, Elements, Particles, Slots
from netfall.mechanics.fracture import BREAKING, FractureRules, Fractures
from netfall.mechanics.ground import Ground, move_ground
from netfall.mechanics.law.law import Law
from netfall.mechanics.slip.motion import Places
from netfall.mechanics.state import State, axes
from netfall.parallel.halo import Halo, HaloBuffers, check
from netfall.step.beside import (
    BLOWN,
    EXCHANGED,
    begin_step,
    collect,
    collect_now,
    end_step,
    find_drag,
    pack,
    unpack,
)
from netfall.step.forces import KICKED, kick_chunk, kick_unyielded
from netfall.step.limits import find_over, look_closer
from netfall.step.loop import Beside, Found, Interval, Moved, Spare, time_loop
from netfall.step.rows import no_rows
from netfall.step.runs import LANES, Runs, end_all_loans, find_runs, make_runs
from netfall.step.slots import fill_slots
from netfall.step.tear import break_elements

MOVING = (  # where nothing breaks
    *("x", "v", "work", "other_work", "highest", "lowest", "eps_p", "dissipated"),
    *("slot_eps_p", "slot_highest", "slot_lowest", "slot_branch_a", "slot_branch_b", "slot_branch_c"),
)
SLIPPING = ("slip", "slip_v", "slip_locked", "slip_work", "L0", "inv_L0")  # where cables slip, besides
CHUNK = 2048  # particles, 300 KB; fewer end the runs too often, more leave the second cache
FAR_OFF = 1 << 62  # more rows than there can be
FAR = 16  # chunks: what is farther away in number leaves the third cache before it is needed


class Chunks(NamedTuple):
    """Stretches of particles, each small enough for the cache, in the order in which they are stepped.

    By number they are first those of the particles that split off, `splits` of them, with one element each;
    some are empty as yet; then those of the owned ones, of which the first `boundary` hold the boundary
    particles. Stepped are first those split off, `front` of them, of which any chunk may need the positions;
    then the owned ones, each behind the split ones whose far ends begin there: these are in the cache.
    n_owned, n_halo : particles; inner : the first one after the boundary chunks; size : of a whole chunk
    own : chunks up to and with the last boundary one; place : (chunks,) of each number
    is_split : (chunks,) 1 for particles that split off; for `kick_chunk` None where none ever does
    low, high : (chunks,) particles of each chunk
    width : (chunks,) most elements at one of them
    last_use : (chunks,) the last chunk that reads positions of the chunk, itself if none comes after it
    has_yielded : (chunks,) whether any of its elements has plastic strain
    """

    n_owned: int
    n_halo: int
    inner: int
    size: int
    splits: int
    boundary: int
    front: int
    own: int
    place: np.ndarray
    is_split: np.ndarray | None
    low: np.ndarray
    high: np.ndarray
    width: np.ndarray
    last_use: np.ndarray
    has_yielded: np.ndarray
    runs: Runs


class Lent(NamedTuple):
    """What each particle lends of the element in its fourth slot, (n_owned,): see `runs`.

    density : [N/m], N / L; band : the same, of the branches alone, None: there are none
    near : 1 where it is near its limits; None: all is elastic
    """

    density: np.ndarray
    band: np.ndarray | None
    near: np.ndarray | None


class Scratch(NamedTuple):
    """What the loop writes for the chunk in hand: forces, and whose elements are near their limits.

    band, band_rest : as f, f_rest, of the branches alone, None: there are none
    f, f_rest : three of (rows,) [N]; near : None where all is elastic; f_rest, near_rest : of particles
        in no run
    lent : of all particles; lent_rest : of those in no run
    """

    f: tuple
    near: np.ndarray | None
    f_rest: tuple
    near_rest: np.ndarray
    band: tuple | None
    band_rest: tuple | None
    lent: Lent
    lent_rest: Lent


class Work(NamedTuple):
    """What the kernels of a step work on, see `Plan`; None: the scene has no such thing.

    kicked_... : what `kick_chunk` reads of them; unyielded : these slots without plastic strains
    particles : as `stepped_particles` prepares them, of which `exchanged` and `blown` are some fields, and
        `grounded` all
    """

    chunks: Chunks
    kicked_chunks: Chunks
    kicked_particles: Particles
    kicked_slots: Slots
    unyielded: Slots
    particles: Particles
    exchanged: Particles
    blown: Particles
    relative: RelativeWind | None
    moved: Moved
    elements: Elements
    slots: Slots
    law: Law
    scratch: Scratch
    found: Found
    fractures: Fractures | None
    buffers: HaloBuffers
    bends: Bends | None
    places: Places | None
    ground: Ground | None
    grounded: Particles | None

    @property
    def of_elements(self) -> tuple:
        """Elements, slots and law."""
        return self.elements, self.slots, self.law


def halo_width(state: State) -> int:
    """Numbers sent for each boundary particle, as `halo.pack_forces` packs them."""
    if not state.features.fracture:
        return 3 + state.features.sliding
    return (6 if state.features.air_mass else 5) + state.features.sliding


def stepped_particles(state: State) -> Particles:
    """The particles as the time loop takes them: what no particle has, and what it does not read, is None."""
    s = state
    vertical = not s.load[:, :2].any()
    return s.particles._replace(
        x_start=None,
        free=axes(s.free)
        if s.features.part_held or s.features.motion
        else None,  # else all axes move, or 1 / mass is 0
        load=(None, None, s.load[:, 2]) if vertical else axes(s.load),
        slip_v=axes(s.slip_v) and axes(s.slip_v)[: s.features.sliding],
        gid=None,
        detached=None,
        drag_size=None,
        steady_speed=None,
    )


def with_fields(particles: Particles, names: tuple) -> Particles:
    """Particles of which all other fields are None: scenes that differ in those then share kernels."""
    return particles._replace(**dict.fromkeys(set(particles._fields) - set(names)))


def breaking_particles(state: State) -> Particles:
    """The particles as fractures take them. Where a wind may end there is air, if of no particle."""
    particles = with_fields(state.particles, BREAKING)
    if particles.wind is not None and particles.air is None:
        particles = particles._replace(air=(np.zeros(0),) * 3)
    return particles if state.features.air_mass else particles._replace(work=None)


def _lent(n: int, features) -> Lent:
    """`Lent` of n particles."""
    return Lent(
        columns(1, n, float)[0],
        columns(1, n, float, 1)[0] if features.band else None,
        columns(1, n, np.uint8, 2)[0] if features.inelastic else None,
    )


class Plan:
    """The arguments of the time loop for a state, brought up to date when something else changes it."""

    def __init__(
        self,
        state: State,
        halo: Halo,
        rules: FractureRules | None = None,
        rows=None,
        ground: Ground | None = None,
    ):
        """rules : of fractures; None: nothing breaks; rows : as `record.rows.RowTable`, None: no history

        ground : where supports move
        """
        before, after = np.arange(0, halo.boundary, CHUNK), np.arange(halo.boundary, state.n_owned, CHUNK)
        self.halo, self.boundary, self.rules, self.rows, self.ground = halo, len(before), rules, rows, ground
        self._low = np.concatenate([before, after])
        self._high = np.append(self._low[1:], state.n_owned)[: len(self._low)]
        self.scratch = Scratch(
            tuple(columns(3, CHUNK, float)),
            np.zeros(CHUNK, np.uint8) if state.features.inelastic else None,
            tuple(columns(3, CHUNK + LANES, float)),
            np.zeros(CHUNK + LANES, np.uint8),
            tuple(columns(3, CHUNK, float)) if state.features.band else None,
            tuple(columns(3, CHUNK + LANES, float)) if state.features.band else None,
            _lent(state.n_owned, state.features),
            _lent(CHUNK + LANES, state.features),
        )
        valence = np.bincount(state.ends.ravel(), minlength=state.n_local)[: state.n_owned]
        self._width = np.full(len(self._low), SLOTS, np.int64)
        self._last_use = np.arange(len(self._low))
        chunk_of = lambda particles: np.searchsorted(self._low, particles, side="right") - 1
        np.maximum.at(self._width, chunk_of(np.arange(state.n_owned)), valence)
        chunk = chunk_of(state.ends[(state.ends < state.n_owned).all(1)])
        np.maximum.at(self._last_use, chunk[:, 0], chunk[:, 1])
        np.maximum.at(self._last_use, chunk[:, 1], chunk[:, 0])
        near = self.scratch.near if state.features.inelastic else np.zeros(0, np.uint8)
        self.found = Found(self.scratch.f, near, np.zeros(1, np.int64))
        self.events, self.state = events_with_room(0), None
        self._loops: dict = {}  # by whether its parts are timed
        self.attach(state)

    def attach(self, state: State, filled: bool = False) -> None:
        """Bring chunks, slots, masses and runs up to date with what is attached to what.

        filled : whether the slots are so already
        """
        if self.state is not None:
            self.collect_yield()
        self.state = state
        state.renew_law()
        if filled:
            end_all_loans(self.chunks, state.slots)
        else:
            fill_slots(state, zip(self._low.tolist(), self._high.tolist()))
        state.invert_masses()
        state.place_springs()
        self.chunks = self._chunks_of(state)
        find_runs(self.chunks, state.other, state.inv_L0)
        rows = self.rows.of(state) if self.rows else no_rows()
        self.beside = Beside(*self._entries(self._work(state)), rows)
        fragments = self.rules is not None and state.features.fragments
        most_rows = len(state.x) if fragments else FAR_OFF
        spare = Spare(state.rows, most_rows, self.events.count, len(self.events.step))
        moved = Moved(state.particles.x, state.particles.v, state.particles.f)
        arguments = self.chunks, moved, self.found, spare, self.beside
        self.laid = tuple(map(laid, arguments, types_of(arguments)))

    def _work(self, state: State) -> Work:
        """What the kernels of a step work on, by its address."""
        split, whole = state.features.fracture and state.features.fragments, state.particles
        stepped, kicked_slots = stepped_particles(state), state.slots._replace(element=None)
        work = Work(
            self.chunks,
            self.chunks if split else self.chunks._replace(is_split=None),
            with_fields(stepped, KICKED),
            kicked_slots,
            kicked_slots._replace(eps_p=None, yield_strain=None),
            stepped,
            with_fields(stepped, EXCHANGED),
            with_fields(stepped, BLOWN),
            state.relative_wind(),
            Moved(whole.x, whole.v, whole.f),
            state.elements,
            state.slots,
            state.law,
            self.scratch,
            self.found,
            self.rules and Fractures(self.rules, breaking_particles(state), state.rows, self.events),
            self.halo.buffers,
            None if state.joints is None else Bends(state.x, state.joints, state.bend),
            state.places,
            self.ground,
            whole if self.ground else None,
        )
        return Work(*map(laid, work, types_of(work)))

    def _entries(self, work: Work) -> list[Entry]:
        """What the time loop calls, in the order of `Beside`: each kernel and what it works on."""
        features, w = self.state.features, work
        keeps = features.plastic or features.peaks or features.band
        begins = features.band or features.air or features.bending or w.places
        when, of_kick, real = StepDone(0.0, 0, 0.0), (w.kicked_chunks, w.kicked_particles), 0.0
        calls = (  # the kernel, unless there is nothing to do; arguments like those of a call; what is given
            (kick_chunk, (0, real, real, real), (*of_kick, w.kicked_slots, w.law, w.scratch)),
            (kick_unyielded, (0, real, real, real), (*of_kick, w.unyielded, w.law, w.scratch)),
            (features.inelastic and look_closer, (0,), (w.chunks, w.moved, *w.of_elements, w.found)),
            (features.fracture and find_over, (), (w.moved, w.elements, w.law, w.found)),
            (self.rules and break_elements, (0, when), (w.chunks, *w.of_elements, w.fractures)),
            (pack, (0,), (w.exchanged, w.buffers)),
            (unpack, (0, real, real, real), (w.chunks, w.exchanged, w.buffers)),
            (self.ground and move_ground, (real,) * 4, (w.ground, w.grounded)),
            (begins and begin_step, (*[real] * 6, True), (w.bends, w.places, w.particles, w.elements, w.law)),
            (features.drags and find_drag, (real, real), (w.relative, w.blown)),
            (w.places and end_step, (real,), (w.chunks, w.places, w.particles, w.elements, w.slots)),
            (keeps and collect, (), (w.chunks, *w.of_elements)),
        )
        found = [Entry(kernel or None, *like, given=given) for kernel, like, given in calls]
        return found if features.plastic else [found[0], found[0], *found[2:]]

    @property
    def apart(self) -> list[Entry]:
        """All that the time loop calls by its address, what takes longest to compile first."""
        kick_chunk, kick_unyielded, *others, rows = self.beside
        of_rows = [*(self.rows.snapshot.apart if self.rows else ()), rows.take_row]
        return [kick_chunk, kick_unyielded, *of_rows, *others]

    def _chunks_of(self, state: State) -> Chunks:
        """The chunks, of which those split off come where most of their far ends are."""
        new = np.arange(state.first_split, len(state.x), CHUNK)
        low = np.concatenate([new, self._low])
        high = np.concatenate([np.clip(state.n_local, new, new + CHUNK), self._high])
        splits, last_use = len(new), np.concatenate([np.arange(len(new)), self._last_use + len(new)])
        before = np.arange(-splits, len(self._low)) + 0.5  # the chunk of the owned ones that it comes before
        before[:splits] = -1.0
        for k in np.flatnonzero(high[:splits] - new == CHUNK):  # nothing joins them
            far = state.other[0, low[k] : high[k]]
            first, last = np.searchsorted(self._low, (far.min(), far.max()), side="right") - 1
            if far.max() < state.n_owned and last - first < FAR:
                before[k], last_use[k] = first, splits + last
        order = np.argsort(before, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        low, high = low[order], high[order]
        has_yielded = np.zeros(len(low), np.uint8)
        if state.slot_eps_p is not None:
            has_yielded[:] = [state.slot_eps_p[:, a:b].any() for a, b in zip(low, high)]
        return Chunks(
            state.n_owned,
            state.n_halo,
            self._low[self.boundary] if self.boundary < len(self._low) else state.n_owned,
            CHUNK,
            splits,
            self.boundary,
            int(np.count_nonzero(before < 0.0)),
            int(place[splits + self.boundary - 1]) + 1 if self.boundary else 0,
            place,
            (order < splits).astype(np.uint8),
            low,
            high,
            np.concatenate([np.full(splits, SLOTS), self._width])[order],
            place[last_use][order],
            has_yielded,
            make_runs(len(low), state.n_owned),
        )

    def collect_yield(self) -> None:
        """Bring plastic strains, heat and extremes of the elements up to date: else slots alone change."""
        collect_now(self.beside.collect)

    def run(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Advance the state by up to the steps of an interval; how many were done.

        Fewer where more breaks than there is room for: then there is, and it has broken. Collective among
        neighbours.
        """
        done, count, error = self._steps(interval, seconds)
        check(error)
        if count:
            if self.state.features.fragments:
                self.state.sort_splits()
                self.state.reserve(2 * count)
            needed = int(self.events.count[0]) + 2 * max(count, len(self.state.x) - self.state.n_local)
            if needed > len(self.events.step):
                self.events = events_with_room(2 * needed, self.events)
            self.attach(self.state, filled=True)
            rest = interval._replace(first=interval.first + done, steps=0, pending=count)
            check(self._steps(rest, seconds)[2])
        return done

    def try_out(self, interval: Interval, seconds: np.ndarray | None = None) -> int:
        """Steps of a trial before that in which an element passes its fracture strain; all, if none does."""
        moving = MOVING + SLIPPING if self.state.features.sliding else MOVING
        kept = {name: getattr(self.state, name) for name in moving}
        kept = {name: array.copy(order="K") for name, array in kept.items() if array is not None}
        rows = self.rows and self.rows.keep()
        done, tried, error = self._steps(interval, seconds)
        check(error)
        self.before = kept, rows
        return max(0, tried - 2) if tried else done  # it had passed it in the step before

    def _steps(self, interval: Interval, seconds: np.ndarray | None) -> tuple[int, int, int]:
        """`time_loop` with these arguments."""
        arguments, timed = (interval, *self.laid, self.halo.buffers, seconds), seconds is not None
        if timed in self._loops:
            return self._loops[timed](*arguments)
        found = time_loop(*arguments)
        self._loops[timed] = entry_for(time_loop, *arguments)
        return found

    def take_back(self) -> None:
        """The state is as it was before the last trial."""
        moving, rows = self.before
        for name, array in moving.items():
            getattr(self.state, name)[:] = array
        if self.rows:
            self.rows.put_back(rows)
