"""The study file: which runs of which job, in what order (jobs/studies/README.md)."""

import hashlib
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.asks import has_statics
from netfall.job.job import PATHS, Job
from netfall.job.read import read_job, read_toml
from netfall.job.toml_text import toml_value
from netfall.job.validate import Validation
from netfall.job.values import nearest, shown
from netfall.net.build import build_net
from netfall.results.outcomes import BY_NAME
from netfall.study import sections
from netfall.study.answers.hazard import Hazard
from netfall.study.answers.measures import Failure
from netfall.study.answers.samples import SPEED
from netfall.study.draws import draw

# A member leaves no checkpoints, which change nothing in what it finds, and its modes are not asked.
FEW = 10  # pieces that a message names
OWN = {"output.checkpoint": 0.0, "output.modes": 0}


@dataclass(frozen=True)
class Member:
    """One run: its number from 0, what it changes in the job. removed : id or name; remove : [[remove]]"""

    number: int
    values: dict
    removed: str
    remove: dict | None

    @property
    def overrides(self) -> list[str]:
        """As of --set."""
        return [f"{name}={toml_value(value)}" for name, value in self.values.items()]


@dataclass(frozen=True)
class Plan:
    """A study, checked. Members come in the order of the axes as they are written, draws innermost.

    draws : (count, k) of the keys `sampled`, None without [sample]; whole : those with whole numbers
    loss : what each loss has in common; exposure : [s], duration of the job's own dynamic stage
    files : that the members read; nets_differ : members have other elements, or other ids of them
    failures, hazard : what is asked of the runs when they are there
    """

    path: Path
    text: str
    title: str
    job: Path
    axes: list[sections.Axis]
    sampled: list[str]
    whole: set[str]
    draws: np.ndarray | None
    loss: dict | None
    ranks: int
    keep: str
    time_limit: float
    exposure: float
    failures: tuple[Failure, ...]
    hazard: Hazard | None
    files: list[Path]
    notes: list[str]
    nets_differ: bool = False

    def __len__(self) -> int:
        count = 1 if self.draws is None else len(self.draws)
        return count * math.prod(len(axis.values) for axis in self.axes)

    def member(self, number: int) -> Member:
        """One run, by its number."""
        rest, row = divmod(number, 1 if self.draws is None else len(self.draws))
        chosen = {}
        for axis in reversed(self.axes):
            rest, k = divmod(rest, len(axis.values))
            chosen[axis.name] = axis.values[k]
        values = {axis.name: chosen[axis.name] for axis in self.axes if axis.name != sections.LOST}
        if self.draws is not None:
            drawn = zip(self.sampled, self.draws[row].tolist())
            values |= {name: int(value) if name in self.whole else value for name, value in drawn}
        removed = chosen.get(sections.LOST)
        remove = None
        if removed is not None:
            when = {name: value for name, value in self.loss.items() if name in ("time", "duration")}
            remove = {sections.EACH[self.loss["each"]]: [removed], **when}
        return Member(number, values, "" if removed is None else str(removed), remove)

    @property
    def inputs(self) -> list[str]:
        """The keys of the job that vary or are drawn."""
        return [axis.name for axis in self.axes if axis.name != sections.LOST] + self.sampled

    @property
    def depth(self) -> float | None:
        """From which a node has sunk [m], for the outcome `sunk_area`; None: that is not asked for."""
        return next((float(each.by) for each in self.failures if each.by is not None), None)

    def duration(self, member: Member) -> float:
        """Of a member's dynamic stage [s]."""
        return float(member.values.get("dynamics.duration", self.exposure))

    def read(self, member: Member) -> Job:
        """The job of a member. Raises InputError."""
        return read_job(self.job, member.overrides, [member.remove] if member.remove else [])

    def digest(self) -> str:
        """Fingerprint of what is run, however it is run."""
        asked = [[axis.name, axis.values] for axis in self.axes]
        draws = None if self.draws is None else self.draws.tolist()
        parts = [asked, self.sampled, draws, self.loss]
        if self.depth is not None:
            parts.append(self.depth)
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


class Sections(NamedTuple):
    """The sections of a study file, checked; of losses not yet which elements or cables."""

    run: dict
    failures: tuple[Failure, ...]
    hazard: Hazard | None
    axes: list[sections.Axis]
    loss: dict | None
    sample: dict
    distributions: dict


def read_plan(path: Path) -> Plan:
    """The plan of a study file, with every value of every key tried in the job.

    Raises InputError with a line for each thing that is wrong.
    """
    data, text = read_toml(path, "study")
    if "net" in data and "job" not in data:
        raise InputError(f"{path}: is a job file; netfall run {path} runs it; a study file names it in job")
    there, job = _sections_of(path, data), path.parent / str(data["job"])
    axes, loss = there.axes, there.loss
    count = math.prod(len(axis.values) for axis in axes if axis.name != sections.LOST) * there.sample.get(
        "count", 1
    )
    if count > sections.MOST:
        raise InputError(f"{path}: asks for {count} runs; at most {sections.MOST} are possible")
    if loss:
        first = [f"{axis.name}={toml_value(axis.values[0])}" for axis in axes if axis.name != sections.LOST]
        pieces = _pieces_of(read_job(job, first), loss["each"], loss.get("group"), loss.get("ids"))
        axes = [sections.Axis(sections.LOST, pieces) if axis.name == sections.LOST else axis for axis in axes]
    draws, notes = _draws(there)
    own = read_job(job)
    plan = Plan(
        path,
        text,
        data.get("title", ""),
        job,
        axes,
        list(there.distributions),
        {name for name, each in there.distributions.items() if each["distribution"] == "integer"},
        draws,
        loss,
        **there.run,
        exposure=own.dynamics.duration if own.dynamics else math.nan,
        failures=there.failures,
        hazard=there.hazard,
        files=[job, *own.files()],
        notes=notes,
    )
    files, nets = _try(plan)
    return replace(plan, files=files, nets_differ=nets > 1)


def _sections_of(path: Path, data: dict) -> Sections:
    """What stands in a study file. Raises InputError with a line for each thing that is wrong."""
    check = Validation(str(path), [])
    for name in data:
        if name == "rare":
            check.wrong("", "[rare]: removed in version 0.5; see jobs/studies/rare_openturns.py")
        elif name not in sections.TOP:
            check.wrong("", f"{name}: unknown; {nearest(name, sections.TOP)}")
    if not isinstance(data.get("title", ""), str):
        check.wrong("", f"title = {shown(data['title'])}: expected a text")
    if not isinstance(data.get("job"), str):
        expected = "expected the path of a job file, relative to this one"
        check.wrong("", f"job = {shown(data.get('job'))}: {expected}")
    tables = {name: data.get(name, {}) for name in ("vary", "sample", "run", "hazard")}
    for name, table in tables.items():
        if not isinstance(table, dict):
            check.wrong("", f"{name} = {shown(table)}: expected a section, [{name}]")
            tables[name] = {}
    vary, sample = (_flat(tables[name], check) for name in ("vary", "sample"))
    of_draws = {key.name: sample.pop(key.name) for key in sections.KEYS["sample"] if key.name in sample}
    sections.check_distributions(sample, vary, check)
    failures = sections.failure_sections(data.get("failure", []), "remove" in vary, check)
    if of_draws and not sample:
        check.wrong("sample", "names no key of the job to draw")
    varied = {*vary, *sample}
    there = Sections(
        vars(check.table("run", sections.KEYS["run"], tables["run"])),
        failures,
        sections.hazard_section(tables["hazard"], SPEED in varied, check),
        [sections.axis_of(name, value, check) for name, value in vary.items()],
        sections.loss_section(vary["remove"], check) if "remove" in vary else None,
        sections.sample_section(of_draws, bool(sample), check),
        sample,
    )
    if not varied:
        check.wrong("", "nothing varies; expected [vary] or [sample]")
    if check.errors:
        raise InputError(check.errors)
    return there


def _draws(there: Sections) -> tuple[np.ndarray | None, list[str]]:
    """The values that are drawn, and what is to be noted of them."""
    if not there.distributions:
        return None, []
    method, count = there.sample["method"], there.sample["count"]
    notes = []
    if method == "sobol" and count & (count - 1):
        notes.append(f"note: [sample] count = {count}: Sobol's points are even for powers of two only")
    return draw(method, count, there.sample["seed"], list(there.distributions.values())), notes


def _pieces_of(job, each: str, group: str | list[str] | None, ids: list | None) -> list:
    """Ids of elements, or names of cables, that are lost one after another. Raises InputError.

    Not of what a stage of erection takes out before.
    group : of these groups alone; ids : of these alone, in their order
    """
    net = build_net(job)
    active = next((stage.active for stage in reversed(job.stages) if stage.active is not None), None)
    there = {net.group_names[k] for k in net.group if active is None or net.group_names[k] in active}
    groups = there if group is None else {group} if isinstance(group, str) else set(group)
    if groups - there:
        known = ", ".join(sorted(filter(None, there))) or "none"
        when = "" if active is None else " after the last [[stage]]"
        raise InputError(f"{job.path}: no element has the group {min(groups - there)}{when}; groups: {known}")
    rows = [e for e in range(net.m) if net.group_names[net.group[e]] in groups]
    if each == "element":
        pieces = list(dict.fromkeys(int(net.element_id[e]) for e in rows))
    else:
        pieces = list(dict.fromkeys(net.cable_names[net.cable[e]] for e in rows))
    unknown = [name for name in ids or [] if name not in pieces]
    if unknown:
        few = ", ".join(map(str, pieces[:FEW])) + ", ..." * (len(pieces) > FEW)
        raise InputError(f"{job.path}: [vary] remove: ids: no {each} {shown(unknown[0])}; there are {few}")
    return pieces if ids is None else ids


def _net_key(job) -> str:
    """What rows and ids of a net's elements are."""
    net = build_net(job)
    return hashlib.sha256(net.elements.tobytes() + net.element_id.tobytes()).hexdigest()


def _flat(table: dict, check: Validation, prefix: str = "") -> dict:
    """Keys of the job by their whole names, whether written "wind.speed" or wind.speed."""
    found = {}
    for name, value in table.items():
        whole = f"{prefix}{name.strip()}"
        ends = not isinstance(value, dict) or {"from", "distribution"} & set(value)
        ends = ends or whole == "remove" or "." in name
        for called, one in ({whole: value} if ends else _flat(value, check, f"{whole}.")).items():
            if called in found:
                check.wrong("", f"{called}: stands twice")
            found[called] = one
    return found


def _try(plan: Plan) -> tuple[list[Path], int]:
    """Try each value of each key in the job, and the ends of each draw. Raises InputError.

    The files read, and how many nets there are of those that were tried
    """
    if len(plan) > sections.MOST:
        raise InputError(f"{plan.path}: asks for {len(plan)} runs; at most {sections.MOST} are possible")
    files, nets = dict.fromkeys(plan.files), set()
    first, errors, told = plan.member(0).values, [], set()
    tried = [(axis.name, value) for axis in plan.axes if axis.name != sections.LOST for value in _few(axis)]
    for k, name in enumerate(plan.sampled):
        number = int if name in plan.whole else float
        tried += [(name, number(end)) for end in (plan.draws[:, k].min(), plan.draws[:, k].max())]
    for name, value in tried:
        if name in OWN:
            errors.append(
                f"{plan.path}: {name}: members leave no checkpoints and find no modes; remove the key"
            )
            continue
        section, _, key = name.rpartition(".")
        if not (section and key) or isinstance(value, dict):
            errors.append(f"{plan.path}: {name} = {shown(value)}: expected a key of the job, SECTION.KEY")
            continue
        try:
            job = read_job(plan.job, [f"{n}={toml_value(v)}" for n, v in (first | {name: value}).items()])
        except InputError as error:
            new = [line for line in error.lines if line not in told]
            errors += [f"{plan.path}: {name} = {shown(value)}: {line}" for line in new]
            told.update(new)
        else:
            files |= dict.fromkeys(job.files())
            if job.dynamics is None and not has_statics(job):
                errors.append(
                    f"{plan.job}: a study is of the dynamic stage, or of equilibria; expected [dynamics], "
                    "[[case]], [[combination]], or [load] with steps"
                )
            elif job.dynamics is None and plan.loss:
                needs = "takes a dynamic stage; expected [dynamics] in"
                errors.append(f"{plan.path}: [vary] remove {needs} {plan.job}")
            elif name.startswith("net."):
                nets.add(_net_key(job))
    if math.isnan(plan.exposure):
        errors += [
            f"{plan.path}: [[failure]] {each.name}: of = {shown(each.of)}: of a dynamic stage, and nothing "
            f"breaks in equilibria; expected another outcome, or [dynamics] in {plan.job}"
            for each in plan.failures
            if BY_NAME[each.of].of_motion
        ]
    if len(nets) > 1 and plan.loss:
        errors.append(
            f"{plan.path}: [vary] remove: keys of [net] that vary change the elements, each of which "
            "would be lost; make a study of each net"
        )
    if plan.loss and not tried:
        plan.read(plan.member(0))
    if errors:
        raise InputError(list(dict.fromkeys(errors)))
    return list(files), len(nets)


def _few(axis: sections.Axis) -> list:
    """The values that are tried: all of a list, and the ends of a long range; all that name files."""
    whole = len(axis.values) <= 100 or tuple(axis.name.split(".")) in PATHS
    return axis.values if whole else [*axis.values[:50], *axis.values[-50:]]
