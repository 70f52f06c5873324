"""Form finding with a given horizontal force compared with closed forms."""

import numpy as np
import pytest
from conftest import BARE, error_lines
from results import assert_same_results
from scipy.optimize import brentq

from netfall.core.errors import DivergedError
from netfall.core.messages import code_of
from netfall.geometry.build import build_net
from netfall.geometry.net import GRAVITY, Net
from netfall.job.read import read_job
from netfall.statics.form.densities import force_density_form

BY_DENSITY = '[form_finding]\nmethod = "force_density"\ntolerance = 1e-9\n'


def net_of(x, fixed, elements, H) -> Net:
    """Return a net of weightless cables of one group with horizontal forces H [N]."""
    held = np.repeat(np.asarray(fixed, bool)[:, None], 3, 1)
    net = Net(np.array(x, float), held, np.array(elements), np.zeros(len(elements), int), ["cable"])
    net.horizontal_force = net.prestress = np.broadcast_to(np.asarray(H, float), len(elements)).copy()
    return net


def rectangle(columns: int, rows: int, step: float, height):
    """Cables along u and v on a rectangle in plan with a fixed edge; nodes inside begin at z = 0.

    height : function of u and v. Returns nodes, held ones, elements, whether each runs along u
    """
    i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
    u, v = (i - columns / 2) * step, (j - rows / 2) * step
    edge = (i % columns == 0) | (j % rows == 0)
    x = np.stack([u, v, np.where(edge, height(u, v), 0.0)], -1).reshape(-1, 3)
    number = np.arange(edge.size).reshape(edge.shape)
    along = np.stack([number[:-1], number[1:]], -1)[:, 1:-1].reshape(-1, 2)
    across = np.stack([number[:, :-1], number[:, 1:]], -1)[1:-1].reshape(-1, 2)
    return x, edge.ravel(), np.concatenate([along, across]), np.arange(len(along) + len(across)) < len(along)


@pytest.mark.parametrize("sagging, hogging", [(300e3, 300e3), (300e3, 200e3)])
def test_a_saddle_agrees_with_a_hand_calculation(sagging, hogging):
    """z = f/2 (u^2 - v^2 H_u / H_v) has H_u z_uu + H_v z_vv = 0, also in differences; f = 0.02 1/m. If nodes
    carry P, less hogging force has the same form: H_u z_uu step - H_v' |z_vv| step = P.
    """
    step, f, ratio = 2.0, 0.02, sagging / hogging
    shape = lambda u, v: 0.5 * f * (u**2 - ratio * v**2)
    x, fixed, elements, along = rectangle(10, 7, step, shape)
    P = 1e3
    loaded_hogging = (sagging * f * step - P) / (f * ratio * step)
    for H_v, load in ((hogging, 0.0), (loaded_hogging, P)):
        net = net_of(x, fixed, elements, np.where(along, sagging, H_v))
        form = force_density_form(net, np.array([0.0, 0.0, -load]) * np.ones_like(x), 1e-12)
        exact = np.column_stack([x[:, :2], shape(x[:, 0], x[:, 1])])
        assert np.abs(form.x - exact).max() < 1e-13 * 20  # rounding at a length of 20 m
        chord = exact[elements[:, 1]] - exact[elements[:, 0]]
        N = form.force_density * np.linalg.norm(chord, axis=1)
        slope = chord[:, 2] / step
        assert N == pytest.approx(net.horizontal_force * np.sqrt(1.0 + slope**2), rel=1e-13)
        assert form.solutions == 1


def test_a_hypar_on_a_square_between_straight_edges():
    """z = f x y with cables along the diagonals of the plan, which sag and hog with equal forces."""
    k, step, f = 6, 1.5, 0.03
    nodes = {(i, j): None for i in range(-k, k + 1) for j in range(-k, k + 1) if abs(i) + abs(j) <= k}
    number = {place: row for row, place in enumerate(nodes)}
    s = step * np.sqrt(0.5)
    plan = np.array([(s * (i - j), s * (i + j)) for i, j in number])
    fixed = np.array([abs(i) + abs(j) == k for i, j in number])
    pairs = [((i, j), (i + a, j + b)) for i, j in number for a, b in ((1, 0), (0, 1))]
    elements = [(number[start], number[end]) for start, end in pairs if end in number]
    z = f * plan[:, 0] * plan[:, 1]
    form = force_density_form(net_of(np.column_stack([plan, z * fixed]), fixed, elements, 250e3), None, 1e-12)
    assert np.abs(form.x - np.column_stack([plan, z])).max() < 1e-13 * 20


def test_a_cable_with_a_load_by_length_in_plan_is_a_parabola():
    """Sag p L^2 / (8 H): 2 kN/m over 60 m with 300 kN give 3 m, and the force at the support."""
    L, n, p, H = 60.0, 20, 2e3, 300e3
    x = np.linspace(0.0, L, n + 1)
    fixed = (x == 0.0) | (x == L)
    elements = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    load = np.outer(np.full(n + 1, p * L / n), [0.0, 0.0, -1.0])
    form = force_density_form(net_of(np.column_stack([x, 0 * x, 0 * x]), fixed, elements, H), load, 1e-12)
    assert form.x[:, 2] == pytest.approx(-p * x * (L - x) / (2.0 * H), abs=1e-13 * L)
    assert form.x[n // 2, 2] == pytest.approx(-3.0)
    length = np.linalg.norm(np.diff(form.x[:2], axis=0))
    assert form.force_density[0] * length == pytest.approx(np.hypot(H, p * (L - L / n) / 2.0), rel=1e-13)


def elastic_catenary(span: float, H: float, w: float, EA: float) -> float:
    """Return the sag [m] of a cable between supports at one height: Irvine (1981), lowest at s = 0."""
    x = lambda s: H * s / EA + H / w * np.arcsinh(w * s / H)
    s = brentq(lambda s: x(s) - span / 2.0, 0.0, span, xtol=1e-13)
    return w * s**2 / (2.0 * EA) + H / w * (np.hypot(1.0, w * s / H) - 1.0)


def test_a_cable_under_its_own_weight_is_an_elastic_catenary(workshop):
    """80 m, 20 kN: 2.1 m of sag for 53 N/m. The error of lumped weights is a quarter with half the step."""
    span, H, EA = 80.0, 20e3, 1.95e11 * 683.08e-6
    exact, sags = elastic_catenary(span, H, GRAVITY * 7850.0 * 683.08e-6, EA), []
    text = BARE + f"[group.g]\nhorizontal_force = {H}\n{BY_DENSITY}"
    text = text.replace("1e-9", '1e-10\nloads = "permanent"') + "[load]\nsteps = 0\n"
    for n in (32, 64):
        nodes = "".join(f"{k},{span * k / n},0,0,{int(k in (0, n))}\n" for k in range(n + 1))
        elements = "".join(f"{k},{k + 1},g\n" for k in range(n))
        f = workshop.solve(text, "id,x,y,z,fixed\n" + nodes, "start,end,group\n" + elements)
        x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
        chord = np.diff(x, axis=0)
        assert N * chord[:, 0] / np.linalg.norm(chord, axis=1) == pytest.approx(np.full(n, H), rel=1e-11)
        assert f["form_finding/residual_real_material"][()] < 1e-9
        sags.append(-x[n // 2, 2])
        f.close()
    errors = np.array(sags) / exact - 1.0
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=1e-3)
    assert (4.0 * sags[1] - sags[0]) / 3.0 == pytest.approx(exact, rel=1e-8)


# Three supports of unlike height and a node that three equal horizontal forces hold: in plan it is the point
# that sees the sides of the triangle at 120 degrees.
TRIANGLE = "id,x,y,z,fixed\n1,0,0,0,1\n2,12,0,3,1\n3,4,9,6,1\n4,5,2,0,0\n"
THREE = "start,end,group\n4,1,a\n4,2,b\n4,3,b\n"


def test_the_plan_follows_the_forces(workshop):
    """Fermat's point of the triangle, and the height from sum H (z_i - z) / length in plan = 0."""
    text = f"{BARE}horizontal_force = 1e3\n[group.'[ab]']\nhorizontal_force = 50e3\n{BY_DENSITY}"
    job = workshop.job(text, TRIANGLE, THREE)
    f = workshop.run(job)
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    chord = x[:3] - x[3]
    plan = np.linalg.norm(chord[:, :2], axis=1)
    unit = chord[:, :2] / plan[:, None]
    assert unit @ unit.T == pytest.approx(1.5 * np.eye(3) - 0.5, abs=1e-8)
    assert x[3, 2] == pytest.approx((x[:3, 2] / plan).sum() / (1.0 / plan).sum(), rel=1e-8)
    level = N * plan / np.linalg.norm(chord, axis=1)
    assert level == pytest.approx(np.full(3, 50e3), rel=1e-9)  # the tolerance
    assert 2 < f["form_finding/iterations"][()] < 100
    assert_same_results(f, workshop.run(job, ranks=2, output="two.vtkhdf"))


def test_other_groups_keep_their_prestress(workshop):
    """Two cables of 40 kN in plan, 10 m to each side and 4 m up, against a tie of 20 kN over 5 m: 2 H / 10 (4
    - z) = 20e3 / 5 (z + 5), z = 1.0 m.
    """
    nodes = "id,x,y,z,fixed\n1,-10,0,4,1\n2,10,0,4,1\n3,0,0,-5,1\n4,0,0,0,0\n"
    elements = "start,end,group\n1,4,upper\n2,4,upper\n3,4,tie\n"
    text = f"{BARE}horizontal_force = '40 kN'\n[group.tie]\nprestress = '20 kN'\n{BY_DENSITY}"
    f = workshop.solve(text, nodes, elements)
    z = f["form_finding/position"][3, 2]
    assert z == pytest.approx((8e3 * 4 - 4e3 * 5) / 12e3, rel=1e-12)
    by_hand = [8e3 / 2 * np.hypot(10, 4 - z)] * 2 + [4e3 * (z + 5)]
    assert f["form_finding/tension"][:] == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize(
    "cable, form, elements, message",
    [
        ("horizontal_force = 1e3\n", "", THREE, "[cable] horizontal_force: needs [form_finding] method ="),
        ("horizontal_force = 1e3\n", "[form_finding]\n", THREE, "Set this method, or give prestress. [E171]"),
        ("horizontal_force = 1e3\nprestress = 1e3\n", BY_DENSITY, THREE, "prestress and horizontal_force"),
        ("horizontal_force = 0.0\n", BY_DENSITY, THREE, "horizontal_force = 0.0: expected a number > 0"),
        (
            "horizontal_force = 1e3\n",
            BY_DENSITY,
            THREE.replace("4,3,b", "4,3,b\n4,5,b"),
            "element 3 between nodes 4 and 5 has no length in plan. Give its group a prestress",
        ),
    ],
)
def test_features_without_horizontal_force_are_refused(workshop, cable, form, elements, message):
    """The error has a remedy."""
    nodes = TRIANGLE + ("5,5,2,-4,1\n" if "4,5" in elements else "")
    job = workshop.job(BARE + cable + form, nodes, elements)
    assert message in "\n".join(error_lines(lambda: build_net(read_job(job))))


def test_forces_that_pull_two_nodes_together_have_no_form():
    """In a triangle with an angle above 120 degrees the node moves to that corner."""
    x = [(0, 0, 0), (10, 1, 0), (-10, 1, 0), (0, 0.5, 1)]
    net = net_of(x, [1, 1, 1, 0], [(3, 0), (3, 1), (3, 2)], 1e3)
    with pytest.raises(DivergedError) as raised:
        force_density_form(net, None, 1e-9)
    line = str(raised.value)
    assert code_of(line) == "E536" and "element 0 (nodes 3 and 0)" in line


@pytest.mark.parametrize(
    "columns, rows, forces, densities",
    [
        ("", "", [np.nan, 2e3, 2e3], [np.nan] * 3),
        (",prestress", ",5e3", [np.nan] * 3, [np.nan] * 3),
        (",force_density", ",70", [np.nan] * 3, [70.0] * 3),
    ],
)
def test_the_most_specific_value_counts(workshop, columns, rows, forces, densities):
    """A group's prestress precedes the horizontal force of [cable], and a row precedes both."""
    text = f"{BARE}horizontal_force = 2e3\n[group.a]\nprestress = 1e3\n{BY_DENSITY}"
    head, *lines = THREE.splitlines()
    table = "\n".join([head + columns, *(line + rows for line in lines)]) + "\n"
    net = build_net(read_job(workshop.job(text, TRIANGLE, table)))
    given = np.full(3, np.nan) if net.horizontal_force is None else net.horizontal_force
    assert given.tolist() == pytest.approx(forces, nan_ok=True)
    assert net.force_density.tolist() == pytest.approx(densities, nan_ok=True)
