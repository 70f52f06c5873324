"""Errors of users on the command line or in single values: one clear line, exit code 2, no hang."""

import sys

import pytest
from conftest import BIN, refused, run_netfall, run_on_standing_ranks, run_process
from test_long_runs import ELEMENTS, JOB, NODES

TINY = JOB.replace("16.2", "0.001")


@pytest.fixture
def job(workshop):
    """Return the file of a valid job."""
    return workshop.job(TINY, NODES, ELEMENTS)


def test_a_long_title_is_printed_and_drawn(workshop):
    """The title is longer than an attribute of the result file can be. info prints all, plot a part of it."""
    title = "A roof " * 40
    result = workshop.solve(TINY, NODES, ELEMENTS, "--set", f'title="{title}"').filename
    assert title in run_on_standing_ranks("info", result).stdout
    drawn = run_on_standing_ranks("plot", result)
    assert "energies.png" in drawn.stdout, drawn.stderr


@pytest.mark.parametrize(
    "speed, surface_drag, message",
    [
        ("1e200", "0.03", "expected a number from 0.1 to 200 m/s"),
        ("0.001", "0.03", "expected a number from 0.1 to 200 m/s"),
        ("0.5", "0.03", "Set [wind] time_step >= 0.1, or surface_drag = 0"),
    ],
)
def test_an_impossible_wind_is_refused(workshop, job, speed, surface_drag, message):
    """At once: no overflow, and no minutes for the lags of gusts that last half an hour."""
    values = ("--set", f"wind.speed={speed}", "--set", f"wind.surface_drag={surface_drag}")
    assert message in refused("check", job, *values, timeout=120)


def test_a_slow_wind_without_gusts_runs(workshop):
    """Only the model of the gusts is refused."""
    workshop.solve(TINY, NODES, ELEMENTS, "--set", "wind.speed=0.5")


def test_a_job_file_with_a_byte_order_mark_is_read(workshop):
    job = workshop.job(TINY, "\ufeff" + NODES, ELEMENTS)
    job.write_bytes(b"\xef\xbb\xbf" + job.read_bytes())
    workshop.run(job)


def test_a_forgotten_command_is_named(workshop, job):
    assert f"did you mean netfall run {job}?" in refused(job)
    assert "did you mean netfall info a.vtkhdf?" in refused("a.vtkhdf")
    assert 'netfall rum: unknown command; did you mean "run"?' in refused("rum", job)
    assert "did you mean netfall run" in refused(job, ranks=2, run=run_netfall)


def test_a_wrong_option_is_one_line(workshop, job):
    assert "--walltime" in refused("run", job, "--walltime", "10")
    assert "--fast: unknown option; did you mean" in refused("run", job, "--fast")


@pytest.mark.parametrize("is_result", [True, False])
def test_a_folder_is_refused_as_a_result_file(workshop, job, is_result):
    if is_result:
        (workshop.folder / "out").mkdir()
    line = refused("run", job, "-o", f"{workshop.folder}/out/")
    assert "is a folder; expected the name of a file" in line
    assert (workshop.folder / "out").exists() == is_result


@pytest.mark.parametrize("verb", ["plot", "scale", "trade"])
def test_a_file_is_refused_as_a_folder_for_pictures(workshop, job, verb):
    more = ["--ranks", "1"] if verb == "scale" else []
    for place in (job, job / "pictures"):
        line = refused(verb, job, "-o", place, *more)
        assert f"-o {place}: {job} is a file; expected a folder" in line


def test_an_animation_of_one_case_is_refused(workshop, job):
    """An animation shows the dynamic stage, so the option would have no effect."""
    assert "--case snow: an animation shows" in refused("plot", job, "--animate", "--case", "snow")


def test_mpirun_adds_no_lines_to_an_error(workshop, job):
    """The job file is wrong, or the run stops with a checkpoint: the exit code stays."""
    assert 'did you mean "speed"?' in refused("run", job, "--set", "wind.sped=3", ranks=2, run=run_netfall)
    output = workshop.folder / "result.vtkhdf"
    done = run_netfall("run", job, "-o", output, "--walltime", "00:00:00", ranks=2, code=4)
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize(
    "end, message", [("os.kill(os.getpid(), 9)", "signal 9"), ("os._exit(5)", "Exit code:    5")]
)
def test_mpirun_reports_other_failures(end, message):
    code = f"import os; from mpi4py import MPI; MPI.COMM_WORLD.rank == 1 and {end}; MPI.COMM_WORLD.Barrier()"
    line = [BIN / "mpirun", "-n", "2", sys.executable, "-c", code]
    done = run_process(*line, timeout=60, code=None)
    assert done.returncode != 0 and message in done.stderr


def test_mpirun_passes_the_output_of_a_rank():
    """Lines of dashes and a last line without an end: no output of a program is lost."""
    text = "one\n" + "-" * 74 + "\ntwo\n" + "-" * 74 + "\n" + "-" * 74 + "\nopen\nlast"
    code = f"import sys; sys.stderr.write({text!r}); sys.exit(2)"
    line = [BIN / "mpirun", "-n", "1", sys.executable, "-c", code]
    done = run_process(*line, timeout=60, code=None)
    assert done.returncode == 2 and done.stderr.startswith(text)


def test_a_probe_far_from_the_net_is_named(workshop):
    """Node 2 at [1, 1] is used, 5 m from [4, 5] by Pythagoras. A near probe is not named."""
    job = workshop.job(TINY + "probes = [[1.5, 1.5], [4.0, 5.0]]\n", NODES, ELEMENTS)
    done = run_on_standing_ranks("run", job, "-o", workshop.folder / "result.vtkhdf")
    (note,) = [line for line in done.stdout.splitlines() if "probes" in line]
    assert "[4, 5]: 5 m away" in note and "longest element 2 m" in note and "node 2, at [1, 1]" in note
    assert note in run_on_standing_ranks("check", job).stdout


def test_a_step_longer_than_the_duration_is_refused(workshop, job):
    """The run would be one step to a later time."""
    values = ("--set", "dynamics.duration=5e-7")
    line = refused("run", job, "-o", workshop.folder / "result.vtkhdf", *values)
    assert "time_step = 1e-06: longer than duration = 5e-07 s" in line
