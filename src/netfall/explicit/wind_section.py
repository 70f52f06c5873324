"""Statistics of the wind for /wind, gust factor and number of gust lengths."""

import math

import numpy as np

from netfall.core.functions import integral
from netfall.job.job import Job
from netfall.loads.loads import mean_pressure
from netfall.loads.wind.field import coherence_errors
from netfall.model.model import Model
from netfall.physics.wind_spectra import Gust, make_gust, turbulence_intensity

EULER = 0.5772  # Euler-Mascheroni constant
RECORD_SAMPLES = 2**17  # least number in a record for the expected gust factor
MOST_SAMPLES = 2**20  # largest number in a duration; more would take seconds
LEAST_WINDOWS, MOST_RECORDS = 1000, 30  # durations over which the largest speed is averaged; records


def expected_gust_factor(gust: Gust, dt: float, duration: float) -> float:
    """Estimate the expected ratio of the largest to the mean speed at 10 m in a duration [s].

    It is a mean over random records with the spectrum, drawn by Fourier series. dt : [s] between samples
    If the duration has too many samples, it is 1 + g I with Davenport's peak factor (1964),
    g = sqrt(2 ln nu T) + 0.577 / sqrt(2 ln nu T), nu the rate of upward crossings of the mean. In a duration
    of a few seconds that exceeds the mean by half of g I, in ten minutes by 6 %.
    """
    window = int(duration / dt) + 1  # samples
    if window > MOST_SAMPLES:
        n = np.geomspace(1e-4 * gust.speed / gust.length, 0.5 / dt, 2000)
        S = gust.spectrum(n)
        rate = math.sqrt(integral(n**2 * S, n) / integral(S, n))
        root = math.sqrt(2.0 * math.log(max(rate * duration, math.e)))
        return 1.0 + (root + EULER / root) * gust.deviation / gust.speed
    random, count = np.random.default_rng(0), max(RECORD_SAMPLES, 2 ** (window - 1).bit_length())
    windows = count // window
    amplitude = 0.5 * np.sqrt(count / dt * gust.spectrum(np.fft.rfftfreq(count, dt)))
    amplitude[0] = 0.0
    largest = 0.0
    records = min(MOST_RECORDS, -(-LEAST_WINDOWS // windows))
    for _ in range(records):
        real, imaginary = random.standard_normal((2, len(amplitude)))
        record = np.fft.irfft(amplitude * (real + 1j * imaginary), count)
        largest += record[: windows * window].reshape(windows, window).max(1).mean() / records
    return 1.0 + largest / gust.speed


def negative_share(mean: np.ndarray, deviation: float) -> float:
    """Compute the expected share of negative speeds, normally distributed about means (c,) [m/s]."""
    return float(np.mean([0.5 * math.erfc(u / (math.sqrt(2.0) * deviation)) for u in mean]))


def gust_lengths(job: Job, gust: Gust) -> float:
    """Compute how many gusts of the spectrum's length pass in the duration."""
    return job.dynamics.duration * gust.speed / gust.length


def wind_section(job: Job, model: Model, time: np.ndarray, gust: np.ndarray) -> dict[str, np.ndarray]:
    """Return the datasets of /wind from gusts (t, c) [m/s] at times (t,) [s]."""
    if job.wind.pressures:
        return {
            "tap": model.wind_field.control_point,
            "time": time,
            "pressure": gust,
            "mean_pressure": mean_pressure(job, None, model.wind_field, model.history.mean_gust),
        }
    speed = model.wind_field.control_mean + gust
    mean = model.wind_field.control_mean + model.history.mean_gust
    section = {
        "control_point": model.wind_field.control_point,
        "time": time,
        "speed": speed,
        "mean_speed": mean,
        "gust_factor": speed.max(0) / np.where(mean > 0.0, mean, np.nan),
        "negative_share": np.mean(speed < 0.0, axis=0),
        "shape_coefficient": model.layout.pressure_coefficient,
        "mean_pressure": mean_pressure(
            job, model.layout.pressure_coefficient, model.wind_field, model.history.mean_gust
        ),
    }
    spectrum = make_gust(job.wind)
    if spectrum:
        losses = model.wind_field.model.losses
        section |= {
            "turbulence": np.float64(turbulence_intensity(job.wind)),
            "variance_beyond": np.float64(losses.beyond),
            "variance_between": np.float64(losses.between),
            "spectrum_misfit": np.float64(losses.misfit),
            "coherence_error": coherence_errors(model.x, model.wind_field, job.wind, spectrum),
            "gust_lengths": np.float64(gust_lengths(job, spectrum)),
        }
    return section
