"""Chains of bars that resist bending: forces, tangent, critical loads, elastica, toggle, static jobs."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import ROOT, STEEL, assert_same_bits_on, audits
from nets import pulls, table
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from netfall.core.kernels import kernel
from netfall.geometry.build import build_net
from netfall.geometry.cables import CHAIN_END, NO_BENDING, find_bending_chains
from netfall.job.read import read_job
from netfall.physics.bending import (
    Joints,
    add_bending_forces,
    add_joint_bounds,
    add_joint_stiffness,
    curvatures,
    joint_energy,
    joint_moments,
    joint_tangents,
)
from netfall.physics.elements import add_stiffness
from netfall.post.checks.ends import end_weights

# Critical pressure of rings of 12, 24, 36 bars, times r^3 / EI, r of the nodes: pressure that
# follows, that keeps its direction, that points to the centre. Limits 3, 4, 4.5.
RINGS = {12: (2.82843, 3.86370, 4.29530), 24: (2.95715, 3.96578, 4.44865), 36: (2.98096, 3.98467, 4.47717)}
ELASTICA = {1.0: (0.301721, 0.056433), 2.0: (0.493457, 0.160642)}  # P L^2 / EI: w / L, u / L at the tip
TOGGLE = 33.860  # lb at 0.23 in: Williams' frame
EULER = {"one end free": 2.0, "hinged": 1.0, "one end hinged": 0.699, "clamped": 0.5}  # K
BAR = 'kind = "bar"\nmodulus = {}\narea = {}\ndensity = 7850.0\nsecond_moment = {}\nbending = true\n'


def row_of(count):
    """Return the joints of a number of particles in a row."""
    return np.column_stack([np.arange(count - 2) + k for k in range(3)]).astype(np.uint32)


@pytest.fixture
def crooked():
    """Return positions and joints of a crooked chain in space, whose unloaded shape is crooked too."""
    rng = np.random.default_rng(1)
    x = np.asfortranarray(np.cumsum(rng.normal(0.0, 1.0, (7, 3)) + [2.0, 0.0, 0.0], axis=0))
    return x, Joints(row_of(7), rng.uniform(1.0, 3.0, 5), rng.normal(0.0, 0.3, (5, 3)))


def forces(x, joints):
    f = np.zeros((len(x), 3))
    add_bending_forces(np.asfortranarray(x), joints, f)
    return f


def matrix_of(add, n):
    """Return the matrix (3 n, 3 n) of a function that adds the forces (n, 3) of displacements (n, 3)."""
    K = np.zeros((3 * n, 3 * n))
    for c, u in enumerate(np.eye(3 * n)):
        force = np.zeros((n, 3))
        add(u.reshape(n, 3), force)
        K[:, c] = force.ravel()
    return K


def dense(joints, stiffness, n):
    """Return the stiffness (3 n, 3 n) of joints."""
    return matrix_of(lambda u, force: add_joint_stiffness(u, joints.particles, stiffness, force), n)


def tangents(x, joints):
    pair = np.empty((2, len(joints.stiffness), 6, 6))
    joint_tangents(np.asfortranarray(x), joints, *pair)
    return pair


@kernel
def joint_energies(x, joints, energy):
    for k in range(energy.shape[0]):
        energy[k] = joint_energy(x, joints, k)


def energies(x, joints):
    each = np.empty(len(joints.stiffness))
    joint_energies(np.asfortranarray(x), joints, each)
    return each


def differences(of, x, step=1e-5):
    """Return the derivative of a function of positions by each of them."""
    columns = []
    for move in np.eye(x.size):
        d = step * move.reshape(x.shape)
        columns.append((of(x + d) - of(x - d)) / (2 * step))
    return np.array(columns)


def test_bending_forces_are_the_derivative_of_the_energy_and_balance(crooked):
    """f = -dU/dx. Their sum is zero, and the sum of moments is that at held sections, to rounding."""
    x, joints = crooked
    f = forces(x, joints)
    slope = differences(lambda x: energies(x, joints).sum(), x)
    assert np.abs(f.ravel() + slope).max() < 1e-8 * np.abs(f).max()  # of the differences
    assert np.abs(f.sum(0)).max() < 1e-14 * np.abs(f).sum()
    half = np.linalg.norm(joints.rest, axis=1, keepdims=True) / 2.0  # of the turn without moment: its tangent
    turn = Rotation.from_rotvec(np.arctan(half) / half * joints.rest)
    a, b = x[1:-1] - x[:-2], x[2:] - x[1:-1]
    normal, along = np.cross(turn.apply(a), b), (turn.apply(a) * b).sum(1)
    size = np.linalg.norm(normal, axis=1)
    m = (joints.stiffness * np.arctan2(size, along) / size)[:, None] * normal
    held = turn.inv().apply(m) - m
    assert np.abs(np.cross(x, f).sum(0) - held.sum(0)).max() < 1e-13 * np.abs(x).max() * np.abs(f).sum()
    moment, hold = np.empty((2, 5))
    joint_moments(x, joints, moment, hold)
    assert moment == pytest.approx(np.linalg.norm(m, axis=1), rel=1e-12)
    assert hold == pytest.approx(np.linalg.norm(held, axis=1), rel=1e-12)


def test_the_tangent_is_the_derivative_of_the_forces(crooked):
    """The tangent is symmetric, its part without moments positive, and the bound of each particle holds."""
    x, joints = crooked
    whole, positive = (dense(joints, K, 7) for K in tangents(x, joints))
    tangent = -differences(lambda x: forces(x, joints).ravel(), x)
    assert np.abs(whole - tangent).max() < 1e-9 * np.abs(whole).max()  # of the differences
    assert np.abs(whole - whole.T).max() < 1e-14 * np.abs(whole).max()
    assert np.linalg.eigvalsh(positive).min() > -1e-13 * np.abs(positive).max()
    bound = np.zeros(7)
    add_joint_bounds(x, joints, 1.0, bound)
    root = np.sqrt(np.repeat(bound, 3))
    assert np.linalg.eigvalsh(whole / root[:, None] / root).max() <= 3.0


def critical(K, K_load, rigid):
    """Return the least load factor at which K + factor K_load is singular except for rigid motions (d, r)."""
    free = np.linalg.svd(rigid)[0][:, rigid.shape[1] :] if rigid.size else np.eye(len(K))
    return 1.0 / eigh(-(free.T @ K_load @ free), free.T @ K @ free, eigvals_only=True).max()


def elements_stiffness(x, ends, axial, N):
    """Return the stiffness (3 n, 3 n) of bars with forces N; axial : [N/m]"""
    along = x[ends[:, 1]] - x[ends[:, 0]]
    L = np.linalg.norm(along, axis=1)
    each = ends, along / L[:, None], np.full(len(L), axial), N / L
    return matrix_of(lambda u, force: add_stiffness(u, *each, force), len(x))


@pytest.mark.parametrize("n", RINGS)
def test_rings_buckle_at_their_critical_pressures(n):
    """Rings of 12, 24 and 36 bars under the three pressures, in their plane, by the tangent."""
    turn, s = 2.0 * np.pi * np.arange(n) / n, np.sin(np.pi / n)
    x = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n)])
    ends = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)]).astype(np.uint32)
    particles = np.column_stack([np.roll(ends[:, 0], 1), ends]).astype(np.uint32)
    joints = Joints(particles, np.full(n, 0.5 / s), curvatures(x, particles))  # EI = 1, stiff along
    K = dense(joints, tangents(x, joints)[0], n) + elements_stiffness(x, ends, 1e7, np.zeros(n))
    compressed = elements_stiffness(x, ends, 0.0, np.full(n, -0.5 / s))  # of unit forces to the centre
    follows, central = np.zeros((2, 3 * n, 3 * n))
    per_area = 0.5 / s / np.cos(np.pi / n)
    for i, j in ends.astype(int):
        for a, b, sign in ((3 * i, 3 * j + 1, 0.5), (3 * j, 3 * i + 1, -0.5)):
            follows[a, b] += per_area * sign
            follows[b, a] += per_area * sign
        central[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = np.eye(3) - np.outer(x[i], x[i])
    plane = np.flatnonzero(np.arange(3 * n) % 3 < 2)
    rigid = np.zeros((n, 2, 3))
    rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
    rigid[:, 0, 2], rigid[:, 1, 2] = -x[:, 1], x[:, 0]
    for load, expected in zip((follows, np.zeros_like(follows), central), RINGS[n]):
        part = np.ix_(plane, plane)
        P = critical(K[part], (compressed + load)[part], rigid.reshape(-1, 3))
        assert P / (2.0 * s) / np.cos(np.pi / n) == pytest.approx(expected, rel=1e-4)  # bars stretch a little


def column(n, ends):
    """Return a column of length 1 of n bars, EI = 1: positions, with stubs at clamped ends, and held axes."""
    z, stub = np.linspace(0.0, 1.0, n + 1), 1e-7 / n
    low, high = {"one end free": (1, 0), "hinged": (0, 0), "one end hinged": (1, 0), "clamped": (1, 1)}[ends]
    z = np.concatenate([[-stub] * low, z, [1.0 + stub] * high])
    held = np.zeros((len(z), 2), bool)  # across and along
    held[: low + 1, 0] = held[: low + 1, 1] = True
    if ends != "one end free":
        held[len(z) - high - 1 :, 0] = True
    return z, held


def critical_column(n, ends):
    """Return the critical load of that column, by the tangent in its plane."""
    z, held = column(n, ends)
    x = np.column_stack([np.zeros((len(z), 2)), z])
    L, m = np.diff(z), len(z)
    pairs = np.column_stack([np.arange(m - 1), np.arange(1, m)]).astype(np.uint32)
    joints = Joints(row_of(m), 2.0 / (L[1:] + L[:-1]), np.zeros((m - 2, 3)))
    compressed = elements_stiffness(x, pairs, 0.0, -np.ones(m - 1))
    across = 3 * np.flatnonzero(~held[:, 0])
    K = dense(joints, tangents(x, joints)[0], m)[np.ix_(across, across)]
    return critical(K, compressed[np.ix_(across, across)], np.zeros((0, 0)))


@pytest.mark.parametrize("ends", EULER)
def test_columns_buckle_at_eulers_load(ends):
    """K is 2, 1, 0.699 or 0.5. With 12 and 24 bars the error falls as the square of their length."""
    coarse, fine = (critical_column(n, ends) for n in (12, 24))
    exact = 20.19072856 if ends == "one end hinged" else (np.pi / EULER[ends]) ** 2
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(exact, rel=1e-4)  # the error is of fourth order
    assert exact == pytest.approx((np.pi / EULER[ends]) ** 2, rel=1e-3)  # K has three digits
    assert fine < exact


def test_an_end_moment_bends_a_bar_to_a_circle():
    """2 pi EI / L closes the circle. In a regular polygon each joint has that moment, and no node a force."""
    n = 200
    turn = 2.0 * np.pi * np.arange(n + 1) / n
    side = 2.0 * np.sin(np.pi / n)
    x = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n + 1)]) / (n * side)  # bars of 1 / n
    joints = Joints(row_of(n + 1), np.full(n - 1, float(n)), np.zeros((n - 1, 3)))  # EI = L = 1
    f = forces(x, joints)
    couple = np.linalg.norm(f[0]) / n
    # sums of terms n times larger
    assert np.linalg.norm(f[2:-2], axis=1).max() < 1e-11 * np.linalg.norm(f[0])
    assert couple == pytest.approx(2.0 * np.pi, rel=1e-10)


def chain_job(workshop, places, held, load, section, more):
    """Return a job of a chain in the plane y = 0; held : (n, 2) x and z; load : (n,) down [N]"""
    rows = ((x, 0, z, int(a), 1, int(b), -P) for (x, z), (a, b), P in zip(places, held, load))
    nodes = table("id,x,y,z,fixed_x,fixed_y,fixed_z,load_z", ((p, *row) for p, row in enumerate(rows)))
    elements = table("start,end", pairwise(range(len(places))))
    return workshop.job("[cable]\n" + BAR.format(*section) + more, nodes, elements)


STIFF = (1e6, 1.0, 1e-6)  # modulus, area, second moment: EI = 1, EA = 1e6


def tip(workshop, n, P):
    """Return by how much the tip of a cantilever of length 1 sinks and shortens under P, with n bars."""
    places = np.array([[-1e-4 / n, 0.0], *[[k / n, 0.0] for k in range(n + 1)]])
    held = np.arange(n + 2)[:, None] < [2, 2]
    load = np.where(np.arange(n + 2) == n + 1, float(P), 0.0)
    more = "[load]\nself_weight = false\nsteps = 2\ntolerance = 1e-9\n"
    with workshop.run(chain_job(workshop, places, held, load, STIFF, more)) as f:
        d, moment = f["statics/displacement"][-1, -1], f["statics/bending_moment"][-1]
        reaction = f["statics/reaction"][-1].sum(0)
        assert reaction[2] == pytest.approx(-P, rel=1e-6)
        assert moment[1, 0] == pytest.approx(P * (1.0 + d[0]), rel=1e-5)  # force times arm
        assert moment[-1, 1] == 0.0
    return np.array([-d[2], -d[0]])


@pytest.mark.parametrize("P", ELASTICA)
def test_a_cantilever_is_an_elastica(workshop, P):
    """Tip for 10 and 20 bars, extrapolated, and elliptic integrals; moment and force at the support."""
    coarse, fine = tip(workshop, 10, P), tip(workshop, 20, P)
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(ELASTICA[P], rel=3e-4)  # of the fourth order


def toggle(workshop, n):
    """Return forces [lb] at which the apex of Williams' frame sinks by 0.22, 0.23, 0.24 in; n bars a leg."""
    s = np.linspace(-1.0, 1.0, 2 * n + 1)
    places = np.column_stack([12.943 * s, 0.386 * (1.0 - np.abs(s))])
    stubs = 1e-5 * (places[[1, -2]] - places[[0, -1]])
    places = np.concatenate([[places[0] - stubs[0]], places, [places[-1] - stubs[1]]])
    clamped = np.isin(np.arange(2 * n + 3), (0, 1, 2 * n + 1, 2 * n + 2))
    held = np.column_stack([clamped, clamped | (np.arange(2 * n + 3) == n + 1)])
    more = "[load]\nself_weight = false\ntolerance = 1e-9\n"
    sunk = (0.22, 0.23, 0.24)
    for v in sunk:
        more += f'[[case]]\nname = "{v}"\nsettlement = {{{n + 1} = [0.0, 0.0, {-v}]}}\n'
    section = 1.885e8, 1e-2, 9.27e3 / 1.885e8
    with workshop.run(chain_job(workshop, places, held, np.zeros(2 * n + 3), section, more)) as f:
        return np.array([f[f"cases/{v}/reaction"][n + 1, 2] for v in sunk])


def test_williams_toggle_has_its_limit(workshop):
    """33.860 lb at 0.23 in, and less before and after; legs of 10 and 20 bars, extrapolated."""
    before, at, after = (4.0 * toggle(workshop, 20) - toggle(workshop, 10)) / 3.0
    assert at == pytest.approx(TOGGLE, rel=1e-4)
    assert before < at and after < at


def hinged(workshop, share):
    """Return a hinged column of 10 bars under a share of its critical load, on rollers across."""
    n = 10
    places = np.column_stack([np.zeros(n + 1), np.arange(n + 1) / n])
    held = np.zeros((n + 1, 2), bool)
    held[0], held[-1, 0] = True, True
    P = share * 4.0 * n * n * np.sin(np.pi / 2.0 / n) ** 2  # of hinges with springs EI / l
    load = np.where(np.arange(n + 1) == n, P, 0.0)
    return chain_job(workshop, places, held, load, STIFF, "[load]\nself_weight = false\nsteps = 1\n")


def test_the_stability_check_includes_bending(workshop):
    """A column is stable at 0.99 of its critical load, and unstable at 1.01."""
    for share, stable in ((0.99, True), (1.01, False)):
        with workshop.run(hinged(workshop, share)) as f:
            assert f["statics/stable"][:].tolist() == [True, stable]
            assert f["statics"].attrs["state"] == ("equilibrium" if stable else "unstable")


RING = STEEL + "[group.ring]\n" + BAR.format(2.1e11, 1e-2, 1e-5) + "[group.other]\n"
RING += BAR.format(2e11, 1e-2, 1e-5)


def chains(workshop, elements, parts=1):
    """Return the joints of elements between nodes 1 to 6, by ids of nodes, and of the ends of each."""
    nodes = "id,x,y,z,fixed\n" + "".join(f"{k},{k},{k * k % 5},{k % 3},{int(k == 1)}\n" for k in range(1, 7))
    text = RING if "other" in elements else RING.partition("[group.other]")[0]
    job = read_job(workshop.job(text, nodes, elements), [f"net.subdivide={parts}"])
    net = build_net(job)
    result = find_bending_chains(net)
    ids = net.node_id[result.particles].tolist()
    return {(min(a, c), max(a, c), b) for a, b, c in ids}, result


def test_chains_continue_where_two_bars_of_a_group_meet(workshop):
    """Also at a support, at any angle; not between groups, nor where cables meet."""
    rows = "start,end,group\n2,1,ring\n2,3,ring\n4,3,ring\n4,5,other\n5,6,\n6,1,\n2,6,\n"
    result, chains_found = chains(workshop, rows)
    assert result == {(1, 3, 2), (2, 4, 3)}
    at = chains_found.at
    assert (at[3:] == NO_BENDING).all()  # the bar of the other group has no joint
    assert at[0, 1] == CHAIN_END and at[0, 0] == at[1, 0] >= 0
    parts, _ = chains(workshop, rows, parts=3)
    assert len(parts) == 2 + 2 * 4  # two inner nodes of each bar


def test_the_column_cable_says_which_bars_continue_at_a_node(workshop):
    """Four bars meet at a node. Without names none continues; with names the two of each name do."""
    rows = "start,end,group,cable\n1,2,ring,{}\n2,3,ring,{}\n4,2,ring,{}\n2,5,ring,{}\n5,6,ring,\n"
    assert chains(workshop, rows.format("", "", "", ""))[0] == {(2, 6, 5)}
    assert chains(workshop, rows.format("a", "a", "b", "b"))[0] == {(1, 3, 2), (4, 5, 2), (2, 6, 5)}


def test_a_single_bar_that_bends_is_a_warning(workshop):
    """Bending has no effect in a single bar."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n"
    job = workshop.job("[cable]\n" + BAR.format(*STIFF), nodes, "start,end\n1,2\n")
    assert "bending: no effect" in workshop.check(job)


@pytest.fixture(scope="module")
def bicycle(shared_workshop):
    """Return the shipped ring in snow, on one rank."""
    with shared_workshop.run(ROOT / "jobs" / "bicycle.toml") as f:
        yield f


def test_moments_of_a_ring_balance_its_spokes(bicycle):
    """Under snow on one half both sides of a joint have one moment, and nodes are in equilibrium."""
    g = bicycle["cases/snow east"]
    moment, ends = g["bending_moment"][:], bicycle["net/elements"][:]
    assert np.isnan(moment[24:]).all() and np.isfinite(moment[:24]).all()
    assert np.array_equal(moment[:24, 1], np.roll(moment[:24, 0], -1))
    x = bicycle["form_finding/position"][:] + g["displacement"][:]
    particles = np.column_stack([np.roll(ends[:24, 0], 1), ends[:24]]).astype(np.uint32)
    stiffness = np.full(24, 2.1e11 * 1.61e-3 / bicycle["net/unstressed_length"][0])
    joints = Joints(particles, stiffness, curvatures(bicycle["form_finding/position"][:], particles))
    f = forces(x, joints) + pulls(x, ends, g["tension"][:])
    free = np.isin(np.arange(24) % 6, (1, 2, 3, 4, 5))
    assert np.abs(f[:24][free, :2]).max() < 1e-5 * np.abs(g["tension"][:]).max()  # no load in plan
    assert np.nanmax(moment) > 100.0 * np.nanmax(bicycle["cases/snow/bending_moment"][:])


def test_the_report_has_moments(bicycle, shared_workshop):
    """The largest of each element with its state, the page, its picture. Parts of a chain have no check."""
    report = shared_workshop.report(pictures=True)
    rows = report.rows("elements")
    most = np.max([bicycle[f"cases/{name}/bending_moment"][:].max(1) for name in bicycle["cases"]], axis=0)
    assert [float(row["bending_moment_max"]) for row in rows[:24]] == pytest.approx(most[:24].tolist())
    assert rows[30]["bending_moment_max"] == rows[30]["case_moment"] == ""
    assert "result_en1993_buckling" not in rows[0] and rows[30]["result_en1993"] in ("", "passes")
    assert "## Bending" in report.page and (report.folder / "moments.png").exists()


def test_a_beam_vibrates_about_its_static_sag(workshop):
    """Under a sudden load it has twice the static sag and moment, at the period of a hinged beam."""
    n, span, EI, line, per_length = 12, 6.0, 2.1e11 * 2e-5, 4000.0, 0.005 * 7850.0
    places = np.column_stack([np.linspace(0.0, span, n + 1), np.zeros(n + 1)])
    held = np.zeros((n + 1, 2), bool)
    held[0], held[-1, 1] = True, True
    load = np.where(np.isin(np.arange(n + 1), (0, n)), 0.0, line * span / n)
    more = "[dynamics]\nduration = 0.08\n[output]\nhistory_interval = 0.001\nframes = 4\n"
    more += "probes = [[3.0, 0.0]]\n[modes]\ncount = 2\n"
    with workshop.run(chain_job(workshop, places, held, load, (2.1e11, 0.005, 2e-5), more)) as f:
        h, period = f["history"], 2.0 * span**2 / np.pi * np.sqrt(per_length / EI)
        assert f["modes/period"][0] == pytest.approx(period, rel=0.01)  # (pi / n)^2 / 6 of a lumped chain
        z = h["probe_displacement"][:, 0, 2]
        assert h["time"][np.argmin(z)] == pytest.approx(0.5 * period, abs=0.001)  # a row
        assert z.min() == pytest.approx(-2.0 * 5.0 * line * span**4 / (384.0 * EI), rel=0.03)  # higher modes
        most = f["envelope/bending_moment_max"][n // 2]
        assert most == pytest.approx(2.0 * line * span**2 / 8.0, rel=0.05)
        assert (audits(f) < (1e-12, 1e-4)).all()
        assert f["VTKHDF/CellData/bending_moment"].shape[1] == 2
        assert f["final/bending_moment"][0, 0] == 0.0 and f["final/bending_moment"][3].min() > 0.0


LOST = """
[[remove]]
elements = [103]
time = 0.02
[[remove]]
elements = [206]
time = 0.05
duration = 0.01
[dynamics]
duration = 0.6
mass_damping = 0.2
[output]
frames = 3
history_interval = 0.005
checkpoint_interval = 0.1
"""


@pytest.fixture(scope="module")
def torn(shared_workshop):
    """Return the job of the shipped ring without two spokes, and its result on one rank with fractures."""
    text = (ROOT / "jobs" / "bicycle.toml").read_text().partition("[[case]]")[0]
    text = text.replace('"bicycle/', f'"{ROOT}/jobs/bicycle/')
    text = text.replace("= true\n\n[[zone", "= true\nsnow = 300.0\n\n[[zone")
    limits = "".join(f"[group.{name}]\nfracture_strain = 0.0022\n\n" for name in ("upper", "lower"))
    job = shared_workshop.job(text.replace("[group.ring] ", limits + "[group.ring] ") + LOST, name="torn")
    with shared_workshop.run(job, output="torn.vtkhdf") as f:
        yield job, f


def test_a_ring_bends_as_spokes_break(torn):
    """The ring remains and bends more; both energy checks hold; moments in statics, frames and at the end."""
    f = torn[1]
    assert len(f["events/element"]) >= 4 and (audits(f) < (1e-10, 0.02)).all()
    most = f["envelope/bending_moment_max"][:]
    assert np.isfinite(most[:24]).all() and np.isnan(most[24:]).all()
    assert (most[:24] >= f["final/bending_moment"][:24].max(1) * (1.0 - 1e-12)).all()
    # single
    assert (most[:24] >= f["VTKHDF/CellData/bending_moment"][: len(most)].max(1)[:24] * (1.0 - 1e-6)).all()
    assert np.nanmax(most) > 100.0 * np.nanmax(f["initial_state/bending_moment"][:])


def test_the_report_has_moments_of_the_dynamic_stage(torn, shared_workshop):
    """Dynamic moments exceed the static ones everywhere in the torn ring."""
    rows = shared_workshop.report("torn.vtkhdf", "of_torn").rows("elements")[:24]
    most = torn[1]["envelope/bending_moment_max"][:24].tolist()
    assert [float(row["bending_moment_max"]) for row in rows] == pytest.approx(most)
    assert {row["case_moment"] for row in rows} == {"dynamics"}


def test_bits_of_a_torn_ring(torn, shared_workshop):
    """On three ranks; on these again from a checkpoint of one rank, after the losses."""
    assert_same_bits_on(3, *torn, shared_workshop, "torn")


BEAM = STEEL.replace("100e3", "0.0") + "[group.beam]\n" + BAR.format(2.1e11, 1e-2, 1e-5)


def beam_on_a_hanger(workshop, stages):
    """Return a hinged beam of ten bars of 1 m, one end on rollers, with a hanger at its middle."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z\n20,5,0,4,1,1,1\n"
    nodes += "".join(f"{k},{k},0,0,{int(k == 0)},1,{int(k in (0, 10))}\n" for k in range(11))
    elements = "id,start,end,group\n" + "".join(f"{k},{k},{k + 1},beam\n" for k in range(10))
    return workshop.job(BEAM + stages, nodes, elements + "10,5,20,hanger\n")


def test_a_beam_bends_as_its_hanger_is_pulled_in_a_stage(both_ways):
    """P = 1 kN at the middle: M = P L / 4, by the sum of P x^2 l / 4 EI of its joints; P / 2 at its ends."""
    stages = '[[stage]]\nname = "alone"\nactive = ["beam"]\n'
    stages += '[[stage]]\nname = "lifted"\nactive = ["beam", "hanger"]\nlengths = {hanger = {force = 1e3}}\n'
    stages += "[dynamics]\nduration = 0.02\nmass_damping = 0.0\n"
    f = both_ways.run(beam_on_a_hanger(both_ways, stages))
    alone, lifted = f["stages/alone"], f["stages/lifted"]
    assert np.abs(alone["bending_moment"][:10]).max() < 1e-6
    M = 0.5e3 * np.minimum(np.arange(11), 10 - np.arange(11))
    by_hand = np.append(np.column_stack([M[:-1], M[1:]]), [[np.nan, np.nan]], 0)
    assert np.allclose(lifted["bending_moment"][:], by_hand, rtol=1e-5, atol=1e-3, equal_nan=True)
    z = lifted["displacement"][:][np.flatnonzero(f["net/node_id"][:] == 5), 2]
    assert z == pytest.approx(1e3 * (2 * (1 + 4 + 9 + 16) + 25) / 4.0 / 2.1e6, rel=1e-4)
    at = [np.flatnonzero(f["net/node_id"][:] == k)[0] for k in (0, 10, 20)]
    assert np.allclose(lifted["reaction"][:][at, 2], [500.0, 500.0, -1e3], rtol=1e-5)
    assert f["envelope/bending_moment_max"][:10].max() == pytest.approx(2500.0, rel=1e-5)
    assert abs(f["history/work_identity_error"][:]).max() < 1e-10


def test_bars_that_bend_must_exist_in_each_stage(workshop):
    """Exit code 2 with the name of the stage."""
    job = beam_on_a_hanger(workshop, '[[stage]]\nname = "hung"\nactive = ["hanger"]\n')
    assert "[[stage]] hung: the stage leaves out bars that bend" in workshop.run(job, code=2).stderr


def test_features_without_bending_are_refused(workshop):
    """Targets, bars that can break or are removed, or lack a second moment: exit code 2."""
    more = '[[target]]\ngroup = "ring"\nforce = 1e3\nadjust = "ring"\n[dynamics]\nduration = 1.0\n'
    ring = BEAM.replace("beam", "ring")
    lost = '[[remove]]\ngroup = "ring"\ntime = 0.1\n[dynamics]\nduration = 1.0\n'
    long, bare = lost.replace('group = "ring"', f"elements = {list(range(30))}"), "second_moment = 1e-05\n"
    for n, text, *errors in (
        (2, ring + "fracture_strain = 0.1\n" + more, "[[target]]: not possible", "true, and it can break"),
        (2, ring + lost, 'group = "ring": 2 bars (0, 1) of a bending chain, whose removal is not computed'),
        (30, ring + long, "[[remove]] 1: elements: 30 bars (0, 1, 2, 3, 4, ...) of a bending chain"),
        (30, ring.replace(bare, ""), "needs second_moment"),
    ):
        nodes = table("id,x,y,z,fixed", ((k, k, 0, 0, int(k in (0, n))) for k in range(n + 1)))
        elements = table("start,end,group", ((k, k + 1, "ring") for k in range(n)))
        lines = workshop.solve(text, nodes, elements, code=2).stderr
        assert all(words in lines for words in errors), lines


def test_a_subdivided_bar_of_a_form_with_permanent_load_is_straight(workshop):
    """A strut between hanging cables: its weight bends it by q L^2 / 8 / (1 - N / N_E), and makes no arch."""
    nodes = "id,x,y,z,fixed\n1,4,0,9,1\n2,16,0,9,1\n3,8,-5,0,1\n4,8,5,0,1\n5,12,-5,0,1\n6,12,5,0,1\n"
    nodes += "7,4,0,3,0\n8,16,0,3,0\n"
    sides = "".join(f"{a},{b},c,3e3\n" for a, b in ((1, 7), (2, 8), (3, 7), (4, 7), (5, 8), (6, 8)))
    text = "[cable]\nmodulus = 1.6e11\narea = 1e-3\ndensity = 8e3\n[group.bar]\n"
    text += BAR.format(2.1e11, 5e-3, 2e-5) + '[form_finding]\nmethod = "force_density"\nloads = "permanent"\n'
    text += '[load]\nself_weight = true\n[[case]]\nname = "a"\nset = {"load.temperature" = 0.0}\n'
    job = workshop.job(text, nodes, "start,end,group,force_density\n" + sides + "7,8,bar,-2e3\n")
    with workshop.run(job, "--set", "net.subdivide=8") as f:
        x, N = f["form_finding/position"][:], f["permanent/tension"][-4]
        assert x[-7:, 2] == pytest.approx(x[7, 2], abs=1e-9)
        moment = 7850.0 * 5e-3 * 9.81 * 12.0**2 / 8.0 / (1.0 + N / (np.pi**2 * 2.1e11 * 2e-5 / 12.0**2))
        assert np.nanmax(f["permanent/bending_moment"]) == pytest.approx(moment, rel=0.01)  # of eight parts
        weight = f["permanent/load"][:, 2].sum()
        assert f["form_finding/reaction"][:, 2].sum() == pytest.approx(weight, rel=1e-6)
        half = 0.5 * 7850.0 * 5e-3 * 9.81 * 12.0
        for place, share in (("form_finding", 1.0), ("permanent", 1.0 / 8.0)):  # of the bar as if it stood
            added = end_weights(f)(place, x[:, ::-1], 1.0)[-8:]
            assert added == pytest.approx(half * share, rel=1e-3), place
        assert b"W631" not in f["provenance/warnings"][()]
    job.write_text(job.read_text().partition("[[case]]")[0] + "[dynamics]\nduration = 0.01\n")
    with workshop.run(job, "--set", "net.subdivide=8") as f:  # starts from the straight bar
        assert b"W631" in f["provenance/warnings"][()]
