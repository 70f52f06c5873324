"""Reading of a job file: TOML in, a validated `Job` out, or all errors at once."""

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError, raise_errors
from netfall.job.job import Job, apply_overrides
from netfall.job.validate import Validator
from netfall.physics.wind_spectra import make_gust

MOST_ROWS = 2e6  # limit of rows; each takes some 500 bytes on every rank
MAX_WIND_SAMPLES = 1e8  # limit of samples; each takes 8 bytes on every rank
MAX_GUST_SAMPLES = 24_000  # samples; the gust model then takes seconds to fit


def read_job(path: str | Path, overrides: Sequence[str] = (), removes: Sequence[dict[str, Any]] = ()) -> Job:
    """Read a job from a TOML file with `SECTION.KEY=VALUE` overrides and additional entries of [[remove]].

    Raises
    ------
    InputError : one line for each error
    """
    path = Path(path)
    data, text = read_toml(path, "job")
    if "job" in data and {"vary", "sample"} & set(data):
        raise InputError(f"{path}: is a study file; netfall study {path} runs it")
    errors: list[str] = []
    warnings = apply_overrides(data, list(overrides), str(path), errors)
    if removes:
        given_removes = data.get("remove", [])
        data["remove"] = [*given_removes, *removes] if isinstance(given_removes, list) else given_removes
    sections = Validator(str(path), errors).sections(data)
    job = Job(path, text, tuple(overrides), **sections, warnings=tuple(warnings))
    errors = errors or [*_absurd_counts(job), *_slow_gusts(job)]
    raise_errors(errors)
    return job


def read_toml(path: Path, kind: str) -> tuple[dict[str, Any], str]:
    """Read the tables of a TOML file, and its text. kind : of file, for messages. Raises InputError."""
    try:
        text = path.read_bytes().decode("utf-8-sig")  # drops a byte-order mark
        return tomllib.loads(text), text
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; give the path of a {kind} file") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not a text file (byte {error.start} is not UTF-8); expected a TOML {kind} file"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None


def _absurd_counts(job: Job) -> Iterator[str]:
    """Yield errors for numbers of rows and samples that exceed the memory of any machine."""
    wind, output = job.wind, job.output
    if job.dynamics is None:
        return
    duration = job.dynamics.duration
    counts = [("output", "history_interval", duration / output.history_interval, "rows", MOST_ROWS)]
    if output.checkpoint_interval:
        number = duration / output.checkpoint_interval
        counts.append(("output", "checkpoint_interval", number, "checkpoints", MOST_ROWS))
    if wind and wind.speed and not wind.pressures:
        speeds = duration / wind.time_step * wind.control_points
        counts.append(("wind", "time_step", speeds, "wind speeds", MAX_WIND_SAMPLES))
    for section, key, number, noun, limit in counts:
        if number > limit:
            yield (
                f"{job.path}: [{section}] {key} = {getattr(getattr(job, section), key):g}: asks for "
                f"{number:.3g} {noun} over the duration; at most {limit:.0e} are possible"
            )


def _slow_gusts(job: Job) -> Iterator[str]:
    """Yield an error for a wind so slow, or a step so short, that its gust model takes minutes to fit."""
    wind = job.wind
    gust = make_gust(wind) if wind is not None else None
    if wind is None or gust is None or wind.speed is None:
        return
    samples = gust.length / (wind.speed * wind.time_step)
    if samples > MAX_GUST_SAMPLES:
        least = gust.length / MAX_GUST_SAMPLES / wind.speed
        zero_key = "surface_drag" if wind.turbulence_intensity is None else "turbulence_intensity"
        yield (
            f"{job.path}: [wind] speed = {wind.speed:g}: a gust of {gust.length:g} m lasts {samples:.3g} "
            f"samples of time_step = {wind.time_step:g} s; at most {MAX_GUST_SAMPLES} are possible; expected "
            f"[wind] time_step >= {least:.3g}, or {zero_key} = 0 for a wind without gusts"
        )
