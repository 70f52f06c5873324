"""`netfall study`: many runs of one job on persistent workers. A finished run is never repeated.

A finished run is a line of the journal, NAME.study.journal, next to the study file. When all runs are
finished, netfall writes the study file, NAME.study.h5, from the journal. After an interruption the same
command continues.
"""

import os
from pathlib import Path
from typing import Any

from netfall.core.cache import PRESENTATION_PACKAGES, program_digest
from netfall.core.launch import memory_message
from netfall.core.progress import Progress
from netfall.core.timings import StopFlag
from netfall.geometry.build import build_net
from netfall.geometry.defaults import default_warnings
from netfall.results.locks import check_output_path, lock_output, release
from netfall.study.file import Plan, read_study_plan
from netfall.study.files import Place, Watch, study_files
from netfall.study.journal import read_journal
from netfall.study.runs import StudyRuns, part_of, write_study
from netfall.study.table import Table, check_digests, read_digests, text_of

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
) -> Path:
    """Run the missing runs of a study, and return the path of its file.

    shard : the I-th of N shards; launcher : starts the ranks of a worker; retry : treat failed runs as
    missing; stop : requests an early end

    Raises InputError, OutputError, Interrupted if `stop` requests it.
    """
    plan = read_study_plan(path)
    job = plan.read(plan.sample(0))
    net = build_net(job)  # reports errors of the net once, before any worker starts
    progress.say(*job.warnings, *default_warnings(job, net), *plan.notes)
    place = study_files(path, output, shard)
    if not place.result.exists() or read_digests(place.result) is None:
        check_output_path(place.result)
    watch = Watch(plan.files)
    digests = {"study": plan.digest(), "job": watch.digest, "program": program_digest(PRESENTATION_PACKAGES)}
    lock = lock_output(place.result)
    try:
        table = _finished_runs(plan, place, digests, shard, progress)
        if retry:
            table.reset_failed()
        numbers = range(len(plan)) if shard is None else part_of(plan, *shard)
        missing = [number for number in numbers if not table.there[number]]
        header = {"format": FORMAT, "samples": len(plan), **digests}
        workers = workers or _cores(launcher) // plan.ranks or 1
        if missing and not launcher:
            progress.say(memory_message(min(workers, len(missing)), plan.ranks, net.m))
        if missing or not place.result.exists() or place.journal.exists():
            StudyRuns(plan, place, table, header, watch, progress).run(missing, workers, launcher, stop)
        elif text_of(place.result) != plan.text:  # other evaluations of the same runs
            write_study(plan, place, table, header, workers, progress)
        else:
            progress.say(f"{place.result}: whole already, {len(numbers)} runs")
    finally:
        release(lock)
    progress.say_warning_count()
    return place.result


def _cores(launcher: str | None) -> int:
    """Return the number of cores for workers: here, or in the whole allocation with a launcher."""
    local = len(os.sched_getaffinity(0))
    if launcher:
        tasks = os.environ.get("SLURM_NTASKS", "")
        return int(tasks) if tasks.isdigit() else local
    allocated = os.environ.get("SLURM_CPUS_ON_NODE", "")  # without CPU binding the affinity shows all cores
    return min(local, int(allocated)) if allocated.isdigit() else local


def _finished_runs(
    plan: Plan, place: Place, digests: dict[str, Any], shard: tuple[int, int] | None, progress: Progress
) -> Table:
    """Return the finished runs of this study, and of its shards if this is the whole study."""
    table = Table(len(plan), plan.nets_differ)
    for files in [place, *(place.parts() if shard is None else [])]:
        before = int(table.there.sum())
        if files is not place:
            release(lock_output(files.result))  # raises if another process writes it
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
