"""The vector kernel of the step against the plain element law, for every kind of scene."""

import itertools

import numpy as np
import pytest

from netfall.ground.columns import LINE, PAGE
from netfall.ground.compile import kernel
from netfall.ground.handed import laid
from netfall.mechanics.elements import add_tensions
from netfall.mechanics.fields import FIELDS, Features
from netfall.mechanics.state import State
from netfall.parallel.halo import buffers_alone
from netfall.parallel.partition import metis_partition
from netfall.parallel.subdomain import cut_net
from netfall.step.limits import count_near
from netfall.step.loop import kick
from netfall.step.plan import CHUNK, Plan
from netfall.step.runs import BORROWING, end_all_loans
from netfall.step.slots import collect_elements

# Numbers of far ends wrap where kernels run as plain Python, as unsigned ones do.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


class NoHalo:
    """One rank: nothing is sent."""

    boundary, buffers = 0, buffers_alone()


def random_state(scene: Features, seed: int, n: int = CHUNK + 7) -> State:
    """Particles near a line, each tied to a few others, one to thirteen."""
    rng = np.random.default_rng(seed)
    hub = np.column_stack([np.zeros(13, np.int64), np.arange(20, 33)])
    elements = np.concatenate(
        [np.sort(np.column_stack([np.repeat(np.arange(n), 2), rng.integers(0, n, 2 * n)]), axis=1), hub]
    )
    elements = np.unique(elements[elements[:, 0] != elements[:, 1]], axis=0)
    return make_state(scene, n, elements, 50.0 * rng.normal(size=(n, 3)) * (1.0, 0.1, 0.02), seed)


def make_state(scene: Features, n: int, elements: np.ndarray, x: np.ndarray, seed: int) -> State:
    """Elements of all kinds: some taut, some slack, some yielding, one without length."""
    rng = np.random.default_rng(seed)
    (subdomain,) = cut_net(n, elements, np.zeros(n, np.int32), 1)
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
    if scene.fracture:
        state.eps_u[:] = rng.choice([0.025, 0.027], len(L)) if scene.strengths else 0.025
    return state


@kernel
def run_chunk(c, chunks, near, beside):
    """One chunk from rest, without load; what is near, where that is told."""
    kick(c, 0.0, 0.0, 0.0, chunks, beside)
    return 0 if near.shape[0] == 0 else count_near(near, chunks.high[c] - chunks.low[c])


def forces_of(state: State, in_runs: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Forces (n, 3) [N] by the vector loop, from rest without load;
    and whether a particle has elements near their limits.
    """
    plan, s = Plan(state, NoHalo()), state
    chunks, scratch = plan.chunks, plan.scratch
    runs = chunks.runs
    in_some = [runs.rest[slice(*span)] for span in runs.spans[:, 2:4]]
    in_some += [np.arange(*run[:2]) for span in runs.spans for run in runs.whole[slice(*span[:2])]]
    in_some += [np.arange(*chunk[:2]) for chunk in zip(chunks.low, chunks.high, runs.gathered) if chunk[2]]
    assert np.array_equal(np.sort(np.concatenate(in_some)), np.arange(s.n_owned))
    if not in_runs:
        runs.gathered[:] = 1
    found, near = np.zeros_like(s.x), np.zeros(s.n_owned, bool)
    for c, (low, high) in enumerate(zip(chunks.low, chunks.high)):
        count = run_chunk(c, laid(chunks), plan.found.near, laid(plan.beside))
        found[low:high] = np.column_stack(scratch.f)[: high - low]
        if s.features.inelastic:
            near[low:high] = scratch.near[: high - low]
            assert count == scratch.near[: high - low].sum()
    end_all_loans(chunks, state.slots)
    return found, near


def lattice(side: int) -> np.ndarray:
    """Elements (m, 2) of a square lattice, in ascending order."""
    number = np.arange(side * side).reshape(side, side)
    along, across = (
        np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
    )
    elements = np.concatenate([along, across])
    return elements[np.lexsort((elements[:, 1], elements[:, 0]))]


FEATURES = ("plastic", "fracture", "logarithmic", "bars", "sections")
ROUNDING = 1e-12  # of the largest force; there are thirteen terms at the hub
# Any two features, with and without, in some row: few, for each is compiled.
COVERING = ["00000", "11111", "00111", "11010", "10100", "11001", "01110"]
EVERY = list(map("".join, itertools.product("01", repeat=5)))
NAMES = {row: "-".join(itertools.compress(FEATURES, map(int, row))) or "none" for row in EVERY}


def scene_of(row: str) -> Features:
    """The scene of a row of zeros and ones."""
    there = {name: one == "1" for name, one in zip(FEATURES, row)}
    strain = "logarithmic" if there.pop("logarithmic") else "engineering"
    return Features(strain=strain, strengths=there["fracture"] and there["sections"], **there)


SCENES = {row: scene_of(row) for row in EVERY}
ALL_FEATURES = SCENES["11111"]
EVERY_SCENE = pytest.mark.parametrize(
    "scene",
    [
        pytest.param(SCENES[row], id=NAMES[row], marks=() if row in COVERING else pytest.mark.long)
        for row in EVERY
    ],
)


def test_scenes_that_are_always_tested_cover_all_pairs():
    """Of any two features each combination stands in some row."""
    pairs = lambda rows: {
        ((i, a), (j, b)) for row in rows for (i, a), (j, b) in itertools.combinations(enumerate(row), 2)
    }
    assert pairs(COVERING) == pairs(EVERY)


@EVERY_SCENE
def test_vector_kernel_gives_the_forces_of_the_element_law(scene):
    """To rounding; and it points at every particle with an element past yield or fracture."""
    state = random_state(scene, 1)
    N, eps, eps_p, L = state.elements_now()
    expected = np.zeros_like(state.x)
    add_tensions(state.x, state.ends, N, L, expected)
    found, near = forces_of(state)
    assert np.abs(found - expected).max() <= ROUNDING * np.abs(expected).max()
    if scene.inelastic:
        over = np.zeros(state.m, bool)
        if scene.plastic:  # bars are pointed at, cables yield
            over |= (eps_p != state.eps_p) & (state.bar == 1)
            collect_elements(state.n_owned, state.first_split, state.elements, state.slots, state.law)
            cable = state.bar == 0
            assert np.abs(state.eps_p - eps_p)[cable].max() < 1e-12 and (eps_p > 0.004)[cable].any()
        if scene.fracture:
            over |= eps > state.eps_u
        assert (over.any() or not (scene.fracture or scene.bars)) and near[state.ends[over]].all()


@EVERY_SCENE
def test_runs_give_the_bits_of_the_general_loop(scene):
    """On a grid of 40 x 40, whose rows are runs: the same forces, yield and particles pointed at."""
    state = make_state(
        scene,
        1600,
        lattice(40),
        np.column_stack([np.arange(1600) % 40, np.arange(1600) // 40, np.zeros(1600)]),
        2,
    )
    whole = Plan(state, NoHalo()).chunks.runs.whole
    assert (whole[:, 1] - whole[:, 0]) @ (whole[:, -1] == BORROWING) > 1300
    outcomes = []
    for in_runs in (True, False):
        found = *forces_of(state, in_runs), np.zeros(0) if state.slot_eps_p is None else state.slot_eps_p
        outcomes.append([values.tobytes() for values in found])
    assert outcomes[0] == outcomes[1]


def test_runs_keep_the_extreme_forces_of_each_element():
    """Where particles borrow elements, at the lenders' ends; in another order of the elements, at both.

    The forces of the element law, to rounding.
    """
    across = np.abs(np.diff(lattice(40), axis=1).ravel()) > 1
    x = np.column_stack([np.arange(1600) % 40, np.arange(1600) // 40, np.zeros(1600)])
    for order, kind in ((np.arange(len(across)), BORROWING), (np.argsort(across, kind="stable"), 0)):
        state = make_state(SCENES["01110"], 1600, lattice(40)[order], x, 2)
        runs = Plan(state, NoHalo()).chunks.runs
        inside = (runs.whole[:, 1] - runs.whole[:, 0]) @ (runs.whole[:, -1] == kind)
        assert inside > 1200 and runs.rest.any()
        forces_of(state)
        collect_elements(state.n_owned, state.first_split, state.elements, state.slots, state.law)
        N = state.elements_now().N
        for kept, expected in ((state.highest, np.maximum(N, 0.0)), (state.lowest, np.minimum(N, 0.0))):
            assert np.abs(kept - expected).max() <= ROUNDING * np.abs(N).max()


def test_a_lattice_with_gaps_is_one_run_for_each_chunk():
    """Where a particle lacks an element that its neighbours have, empty slots stand so that the run goes on;
    the forces have the same bits.
    """
    elements = lattice(40)
    elements = elements[np.random.default_rng(4).random(len(elements)) > 0.05]
    x = np.column_stack([np.arange(1600) % 40, np.arange(1600) // 40, 0.1 * np.sin(np.arange(1600))])
    state = make_state(ALL_FEATURES, 1600, elements, x, 2)
    whole = Plan(state, NoHalo()).chunks.runs.whole
    assert (whole[:, 1] - whole[:, 0]).max() > 1400
    N, _, _, L = state.elements_now()
    expected = np.zeros_like(state.x)
    add_tensions(state.x, state.ends, N, L, expected)
    found = forces_of(state)[0]
    assert np.abs(found - expected).max() <= ROUNDING * np.abs(expected).max()
    assert found.tobytes() == forces_of(state, in_runs=False)[0].tobytes()


def test_a_net_numbered_at_random_is_stepped_in_layers():
    """Neighbours then stand near each other in a rank's rows; a net in good order keeps it."""
    elements = lattice(40)
    shuffled = np.random.default_rng(5).permutation(1600)[elements]
    for given, in_order in ((elements, True), (shuffled, False)):
        (subdomain,) = cut_net(1600, given, np.zeros(1600, np.int32), 1)
        assert np.array_equal(subdomain.particle_gid, np.arange(1600)) == in_order
        rows = subdomain.ends.astype(np.int64)
        assert np.abs(rows[:, 0] - rows[:, 1]).mean() < 60
        assert np.array_equal(subdomain.particle_gid[rows], given)


def test_a_net_of_short_rows_is_gone_through_without_runs():
    """A disc, whose rows differ in length."""
    side = 24
    column, row = np.arange(side**2) % side, np.arange(side**2) // side
    inside = np.hypot(column - 11.5, 1.3 * (row - 11.5)) < 12
    number = np.cumsum(inside) - 1
    elements = lattice(side)
    elements = number[elements[inside[elements].all(1)]]
    x = np.column_stack([column, 1.1 * row, 0.1 * np.sin(np.arange(side**2))])[inside]
    state = make_state(ALL_FEATURES, len(x), elements, x, 2)
    assert Plan(state, NoHalo()).chunks.runs.gathered.all()
    N, _, _, L = state.elements_now()
    expected = np.zeros_like(state.x)
    add_tensions(state.x, state.ends, N, L, expected)
    assert np.abs(forces_of(state)[0] - expected).max() <= ROUNDING * np.abs(expected).max()


def test_a_cut_leaves_the_rows_of_a_lattice_whole():
    """METIS's halves of a lattice:
    almost no element along the rows is cut, runs are longer than a row, and few particles are in none.
    """
    side = 120
    part = metis_partition(side**2, lattice(side), 2)
    cut = lattice(side)[(part[lattice(side)] != part[lattice(side)[:, :1]]).any(1)]
    assert len(cut) < 1.2 * side and (np.diff(cut) == 1).sum() < 0.1 * side
    for subdomain in cut_net(side**2, lattice(side), part, 2):
        state = State(Features(), subdomain.n_owned, subdomain.n_halo, len(subdomain.element_gid))
        state.ends[:], state.EA[:], state.L0[:] = subdomain.ends, 1.0, 1.0
        halo = NoHalo()
        halo.boundary = int(subdomain.send_index.max()) + 1
        runs = Plan(state, halo).chunks.runs
        assert (runs.whole[:, 1] - runs.whole[:, 0]).max() > 4 * side and (
            runs.spans[:, 3] - runs.spans[:, 2]
        ).sum() < 0.02 * subdomain.n_owned


@pytest.mark.parametrize("n", [512, 4096, 66049])
def test_columns_of_a_step_begin_apart_within_a_page(n):
    state = State(Features(plastic=True, fracture=True, wind=True, energy=True, air=True), n, 0, 2 * n)
    grown = state.copy()
    grown.reserve(n // 4)
    for each in (state, state.copy(), grown):
        arrays = [(f, getattr(each, f.name)) for f in FIELDS if f.entity != "element"]
        tables = [a if f.entity == "slot" else a.reshape(len(a), -1).T for f, a in arrays if a is not None]
        begin = np.array([column.ctypes.data for table in tables for column in table])
        assert (begin % LINE == 0).all()
        assert len(begin) > 40
        assert np.bincount(begin % PAGE // LINE).max() <= 3  # the cache has room for eight
