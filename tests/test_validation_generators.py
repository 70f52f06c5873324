"""Gusts against PyConTurb, a generator by another method, and a spectrum fitted to measured wind.

PyConTurb's statistics are stored in wind_reference.npz; wind_reference.py describes and makes them.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import wind_reference as wind

from netfall.core.errors import InputError
from netfall.job.keys.schema import SECTIONS
from netfall.loads.wind.autoregressive import GustRecursion
from netfall.loads.wind.field import WindField, load_power, make_wind_field
from netfall.loads.wind.surface import square_variances
from netfall.physics.wind_spectra import make_gust

THEME, PYCONTURB = "Other programs", "PyConTurb, sums of cosines at every node"
NODES = (wind.CELLS + 1) ** 2
FIT, FIT_LAST, FIT_COHERENCE = 0.09, 0.2, 0.08  # octaves except the last; the last, where means are weak
SCATTER = 3.0  # standard errors


def field_of(gusts: str, points: int, spectrum: str = "davenport", decay=wind.DECAY) -> tuple:
    settings = SimpleNamespace(
        **{key.name: key.default for key in SECTIONS["wind"]}
        | dict(speed=wind.SPEED, turbulence_intensity=wind.INTENSITY, spectrum=spectrum, gust_field=gusts)
        | dict(control_points=points, time_step=wind.DT, coherence_decay=(*decay, 10.0))
        | dict(pressure_coefficient=-1.0, profile_exponent=0.0)
    )
    return settings, make_wind_field(*nodes_and_areas(), settings)


def nodes_and_areas() -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n, 3) [m] and upward vector areas (n, 3) [m2]."""
    x, area = wind.roof()
    zero = np.zeros(len(x))
    return np.column_stack([x, zero]), np.column_stack([zero, zero, area])


def speeds(field: WindField, seed: int) -> np.ndarray:
    """Return total speeds (t, n) [m/s] of the nodes."""
    recursion = GustRecursion(field.model, seed)
    gusts = np.array([recursion.advance() for _ in range(round(wind.DURATION / wind.DT))])
    weight = np.zeros((len(field.control_point), NODES))
    np.add.at(weight, (field.corner, np.arange(NODES)[:, None]), field.weight)
    return field.mean + gusts @ weight


def realisations(field: WindField, count: int) -> dict[str, np.ndarray]:
    """Return statistics of seeds 1 to count."""
    return wind.stack([wind.statistics(speeds(field, seed)) for seed in range(1, count + 1)])


@pytest.fixture(scope="module")
def theirs():
    """Return PyConTurb's statistics: by "case/name", realisations along the first axis."""
    with np.load(wind.STORED) as f:
        return dict(f)


def count(long: int, short: int, request) -> int:
    return long if request.config.getoption("--long") else short


def check(compare, case: str, what: str, unit: str, ours, theirs, fit, absolute: bool = False) -> None:
    """Compare the means of realisations (r, ...); of a coherence the worst octave of each separation."""
    error = np.sqrt(ours.var(0, ddof=1) / len(ours) + theirs.var(0, ddof=1) / len(theirs))
    a, b = np.asarray(ours.mean(0)), np.asarray(theirs.mean(0))
    fit = np.broadcast_to(fit, a.shape)
    allowed = fit + SCATTER * error / (1 if absolute else b)
    places = list(np.ndindex(a.shape))
    if a.ndim > 1:
        off = np.abs(a - b) / allowed
        places = [(k, int(np.argmax(off[k]))) for k in range(len(a))]
    for place in places:
        band = f", {wind.OCTAVES[place[-1]]:.2f} to {2 * wind.OCTAVES[place[-1]]:.2f} Hz" if place else ""
        if len(place) > 1:
            band = f" at {wind.SEPARATIONS[place[0]] * wind.SIDE / wind.CELLS:g} m, worst octave{band}"
        because = f"fit of the lags {fit[place]:g}; {SCATTER:g} standard errors"
        figures, scale = (a[place], b[place], allowed[place]), 1.0 if absolute else None
        compare(f"{case}: {what}{band}", PYCONTURB).figures(*figures, because, unit, scale)


BANDS = np.array([FIT] * (len(wind.OCTAVES) - 1) + [FIT_LAST])


@pytest.mark.parametrize("spectrum", ["davenport", pytest.param("kaimal", marks=pytest.mark.long)])
def test_load_of_the_roof_by_means(compare, theirs, request, spectrum):
    ours = realisations(field_of("area_mean", 25, spectrum)[1], count(40, 8, request))
    case = f"roof of 60 m in gusts, {spectrum}, means at 25 points"
    for name, what, unit, fit in (
        ("load_deviation", "standard deviation of the load, over its mean", "", 0.02),
        ("load_peak", "largest load in 600 s, over its mean", "", 0.02),
        ("load_spectrum", "spectrum of the load", "1/Hz", BANDS),
    ):
        check(compare, case, what, unit, ours[name], theirs[f"{spectrum}/{name}"], fit)


@pytest.mark.parametrize("spectrum", ["davenport", pytest.param("kaimal", marks=pytest.mark.long)])
def test_gusts_at_nodes_with_a_point_each(compare, theirs, request, spectrum):
    """Variance, octaves, gust factor of 3 s, coherence: properties of the autoregressive model alone."""
    ours = realisations(field_of("point", NODES, spectrum)[1], count(24, 3, request))
    case = f"roof of 60 m in gusts, {spectrum}, a point at each node"
    for name, what, unit, fit, absolute in (
        ("deviation", "standard deviation at a node", "m/s", 0.01, False),
        ("gust_factor", "largest mean over 3 s in 600 s, over the mean", "", 0.01, False),
        ("spectrum", "spectrum at a node", "m2/s", FIT, False),
        ("along", "coherence along the wind", "", FIT_COHERENCE, True),
        ("across", "coherence across the wind", "", FIT_COHERENCE, True),
        ("load_deviation", "standard deviation of the load, over its mean", "", 0.02, False),
        ("load_peak", "largest load in 600 s, over its mean", "", 0.02, False),
    ):
        check(compare, case, what, unit, ours[name], theirs[f"{spectrum}/{name}"], fit, absolute)


def test_the_errors_of_few_points_are_those_of_check(compare, theirs, request):
    """Gusts at 25 points load the roof too much; means at them are too weak at nodes."""
    settings, points = field_of("point", 25)
    x, vector = nodes_and_areas()
    gust = make_gust(settings)
    n = np.geomspace(0.5 / wind.DURATION, 0.5 / wind.DT, 400)
    weight = np.gradient(n) * gust.spectrum(n)
    power = load_power((x, square_variances(vector)), vector, points, settings, n, weight[None])[0]
    announced = float(np.sqrt(power))
    means = field_of("area_mean", 25)[1]
    share = float(np.sqrt(np.mean(means.deviation**2))) / wind.sampled_deviation(wind.davenport)
    runs = count(40, 6, request)
    for field, name, expected, what in (
        (points, "load_deviation", announced, "gusts at 25 points: deviation of the load"),
        (means, "deviation", share, "means at 25 points: deviation at a node"),
    ):
        ours, other = realisations(field, runs)[name], theirs[f"davenport/{name}"]
        error = np.hypot(*(v.std(ddof=1) / np.sqrt(len(v)) / v.mean() for v in (ours, other)))
        ratio, why = ours.mean() / other.mean(), "fit of the lags 0.02; 3 standard errors"
        case = compare(f"{what}, over PyConTurb's", "netfall check")
        case.figures(ratio, expected, 0.02 + SCATTER * error, why)


@pytest.mark.long
def test_the_coherence_of_the_standard_loads_a_roof_less(theirs):
    """IEC 61400-1 has less coherence at slow gusts than Davenport, so netfall's load is conservative."""
    ours = realisations(field_of("area_mean", 25, "kaimal", (12.0, 12.0))[1], 40)
    for name, least, most in (("load_deviation", 1.10, 1.30), ("load_peak", 1.02, 1.12)):
        assert least < ours[name].mean() / theirs[f"iec/{name}"].mean() < most, name


def test_unstable_gust_models_are_refused():
    """The autoregressive model of means at 121 points, one for each node, is unstable."""
    with pytest.raises(InputError, match="would grow without bound"):
        field_of("area_mean", NODES)


@pytest.mark.parametrize("f", [0.003, 0.03, 0.3, 3.0])
def test_kaimal_is_the_spectrum_measured_in_kansas(compare, f):
    """n S / u*^2 = 105 f / (1 + 33 f)^(5/3), f = n z / U, fitted to the measurements of 1968 over a plain."""
    settings, z = SimpleNamespace(**{key.name: key.default for key in SECTIONS["wind"]}), 10.0
    settings.speed, settings.turbulence_intensity, settings.spectrum = 20.0, 0.2, "kaimal"
    n = f * settings.speed / z
    variance = 105.0 / 33.0 * 1.5  # over u*^2, the integral over all f
    ours = n * float(make_gust(settings).spectrum(np.array([n]))[0]) / (0.2 * 20.0) ** 2
    compare(f"spectrum kaimal at n z / U = {f:g}", "Kaimal et al. 1972, Kansas", "Wind").figures(
        ours, 105 * f / (1 + 33 * f) ** (5 / 3) / variance, 0.035, "IEC's length, 34.0 for 33"
    )
