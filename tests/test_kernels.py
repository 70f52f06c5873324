"""Vector kernels of the step compared with the scalar element law, for every feature set."""

import itertools

import numpy as np
import pytest

from netfall.core.kernels import kernel
from netfall.core.vectors import LANES
from netfall.explicit.incidence import collect_elements
from netfall.explicit.loop import Chunks, LoopState, chunk_forces, general_forces
from netfall.explicit.plan import CHUNK, StepPlan
from netfall.gpu.memory import GpuNet
from netfall.parallel.halo import buffers_without_neighbours
from netfall.parallel.subdomain import split_net
from netfall.physics.elements import add_axial_forces
from netfall.physics.fields import Features
from netfall.physics.state import State


class NoHalo:
    """A halo of one rank, which sends nothing."""

    boundary, buffers = 0, buffers_without_neighbours()


def random_state(scene: Features, seed: int) -> State:
    """Return particles near a line, each connected to one to thirteen others."""
    n, rng = CHUNK + 7, np.random.default_rng(seed)
    hub = np.column_stack([np.zeros(13, np.int64), np.arange(20, 33)])
    elements = np.concatenate(
        [np.sort(np.column_stack([np.repeat(np.arange(n), 2), rng.integers(0, n, 2 * n)]), axis=1), hub]
    )
    elements = np.unique(elements[elements[:, 0] != elements[:, 1]], axis=0)
    return make_state(scene, n, elements, 50.0 * rng.normal(size=(n, 3)) * (1.0, 0.1, 0.02), seed)


def make_state(scene: Features, n: int, elements: np.ndarray, x: np.ndarray, seed: int) -> State:
    """Return elements of all kinds: taut, slack, yielding, and one without length."""
    rng = np.random.default_rng(seed)
    (subdomain,) = split_net(n, elements, np.zeros(n, np.int32), 1)
    state = State(scene, n, 0, len(elements), int(np.bincount(elements.ravel()).max()))
    state.ends[:], state.owned[:], state.free[:], state.mass[:] = subdomain.ends, 1, 1, 1.0
    state.x[:] = x
    a, b = elements[3]
    state.x[b] = state.x[a]
    state.x_start[:] = state.x
    L = np.linalg.norm(state.x[elements[:, 1]] - state.x[elements[:, 0]], axis=1)
    state.L0[:] = np.maximum(L, 1.0) / (1 + rng.uniform(-0.02, 0.03, len(L)))
    state.EA[:] = 1e8 * (rng.choice([1.0, 2.5], len(L)) if scene.sections else 1.0)
    state.bar[:] = rng.integers(0, 2, len(L)) if scene.bars else 0
    if scene.plastic:
        state.yield_force[:] = 0.01 * 1e8 * (rng.choice([1.0, 1.5], len(L)) if scene.sections else 1.0)
        state.eps_p[:] = rng.choice([0.0, 0.004], len(L))
    if scene.buckling:
        state.euler[:] = np.where(state.bar, rng.choice([0.6e6, np.inf], len(L)), np.inf)
    if scene.crushing:
        state.eps_c[:] = np.where(state.bar, -0.025, -np.inf)
    if scene.fracture:
        state.eps_u[:] = rng.choice([0.025, 0.027], len(L)) if scene.strengths else 0.025
    return state


@kernel
def run_chunk(c: int, work: LoopState) -> int:
    return chunk_forces(c, 0, work)


def chunks_of(plan: StepPlan) -> Chunks:
    """Return the chunks of the loop."""
    return plan._works[False].chunks


def forces_of(state: State, plain: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Forces (n, 3) [N] of the elements by the vector kernels, and which particles have some near a limit.

    plain : False: by the general kernel even where a simpler one would do
    """
    forces, flags = np.zeros_like(state.x), np.zeros(state.n_owned, bool)
    plan = StepPlan(state, NoHalo())
    chunks, scratch, work = chunks_of(plan), plan.scratch, plan._works[False]
    if not plain:
        work = work.with_values(elastic_forces=0, inelastic_forces=general_forces.address)
    for c, (low, high) in enumerate(zip(chunks.low, chunks.high)):
        any_near = run_chunk(c, work)
        forces[low:high], flags[low:high] = scratch.f[:, : high - low].T, scratch.margin[: high - low] < 0.0
        assert bool(any_near) == flags[low:high].any()
    return forces, flags


def law_forces(state: State) -> np.ndarray:
    """Return the same forces by the law of one element."""
    now, expected = state.present_element_state(), np.zeros_like(state.x)
    add_axial_forces(state.x, state.ends, now.N, now.L, expected)
    return expected


def assert_close(computed: np.ndarray, expected: np.ndarray) -> None:
    assert np.abs(computed - expected).max() <= ROUNDING * np.abs(expected).max()


def lattice() -> np.ndarray:
    """Return elements (m, 2) of the square lattice of 40 x 40 particles, in ascending order."""
    number = np.arange(1600).reshape(40, 40)
    along = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    across = np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    elements = np.concatenate([along, across])
    return elements[np.lexsort((elements[:, 1], elements[:, 0]))]


FEATURES = ("plastic", "fracture", "logarithmic", "bars", "sections")
ROUNDING = 1e-12  # of the largest force; there are thirteen terms at the hub
EVERY = list(map("".join, itertools.product("01", repeat=5)))
NAMES = {row: "-".join(itertools.compress(FEATURES, map(int, row))) or "none" for row in EVERY}
PLAIN = [row for row in EVERY if row[FEATURES.index("logarithmic")] == "0"]
LATTICE = np.column_stack([np.arange(1600) % 40, np.arange(1600) // 40, np.zeros(1600)])


def scene_of(row: str) -> Features:
    """Return the feature set of a row of zeros and ones."""
    has = {name: one == "1" for name, one in zip(FEATURES, row)}
    strain = "logarithmic" if has.pop("logarithmic") else "engineering"
    strengths, buckling = has["fracture"] and has["sections"], has["bars"] and has["sections"]
    return Features(strain=strain, strengths=strengths, buckling=buckling, **has)


SCENES = {row: scene_of(row) for row in EVERY}
ALL_FEATURES = SCENES["11111"]


def of_scenes(rows: list[str]):
    """Parametrise a test by feature sets."""
    return pytest.mark.parametrize("scene", [pytest.param(SCENES[row], id=NAMES[row]) for row in rows])


@of_scenes(EVERY)
def test_vector_kernels_agree_with_the_element_law(scene):
    """To rounding. They report every particle with an element beyond yield or fracture."""
    state = random_state(scene, 1)
    now, expected = state.present_element_state(), law_forces(state)
    eps, eps_p = now.eps, now.eps_p
    forces, flags = forces_of(state)
    assert_close(forces, expected)
    if scene.inelastic:
        over = np.zeros(state.m, bool)
        if scene.plastic:  # bars are pointed at, cables yield
            over |= (eps_p != state.eps_p) & (state.bar == 1)
            collect_elements(state.n_owned, state.first_split, state.elements, state.slots, state.law)
            cable = state.bar == 0
            assert np.abs(state.eps_p - eps_p)[cable].max() < 1e-12 and (eps_p > 0.004)[cable].any()
        if scene.fracture:
            over |= eps > state.eps_u
        assert (over.any() or not (scene.fracture or scene.bars)) and flags[state.ends[over]].all()


def share_in_line(state: State) -> float:
    """Return the share of vectors of owned particles whose far ends are consecutive."""
    others = state.other[:, : state.n_owned - state.n_owned % LANES].astype(np.int64)
    steps = np.diff(others.reshape(len(others), -1, LANES), axis=2)
    return float((steps == 1).all((0, 2)).mean())


@of_scenes(PLAIN)
def test_fast_kernels_have_the_bits_of_the_general_one(scene):
    """On a grid of 40 x 40 most vectors load their far ends at once: forces and yield."""
    outcomes = []
    for plain in (True, False):
        state = make_state(scene, 1600, lattice(), LATTICE, 2)
        forces, _ = forces_of(state, plain)
        assert share_in_line(state) >= 0.6  # all except those at the ends of rows
        outcomes.append((forces.tobytes(), b"" if state.slot_eps_p is None else state.slot_eps_p.tobytes()))
    assert outcomes[0] == outcomes[1]


@of_scenes(PLAIN[:1])
def test_kernels_work_on_a_copy_in_one_piece_of_memory(scene):
    """As on a GPU: tables with the addresses of the copy lead them there, and the original stays."""
    work = StepPlan(make_state(scene, 1600, lattice(), LATTICE, 2), NoHalo())._works[False]
    places = GpuNet()
    places.give_places(work)
    memory = np.zeros(places.staged.size + 64, np.uint8)
    memory = memory[-memory.ctypes.data % 64 :]
    for pairs in places.groups:
        for array, place in pairs:
            place[...] = array
    places.write_tables(memory.ctypes.data)
    memory[: places.staged.size] = places.staged
    copied = work.with_values()
    copied.address = memory.ctypes.data + places.offsets[work.address]
    run_chunk(0, copied)
    assert not work.scratch.f.any()
    run_chunk(0, work)
    assert work.scratch.f.any()
    assert places.view(work.scratch.f, memory).tobytes() == work.scratch.f.tobytes()


@of_scenes([row for row in PLAIN if row[0] == "1"])
def test_yield_does_not_depend_on_earlier_yield(scene):
    """A chunk is first computed without yield, and again if an element yields: the same bits."""
    outcomes = []
    for yielded in (0, 1):
        state = make_state(scene, 1600, lattice(), LATTICE, 2)
        state.eps_p[:] = 0.0
        plan = StepPlan(state, NoHalo())
        chunks = chunks_of(plan)
        assert not chunks.has_yielded.any()
        chunks.has_yielded[:] = yielded
        run_chunk(0, plan._works[False])
        assert chunks.has_yielded[0] and (state.slot_eps_p > 0.0).any()
        outcomes.append((plan.scratch.f[:, :CHUNK].tobytes(), state.slot_eps_p.tobytes()))
    assert outcomes[0] == outcomes[1]


@of_scenes(["01000", "11000", "01110"])
def test_extreme_forces_agree_with_the_element_law(scene):
    """To rounding."""
    state = make_state(scene, 1600, lattice(), LATTICE, 2)
    N = state.present_element_state().N
    forces_of(state)
    collect_elements(state.n_owned, state.first_split, state.elements, state.slots, state.law)
    assert np.abs(state.highest - np.maximum(N, 0.0)).max() <= ROUNDING * np.abs(N).max()
    if scene.tracks_minima:
        assert np.abs(state.lowest - np.minimum(N, 0.0)).max() <= ROUNDING * np.abs(N).max()


@of_scenes(["11000", "11111"])
def test_missing_incident_elements_add_nothing(scene):
    """A lattice with gaps, and a disc, whose rows differ in length."""
    column, row = LATTICE[:, 0], LATTICE[:, 1]
    inside = np.hypot(column - 19.5, 1.3 * (row - 19.5)) < 20
    number, whole = np.cumsum(inside) - 1, lattice()
    with_gaps = whole[np.random.default_rng(4).random(len(whole)) > 0.05]
    x = np.column_stack([column, 1.1 * row, 0.1 * np.sin(np.arange(1600))])
    for elements, places in ((with_gaps, x), (number[whole[inside[whole].all(1)]], x[inside])):
        state = make_state(scene, len(places), elements, places, 2)
        expected = law_forces(state)
        assert_close(forces_of(state)[0], expected)
        assert (state.inv_L0[:, : state.n_owned] == 0.0).any()
