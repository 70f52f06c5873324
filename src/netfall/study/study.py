"""`netfall study`: many runs of one job, on workers that stay; nothing that was run is run again.

A run that ends is a line of the journal, NAME.study.journal beside the study file; the study file,
NAME.study.h5, is made from it when all runs are there. The same command goes on after any interruption.
"""

import os
from pathlib import Path

from netfall.ground.progress import Progress
from netfall.ground.room import memory_line
from netfall.ground.sources import TELLING, program_digest
from netfall.net.build import build_net
from netfall.net.defaults import default_warnings
from netfall.study.file import Plan, read_plan
from netfall.study.files import Place, Watch, place_of
from netfall.study.journal import read_journal
from netfall.study.runs import Runs, part_of, write_study
from netfall.study.table import Table, check_digests, digests_of, text_of
from netfall.write.locks import check_place, claim, release

FORMAT = 2  # of journals


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
    plan = read_plan(path)
    job = plan.read(plan.member(0))
    net = build_net(job)  # what is wrong in the net is said here, once
    progress.say(*default_warnings(job, net), *plan.notes)
    place = place_of(path, output, shard)
    if not place.result.exists() or digests_of(place.result) is None:
        check_place(place.result)
    watch = Watch(plan.files)
    digests = {"study": plan.digest(), "job": watch.digest, "program": program_digest(TELLING)}
    claimed = claim(place.result)
    try:
        table = _what_there_is(plan, place, digests, shard, progress)
        if retry:
            table.forget_failed()
        mine = range(len(plan)) if shard is None else part_of(plan, *shard)
        missing = [number for number in mine if not table.there[number]]
        header = {"format": FORMAT, "members": len(plan), **digests}
        workers = workers or _cores(launcher) // plan.ranks or 1
        if missing and not launcher:
            progress.say(memory_line(min(workers, len(missing)), plan.ranks, net.m))
        if missing or not place.result.exists() or place.journal.exists():
            Runs(plan, place, table, header, watch, progress).run(missing, workers, launcher, stop)
        elif text_of(place.result) != plan.text:  # other questions to the same runs
            write_study(plan, place, table, header, workers, progress)
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
    table = Table(len(plan), plan.nets_differ)
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
