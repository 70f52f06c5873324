"""Steps in mixed and single precision:
what is lost against double, and that the bits stay the same on any number of ranks and through a restart.
"""

import h5py
import numpy as np
import pytest
from conftest import (
    AREAS,
    NEVER_REACHED,
    ROOF,
    ROOT,
    STILL_AIR,
    WHOLE,
    assert_same_results,
    run_on_standing_ranks,
)
from test_extremes import positions, reached
from test_parallel import COLLAPSE
from test_restart import SLOW

LOST = {"mixed": 1e-4, "single": 1e-4}  # of the largest displacement or tension, while cables are taut


@pytest.mark.parametrize("precision", ["mixed", pytest.param("single", marks=pytest.mark.long)])
def test_collapse_is_the_same_on_three_ranks(workshop, precision):
    """Fractures, yield, wind and static load; the audits hold as far as the numbers reach."""
    keys = ["--set", "dynamics.duration=1.0", "--set", f"dynamics.precision={precision}"]
    job = workshop.job(COLLAPSE.format(after="particle"))
    one = workshop.run(job, *keys, output="1.vtkhdf")
    assert_same_results(one, workshop.run(job, *keys, ranks=3, output="3.vtkhdf"))
    assert one["history/broken"][-1] > 30
    reached(
        f"collapse in {precision} precision: work identity",
        "1e-3",
        np.abs(one["history/identity_error"][:]).max(),
        1e-3,
    )
    reached("the same: physical balance", "2e-3", np.abs(one["history/balance_error"][:]).max(), 2e-3)


@pytest.mark.parametrize("precision", LOST)
def test_restart_gives_the_same_bits(workshop, precision):
    """From a checkpoint after fractures, on other ranks."""
    job = workshop.job(SLOW)
    keys = ["--set", f"dynamics.precision={precision}"]
    whole = workshop.run(job, *keys, output="whole.vtkhdf")
    assert len(whole["events/step"]) > 3
    checkpoint = sorted(workshop.folder.glob("whole.checkpoint*"))[-1]
    assert_same_results(
        whole, workshop.run(job, *keys, "--restart", checkpoint, ranks=3, output="again.vtkhdf")
    )


@pytest.mark.parametrize("strain", ["engineering", pytest.param("logarithmic", marks=pytest.mark.long)])
def test_what_is_lost_against_double(workshop, strain):
    """The stadium in its wind while its cables are taut: displacements and tensions."""
    text = (
        (ROOT / "jobs" / "stadium_paper.toml")
        .read_text()
        .replace("duration = 6.0", "duration = 0.25")
        .replace("frames = 120", "frames = 10")
    )
    job = workshop.job(text.replace("fracture_strain = ", f'strain = "{strain}"\nfracture_strain = '))
    found = {}
    for precision in ("double", *LOST):
        with workshop.run(job, "--set", f"dynamics.precision={precision}") as f:
            assert precision == "double" or f["history/slack"][:].max() == 0
            found[precision] = f["VTKHDF/PointData/displacement"][:], f["VTKHDF/CellData/tension"][:]
    for precision, limit in LOST.items():
        for name, exact, other in zip(("displacement", "tension"), found["double"], found[precision]):
            reached(
                f"{precision} precision, {strain} strain, 0.25 s: error of the {name}",
                f"{limit:g}",
                np.abs(other - exact).max() / np.abs(exact).max(),
                limit,
            )


def test_a_creep_that_single_precision_cannot_follow(workshop):
    """A weight settles by 1 m, ever slower:
    the last way of a step is below the last digit of a single-precision displacement. Mixed follows; single
    is announced.
    """
    stiffness, mass, zeta, dt, seconds = 1e5, 1e4, 20.0, 4e-5, 20.0
    nodes = (
        f"id,x,y,z,fixed,mass,load_z{AREAS}\n1,0,0,0,1,0,0{ROOF}\n"
        f"2,0,0,-100,0,{mass - 3.925e-3!r},{-stiffness!r}{ROOF}\n"
    )
    text = (
        "[cable]\nmodulus = 1e13\narea = 1e-6\ndensity = 78.5\n"
        + NEVER_REACHED.replace("1e12", "9e12")
        + STILL_AIR
        + WHOLE
        + f"duration = {seconds}\ntime_step = {dt}\ndamping = {zeta}\n"
        f"[output]\nhistory = 0.1\nframes = 20\n"
    )
    job = workshop.job(text, nodes, "start,end\n1,2\n")
    slow = 0.5 * zeta - np.sqrt(0.25 * zeta**2 - stiffness / mass)
    fast = zeta - slow
    for precision, least, most in (("double", 0.0, 1e-6), ("mixed", 0.0, 1e-4), ("single", 1e-4, 0.05)):
        done = run_on_standing_ranks(
            "run", job, "--set", f"dynamics.precision={precision}", "-o", workshop.folder / "result.vtkhdf"
        )
        assert (
            done.returncode == 0
            and ("stands still" in done.stdout) == (precision == "single")
            and ("tensions are rounded" in done.stdout) == (precision != "double")
        )
        with h5py.File(workshop.folder / "result.vtkhdf") as f:
            t, fallen = f["VTKHDF/Steps/Values"][:], -100.0 - positions(f, 1)[:, 2]
        expected = 1.0 - (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow)
        error = np.abs(fallen - expected).max()
        reached(
            f"a creep by 1 m, slower and slower, in 5e5 steps, {precision}: error [m]",
            f"{least:g} to {most:g}",
            error,
            most,
        )
        assert error >= least
