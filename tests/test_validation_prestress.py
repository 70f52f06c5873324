"""Prestress of a given geometry: states of self-stress, by hand and published; geometries without one."""

import numpy as np
import pytest
from conftest import ROOT, STEEL, run_on_standing_ranks
from scipy.spatial.transform import Rotation

from netfall.core.errors import DivergedError, InputError
from netfall.core.linear import least_squares
from netfall.geometry.build import build_net
from netfall.geometry.generators.generate import generate
from netfall.geometry.net import Net
from netfall.job.read import read_job
from netfall.results.text import prestress_warnings
from netfall.statics.form.self_stress import self_stress

BY_HAND = 1e-9  # of a force, as asked; rounding is some 1e-14
KEEP = '[form_finding]\nmethod = "given_geometry"\n'


def shipped(name, ring_groups):
    net = read_job(ROOT / "jobs" / f"{name}.toml").net
    dimensions = getattr(net, name).replaced(ring_groups=ring_groups)
    return generate(net.replaced(**{name: dimensions}))


def group_forces(net, N):
    """Return the forces of each group, which must be equal, by name."""
    result = {name: N[net.group == k] for k, name in enumerate(net.group_names)}
    assert all(np.ptp(forces) == 0.0 for forces in result.values())
    return {name: forces[0] for name, forces in result.items()}


@pytest.mark.parametrize(
    "name, given, states", [("dome", ["ring_upper"], 1), ("wheel", ["ring_upper", "brace"], 2)]
)
@pytest.mark.parametrize("rings", [False, True])
def test_a_generated_net_has_the_forces_of_its_closed_form(name, given, states, rings):
    net = shipped(name, rings)
    expected = net.prestress.copy()
    assert ("hoop2" in net.group_names) == rings
    net.prestress[~np.isin(net.group, [net.group_names.index(group) for group in given])] = 0.0
    result = self_stress(net, None, 1e-6)
    assert len(result.states) == states
    assert np.abs(result.N - expected).max() < BY_HAND * np.abs(expected).max()


GEIGER = {"n": 10, "R": 30.0, "r": 14.0, "ridge": 4.0, "foot": -3.0, "top": 6.0, "bottom": 1.0}


def geiger():
    """Return a Geiger dome of n planes: each with a strut, ridge and diagonal cables; hoops at the feet."""
    n, R, r = GEIGER["n"], GEIGER["R"], GEIGER["r"]
    angle = 2 * np.pi * np.arange(n) / n
    ring = lambda radius, z: np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, z)])
    middle = [[0.0, 0.0, GEIGER["top"]], [0.0, 0.0, GEIGER["bottom"]]]
    x = np.concatenate([ring(R, 0.0), ring(r, GEIGER["ridge"]), ring(r, GEIGER["foot"]), middle])
    support, upper, lower = np.arange(3 * n).reshape(3, n)
    pairs = {
        "ridge_outer": np.column_stack([support, upper]),
        "diagonal_outer": np.column_stack([support, lower]),
        "strut": np.column_stack([lower, upper]),
        "hoop": np.column_stack([lower, np.roll(lower, -1)]),
        "ridge_inner": np.column_stack([upper, np.full(n, 3 * n)]),
        "diagonal_inner": np.column_stack([upper, np.full(n, 3 * n + 1)]),
        "mast": np.array([[3 * n + 1, 3 * n]]),
    }
    fixed = np.zeros((len(x), 3), bool)
    fixed[:n] = True
    group = np.repeat(np.arange(len(pairs)), [len(each) for each in pairs.values()])
    net = Net(x, fixed, np.concatenate(list(pairs.values())), group, list(pairs))
    net.prestress = np.zeros(net.m)
    return net


def geiger_by_hand(H):
    """Return the forces of the groups if the inner ridge cables have the radial force H."""
    n, R, r = GEIGER["n"], GEIGER["R"], GEIGER["r"]
    ridge_inner = (GEIGER["top"] - GEIGER["ridge"]) / r
    diagonal_inner = (GEIGER["ridge"] - GEIGER["bottom"]) / r
    ridge_outer, diagonal_outer = GEIGER["ridge"] / (R - r), -GEIGER["foot"] / (R - r)  # slopes
    H_diagonal = H * ridge_inner / diagonal_inner  # both ends of the mast
    H_ridge = H + H_diagonal  # along the radius, at the ridge; upright, both inner cables cancel there
    P = H_ridge * ridge_outer
    H_outer = P / diagonal_outer  # upright, at the foot of a strut
    along = lambda force, slope: force * np.sqrt(1 + slope**2)
    return {
        "ridge_outer": along(H_ridge, ridge_outer),
        "diagonal_outer": along(H_outer, diagonal_outer),
        "strut": -P,
        "hoop": H_outer / (2 * np.sin(np.pi / n)),
        "ridge_inner": along(H, ridge_inner),
        "diagonal_inner": along(H_diagonal, diagonal_inner),
        "mast": -n * H * ridge_inner,
    }


@pytest.mark.parametrize("given", ["hoop", "mast"])
def test_a_geiger_dome_by_hand(given, compare):
    net, expected = geiger(), geiger_by_hand(1e5)
    net.prestress[net.group == net.group_names.index(given)] = expected[given]
    result = self_stress(net, None, 1e-6)
    forces = group_forces(net, result.N)
    assert len(result.states) == 1 and forces.keys() == expected.keys()
    for name, force in expected.items():
        case = f"Geiger dome, force of {name} from that of {given}"
        compare(case, "by hand", "Form finding").figures(forces[name], force, BY_HAND, "rounding", "N")


def line(*prestress):
    """Return nodes on a line with held ends; each element is a group."""
    n = len(prestress) + 1
    x, fixed = np.zeros((n, 3)), np.ones((n, 3), bool)
    x[:, 0] = np.arange(n)
    fixed[1:-1] = False
    elements = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    net = Net(x, fixed, elements, np.arange(n - 1), [f"g{k}" for k in range(n - 1)])
    net.prestress = np.array(prestress, float)
    return net


def test_forces_are_the_nearest_to_the_prestress():
    """Elements on a line have one force, the mean of the given prestresses; 0 does not count."""
    assert self_stress(line(100.0, 200.0, 600.0), None, 1e-6).N == pytest.approx([300.0] * 3, rel=1e-14)
    assert self_stress(line(100.0, 0.0, 600.0), None, 1e-6).N == pytest.approx([350.0] * 3, rel=1e-14)
    net = line(100.0, 200.0, 600.0, 600.0)
    net.group = np.array([0, 1, 2, 2])  # of a group each element counts
    assert self_stress(net, None, 1e-6).N == pytest.approx([375.0] * 4, rel=1e-14)


def test_a_self_stress_far_from_the_prestress_is_a_warning():
    """485 N are near 500 and 470 N; 500 N are far from 600 and 400 N; a prestress of 0 does not count."""
    close, far = line(500.0, 470.0, 0.0), line(600.0, 400.0)
    assert [*prestress_warnings(close, self_stress(close, None, 1e-6).N)] == []
    (text,) = prestress_warnings(far, self_stress(far, None, 1e-6).N)
    assert "prestress of 2 elements by more than 10%; most in element 1: 0.5 kN instead of 0.4 kN" in text
    parts = line(600.0, 600.0, 400.0, 400.0)
    parts.element_id = np.array([7, 7, 8, 8])
    (text,) = prestress_warnings(parts, self_stress(parts, None, 1e-6).N)
    assert "prestress of 2 elements by more" in text


def test_a_straight_cable_at_any_angle_keeps_its_prestress():
    """Rounded coordinates leave 1e-9 of the force at each node, which counts as equilibrium."""
    net = line(300.0, 300.0, 300.0, 300.0)
    net.group[:] = 0
    net.x = net.x @ np.array([[np.cos(0.5), np.sin(0.5), 0.0], [-np.sin(0.5), np.cos(0.5), 0.0], [0, 0, 1.0]])
    net.x = net.x.round(9)
    assert self_stress(net, None, 1e-6).N == pytest.approx([300.0] * 4, rel=1e-12)


def test_a_load_is_carried_in_addition_to_the_self_stress():
    """Nothing carries across the line. Along it both sides differ by the load."""
    net, load = line(100.0, 200.0), np.zeros((3, 3))
    load[1, 0] = 40.0
    assert self_stress(net, load, 1e-6).N == pytest.approx([170.0, 130.0], rel=1e-14)
    load[1] = [0.0, 0.0, -30.0]
    with pytest.raises(DivergedError, match=r"node 1: not in equilibrium .*\(node 1 by \[0, 0, -0.03\] kN\)"):
        self_stress(net, load, 1e-6)


def test_a_group_of_which_rounding_leaves_a_trace_in_the_states_is_not_in_them():
    """A stay out of the plane of a braced square has 1e-17 of its forces; without a load that is an error."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 1, 1]])
    tilted = corners @ Rotation.from_rotvec([0.3, 0.5, 0.7]).as_matrix()
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3], [2, 4]])
    fixed = np.array([[True] * 3, *[[False] * 3] * 3, [True] * 3])
    net = Net(tilted, fixed, ends, np.array([0, 0, 0, 0, 1, 1, 2]), ["side", "diagonal", "stay"])
    net.prestress = np.array([0.0] * 6 + [100.0])
    with pytest.raises(InputError, match="group stay: no state of self-stress of the geometry has it"):
        self_stress(net, None, 1e-6)
    assert self_stress(net, np.zeros((5, 3)), 1e-6).N == pytest.approx(0.0, abs=1e-12)


PYRAMID = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,10,10,0,1\n4,0,10,0,1\n5,5,5,3,0\n"
SIDES = "start,end,group\n1,5,side\n2,5,side\n3,5,side\n4,5,side\n"


def test_a_geometry_without_self_stress_is_refused(workshop):
    """The error names the node: at the top of a pyramid four forces f leave 4 f 3 / sqrt(59)."""
    job = workshop.job(STEEL + KEEP, PYRAMID, SIDES)
    done = run_on_standing_ranks("run", job, "-o", workshop.folder / "result.vtkhdf", code=2)
    assert "no state of self-stress" in done.stderr
    assert f"leave {4 * 3 / np.sqrt(59):.3g} of the largest at node 5" in done.stderr
    net = line(0.0, 0.0)
    with pytest.raises(InputError, match="no element that can move has a prestress"):
        self_stress(net, None, 1e-6)


def test_the_residual_of_rounded_coordinates_is_an_error_or_allowed():
    """A node 1 mm off a line of 2 m: each force leaves 2e-3 of itself there."""
    net = line(100.0, 100.0)
    net.x[1, 2] = 1e-3
    with pytest.raises(InputError, match=r"leave 0\.002 of the largest at node 1"):
        self_stress(net, None, 1e-6)
    assert self_stress(net, None, 3e-3).N == pytest.approx([100.0] * 2, rel=1e-5)


LEVY = {  # source: TsgFEM, cable dome; N
    "outer_strut": -216644.96,
    "inner_strut": -69487.4,
    "outer_ridge": 270049.94,
    "outer_diagonal": 247645.94,
    "outer_hoop": 650806.2,
    "inner_ridge": 133333.36,
    "inner_diagonal": 72952.58,
    "inner_hoop": 216664.23,
    "inner_ring": 434784.92,
}
LOADED = [-444.741, -21.010, 31.390, 500.578, 1313.526, 1.940, 22.001, 65.308, 6.304]  # kN, in that order
DIGITS = "areas and stresses are published with seven digits"


@pytest.fixture(scope="module")
def levy(shared_workshop):
    path = shared_workshop.folder / "levy.vtkhdf"
    done = run_on_standing_ranks("run", ROOT / "jobs" / "levy.toml", "-o", path)
    info = run_on_standing_ranks("info", path).stdout
    with shared_workshop.open("levy.vtkhdf") as f:
        yield f, done.stdout, info


def test_the_self_stress_of_the_levy_dome_is_the_published_one(levy, compare):
    """The self-stress follows from the force of one hoop."""
    f, output, info = levy
    names = f["net/group_names"].asstr()[:]
    assert f["form_finding/self_stress"].shape == (1, 156)
    assert "self-stress: 1 state with one force in each group, of " in output
    assert next(line for line in output.splitlines() if line.startswith("self-stress")) in info
    for name, force in LEVY.items():
        computed = f["form_finding/tension"][:][f["net/group"][:] == list(names).index(name)]
        assert np.ptp(computed) == 0.0
        case = f"Levy dome of 156 members, prestress of {name}"
        compare(case, "TsgFEM, published", "Form finding").figures(computed[0], force, 3e-7, DIGITS, "N")


def test_the_levy_dome_under_load(levy, compare):
    """Displacements and forces under 400 and 20 kN, by Newton's method with the dense matrix."""
    f = levy[0]
    node, u, N = f["net/node_id"][:], f["statics/displacement"][-1], f["statics/tension"][-1]
    for p, what, expected in ((13, "outer", -0.1664917), (37, "inner", -0.1800879)):
        case, ours = f"Levy dome, vertical displacement of the {what} tops", u[node == p, 2][0]
        compare(case, "dense Newton's method", "Statics").figures(ours, expected, 5e-7, "its digits", "m")
    names = list(f["net/group_names"].asstr()[:])
    for name, force in zip(LEVY, LOADED):
        ours = N[f["net/group"][:] == names.index(name)] / 1e3
        assert ours == pytest.approx(np.full(len(ours), force), abs=6e-4)  # half of its last digit, rounding
    assert f["statics/slack"][-1] == 0


V = "id,x,y,z,fixed\n1,-3,0,4,1\n2,3,0,4,1\n3,0,0,0,0\n"
LEGS = "start,end,group\n1,3,leg\n2,3,leg\n"
HEAVY = "[cable]\nmodulus = 1e9\narea = 1e-3\ndensity = 50e3\n"


def v_by_hand():
    """Return the tension of two legs of 5 m under self weight, half of it at the node: 3-4-5 triangles."""
    EA, N = 1e6, 0.0
    for _ in range(50):
        N = 9.81 * 50e3 * 1e-3 * 5.0 / (1 + N / EA) / (2 * 0.8)
    return N


@pytest.mark.parametrize("method", ["given_geometry", "fpm", "force_density"])
def test_a_form_carries_its_permanent_load(workshop, method):
    """The V does not move, or finds its equilibrium; the permanent load then moves nothing."""
    form = f'[form_finding]\nmethod = "{method}"\nloads = "permanent"\ntolerance = 1e-10\n'
    load = "[load]\nself_weight = true\nsteps = 1\ntolerance = 1e-9\n"
    legs = LEGS.replace("group\n", "group,prestress\n").replace("leg\n", "leg,10000\n")
    with workshop.solve(HEAVY + form + load, V, LEGS if method == "given_geometry" else legs) as f:
        x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
        if method == "given_geometry":
            assert (x == f["net/particles"][:]).all()
            assert N == pytest.approx([v_by_hand()] * 2, rel=1e-9)  # as asked of the load
        assert np.abs(f["statics/displacement"][0]).max() < 1e-8  # 1e-10 of the tension over N / L
        assert f["statics/tension"][0] == pytest.approx(N, rel=1e-8)


def test_keep_with_subdivided_cables_under_permanent_load_is_refused(workshop):
    """Their inner nodes would sag."""
    form = KEEP + 'loads = "permanent"\n'
    job = workshop.job(HEAVY + form + "[load]\nself_weight = true\n", V, LEGS)
    done = run_on_standing_ranks("check", job, "--set", "net.subdivide=2", code=2)
    assert "new nodes would sag" in done.stderr


def test_a_subdivided_net_has_the_self_stress_of_the_given_net(workshop):
    tables = PYRAMID.replace("5,5,3", "5,5,0"), SIDES
    with workshop.run(workshop.job(STEEL + KEEP, *tables), "--set", "net.subdivide=3") as f:
        assert f["form_finding/tension"][:] == pytest.approx([100e3] * 12, rel=1e-14)
        assert f["form_finding/self_stress"].shape == (1, 12)


def test_least_squares_without_full_rank():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(30, 4)) @ rng.normal(size=(4, 9))
    b = rng.normal(size=30)
    fit = least_squares(A, b)
    assert fit.null.shape == (9, 5)
    assert np.abs(fit.x - np.linalg.pinv(A) @ b).max() < 1e-12
    assert np.abs(A @ fit.null).max() < 1e-12
    assert np.abs(fit.null.T @ fit.null - np.eye(5)).max() < 1e-14


def test_published_prestress_of_all_groups_gives_equal_forces(workshop):
    """Least squares over all groups agree to their digits."""
    job = (ROOT / "jobs" / "levy.toml").read_text().replace("levy/", f"{ROOT}/jobs/levy/")
    for name, force in LEVY.items():
        job = job.replace(f"[group.{name}]\n", f"[group.{name}]\nprestress = {force}\n")
    job = job.replace("prestress = 650806.2            # N: all other forces follow\n", "")
    path = workshop.folder / "all.toml"
    path.write_text(job)
    net = build_net(read_job(path))
    N = self_stress(net, None, 1e-6).N
    assert np.abs(N - net.prestress).max() < 0.1  # N, the stated digits of the source
    assert net.m == 156
