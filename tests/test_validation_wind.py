"""Wind compared with Davenport's formulas, and particles in it with exact solutions."""

import itertools

import numpy as np
import pytest
from conftest import STEEL, Workshop
from nets import table
from scipy.linalg import expm
from scipy.signal import csd

THEME = "Wind"
U0, K, DT, DECAY = 40.0, 0.03, 0.1, (8.0, 16.0, 10.0)
SIDE, TIE, EA, MASS, ZETA = 30.0, 10.0, 1e5, 1000.0, 0.3
C = 0.5 * 1.25 * 0.02 * 30.0**2 / 3  # N, force on the middle particle at 1 m/s
SEEDS, DURATION, SKIPPED = (1, 2, 3), 3000.0, 60.0
FIT, FIT_COHERENCE = 0.09, 0.08  # by which default lags miss half octaves and coherences at most

CORNER = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
# a square of threads without stiffness, whose faces give the middle particle a third of the square; it stands
# on a tie of stiffness k
CORNERS = "".join(f"{k + 2},{x},{y},{{z}},1,0,0\n" for k, (x, y) in enumerate(SIDE / 2 * CORNER))
ENDS = *((1, k) for k in range(2, 6)), (2, 3), (3, 4), (4, 5), (5, 2)
THREADS = table("start,end,group", ((*pair, "thread") for pair in ENDS))
LIMP = "[cable]\nmodulus = 1.0\narea = 1e-12\ndensity = 1.0\n"
NODES = f"id,x,y,z,fixed,mass,load_z\n1,0,0,0,0,{MASS},0\n" + CORNERS.format(z=0) + f"6,0,0,{-TIE},1,0,0\n"
OSCILLATOR = f"""{LIMP}[group.tie]
kind = "bar"
modulus = {EA / 1e-4}
area = 1e-4
density = 1.0
[wind]
onset = "sudden"
speed = {U0}
surface_drag = {K}
pressure_coefficient = -0.02
gust_field = "point"
profile_exponent = 0.0
time_step = {DT}
control_points = 9
[dynamics]
fragments = false
duration = {{duration}}
time_step = {{dt}}
mass_damping = {ZETA}
[output]
history_interval = {{history}}
frames = 1
probes = [[0, 0]]
"""
LUMP = MASS + 0.5 * 1e-4 * TIE  # kg, with half of the tie
OMEGA = np.sqrt(EA / TIE / LUMP)


def davenport(n):
    """Return Davenport's spectrum [m2/s2/Hz]."""
    x = 1200 * n / U0
    return 4 * K * U0**2 * x**2 / (n * (1 + x**2) ** (4 / 3))


def coherence(n, dx, dy):
    """Return Davenport's root coherence of points dx apart along and dy across the wind [m]."""
    return np.exp(-n * np.hypot(DECAY[0] * dx, DECAY[1] * dy) / U0)


def over(n, values):
    return np.trapezoid(values, n)


def octave(low):
    return np.linspace(low, 2 * low, 400)


SAMPLED = np.geomspace(1e-6, 0.5 / DT, 20_000)  # Hz, up to half the sampling frequency
BEYOND = 1 - over(SAMPLED, davenport(SAMPLED)) / (6 * K * U0**2)  # share of the variance that lies beyond


@pytest.fixture(scope="module")
def storms(tmp_path_factory):
    """Return 3000 s of wind on the oscillator for three seeds: results of runs on one rank."""
    shop = Workshop(tmp_path_factory.mktemp("storms"), standing=True)
    job = shop.job(OSCILLATOR.format(duration=DURATION, dt=0.05, history=0.4), NODES, THREADS + "1,6,tie\n")
    return [shop.run(job, "--set", f"wind.seed={seed}", output=f"{seed}.vtkhdf") for seed in SEEDS]


@pytest.fixture(scope="module")
def gusts(storms):
    """Return speeds without their mean (t, 9) [m/s] of each storm."""
    return [f["wind/speed"][:] - U0 for f in storms]


POINTS = [(x, y) for x in (-15, 0, 15) for y in (-15, 0, 15)]
TOTAL, STORMS = DURATION * len(SEEDS), f"{len(SEEDS)} x {DURATION:g} s"


def scatter(n):
    """Return the relative standard deviation of the power within frequencies n, mean of nine points."""
    together = np.mean([coherence(n, a[0] - b[0], a[1] - b[1]) ** 2 for a in POINTS for b in POINTS], axis=0)
    return np.sqrt(over(n, together * davenport(n) ** 2) / TOTAL) / over(n, davenport(n))


def test_mean_and_variance(storms, gusts, compare):
    assert np.allclose(storms[0]["wind/control_point"][:, :2], POINTS)
    n = np.geomspace(1e-5, 100, 20_000)
    slow = np.sqrt(davenport(n).max() / 2 / TOTAL)
    compare(f"wind at 9 points, {STORMS}: mean", "U0").figures(
        U0 + np.mean(gusts), U0, 3 * slow / U0, "3 standard deviations: sqrt(S max / 2 T)", "m/s"
    )
    ours, theirs = np.mean([u.var(0) for u in gusts]), 6 * K * U0**2 * (1 - BEYOND)
    case = compare("the same: variance", "6 k U0^2 below half the sampling frequency")
    case.figures(ours, theirs, 3 * scatter(n), "3 standard deviations", "m2/s2")


def spectra(gusts, i, j):
    """Return frequencies [Hz] and real cross spectrum [m2/s2/Hz] of points i and j over some storms."""
    pairs = [csd(u[:, i], u[:, j], 1 / DT, nperseg=4096) for u in gusts]
    return pairs[0][0], np.mean([S.real for _, S in pairs], axis=0)


def measured_spectrum(gusts, low):
    """Return the mean spectrum of all points over an octave, and Davenport's."""
    n, S = np.mean([spectra(gusts, i, i) for i in range(len(POINTS))], axis=0)
    band = (n >= low) & (n < 2 * low)
    return S[band].mean(), davenport(n[band]).mean()


def measured_coherence(gusts, low, along):
    """Return the coherence of neighbours over an octave, and Davenport's."""
    n = spectra(gusts, 0, 0)[0]
    band = (n >= low) & (n < 2 * low)
    of = lambda i, j: spectra(gusts, i, j)[1][band].sum()
    pairs = ((1, 4), (4, 7)) if along else ((3, 4), (4, 5))
    measured = np.mean([of(i, j) / np.sqrt(of(i, i) * of(j, j)) for i, j in pairs])
    expected, power = coherence(n[band], *((15, 0) if along else (0, 15))), davenport(n[band])
    return measured, expected @ power / power.sum()


@pytest.mark.parametrize("low", 0.02 * 2.0 ** np.arange(7))
def test_spectrum(gusts, compare, low):
    within, why = FIT + 3 * scatter(octave(low)), "fit of the default lags 9 %; 3 standard deviations"
    case = compare(f"the same: spectrum, {low:.2f} to {2 * low:.2f} Hz", "Davenport")
    case.figures(*measured_spectrum(gusts, low), within, why, "m2/s")


@pytest.mark.parametrize("low", 0.02 * 2.0 ** np.arange(5))
@pytest.mark.parametrize("along", [True, False])
def test_coherence(gusts, compare, along, low):
    measured, expected = measured_coherence(gusts, low, along)
    what = f"the same: coherence 15 m {'along' if along else 'across'} the wind"
    within = FIT_COHERENCE + 3 * (1 - expected**2) / np.sqrt(2 * low * TOTAL)
    why = "fit of the default lags 0.08; 3 standard deviations: (1 - coh^2) / sqrt(2 B T)"
    case = compare(f"{what}, {low:.2f} to {2 * low:.2f} Hz", "Davenport")
    case.figures(measured, expected, within, why, scale=1.0)


def exact_oscillator(time, speed, at):
    """Displacement [m] of m z'' + zeta m z' + k z = C U^2 from rest, U linear between the samples:
    each interval solved exactly.
    """
    dt, z = time[1] - time[0], np.zeros(2)
    system = np.zeros((5, 5))
    system[:2, :3] = [[0, 1, 0], [-(OMEGA**2), -ZETA, 1]]
    system[2, 3], system[3, 4] = 1, 1  # the load per mass, its slope and its curvature
    steps = round(dt / at)
    fine = expm(system * dt / steps)
    response = [0.0]
    for a, b in itertools.pairwise(speed):
        state = np.array([*z, *(C / LUMP * np.array([a * a, 2 * a * (b - a) / dt, 2 * ((b - a) / dt) ** 2]))])
        for _ in range(steps):
            state = fine @ state
            response.append(state[0])
        z = state[:2]
    return np.array(response)


def test_oscillator_in_the_generated_wind(both_ways, compare):
    f = both_ways.solve(OSCILLATOR.format(duration=60.0, dt=0.005, history=0.1), NODES, THREADS + "1,6,tie\n")
    t, z = f["history/time"][:], f["history/probe_displacement"][:, 0, 2]
    exact = exact_oscillator(f["wind/time"][:], f["wind/speed"][:, 4], 0.1)[: len(t)]
    error = (OMEGA * 0.005) ** 2 / 24 / (0.5 * ZETA / OMEGA)
    rms = lambda values: np.sqrt(np.mean(values**2))
    because = "second order: frequency (omega dt)^2 / 24, over the damping ratio"
    case = compare("oscillator in gusts, 60 s: largest displacement", "exact solution of each interval")
    case.figures(z.max(), exact.max(), error, because, "m")
    case = compare("the same: rms of the difference", "exact solution of each interval")
    case.error(rms(z - exact), error * rms(exact), because, "m")


def response(n):
    """Return |H|^2 [m2/N2] of the oscillator without the part beyond linear interpolation between samples."""
    w = 2 * np.pi * n
    return np.sinc(n * DT) ** 4 / ((EA / TIE - LUMP * w**2) ** 2 + (ZETA * LUMP * w) ** 2)


def test_response_to_the_spectrum(storms, compare):
    z = [f["history/probe_displacement"][:, 0, 2][f["history/time"][:] > SKIPPED] for f in storms]
    variance, count = 6 * K * U0**2, 2**18
    n = np.append(1e-9, np.arange(1, count + 1)) * (0.5 / DT / count)
    S, dn = davenport(n), n[2] - n[1]
    slow = 2 * U0 * np.sqrt(S.max() / 2 / TOTAL)
    theirs, within = C * (U0**2 + variance) * TIE / EA, (3 * slow + BEYOND * variance) / (U0**2 + variance)
    why = "3 standard deviations of the mean speed; share of the variance beyond half the sampling frequency"
    case = compare(f"oscillator, {STORMS}: mean displacement", "C (U0^2 + 6 k U0^2) / stiffness")
    case.figures(np.mean(z), theirs, within, why, "m")
    R = np.fft.irfft(S) * count * dn  # covariance of the gust; that of its square is 2 R^2 (Gaussian process)
    full = C**2 * (4 * U0**2 * S + np.fft.rfft(2 * R**2).real / (count * dn))
    assert abs(over(n, full) / (C**2 * (4 * U0**2 * R[0] + 2 * R[0] ** 2)) - 1) < 1e-3
    H = response(n)
    sigma = np.sqrt(over(n, H * full))
    spread = np.sqrt(over(n, (H * full) ** 2) / TOTAL) / sigma**2
    ours = np.sqrt(np.mean([v.var() for v in z]))
    why = "half of: fit of the default lags 9 %; 3 standard deviations"
    case = compare("the same: standard deviation", "integral of |H|^2 S, S with the square of the gust")
    case.figures(ours, sigma, 0.5 * (FIT + 3 * spread), why, "m")


@pytest.mark.parametrize("coefficient", [-1.3, 0.8])
def test_force_on_a_flat_roof_by_hand(both_ways, compare, coefficient):
    """A free particle in the middle of a flat square 30 m above ground:
    u_s A rho U^2 / 2 with a third of the square; suction lifts.
    """
    text = LIMP + "[wind]\nonset = 'sudden'\nspeed = 30.0\nsurface_drag = 0.0\nprofile_exponent = 0.2\n"
    text += f"pressure_coefficient = {coefficient}\nbase_height = 25.0\n[dynamics]\n"
    text += "duration = 1.0\ntime_step = 0.01\n"
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,5,0,{MASS},0\n" + CORNERS.format(z=5)
    f = both_ways.solve(text, nodes, THREADS)
    force = -coefficient * SIDE**2 / 3 * 0.5 * 1.25 * (30.0 * 3.0**0.2) ** 2
    case = f"particle of a flat roof at 30 m height, u_s = {coefficient}: way in 1 s"
    way, why = f["final/position"][0, 2] - 5, "central difference is exact for a constant force"
    compare(case, "u_s A rho U^2 t^2 / 4 M by hand").figures(way, 0.5 * force / MASS, 1e-12, why, "m")


def test_profile_of_the_mean_speed(both_ways, compare):
    text = (
        f'[net]\ngenerator = "saddle"\n[net.saddle]\nrise = 8.0\n{STEEL}[form_finding]\nmodulus_factor = 0\n'
    )
    text += "[wind]\nonset = 'sudden'\nspeed = 30.0\npressure_coefficient = -1.0\nsurface_drag = 0.03\n"
    text += "gust_field = 'point'\nprofile_exponent = 0.2\nbase_height = 30.0\n[dynamics]\nduration = 0.1\n"
    f = both_ways.solve(text)
    z, U = f["wind/control_point"][:, 2] + 30.0, f["wind/mean_speed"][:]
    assert np.ptp(z) > 5
    expected = 30 * (z / 10) ** 0.2
    worst = np.abs(U - expected).argmax()
    case = compare(f"mean speed at {len(z)} heights: the one farthest off", "U0 (z / 10 m)^0.2")
    case.figures(U[worst], expected[worst], 1e-14, "a formula; rounding", "m/s")
