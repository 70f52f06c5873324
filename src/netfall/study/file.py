"""The study file: the job, its runs and their order (docs/pages/reference/study-file.md)."""

import hashlib
import json
import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.core.messages import code_of
from netfall.geometry.build import TOO_WEAK, build_net
from netfall.geometry.net import Net
from netfall.job.derived import has_statics, moves_supports
from netfall.job.job import PATH_KEYS, Job
from netfall.job.keys.entries import flatten_settings, has_static_wind
from netfall.job.keys.fields import is_finite_number
from netfall.job.read import read_job, read_toml
from netfall.job.toml_text import toml_value
from netfall.job.validate import Validator
from netfall.job.values import format_list, format_value, suggest
from netfall.physics.wind_spectra import make_gust, turbulence_intensity
from netfall.results.datasets import OUTCOME_BY_NAME
from netfall.study import messages, sections
from netfall.study.answers.hazard import Hazard
from netfall.study.answers.samples import SPEED, is_seed
from netfall.study.sections import DrawSettings, FailureCriterion, RunSettings, draw

MAX_NAMED = 10  # elements or cables that a message names
# Overrides of every sample: no checkpoints and no modes, since they do not affect its outcomes.
OVERRIDES = {"output.checkpoint_interval": 0.0, "modes.count": 0}
# Keys that change only the output or the checks of a report; several samples may have the same value.
WITHOUT_OUTCOME = (
    *("limits.*", "output.frames", "output.probes", "output.elements"),
    *("*.buckling_curve", "*.section_modulus", "*.design_strength"),
)
TURBULENCE = {"wind.turbulence_intensity", "wind.surface_drag"}
SCATTERS = ("strength_cov", "length_std")
FACTOR = "wind.pressure_factor"
KEYS_OF_NET = ("net.", "cable.", "group.")  # first parts of the keys from which a net is built


@dataclass(frozen=True)
class Sample:
    """One sample of a study.

    number : from 0; values : of the keys of the job that it changes
    removed : id of the element or name of the cable; remove : its [[remove]] entry
    """

    number: int
    values: dict[str, Any]
    removed: str
    remove: dict[str, Any] | None

    @property
    def overrides(self) -> list[str]:
        """The values as arguments of --set."""
        return [f"{name}={toml_value(value)}" for name, value in self.values.items()]


@dataclass(frozen=True)
class Sections:
    """The checked sections of a study file. Without a `Plan`, the removed parts are not determined yet.

    loss : settings common to all member removals; distributions : of the random keys
    failures, hazard : evaluations of the finished runs
    """

    run: RunSettings
    failures: tuple[FailureCriterion, ...]
    hazard: Hazard | None
    axes: list[sections.Axis]
    loss: dict[str, Any] | None
    sampling: DrawSettings | None
    distributions: dict[str, Any]


@dataclass(frozen=True)
class Plan(Sections):
    """A checked study. Samples have the order of the axes in the file; random draws are the innermost loop.

    draws : (count, k) of the keys in `distributions`, None without [sampling]
    exposure : [s], duration of the dynamic stage in the job file
    files : that the samples read; nets_differ : samples differ in elements or their ids
    """

    path: Path
    text: str
    title: str
    job: Path
    draws: np.ndarray | None
    exposure: float
    files: list[Path]
    notes: list[str]
    nets_differ: bool = False

    def __len__(self) -> int:
        count = 1 if self.draws is None else len(self.draws)
        return count * math.prod(len(axis.values) for axis in self.axes)

    def sample(self, number: int) -> Sample:
        """Return one sample by its number."""
        quotient, row = divmod(number, 1 if self.draws is None else len(self.draws))
        chosen = {}
        for axis in reversed(self.axes):
            quotient, k = divmod(quotient, len(axis.values))
            chosen[axis.name] = axis.values[k]
        values = {axis.name: chosen[axis.name] for axis in self.axes if axis.name != sections.LOST}
        if self.draws is not None:
            values |= {
                name: self.drawn(name, self.draws[row, k]) for k, name in enumerate(self.distributions)
            }
        removed = chosen.get(sections.LOST)
        remove = None
        if removed is not None and self.loss:
            timing = {name: value for name, value in self.loss.items() if name in ("time", "duration")}
            remove = {sections.PART_KEYS[self.loss["each"]]: [removed], **timing}
        return Sample(number, values, "" if removed is None else str(removed), remove)

    def drawn(self, name: str, value: float) -> float:
        """Return a random value of a key: an integer if its distribution has integers."""
        return int(value) if self.distributions[name]["distribution"] == "integer" else float(value)

    @property
    def inputs(self) -> list[str]:
        """The keys of the job that vary or are drawn."""
        return [axis.name for axis in self.axes if axis.name != sections.LOST] + [*self.distributions]

    @property
    def depth(self) -> float | None:
        """Depth [m] from which a node counts as sunk, for the outcome `sunk_area`; None: not requested."""
        return next((float(failure.depth) for failure in self.failures if failure.depth is not None), None)

    def duration(self, sample: Sample) -> float:
        """Return the duration of a sample's dynamic stage [s]."""
        return float(sample.values.get("dynamics.duration", self.exposure))

    def read(self, sample: Sample) -> Job:
        """Read the job of a sample. Raises InputError."""
        return read_job(self.job, sample.overrides, [sample.remove] if sample.remove else [])

    def digest(self) -> str:
        """Return a digest of the runs, independent of how they are executed."""
        axes = [[axis.name, axis.values] for axis in self.axes]
        draws = None if self.draws is None else self.draws.tolist()
        parts = [axes, [*self.distributions], draws, self.loss]
        if self.depth is not None:
            parts.append(self.depth)
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def read_study_plan(path: Path) -> Plan:
    """Read a study file, and check every value of every key in the job.

    Raises InputError with a line for each error.
    """
    data, text = read_toml(path, "study")
    if "net" in data and "job" not in data:
        raise InputError(messages.IS_A_JOB(path=path))
    content, job = _sections_of(path, data), path.parent / str(data["job"])
    axes, loss = content.axes, content.loss
    if loss:
        first = [f"{axis.name}={toml_value(axis.values[0])}" for axis in axes if axis.name != sections.LOST]
        pieces = _removable_parts(read_job(job, first), loss["each"], loss.get("group"), loss.get("ids"))
        axes = [sections.Axis(sections.LOST, pieces) if axis.name == sections.LOST else axis for axis in axes]
    count = math.prod(len(axis.values) for axis in axes) * (content.sampling.count if content.sampling else 1)
    if count > sections.MAX_SAMPLES:
        raise InputError(messages.TOO_MANY_RUNS(path=path, count=count, most=sections.MAX_SAMPLES))
    job_itself, notes = read_job(job), list[str]()
    if job_itself.dynamics and (job_itself.cases or job_itself.combinations):
        notes.append(messages.CASES_WITHOUT_EFFECT(job=job))
    if job_itself.stages:
        notes.append(messages.STAGES_WITHOUT_EFFECT(job=job))
    plan = Plan(
        **vars(content) | {"axes": axes},
        path=path,
        text=text,
        title=data.get("title", ""),
        job=job,
        draws=_draws(content),
        exposure=job_itself.dynamics.duration if job_itself.dynamics else math.nan,
        files=[job, *job_itself.files()],
        notes=[*notes, *_job_warnings(job_itself, content)],
    )
    files, nets = _try_values(plan)
    return replace(plan, files=files, nets_differ=nets > 1)


def _job_warnings(job: Job, content: Sections) -> Iterator[str]:
    """Yield warnings of settings of the job that contradict a study.

    Displacements include the motion of supports, cases give keys that vary, and a hazard needs gusts.
    """
    for each in content.failures if moves_supports(job) else ():
        if each.outcome in ("displacement_max", sections.SUNK_OUTCOME):
            yield messages.MOVING_SUPPORTS(name=each.name, outcome=each.outcome)
    varied = [*(axis.name for axis in content.axes), *content.distributions]
    cases = tomllib.loads(job.text).get("case", [])  # job.cases have the keys of [wind] too, which vary
    given = {case["name"]: flatten_settings(case.get("set", {})) for case in cases}
    for key in varied if job.dynamics is None else ():
        if names := [name for name, values in given.items() if key in values]:
            yield messages.KEY_OF_CASES(cases=format_list(names), key=key)
    wind = job.wind if job.dynamics and content.hazard else None
    if wind and wind.speed and turbulence_intensity(wind) == 0.0 and not TURBULENCE & {*varied}:
        yield messages.HAZARD_WITHOUT_GUSTS(
            wind="[wind] has no gusts (turbulence intensity 0)", remedy="a turbulence intensity"
        )
    static = [case.name for case in job.cases if has_static_wind(case) and FACTOR not in case.set]
    if static and content.hazard and not job.dynamics and FACTOR not in varied:
        yield messages.HAZARD_WITHOUT_GUSTS(
            wind=f"the static wind of [[case]] {format_list(static)} has no gusts",
            remedy=f"{FACTOR}, the ratio of peak to mean velocity pressure, or 1 for the speed of a gust",
        )


def _sections_of(path: Path, data: dict[str, Any]) -> Sections:
    """Check the sections of a study file. Raises InputError with a line for each error."""
    check = Validator(str(path), [])
    for name in data:
        if name == "rare":
            check.wrong("", messages.RARE_REMOVED())
        elif name not in sections.TOP_KEYS:
            check.wrong("", messages.UNKNOWN_NAME(name=name, advice=suggest(name, sections.TOP_KEYS)))
    if not isinstance(data.get("title", ""), str):
        check.wrong("", messages.NO_TITLE(value=format_value(data["title"])))
    if not isinstance(data.get("job"), str):
        check.wrong("", messages.NO_JOB(value=format_value(data.get("job"))))
    tables = {name: data.get(name, {}) for name in ("vary", "sampling", "run", "hazard")}
    for name, table in tables.items():
        if not isinstance(table, dict):
            check.wrong("", messages.NO_SECTION(name=name, value=format_value(table)))
            tables[name] = {}
    vary, drawn = (_flatten(tables[name], check) for name in ("vary", "sampling"))
    draw_settings = {name: drawn.pop(name) for name in DrawSettings.model_fields if name in drawn}
    vary = sections.in_units_of_keys("vary", vary, check)
    drawn = sections.in_units_of_keys("sampling", drawn, check)
    sections.check_distributions(drawn, vary, check)
    failures = sections.failure_sections(data.get("failure", []), "remove" in vary, check)
    if draw_settings and not drawn:
        check.wrong("sampling", messages.NOTHING_DRAWN())
    varied = {*vary, *drawn}
    content = Sections(
        check.table("run", RunSettings, tables["run"]),
        failures,
        sections.hazard_section(tables["hazard"], SPEED in varied, check),
        [sections.read_axis(name, value, check) for name, value in vary.items()],
        sections.removal_section(vary["remove"], check) if "remove" in vary else None,
        check.table("sampling", DrawSettings, draw_settings) if draw_settings or drawn else None,
        drawn,
    )
    if not varied:
        check.wrong("", messages.NOTHING_VARIES())
    if check.errors:
        raise InputError(check.errors)
    return content


def _draws(content: Sections) -> np.ndarray | None:
    """Return the random values, None without [sampling]."""
    if not content.distributions or (settings := content.sampling) is None:
        return None
    return draw(settings.method, settings.count, settings.seed, list(content.distributions.values()))


def _removable_parts(job: Job, each: str, group: str | list[str] | None, ids: list[Any] | None) -> list[Any]:
    """Return the ids of elements, or names of cables, that the samples remove. Raises InputError.

    Elements that a stage of erection removes are excluded.
    group : only of these groups; ids : only these, in their order
    """
    net = build_net(job)
    active = next((stage.active for stage in reversed(job.stages) if stage.active is not None), None)
    present = {net.group_names[k] for k in net.group if active is None or net.group_names[k] in active}
    groups = present if group is None else {group} if isinstance(group, str) else set(group)
    if groups - present:
        known = ", ".join(sorted(filter(None, present))) or "none"
        moment = "" if active is None else " after the last [[stage]]"
        group = min(groups - present)
        raise InputError(messages.UNKNOWN_GROUP(job=job.path, group=group, moment=moment, known=known))
    part_of = net.element_id.tolist() if each == "element" else [net.cable_names[k] for k in net.cable]
    rows = [e for e in range(net.m) if net.group_names[net.group[e]] in groups]
    pieces: list[Any] = list(dict.fromkeys(part_of[e] for e in rows))
    unknown = [name for name in ids or [] if name not in pieces]
    if unknown:
        known, value = format_list(pieces, MAX_NAMED), format_value(unknown[0])
        raise InputError(messages.UNKNOWN_MEMBER(job=job.path, each=each, value=value, known=known))
    return pieces if ids is None else ids


def _flatten(table: dict[str, Any], check: Validator, prefix: str = "") -> dict[str, Any]:
    """Return keys of the job by their full names, whether written "wind.speed" or wind.speed."""
    values_by_name = {}
    for name, value in table.items():
        full_name = f"{prefix}{name.strip()}"
        is_table = isinstance(value, dict) and not {"from", "distribution"} & set(value)
        is_value = not is_table or full_name == "remove" or "." in name
        for key, key_value in (
            {full_name: value} if is_value else _flatten(value, check, f"{full_name}.")
        ).items():
            if key in values_by_name:
                check.wrong("", messages.KEY_TWICE(key=key))
            values_by_name[key] = key_value
    return values_by_name


def _try_values(plan: Plan) -> tuple[list[Path], int]:
    """Check each value of each key in the job, and the extremes of each draw. Raises InputError.

    Returns the files read, and the number of different nets among the checked samples.
    """
    files, nets, nets_by_key = dict.fromkeys(plan.files), set(), dict[str, dict[Any, bytes]]()
    first, errors, seen = plan.sample(0).values, [], set()
    axes = [axis for axis in plan.axes if axis.name != sections.LOST]
    settings = [(axis.name, value) for axis in axes for value in _values_to_try(axis)]
    draws = np.zeros((1, 0)) if plan.draws is None else plan.draws
    for name, drawn in zip(plan.distributions, draws.T):
        settings += [(name, plan.drawn(name, end)) for end in (drawn.min(), drawn.max())]
    shared = {axis.name for axis in axes if len(axis.values) == 1}
    for name, value in settings:
        is_idle = name not in shared and any(fnmatchcase(name, pattern) for pattern in WITHOUT_OUTCOME)
        if name in OVERRIDES or is_idle:
            errors.append(messages.KEY_OF_RUNS(path=plan.path, name=name))
            continue
        section, _, key = name.rpartition(".")
        if not (section and key) or isinstance(value, dict):
            errors.append(messages.NO_KEY_OF_JOB(path=plan.path, name=name, value=format_value(value)))
            continue
        try:
            job = read_job(plan.job, [f"{n}={toml_value(v)}" for n, v in (first | {name: value}).items()])
            net, digests = None, nets_by_key.setdefault(name, {})
            # two values of a seed show whether anything scatters
            if name.startswith(KEYS_OF_NET) and not (is_seed(name) and len(digests) > 1):
                net = net_unless_weak(job)
                digests[value if is_finite_number(value) else None] = b"" if net is None else _digest_of(net)
        except InputError as error:
            new_lines = [line for line in error.lines if line not in seen]
            errors += [f"{plan.path}: {name} = {format_value(value)}: {line}" for line in new_lines]
            seen.update(new_lines)
        else:
            files |= dict.fromkeys(job.files())
            has_gusts = job.wind is None or make_gust(job.wind) or TURBULENCE & {*plan.inputs} - shared
            if name == "wind.seed" and name not in shared and not has_gusts:
                errors.append(messages.KEY_OF_RUNS(path=plan.path, name=name))
            if job.dynamics is None and not has_statics(job):
                errors.append(messages.NOTHING_TO_RUN(job=plan.job))
            elif job.dynamics is None and plan.loss:
                errors.append(messages.REMOVAL_WITHOUT_DYNAMICS(path=plan.path, job=plan.job))
            elif net is not None:
                nets.add(hashlib.sha256(net.elements.tobytes() + net.element_id.tobytes()).digest())
    errors += [messages.KEY_OF_RUNS(path=plan.path, name=name) for name in _keys_without_effect(nets_by_key)]
    if math.isnan(plan.exposure):
        errors += [
            messages.DYNAMIC_OUTCOME(
                path=plan.path, name=each.name, value=format_value(each.outcome), job=plan.job
            )
            for each in plan.failures
            if OUTCOME_BY_NAME[each.outcome].needs_dynamics
        ]
    if len(nets) > 1 and plan.loss:
        errors.append(messages.REMOVAL_OF_CHANGING_NETS(path=plan.path))
    if plan.loss and not settings:
        plan.read(plan.sample(0))
    if errors:
        raise InputError(list(dict.fromkeys(errors)))
    return list(files), len(nets)


def _keys_without_effect(nets_by_key: dict[str, dict[Any, bytes]]) -> list[str]:
    """Return the keys of elements that do not change the net, such as seeds without a scatter.

    nets_by_key : digest of the net for each value of each key, other keys at their first values; b"": no
        net. Value None: no number. Such a first value may hide the effects of other keys, so none is returned
    """
    if any(None in nets for name, nets in nets_by_key.items() if name.startswith(KEYS_OF_NET)):
        return []
    scatters = any(name.endswith(SCATTERS) and len(nets) > 1 for name, nets in nets_by_key.items())
    return [
        name
        for name, nets in nets_by_key.items()
        if len(nets) > 1 and len({*nets.values()}) == 1 and not name.startswith("net.")
        if b"" not in nets.values() and not (is_seed(name) and scatters)
    ]


def _digest_of(net: Net) -> bytes:
    """Return a digest of all columns of a net."""
    columns = [column for column in vars(net).values() if isinstance(column, np.ndarray)]
    return hashlib.sha256(b"".join(column.tobytes() for column in columns)).digest()


def net_unless_weak(job: Job) -> Net | None:
    """Build the net; None if it is too weak for its prestress, because such a sample counts as failed.

    Raises InputError.
    """
    try:
        return build_net(job)
    except InputError as error:
        if {code_of(line) for line in error.lines} - TOO_WEAK:
            raise
        return None


def _values_to_try(axis: sections.Axis) -> list[Any]:
    """Return the values to check: all values of a short list or of files, otherwise the ends of the range."""
    is_complete = len(axis.values) <= 100 or tuple(axis.name.split(".")) in PATH_KEYS
    return axis.values if is_complete else [*axis.values[:50], *axis.values[-50:]]
