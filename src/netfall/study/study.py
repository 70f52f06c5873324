"""`netfall study`: many runs of one job on persistent workers. A finished run is never repeated.

A finished run is a line of the journal, NAME.study.journal, next to the study file. When all runs are
finished, netfall writes the study file, NAME.study.h5, from the journal. After an interruption the same
command continues.
"""

import itertools
import json
import os
import platform
import re
import secrets
import shlex
import sys
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import netfall
from netfall.core.cache import program_digest
from netfall.core.errors import DivergedError, Interrupted
from netfall.core.launch import memory_message
from netfall.core.messages import code_of, count_of, with_sentence
from netfall.core.progress import Progress
from netfall.core.timings import StopFlag
from netfall.geometry.build import build_net
from netfall.geometry.net import Net
from netfall.gpu import NETS_AT_ONCE
from netfall.job.cache import IGNORED_KEYS, NO_CACHE
from netfall.job.job import Job
from netfall.job.read import read_job
from netfall.results.datasets import NO_OUTCOMES
from netfall.results.locks import check_output_path, locked_output, writing
from netfall.study import messages
from netfall.study.answers.fragility import JUDGED_STATES
from netfall.study.answers.info import balance_warnings, left_out_warnings
from netfall.study.answers.read import read_study
from netfall.study.file import OVERRIDES, Plan, Sample, net_unless_weak, read_study_plan
from netfall.study.files import InputFiles, Journal, Place, read_journal, study_files
from netfall.study.pool import WorkerPool, check_worker, worker_command, worker_task
from netfall.study.table import DIGESTS, Table, check_digests, read_digests, text_of

TEMPORARY_NAME = re.compile(r"\.+(\d{6,})-")  # start of the temporary name of a result file
MOST_TRIED = 100  # number of samples of which one must be strong enough for its prestress
NET_TASK = -1  # number of the task that returns the net, instead of a sample's number


class StudyRuns:
    """Execution of the missing runs of a study, and its file."""

    def __init__(
        self,
        plan: Plan,
        place: Place,
        table: Table,
        header: dict[str, Any],
        inputs: InputFiles,
        progress: Progress,
    ):
        """header : of the journal; table : the finished runs"""
        self.plan, self.place, self.table, self.header = plan, place, table, header
        self.inputs, self.progress = inputs, progress
        self.done = self.broke = 0
        self.said_codes = {code_of(line) for line in progress.warnings}  # and those of runs
        self.net_requested = table.net is not None
        self.token = secrets.token_hex(4)  # distinguishes files of this session from files of killed sessions

    def run(self, missing: list[int], workers: int, launcher: str | None, stop: StopFlag) -> None:
        """Execute the runs, and write the study file. Raises Interrupted."""
        self.queue, self.count = SampleQueue(self.plan, missing), len(missing)
        self.journal = Journal(self.place.journal, self.header)
        count, ranks = max(1, min(workers, len(missing))), self.plan.run.ranks
        self.progress.say(
            f"netfall {netfall.__version__}: {self.plan.path.name}, {len(missing)} of {len(self.plan)} runs "
            f"to make, {count} at once on {count_of(ranks, 'rank')} each"
        )
        self.progress.start()
        try:
            self._make_room(set(missing))
            WorkerPool(
                command=worker_command(launcher, ranks, self.plan.run.device),
                count=count,
                time_limit=self.plan.run.time_limit,
                take=self.take,
                done=self.finish,
                died=self.died,
                started=self.started,
                slots=1 if self.plan.run.device == "cpu" else NETS_AT_ONCE,
            ).run(stop)
            self.journal.sync()
        finally:
            self.journal.close()
        self.progress.end()
        if self.done < self.count or self.table.net is None:
            done = int(self.table.there.sum())
            raise Interrupted(messages.INTERRUPTED(done=done, total=len(self.plan)))
        self.write(workers)

    def _make_room(self, missing: set[int]) -> None:
        """Make the folder of result files, and remove unfinished files of these samples from it.

        Unfinished files of other samples may belong to a running shard.
        """
        if self.plan.run.keep_results == "none":
            return
        with writing(self.place.samples):
            self.place.samples.mkdir(exist_ok=True)
            for old in self.place.samples.glob(".*"):
                name = TEMPORARY_NAME.match(old.name)
                if name and int(name[1]) in missing:
                    old.unlink(missing_ok=True)

    def write(self, workers: int) -> None:
        """Write the study file from the finished runs, and remove the journal."""
        plan, result, job = self.plan, self.place.result, read_job(self.plan.job)
        provenance = {f"{name}_digest": self.header[name] for name in DIGESTS} | {
            "study": plan.text,
            "job": job.text,
            "netfall": netfall.__version__,
            "python": platform.python_version(),
            "command": shlex.join(sys.argv),
            "workers": workers,
            "ranks": plan.run.ranks,
            "drawn": np.array([*plan.distributions], str),
            "notes": np.array(plan.notes, str),
        }
        if plan.draws is not None:
            provenance["draws"] = plan.draws
        if plan.loss:
            provenance["removes"] = plan.loss["each"]
        self.table.write(result, plan, plan.title or job.title or job.name, provenance)
        self.place.journal.unlink(missing_ok=True)
        counts = ", ".join(f"{name} {count}" for name, count in self.table.counts.items() if count)
        written = read_study(result)
        warnings = left_out_warnings(written) + balance_warnings(written)
        self.progress.say(f"written: {result} ({counts})", *warnings)

    # --- callbacks of the pool

    def started(self, answer: dict[str, Any]) -> None:
        """Check that a started worker belongs to this study. Raises InputError."""
        check_worker(answer, self.plan.run.ranks, self.header["program"])

    def take(self, last: str | None) -> tuple[Any, ...] | None:
        """Return the next task, None if there are no more.

        The first task returns the form-found net of the first sample.
        """
        if not self.net_requested:
            self.net_requested = True
            return None, NET_TASK, sample_task(self.plan, self.plan.sample(0), net=True)
        next_sample = self.queue.take(last)
        if next_sample is None:
            return None
        key, number = next_sample
        self._note({"try": number})
        result = None if self.plan.run.keep_results == "none" else self._kept(number, self.token)
        return key, number, sample_task(self.plan, self.plan.sample(number), result)

    def finish(self, number: int, outcomes: dict[str, Any]) -> None:
        """Record a finished run, and print its warnings. Raises InputError if an input file has changed."""
        self.inputs.check()
        self._say(number, outcomes.pop("notes", []))
        if number == NET_TASK:
            self._note({"net": outcomes["net"]})
            return
        self._keep(number, outcomes)  # before the record, because a recorded run is not repeated
        self._note({"done": number, **outcomes})
        self.done += 1
        self.broke += outcomes["broken"] > 0
        counts = self.table.counts.items()
        ended = "".join(f", {name} {count}" for name, count in counts if count and name != "finished")
        share, done = self.done / self.count, f"{self.done} of {self.count}"
        self.progress.at(share, done, self.done, "runs", f"with fractures {self.broke}{ended}")

    def _say(self, number: int, lines: list[str]) -> None:
        """Print the warnings and notes of the net, or the first message with each code of a run."""
        new_lines = [line for line in lines if line not in self.progress.warnings]
        if number != NET_TASK:
            first = {code_of(line): line for line in reversed(lines) if code_of(line) not in self.said_codes}
            sentence = f"Run {number} is the first with this message; later ones are not listed"
            new_lines = [with_sentence(line, sentence) for line in reversed(first.values())]
        self.said_codes.update(map(code_of, lines))
        self.progress.say(*new_lines)

    def died(self, number: int, why: str, again: bool) -> None:
        """Record a run that ended its worker or took too long."""
        if not again:
            failed = NO_OUTCOMES | {"state": "failed", "reason": why}
            self.finish(number, {"net": {}} if number == NET_TASK else failed)
        else:
            task = "the net" if number == NET_TASK else f"run {number}"
            self.progress.say(messages.RUN_AGAIN(task=task, reason=why))
            if number != NET_TASK:
                self._note({"try": number})

    def _note(self, record: dict[str, Any]) -> None:
        self.journal.add(record)
        self.table.add(record)

    # --- files

    def _kept(self, number: int, token: str = "") -> Path:
        return self.place.samples / (f".{number:06d}-{token}.vtkhdf" if token else f"{number:06d}.vtkhdf")

    def _keep(self, number: int, outcomes: dict[str, Any]) -> None:
        """Rename a result file to keep, or remove it, and remove an older file with its name."""
        if self.plan.run.keep_results == "none":
            return
        temporary, final = self._kept(number, self.token), self._kept(number)
        with writing(temporary):
            if temporary.exists() and (self.plan.run.keep_results == "all" or outcomes["broken"]):
                os.replace(temporary, final)
                return
            for path in (temporary, final):
                path.unlink(missing_ok=True)


def sample_task(plan: Plan, sample: Sample, result: Path | None = None, net: bool = False) -> dict[str, Any]:
    """Return the task of a worker for a sample; see `worker_task`."""
    without_file = {} if result else {"output.frames": 1}  # each pauses the steps
    common = {} if net else OVERRIDES | without_file  # the net comes with the notes of the job itself
    overrides = [*sample.overrides, *(f"{name}={value}" for name, value in common.items())]
    removes = [sample.remove] if sample.remove else []
    return worker_task(plan.job, overrides, removes, result, net=net, depth=plan.depth)


def part_of(plan: Plan, part: int, parts: int) -> list[int]:
    """Return the numbers of the samples of a shard, 1 to `parts`.

    Samples with the same form and equilibria stay together.
    """
    order = [*itertools.chain(*SampleQueue(plan, range(len(plan))).groups.values())]
    return sorted(order[(part - 1) * len(plan) // parts : part * len(plan) // parts])


def shared_key(plan: Plan, number: int) -> str:
    """Return a key that is equal for samples with the same form and equilibria."""
    values = plan.sample(number).values
    return json.dumps([value for name, value in values.items() if name not in IGNORED_KEYS])


class SampleQueue:
    """Samples to run. A worker gets the samples that share most with its last sample."""

    def __init__(self, plan: Plan, numbers: Sequence[int]):
        self.groups: dict[str, deque[int]] = {}
        for number in numbers:
            self.groups.setdefault(shared_key(plan, number), deque()).append(number)
        self.given: set[str] = set()

    def take(self, last: str | None) -> tuple[str, int] | None:
        """Return the next sample and its key; None if there are no more."""
        if not self.groups:
            return None
        unused = (key for key in self.groups if key not in self.given)
        key = last if last in self.groups else next(unused, next(iter(self.groups)))
        self.given.add(key)
        number = self.groups[key].popleft()
        if not self.groups[key]:
            del self.groups[key]
        return key, number


FORMAT = 3  # version of the layout of journals


def study(
    path: Path,
    output: Path | None,
    workers: int | None,
    shard: tuple[int, int] | None,
    launcher: str | None,
    retry: bool,
    progress: Progress,
    stop: StopFlag,
    device: str | None = None,
) -> Path:
    """Run the missing runs of a study, and return the path of its file.

    shard : the I-th of N shards; launcher : starts the ranks of a worker; retry : treat failed runs as
    missing; stop : requests an early end; device : replaces the device of the study file, None: keep it

    Raises InputError, OutputError, Interrupted if `stop` is set, DivergedError if no run has a result.
    """
    plan = read_study_plan(path)
    job, net = _first_net(plan)
    device = _usable_device(device or plan.run.device, plan, job, progress)
    plan = replace(plan, run=plan.run.model_copy(update={"device": device}))
    progress.say(*plan.notes)
    place = study_files(path, output, shard)
    if not place.result.exists() or read_digests(place.result) is None:
        check_output_path(place.result)
    inputs = InputFiles(plan.files)
    digests = {"study": plan.digest(), "job": inputs.digest, "program": program_digest()}
    with locked_output(place.result):
        table = _finished_runs(plan, place, digests, shard, progress)
        if retry:
            table.reset_failed()
        progress.say(*_note_of_missing_files(plan, place, table))
        numbers = range(len(plan)) if shard is None else part_of(plan, *shard)
        missing = [number for number in numbers if not table.there[number]]
        header = {"format": FORMAT, "samples": len(plan), **digests}
        workers = workers or _cores(launcher) // plan.run.ranks or 1
        if missing and not launcher:
            progress.say(memory_message(min(workers, len(missing)), plan.run.ranks, net.m))
        runs = StudyRuns(plan, place, table, header, inputs, progress)
        if missing or not place.result.exists() or place.journal.exists():
            runs.run(missing, workers, launcher, stop)
        elif text_of(place.result) != plan.text:  # other evaluations of the same runs
            runs.write(workers)
        else:
            progress.say(f"{place.result}: whole already, {len(numbers)} runs")
    progress.say_warning_count()
    if numbers and not any(table.counts[state] for state in JUDGED_STATES):
        raise DivergedError(messages.NO_RESULT(path=place.result, total=len(numbers)))
    return place.result


def _first_net(plan: Plan) -> tuple[Job, Net]:
    """Return the job and the net of the first sample that is strong enough for its prestress.

    Reports errors of the net once, before any worker starts. Raises InputError.
    """
    for number in range(min(len(plan), MOST_TRIED)):
        job = plan.read(plan.sample(number))
        net = net_unless_weak(job)
        if net is not None:
            return job, net
    return job, build_net(job)  # raises the error of the last one


def _usable_device(device: str, plan: Plan, job: Job, progress: Progress) -> str:
    """Return "cpu" if the device cannot run the first sample. Raises InputError if it was requested."""
    if device == "cpu" or job.dynamics is None:
        return "cpu"
    # imported here: they load numba and the kernels, which a study on the CPU needs only in its workers
    from netfall.explicit.plan import StepPlan
    from netfall.gpu.plan import plan_maker
    from netfall.model.layout import make_features, make_layout

    layout = make_layout(job, 1, NO_CACHE)
    features = make_features(job, layout.net, layout.slides)
    on_cpu = plan_maker(device, features, plan.run.ranks, progress.say) is StepPlan
    return "cpu" if on_cpu else device


def _cores(launcher: str | None) -> int:
    """Return the number of cores for workers: of this machine, or of the whole allocation with a launcher."""
    local = len(os.sched_getaffinity(0))
    if launcher:
        tasks = os.environ.get("SLURM_NTASKS", "")
        return int(tasks) if tasks.isdigit() else local
    allocated = os.environ.get("SLURM_CPUS_ON_NODE", "")  # without CPU binding the affinity shows all cores
    return min(local, int(allocated)) if allocated.isdigit() else local


def _finished_runs(
    plan: Plan, place: Place, digests: dict[str, Any], shard: tuple[int, int] | None, progress: Progress
) -> Table:
    """Return the finished runs of this study, including its shards if this is the whole study."""
    table = Table(len(plan), plan.nets_differ)
    for files in [place, *(place.parts() if shard is None else [])]:
        before = int(table.there.sum())
        if files is not place:
            with locked_output(files.result):  # raises if another process writes it
                pass
        if files.result.exists():
            check_digests(files.result, read_digests(files.result) or {}, digests)
            table.add_file(files.result)
        if files.journal.exists():
            records, _ = read_journal(files.journal)
            if records:
                check_digests(files.journal, records[0], digests)
            for record in records[1:]:
                table.add(record)
        added = int(table.there.sum()) - before
        if added:
            progress.say(f"{files.result.name}: {added} of {len(plan)} runs are there")
    return table


def _note_of_missing_files(plan: Plan, place: Place, table: Table) -> list[str]:
    """Return a note if finished runs lack the result file that `keep_results` now requests."""
    keep, state, broken = plan.run.keep_results, table.columns["state"], table.columns["broken"]
    if keep == "none":
        return []
    wanted = table.there & (state == "finished") & ((broken > 0) | (keep == "all"))
    names = {path.stem for path in place.samples.glob("*.vtkhdf")}
    count = sum(f"{number:06d}" not in names for number in np.flatnonzero(wanted))
    total = int(table.there.sum())
    return [messages.FILES_NOT_KEPT(path=plan.path, keep=keep, count=count, total=total)] if count else []
