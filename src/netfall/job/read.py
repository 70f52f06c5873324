"""Reading of a job file: TOML in, a validated `Job` out, or all errors at once."""

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError, raise_errors
from netfall.job import messages
from netfall.job.csv_table import zone_values
from netfall.job.job import Job, apply_overrides
from netfall.job.keys.entries import Case, Stage, apply_settings, has_table, setting_of
from netfall.job.keys.models import Load
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
    if "job" in data and {"vary", "sample", "sampling"} & set(data):
        raise InputError(messages.STUDY_FILE(path=path))
    errors: list[str] = []
    apply_overrides(data, list(overrides), str(path), errors)
    if removes:
        given_removes = data.get("remove", [])
        data["remove"] = [*given_removes, *removes] if isinstance(given_removes, list) else given_removes
    sections = Validator(str(path), errors).sections(data)
    job = Job(path, text, tuple(overrides), **sections)
    errors = errors or [f"{path}: {line}" for line in (*_absurd_counts(job), *_slow_gusts(job))]
    raise_errors(errors)
    return _with_zone_loads(job)


def _with_zone_loads(job: Job) -> Job:
    """Return the job with rows of zones in its load tables as values of [load.zone.NAME] and of `set`.

    Values of a stage's table that the next table does not give return to those of [load]. Raises InputError.
    """
    errors: list[str] = []
    zone_rows: dict[str, str] = {}

    def rows_of(section: Load | Case | Stage, given: dict[str, Any], place: str) -> dict[str, Any]:
        """Return the values that the table of a section gives; given : values that stand in the job."""
        if not has_table(section):
            return {}
        try:
            values = zone_values(job.path.parent / str(section.load_table), zone_rows)
        except InputError as error:
            errors.extend(error.lines)
            return {}
        for key in values.keys() & given:
            errors.append(f"{job.path}: {place} {messages.EXCLUSIVE(keys=f'{key} and load_table')}")
        return values

    load = job.load or Load()
    own = {f"load.zone.{name}.{key}": 0 for name, zone in load.zone.items() for key in zone.given()}
    if values := rows_of(load, own, "[load]"):
        load = apply_settings(load, "load", values)
    cases, stages = [], []
    for case in job.cases:
        values = rows_of(case, case.set, f"[[case]] {case.name}: set:")
        cases.append(case.replaced(set=values | case.set) if values else case)
    earlier: dict[str, Any] = {}
    for stage in job.stages:
        values = rows_of(stage, stage.set, f"[[stage]] {stage.name}: set:")
        if stage.load_table is not None:
            values, earlier = {key: setting_of(load, key) for key in earlier} | values, values
        stages.append(stage.replaced(set=values | stage.set) if values else stage)
    raise_errors(dict.fromkeys(errors))
    given_load = load if job.load else None
    return replace(job, load=given_load, cases=cases, stages=stages, zone_rows=tuple(zone_rows.items()))


def read_toml(path: Path, kind: str) -> tuple[dict[str, Any], str]:
    """Read the tables of a TOML file, and its text. kind : of file, for messages. Raises InputError."""
    try:
        text = path.read_bytes().decode("utf-8-sig")  # drops a byte-order mark
        return tomllib.loads(text), text
    except OSError as error:
        reason = error.strerror or error
        raise InputError(messages.UNREADABLE_JOB(path=path, reason=reason, kind=kind)) from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(messages.NOT_TEXT(path=path, line=line, kind=kind)) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(messages.INVALID_TOML(path=path, reason=" ".join(str(error).split()))) from None
    except RecursionError:
        raise InputError(messages.INVALID_TOML(path=path, reason="nested too deeply")) from None


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
            value = getattr(getattr(job, section), key)
            yield messages.TOO_MANY_ROWS(
                section=section, key=key, value=value, number=number, rows=noun, limit=limit
            )


def _slow_gusts(job: Job) -> Iterator[str]:
    """Yield an error for a wind so slow, or a step so short, that its gust model takes minutes to fit."""
    wind = job.wind
    if wind is None or wind.speed is None or (gust := make_gust(wind)) is None:
        return
    speed, length, step = wind.speed, gust.length, wind.time_step
    samples, most = length / (speed * step), MAX_GUST_SAMPLES
    if samples > most:
        least = length / most / speed
        key = "surface_drag" if wind.turbulence_intensity is None else "turbulence_intensity"
        yield messages.SLOW_GUSTS(
            speed=speed, length=length, samples=samples, step=step, most=most, least=least, key=key
        )
