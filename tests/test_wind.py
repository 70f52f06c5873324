"""The wind:
variance, spectrum and coherence of the histories, the force on a roof, the choices after a fracture.
"""

import numpy as np
import pytest
from conftest import STEEL
from scipy.signal import csd, welch

from netfall.wind.autoregressive import GustRecursion, fit_gust_model, spread_lags
from netfall.wind.davenport import davenport_coherence, davenport_spectrum, gust_variance

U0, K, DT, ORDER, DECAY = 40.0, 0.03, 0.05, 4, np.array([8.0, 16.0, 10.0])
POINTS = np.array([[x, y, 0.0] for x in (-30.0, -10.0, 10.0, 30.0) for y in (0.0, 15.0, 30.0)])
STEPS = int(1500 / DT)


@pytest.fixture(scope="module")
def histories():
    """1500 s at twelve points, for three seeds."""
    model = fit_gust_model(POINTS, np.full(len(POINTS), U0), U0, K, DECAY, DT, ORDER)
    return [
        np.array([g.advance() for _ in range(STEPS)])
        for g in (GustRecursion(model, seed, U0, DT) for seed in (1, 2, 3))
    ]


def test_spectrum_integrates_to_its_variance():
    """The integral of Davenport's spectrum is 6 k U0^2."""
    n = np.geomspace(1e-7, 1e5, 400_001)
    assert abs(np.trapezoid(davenport_spectrum(n, U0, K) * n, np.log(n)) / gust_variance(U0, K) - 1) < 1e-3


def test_variance_is_the_spectrums(histories):
    """Within 20 % of 6 k U0^2 over 1500 s, for each seed."""
    for u in histories:
        assert abs(u.var(axis=0).mean() / gust_variance(U0, K) - 1) < 0.2
        assert abs(u.mean()) < 3 * np.sqrt(gust_variance(U0, K) * 60 / 1500)  # a gust's memory is some 30 s


def test_spectrum_band_by_band(histories):
    """Within 25 % in each octave from 0.02 to 10 Hz, over 1500 s, averaged over points and seeds."""
    for low in 0.02 * 2.0 ** np.arange(9):
        ratios = []
        for u in histories:
            n, S = welch(u.T, 1 / DT, nperseg=8192)
            band = (n >= low) & (n < 2 * low)
            ratios.append(S[:, band].mean() / davenport_spectrum(n[band], U0, K).mean())
        assert abs(np.mean(ratios) - 1) < 0.25, (low, ratios)


@pytest.mark.parametrize("i, j", [(0, 1), (0, 3), (3, 6)])
def test_coherence_is_davenports(histories, i, j):
    """Between two points along and across the wind, within 0.1."""
    n, cross = csd(*(np.concatenate([u[:, k] for u in histories]) for k in (i, j)), 1 / DT, nperseg=1024)
    own = [welch(np.concatenate([u[:, k] for u in histories]), 1 / DT, nperseg=1024)[1] for k in (i, j)]
    measured, asked = (
        cross.real / np.sqrt(own[0] * own[1]),
        davenport_coherence(n, POINTS[i] - POINTS[j], DECAY, U0),
    )
    for low, high in ((0.02, 0.06), (0.06, 0.15), (0.15, 0.3), (0.3, 0.6), (0.6, 1.2)):
        band = (n >= low) & (n < high)
        assert abs(measured[band].mean() - asked[band].mean()) < 0.1, (
            low,
            measured[band].mean(),
            asked[band].mean(),
        )


def test_noise_is_a_function_of_seed_and_step():
    """The same numbers whatever was drawn before; others for another seed or step."""
    model = fit_gust_model(POINTS[:3], np.full(3, U0), U0, K, DECAY, DT, ORDER)
    a, b = GustRecursion(model, 1, U0, DT), GustRecursion(model, 2, U0, DT)
    assert (a.noise(5) == GustRecursion(model, 1, U0, DT).noise(5)).all()
    assert (a.noise(5) != b.noise(5)).all() and (a.noise(5) != a.noise(6)).all()


@pytest.mark.parametrize(
    "speed, dt, order", [(5, 0.5, 1), (10, 0.05, 4), (40, 0.01, 3), (80, 0.1, 8), (60, 2.0, 30)]
)
def test_lags_are_as_many_as_asked_and_the_model_is_stable(speed, dt, order):
    """At slow and fast winds, short and long steps."""
    lags, gain = spread_lags(POINTS[:4], np.full(4, speed), speed, DECAY, dt, order)
    assert 0.8 < gain < 1.25
    assert 1 <= len(lags) <= order and lags[0] == 1 and (np.diff(lags) > 0).all()
    model = fit_gust_model(POINTS[:4], np.full(4, speed), speed, K, DECAY, dt, order)
    g = GustRecursion(model, 1, speed, dt)
    u = np.array([g.advance() for _ in range(4000)])
    assert np.isfinite(u).all() and np.abs(u).max() < 8 * np.sqrt(gust_variance(speed, K))


FLAT = (
    '[net]\ngenerator = "saddle"\nside = 40.0\nrise = 0.0\ncells = 4\n'
    + STEEL
    + "[form_finding]\nmodulus_factor = 0\n"
)
BLOW = (
    "[wind]\nspeed = 30.0\nroughness = {k}\nshape_coefficient = {u}\n"
    "air_density = 1.25\nprofile_exponent = 0.0\n"
    "[dynamics]\nduration = 0.002\ntime_step = 1e-5\n[output]\nhistory = 0.001\n"
)


@pytest.mark.parametrize("coefficient", [-1.3, 0.8])
def test_force_on_a_flat_roof_by_hand(workshop, coefficient):
    """Acceleration of the inner particles right after t = 0: u_s A rho U^2 / 2 over their mass;
    suction lifts.
    """
    f = workshop.run(workshop.job(FLAT + BLOW.format(k=0.0, u=coefficient)))
    free = ~f["net/fixed"][:].astype(bool).all(1)
    v = f["final/velocity"][:][free]
    mass = 7850 * 683.08e-6 * 10 * 2 / (1 + 100e3 / (1.95e11 * 683.08e-6))
    expected = -coefficient * 100.0 * 0.5 * 1.25 * 30**2 / mass * 0.002
    assert np.allclose(v[:, 2], expected, rtol=1e-3)  # the net barely resists within 2 ms
    assert np.sign(v[0, 2]) == -np.sign(coefficient)


def test_measured_wind_from_a_table(workshop):
    """Speeds from a table, interpolated in time: impulse of a linear ramp on a flat roof."""
    (workshop.folder / "speed.csv").write_text("time,speed\n-1,99\n0,0\n0.001,20\n0.004,20\n")
    text = FLAT + BLOW.format(k=0.0, u=-1.0).replace("speed = 30.0\nroughness = 0.0", 'file = "speed.csv"')
    f = workshop.run(workshop.job(text))
    mass = 7850 * 683.08e-6 * 20 / (1 + 100e3 / (1.95e11 * 683.08e-6))
    impulse = 100 * 0.625 * (20**2 / 3 * 0.001 + 20**2 * 0.001)
    free = ~f["net/fixed"][:].astype(bool).all(1)
    assert np.allclose(f["final/velocity"][:][free, 2], impulse / mass, rtol=2e-3)
    assert np.allclose(f["wind/speed"][:3, 0], [0, 20, 20])


@pytest.mark.parametrize(
    "table, message",
    [
        ("time,speed\n0,1\n0,2\n", "not after the row before"),
        ("time,speed\n0,1\n0.001,1\n", "covers 0 to 0.001 s"),
        ("time,speed\n0,1\n1,-2\n", "speed = '-2'"),
        ("time,velocity\n0,1\n", "column speed is missing"),
    ],
)
def test_wrong_wind_table_is_refused(workshop, table, message):
    """With file, line and what is expected."""
    (workshop.folder / "speed.csv").write_text(table)
    text = FLAT + BLOW.format(k=0.0, u=-1.0).replace("speed = 30.0\nroughness = 0.0", 'file = "speed.csv"')
    assert message in workshop.run(workshop.job(text), code=2).stderr


def test_wind_without_normals_is_refused(workshop):
    """Areas from the table but no face in plan:
    the wind would have no direction, and is not dropped silently.
    """
    nodes = "id,x,y,z,fixed,area\n1,0,0,0,1,5\n2,10,0,0,0,10\n3,20,0,0,1,5\n"
    job = workshop.job(STEEL + BLOW.format(k=0.0, u=-1.0), nodes, "start,end\n1,2\n2,3\n")
    assert "have no normal to act along (first: node 2)" in workshop.run(job, code=2).stderr


STORM = """[net]
generator = "saddle"
side = 40.0
cells = 6
[cable]
modulus = 1.95e11
area = 400e-6
density = 7850.0
prestress = 100e3
yield_stress = 1.75e9
fracture_strain = 0.0404
[form_finding]
modulus_factor = 0
[wind]
speed = 60.0
shape_coefficient = -3.0
seed = 3
after_fracture = "{after}"
[dynamics]
duration = 1.0
[output]
history = 0.002
frames = 20
"""


def test_choices_after_a_fracture(workshop):
    """all: no more external work after the first fracture; particle: less than none;
    the runs agree until then.
    """
    f = {
        after: workshop.run(workshop.job(STORM.format(after=after), name=after), output=f"{after}.vtkhdf")
        for after in ("particle", "all", "none")
    }
    first = {after: (g["events/step"][0], g["events/element"][0]) for after, g in f.items()}
    assert len(set(first.values())) == 1
    t, work = f["all"]["history/time"][:], f["all"]["history/external_work"][:]
    after = t > f["all"]["events/time"][0] + 0.002
    assert after.sum() > 50 and np.ptp(work[after]) == 0.0
    assert np.ptp(f["particle"]["history/external_work"][:][after]) > 0
    assert f["none"]["history/external_work"][-1] != f["particle"]["history/external_work"][-1]
