"""`netfall study`: equal bits for any way to run it, no lost runs, and faults of a study file."""

import contextlib
import gc
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import (
    BARE,
    BIN,
    ENVIRONMENT,
    ROOT,
    STEEL,
    Workshop,
    assert_same_results,
    children_of,
    error_lines,
    run_netfall,
    run_on_standing_ranks,
    wait_for,
)
from mpi4py import MPI
from nets import LOW_SADDLE, WEAK
from study_files import study_lines

from netfall.core import launch
from netfall.core.errors import InputError
from netfall.core.timings import NEVER_STOP
from netfall.driver.reporting import wind
from netfall.driver.sample import detached_area, run_sample
from netfall.geometry.net import Net
from netfall.job.cache import NO_CACHE, ResultCache
from netfall.job.read import read_job
from netfall.physics.state import State
from netfall.post.plots.study.study import plot_study
from netfall.results.datasets import NO_OUTCOMES
from netfall.study.answers.info import _print_energy_check, print_study
from netfall.study.answers.read import read_study
from netfall.study.answers.removals import removal_of_element, removals_of
from netfall.study.file import read_study_plan
from netfall.study.files import InputFiles, Journal, read_journal, study_files
from netfall.study.pool import WorkerPool
from netfall.study.sections import draw, quantiles
from netfall.study.study import StudyRuns
from netfall.study.table import Table

JOB = f"""
{LOW_SADDLE}{WEAK}dead = 200.0
steps = 2
max_iterations = 2000
[wind]
speed = 33.0
turbulence_intensity = 0.3
pressure_coefficient = -1.5
base_height = 10.0
gust_field = "point"
[dynamics]
duration = 1.6
"""
STUDY = """
job = "roof.toml"
[vary]
"wind.speed" = [20.0, 30.0, 180.0]
"wind.seed" = {from = 1, to = 2}
"""


def write(folder: Path, text: str = STUDY, name: str = "storm") -> Path:
    (folder / "roof.toml").write_text(JOB)
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def own_run(folder: Path, *settings: str) -> h5py.File:
    words = [word for setting in settings for word in ("--set", setting)]
    run_on_standing_ranks("run", "roof.toml", "-o", "own.vtkhdf", *words, cwd=folder)
    return h5py.File(folder / "own.vtkhdf")


def same_studies(one: Path, other: Path) -> None:
    """Check that two studies are equal except seconds and provenance."""
    with h5py.File(one, "r+") as a, h5py.File(other, "r+") as b:
        for f in (a, b):
            f["samples"].pop("seconds", None)
        assert assert_same_results(a, b) > 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the study, run without interruption."""
    folder = tmp_path_factory.mktemp("whole")
    run_on_standing_ranks("study", write(folder), cwd=folder)
    assert not (folder / "storm.study.journal").exists()
    return folder / "storm.study.h5"


def test_samples_are_the_runs_of_the_job(whole, tmp_path):
    """Samples are in order and equal single runs. A wind without an equilibrium is also a row."""
    with h5py.File(whole) as f:
        samples = f["samples"]
        state = samples["state"].asstr()[:].tolist()
        assert f["provenance/attempts"][:].tolist() == [1] * 6  # no worker has died
        assert samples["wind.speed"][:].tolist() == [20.0, 20.0, 30.0, 30.0, 180.0, 180.0]
        assert samples["wind.seed"][:].tolist() == [1, 2] * 3
        assert state[:2] == ["finished"] * 2 and state[4:] == ["no_equilibrium"] * 2
        assert samples["first_fracture"][4:].tolist() == [0.0, 0.0] and np.isnan(samples["first_fracture"][0])
        assert "the mean wind" in samples["reason"].asstr()[4] and samples["reason"].asstr()[0] == ""
        broken = samples["broken"][2]
        assert broken > 0 and f["breaks"][:].sum() == samples["broken"][:].sum()
        assert f["first_breaks"][:].sum() == (samples["broken"][:] > 0).sum()
        write(tmp_path)
        with own_run(tmp_path, "wind.speed=30.0", "wind.seed=1") as run:
            in_sample = f["events/sample"][:] == 2
            assert f["events/time"][in_sample].tolist() == run["events/time"][:].tolist()
            assert samples["energy_balance_error"][2] == np.abs(run["history/energy_balance_error"][:]).max()
            assert samples["displacement_max"][2] == run["envelope/displacement_max"][:].max()
            assert samples["tension_max"][2] == run["envelope/tension_max"][:].max()
            assert broken == run["history/broken"][-1]
            assert f["net/particles"].shape == run["net/particles"].shape


@pytest.mark.parametrize(
    "device, collects", [("cpu", "0"), ("auto", "sample.raise_failure = lambda *_: gc.collect()")]
)
def test_a_worker_frees_the_arrays_of_each_run(tmp_path, device, collects):
    """No state is left after two runs; otherwise a long study fills the memory.

    collects : as at the end of a simultaneous run, before the arrays of this one are free
    """
    write(tmp_path)
    task = {"job": "roof.toml", "removes": [], "result": None, "profile": False, "depth": None, "net": False}
    tasks = [task | {"number": k, "overrides": [f"wind.speed={20 + k}"]} for k in range(2)]
    count = "sum(type(each).__name__ == 'State' for each in gc.get_objects())"
    program = (
        "import gc, sys, netfall.gpu; from netfall.driver import sample, worker; netfall.gpu.NETS_AT_ONCE"
    )
    program += f" = 2; sys.argv[1:] = ['{device}']; {collects}; worker.main(); sys.exit({count})"
    line, pipe = [sys.executable, "-c", program], subprocess.PIPE
    with subprocess.Popen(line, cwd=tmp_path, env=ENVIRONMENT, text=True, stdin=pipe, stdout=pipe) as worker:
        print(*map(json.dumps, tasks), sep="\n", file=worker.stdin, flush=True)
        answers = [json.loads(worker.stdout.readline()) for _ in range(3)]
        worker.stdin.close()
    assert [each["state"] for each in answers[1:]] == ["finished"] * 2 and worker.returncode == 0


def test_cached_results_have_the_bits_of_computed_ones(tmp_path):
    """Load steps, cases and the equilibrium of a second run, with reactions."""
    job, memory = tmp_path / "roof.toml", ResultCache(4)
    job.write_text(JOB + '[[case]]\nname = "snow"\nset = {"load.snow" = 100.0}\n')
    paths = tmp_path / "first.vtkhdf", tmp_path / "second.vtkhdf"
    for path in paths:
        run_sample(MPI.COMM_WORLD, lambda: read_job(job), path, memory)
    with h5py.File(paths[0]) as first, h5py.File(paths[1]) as second:
        assert np.abs(second["cases/snow/reaction"][:]).max() > 1e4
        assert assert_same_results(first, second) > 50


def test_samples_with_other_gusts_on_the_same_net_share_its_wind_warnings(tmp_path, monkeypatch):
    """The load on the whole roof is compared with the coherence model only once."""
    count, memory, lines = [], ResultCache(4), [[], []]
    power = wind.load_power
    monkeypatch.setattr(wind, "load_power", lambda *values: count.append(1) or power(*values))
    write(tmp_path)
    for gusts, said in zip((1, 2), lines):
        changes = [f"wind.seed={gusts}", "dynamics.duration=0.01", "wind.control_points=4"]
        read = partial(read_job, tmp_path / "roof.toml", changes)
        run_sample(MPI.COMM_SELF, read, None, memory, say=said.extend)
    assert len(count) == 1 and lines[0] == lines[1] and any("[W" in line for line in lines[0])


def test_a_killed_study_resumes_with_the_same_bits(whole, tmp_path):
    """The driver of two workers, then a worker are killed. The remainder runs on two ranks."""
    study = write(tmp_path)
    command = [BIN / "netfall", "study", study, "--workers", "2"]
    driver = subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.DEVNULL)
    journal = tmp_path / "storm.study.journal"
    wait_for(lambda: journal.exists() and b'"done"' in journal.read_bytes())
    driver.kill()
    driver.wait()
    finished = {record["done"] for record in read_journal(journal)[0] if "done" in record}
    assert 0 < len(finished) < 6
    study.write_text(STUDY + "[run]\nranks = 2\n")
    command[-1] = "1"
    driver = subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.PIPE)
    wait_for(lambda: children_of(driver.pid, b"worker"))
    os.kill(children_of(driver.pid, b"worker")[0], signal.SIGKILL)
    assert driver.wait(120) == 0, driver.stdout.read()
    driver.stdout.close()
    same_studies(whole, tmp_path / "storm.study.h5")
    with h5py.File(tmp_path / "storm.study.h5") as f:
        assert f["provenance/attempts"][:].sum() >= 6


STATIC = JOB.partition("[wind]")[0].replace("steps = 2", "steps = 0") + "stop_at_strength = true\n"
STATIC += '[[case]]\nname = "snow"\nset = {"load.snow" = 100.0}\n'
STATIC += '[[case]]\nname = "uplift"\nset = {"load.pressure" = -600.0}\n'


def test_a_study_of_equilibria_has_the_extremes_of_all_cases(tmp_path):
    """Extremes equal those of the result files. A case without an equilibrium has failed."""
    (tmp_path / "static.toml").write_text(STATIC)
    study, text = tmp_path / "cases.toml", 'job = "static.toml"\n[vary]\n"cable.prestress" = [8e4, 1e5]\n'
    text += '"cable.breaking_load" = [1.9e5, 4.9e5]\n[run]\nkeep_results = "all"\n'
    study.write_text(text + '[[failure]]\nname = "moves"\noutcome = "displacement_max"\nlimit = 0.3\n')
    run_on_standing_ranks("study", study, cwd=tmp_path)
    with h5py.File(tmp_path / "cases.study.h5") as f:
        rows = {key: f[f"samples/{key}"][:] for key in ("tension_max", "displacement_max", "state", "reason")}
        used = f["samples/utilisation_before_break"][:]
        failed = int(f["failures/failed"][0])
    state = [word.decode() for word in rows["state"]]
    assert state == ["no_equilibrium", "finished"] * 2 and b"cases/" in rows["reason"][0]
    for number in (1, 3):
        with h5py.File(tmp_path / f"cases.samples/{number:06d}.vtkhdf") as f:
            groups = [f["cases/snow"], f["cases/uplift"]]
            tension = max(group["tension"][:].max() for group in groups)
            moved = max(np.sqrt((group["displacement"][:] ** 2).sum(1)).max() for group in groups)
        assert rows["tension_max"][number] == tension
        assert rows["displacement_max"][number] == pytest.approx(moved, rel=1e-15)
        assert used[number] == pytest.approx(tension / 4.9e5, rel=1e-12)  # elastic, all of one strength
    assert failed == 2 + (rows["displacement_max"][[1, 3]] > 0.3).sum()
    text = run_on_standing_ranks("info", tmp_path / "cases.study.h5", cwd=tmp_path).stdout
    assert "equilibria without a dynamic stage" in text and "no stable equilibrium: count" in text
    assert "strength: exceeded" not in text and used[1] < 1.0


def test_a_study_of_equilibria_names_exceeded_strengths_and_refuses_counts_of_fractures(tmp_path):
    """Nothing breaks in a study of equilibria, so "0 broken" would mislead."""
    job = STATIC.replace("stop_at_strength = true", "stop_at_strength = false")
    (tmp_path / "static.toml").write_text(job)
    study = tmp_path / "cases.toml"
    study.write_text('job = "static.toml"\n[vary]\n"cable.breaking_load" = [1.5e5, 4.9e6]\n')
    run_on_standing_ranks("study", study, cwd=tmp_path)
    with h5py.File(tmp_path / "cases.study.h5") as f:
        used = f["samples/utilisation_max"][:]
        assert np.isnan(f["samples/detached_area"][:]).all()
    assert used[0] > 1.1 and used[1] < 1.0
    text = run_on_standing_ranks("info", tmp_path / "cases.study.h5", cwd=tmp_path).stdout
    assert f"exceeded in 1 of the 2 samples that finished, by a factor of up to {used[0]:.3g}" in text
    with study.open("a") as file:
        file.write('[[failure]]\nname = "tears"\noutcome = "broken"\nlimit = 0\n')
    error = run_on_standing_ranks("study", study, cwd=tmp_path, code=2).stderr
    assert '[[failure]] tears: outcome = "broken" belongs to a dynamic stage' in error


def test_the_utilisation_of_a_yielding_cable_exceeds_one(workshop):
    """3 kN on two equal cables, one of which yields at 1 kN: the other stretches both to 2 kN over EA."""
    text = "[cable]\nmodulus = 1e11\narea = 1e-4\ndensity = 7850.0\n[load]\nself_weight = false\n"
    nodes = "id,x,y,z,fixed,load_z\n1,0,0,0,1,0\n2,0,0,-10,0,-3e3\n"
    job = workshop.job(text, nodes, "start,end,yield_stress,unstressed_length\n1,2,1e7,10\n1,2,1e9,10\n")
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache())
    assert outcomes["utilisation_max"] == pytest.approx(2.0, rel=1e-6)  # no limit of 1 exceeds 1


def test_extremes_of_a_sample_include_the_permanent_loads(workshop):
    """32 kN on two cables of 100 kN: 105.8 kN each; suction of 6 kN leaves 89.9 kN."""
    text = "[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 7850.0\nbreaking_load = 1e5\n[roof]\n"
    text += "[load]\nself_weight = false\ndead = 3.2e3\n"
    text += "[[case]]\nname = 'suction'\nset = {'load.pressure' = [0.0, 0.0, 600.0]}\n"
    nodes = "id,x,y,z,fixed,area\n1,-10,0,0,1,0\n2,10,0,0,1,0\n3,0,0,-1,0,10\n"
    job = workshop.job(text, nodes, "id,start,end\n1,1,3\n2,3,2\n")
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache())
    for name in ("utilisation_max", "utilisation_before_break"):
        assert outcomes[name] == pytest.approx(1.05807, rel=1e-5)
    text, lines = job.read_text().replace("dead = 3.2e3", "dead = 100.0"), []
    stages = "[[stage]]\nname = '{}'\nset = {{'load.dead' = {}}}\n"
    job.write_text(text + stages.format("heavy", 3.2e3) + stages.format("light", 100.0))
    run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache(), say=lines.extend)
    assert [line for line in lines if "stage heavy: 2 elements (1, 2): strength exceeded" in line]


def test_the_sunk_area_is_that_of_the_worst_case(tmp_path):
    """Snow on either half: areas that sink in different cases do not add up."""
    halves = "".join(
        f'[[zone]]\nname = "{side}"\npolygon = [[{x}, -20], [0, -20], [0, 20], [{x}, 20]]\n'
        f'[[case]]\nname = "{side}"\nset = {{"load.zone.{side}.snow" = 2e3}}\n'
        for side, x in (("west", -20), ("east", 20))
    )
    job, result = tmp_path / "roof.toml", tmp_path / "roof.vtkhdf"
    job.write_text(STATIC.partition("[load]")[0] + "[load]\nself_weight = false\n" + halves)
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), result, ResultCache(), depth=0.85)
    with h5py.File(result) as f:
        area = f["net/tributary_area"][:]
        sunk = [f[f"cases/{side}/displacement"][:, 2] < -0.85 for side in ("west", "east")]
    shares = [area[rows].sum() / area.sum() for rows in sunk]
    assert outcomes["sunk_area"] == max(shares) < area[sunk[0] | sunk[1]].sum() / area.sum()
    assert min(shares) > 0.0


def test_a_study_prints_the_warnings_of_its_job_and_its_runs(tmp_path):
    """Once each: a seed without effect, a base height below ground, a speed that the first run lacks."""
    text = STUDY.replace("30.0, 180.0", "92.0") + '"cable.strength_seed" = [1]\n'
    study = write(tmp_path, text)
    job = tmp_path / "roof.toml"
    job.write_text(job.read_text().replace("base_height = 10.0", "base_height = -5.0").replace("1.6", "0.01"))
    output = run_on_standing_ranks("study", study, cwd=tmp_path).stdout
    assert all(output.count(code) == 1 for code in ("[N249]", "[W436]"))
    assert "warnings (W422, W436, " in output.splitlines()[-1] and "[output]" not in output
    (line,) = [line for line in output.splitlines() if line.endswith("[W422]")]
    assert "wind.speed = 92.0 m/s: implausible for roofs" in line and "is the first with this" in line


def test_a_study_prints_that_bars_exceed_the_euler_load_in_motion(tmp_path):
    """A post with N_cr = 9.87 kN gets 6 kN suddenly, which doubles. Its run and a study of it warn."""
    (tmp_path / "nodes.csv").write_text(
        "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,0,1,1,1,0\n2,0,0,1,1,1,0,-6e3\n"
    )
    (tmp_path / "elements.csv").write_text("start,end\n1,2\n")
    text = '[net]\nnodes = "nodes.csv"\nelements = "elements.csv"\n[cable]\nkind = "bar"\nmodulus = 1e11\n'
    text += "area = 1e-4\ndensity = 7850.0\nsecond_moment = 1e-8\n[dynamics]\nduration = 0.01\n"
    (tmp_path / "post.toml").write_text(text)
    (tmp_path / "study.toml").write_text('job = "post.toml"\n[vary]\n"dynamics.safety" = [0.4]\n')
    for command in ("run", "post.toml"), ("study", "study.toml"):
        output = run_on_standing_ranks(*command, cwd=tmp_path).stdout
        assert "dynamics: element 0: compression above the Euler load" in output


def test_a_study_without_a_finished_run_has_exit_code_3(tmp_path):
    """Its time step is too long. The file is written; a repetition has the same exit code."""
    text = STUDY.replace("20.0, 30.0, 180.0", "20.0").replace("to = 2", "to = 1")
    study = write(tmp_path, text + '"dynamics.time_step" = [0.5]\n')
    for _ in range(2):
        done = run_on_standing_ranks("study", study, cwd=tmp_path, code=3)
        assert "storm.study.h5: none of 1 sample has a result" in done.stderr
    with h5py.File(tmp_path / "storm.study.h5") as f:
        assert f["samples/state"].asstr()[:].tolist() == ["failed"]


def test_nets_may_differ_between_samples(tmp_path):
    """Ids are those of each net, and nothing is counted by element."""
    text = 'job = "roof.toml"\n'
    text += '[vary]\n"net.saddle.cells" = [4, 6]\n"wind.seed" = [1, 2]\n"wind.speed" = [30.0]\n'
    run_on_standing_ranks("study", write(tmp_path, text), cwd=tmp_path)
    path = tmp_path / "storm.study.h5"
    with h5py.File(path) as f:
        assert f["samples/state"].asstr()[:].tolist() == ["finished"] * 4 and "net" not in f
        assert "first_breaks" not in f and f["samples/broken"][0] > 0
        first, ids = f["samples/first_element"][:], f["samples/first_element_id"][:]
    for row, (cells, seed) in enumerate([(4, 1), (4, 2), (6, 1), (6, 2)]):
        with own_run(tmp_path, f"net.saddle.cells={cells}", f"wind.seed={seed}", "wind.speed=30.0") as run:
            element = run["events/element"][:1].tolist()
            assert first[row : row + 1].tolist() == (element or [-1])
            assert ids[row] == (run["net/element_id"][element[0]] if element else -1)
    plot_study(path, tmp_path)
    lines = []
    print_study(path, lines.append)
    assert lines[1].startswith("study: 4 samples of nets that differ"), lines


def test_shards_are_joined_and_missing_runs_executed(whole, tmp_path):
    study = write(tmp_path)
    done = run_on_standing_ranks("study", study, "--shard", "2/3", cwd=tmp_path)
    with h5py.File(tmp_path / "storm.2-of-3.study.h5") as part:
        assert part["samples/sample"][:].tolist() == [2, 3]  # those of one speed, which share a form
    lines: list[str] = []
    print_study(tmp_path / "storm.2-of-3.study.h5", lines.append)
    assert lines[1].startswith("study, part 2 of 3 only: 2 samples of ")
    done = run_on_standing_ranks("study", study, cwd=tmp_path)
    assert "storm.2-of-3.study.h5: 2 of 6 runs are there" in done.stdout, done.stdout
    same_studies(whole, tmp_path / "storm.study.h5")
    again = run_on_standing_ranks("study", study, cwd=tmp_path)
    assert "whole already, 6 runs" in again.stdout
    study.write_text(STUDY + '[run]\nkeep_results = "all"\n')
    again = run_on_standing_ranks("study", study, cwd=tmp_path)
    assert "4 of 6 finished runs have no result file" in again.stdout
    run_on_standing_ranks("study", study, "--shard", "1/7", cwd=tmp_path)  # without a sample, no failure
    study.write_text(STUDY.replace("30.0", "31.0"))
    other = run_on_standing_ranks("study", study, cwd=tmp_path, code=2)
    assert "storm.study.h5: was made before the study file changed" in other.stderr


def test_shards_match_the_literal_name_of_the_study(tmp_path):
    """A name is not a pattern: roof.v2 is not a shard of the study roof."""
    stem = "roof [1] *"
    for name in (f"{stem}.2-of-3.study.h5", f"{stem}.1-of-3.study.journal", f"{stem}.v2.1-of-3.study.h5"):
        (tmp_path / name).touch()
    place = study_files(Path("roof.toml"), tmp_path / f"{stem}.study.h5", None)
    assert [part.part for part in place.parts()] == [".1-of-3", ".2-of-3"]


def test_kept_files_exist_and_those_of_other_shards_remain(tmp_path):
    """A run whose file could not be kept is repeated. Files that another shard writes are left alone."""
    study = write(tmp_path, STUDY.replace("20.0, 30.0, 180.0", "20.0") + '[run]\nkeep_results = "all"\n')
    own = tmp_path / "storm.samples" / "000000.vtkhdf"
    left, other = own.with_name(".000000-0123abcd.vtkhdf"), own.with_name("..000001-0123abcd.vtkhdf.part")
    (own / "in the way").mkdir(parents=True)
    left.touch()
    other.touch()
    part = ("study", study, "--shard", "1/2")
    assert "cannot be written (Is a directory)" in run_on_standing_ranks(*part, cwd=tmp_path, code=1).stderr
    (own / "in the way").rmdir()
    own.rmdir()
    run_on_standing_ranks(*part, cwd=tmp_path)
    assert {path.name for path in own.parent.iterdir()} == {own.name, other.name}
    with h5py.File(own) as file, h5py.File(tmp_path / "storm.1-of-2.study.h5") as f:
        assert file["events/time"].shape == (f["samples/broken"][0],) == (0,)


@pytest.mark.parametrize(  # the last: it diverged
    "keep, broken, wrote, stays",
    [("all", 0, True, "new"), ("broken", 2, True, "new"), ("broken", 0, True, None), ("all", 0, False, None)],
)
def test_files_of_an_earlier_study_are_not_used(tmp_path, keep, broken, wrote, stays):
    new, old = tmp_path / ".new", tmp_path / "000007.vtkhdf"
    old.write_text("old")
    if wrote:
        new.write_text("new")
    name = lambda number, token="": new if token else old
    plan = SimpleNamespace(run=SimpleNamespace(keep_results=keep))
    runs = SimpleNamespace(plan=plan, token="new", _kept=name)
    StudyRuns._keep(runs, 7, {"broken": broken})
    assert not new.exists() and (old.read_text() if old.exists() else None) == stays


def test_a_run_leaves_no_reference_cycles(tmp_path):
    """Several runs in a process would otherwise keep their arrays until Python collects garbage."""
    write(tmp_path)
    gc.collect()
    before = [type(item) for item in gc.get_objects()].count(State)
    gc.disable()
    try:
        read = lambda: read_job(tmp_path / "roof.toml", ["wind.speed=20.0", "dynamics.duration=0.1"])
        assert run_sample(MPI.COMM_SELF, read, tmp_path / "own.vtkhdf", NO_CACHE)["state"] == "finished"
        assert [type(item) for item in gc.get_objects()].count(State) == before
        overloaded = lambda: read_job(tmp_path / "roof.toml", ["load.dead=1e5"])
        assert run_sample(MPI.COMM_SELF, overloaded, None, NO_CACHE)["state"] == "no_equilibrium"
        assert [type(item) for item in gc.get_objects()].count(State) == before
    finally:
        gc.enable()


WEIGHT = "id,x,y,z,fixed,load_z\n1,0,0,0,0,-1000\n2,0,0,10,1,0\n3,0,0,5,1,0\n"  # on two cables


def test_each_cable_is_removed_in_its_own_run(tmp_path):
    """A weight on two cables, one removed suddenly: the other tension doubles, its peak is three halves."""
    text = BARE + "[dynamics]\nduration = 0.4\n[output]\nhistory_interval = 1e-3\n"
    Workshop(tmp_path).job(text, WEIGHT, "id,start,end,prestress\n7,1,2,500\n9,1,3,500\n")
    lost = '[vary]\nremove = {each = "element", time = 0.0}\n[run]\nkeep_results = "all"\n'
    study = write(tmp_path, f'job = "job.toml"\n{lost}', "lost")
    run_on_standing_ranks("study", study, cwd=tmp_path)
    with h5py.File(tmp_path / "lost.samples" / "000000.vtkhdf") as f:  # one cable is slack until it moves
        assert f["removal/tension_after"][0] == pytest.approx([0.0, 1000.0], rel=1e-6)
    with h5py.File(tmp_path / "lost.study.h5") as f:
        assert f["samples/removed"].asstr()[:].tolist() == ["7", "9"]
        # undamped: (peak - before) / (after - before) = 2; the step reaches the peak to its square
        assert f["samples/dynamic_factor_max"][:] == pytest.approx([2.0, 2.0], rel=2e-3)
        assert f["samples/dynamic_factor_element_id"][:].tolist() == [9, 7]
        assert f["samples/tension_ratio_max"][:] == pytest.approx([3.0, 3.0], rel=2e-3)  # W / 2 to 3 W / 2
        assert f["samples/tension_ratio_element_id"][:].tolist() == [9, 7]
    assert (tmp_path / "lost.samples" / "000001.vtkhdf").exists()


@pytest.mark.parametrize("each, rows", [("element", [0, 1]), ("cable", [1, 0])])
def test_a_cable_with_the_id_of_another_element_as_its_name_is_not_that_element(tmp_path, each, rows):
    """Element 7 is cable 9, and element 9 is cable 7."""
    elements = "id,start,end,prestress,cable\n7,1,2,500,9\n9,1,3,500,7\n"
    Workshop(tmp_path).job(BARE + "[dynamics]\nduration = 0.02\n", WEIGHT, elements)
    ids = "[7, 9]" if each == "element" else '["7", "9"]'
    lost = f'[vary]\nremove = {{each = "{each}", time = 0.0, ids = {ids}}}\n'
    run_on_standing_ranks("study", write(tmp_path, f'job = "job.toml"\n{lost}', "lost"), cwd=tmp_path)
    study = read_study(tmp_path / "lost.study.h5")
    assert removal_of_element(study, removals_of(study)).tolist() == rows


@pytest.mark.parametrize(
    "more, lost",
    [
        ("", [7, 9]),
        (', group = "rope"', [7, 9]),
        (', group = "prop"', "no element has the group prop after the last [[stage]]; groups: rope"),
        (", ids = [9, 8]", "ids: no element 8"),
    ],
)
def test_a_study_does_not_remove_elements_absent_after_erection(tmp_path, more, lost):
    """Otherwise their removal would count as a run without failure."""
    nodes = "id,x,y,z,fixed\n1,-4,0,0,1\n2,0,0,0,0\n3,4,0,0,1\n4,0,0,-3,1\n"
    stages = '[[stage]]\nname = "struck"\nactive = ["rope"]\n[[stage]]\nname = "after"\nrelease = [2]\n'
    elements = "id,start,end,group\n7,1,2,rope\n8,2,4,prop\n9,2,3,rope\n"
    Workshop(tmp_path).job(COLUMN.replace("post", "prop") + stages, nodes, elements)
    path = write(tmp_path, f'job = "job.toml"\n[vary]\nremove = {{each = "element", time = 0.0{more}}}\n')
    if isinstance(lost, str):
        with pytest.raises(InputError, match=re.escape(lost)):
            read_study_plan(path)
    else:
        (axis,) = read_study_plan(path).axes
        assert axis.values == lost


COLUMN = """
[cable]
modulus = 2e11
area = 1e-3
density = 7850.0
[group.post]
kind = "bar"
[dynamics]
duration = 0.05
[output]
history_interval = 0.01
"""


def test_run_and_study_agree_on_jobs_without_equilibrium(tmp_path):
    """A loaded post between stays: without those across y it is unstable."""
    stays = [(3, 8, 0, 10), (4, -8, 0, 10), (5, 0, 8, 10), (6, 0, -8, 10)]
    nodes = ["id,x,y,z,fixed,load_z", "1,0,0,0,1,0", "2,0,0,10,0,-50000"]
    nodes = "\n".join([*nodes, *(f"{n},{x},{y},{z},1,0" for n, x, y, z in stays)])
    rows = ["id,start,end,group,cable,prestress", "1,1,2,post,post,-50000"]
    rows += [f"{n},{n},2,stay,{'x' if n < 5 else 'y'},1000" for n, *_ in stays]
    shop, elements = Workshop(tmp_path), "\n".join(rows)
    job = shop.job(COLUMN + '[[remove]]\ncables = ["y"]\ntime = 0.0\n', nodes, elements, "post")
    run = run_on_standing_ranks("run", job, "-o", tmp_path / "post.vtkhdf").stdout
    assert "warning: the net without cable y: unstable equilibrium: compressed bars buckle, node 2" in run
    assert "2 elements (5, 6); the equilibrium of the net is unstable; " in run
    shop.job(COLUMN, nodes, elements)
    lost = '[vary]\nremove = {each = "cable", group = "stay", time = 0.0}\n'
    study = write(tmp_path, f'job = "job.toml"\n{lost}', "posts")
    run_on_standing_ranks("study", study, cwd=tmp_path)
    with h5py.File(tmp_path / "posts.study.h5") as f:
        assert f["samples/state"].asstr()[:].tolist() == ["finished"] * 2
        assert f["samples/equilibrium_after_removal"].asstr()[:].tolist() == ["unstable"] * 2
    output = run_on_standing_ranks("info", tmp_path / "posts.study.h5").stdout
    assert "2 different; further elements break after 0, no equilibrium after 2 (x, y)" in output
    assert ", of which 2 not stable" in output and "one draw of gusts" not in output
    assert re.match(r"\d+ warnings?\b", output.splitlines()[-1])


def test_the_balance_of_a_sample_is_the_worst_of_its_history(tmp_path, capsys):
    """A weight on a spring in steps of a tenth of its period: the error grows to some per cent."""
    period = float(2 * np.pi * np.sqrt(1000.0 * 10.0 / 1.6e7))
    text = f"[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 1.0\n[dynamics]\nduration = {2.0 * period}\n"
    text += f"time_step = {0.1 * period}\n[output]\nhistory_interval = {0.1 * period}\n"
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,1000,-9810\n"
    job = Workshop(tmp_path).job(text, nodes, "id,start,end,unstressed_length\n1,1,2,10\n")
    run_on_standing_ranks("run", job, "-o", tmp_path / "job.vtkhdf")
    with h5py.File(tmp_path / "job.vtkhdf") as f:
        error = np.abs(f["history/energy_balance_error"][:])
    assert error.max() > 0.01 > error[-1]
    outcomes = run_sample(MPI.COMM_WORLD, lambda: read_job(job), None, ResultCache())
    assert outcomes["energy_balance_error"] == error.max()
    for name in ("energy_balance_error", "balance_error_attached"):  # either is enough
        samples = dict.fromkeys(("energy_balance_error", "balance_error_attached"), np.full(2, 1e-4))
        samples |= {name: np.array([1e-4, outcomes["energy_balance_error"]])}
        _print_energy_check(SimpleNamespace(samples=samples), print)
        lines = capsys.readouterr().out
        assert "worst in row 1" in lines and "energy balance of 1 sample is off by more than 0.1%" in lines
    study = write(tmp_path, 'job = "job.toml"\n[vary]\n"cable.area" = [1e-4]\n', "off")
    outcomes = run_on_standing_ranks("study", study, cwd=tmp_path).stdout
    assert "the energy balance of 1 sample is off by more than 0.1%" in outcomes and ", W975; " in outcomes


# --- the journal and the pool


def test_a_truncated_journal_loses_at_most_one_record(tmp_path):
    path, records = tmp_path / "x.journal", [{"done": k, "times": [0.1 * k, float("inf")]} for k in range(3)]
    journal = Journal(path, {"format": 1})
    for record in records:
        journal.add(record)
    journal.close()
    whole = path.read_bytes()
    ends = [k + 1 for k, byte in enumerate(whole) if byte == ord("\n")]
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        intact, _ = read_journal(path)
        assert intact == [{"format": 1}, *records][: sum(end <= cut for end in ends)]
        journal = Journal(path, {"format": 1})
        journal.add({"done": 9})
        journal.close()
        assert read_journal(path)[0] == [*(intact or [{"format": 1}]), {"done": 9}]
    path.write_bytes(whole[:20].replace(b"1", b"2") + whole[20:])
    with pytest.raises(InputError, match="line 1 is damaged"):
        read_journal(path)


FAKE = """
import json, os, sys, time
print("a line of the launcher")
time.sleep(float(sys.argv[1]))
print("{}", flush=True)
for line in sys.stdin:
    task = json.loads(line)
    if task["what"] == "die":
        sys.exit("error: rank 0: no memory")
    time.sleep({"sleep": 60, "nap": 1}.get(task["what"], 0))
    print(json.dumps({"pid": os.getpid(), "number": task["number"]}), flush=True)
"""


def run_pool(requests, workers=1, limit=60.0, start=0.0, slots=1) -> tuple[dict, list]:
    """Return answers of FAKE by number, and the reported deaths. requests : key, number, action"""
    tasks, done, died = [(key, number, {"what": what}) for key, number, what in requests], {}, []
    take, note = lambda _: tasks.pop(0) if tasks else None, lambda *event: died.append(event)
    command = [sys.executable, "-c", FAKE, str(start)]
    WorkerPool(command, workers, limit, take, done.__setitem__, note, slots=slots).run(NEVER_STOP)
    return done, died


def test_workers_that_die_or_take_too_long_are_replaced():
    """Other workers continue. A run whose worker died is repeated; one that takes too long is not."""
    requests = [("a", 0, "go"), ("a", 1, "die"), ("a", 2, "sleep"), ("a", 3, "go"), ("b", 4, "go")]
    done, died = run_pool(requests, 2, 3.0)
    assert sorted(done) == [0, 3, 4]
    assert (2, "took longer than time_limit = 3 s", False) in died
    why = "its worker ended with exit code 1: error: rank 0: no memory"
    deaths = [death for death in died if death[0] == 1]
    assert deaths == [(1, why, True)] * 2 + [(1, f"{why}, 3 times", False)]


def test_simultaneous_tasks_share_their_time_limits():
    """Four tasks of 1 s in one worker, with a limit of 2.5 s for each."""
    done, died = run_pool([("a", number, "nap") for number in range(4)], limit=2.5, slots=4)
    assert sorted(done) == [0, 1, 2, 3] and not died


def test_tasks_of_a_dead_worker_are_repeated_one_by_one():
    """The other tasks do not count as failed with it."""
    done, died = run_pool([("a", 0, "die"), *(("a", number, "go") for number in (1, 2, 3))], slots=4)
    assert sorted(done) == [1, 2, 3] and len({answer["pid"] for answer in done.values()}) <= 3
    again = sorted((number, again) for number, _, again in died)
    assert again == [(0, False), (0, True), (0, True), (1, True), (2, True), (3, True)]


STAND_IN = ["/bin/sh", "-c", "echo {}; while read -r line; do echo $line; done"]


def test_the_limit_of_open_files_is_raised_for_many_workers(monkeypatch):
    """The soft limit of 128 is raised as needed. A hard limit that is too low is an error."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    tasks, done = [("a", number, {}) for number in range(80)], []
    take = lambda _: tasks.pop() if tasks else None
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, before[1]))
    try:
        WorkerPool(STAND_IN, 80, 60.0, take, lambda number, _: done.append(number), None).run(NEVER_STOP)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert sorted(done) == list(range(80))
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1024, 1024))
    with pytest.raises(InputError, match=r"600 workers .* the limit is 1024 .* --workers of at most 320"):
        WorkerPool(STAND_IN, 600, 60.0, take, None, None).run(NEVER_STOP)


def test_too_many_workers_for_the_memory_are_named_before_the_start(monkeypatch):
    monkeypatch.setattr(launch, "memory_left", lambda: 1e9)
    assert launch.memory_message(4, 1, 0) == "memory: at most 1 GB for 4 workers, 1 GB are free"
    assert "note: that is enough for 2; expected --workers 2" in launch.memory_message(3, 2, 0)
    assert "enough for 1" in launch.memory_message(2, 1, 1_000_000)
    monkeypatch.undo()
    assert 1e7 < launch.memory_left() < 1e14


def test_the_time_limit_of_a_run_excludes_the_start_of_its_worker():
    assert list(run_pool([("a", 0, "go")], limit=2.0, start=3.0)[0]) == [0]


def test_a_file_that_changes_while_a_study_runs_ends_it(tmp_path):
    """A change of its content is an error, a newer time stamp is not."""
    table = tmp_path / "nodes.csv"
    table.write_text("one")
    inputs = InputFiles([table])
    os.utime(table, (1, 1))
    inputs.check()
    table.write_text("two")
    with pytest.raises(InputError, match=r"nodes.csv: changed while the study ran"):
        inputs.check()


def test_a_repeated_run_counts_once(whole):
    """A later record replaces a failed one, but no other, also of joined shards next to the whole study."""
    table = Table(2)
    row = NO_OUTCOMES
    for number, state in ((0, "failed"), (1, "finished"), (0, "finished"), (1, "diverged")):
        table.add({"done": number, **row, "state": state})
    assert table.columns["state"].tolist() == ["finished"] * 2 and table.counts["finished"] == 2
    assert table.counts["failed"] == table.counts["diverged"] == 0 and table.there.all()
    table = Table(6)
    table.add({"done": 2, **row, "state": "failed"})
    for _ in range(2):
        table.add_file(whole)
    assert table.there.all() and dict(+table.counts) == {"finished": 4, "no_equilibrium": 2}
    assert "failed" not in table.columns["state"].tolist()


def test_failed_runs_are_repeated_together_with_a_net_that_failed():
    """Without the net of the first sample, the repeated study would not know which elements break."""
    for nets_differ, net in ((False, None), (True, {})):
        table = Table(2, nets_differ)
        table.add({"net": {}})
        table.add({"done": 1, **NO_OUTCOMES, "state": "failed"})
        table.reset_failed()
        assert table.net == net and not table.there.any()


def test_workers_that_do_not_start_end_the_study():
    command, tasks = [sys.executable, "-c", "raise SystemExit('no slots')"], [("a", 0, {})] * 9
    with pytest.raises(InputError, match="does not start: its worker ended with exit code 1: no slots"):
        WorkerPool(command, 1, 60.0, lambda _: tasks.pop(), None, lambda *_: None).run(NEVER_STOP)


def test_the_reason_why_a_worker_ended_is_no_rule_of_dashes():
    """mpirun writes its reason, for example a signal of the system, between two of them."""
    ends = "raise SystemExit('------\\nrank 1 exited on signal 9 (Killed).\\n------')"
    command, tasks = [sys.executable, "-c", ends], [("a", 0, {})] * 9
    with pytest.raises(InputError, match=r"exit code 1: rank 1 exited on signal 9 \(Killed\)"):
        WorkerPool(command, 1, 60.0, lambda _: tasks.pop(), None, lambda *_: None).run(NEVER_STOP)


# --- draws, the roof that is lost


@pytest.mark.parametrize("method", ["sobol", "latin_hypercube", "random"])
def test_draws_have_their_distribution(method):
    count = 1024
    requests = [
        {"distribution": "normal", "mean": 10.0, "deviation": 2.0},
        {"distribution": "lognormal", "mean": 10.0, "deviation": 5.0},
        {"distribution": "uniform", "from": 1.0, "to": 3.0},
        {"distribution": "integer", "from": 1, "to": 4},
    ]
    drawn = draw(method, count, 3, requests)
    assert drawn.shape == (count, 4) and (drawn == draw(method, count, 3, requests)).all()
    deviation = np.array([2.0, 5.0, 2.0 / np.sqrt(12.0), np.sqrt(1.25)])
    assert np.all(np.abs(drawn.mean(0) - [10.0, 10.0, 2.0, 2.5]) < 5.0 * deviation / np.sqrt(count))
    assert drawn.std(0) == pytest.approx(deviation, rel=0.15)
    assert set(drawn[:, 3].tolist()) == {1.0, 2.0, 3.0, 4.0}
    large = {"distribution": "integer", "from": 10**15, "to": 10**15 + 9}
    assert quantiles(large, np.array([0.999])) - 1e15 == 9.0  # 9.99 above the first is rounded to 10
    if method != "random":  # one in each stratum
        assert len(set(((drawn[:, 2] - 1.0) / 2.0 * count).astype(int))) == count


def test_the_detached_area_by_hand():
    """Four particles in a chain between supports: without elements 1 and 2 the one between is detached."""
    fixed, elements = (
        np.repeat([[1], [0], [0], [0], [1]], 3, 1) > 0,
        np.array([[0, 1], [1, 2], [2, 3], [3, 4]]),
    )
    net = Net(np.arange(15.0).reshape(5, 3), fixed, elements, np.zeros(4, int), [""])
    net.density, area = np.ones(4), np.array([1.0, 2.0, 4.0, 2.0, 1.0])
    share = lambda *gone: detached_area(net, area, np.isin(np.arange(4), gone))
    assert share() == share(1) == 0.0
    net.density[2] = 0.0  # a stage of erection took it out
    assert share(1) == share(1, 2) == 0.4 and share(0, 1, 2, 3) == 0.8
    assert np.isnan(detached_area(net, np.zeros(5), np.ones(4, bool)))


# --- wrong input

OF_STUDY = f'job = "{ROOT}/jobs/saddle.toml"\n'
WRONG_VARY = [  # below [vary]
    ("", "nothing varies; expected [vary] or [sampling]"),
    ('"wind.sped" = [3.0]', 'wind.sped = 3.0: JOB: [wind] sped: unknown key; did you mean "speed"?'),
    ('"wind.speed" = [3.0, -1.0]', "wind.speed = -1.0: JOB: [wind] speed = -1.0: expected"),
    ('"wind.speed" = []', "[vary] wind.speed = []: expected a list of values, or {from = 1, to = 50}"),
    ('"wind.speed" = [3, 4, 3]', "[vary] wind.speed = [3, 4, 3]: 3 is listed twice"),
    ('"wind.direction" = [0, 90, 360]', "[vary] wind.direction = [0, 90, 360]: 0.0 is listed twice"),
    ('"wind.speed" = ["3 m/s", 3]', "[vary] wind.speed = [3.0, 3]: 3 is listed twice"),
    ('"wind.seed" = {from = 5, to = 1}', "expected {from = 1, to = 50}, whole numbers, both included"),
    ('"wind.seed" = {from = 1, to = 99999999}', "more than 10000000 values"),
    ('"title" = ["a"]', 'title = "a": expected a key of the job, SECTION.KEY'),
    ('remove = {each = "node", time = 1.0}', 'expected {each = "element", ...}'),
    ('remove = {each = "cable", time = 1.0, group = "ring"}', "no element has the group ring; groups: x, y"),
    ('remove = {each = "cable", time = 1.0, group = []}', "group = []: expected the name of a group"),
    ('remove = {each = "cable"}', "time: missing; expected a number from 0 to 1e+09 s"),
    ('"wind.speed" = [20.0]\nwind.speed = [30.0]', "wind.speed: given twice"),
    ('remove = {each = ["element"], time = 1.0}', 'expected {each = "element", ...}'),
    ('"wind.speed" = [9, 20]\n[hazard]\ndistribution = ["gumbel"]', '["gumbel"]: expected gumbel, weibull'),
    ("removed = [1]", "removed = 1: expected a key of the job, SECTION.KEY"),
    ("remove = {time = 1.0}", 'expected {each = "element", ...}'),
    ('"modes.count" = [2]', "modes.count: no outcome of a sample depends on it"),
    ('"cable.strength_seed" = [1, 2, 3]', "cable.strength_seed: no outcome of a sample depends on it"),
    ('"wind.seed" = [1, 2]\n"wind.surface_drag" = [0]', "wind.seed: no outcome of a sample depends on it"),
    ('"limits.displacement" = [1, 2]', "limits.displacement: no outcome of a sample depends on it"),
    ('"net.saddle.cells" = [4, 6]\nremove = {each = "element", time = 1.0}', "make one study per net"),
    ('"wind.seed" = [1]\n[run]\nkeep_results = "some"', 'keep_results = "some": expected one of "none"'),
    ('"wind.seed" = [1]\n[run]\nrank = 2', '[run] rank: unknown key; did you mean "ranks"?'),
    ('"wind.seed" = [1]\n[varry]', 'varry: unknown; did you mean "vary"?'),
]
STRENGTH = "group.a.design_strength"
WRONG_DRAWS = [  # below [sampling]: a count, a key, its distribution
    ("", "wind.speed", '"normal", mean = 1.0, deviation = 1.0', "[sampling] count: missing; expected an"),
    ("count = 4", "wind.speed", '"beta"', "known distributions: normal, lognormal, uniform, integer"),
    ("count = 4", "wind.speed", '["normal"]', "known distributions: normal, lognormal, uniform, integer"),
    ("count = 4", "wind.speed", '"uniform", from = 2.0, to = 1.0', "expected from < to"),
    ("count = 8", "wind.speed", '"normal", mean = 1.0, deviation = 9.0', "expected a"),
    ("count = 8", "wind.seed", '"integer", from = 1, to = 2.5', "whole numbers"),
    ("count = 4", STRENGTH, '"uniform", from = 1e8, to = 2e8', f"{STRENGTH}: no outcome of a sample"),
    ("count = 100000000000", "wind.speed", '"uniform", from = 1.0, to = 2.0', "at most"),
]
WRONG = [(f"[vary]\n{text}\n", line) for text, line in WRONG_VARY] + [
    (f'[sampling]\n{count}\n"{key}" = {{distribution = {of}}}\n', line)
    for count, key, of, line in WRONG_DRAWS
]


@pytest.mark.parametrize(("text", "line"), WRONG, ids=[line[:40] for _, line in WRONG])
def test_a_wrong_study_file_is_refused_in_one_line(tmp_path, text, line):
    lines = error_lines(read_study_plan, write(tmp_path, OF_STUDY + text))
    message = line.replace("JOB", str(ROOT / "jobs" / "saddle.toml"))
    assert any(message in each and "toml" in each for each in lines), lines


def test_inputs_in_the_table_of_samples_are_values_for_set(tmp_path):
    """Values must be TOML, not Python (True, False), so that a sample can be repeated from its row."""
    plan = read_study_plan(write(tmp_path, OF_STUDY + '[vary]\n"load.self_weight" = [true, false]\n'))
    column = Table(len(plan))._sample_columns(np.arange(2), plan)["load.self_weight"]
    jobs = [read_job(plan.job, [f"load.self_weight={value}"]) for value in column]
    assert [job.load.self_weight for job in jobs] == [True, False]


@pytest.mark.parametrize("where", ["vary", "sampling"])
def test_a_strength_that_each_group_overrides_is_refused(tmp_path, where):
    """Such a strength would change no sample. One that a group lacks may vary."""
    text = STEEL + "breaking_load = 1e6\n[group.a]\nbreaking_load = 1e6\n[load]\nsteps = 1\n"
    job = Workshop(tmp_path).job(text, WEIGHT, "id,start,end,group\n7,1,2,a\n9,1,3,b\n")
    values = {"vary": "[9e5, 1e6]", "sampling": '{distribution = "normal", mean = 9e5, deviation = 1e4}'}
    count = "count = 4\n" * (where == "sampling")
    study = write(tmp_path, f'job = "job.toml"\n[{where}]\n{count}"cable.breaking_load" = {values[where]}\n')
    read_study_plan(study)
    job.write_text(job.read_text() + "[group.b]\nbreaking_load = 1e6\n")
    (line,) = error_lines(read_study_plan, study)
    assert "cable.breaking_load: no outcome of a sample depends on it" in line


@pytest.mark.parametrize(
    ("key", "values", "seed"),
    [
        ("cable.strength_cov", "[0.0, 0.1]", "cable.strength_seed"),
        ("wind.surface_drag", "[0.0, 0.005]", "wind.seed"),
    ],
)
def test_a_seed_whose_scatter_varies_from_0_is_accepted(tmp_path, key, values, seed):
    """At the first value of the scatter the seed has no effect, at the second it has."""
    text = f'{OF_STUDY}[vary]\n"{key}" = {values}\n"{seed}" = [1, 2, 3]\n'
    assert len(read_study_plan(write(tmp_path, text))) == 6


def test_limits_of_displacements_warn_if_supports_move(tmp_path):
    """If supports settle, both outcomes of displacements contain the settlement, the tension does not."""
    (tmp_path / "settle.csv").write_text("time,z\n0,0\n1,-0.5\n")
    study = write(tmp_path, 'job = "roof.toml"\n[vary]\n"wind.seed" = [1]\n')
    for name, more in {"displacement_max": "", "sunk_area": "depth = 0.3\n", "tension_max": ""}.items():
        with study.open("a") as file:
            file.write(f'[[failure]]\nname = "{name[:4]}"\noutcome = "{name}"\nlimit = 0.3\n{more}')
    assert read_study_plan(study).notes == []
    with (tmp_path / "roof.toml").open("a") as file:
        file.write('[[motion]]\ndisplacement = "settle.csv"\n')
    first, second = read_study_plan(study).notes
    assert first.startswith("warning: [[failure]] disp: displacement_max contains the motion of the supports")
    assert second.startswith("warning: [[failure]] sunk: sunk_area contains the motion of the supports")


def test_a_study_of_a_dynamic_stage_warns_of_its_cases(tmp_path):
    """A sample whose case has no equilibrium counts as one without failure. Stages do not count either."""
    study = write(tmp_path, 'job = "roof.toml"\n[vary]\n"wind.seed" = [1]\n')
    with (tmp_path / "roof.toml").open("a") as file:
        file.write('[[case]]\nname = "snow"\nset = {"load.snow" = 9e3}\n')
    (note,) = read_study_plan(study).notes
    assert "[[case]] and [[combination]] have no effect on a study of a dynamic stage" in note
    with (tmp_path / "roof.toml").open("a") as file:
        file.write('[[stage]]\nname = "built"\n')
    assert "outcomes leave out the equilibria of [[stage]]" in read_study_plan(study).notes[1]


def test_keys_that_cases_give_and_a_hazard_without_gusts_warn(tmp_path):
    """A varied load that a case replaces hid its effect; the mean wind alone gave a probability of a year."""
    study = write(tmp_path, 'job = "roof.toml"\n[vary]\n"load.snow" = [1e3, 2e3]\n')
    roof = tmp_path / "roof.toml"
    gusty = roof.read_text()
    head, tail = gusty.split("[wind]")[0], '[[case]]\nname = "snow"\nset = {"load.snow" = 9e3}\n'
    roof.write_text(head + tail)
    (note,) = read_study_plan(study).notes
    assert note.startswith("warning: [[case]] snow: set gives load.snow, which the study varies.")
    run_on_standing_ranks("study", study, cwd=tmp_path)
    assert note in study_lines(study.with_suffix(".study.h5")).splitlines()
    wind = "[wind]\nspeed = 20.0\nbase_height = 10.0\npressure_coefficient = -0.5\n"
    roof.write_text(head + wind + '[[case]]\nname = "west"\nset = {wind.direction = 90.0}\n')
    study.write_text('job = "roof.toml"\n[vary]\n"wind.speed" = [20.0, 30.0]\n')
    assert not read_study_plan(study).notes  # the case has the speed of [wind]
    year = '[hazard]\ndistribution = "gumbel"\nmode = 20.0\nscale = 3.0\n'
    study.write_text('job = "roof.toml"\n[vary]\n"wind.speed" = [20.0, 30.0]\n' + year)
    for gusts in ("turbulence_intensity = 0.0", "turbulence_intensity = 0.2", "surface_drag = 0.0"):
        roof.write_text(gusty.replace("turbulence_intensity = 0.3", gusts))
        notes = read_study_plan(study).notes
        assert ["has no gusts" in note for note in notes] == [True] * gusts.endswith("0.0")
    for factor, count in (("", 1), (", wind.pressure_factor = 2.26", 0)):
        roof.write_text(head + wind + f'[[case]]\nname = "west"\nset = {{wind.direction = 9.0{factor}}}\n')
        notes = read_study_plan(study).notes
        assert ["static wind of [[case]] west has no gusts" in note for note in notes] == [True] * count


def test_another_depth_needs_new_runs_and_another_limit_does_not(tmp_path):
    """A run stores the share of the roof below one depth."""
    sunk = STUDY + '[[failure]]\nname = "sunk"\noutcome = "sunk_area"\nlimit = 0.3\ndepth = 0.5\n'
    digest = read_study_plan(write(tmp_path, sunk)).digest()
    assert read_study_plan(write(tmp_path, sunk.replace("limit = 0.3", "limit = 0.2"))).digest() == digest
    assert read_study_plan(write(tmp_path, sunk.replace("depth = 0.5", "depth = 0.9"))).digest() != digest


def test_a_job_is_not_accepted_as_a_study_nor_the_reverse(tmp_path):
    study = write(tmp_path)
    with pytest.raises(InputError, match=r"a study file, not a job file. Run it with netfall study .*storm"):
        read_job(study)
    with pytest.raises(InputError, match=r"roof.toml: is a job file. Run it with netfall run"):
        read_study_plan(tmp_path / "roof.toml")


def test_the_order_of_the_samples(tmp_path):
    text = OF_STUDY + '[vary]\n"wind.seed" = [3, 1]\nwind.speed = [20.0, 30.0]\n'
    text += '[sampling]\ncount = 2\nmethod = "random"\n'
    text += '"cable.prestress" = {distribution = "uniform", from = 1e5, to = 2e5}\n'
    plan = read_study_plan(write(tmp_path, text))
    order = [plan.sample(k).values for k in range(len(plan))]
    first, second = plan.draws[:, 0].tolist()
    assert [(m["wind.seed"], m["wind.speed"], m["cable.prestress"]) for m in order] == [
        (seed, speed, prestress) for seed in (3, 1) for speed in (20.0, 30.0) for prestress in (first, second)
    ]
    assert json.loads(json.dumps(plan.sample(0).overrides))[0] == "wind.seed=3"


# --- killed again and again


@pytest.mark.long
@pytest.mark.parametrize("victim", ["worker", "driver", "all"])
def test_twenty_kills_change_no_bit(tmp_path, victim):
    """At random moments, some while the journal is written, each followed by the same command."""
    text = STUDY.replace("[20.0, 30.0, 180.0]", "[20.0, 30.0]").replace("to = 2", "to = 30")
    study, chance = write(tmp_path, text), np.random.default_rng(5)
    run_netfall("study", study, "-o", tmp_path / "whole.study.h5", cwd=tmp_path)
    kills, result = 0, tmp_path / "storm.study.h5"
    while not result.exists() or kills < 20:
        if result.exists():  # whole before the last kill: once more
            same_studies(tmp_path / "whole.study.h5", result)
            result.unlink()
        driver = subprocess.Popen([BIN / "netfall", "study", study, "--quiet"], cwd=tmp_path, env=ENVIRONMENT)
        while driver.poll() is None and kills < 20:
            time.sleep(chance.uniform(2.0, 6.0))
            kills += strike(driver, victim)
        assert driver.wait(300) in (0, -signal.SIGKILL)
    same_studies(tmp_path / "whole.study.h5", result)


def strike(driver, victim: str) -> bool:
    """Kill a worker, the driver, or all processes of a study; return whether one existed."""
    workers = children_of(driver.pid, b"worker") if driver.poll() is None else []
    struck = {"worker": workers[:1], "driver": [driver.pid], "all": [driver.pid, *workers]}[victim]
    for pid in struck if workers else []:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return bool(workers)
