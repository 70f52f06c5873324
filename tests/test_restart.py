"""An interrupted run that is resumed on another number of ranks gives the same bits."""

import math
import os
import random
import signal
import subprocess
import sys

import h5py
import pytest
from conftest import (
    ENVIRONMENT,
    ROOT,
    StopAfter,
    assert_same_results,
    refused,
    run_on_standing_ranks,
    start_run,
    wait_for,
)
from kill_runs import JOB, changed, repeat_runs_with_kills

from netfall.core.errors import Interrupted

CALM = changed(checkpoint_interval=0)
KILLS = int(os.environ.get("NETFALL_KILLS", "20"))  # of the long story
LONGEST = 6.0  # s after which a killed run would have ended

# Fewer steps and frames where none has to be met in the middle of them: ranks wait for one another in each.
SLOW = changed(checkpoint_interval=0.1, time_step=1e-4, frames=8, history_interval=0.02)


@pytest.fixture(scope="module")
def undisturbed(shared_workshop):
    """Return the run without interruption or checkpoints."""
    return shared_workshop.solve(CALM, name="undisturbed", output="undisturbed.vtkhdf")


@pytest.fixture(scope="module")
def calm_slow(shared_workshop):
    """Return the run of SLOW without interruption or checkpoints."""
    text = changed(SLOW, checkpoint_interval=0)
    return shared_workshop.solve(text, name="calm_slow", output="calm_slow.vtkhdf")


ON_FOUR = [pytest.param(ranks, 4, marks=pytest.mark.long) for ranks in (1, 2)]


@pytest.mark.parametrize("ranks, later", [(1, 3), (3, 2), *ON_FOUR])
def test_restart_on_other_ranks_gives_the_same_bits(workshop, calm_slow, ranks, later):
    """Both stored checkpoints serve, before and after fractures, also if the run had finished."""
    job = workshop.job(SLOW)
    first = workshop.run(job, ranks=ranks)
    assert len(first["events/step"]) > 3
    assert_same_results(calm_slow, first)
    checkpoints = sorted(workshop.folder.glob("*checkpoint*"))
    # steps of 1e-4 s: the last two of 0.1, 0.2, 0.3 s
    assert [int(p.stem.split("-")[-1]) for p in checkpoints] == [2000, 3000]
    first.close()
    for checkpoint, again in zip(checkpoints, (later, 1)):
        assert_same_results(calm_slow, workshop.run(job, "--restart", checkpoint, ranks=again))
    assert not list(workshop.folder.glob(".*"))


def test_removed_elements_stay_removed_after_a_restart(workshop):
    """Without fragments, with mass scaling: the same bits after fractures, on other ranks."""
    job = workshop.job(SLOW.replace("[dynamics]", "[dynamics]\nfragments = false\nmass_scaling = 0.01"))
    whole = workshop.run(job, output="whole.vtkhdf")
    checkpoint = sorted(workshop.folder.glob("whole.checkpoint*"))[-1]
    with h5py.File(checkpoint) as f:
        assert f["elements/broken"][:].sum() > 3
    assert_same_results(whole, workshop.run(job, "--restart", checkpoint, ranks=2, output="again.vtkhdf"))


OTHERS = [pytest.param(*row, marks=pytest.mark.long) for row in ((1, signal.SIGTERM), (2, signal.SIGUSR1))]


@pytest.mark.parametrize("ranks, number", [(1, signal.SIGUSR1), (2, signal.SIGTERM), *OTHERS])
def test_signal_ends_the_run_with_a_checkpoint(workshop, undisturbed, ranks, number):
    job = workshop.job(CALM)
    process = start_run(job, workshop.folder / "result.vtkhdf", ranks)
    if ranks == 1 or number == signal.SIGUSR1:
        process.send_signal(number)  # mpirun forwards SIGUSR1 to the ranks
    else:
        subprocess.run(["pkill", f"-{int(number)}", "-f", f"python.*netfall run {job}"], check=True)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 4, error
    assert "interrupted at t =" in error and "--restart" in error
    assert not (workshop.folder / "result.vtkhdf").exists()
    (checkpoint,) = workshop.folder.glob("*checkpoint*")
    assert_same_results(undisturbed, workshop.run(job, "--restart", checkpoint, ranks=3 - ranks))


def test_signal_while_a_run_starts_ends_it_with_a_checkpoint(workshop):
    """A signal that arrives before MPI and the compiler are loaded."""
    code = """
import os, signal, sys
from netfall import __main__
from netfall.parallel import alone
start = alone.start_mpi
alone.start_mpi = lambda: (os.kill(os.getpid(), signal.SIGUSR1), start())
__main__.main()
"""
    command = [sys.executable, "-c", code, "run", workshop.job(CALM), "-o", workshop.folder / "result.vtkhdf"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 4, done.stderr
    assert len(list(workshop.folder.glob("result.checkpoint*"))) == 1


@pytest.mark.parametrize("job, code", [("--version", 0), ("missing.toml", 2)])
def test_a_stop_signal_after_the_end_does_not_replace_the_exit_code(tmp_path, job, code):
    """Python restores the default action of a signal, which kills, shortly before its process ends."""
    text = "import atexit, os, signal, sys; from netfall.__main__ import main\n"
    text += "atexit.register(lambda: os.kill(os.getpid(), signal.SIGUSR1)); main()"
    words = (job,) if code == 0 else ("check", job)
    done = subprocess.run([sys.executable, "-c", text, *words], cwd=tmp_path, env=ENVIRONMENT)
    assert done.returncode == code


def test_walltime_ends_the_run_with_a_checkpoint(workshop, undisturbed):
    """--walltime stops at a common step. The run is restarted until it is done, as by the Slurm scripts."""
    job = workshop.job(CALM)
    done = workshop.run(job, "--walltime", "00:00:00", ranks=2, code=4)
    assert "interrupted in form finding or erection" in done.stderr
    (checkpoint,) = workshop.folder.glob("*checkpoint*")
    assert_same_results(undisturbed, workshop.run(job, "--restart", checkpoint, "--walltime", "01:00:00"))


@pytest.fixture(scope="module")
def checkpoints(shared_workshop):
    job = shared_workshop.job(SLOW, name="kept")
    shared_workshop.run(job, output="kept.vtkhdf").close()
    return job, *sorted(shared_workshop.folder.glob("kept.checkpoint*"))


DAMAGES = {
    "one byte short": lambda b: b[:-1],
    "half": lambda b: b[: len(b) // 2],
    "empty": lambda b: b"",
    "one bit": lambda b: b[:5000] + bytes([b[5000] ^ 1]) + b[5001:],
    "digest": lambda b: b[:-3] + b"abc",
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("ranks", [1, 2])
def test_damaged_checkpoint_is_refused_and_the_other_offered(checkpoints, ranks, damage):
    job, old, new = checkpoints
    good = new.read_bytes()
    try:
        new.write_bytes(DAMAGES[damage](good))
        line = refused("run", job, "--restart", new, "-o", job.parent / "kept.vtkhdf", ranks=ranks)
        assert "damaged" in line and str(old) in line and "Traceback" not in line
    finally:
        new.write_bytes(good)


@pytest.mark.parametrize("override", ["wind.seed=4", "net.saddle.cells=6"])
def test_checkpoint_of_another_job_is_refused(checkpoints, override):
    job, _, new = checkpoints
    line = ("run", job, "--restart", new, "--set", override, "-o", job.parent / "kept.vtkhdf")
    assert "another job or net" in refused(*line)


def test_checkpoint_of_other_tables_is_refused(workshop):
    text = JOB[JOB.index("[cable]") : JOB.index("[form_finding]")] + "[group.edge]\ndensity = 7900.0\n"
    text += '[wind]\nonset = "sudden"\nfile = "wind.csv"\nbase_height = 10.0\npressure_coefficient = -1.0\n'
    text += "[dynamics]\nduration = 0.1\ntime_step = 1e-6\n"
    elements = "start,end,group\n1,2,cable\n2,3,cable\n3,1,edge\n"
    job = workshop.job(text, "id,x,y,z,fixed\n1,0,0,0,1\n2,1,1,0,0\n3,2,0,0,1\n", elements)
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n1,20\n")
    workshop.run(job, "--walltime", "00:00:00", code=4)
    (checkpoint,) = workshop.folder.glob("*.checkpoint-*")
    for name, old, new in (("wind.csv", "1,20", "1,21"), ("elements.csv", "2,3,cable", "2,3,edge")):
        path = workshop.folder / name
        before = path.read_text()
        path.write_text(before.replace(old, new))
        assert "another job or net" in workshop.run(job, "--restart", checkpoint, code=2).stderr
        path.write_text(before)
    workshop.run(job, "--restart", checkpoint)


def test_missing_checkpoint_is_refused(checkpoints):
    job, _, new = checkpoints
    absent = new.with_name("kept.checkpoint-5-000000000001.h5")
    error = refused("run", job, "--restart", absent, "-o", job.parent / "kept.vtkhdf")
    assert "no such checkpoint" in error and str(new) in error


def test_missing_parts_of_the_result_are_named(checkpoints, tmp_path):
    job, _, new = checkpoints
    (tmp_path / new.name).write_bytes(new.read_bytes())
    assert "is missing" in refused("run", job, "--restart", tmp_path / new.name, "-o", tmp_path / "x.vtkhdf")
    assert {p.name for p in tmp_path.iterdir()} == {new.name}


@pytest.mark.parametrize("kills, ranks", [(2, 2), pytest.param(KILLS, 4, marks=pytest.mark.long)])
def test_kills_change_no_bit(tmp_path, undisturbed, kills, ranks):
    """kill -9 of a rank, of mpirun or of all, at random (kill_runs.py); NETFALL_KILLS: of four ranks."""
    assert repeat_runs_with_kills(tmp_path, undisturbed.filename, kills, random.Random(), LONGEST, ranks) >= 1


def test_a_warning_of_large_strains_includes_those_before_the_restart(workshop):
    """A weight that falls into its cable: a strain of 2 W / EA = 0.2 after half a period, none after a whole.

    m = 1000 kg and half of the cable's 1 kg, k = EA / L0 = 1e4 N/m; the checkpoint is at 0.8 of the period,
    where the strain is 0.1 (1 - cos(1.6 pi)) = 0.07.
    """
    period = 2 * math.pi * math.sqrt(1000.5 / 1e4)
    text = f"[cable]\nmodulus = 1e9\narea = 1e-4\ndensity = 1000.0\n[dynamics]\nduration = {period}\n"
    text += f"time_step = 1e-3\n[output]\nframes = 1\ncheckpoint_interval = {0.8 * period}\n"
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,1000,-1e4\n"
    job = workshop.job(text, nodes, "start,end,unstressed_length\n1,2,10\n")
    path, note = workshop.folder / "result.vtkhdf", f"strain of 0.2 at t = {period / 2:.2f}"
    assert note in run_on_standing_ranks("run", job, "-o", path).stdout
    (checkpoint,) = workshop.folder.glob("*checkpoint*")
    for ranks in (1, 2):
        again = run_on_standing_ranks("run", job, "-o", path, "--restart", checkpoint, ranks=ranks)
        assert note in again.stdout, again.stderr


PAUSED = changed(duration=0.02, checkpoint_interval=0, time_step=1e-4)
PAUSED = PAUSED.replace("[load]", "[load]\npressure = [0.0, 0.0, 300.0]\nsteps = 4\ntolerance = 1e-10")
PAUSED = PAUSED.replace("modulus_factor = 0", "modulus_factor = 0\ntolerance = 1e-10")


@pytest.fixture(scope="module")
def whole(shared_workshop):
    return shared_workshop.solve(PAUSED, name="paused", output="paused.vtkhdf")


@pytest.mark.parametrize("after", [1, 20])
def test_a_pause_in_form_finding_or_statics_changes_no_bit(workshop, whole, after):
    """The run stops after some checks of the residual and resumes on two ranks."""
    words = "in statics.*checkpoint" if after >= 10 else "in form finding.*checkpoint"
    workshop.assert_pause_changes_no_bit(workshop.job(PAUSED), after, words, whole)
    assert not list(workshop.folder.glob(".*"))


@pytest.mark.parametrize("after", [1, 4, 7])
def test_a_pause_in_a_form_that_carries_its_load_changes_no_bit(workshop, after):
    """Form and load are found in turn. The run stops in the first form and in later ones."""
    text = PAUSED.replace("modulus_factor = 0", 'modulus_factor = 0.001\nloads = "permanent"')
    job = workshop.job(text.split("[wind]")[0])
    workshop.assert_pause_changes_no_bit(job, after, "in form finding")


def test_a_resumed_run_that_stops_in_form_finding_names_the_checkpoint_that_it_resumed(workshop):
    """It writes none of its own, since that would begin again."""
    job = workshop.job(PAUSED)
    checkpoint, _ = workshop.pause(job, 20)
    with pytest.raises(Interrupted, match="in form finding or erection") as stopped:
        workshop.run_here(job, restart=checkpoint, stop=StopAfter(0))
    assert f"--restart {checkpoint}" in str(stopped.value)
    assert [*workshop.folder.glob("*checkpoint*")] == [checkpoint]


STAND_IN = """#!/usr/bin/env bash
trap 'exit 4' USR1
sleep 0.3; touch started
for ((k = 0; k < 300; k++)); do sleep 0.1; done
"""


def write_tools(folder, **tools):
    """Write programs to the environment of a folder; return their folder."""
    place = folder / ".venv" / "bin"
    place.mkdir(parents=True)
    for name, text in tools.items():
        (place / name).write_text(text)
        (place / name).chmod(0o755)
    return place


@pytest.mark.parametrize("name", ["stadium", "saddle", "wheel", "olympia"])
@pytest.mark.parametrize(
    "number, restart, again",
    [(signal.SIGUSR1, 0, True), (signal.SIGUSR1, 1, False), (signal.SIGTERM, 0, False)],
)
def test_a_slurm_script_is_resubmitted_only_after_its_time_limit(tmp_path, name, number, restart, again):
    """USR1 comes a minute before the limit, TERM from scancel. The run and sbatch are replaced.

    A resumed run that is stopped without a newer checkpoint would be stopped there again: the log says why.
    """
    tools = write_tools(tmp_path, mpirun=STAND_IN, sbatch="#!/usr/bin/env bash\ntouch submitted\n")
    (tmp_path / f"{name}.checkpoint-1-000000000000.h5").touch()
    environment = ENVIRONMENT | {"PATH": f"{tools}:{os.environ['PATH']}", "SLURM_NTASKS": "1"}
    environment["NETFALL_RESTART"] = str(restart)
    line = ["bash", ROOT / "jobs" / f"{name}.slurm"]
    script = subprocess.Popen(line, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    wait_for((tmp_path / "started").exists)
    script.send_signal(number)
    log = script.communicate(timeout=30)[1]
    assert script.returncode == (0 if again else 4)
    assert ("or an equilibrium, take longer than --time" in log) == (restart == 1)
    assert (tmp_path / "submitted").exists() == again


@pytest.mark.parametrize("name", ["stadium", "saddle", "wheel", "olympia"])
def test_a_script_of_slurm_takes_the_checkpoint_that_was_written_last(tmp_path, name):
    """An earlier run, of a job that has changed since, left checkpoints of a later stage."""
    write_tools(tmp_path, mpirun='#!/bin/sh\necho "$@" > given\n', netfall="#!/bin/sh\n")
    for age, checkpoint in enumerate(("2-000000000007", "5-000000084000")):
        path = tmp_path / f"{name}.checkpoint-{checkpoint}.h5"
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
    environment = ENVIRONMENT | {"SLURM_NTASKS": "1", "NETFALL_RESTART": "1"}
    subprocess.run(["bash", ROOT / "jobs" / f"{name}.slurm"], cwd=tmp_path, env=environment, check=True)
    assert f"--restart {name}.checkpoint-2-" in (tmp_path / "given").read_text()
