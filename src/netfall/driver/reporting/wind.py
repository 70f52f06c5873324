"""Lines of `check` on the wind, also stored in /wind: intensity, gust factor, errors of the gusts."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from netfall.core.messages import count_of, kN_m2
from netfall.driver import messages
from netfall.explicit.wind_section import expected_gust_factor, gust_lengths, negative_share, wind_section
from netfall.geometry.net import GRAVITY
from netfall.job.derived import gust_ramp, load_settings
from netfall.job.job import Job
from netfall.job.keys.entries import apply_settings
from netfall.job.keys.models import Wind
from netfall.loads.loads import drag_areas, exposed_areas, exposed_patches
from netfall.loads.wind.autoregressive import GustModel, cosine_weights, frequency_nodes
from netfall.loads.wind.field import GrowingGusts, WindField, coherence_errors, load_power, mean_wind_square
from netfall.loads.wind.measured import TableHistory
from netfall.loads.wind.sectors import describe_direction
from netfall.model.model import Model
from netfall.physics.wind_spectra import SHAPES, Gust, make_gust, turbulence_intensity

MAX_NEGATIVE_SHARE = 0.01  # share of negative wind speeds; netfall warns above it
MAX_VARIANCE_LOSS = 0.05  # share of the variance lost by sampling; netfall warns above it
MAX_SPECTRUM_ERROR = 0.2  # relative error of the spectrum in a half octave; netfall warns above it
SLOW_GUSTS = 3.0  # periods of slow gusts in the duration, above which their share of the variance is checked
MAX_SLOW_RATIO = 1.2  # that share relative to the share in the spectrum; netfall warns above it
MAX_ROOF_LOAD_RATIO = 1.1  # load on the whole roof relative to the coherence model; netfall warns above it
MIN_DEVIATION_SHARE = 0.85  # share of the standard deviation, mean over the nodes; netfall warns below it
FREQUENCY_STRIDE = 12  # only every twelfth frequency is evaluated for the load on the whole roof
TYPICAL_ROOF_FREQUENCY = 1.0  # Hz; typical lowest natural frequency of cable roofs
MAX_LENGTH_RATIO = 1.5  # gust length at the height of the roof over that at 10 m; netfall warns above it
MIN_GUST_LENGTHS = 10.0  # gust lengths in the duration, below which one realisation says little


class GeneratedGusts(NamedTuple):
    """Gusts that a job generates on its net; wind : section [wind]; duration : [s] of the dynamic stage."""

    job: Job
    model: Model
    wind: Wind
    duration: float
    field: WindField
    gust_model: GustModel
    gust: Gust


def _generated_gusts(job: Job, model: Model) -> GeneratedGusts | None:
    """Return the gusts that the job generates, None without any."""
    wind, field, gust = job.wind, model.wind_field, make_gust(job.wind) if job.wind else None
    if wind is None or job.dynamics is None or field is None or field.model is None or gust is None:
        return None
    return GeneratedGusts(job, model, wind, job.dynamics.duration, field, field.model, gust)


def slender_loads(job: Job, model: Model) -> Iterator[tuple[str, np.ndarray]]:
    """Yield mean wind and ice on elements with a diameter: a text, and the sum (3,) [N] of the forces."""
    slender, load = model.roof.slender, load_settings(job)
    if slender is None:
        return

    def of_wind(wind: Wind, ice: float, square: np.ndarray) -> np.ndarray:
        """Sum the drag (3,) [N] of a mean wind; square : (n,) [m2/s2] of its speed"""
        drag = slender.at_ends(slender.drag_areas(wind.direction, ice))
        return 0.5 * wind.air_density * (drag * square[:, None]).sum(0)

    field, history = model.wind_field, model.history
    if job.wind is not None and field is not None and history is not None and not field.tapped:
        square = field.mean_square(history.mean_gust)
        yield "mean wind of [wind]", of_wind(job.wind, load.ice, square)
    settings = {f"[[case]] {case.name}": case.set for case in job.cases}
    for place, values in {"[load]": {"load.ice": load.ice}, **settings}.items():
        if values.get("load.ice"):
            weight = GRAVITY * float(slender.ice_mass(values["load.ice"]).sum())
            yield f"ice of {place}", np.array([0.0, 0.0, -weight])
    for case in job.cases:
        wind = model.layout.cases[case.name].wind
        if wind is not None:
            ice, square = apply_settings(load, "load", case.set).ice, mean_wind_square(model.x, wind)
            yield f"wind of [[case]] {case.name}", wind.pressure_factor * of_wind(wind, ice, square)


def wind_lines(job: Job, model: Model) -> list[str]:
    """Return the lines on the wind; [] without wind."""
    wind, history, field = job.wind, model.history, model.wind_field
    if wind is None or history is None or field is None:
        return []
    if wind.pressures:
        mean, axes = history.mean_gust, field.control_point.shape[1]
        means, where = kN_m2(mean.min(), mean.max()), "in plan" if axes == 2 else "in space"
        return [
            f"wind: {wind.pressures}, pressures at {count_of(len(mean), 'tap')}: means of {means} over the "
            f"duration; each node interpolates the four nearest {where}"
        ]
    direction = describe_direction(wind.direction)
    if isinstance(history, TableHistory) and job.dynamics is not None:
        duration = job.dynamics.duration
        of_record = wind_section(job, model, *history.until(duration))["gust_factor"]
        section = wind_section(job, model, *GrowingGusts(history, gust_ramp(job)).until(duration))
        mean, factor = section["mean_speed"], section["gust_factor"]
        is_ramped = not np.array_equal(factor, of_record, equal_nan=True)
        without = f", without the ramp {of_record.min():.3g} to {of_record.max():.3g}" if is_ramped else ""
        where = "one speed at 10 m" if history.places is None else count_of(len(mean), "point")
        return [
            f"wind: {wind.file}, {where}, {direction}: means of {mean.min():.4g} to {mean.max():.4g} m/s "
            f"over the duration, gust factors of {factor.min():.3g} to {factor.max():.3g}{without}"
        ]
    gusts = _generated_gusts(job, model)
    return _gust_lines(gusts) if gusts else [f"wind: steady, {wind.speed:g} m/s at 10 m, {direction}"]


def _gust_lines(gusts: GeneratedGusts) -> list[str]:
    """Return the lines on generated gusts: intensity, gust factor, errors of the spectrum and coherence."""
    wind, field, gust, losses = gusts.wind, gusts.field, gusts.gust, gusts.gust_model.losses
    share = negative_share(field.control_mean, gust.deviation)
    factor = expected_gust_factor(gust, wind.time_step, gusts.duration)
    caution = ": use several seeds" if gust_lengths(gusts.job, gust) < MIN_GUST_LENGTHS else ""
    errors = coherence_errors(gusts.model.x, field, wind, gust)
    parts = [f"{e:.2g} {where}" for e, where in zip(errors, ("over the roof", "in height")) if np.isfinite(e)]
    lines = [
        f"wind: {wind.speed:g} m/s at 10 m, {describe_direction(wind.direction)}, intensity "
        f"{turbulence_intensity(wind):.3g} there ({gust.deviation:.3g} m/s, "
        f"{wind.spectrum}); {len(field.control_point)} control points with means of "
        f"{field.control_mean.min():.4g} to {field.control_mean.max():.4g} m/s, {share:.2%} of their speeds "
        "negative",
        f"gusts: the duration covers {gust_lengths(gusts.job, gust):.3g} gust lengths "
        f"({gust.length:g} m / U0 = {gust.length / gust.speed:.3g} s){caution}; expected gust factor "
        f"{factor:.3g} at 10 m",
        f"gusts: samples {wind.time_step:g} s apart lack {losses.beyond:.2%} of the variance (above "
        f"{0.5 / wind.time_step:.4g} Hz), and linear interpolation removes {losses.between:.2%} of the rest; "
        f"with {len(gusts.gust_model.lags)} lags {losses.slow:.1%} of the variance is below "
        f"{losses.slow_below:.3g} Hz (spectrum: {losses.slow_target:.1%}); the largest spectrum error above "
        f"is {losses.misfit:+.0%}, in the half octave from {losses.misfit_low:.3g} Hz",
        "gusts: the correlation of two nodes in the wind differs from that of Davenport's coherence by "
        f"{', '.join(parts) or '0'} (root mean square over pairs of nodes)",
    ]
    if wind.gust_field != "point":
        deviation = field.deviation / gust.deviation
        lines.append(
            "gusts: means over the area around control points, correct for the load on the whole roof; "
            f"a node has {deviation.min():.0%} to {deviation.max():.0%} of the standard deviation"
        )
    return lines


def wind_warnings(job: Job, model: Model) -> tuple[str, ...]:
    """Return the warnings of generated gusts, computed once for the wind field of the model."""
    gusts = _generated_gusts(job, model)
    if gusts is None:
        return ()
    if not gusts.field.warnings:
        gusts.field.warnings.append(tuple(_gust_warnings(gusts)))
    return gusts.field.warnings[0]


def _gust_warnings(gusts: GeneratedGusts) -> Iterator[str]:
    """Yield the warnings: negative speeds, errors of the spectrum, load level."""
    _, _, wind, duration, field, gust_model, gust = gusts
    losses = gust_model.losses
    share = negative_share(field.control_mean, gust.deviation)
    if share > MAX_NEGATIVE_SHARE:
        key = "surface_drag" if wind.turbulence_intensity is None else "turbulence_intensity"
        yield messages.NEGATIVE_SPEEDS(key=key, value=getattr(wind, key), share=share)
    lost = 1.0 - (1.0 - losses.beyond) * (1.0 - losses.between)
    if lost > MAX_VARIANCE_LOSS:
        yield messages.VARIANCE_LOST(time_step=wind.time_step, share=lost, limit=MAX_VARIANCE_LOSS)
    if abs(losses.misfit) > MAX_SPECTRUM_ERROR:
        order, error, low = wind.ar_order, losses.misfit, losses.misfit_low
        yield messages.SPECTRUM_ERROR(order=order, error=error, low=low, limit=MAX_SPECTRUM_ERROR)
    if duration * losses.slow_below > SLOW_GUSTS and losses.slow > MAX_SLOW_RATIO * losses.slow_target:
        period, share, target = 1.0 / losses.slow_below, losses.slow, losses.slow_target
        yield messages.SLOW_GUSTS(spectrum=wind.spectrum, period=period, share=share, target=target)
    height = wind.base_height + float(field.control_point[:, 2].mean())
    roof_length = SHAPES[wind.spectrum].length_at(height)
    if wind.gust_length == "auto" and roof_length > MAX_LENGTH_RATIO * gust.length:
        yield messages.GUST_LENGTH_AT_TEN(
            spectrum=wind.spectrum, length=gust.length, height=height, roof_length=roof_length
        )
    if field.force.any():
        yield from (_strong_gust_warnings if wind.gust_field == "point" else _weak_gust_warnings)(gusts)


def _weak_gust_warnings(gusts: GeneratedGusts) -> Iterator[str]:
    """Yield a warning if surface means are too weak at single nodes that load an element."""
    share = gusts.field.deviation / gusts.gust.deviation
    could_be_more = len(gusts.field.control_point) == gusts.wind.control_points
    if share.mean() < MIN_DEVIATION_SHARE and could_be_more:
        yield messages.WEAK_GUSTS(mean=share.mean(), least=share.min())


def _strong_gust_warnings(gusts: GeneratedGusts) -> Iterator[str]:
    """Yield a warning if gusts at points load the roof as a whole too strongly."""
    wind, field, gust = gusts.wind, gusts.field, gusts.gust
    n = frequency_nodes(gust, wind.time_step)[::FREQUENCY_STRIDE]
    shown_frequency = int(np.argmin(np.abs(n - TYPICAL_ROOF_FREQUENCY)))
    variance = cosine_weights(n, np.zeros(1), wind.time_step)[0] * gust.spectrum(n)
    weights = np.array([variance, np.arange(len(n)) == shown_frequency])
    roof = gusts.model.roof
    exposed = exposed_areas(roof, drag_areas(roof, wind, gusts.job.load))
    patches = exposed_patches(roof, gusts.model.x, wind, gusts.job.load)
    whole, at_frequency = np.sqrt(load_power(patches, exposed, field, wind, n, weights))
    if whole >= MAX_ROOF_LOAD_RATIO:
        points, frequency = len(field.control_point), n[shown_frequency]
        yield messages.STRONG_GUSTS(points=points, ratio=whole, frequency=frequency, ratio_there=at_frequency)
