"""Under a Slurm of our own (`slurm_cluster.py`), and on two hosts: stopped, killed, and the same bits.

Only with --slurm. Jobs run in a folder that looks as the repository's root does, by the scripts as shipped.
"""

import os
import shutil
from pathlib import Path

import h5py
import pytest
from conftest import BIN, ENVIRONMENT, ROOT, assert_same_results, run_netfall, run_process
from slurm_cluster import Cluster, cluster, missing
from test_study_runs import same_studies, write
from two_hosts import two_hosts

from netfall.study.files import read_journal

pytestmark = [pytest.mark.slurm, pytest.mark.processes]
MEMBERS = 6  # of STUDY
SHORT = f"""
job = "{ROOT}/jobs/saddle.toml"
[vary]
"net.saddle.cells" = [4]
"dynamics.duration" = [0.3]
"wind.seed" = [1, 2]
"""


@pytest.fixture(scope="module")
def slurm():
    if missing():
        pytest.fail(
            f"not there: {', '.join(missing())}; apt-get install slurmctld slurmd munge slurm-client "
            "slurm-wlm-basic-plugins"
        )
    with cluster(ENVIRONMENT) as here:
        yield here


@pytest.fixture
def site(tmp_path, slurm):
    """A folder to submit from: scripts as shipped, the stadium for 12 s, a small study. Jobs end with it."""
    for script in (ROOT / "jobs").rglob("*.slurm"):
        target = tmp_path / script.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(script, target)
    (tmp_path / ".venv").symlink_to(ROOT / ".venv")
    text = (ROOT / "jobs" / "stadium.toml").read_text()
    assert "duration = 6.0" in text
    (tmp_path / "jobs" / "stadium.toml").write_text(text.replace("duration = 6.0", "duration = 12.0"))
    write(tmp_path)
    yield tmp_path
    slurm.clear()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The study, run at once without Slurm."""
    folder = tmp_path_factory.mktemp("whole")
    run_netfall("study", write(folder), "--workers", 2, cwd=folder)
    return folder / "storm.study.h5"


def runs_there(journal: Path) -> int:
    return sum("done" in record for record in read_journal(journal)[0]) if journal.exists() else 0


def until_some(slurm: Cluster, journal: Path, more_than: int = 0) -> None:
    slurm.until(lambda: runs_there(journal) > more_than, f"a run in {journal.name}")
    assert runs_there(journal) < MEMBERS


def until_restart(slurm: Cluster, job, restarts: int) -> None:
    """Wait until a job that went back to the queue runs again."""
    again = {"JobState": "RUNNING", "Restarts": str(restarts)}
    slurm.until(lambda: again.items() <= slurm.facts(job).items(), f"restart {restarts} of {job}")


def log_of(folder: Path, name: str) -> str:
    path = folder / f"{name}.log"
    return path.read_text() if path.exists() else ""


# --- one run


def test_a_run_that_is_stopped_twice_has_the_same_bits(slurm, site):
    """jobs/stadium.slurm, on one rank, then on two; the script submits itself again each time."""
    first = slurm.submit("--ntasks=1", "jobs/stadium.slurm", cwd=site)
    for job in (first, first + 1):
        slurm.until(lambda name=f"stadium-{job}": "dynamics:" in log_of(site, name), "the time loop")
        slurm.command("scancel", "--batch", "-s", "USR1", job)
        slurm.until(lambda name=f"stadium-{job}": "Submitted batch job" in log_of(site, name), "the next job")
    slurm.until_empty()
    assert slurm.facts(first + 2)["ExitCode"] == "0:0", log_of(site, f"stadium-{first + 2}")
    assert "1 rank," in log_of(site, f"stadium-{first}")
    assert "2 ranks," in log_of(site, f"stadium-{first + 1}")
    assert [log_of(site, f"stadium-{first + k}").count("interrupted at t =") for k in range(3)] == [1, 1, 0]
    run_netfall("run", site / "jobs" / "stadium.toml", "-o", site / "alone.vtkhdf", cwd=site)
    with h5py.File(site / "stadium.vtkhdf") as one, h5py.File(site / "alone.vtkhdf") as other:
        assert assert_same_results(one, other) > 20


STAND_IN = """#!/usr/bin/env bash
# In the place of the run: stopped by a signal the first time, done the second.
if [ -e was-here-${0##*/} ] || [ $1 = plot ]; then exit 0; fi
touch was-here-${0##*/}
trap 'exit 4' USR1
for ((k = 0; k < 1200; k++)); do sleep 0.1; done
"""


def test_slurm_sends_the_signal_before_the_time_is_up(slurm, site):
    """The scripts as shipped, with something in the place of netfall that only waits for the signal."""
    (site / ".venv").unlink()
    (site / ".venv" / "bin").mkdir(parents=True)
    for name in ("mpirun", "netfall"):
        (site / ".venv" / "bin" / name).write_text(STAND_IN)
        (site / ".venv" / "bin" / name).chmod(0o755)
    run = slurm.submit("--time=2", "--ntasks=1", "jobs/stadium.slurm", cwd=site)
    study = slurm.submit("--time=2", "--cpus-per-task=1", "jobs/studies/stadium.slurm", cwd=site)
    slurm.until_empty()
    assert slurm.facts(run)["ExitCode"] == "0:0", "what sbatch said, in whose place the script went"
    assert "Submitted batch job" in log_of(site, f"stadium-{run}")
    facts = slurm.facts(study)
    assert (facts["JobState"], facts["Restarts"], facts["TimeLimit"]) == ("COMPLETED", "1", "00:02:00")


# --- studies


def test_a_stopped_and_killed_study_resumes_with_the_same_bits(slurm, site, whole):
    """A signal requeues jobs/studies/stadium.slurm, scancel ends it, sbatch resumes it."""
    words = ["--cpus-per-task=1", "--export=ALL,STUDY=storm.toml", "jobs/studies/stadium.slurm"]
    journal = site / "storm.study.journal"
    job = slurm.submit(*words, cwd=site)
    until_some(slurm, journal)
    slurm.command("scancel", "--batch", "-s", "USR1", job)
    until_restart(slurm, job, 1)
    stopped = runs_there(journal)
    until_some(slurm, journal, stopped)
    slurm.kill(f"SLURM_JOB_ID={job}")  # scancel -s KILL would send SIGTERM first
    slurm.until_empty()
    killed = runs_there(journal)
    assert 0 < stopped < killed < MEMBERS
    log = log_of(site, f"stadium-study-{job}")
    assert log.count("interrupted after") == 1 and f"{stopped} of {MEMBERS} runs are there" in log
    job = slurm.submit(*words, cwd=site)
    slurm.until(lambda: "runs to make" in log_of(site, f"stadium-study-{job}"), "its start")
    slurm.command("scancel", job)
    slurm.until_empty()  # neither requeued nor submitted again
    assert slurm.facts(job)["JobState"] == "CANCELLED" and journal.exists()
    slurm.submit(*words, cwd=site)
    slurm.until_empty()
    same_studies(whole, site / "storm.study.h5")


def test_an_array_is_killed_and_sent_back_and_joined_to_the_same_bits(slurm, site, whole):
    """jobs/studies/parts.slurm: one part is signalled, the other killed and queued again; then joined."""
    words = ["--array=1-2", "--export=ALL,STUDY=storm.toml", "jobs/studies/parts.slurm"]
    job = slurm.submit(*words, cwd=site)
    journals = [site / f"storm.{k}-of-2.study.journal" for k in (1, 2)]
    until_some(slurm, journals[0])
    slurm.command("scancel", "--batch", "-s", "USR1", f"{job}_1")
    until_some(slurm, journals[1])
    slurm.kill("SLURM_ARRAY_TASK_ID=2")
    slurm.until(lambda: f"{job}_2" not in slurm.queue(), "end of part 2")
    slurm.command("scontrol", "requeue", f"{job}_2")
    slurm.until_empty()
    # without a dependency: afterok is given up when a part is killed, though it is queued again
    join = slurm.submit("--wrap", ".venv/bin/netfall study storm.toml", cwd=site)
    slurm.until_empty()
    assert [slurm.facts(f"{job}_{k}")["Restarts"] for k in (1, 2)] == ["1", "1"]
    output = (site / f"slurm-{join}.out").read_text()
    assert all(f"storm.{k}-of-2.study.h5: 3 of 6 runs are there" in output for k in (1, 2)), output
    same_studies(whole, site / "storm.study.h5")


def test_srun_starts_the_ranks_of_a_worker(slurm, site):
    study = write(site, SHORT)
    run_netfall("study", study, "-o", site / "alone.study.h5", "--workers", 1, cwd=site)
    study.write_text(SHORT + "[run]\nranks = 2\n")
    launcher = "srun --exact --mpi=pmix -n {ranks}"
    job = slurm.submit(
        "--ntasks=2", "--wrap", f'.venv/bin/netfall study storm.toml --launcher "{launcher}"', cwd=site
    )
    slurm.until_empty()
    output = (site / f"slurm-{job}.out").read_text()
    assert "1 at once on 2 ranks each" in output and "written:" in output, output
    same_studies(site / "alone.study.h5", site / "storm.study.h5")


# --- two hosts


def test_the_scaling_script_runs_on_ranks_that_srun_starts(slurm, site):
    """jobs/scale.slurm on one node of two tasks: a row for each number of ranks, strong and weak."""
    job = site / "jobs" / "stadium.toml"
    job.write_text(job.read_text().replace("duration = 12.0", "duration = 1.0"))
    first = slurm.submit(
        "--nodes=1", "--ntasks-per-node=2", "--export=ALL,SLURM_MPI_TYPE=pmix", "jobs/scale.slurm", cwd=site
    )
    slurm.until_empty()
    assert slurm.facts(first)["ExitCode"] == "0:0", log_of(site, f"netfall-scale-{first}")
    rows = (site / "results" / "stadium_scale.csv").read_text().splitlines()[1:]
    assert [row.split(",")[:2] for row in rows] == [[k, n] for k in ("strong", "weak") for n in "12"]


@pytest.mark.skipif(os.getuid() != 0, reason="namespaces for hosts of their own need root")
def test_two_ranks_on_two_hosts_have_the_bits_of_one(tmp_path):
    settings = ["net.saddle.cells=4", "dynamics.duration=0.3", "wind.speed=40.0", "wind.ramp=0.1"]
    words = ["run", ROOT / "jobs" / "saddle.toml", *(w for each in settings for w in ("--set", each))]
    done = run_netfall(*words, "-o", tmp_path / "one.vtkhdf", cwd=tmp_path)
    with two_hosts(BIN / "mpirun", tmp_path) as mpirun:
        tell = lambda *command: run_process(*mpirun, *command, cwd=tmp_path, code=None)
        assert sorted(tell("hostname").stdout.split()) == ["alpha", "beta"]
        done = tell(BIN / "netfall", *words, "-o", tmp_path / "two.vtkhdf")
        assert done.returncode == 0 and "2 ranks" in done.stdout + done.stderr, done.stderr
    with h5py.File(tmp_path / "one.vtkhdf") as one, h5py.File(tmp_path / "two.vtkhdf") as two:
        assert one["history/broken"][-1] > 0  # something happens across the border of the two
        assert assert_same_results(one, two) > 20
