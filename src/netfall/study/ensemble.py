"""`netfall study`: many runs of one job, on workers that stay; nothing that was run is run again.

A run that ends is a line of the journal, NAME.study.journal beside the study file; the study file,
NAME.study.h5, is made from it when all runs are there. The same command goes on after any interruption.
"""

import os
import platform
import shlex
import sys
from pathlib import Path

import netfall
from netfall.errors import InputError, Interrupted
from netfall.job.read import read_job
from netfall.net.build import build_net
from netfall.output.place import check_place, claim, release
from netfall.output.progress import Progress
from netfall.sources import program_digest
from netfall.study.fragility import fragility_section
from netfall.study.journal import Journal, read_journal
from netfall.study.launch import default_launcher
from netfall.study.place import Place, place_of
from netfall.study.plan import Member, Plan, read_plan
from netfall.study.pool import run_tasks, worker_command
from netfall.study.queue import Queue
from netfall.study.table import OUTCOMES, Table, check_digests, digests_of

DEATHS = 3  # of workers at one member, after which it is given up


def pieces_of(job, each: str, group: str | list[str] | None) -> list:
    """Ids of elements, or names of cables, that are lost one after another. Raises InputError."""
    net = build_net(job)
    there = {net.group_names[k] for k in net.group}
    groups = there if group is None else {group} if isinstance(group, str) else set(group)
    if groups - there:
        known = ", ".join(sorted(filter(None, there))) or "none"
        raise InputError(f"{job.path}: no element has the group {min(groups - there)}; groups: {known}")
    rows = [e for e in range(net.m) if net.group_names[net.group[e]] in groups]
    if each == "element":
        return list(dict.fromkeys(int(net.element_id[e]) for e in rows))
    return list(dict.fromkeys(net.cable_names[net.cable[e]] for e in rows))


def study(
    path: Path,
    output: Path | None,
    workers: int | None,
    shard: tuple[int, int] | None,
    launcher: str | None,
    retry: bool,
    progress: Progress,
    stop,
) -> Path:
    """Run what is missing of a study; the path of its file.

    shard : the I-th of N parts; launcher : starts the ranks of a worker; retry : runs that failed count as
    missing; stop : a wish to stop

    Raises InputError, OutputError, Interrupted if asked to stop.
    """
    plan = read_plan(path, pieces_of)
    build_net(plan.read(plan.member(0)))  # what is wrong in the net is said here, once
    for note in plan.notes:
        progress.say(note)
    place = place_of(path, output, shard)
    if place.result.exists() and digests_of(place.result) is None:
        check_place(place.result)
    digests = {"study": plan.digest(), "job": read_job(plan.job).digest(), "program": program_digest()}
    claimed = claim(place.result)
    try:
        table = _what_there_is(plan, place, digests, shard, progress)
        if retry:
            table.there &= table.columns["state"] != "failed"
        mine = range(len(plan)) if shard is None else range(shard[0] - 1, len(plan), shard[1])
        missing = [number for number in mine if not table.there[number]]
        if missing or not place.result.exists():
            runs = Runs(plan, place, table, {"format": 1, "members": len(plan), **digests}, progress, retry)
            runs.run(missing, workers or _cores(launcher) // plan.ranks or 1, launcher, stop)
        else:
            progress.say(f"{place.result}: whole already, {len(mine)} runs")
    finally:
        release(claimed)
    return place.result


def _cores(launcher: str | None) -> int:
    """Cores there are for workers: here, or in the allocation where a launcher reaches all of it."""
    here = len(os.sched_getaffinity(0))
    if launcher:
        tasks = os.environ.get("SLURM_NTASKS", "")
        return int(tasks) if tasks.isdigit() else here
    given = os.environ.get("SLURM_CPUS_ON_NODE", "")  # a Slurm that binds nothing leaves all of them in sight
    return min(here, int(given)) if given.isdigit() else here


def _what_there_is(plan: Plan, place: Place, digests: dict, shard, progress: Progress) -> Table:
    """The runs that were made: of this study, and of its parts if this is the whole."""
    table = Table(len(plan))
    for each in [place, *(place.parts() if shard is None else [])]:
        known = int(table.there.sum())
        if each is not place:
            release(claim(each.result))  # nobody writes it at this moment
        if each.result.exists():
            check_digests(each.result, digests_of(each.result) or {}, digests)
            table.add_file(each.result)
        if each.journal.exists():
            records, _ = read_journal(each.journal)
            if records:
                check_digests(each.journal, records[0], digests)
            for record in records[1:]:
                table.add(record)
        new = int(table.there.sum()) - known
        if new:
            progress.say(f"{each.result.name}: {new} of {len(plan)} runs are there")
    return table


class Runs:
    """The runs of a study that are still to be made."""

    def __init__(self, plan: Plan, place: Place, table: Table, header: dict, progress: Progress, retry: bool):
        self.plan, self.place, self.table, self.progress = plan, place, table, progress
        self.header = header
        self.deaths: dict[int, int] = {}
        self.count = self.done = self.broke = 0
        if retry and place.journal.exists():
            self._forget_failed()
        self.journal = Journal(place.journal, header)

    def _forget_failed(self) -> None:
        """Write the journal anew, without the runs that failed."""
        records, _ = read_journal(self.place.journal)
        temporary = self.place.journal.with_suffix(".part")
        temporary.unlink(missing_ok=True)
        fresh = Journal(temporary, self.header)
        for record in records[1:]:
            if record.get("state") != "failed":
                fresh.add(record)
        fresh.sync()
        fresh.close()
        os.replace(temporary, self.place.journal)

    def run(self, missing: list[int], workers: int, launcher: str | None, stop) -> None:
        """Make the runs, and the study file. Raises Interrupted."""
        self.queue, self.count, self.net_from = (
            Queue(self.plan, missing),
            len(missing),
            min(missing, default=-1),
        )
        if self.plan.keep != "none":
            self.place.members.mkdir(exist_ok=True)
        command = worker_words(launcher, self.plan.ranks)
        self.progress.say(
            f"netfall {netfall.__version__}: {self.plan.path.name}, {len(missing)} of {len(self.plan)} runs "
            f"to make, {min(workers, max(1, len(missing)))} at once on {self.plan.ranks} "
            f"rank{'s' * (self.plan.ranks > 1)} each"
        )
        self.progress.start()
        try:
            run_tasks(
                command,
                min(workers, len(missing)),
                self.take,
                self.finish,
                self.died,
                self.plan.time_limit,
                stop,
            )
            self.journal.sync()
        finally:
            self.journal.close()
        self.progress.end()
        if self.done < self.count:
            there = int(self.table.there.sum())
            raise Interrupted(f"interrupted after {there} of {len(self.plan)} runs; the same command goes on")
        self._write(workers)

    def take(self, last: str | None) -> tuple | None:
        """As `pool.run_tasks` has it."""
        found = self.queue.take(last)
        if found is None:
            return None
        key, number = found
        member = self.plan.member(number)
        self._note({"try": number})
        result = None if self.plan.keep == "none" else str(self._kept(number))
        return key, number, task_of(self.plan, member, result, number == self.net_from and not self.table.net)

    def _kept(self, number: int) -> Path:
        return self.place.members / f"{number:06d}.vtkhdf"

    def _note(self, record: dict) -> None:
        self.journal.add(record)
        self.table.add(record)

    def finish(self, number: int, told: dict) -> None:
        """A run has ended."""
        self._note({"done": number, **told})
        self.done += 1
        self.broke += told["broken"] > 0
        if self.plan.keep == "broken" and told["state"] == "finished" and not told["broken"]:
            self._kept(number).unlink(missing_ok=True)
        others = self.table.counts()
        ended = ", ".join(f"{name} {count}" for name, count in others.items() if name != "finished")
        self.progress.at(
            self.done / self.count,
            f"{self.done} of {self.count}",
            self.done,
            "runs",
            f"with fractures {self.broke}{', ' if ended else ''}{ended}",
        )

    def died(self, number: int, why: str, again: bool) -> None:
        """A run ended its worker, or took too long."""
        self.deaths[number] = self.deaths.get(number, 0) + 1
        if again and self.deaths[number] < DEATHS:
            self.queue.back(number)
            return
        times = f", {self.deaths[number]} times" if again else ""
        empty = {name: value for name, (_, value) in OUTCOMES.items()}
        told = {"state": "failed", "reason": why + times, "times": [], "elements": [], "net": {}}
        self.finish(number, empty | told)

    def _write(self, workers: int) -> None:
        """The study file, and the end of the journal."""
        job = read_job(self.plan.job)
        provenance = {f"{name}_digest": self.header[name] for name in ("study", "job", "program")} | {
            "study": self.plan.text,
            "job": job.text,
            "netfall": netfall.__version__,
            "python": platform.python_version(),
            "command": shlex.join(sys.argv),
            "workers": workers,
            "ranks": self.plan.ranks,
        }
        if self.plan.draws is not None:
            provenance["draws"] = self.plan.draws
        title = job.title or job.name
        self.table.write(self.place.result, self.plan, title, provenance, fragility_section)
        self.place.journal.unlink()
        ended = ", ".join(f"{name} {count}" for name, count in self.table.counts().items())
        self.progress.say(f"written: {self.place.result} ({ended})")


def task_of(plan: Plan, member: Member, result: str | None = None, net: bool = False) -> dict:
    """What a worker is told of a member. result : path of a file to keep; net : whether to tell the net"""
    removes = [member.remove] if member.remove else []
    rest = {"result": result, "net": net}
    return {"job": str(plan.job), "overrides": member.overrides, "removes": removes, **rest}


def worker_words(launcher: str | None, ranks: int) -> list[str]:
    """The command that starts a worker."""
    if launcher is None and ranks == 1:
        return worker_command([])
    usual = default_launcher().replace("-n {ranks}", "--bind-to none -n {ranks}")  # workers share the cores
    return worker_command(shlex.split((launcher or usual).format(ranks=ranks)))
