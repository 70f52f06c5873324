"""Gusts: spectra, variance, coherence, direction, and seeds."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import nets
import numpy as np
import pytest
import scipy.signal
from conftest import STEEL

from netfall.core.errors import InputError
from netfall.job.keys.schema import SECTIONS
from netfall.job.read import read_job
from netfall.loads.wind.autoregressive import GustRecursion, PointGusts, cholesky_root, fit_gust_model
from netfall.loads.wind.field import coherence_errors, load_power, make_wind_field
from netfall.loads.wind.surface import square_variances
from netfall.physics.wind_spectra import KARMAN_CONSTANT, SHAPES, along_wind, davenport_coherence, make_gust

DECAY = (8.0, 16.0, 10.0)
POINTS = np.array([[x, y, 0.0] for x in (-30.0, -10.0, 10.0, 30.0) for y in (0.0, 15.0, 30.0)])


def test_an_invalid_covariance_is_refused():
    """Two points have a correlation above 1."""
    with pytest.raises(InputError, match="control_points"):
        cholesky_root(np.array([[1.0, 2.0], [2.0, 1.0]]))


def settings(**given):
    """Return a [wind] with its defaults and the given keys."""
    return SimpleNamespace(**({key.name: key.default for key in SECTIONS["wind"]} | given))


def gusty(**given):
    """Return a wind of 40 m/s with gusts."""
    return settings(**({"speed": 40.0, "turbulence_intensity": 0.2, "pressure_coefficient": 1.0} | given))


def model_of(dt, points=POINTS, **given):
    """Return the gusts at one point, and their model."""
    wind = gusty(**given)
    gust = make_gust(wind)
    gusts = PointGusts(points, np.full(len(points), wind.speed), DECAY)
    return gust, fit_gust_model(gusts, gust, dt, wind.ar_order)


def cross_spectra(model, dt, n):
    """Return spectra (f, c, c) [m2/s2/Hz] of a model at frequencies n [Hz], by its transfer function."""
    c = len(model.noise_root)
    psi = [part.T for part in np.split(model.psi, len(model.lags))]
    waves = (np.exp(-2j * np.pi * n * dt * lag)[:, None, None] * a for lag, a in zip(model.lags, psi))
    transfer = np.linalg.inv(np.eye(c) - sum(waves)) @ model.noise_root.T
    return 2 * dt * transfer @ transfer.conj().transpose(0, 2, 1)


def own_spectrum(model, dt, n):
    """Return the mean spectrum of the points."""
    return np.einsum("fii->f", cross_spectra(model, dt, n).real) / len(model.noise_root)


def of_steps(model, seed, steps):
    """Return histories (steps, c) [m/s]."""
    recursion = GustRecursion(model, seed)
    return np.array([recursion.advance() for _ in range(steps)])


ABOVE = {  # share of the variance above x = n L / U0, integrated by hand
    "davenport": lambda x: (1 + x**2) ** (-1 / 3),
    "kaimal": lambda x: (1 + 6 * x) ** (-2 / 3),
    "en1991": lambda x: (1 + 10.2 * x) ** (-2 / 3),
}


@pytest.mark.parametrize("spectrum", SHAPES)
def test_spectra_integrate_to_the_variance(spectrum):
    """sigma^2 = (I U0)^2 = 6 k U0^2 over all frequencies. The part above a frequency is known by hand."""
    gust = make_gust(settings(speed=40.0, surface_drag=0.03, spectrum=spectrum))
    n = np.geomspace(1e-9, 1e6, 400_001)
    total = np.trapezoid(gust.spectrum(n) * n, np.log(n))
    assert total == pytest.approx(6 * 0.03 * 40**2, rel=1e-4)  # x^(-2/3) of 1e6 Hz lies beyond
    for dt in (0.01, 1.0):
        x = 0.5 / dt * gust.length / 40.0
        if spectrum in ABOVE:
            assert gust.share_above(0.5 / dt) == pytest.approx(ABOVE[spectrum](x), rel=1e-3)  # quadrature
    assert gust.share_above(0.0 + 1e-9) == pytest.approx(1.0, abs=1e-3)


def test_spectra_are_those_of_their_sources():
    """At 1 Hz and 40 m/s in the notation of the sources, n S / sigma^2."""
    value = lambda name: make_gust(gusty(spectrum=name)).spectrum(1.0)
    variance, x, f = (0.2 * 40) ** 2, 1200 / 40, 63.2 / 40
    assert value("davenport") == pytest.approx(4 * (0.2**2 / 6) * 40**2 * x**2 / (1 + x**2) ** (4 / 3))
    iec = 8.1 * 0.7 * 10 / 40
    assert value("kaimal") == pytest.approx(variance * 4 * iec / (1 + 6 * iec) ** (5 / 3))
    # 70.8 is rounded
    assert value("von_karman") == pytest.approx(variance * 4 * f / (1 + 70.8 * f**2) ** (5 / 6), rel=3e-4)
    assert value("en1991") == pytest.approx(variance * 6.8 * f / (1 + 10.2 * f) ** (5 / 3))
    beta = math.gamma(1 / 2) * math.gamma(1 / 3) / math.gamma(5 / 6)
    assert KARMAN_CONSTANT == pytest.approx(4 * beta**2, rel=1e-6)


CASES = [("davenport", dt) for dt in (0.01, 0.05, 0.2, 1.0)]
CASES += [(name, dt) for name in ("kaimal", "von_karman", "en1991") for dt in (0.05, 1.0)]


@pytest.mark.parametrize("spectrum, dt", CASES)
def test_variance_and_half_octaves_agree_with_the_spectrum(spectrum, dt):
    """The model at default lags has the variance below half of 1 / dt, in total and in half octaves."""
    gust, model = model_of(dt, POINTS[::5], spectrum=spectrum)
    high, share = 0.5 / dt, 1 - gust.share_above(0.5 / dt)
    n = (np.arange(2**15) + 0.5) * high / 2**15
    ours = own_spectrum(model, dt, n)
    # 1e-2: gain by some of the points and on a grid in proportion, the midpoint rule here
    assert ours.mean() * high == pytest.approx(gust.deviation**2 * share, rel=1e-2)
    below = lambda n: 1 - gust.share_above(n)
    low = next(n for n in np.geomspace(1e-3, 1, 200) * 40 / gust.length if below(n) > 0.03)
    edges = high / 2 ** (0.5 * np.arange(int(2 * np.log2(high / low)) + 1))
    for upper, lower in itertools.pairwise(edges):
        n = np.linspace(lower, upper, 200)
        ratio = np.trapezoid(own_spectrum(model, dt, n), n) / np.trapezoid(gust.spectrum(n), n)
        assert abs(ratio - 1) < 0.15, (lower, ratio)
        assert abs(ratio - 1) < abs(model.losses.misfit) + 0.04, (lower, ratio)  # finer bands
    slowest = model.losses.slow_below
    assert model.losses.slow_target == pytest.approx(below(slowest) / share, rel=1e-9)
    n = (np.arange(2**12) + 0.5) * slowest / 2**12
    slow = own_spectrum(model, dt, n).mean() * slowest / (gust.deviation**2 * share)
    assert model.losses.slow == pytest.approx(slow, rel=0.05)  # six of the points there
    assert (slow > 1.3 * model.losses.slow_target) == (spectrum == "davenport" and dt < 1.0)


@pytest.mark.parametrize("order", [1, 2, 4, 30])
def test_the_variance_is_exact_with_any_number_of_lags(order):
    """The equations between spread lags do not ensure it. A difference would be named."""
    gust, model = model_of(0.05, POINTS[::5], ar_order=order)
    n = (np.arange(2**15) + 0.5) * 10.0 / 2**15
    variance = own_spectrum(model, 0.05, n).mean() * 10.0
    assert variance == pytest.approx(gust.deviation**2 * (1 - gust.share_above(10.0)), rel=1e-2)
    assert len(model.lags) <= order and model.lags[0] == 1
    assert (abs(model.losses.misfit) > 0.15) == (order < 10)


ROOF = np.array([[x, y, 0.05 * x] for x in np.linspace(-40, 40, 9) for y in np.linspace(-20, 20, 5)])


@pytest.mark.parametrize("direction", [0.0, 30.0, 90.0, -135.0])
def test_coherence_follows_the_direction(direction):
    """Control points along the wind, across it and at an angle, from the model."""
    wind = gusty(direction=direction, profile_exponent=0.0, gust_field="point")
    field = make_wind_field(ROOF, np.tile([0.0, 0, 1], (45, 1)), wind)
    angle = math.radians(direction)
    c, s = math.cos(angle), math.sin(angle)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    n = np.array([0.02, 0.03, 0.1, 0.2, 0.4, 0.8])
    S = cross_spectra(field.model, 0.05, n)
    directions = set()
    for i, j in itertools.combinations(range(len(S[0])), 2):
        apart = axes @ (field.control_point[i] - field.control_point[j])
        across = abs(apart[0]) < 1e-9  # otherwise along, or oblique
        directions |= {"across"} if across else {"along"} if abs(apart[1]) < 1e-9 else set()
        expected = davenport_coherence(n, apart, np.array(DECAY), 40.0)
        ours = (S[:, i, j] / np.sqrt(S[:, i, i] * S[:, j, j])).real
        assert np.abs(ours - expected).max() < 0.1, (i, j, ours, expected)  # fit of the default lags: 0.08
    assert directions == {"along", "across"}


def load_on(field, share):
    """Return the load (c,) of each control point, of nodes with shares (n,) of it."""
    of_points = (share[:, None] * field.weight).ravel()
    return np.bincount(field.corner.ravel(), of_points, len(field.control_point))


@pytest.mark.parametrize("direction", [0.0, 30.0])
def test_mean_gusts_give_the_load_of_the_coherence(direction):
    """Davenport's formula for 24 x 24 nodes: uniform, half a wave, a whole wave. Point gusts give more."""
    a, b = (grid.ravel() for grid in np.meshgrid(*(2 * [(np.arange(24) + 0.5) / 24]), indexing="ij"))
    x, up = np.column_stack([88 * a, 66 * b, 0 * a]), np.tile([0.0, 0, 1], (len(a), 1))
    fast = {"speed": 60.0, "direction": direction}
    means, points = (make_wind_field(x, up, gusty(gust_field=g, **fast)) for g in ("area_mean", "point"))
    y, gust = along_wind(x, direction), make_gust(gusty(**fast))
    delay = np.hypot(8 * (y[:, :1] - y[:, 0]), 16 * (y[:, 1:2] - y[:, 1])) / 60
    n = np.geomspace(1e-4, 10, 60)
    some = [35, 43, 47, 49]  # 0.09 to 1.4 Hz
    waves = (np.sin(k * np.pi * a) * np.sin(np.pi * b) for k in (1, 2))
    for wave in (np.ones(len(a)), *waves):
        expected = np.array([wave @ np.exp(-f * delay) @ wave for f in n]) * gust.spectrum(n)
        at, power = [], []
        for field in (means, points):
            load = load_on(field, wave)
            at.append(load @ cross_spectra(field.model, 0.05, n[some]).real @ load / expected[some])
            power.append(load @ field.model.covariance @ load / np.trapezoid(expected, n))
        # a whole wave over some five control points loses the bends between them
        assert power[0] == pytest.approx(1.0, abs=0.03)
        assert power[1] > 1.25 and at[1][3] > 2.5
        assert at[0] == pytest.approx(np.ones(4), abs=0.18)  # lags miss half octaves by 0.1
        if wave.all() and not np.ptp(wave):
            up_variances = square_variances(up)
            computed = load_power((y, up_variances), up, points, gusty(**fast), n, np.eye(len(n))[some])
            assert computed == pytest.approx(at[1], rel=0.18)
    share = means.deviation / gust.deviation
    assert 0.7 < share.min() < share.max() < 1.1


def test_gusts_on_a_coarse_roof_act_on_its_whole_area(workshop):
    """The variance of the load on a flat square of 2 x 2 cells is the mean over pairs of squares of 0.5 m.

    The corners have no node. At the edge, areas lie on one side of their node: 4 % of the deviation.
    """
    net = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 40.0\nrise = 0.0\ncells = 2\n[form_finding]\n'
    wind = "[wind]\nspeed = 40.0\nsurface_drag = 0.005\npressure_coefficient = -1.0\nprofile_exponent = 0.0\n"
    job = read_job(workshop.job(net + STEEL + wind + "base_height = 10.0\n[dynamics]\nduration = 0.1\n"))
    model = nets.model_of(job)
    field, gust = model.wind_field, make_gust(job.wind)
    at = np.abs(0.5 * np.arange(80) - 19.75)
    loaded = 1.0 * (np.minimum.outer(at, at) < 10.0)
    a, b = np.meshgrid(*(2 * [0.5 * np.arange(-79, 80)]), indexing="ij")
    pairs, n = scipy.signal.fftconvolve(loaded, loaded), np.geomspace(1e-4, 10.0, 100)
    shares = [np.sum(pairs * np.exp(-f * np.hypot(8.0 * a, 16.0 * b) / 40.0)) / pairs.sum() for f in n]
    load = load_on(field, model.roof.area / 1200.0)
    expected = np.trapezoid(shares * gust.spectrum(n), n)
    assert load @ field.model.covariance @ load == pytest.approx(expected, rel=0.02)


def test_a_wind_direction_equals_a_rotated_net():
    """A net rotated with the wind has the same gusts. Direction 0 leaves all bits of the positions."""
    turned = along_wind(ROOF, 30.0)
    up = np.tile([0.0, 0, 1], (45, 1))
    strong = {"turbulence_intensity": 0.4, "gust_field": "point"}
    skew = make_wind_field(ROOF, up, gusty(direction=30.0, **strong))
    straight = make_wind_field(turned, up, gusty(**strong))
    assert np.allclose(along_wind(skew.control_point, 30.0), straight.control_point, atol=1e-12)
    assert np.allclose(skew.model.psi, straight.model.psi, atol=1e-6)  # ill-conditioned equations
    assert np.allclose(skew.weight, straight.weight, atol=1e-9)
    assert (along_wind(ROOF, 0.0) == ROOF).all()


def uneven_saddle():
    """Return a saddle with an even number of cells: nodes of different height are equally near to a point."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-20, 20, 11), np.linspace(-20, 20, 11)))
    roof = np.column_stack([x, y, 0.01 * (x * x - y * y) + 0.05 * x])
    return roof, np.tile([0.0, 0.0, 16.0], (len(roof), 1))


def uneven_facade():
    """Return the facade with moved nodes."""
    x, vector = facade()
    return x + np.random.default_rng(1).uniform(-0.4, 0.4, x.shape), vector


@pytest.mark.parametrize("net", [uneven_saddle, uneven_facade])
@pytest.mark.parametrize("gusts", ["area_mean", "point"])
def test_gusts_do_not_depend_on_the_order_of_nodes(net, gusts):
    """Nodes without wind have no effect either. Points of a mirror image are mirror images."""
    x, vector = net()
    wind = gusty(speed=30.0, gust_field=gusts)
    one, order = make_wind_field(x, vector, wind), np.random.default_rng(1).permutation(len(x))
    other = make_wind_field(x[order], vector[order], wind)
    assert np.array_equal(one.control_point, other.control_point)
    assert np.array_equal(one.model.psi, other.model.psi)
    assert np.array_equal(one.weight[order], other.weight)
    layer = np.vstack([x - (0.0, 0.0, 6.0), x]), np.vstack([0 * vector, vector])
    assert np.array_equal(one.control_point, make_wind_field(*layer, wind).control_point)
    if net is uneven_saddle and gusts == "point":
        mirrored = make_wind_field(x * (1, -1, 1), vector, wind).control_point
        places = {tuple(np.round(p, 9) + 0.0) for p in mirrored * (1, -1, 1)}
        assert places == {tuple(np.round(p, 9) + 0.0) for p in one.control_point}


@pytest.mark.parametrize("size", [1e-12, 1e-7])
def test_rounding_of_a_symmetric_form_does_not_change_its_gusts(size):
    """A square saddle has eight equal parts, and the same control points in the same order."""
    i, j = np.meshgrid(np.linspace(-10.0, 10.0, 11), np.linspace(-10.0, 10.0, 11), indexing="ij")
    x, vector = np.column_stack([i.ravel(), j.ravel(), 0.02 * (i * i - j * j).ravel()]), np.zeros((121, 3))
    vector[:, 2] = 4.0
    wind = gusty(speed=30.0, gust_field="area_mean")
    exact = make_wind_field(x, vector, wind).control_point
    for seed in range(5):
        error = size * np.random.default_rng(seed).standard_normal((2, 121, 3))
        control_point = make_wind_field(x + error[0], vector + error[1], wind).control_point
        assert np.abs(control_point - exact).max() < 10.0 * size + 1e-12


@pytest.mark.parametrize("turn", [1e-9, -1e-9])
def test_rounding_of_the_wind_direction_does_not_change_the_gusts(turn):
    """In a round net on a square grid, nodes equally far from several points keep their four points."""
    i, j = np.meshgrid(np.linspace(-20.0, 20.0, 11), np.linspace(-20.0, 20.0, 11), indexing="ij")
    x = np.column_stack([i.ravel(), j.ravel(), 0.002 * (i * i - j * j).ravel()])
    x = x[np.hypot(*x.T[:2]) < 20.1]
    vector = np.tile([0.0, 0.0, 16.0], (len(x), 1))
    shares = []
    for direction in (0.0, turn):
        field = make_wind_field(x, vector, gusty(speed=30.0, gust_field="area_mean", direction=direction))
        shares.append(np.zeros((len(x), len(field.control_point))))
        np.add.at(shares[-1], (np.arange(len(x))[:, None], field.corner), field.weight)
    assert np.abs(shares[1] - shares[0]).max() < 1e-8  # of 1; the turn moves nodes by 1e-10 m


def least_correlation(slow, fast, dt, **given):
    """Return the least correlation of gusts of one seed over 60 s at two speeds, over the points."""
    a, b = (of_steps(model_of(dt, speed=speed, **given)[1], 5, int(60 / dt)) for speed in (slow, fast))
    return min(np.corrcoef(a[:, k], b[:, k])[0, 1] for k in range(a.shape[1]))


@pytest.mark.parametrize("speeds", [(40.0, 41.0), (20.0, 20.5), (60.0, 61.0)])
@pytest.mark.parametrize("spectrum", ["davenport", "kaimal"])
def test_a_seed_has_similar_gusts_at_neighbouring_speeds(speeds, spectrum):
    """The correlation is above 0.99 at every point. Other seeds have other gusts."""
    assert least_correlation(*speeds, 0.05, spectrum=spectrum) > 0.99
    model = model_of(0.05, spectrum=spectrum)[1]
    assert abs(np.corrcoef(of_steps(model, 1, 1200)[:, 0], of_steps(model, 2, 1200)[:, 0])[0, 1]) < 0.7


def test_gusts_of_all_speeds_are_related():
    """Lags and the burn-in change by steps between 15 and 75 m/s; also with few lags."""
    speeds = np.arange(15.0, 75.0, 2.5)
    for slow in speeds:
        assert least_correlation(slow, 1.02 * slow, 0.5) > 0.99, slow
    lags = [tuple(model_of(0.5, POINTS[:2], speed=speed)[1].lags) for speed in speeds]
    assert len(set(lags)) > 10  # the scan does meet borders
    assert least_correlation(40.0, 41.0, 0.05, ar_order=4) > 0.99


def test_noise_is_a_function_of_seed_and_step():
    """The numbers do not depend on earlier draws, also before 0 s. Other seeds or steps have others."""
    model = model_of(0.05, POINTS[:3])[1]
    a, b = GustRecursion(model, 1), GustRecursion(model, 2)
    later = a.noise(5)[0].copy()
    early = a.noise(-70)[0].copy()
    assert (a.noise(5)[0] == later).all() and (GustRecursion(model, 1).noise(-70)[0] == early).all()
    assert (a.noise(4)[1] == later).all() and len(a.noise(-70)) == 6  # of a block of 64
    drawn = [later, early, b.noise(5)[0], a.noise(6)[0], a.noise(64 + 5)[0]]
    assert len({row.tobytes() for row in drawn}) == 5
    assert a.step == 0


def test_the_burn_in_removes_the_initial_state():
    """Gusts that start at zero twice as early differ by 3 % of the standard deviation at most."""
    gust, model = model_of(0.2)
    long = replace(model, burn_in=2 * model.burn_in)
    a, b = of_steps(model, 1, 300), of_steps(long, 1, 300)
    assert 0 < np.abs(a - b).max() < 0.03 * gust.deviation


def test_turbulence_intensity_gives_the_drag_coefficient():
    """k = I^2 / 6."""
    for given in {"turbulence_intensity": 0.18}, {"surface_drag": 0.18**2 / 6}:
        assert make_gust(settings(speed=40.0, **given)).deviation == pytest.approx(0.18 * 40)
    assert make_gust(settings(speed=40.0, turbulence_intensity=0.0)) is None


# --- walls and tall nets


WIDE, HIGH = 40.0, 25.0  # m, of the facade


def facade(columns=17, rows=11):
    """Return nodes of a facade across the wind, and their vector areas: half a cell along edges."""
    line = lambda count, size: (np.linspace(0.0, size, count), np.full(count, size / (count - 1)))
    (across, wide), (up, high) = line(columns, WIDE), line(rows, HIGH)
    for share in (wide, high):
        share[[0, -1]] *= 0.5
    y, z = (grid.ravel() for grid in np.meshgrid(across, up, indexing="ij"))
    area = np.outer(wide, high).ravel()
    return np.column_stack([0 * y, y, z]), np.column_stack([area, 0 * y, 0 * y])


def steep(size):
    """Return separations (k,) [m] up to a size, dense near 0, with weights of Gaussian integration."""
    edges = np.append(0.0, size * np.geomspace(1e-7, 1.0, 60))
    at, weight = np.polynomial.legendre.leggauss(6)
    step = np.diff(edges)[:, None]
    return (edges[:-1, None] + step * (at + 1) / 2).ravel(), (step * weight / 2).ravel()


def over_the_facade(n, decay, waves):
    """Integral (f,) [m4] of the coherence over all pairs of places, for a load sin(pi y / W) sin(pi z / H).

    waves : 0: a load that is the same everywhere
    The integral over places along a side L with one separation a is L - a for that load, for half a wave
    ((L - a) cos(pi a / L) + L / pi sin(pi a / L)) / 2.
    """
    sides = []
    for size in (WIDE, HIGH):
        a, weight = steep(size)
        wave = np.pi * a / size
        half = 0.5 * ((size - a) * np.cos(wave) + size / np.pi * np.sin(wave))
        sides.append((a, 2.0 * weight * (half if waves else size - a)))
    (a, of_a), (b, of_b) = sides
    delay = np.hypot(decay[1] * a[:, None], decay[2] * b) / 40.0
    return np.array([of_a @ np.exp(-f * delay) @ of_b for f in n])


@pytest.mark.parametrize("upward", [1.0, 10.0, 1000.0])
def test_the_gust_load_of_a_facade_follows_its_coherence(upward):
    """Variance of the whole load and of the first mode, and octaves of their spectra, by the integral.

    With a grid in plan a facade had one gust over its height. At 1000 rows of nodes are independent, so the
    spectrum depends on how the area of a node is spread over its height.
    """
    x, vector = facade(25, 16)
    decay = (8.0, 16.0, upward)
    wind = gusty(profile_exponent=0.0, coherence_decay=decay)
    field, gust = make_wind_field(x, vector, wind), make_gust(wind)
    mode = np.sin(np.pi * x[:, 1] / WIDE) * np.sin(np.pi * x[:, 2] / HIGH)
    n = np.geomspace(1e-4, 10.0, 150)
    # the lags miss octaves by 0.03; at 1000 the points are in rows over the height, few in each
    whole, first = (0.05, 0.1) if upward < 100.0 else (0.1, 0.25)
    for waves, share, off in ((0, vector[:, 0], whole), (1, vector[:, 0] * mode, first)):
        load = load_on(field, share)
        expected = np.trapezoid(over_the_facade(n, decay, waves) * gust.spectrum(n), n)
        assert load @ field.model.covariance @ load == pytest.approx(expected, rel=0.05)
        for low in 0.05 * 2.0 ** np.arange(5):
            band = np.linspace(low, 2 * low, 12)
            ours = np.sum(load @ cross_spectra(field.model, 0.05, band).real @ load)
            computed = np.sum(over_the_facade(band, decay, waves) * gust.spectrum(band))
            assert ours == pytest.approx(computed, rel=off), (waves, low)
    assert np.ptp(field.control_point[:, 2]) > 0.5 * HIGH


def test_each_decay_changes_the_load_of_a_masted_net():
    """A tent of 20 m over a square of 40 m: along the wind, across and upward, for both kinds of gusts."""
    a, b = (grid.ravel() for grid in np.meshgrid(*(2 * [np.linspace(-20.0, 20.0, 11)]), indexing="ij"))
    x = np.column_stack([a, b, 20.0 * (1 - np.hypot(a, b) / 29.0) ** 2])
    vector = np.tile([0.0, 0.0, 16.0], (len(x), 1))
    for gusts in ("area_mean", "point"):
        variances = []
        for decay in ((8.0, 16.0, 10.0), (4.0, 16.0, 10.0), (8.0, 8.0, 10.0), (8.0, 16.0, 20.0)):
            field = make_wind_field(x, vector, gusty(gust_field=gusts, coherence_decay=decay))
            load = load_on(field, vector[:, 2])
            variances.append(load @ field.model.covariance @ load)
        # less decay: the correlation and the load increase; more: they decrease
        assert variances[1] > 1.005 * variances[0] and variances[2] > 1.02 * variances[0], gusts
        assert variances[3] < 0.998 * variances[0], gusts


def test_gust_points_of_a_roof_are_in_plan_and_those_of_a_wall_in_space():
    """A roof has the paper's grid in plan. The same surface, turned upright, has points over its height."""
    wall, vector = facade()
    wind = gusty(gust_field="point")
    roof = make_wind_field(wall[:, [1, 2, 0]], vector[:, [1, 2, 0]], wind)
    assert [len(np.unique(roof.control_point[:, k])) for k in range(3)] == [6, 4, 1]
    field = make_wind_field(wall, vector, wind)
    assert len(field.control_point) == 25 and np.ptp(field.control_point[:, 2]) > 15.0
    at_points = field.model.covariance[0, 0] ** 0.5
    assert field.deviation == pytest.approx(np.full(len(wall), at_points), rel=1e-6)


@pytest.mark.parametrize("nodes, points", [(1, 25), (2, 25), (3, 1), (7, 25)])
def test_few_nodes_have_one_control_point_each(nodes, points):
    """Down to one node. Each has its own gust for any decay, or all have one gust without decay."""
    x = np.column_stack([np.zeros(nodes), np.zeros(nodes), 10.0 * np.arange(nodes)])
    vector = np.tile([4.0, 0.0, 0.0], (nodes, 1))
    for gusts, decay in ("area_mean", DECAY), ("point", DECAY), ("area_mean", (0.0, 0.0, 0.0)):
        wind = gusty(speed=30.0, control_points=points, gust_field=gusts, coherence_decay=decay)
        field = make_wind_field(x, vector, wind)
        assert len(field.control_point) == (min(nodes, points) if any(decay) else 1)
        assert np.isfinite(field.weight).all() and field.deviation.min() > 0.6 * 0.2 * 30.0
        assert field.weight.sum(1) == pytest.approx(np.ones(nodes), abs=1e-6)


def test_gusts_keep_their_variance_between_control_points():
    """Interpolated gusts have the variance of a point: the weights' product with the covariance is 1."""
    x = np.array([[a, b, 0.0] for a in np.linspace(0, 90, 7) for b in np.linspace(0, 70, 6)])
    wind = gusty(speed=30.0, direction=20.0, control_points=9, gust_field="point", spectrum="kaimal")
    field = make_wind_field(x, np.tile([0.0, 0.0, 1.0], (42, 1)), wind)
    pairs = field.model.covariance[field.corner[:, :, None], field.corner[:, None, :]]
    variance = np.einsum("ni,nj,nij->n", field.weight, field.weight, pairs)
    assert variance == pytest.approx(field.model.covariance[0, 0] * np.ones(42), rel=1e-9)
    assert (field.weight.sum(1) > 1.1).any()  # interpolation alone would lose more than that


def test_the_largest_decay_does_not_divide_by_zero():
    """A decay of 1e6 leaves nothing of a mean at the highest frequencies. Warnings are errors."""
    x, vector = facade(9, 6)
    field = make_wind_field(x, vector, gusty(speed=30.0, coherence_decay=(1e6, 1e6, 1e6)))
    assert np.isfinite(field.model.losses.misfit) and field.deviation.max() < 0.01 * 0.2 * 30.0


def test_the_error_of_the_coherence_is_that_by_hand():
    """The error is 0 if each node has its own point. For one gust it is 1 minus the correlation, by hand."""
    x = np.array([[0.0, 15.0 * k, 12.0 * j] for k in range(3) for j in range(3)])
    vector = np.tile([4.0, 0.0, 0.0], (9, 1))
    slow = {"speed": 30.0, "gust_field": "point", "profile_exponent": 0.0, "time_step": 0.5}
    wind, one = gusty(**slow), gusty(**slow, control_points=1)
    gust = make_gust(wind)
    own = coherence_errors(x, make_wind_field(x, vector, wind), wind, gust)
    assert own == pytest.approx([0.0, 0.0], abs=1e-3)  # the table of delays
    n = np.geomspace(1e-6, 1.0, 4000)
    power = lambda delay: np.trapezoid(gust.spectrum(n) * np.exp(-n * delay), n)
    lacks = lambda delay: 1 - power(delay) / power(0.0)
    exact = {True: [], False: []}
    for p, q in itertools.combinations(x, 2):
        across, up = 16.0 * abs(p - q)[1], 10.0 * abs(p - q)[2]
        exact[up > across].append(lacks(math.hypot(across, up) / 30.0) ** 2)
    error = coherence_errors(x, make_wind_field(x, vector, one), one, gust)
    assert error == pytest.approx([np.mean(exact[k]) ** 0.5 for k in (False, True)], rel=5e-3)  # quadratures
    flat = coherence_errors(x[:, [0, 1, 0]], make_wind_field(x[:, [0, 1, 0]], vector, one), one, gust)
    assert flat[0] > 0.0 and np.isnan(flat[1])
