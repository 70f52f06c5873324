"""Loads inside a removed cable are redistributed to its ends: by hand, by refinement, with equal bits."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import assert_same_results, audits
from mpi4py import MPI
from nets import saddle
from test_removal import GUSTS, LOSSES, breaking

from netfall.driver.dynamics.varying_loads import FadingLoad
from netfall.driver.sample import run_sample
from netfall.geometry.net import GRAVITY
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.loads.removal import redistribute
from netfall.physics.fields import Features
from netfall.physics.removal import remove_particles, transfer_carried
from netfall.physics.state import State


def shares_of_removal(pairs, cable, L0, loose, torn=()):
    """Return shares {node: {receiver: share}} if all elements (node, node) are removed."""
    pairs = np.array(pairs)
    net = SimpleNamespace(elements=pairs, cable=np.array(cable))
    flags = np.isin(np.arange(pairs.max() + 1), loose)
    result = redistribute(net, np.array(L0, float), np.arange(len(pairs)), flags, torn)
    shares = {int(p): {} for p in result.particles}
    for k, receiver, share in zip(result.source, result.receiver, result.share):
        shares[int(result.particles[k])][int(receiver)] = float(share)
    return shares


CHAIN = [(0, 1), (1, 2), (2, 3)]


def test_a_chain_is_shared_by_the_lever_rule():
    """Parts of 1, 2 and 3 m: a node 1 m from one end and 5 m from the other gives it 5/6."""
    shares = shares_of_removal(CHAIN, [0, 0, 0], [1, 2, 3], [1, 2])
    assert shares == {1: {0: pytest.approx(5 / 6), 3: pytest.approx(1 / 6)}, 2: {0: 0.5, 3: 0.5}}
    backwards = shares_of_removal([(2, 3), (2, 1), (1, 0)], [0, 0, 0], [3, 2, 1], [1, 2])
    assert backwards == shares


def test_an_unsupported_end_receives_no_load():
    """The other end receives everything. Without a supported end nothing is redistributed."""
    assert shares_of_removal(CHAIN, [0, 0, 0], [1, 2, 3], [1, 2, 3]) == {1: {0: 1.0}, 2: {0: 1.0}}
    assert shares_of_removal(CHAIN, [0, 0, 0], [1, 2, 3], [0, 1, 2, 3]) == {}


def test_no_load_is_redistributed_along_broken_elements():
    """Each side of the broken part goes to its own end. A node between two broken parts keeps its load."""
    assert shares_of_removal(CHAIN, [0, 0, 0], [1, 2, 3], [1, 2], {1}) == {1: {0: 1.0}, 2: {3: 1.0}}
    assert shares_of_removal(CHAIN, [0, 0, 0], [1, 2, 3], [1, 2], {0, 1}) == {2: {3: 1.0}}


def test_the_end_of_a_removed_cable_keeps_its_loads():
    """A weight at the joint of two removed cables is inside neither, so it falls."""
    assert shares_of_removal(CHAIN, [0, 1, 1], [1, 2, 3], [1, 2]) == {2: {3: 1.0}}


def test_a_hanger_receives_no_load_of_its_cable():
    """A removed hanger between node 1 of a removed chain and node 4, in one part or in two."""
    whole = shares_of_removal([*CHAIN, (1, 4)], [0, 0, 0, 1], [1, 2, 3, 4], [1, 2])
    divided = shares_of_removal([*CHAIN, (1, 5), (5, 4)], [0, 0, 0, 1, 1], [1, 2, 3, 2, 2], [1, 2, 5])
    assert whole == {1: {0: pytest.approx(5 / 6), 3: pytest.approx(1 / 6)}, 2: {0: 0.5, 3: 0.5}}
    middle = {0: pytest.approx(5 / 12), 3: pytest.approx(1 / 12), 4: 0.5}
    assert {p: divided[p] for p in whole} == whole and divided[5] == middle


def test_all_ends_of_removed_crossing_cables_receive_a_share():
    """Each end has the inverse of its distance: 1, 2, 3 and 6 m give 6, 3, 2 and 1 twelfths."""
    cross = shares_of_removal([(1, 0), (0, 2), (3, 0), (0, 4)], [0, 0, 1, 1], [1, 2, 3, 6], [0])
    assert cross[0] == {k: pytest.approx(share / 12) for k, share in ((1, 6), (2, 3), (3, 2), (4, 1))}


def test_the_loads_of_a_removed_grid_go_to_its_border():
    """3 x 3 crossings 1 m apart: the middle has four ends at 2 m, a corner two at 1 m and two at 3 m."""
    number = np.arange(25).reshape(5, 5)
    lines = [number[k] for k in (1, 2, 3)] + [number[:, k] for k in (1, 2, 3)]
    pairs = [(int(a), int(b)) for line in lines for a, b in pairwise(line)]
    result = shares_of_removal(pairs, np.repeat(np.arange(6), 4), np.ones(24), number[1:-1, 1:-1].ravel())
    assert result[12] == {2: 0.25, 10: 0.25, 14: 0.25, 22: 0.25}
    assert result[6] == {k: pytest.approx(w / 8) for k, w in ((1, 3), (5, 3), (9, 1), (21, 1))}
    assert all(sum(shares.values()) == pytest.approx(1.0) for shares in result.values()) and len(result) == 9


def test_an_unsupported_ring_keeps_its_loads():
    """A closed cable without a supported node has no ends; one supported node receives everything."""
    ring = [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert shares_of_removal(ring, [0] * 4, [1, 1, 1, 1], [0, 1, 2, 3]) == {}
    assert shares_of_removal(ring, [0] * 4, [1, 1, 1, 1], [1, 2, 3]) == {
        1: {0: 1.0},
        2: {0: 1.0},
        3: {0: 1.0},
    }


def test_redistribution_keeps_resultant_and_moment():
    """For a straight cable with random loads at random positions."""
    rng = np.random.default_rng(1)
    along = np.sort(rng.uniform(0.0, 9.0, 12))
    x = np.outer(along, [1.0, 2.0, -2.0]) / 3.0
    pairs = np.column_stack([np.arange(11), np.arange(1, 12)])
    net = SimpleNamespace(elements=pairs, cable=np.zeros(11, int))
    loose = np.ones(12, bool)
    loose[[0, 11]] = False
    handed = redistribute(net, np.diff(along), np.arange(11), loose)
    force = rng.normal(size=(12, 3))
    after = force.copy()
    handed.move(after, np.arange(12))
    assert (after[1:-1] == 0).all() and np.abs(after[[0, -1]] - force[[0, -1]]).min() > 0
    assert after.sum(0) == pytest.approx(force.sum(0), abs=1e-14)
    assert np.cross(x, after).sum(0) == pytest.approx(np.cross(x, force).sum(0), abs=1e-13)


def test_redistributed_mass_keeps_its_momentum():
    """1 kg at 3 m/s and half of 4 kg at -2 m/s give 3 kg at -1/3 m/s. Held nodes stay; the work balances."""
    state = State(Features(wind=True), 3, 0, 0)
    state.free[:] = [[1, 1, 1], [1, 0, 1], [1, 1, 1]]
    state.mass[:], state.v[:, 0], state.v[2, 1] = [1.0, 1.0, 4.0], [3.0, 0.0, -2.0], 5.0
    state.load[:, 2], state.wind[:, 2] = [-10.0, -20.0, -40.0], [0.1, 0.2, 0.8]
    kinetic = lambda: float((0.5 * state.mass * (state.v**2).sum(1)).sum())
    before, source, share = kinetic(), np.array([0, 0]), np.array([0.5, 0.5])
    given = {name: getattr(state, name)[2:].copy() for name in ("mass", "v", "load", "wind")}
    transfer_carried(state, np.array([0, 1]), source, share, given)
    remove_particles(state, np.array([2]))
    assert state.mass.tolist() == [3.0, 3.0, 0.0]
    assert state.v[:, 0] == pytest.approx([-1 / 3, -4 / 3, 0.0])
    assert state.v[:, 1] == pytest.approx([10 / 3, 0.0, 0.0])  # the second one is held along y
    assert state.load[:, 2].tolist() == [-30.0, -40.0, 0.0]
    assert state.wind[:, 2] == pytest.approx([0.5, 0.6, 0.0])
    assert state.work.sum() == pytest.approx(kinetic() - before, rel=1e-14) and kinetic() < before


def test_a_fading_chain_pulls_its_ends_by_the_horizontal_force():
    """A sagging chain under 10 and 20 N at 1 and 3 of 6 m: the end forces without the shares are H. By hand:
    the right support carries (10 * 1 + 20 * 3) / 6 = 35/3 N, the left one 55/3 N; H = 50 N.
    """
    left, H = 55 / 3, 50.0
    force = np.array([[H, 0, -left], [H, 0, -left + 10.0], [H, 0, -left + 30.0]])  # on the start of each
    ends = np.array([[0, 1], [1, 2], [2, 3]])
    net = SimpleNamespace(elements=ends, cable=np.zeros(3, int))
    handed = redistribute(net, np.array([1.0, 2.0, 3.0]), np.arange(3), np.array([False, True, True, False]))
    state = SimpleNamespace(load_before=np.zeros((4, 3)), load_after=np.zeros((4, 3)), fading_before=None)
    fade = FadingLoad(np.arange(4), 2.0)
    fade.begin(1.0, ends, force, np.arange(3))
    fade.redistribute(handed, None)
    fade.write(state, 1.0, 2.0)
    assert state.load_before == pytest.approx(np.array([[H, 0, 0], [0] * 3, [0] * 3, [-H, 0, 0]]), abs=1e-12)
    assert state.load_after == pytest.approx(0.5 * state.load_before, abs=1e-12)


# --- a cable with all kinds of loads

HANGER = 10.0  # m
HUNG = """
[cable]
modulus = 1.6e11
area = 1e-4
density = 7850.0
[load]
self_weight = true
dead = 40.0
snow = 60.0
pressure = [30.0, 0.0, -80.0]
ramp = 0.2
tolerance = 1e-10
[wind]
speed = 30.0
pressure_coefficient = 0.4
surface_drag = 0.0
profile_exponent = 0.0
base_height = 50.0
onset = "sudden"
[dynamics]
duration = 0.6
mass_damping = 3.0
fragments = false
[output]
history_interval = 0.01
[[remove]]
elements = [2, 3, 4]
time = 0.3
duration = 0.05
"""
AREA, MASS, LOAD = np.array([2.0, 3.0, 5.0, 1.5]), np.array([0.0, 10.0, 0.0, 0.0]), [0.0, -200.0, 0.0, -50.0]
# N on held nodes: loads along x from the start avoid a second compilation
SIDEWAYS = (1, 0, 0, 0)
AT = np.array([0.0, 1.0, 3.0, 6.0])  # m, along the chain


def hung(parts):
    """Return two hangers and a chain of three elements between their lower ends that carries a roof."""
    nodes = [
        "id, x, y, z, fixed_x, fixed_y, fixed_z, area, normal_x, normal_y, normal_z, mass, load_x, load_z"
    ]
    nodes += [f"{k}, {x}, 0, 0, 1, 1, 1, 0, 0, 0, 1, 0, 0, 0" for k, x in ((10, 0.0), (11, 6.0))]
    for k in range(4):
        held = "1, 1, 0" if k in (0, 3) else "0, 0, 0"
        nodes.append(
            f"{k}, {AT[k]}, 0, {-HANGER}, {held}, {AREA[k]}, 0, 0, 1, {MASS[k]}, {SIDEWAYS[k]}, {LOAD[k]}"
        )
    elements = ["id, start, end, unstressed_length", f"0, 10, 0, {HANGER}", f"1, 11, 3, {HANGER}"]
    elements += [f"{k + 2}, {k}, {k + 1}, {AT[k + 1] - AT[k]}" for k in range(3)]
    return f'[net]\nnodes = "nodes.csv"\nelements = "elements.csv"\nsubdivide = {parts}\n', nodes, elements


def hung_job(workshop, parts):
    net, nodes, elements = hung(parts)
    (workshop.folder / "nodes.csv").write_text("\n".join(nodes))
    (workshop.folder / "elements.csv").write_text("\n".join(elements))
    return workshop.job(net + HUNG, name=f"hung{parts}")


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_the_hangers_carry_all_loads_of_the_removed_cable(workshop, parts):
    """Dead load, snow, a pressure ramp, wind, weights and self weight, each by the lever rule."""
    pressed = 0.4 * 0.5 * 1.25 * 30.0**2  # N/m2, of the wind; the density of air is that of the schema
    down = (40.0 + 60.0 + 80.0 + pressed) * AREA - np.array(LOAD)
    own = GRAVITY * 7850.0 * 1e-4 * np.diff(AT, prepend=0.0, append=6.0)
    down += 0.5 * (own[:-1] + own[1:])
    to_left = 1.0 - AT / 6.0
    exact = np.array([to_left @ down, (1.0 - to_left) @ down])
    with workshop.run(hung_job(workshop, parts)) as f:
        number = np.array([np.flatnonzero(f["net/element_id"][:] == k)[-1] for k in (0, 1)])
        own_hanger = GRAVITY * 7850.0 * 1e-4 * HANGER * 0.5 / parts  # at the lower end of the lowest part
        assert f["removal/tension_after"][0][number] == pytest.approx(exact + own_hanger, rel=1e-8)
        assert (audits(f) < (1e-12, 2e-3)).all()  # rounding; the step
        inner = np.flatnonzero(np.isin(f["net/node_id"][:], [1, 2]))
        assert (f["final/velocity"][:][inner] == 0).all()


# --- a roof

ROOF = breaking(0.0047) + "dead = 60.0\npressure = -100.0\nramp = 0.4\ntolerance = 1e-3\n"
ROOF += GUSTS.format(40.0, 'onset = "sudden"') + LOSSES
ROOF += """[[remove]]
elements = [0, 1, 2, 3, 5, 6, 7, 8, 9, 30, 31]
time = 0.3
duration = 0.1
[output]
history_interval = 0.02
checkpoint_interval = 0.15
probes = [[0.0, 0.0], 15, [10.0, 6.0, 2.0]]
elements = [40, 20, 33]
"""


@pytest.mark.parametrize("what_leaves, restarts", [("particle", [1, 2]), ("panels", [1])])
def test_a_roof_with_fractures_and_removals_has_the_same_bits(workshop, what_leaves, restarts):
    """On two ranks and from checkpoints in a fade, in a load ramp, and in the step of a removal."""
    text = ROOF.replace("seed = 3", f'seed = 3\nafter_fracture = "{what_leaves}"')
    if what_leaves == "panels":  # no load that grows, nor, for the scene is that of the other, along x or y
        text = text.replace("pressure = -100.0\nramp = 0.4", "pressure = [0.0, 0.0, 100.0]")
        text = text.replace(LOSSES, LOSSES[LOSSES.index("[[remove]]", 1) :])  # each has a static stage
    job = workshop.job(text)
    with workshop.run(job) as one, workshop.run(job, ranks=2, output="two.vtkhdf") as two:
        assert_same_results(one, two)
        lost, time = one["removal/element"][:], one["removal/time"][:][one["removal/entry"][:]]
        broke = dict(zip(one["events/element"][:].tolist(), one["events/time"][:].tolist()))
        assert sum(broke.get(e, np.inf) < t for e, t in zip(lost.tolist(), time)) >= 3
        assert np.abs(one["history/work_identity_error"][:]).max() < 1e-12  # rounding
        checkpoints = sorted(workshop.folder.glob("two.checkpoint*"))
        assert len(checkpoints) == 2
        for checkpoint, ranks in zip(checkpoints[-len(restarts) :], restarts):
            with workshop.run(job, "--restart", checkpoint, ranks=ranks, output="again.vtkhdf") as again:
                assert_same_results(one, again)


STANDING = """[load]
self_weight = true
dead = 50.0
tolerance = 1e-9
[dynamics]
duration = 1.0
mass_damping = 2.0
[[remove]]
elements = [20]
time = 0.05
duration = 0.3
[output]
history_interval = 0.02
"""


def test_answers_do_not_depend_on_the_refinement(workshop):
    """With subdivide 1, 2, 4, 8, 16 equilibria come nearer as the square of the parts; no roof goes.

    From 2 on: with 1 the faces have four corners and are shared by triangles, with more they have eight and
    more and are shared by nearest corner, so that step is between two rules.
    """
    results, lost = [], []
    for parts in (1, 2, 4, 8, 16):
        job = workshop.job(saddle("", parts=parts, prestress=400e3) + STANDING)
        with workshop.run(job, output=f"{parts}.vtkhdf") as f:
            mean = lambda values: values.reshape(-1, parts).mean(1)
            g, nodes = f["removal"], np.flatnonzero(f["net/node_id"][:] < 45)
            before, after = mean(f["initial_state/tension"][:]), mean(g["tension_after"][0])
            factor = g["dynamic_factor"][0].reshape(-1, parts)[:, 0]
            place, moved = f["initial_state/position"][:][nodes], f["envelope/displacement_max"][:][nodes]
            results.append((before, after, place, factor, moved))
        if parts < 8:
            outcome = run_sample(MPI.COMM_WORLD, lambda job=job: read_job(job), None, ResultCache())
            lost.append((outcome["state"], outcome["detached_area"]))
    assert lost == [("finished", 0.0)] * 3
    for values in list(zip(*results))[:3]:
        steps = [np.abs(b - a).max() for a, b in pairwise(values)]
        ratios = np.array(steps[:-1]) / steps[1:]
        assert ((ratios > 3.5) & (ratios < 4.5))[1:].all() and ratios[0] > 3.5, (steps, ratios)
    (_, _, _, coarse, moved), (before, after, _, fine, moved_finer) = results[2:4]
    has_changed = (np.abs(after - before) > 0.1 * before.max()) & (after > 0)  # 0: removed
    assert has_changed.sum() > 3 and fine[has_changed] == pytest.approx(coarse[has_changed], rel=0.02)
    assert moved_finer.max() == pytest.approx(moved.max(), rel=0.02)
