"""Runs of tens of millions of steps end at the right time, and stop soon after a signal."""

import signal
import time

import numpy as np
import pytest
from conftest import start_run

from netfall.model.schedule import step_at

NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,1,0,0\n3,2,0,0,1\n"
ELEMENTS = "start,end\n1,2\n2,3\n3,1\n"
JOB = """[cable]
modulus = 1e9
area = 1e-4
density = 7850.0
prestress = 1e3
[wind]
onset = "sudden"
speed = 20.0
surface_drag = 0
pressure_coefficient = -1.0
base_height = 10.0
[dynamics]
duration = 16.2
time_step = 1e-6
mass_damping = 1.0
[output]
frames = 1
history_interval = 100.0
"""


@pytest.mark.parametrize("duration", [16.2, pytest.param(50.0, marks=pytest.mark.long)])
def test_tens_of_millions_of_steps_in_wind_end_at_the_right_time(workshop, duration):
    """The last step has the right number. Damping of 1/s leaves exp(-16.2 / 2) = 3e-4 of the motion."""
    result = workshop.solve(JOB.replace("16.2", str(duration)), NODES, ELEMENTS)
    assert result["history/time"][:].tolist() == [0.0, duration]
    assert result["provenance"].attrs["steps"] == round(1e6 * duration)
    assert result["history/kinetic_energy"][-1] < 1e-6 * result["history/external_work"][-1]


def stopped_after(workshop, job, ranks: int, number: int, wait: float) -> int:
    """Return the step of a checkpoint after a signal some seconds after the dynamics began."""
    process = start_run(job, workshop.folder / "result.vtkhdf", ranks)
    time.sleep(wait)
    process.send_signal(number)
    _, error = process.communicate(timeout=100)  # without a check between the rows it would be minutes
    assert process.returncode == 4, error
    assert "interrupted at t =" in error
    newest = max(workshop.folder.glob("*.checkpoint-*"))
    return int(newest.stem.split("-")[-1])


@pytest.mark.parametrize("ranks, number", [(1, signal.SIGTERM), (2, signal.SIGUSR1)])
def test_a_signal_between_two_distant_rows_stops_the_run(workshop, ranks, number):
    """The next row is minutes away: exit code 4 and a checkpoint at an earlier check."""
    job = workshop.job(JOB.replace("16.2", "1000.0"), NODES, ELEMENTS)
    steps = (stopped_after(workshop, job, ranks, number, wait) for wait in (1.0, 4.0, 16.0))
    step = next(step for step in steps if step > 0)
    assert step % 100_000 == 0


def test_steps_are_numbered_to_rounding_in_long_runs():
    """k * dt is at step k and a little more is not, for up to 1e12 steps."""
    k = np.unique(np.geomspace(1, 1e12, 5000).astype(np.int64))
    for dt in (1e-6, 1.7e-5, 2.3e-5, 0.1):
        assert np.array_equal(step_at(k * dt, dt), k)
        assert np.array_equal(step_at((k + 0.01) * dt, dt), k + 1)
