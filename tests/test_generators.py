"""Stadium, ring and dome: their elements, their equilibrium, the shipped jobs."""

import numpy as np
import pytest
from nets import pulls
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import spsolve

from netfall.geometry.areas import tributary_areas
from netfall.geometry.faces import find_faces
from netfall.geometry.generators import generate as generators
from netfall.geometry.generators.dome import GROUPS, dome
from netfall.geometry.generators.generate import ring
from netfall.geometry.net import pair_key
from netfall.job.keys.fields import keys_of
from netfall.job.keys.net import Dome, Ring, Stadium
from netfall.job.keys.schema import GENERATORS


def levy_dome(**numbers):
    return Dome(diameter=100.0, opening=16.0, dome_height=6.0, strut=7.0, spoke_force=2e5, **numbers)


def places(x):
    """Return nodes by position, in an order that does not depend on their numbers."""
    return np.array(sorted(map(tuple, np.round(x, 9) + 0.0)))


def test_the_whole_stadium_is_two_halves_that_share_the_arch():
    """Twice 544 particles and 937 elements, less the 39 of the arch. It is symmetric, with its areas."""
    half, whole = (generators.stadium(Stadium(halves=halves)) for halves in (1, 2))
    arch = int((half.x[:, 1] == 0).sum())
    assert (whole.n, whole.m) == (2 * half.n - arch, 2 * half.m) == (1049, 1874)
    assert np.array_equal(places(whole.x), places(whole.x * [1, -1, 1]))
    assert (np.bincount(whole.elements.ravel(), minlength=whole.n)[~whole.fixed.all(1)] == 4).all()
    assert len(np.unique(pair_key(whole.elements, whole.n))) == whole.m
    assert np.sort(whole.lengths()) == pytest.approx(np.repeat(np.sort(half.lengths()), 2), rel=1e-14)
    own, both = (tributary_areas(net.x, net, find_faces(net))[1] for net in (half, whole))
    free = lambda net, area: np.sort(area[~net.fixed.all(1)])
    assert free(whole, both) == pytest.approx(np.repeat(free(half, own), 2), rel=1e-12)  # rounding


@pytest.mark.parametrize(
    ("length", "width", "spacing"), [(60, 60, 3), (88, 66, 2.2), (56, 80, 4), (60, 60, 1.37)]
)
def test_ring_holds_every_cable_at_both_ends(length, width, spacing):
    """Supports on the ellipse, four elements at each free node, symmetric, faces over the whole plan."""
    net = ring(Ring(length=length, width=width, rise=4.0, spacing=spacing))
    held = net.fixed.all(1)
    x, y, z = net.x.T
    u, v = 2 * x / length, 2 * y / width
    assert u[held] ** 2 + v[held] ** 2 == pytest.approx(np.ones(held.sum()), abs=1e-3)  # grid points on it
    assert (u[~held] ** 2 + v[~held] ** 2 < 1).all() and z == pytest.approx(4 * (u**2 - v**2), abs=1e-12)
    assert (np.bincount(net.elements.ravel(), minlength=net.n)[~held] == 4).all()
    for mirror in ([-1, 1, 1], [1, -1, 1]):
        assert np.array_equal(places(net.x), places(net.x * mirror))
    edge = net.x[net.outline[:, 0], :2]
    polygon = 0.5 * abs(np.sum(edge[:, 0] * np.roll(edge[:, 1], -1) - np.roll(edge[:, 0], -1) * edge[:, 1]))
    area = tributary_areas(net.x, net, find_faces(net))[1]
    assert area.sum() == pytest.approx(polygon, rel=1e-12)
    assert 0 < 1 - polygon / (np.pi * length * width / 4) < 0.01


def test_ring_of_constant_horizontal_force_is_a_hypar():
    """H z_xx + H z_yy = 0 in a circle: no vertical force if all four elements are equally long in plan."""
    net = ring(Ring(length=60.0, width=60.0, rise=4.0, spacing=3.0))
    plan = np.linalg.norm(np.diff(net.x[net.elements][..., :2], axis=1)[:, 0], axis=1)
    force = pulls(net.x, net.elements, 1e5 / plan * net.lengths())  # 100 kN along x and along y
    regular = np.bincount(net.elements.ravel(), np.repeat(np.abs(plan - 3.0) < 1e-9, 2), net.n) == 4
    assert regular.sum() > 200 and np.abs(force[regular]).max() < 1e-7  # rounding of 1e5 N
    # load of a node from the cables along x: 2 H rise dx / a^2
    slope = 4.0 * (3.0 / 30.0) ** 2 * 2 / 3.0
    along_x = pulls(net.x, net.elements, np.where(net.group == 0, 1e5 / plan * net.lengths(), 0.0))
    assert along_x[regular, 2] == pytest.approx(np.full(regular.sum(), 1e5 * slope), rel=1e-9)


def of(net, group):
    return net.prestress[net.group == GROUPS.index(group)]


@pytest.mark.parametrize(("hoops", "spokes"), [(0, 6), (1, 12), (4, 36), (3, 25)])
def test_every_free_node_of_the_dome_is_in_equilibrium(hoops, spokes):
    """Far below 1e-9 of the prestress. Cables are taut, struts compressed, equal all around."""
    net = dome(levy_dome(spokes=spokes, hoops=hoops))
    force, free = pulls(net.x, net.elements, net.prestress), ~net.fixed.all(1)
    rounding = 1e-13
    assert np.abs(force[free]).max() < rounding * np.abs(net.prestress).max()
    assert (net.n, net.m) == ((2 * hoops + 3) * spokes, (6 * hoops + 7) * spokes)
    assert (of(net, "strut") < 0).all() and (net.prestress[net.group != GROUPS.index("strut")] > 0).all()
    for group in GROUPS:
        alike = np.sort(of(net, group)).reshape(-1, 2 * spokes if group in ("ridge", "diagonal") else spokes)
        assert (np.ptp(alike, axis=1) <= rounding * np.abs(net.prestress).max()).all()


def test_forces_of_the_dome_by_hand():
    """Central ring S / (2 sin(pi / n)), the lower one fall / climb of it. Without hoops struts have S fall /
    out. Supports carry the whole force and no weight.
    """
    n, S, fall, climb = 24, 2e5, 3.0, 4.0
    sizes = {"opening": 20.0, "dome_height": fall, "strut": fall + climb}
    net = dome(Dome(diameter=100.0, **sizes, spokes=n, hoops=0, spoke_force=S))
    out = 50.0 * np.cos(np.pi / n) - 10.0
    assert of(net, "ring_upper") == pytest.approx(np.full(n, S / (2 * np.sin(np.pi / n))), rel=1e-12)
    lower = S * fall / climb / (2 * np.sin(np.pi / n))
    assert of(net, "ring_lower") == pytest.approx(np.full(n, lower), rel=1e-12)
    assert of(net, "strut") == pytest.approx(np.full(n, -S * fall / out), rel=1e-12)
    pull = pulls(net.x, net.elements, net.prestress)[net.fixed.all(1)]
    assert np.abs(pull[:, 2]).max() < 1e-9 * S  # ridge down, diagonal up, equal


def heights_of_equal_force(net, H):
    """Return heights (n,) [m] of the free nodes with a horizontal force H [N] in all elements, by a linear
    solve, and force densities (m,) [N/m]; Schek 1974, Eq. 5.
    """
    q = H / np.linalg.norm(np.diff(net.x[net.elements][..., :2], axis=1)[:, 0], axis=1)
    rows, one = np.arange(net.m), np.ones(net.m)
    ends = (np.append(rows, rows), net.elements.T.ravel())
    C = csc_array((np.append(one, -one), ends), shape=(net.m, net.n))
    free, z = ~net.fixed.all(1), net.x[:, 2].copy()
    inner, outer = C[:, free], C[:, ~free]
    z[free] = spsolve((inner.T @ diags_array(q) @ inner).tocsc(), -inner.T @ (q * (outer @ z[~free])))
    return z, q


NETS = {  # of about 10,000 elements
    "saddle": ("saddle", 200.0, 20.0, 71),
    "stadium": ("stadium", 220.0, 165.0, 25.0, 1.68),
    "whole stadium": ("stadium", 220.0, 165.0, 25.0, 2.37, 2),
    "ring": ("ring", 120.0, 100.0, 8.0, 1.37),
}


@pytest.mark.parametrize("name", NETS)
def test_every_free_node_is_in_equilibrium_under_equal_horizontal_force(name):
    """Vertically, at the heights of a linear solve; the saddle is a hypar."""
    kind, *dimensions = NETS[name]
    model = GENERATORS[kind]
    net = getattr(generators, kind)(model(**dict(zip(keys_of(model), dimensions))))
    assert net.m == pytest.approx(10_000, rel=0.03)
    net.x[:, 2], q = heights_of_equal_force(net, 1e5)
    force, free = pulls(net.x, net.elements, q * net.lengths()), ~net.fixed.all(1)
    # rounding of places, 1e-16 of 100 m, times the largest force density, 1e5 N over some 1e-3 of the spacing
    assert np.abs(force[free]).max() < 1e-11 * 1e5
    if name == "saddle":
        hypar = 20.0 * ((net.x[:, 0] / 100.0) ** 2 - (net.x[:, 1] / 100.0) ** 2)
        # z_xx + z_yy = 0 holds for second differences of squares; rounding times the condition, cells^2
        assert net.x[:, 2] == pytest.approx(hypar, abs=1e-16 * 20.0 * dimensions[2] ** 2)
