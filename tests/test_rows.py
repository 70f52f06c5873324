"""Rows of the history that wait in a table: none is lost, doubled or taken for another."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import assert_same_results
from test_dynamics import DIVERGES
from test_restart import SLOW

from netfall.core.errors import DivergedError
from netfall.driver.dynamics import stage as dynamics
from netfall.explicit import rows
from netfall.parallel.sums import ALL, LIMBS, SUM_BLOCK, add_exactly, round_limbs


@pytest.mark.parametrize("lowest", [-155, -156, -157, -400])
def test_sums_in_blocks_are_exact_beyond_three_pieces(lowest):
    """Bits down to 2^-155 of the largest are cut in three pieces, those below are added one by one."""
    rng = np.random.default_rng(3)
    values = rng.standard_normal(2 * SUM_BLOCK + 7) * 2.0 ** rng.integers(lowest + 60, 0, 2 * SUM_BLOCK + 7)
    values[[5, SUM_BLOCK, -1]] = 1.5, -(2.0**lowest), 2.0**lowest + 2.0 ** (lowest + 40)
    is_counted = (rng.random(len(values)) < 0.5).astype(np.uint8)
    is_counted[[5, SUM_BLOCK, -1]] = 1
    limbs = np.zeros((2, LIMBS), np.int64)
    add_exactly(values, ALL, limbs[0])
    add_exactly(values, is_counted, limbs[1])
    assert round_limbs(limbs)[0] == math.fsum(values)
    assert round_limbs(limbs)[1] == math.fsum(values[is_counted == 1])


def test_a_stop_between_two_rows_of_a_table_changes_no_bit(workshop, monkeypatch):
    """Rows every 5 steps, 32 in a table, a look every 233: stopped at step 2097, where 14 rows wait."""
    text = SLOW.replace("duration = 0.4", "duration = 0.3").replace(
        "checkpoint_interval = 0.1", "checkpoint_interval = 0"
    )
    job = workshop.job(
        text.replace("history_interval = 0.02", "history_interval = 5e-4").replace("frames = 8", "frames = 1")
    )
    whole = workshop.run(job, output="whole.vtkhdf")
    assert len(whole["history/time"]) == 601 and len(whole["events/step"]) > 3
    stop, report = SimpleNamespace(is_set=False), dynamics.Simulation.report

    def ask(simulation):
        stop.is_set = simulation.n > 2000
        report(simulation)

    monkeypatch.setattr(rows, "MOST_ROWS", 32)
    monkeypatch.setattr(dynamics, "CHECK_STEPS", 233)
    monkeypatch.setattr(dynamics.Simulation, "report", ask)
    workshop.assert_pause_changes_no_bit(job, stop, r"\(step 2097\)", whole)


PERIOD = 2 * math.pi / math.sqrt(1e6 / 1000.0)  # s, of 1000 kg on 1e6 N/m


def let_go(workshop, **output) -> Path:
    """The job of a weight on a cable, let go 1 mm above its rest, with rows at 0 and at 0.9 of a period."""
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,{-10 - 10e-3 + 1e-3!r},0,1000,-10000\n"
    text = "[cable]\naxial_stiffness = 1e7\nmass_per_length = 1e-3\n[dynamics]\n"
    text += f"duration = {0.9 * PERIOD!r}\ntime_step = {PERIOD / (4 * dynamics.ENVELOPE_STEPS)!r}\n[output]\n"
    text += f"history_interval = {PERIOD!r}\nframes = 1\n"
    text += "".join(f"{key} = {value!r}\n" for key, value in output.items())
    return workshop.job(text, nodes, "start,end,unstressed_length\n1,2,10\n")


def test_the_envelope_includes_motion_between_two_rows(workshop):
    """The weight comes down 2 mm, and 1 mm of stretch more than at rest, half a period after the start."""
    f = workshop.run(let_go(workshop))
    assert len(f["history/time"]) == 2
    envelope = {name: f[f"envelope/{name}"][-1] for name in f["envelope"]}
    assert envelope["displacement_max"] == pytest.approx(2e-3, rel=1e-3)
    assert envelope["tension_max"] == pytest.approx(10e3 + 1e-3 * 1e6, rel=1e-4)
    assert envelope["displacement_max_time"] == pytest.approx(0.5 * PERIOD, rel=1e-9)
    time = envelope["tension_max_time"]  # or a row later
    assert 0.5 * PERIOD * (1 - 1e-9) <= time <= 0.75 * PERIOD * (1 + 1e-9)


def test_the_envelope_is_updated_at_the_same_steps_after_a_restart(workshop):
    """At half a period, a quarter after the time before it, wherever a checkpoint falls."""
    job = let_go(workshop, checkpoint_interval=0.37 * PERIOD)
    whole = workshop.run(job, output="whole.vtkhdf")
    checkpoints = sorted(workshop.folder.glob("whole.checkpoint*"))
    assert len(checkpoints) == 2
    for checkpoint in checkpoints:
        again = workshop.run(job, "--restart", checkpoint, ranks=2, output="again.vtkhdf")
        assert_same_results(whole, again)


def test_divergence_is_reported_for_the_first_row_of_a_table(workshop, monkeypatch):
    """The error is the same as if each row were collected at once, although later rows exist."""
    text, *tables = DIVERGES
    job = workshop.job(text + "[output]\nframes = 1\nhistory_interval = 1e-4\n", *tables)
    errors = []
    for most_rows in (128, 1):
        monkeypatch.setattr(rows, "MOST_ROWS", most_rows)
        with pytest.raises(DivergedError) as raised:
            workshop.run_here(job)
        errors.append(str(raised.value))
    assert errors[0] == errors[1] and "diverged at t = 0.0" in errors[0]
