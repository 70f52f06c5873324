"""The vector kernel of the step against the plain element law, for every kind of scene."""

import itertools

import numpy as np
import pytest

from netfall.mechanics.kernels import add_tensions, run_forces, slot_forces
from netfall.mechanics.state import Scene, State
from netfall.parallel.distribute import cut_net
from netfall.solve.stepping import CHUNK, Plan


class NoHalo:
    """One rank: nothing is sent."""

    send_index = np.zeros(0, np.uint32)


def random_state(scene: Scene, seed: int, n: int = 3 * CHUNK + 7) -> State:
    """Particles near a line, each tied to a few others, one to thirteen."""
    rng = np.random.default_rng(seed)
    hub = np.column_stack([np.zeros(13, np.int64), np.arange(20, 33)])
    elements = np.concatenate([np.sort(np.column_stack([np.repeat(np.arange(n), 2), rng.integers(0, n, 2 * n)]), axis=1), hub])
    elements = np.unique(elements[elements[:, 0] != elements[:, 1]], axis=0)
    return make_state(scene, n, elements, 50.0 * rng.normal(size=(n, 3)) * (1.0, 0.1, 0.02), seed)


def make_state(scene: Scene, n: int, elements: np.ndarray, x: np.ndarray, seed: int) -> State:
    """Elements of all kinds: some taut, some slack, some yielding, one without length."""
    rng = np.random.default_rng(seed)
    piece, = cut_net(n, elements, np.zeros(n, np.int32), 1)
    state = State(scene, n, 0, len(elements), int(np.bincount(elements.ravel()).max()))
    state.ends[:], state.owned[:], state.free[:], state.mass[:] = piece.ends, 1, 1, 1.0
    state.x[:] = x
    a, b = elements[3]
    state.x[b] = state.x[a]
    L = np.linalg.norm(state.x[elements[:, 1]] - state.x[elements[:, 0]], axis=1)
    state.L0[:] = np.maximum(L, 1.0) / (1 + rng.uniform(-0.02, 0.03, len(L)))
    state.EA[:] = 1e8 * (rng.choice([1.0, 2.5], len(L)) if scene.sections else 1.0)
    state.bar[:] = rng.integers(0, 2, len(L)) if scene.bars else 0
    if scene.plastic:
        state.yield_force[:] = 0.01 * 1e8 * (rng.choice([1.0, 1.5], len(L)) if scene.sections else 1.0)
        state.eps_p[:] = rng.choice([0.0, 0.004], len(L))
    if scene.fracture:
        state.eps_u[:] = 0.025
    return state


SCENES = list(itertools.product([False, True], repeat=5))


@pytest.mark.parametrize("plastic, fracture, logarithmic, bars, sections", SCENES)
def test_vector_kernel_gives_the_forces_of_the_element_law(plastic, fracture, logarithmic, bars, sections):
    """Equal to 1e-13 of the largest force; and it points at every particle with an element past yield or fracture."""
    scene = Scene(plastic=plastic, fracture=fracture, logarithmic=logarithmic, bars=bars, sections=sections)
    state = random_state(scene, 1)
    N, eps, eps_p, L = state.elements_now()
    expected = np.zeros_like(state.x)
    add_tensions(state.x, state.ends, N, L, expected)
    plan, found, near = Plan(state, NoHalo()), np.zeros_like(state.x), np.zeros(state.n_owned, bool)
    for c, width in enumerate(plan.chunk_width):
        low, high = c * CHUNK, min((c + 1) * CHUNK, state.n_owned)
        slot_forces(low, high, low, width, state.x, state.other, state.inv_L0, state.EA.max(), state.slot_EA, logarithmic or None, state.slot_bar,
                    state.yield_force.max() if plastic else None, state.slot_yield, state.slot_eps_p, state.reach, plan.f_int,
                    plan.near_of if scene.inelastic else None)
        found[low:high], near[low:high] = plan.f_int[: high - low], plan.near_of[: high - low] > 0
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max() * 10  # thirteen terms at the hub
    if scene.inelastic:
        over = np.zeros(state.m, bool)
        if plastic:
            over |= eps_p != state.eps_p
        if fracture:
            over |= eps > state.eps_u
        assert over.any() and near[state.ends[over]].all()


@pytest.mark.parametrize("plastic, fracture, logarithmic, bars, sections", SCENES)
def test_runs_give_the_bits_of_the_general_loop(plastic, fracture, logarithmic, bars, sections):
    """On a grid of 40 x 40, whose rows are runs: the same forces and the same particles pointed at."""
    scene = Scene(plastic=plastic, fracture=fracture, logarithmic=logarithmic, bars=bars, sections=sections)
    number = np.arange(1600).reshape(40, 40)
    along, across = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]), np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    elements = np.concatenate([along, across])
    elements = elements[np.lexsort((elements[:, 1], elements[:, 0]))]
    state = make_state(scene, 1600, elements, np.column_stack([number.ravel() % 40, number.ravel() // 40, np.zeros(1600)]), 2)
    plan = Plan(state, NoHalo())
    first, last, step, chunk_run = plan.runs
    regular = np.flatnonzero(step[:, 0] != 0)
    assert (last - first)[regular].sum() > 1300
    assert np.array_equal(np.concatenate([np.arange(a, b) for a, b in zip(first, last)]), np.arange(1600))
    common = (state.EA.max(), state.slot_EA, logarithmic or None, state.slot_bar, state.yield_force.max() if plastic else None, state.slot_yield,
              state.slot_eps_p, state.reach)
    for r in regular:
        rows = last[r] - first[r]
        outcomes = []
        for run in (True, False):
            f_int, near_of = np.full((CHUNK, 3), np.nan, order="F"), np.full(CHUNK, -1) if scene.inelastic else None
            if run:
                near = run_forces(first[r], last[r], first[r], step[r], state.x, state.inv_L0, *common, f_int, near_of)
            else:
                near = slot_forces(first[r], last[r], first[r], 4, state.x, state.other, state.inv_L0, *common, f_int, near_of)
            outcomes.append((near, f_int[:rows].tobytes(), near_of[:rows].tobytes() if scene.inelastic else b""))
        assert outcomes[0] == outcomes[1]
