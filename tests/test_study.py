"""`netfall scale` and `netfall trade`: tables, pictures, resumption, and refusal of wrong input."""

import signal
from itertools import product
from subprocess import DEVNULL, Popen

import h5py
import numpy as np
import pytest
from conftest import BIN, ENVIRONMENT, STEEL, refused, run_on_standing_ranks, wait_for
from results import rows_of

from netfall.job.read import read_job
from netfall.post.accuracy.compare import (
    AccuracyOutcome,
    OutcomeJournal,
    compare_outcome,
    comparison_text,
    read_outcome,
)
from netfall.results.locks import locked_output
from netfall.study.files import read_journal

LIMITS = "yield_stress = 1.75e9\nfracture_strain = 0.0404\n"
NET = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 40.0\ncells = 6\n'
JOB = f"""{NET}{STEEL}{LIMITS}[form_finding]
method = "force_density"
[load]
self_weight = false
dead = 300.0
[wind]
onset = "sudden"
speed = 90.0
pressure_coefficient = -1.5
base_height = 10.0
surface_drag = 0.03
gust_field = "point"
[dynamics]
duration = 0.2
mass_damping = 0.5
[output]
frames = 10
"""


def test_scale_measures_one_and_two_ranks(workshop):
    """Strong: the job; weak: twice the elements on two ranks. Phases add up to the stage at most."""
    words = ["--ranks", "1,2", "--repeats", "1", "-o", workshop.folder / "out"]
    job = workshop.job(JOB.replace(LIMITS, "").replace("cells = 6", "cells = 4"))
    run_on_standing_ranks("scale", job, *words, cwd=workshop.folder)
    rows = rows_of(workshop.folder / "out" / "job_scale.csv")
    assert {(row["kind"], row["ranks"]) for row in rows} == set(product(("strong", "weak"), "12"))
    by = {(row["kind"], int(row["ranks"])): row for row in rows}
    assert by["strong", 2]["elements"] == by["strong", 1]["elements"]
    assert 1.4 < int(by["weak", 2]["elements"]) / int(by["weak", 1]["elements"]) < 2.6
    for row in rows:
        total = sum(float(row[f"{phase}_mean_s"]) for phase in ("forces", "exchange", "drift", "output"))
        assert 0 < total <= 1.01 * float(row["dynamics_s"])
        assert float(row["forces_min_s"]) <= float(row["forces_mean_s"]) <= float(row["forces_max_s"])
    assert float(by["strong", 2]["exchange_mean_s"]) > 0
    assert (workshop.folder / "out" / "job_scale.png").stat().st_size > 10_000
    assert not list((workshop.folder / "out").glob(".*"))


def test_trade_compares_settings(workshop):
    """The reference has no error against itself. A step above the limit is a refused row."""
    arguments = ["trade", workshop.job(JOB), "--vary", "dynamics.time_step=auto,1.0"]
    arguments += ["--vary", "dynamics.fragment_mass=0,0.05", "--reference", "dynamics.fragment_mass=0"]
    arguments += ["--repeats", "1", "-o", workshop.folder / "out"]
    done = run_on_standing_ranks(*arguments, cwd=workshop.folder)
    with h5py.File(workshop.folder / "out" / "job_trade.h5") as file:
        table = {name: values[()] for name, values in file["table"].items()}
    settings, states = table["setting"].astype(str).tolist(), table["state"].astype(str).tolist()
    pairs = product(("auto", "1.0"), ("0", "0.05"))
    assert settings == ["dynamics.time_step={}, dynamics.fragment_mass={}".format(*pair) for pair in pairs]
    assert states == ["finished", "finished", "refused", "refused"]
    assert table["error"][0] == 0 and table["overlap"][0] == 1 and table["broken"][0] > 3
    assert np.isinf(table["error"][2:]).all() and "above the stable step" in table["reason"].astype(str)[2]
    assert table["pareto"][:2].any() and not table["pareto"][2:].any()
    assert "cheapest within an error of 0.05, energy balance within 0.001: dynamics" in done.stdout
    assert (workshop.folder / "out" / "job_trade.png").exists()


def test_trade_recommends_no_run_with_a_large_energy_balance_error():
    """The faster of two runs within the tolerance has twice the balance error of the warning W735."""
    exact = AccuracyOutcome("finished", "", 9.0, 1e-4, 1.0, 1.0, energy_balance_error=1e-6)
    short = exact._replace(seconds=2.0, energy_balance_error=5e-4)
    long = exact._replace(seconds=1.0, energy_balance_error=2e-3)
    rows = [compare_outcome(name, run, exact) for name, run in (("short", short), ("long", long))]
    assert "within 0.001: short (2 s, 4.5 times faster" in comparison_text(rows, exact, 0.05)[-1]


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["scale", "--ranks", "0"], "expected a whole number >= 1"),
        (["scale", "--ranks", "1", "--launcher", "mpirun"], "{ranks}"),
        (["scale", "--ranks", "1", "--launcher", "no-such-launcher {ranks}"], "No such file"),
        (["trade", "--vary", "safety"], "expected SECTION.KEY=VALUE"),
        (["trade", "--vary", "dynamics.safty=1"], "safety"),
    ],
)
def test_wrong_studies_are_refused(workshop, arguments, message):
    done = run_on_standing_ranks(arguments[0], workshop.job(JOB), *arguments[1:], cwd=workshop.folder, code=2)
    assert message in done.stderr and "Traceback" not in done.stderr
    assert {p.suffix for p in workshop.folder.iterdir()} <= {".toml", ".h5"}


def test_the_energy_check_is_optional_and_changes_no_bit(workshop):
    """energy = false: the same motion. The works and both errors are nan."""
    text = JOB.replace("cells = 6", "cells = 4").replace("speed = 90.0", "speed = 180.0")
    job = workshop.job(text.replace("duration = 0.2", "duration = 0.07"))
    audited = workshop.run(job, output="a.vtkhdf")
    bare = workshop.run(job, "--set", "output.energy=false", output="b.vtkhdf")
    assert len(audited["events/step"]) > 3 and audited["events/mass"][:].min() > 0
    same = [*(f"final/{name}" for name in ("position", "velocity", "tension")), "events/step"]
    for name in [*same, *(f"history/{name}" for name in ("kinetic_energy", "strain_energy", "time"))]:
        assert np.array_equal(audited[name], bare[name]), name
    for name in ("external_work", "damping_work", "work_identity_error", "energy_balance_error"):
        assert np.isfinite(audited[f"history/{name}"]).all() and np.isnan(bare[f"history/{name}"]).all()


TABLES = STEEL + '[wind]\nonset = "sudden"\nfile = "wind.csv"\nbase_height = 10.0\n'
TABLES += "pressure_coefficient = -1.0\n[dynamics]\nduration = 0.02\n"
NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,1,0,0\n3,2,0,0,1\n"


def with_tables(workshop):
    """Return a job with three tables, and a study of it that runs in seconds."""
    job = workshop.job(TABLES, NODES, "start,end\n1,2\n2,3\n3,1\n")
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n1,20\n")
    vary = ["--vary", "dynamics.safety=0.8", "--reference", "dynamics.safety=0.4", "--repeats", "1"]
    return job, ["trade", job, *vary, "-o", workshop.folder]


def test_changed_tables_and_failed_runs_are_repeated(workshop):
    """Nothing runs while the tables are unchanged. Another number in one restarts the reference."""
    _, arguments = with_tables(workshop)
    arguments += ["--set", "output.checkpoint_interval=0.005"]
    trade = lambda *more, code=0: run_on_standing_ranks(*arguments, *more, cwd=workshop.folder, code=code)
    no_launcher = ("--launcher", "false {ranks}")
    assert "does not start" in trade(*no_launcher, code=2).stderr
    first = trade()
    assert not [p.name for p in workshop.folder.iterdir() if p.name.startswith(".") or "checkpoint" in p.name]
    assert trade(*no_launcher).stdout == first.stdout
    for table, old, new in (("wind.csv", "1,20", "1,30"), ("nodes.csv", "2,1,1,0,0", "2,1,1,0.1,0")):
        path = workshop.folder / table
        before = path.read_text()
        path.write_text(before.replace(old, new))
        assert "does not start" in trade(*no_launcher, code=2).stderr
        path.write_text(before)


def test_a_second_study_of_the_same_table_is_refused_at_once(workshop):
    _, arguments = with_tables(workshop)
    with locked_output(workshop.folder / "job_trade.h5"):
        assert "another run or program is writing" in refused(*arguments, cwd=workshop.folder)


def test_an_outcome_without_fracture_has_the_peaks_between_snapshots(workshop):
    """Two snapshots miss them. Up to a fracture, which does not end an envelope, snapshots are used."""
    with workshop.run(workshop.job(JOB.replace(LIMITS, "")), "--set", "output.frames=1") as file:
        outcome, ended = (read_outcome({}, file, until) for until in (None, 10.0))
        assert outcome.largest_tension == file["envelope/tension_max"][:].max() > ended.largest_tension
        largest = file["envelope/displacement_max"][:].max()
    assert outcome.largest_displacement == largest >= ended.largest_displacement


def test_parts_of_an_element_break_as_one_in_an_accuracy_study():
    """Both halves of element 7 broke; net.subdivide=2 had an error of 100 % against one whole element."""
    file = h5py.File("parts", "w", driver="core", backing_store=False)
    file["net/element_id"], file["net/elements"] = [7, 7], [[0, 1], [1, 2]]
    file["events/time"], file["events/element"] = [0.1, 0.2], [0, 1]
    file["VTKHDF/Steps/Values"] = file["provenance/nothing"] = file["history/energy_balance_error"] = [0.0]
    file["envelope/displacement_max"] = file["envelope/tension_max"] = [1.0]
    file.create_group("provenance/timings").attrs["dynamics"] = [0.0, 0.0, 1.0]
    file["provenance"].attrs["shortest_time_step"] = 1e-3
    outcome = read_outcome({}, file, np.inf)
    assert (outcome.broken, outcome.broken_elements) == (1, "7")


def test_reproducible_failures_are_not_repeated(tmp_path):
    """A refused or diverged run remains, a dead worker does not. Another version starts afresh."""
    path, header = tmp_path / "x.journal", {"program": "a"}
    records = {code: {"state": "failed", "exit_code": code, "reason": "why"} for code in (1, 2, 3)}
    ended = [read_outcome(records[code], None, None) for code in (1, 2, 3)]
    assert [outcome.state for outcome in ended] == ["failed", "refused", "diverged"]
    outcomes = OutcomeJournal(path, header)
    for key, outcome in zip("abc", ended):
        outcomes.add(key, outcome)
        assert outcomes.best(key, 3) == outcome
    for seconds in (2.0, 1.0, 3.0):
        assert outcomes.best("d", 3) is None
        outcomes.add("d", AccuracyOutcome("finished", seconds=seconds))
    again = OutcomeJournal(path, header)
    assert sorted(again.there) == ["b", "c", "d"] and again.best("a", 1) is None
    assert again.best("d", 3).seconds == 1.0 and again.best("d", 4) is None
    assert OutcomeJournal(path, {"program": "b"}).there == {} and read_journal(path)[0] == [{"program": "b"}]


def test_a_stopped_trade_resumes(workshop):
    """The study is killed, then stopped: measured runs are in the journal, partial results are removed."""
    _, arguments = with_tables(workshop)
    arguments = [str(word) for word in (*arguments, "--repeats", 6)]
    journal, total = workshop.folder / "job_trade.journal", 2 * 6  # of each setting
    measured = lambda: read_journal(journal)[0][1:] if journal.exists() else []
    finished = []
    for signal_, code in ((signal.SIGKILL, -signal.SIGKILL), (signal.SIGTERM, 4)):
        process = Popen([BIN / "netfall", *arguments], cwd=workshop.folder, env=ENVIRONMENT, stdout=DEVNULL)
        wait_for(lambda: len(measured()) > len(finished) or process.poll() is not None)
        process.send_signal(signal_)
        assert process.wait(60) == code
        before, finished = finished, measured()
        assert finished[: len(before)] == before and len(before) < len(finished) < total
    run_on_standing_ranks(*arguments, cwd=workshop.folder)
    assert measured()[: len(finished)] == finished and len(measured()) == total
    names = {"job.toml", "nodes.csv", "elements.csv", "wind.csv"}
    assert {p.name for p in workshop.folder.iterdir() if "lock" not in p.name} == names | {
        f"job_trade.{ending}" for ending in ("h5", "png", "journal")
    }


def test_the_digest_of_a_job_depends_on_its_values(workshop):
    """Not on overrides that change nothing. Tables count by content."""
    job, _ = with_tables(workshop)
    digest = lambda *overrides: read_job(job, overrides).digest()
    plain = digest()
    assert digest("cable.area=1e-3", "cable.area=2e-3") != digest("cable.area=2e-3", "cable.area=1e-3")
    assert digest("cable.area=1e-3", "cable.area=2e-3") == digest("cable.area=2e-3")
    assert digest("dynamics.mass_damping=0", "wind.seed=2") == digest("wind.seed=2") != plain
    assert [path.name for path in read_job(job).files()] == ["nodes.csv", "elements.csv", "wind.csv"]
    for path in read_job(job).files():
        before = path.read_bytes()
        path.write_bytes(before + b"\n")
        assert digest() != plain
        path.write_bytes(before)
    assert digest() == plain
