"""Parts that are detached in wind: drag instead of pressure, its work, and the warnings."""

import numpy as np
import pytest
from conftest import BARE, audits
from mpi4py import MPI

from netfall.driver.sample import run_sample
from netfall.explicit.history import energy_in_play
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.results.warning_text import balance_warnings, detached_warnings_of

RHO, STEP = 1.25, 1e-3
STRING = BARE.replace("683.08e-6", "1e-7")  # cables of next to no mass
LINE = 7850.0 * 1e-7  # kg/m
NODES = "id,x,y,z,fixed,mass,area,normal_x,normal_y,normal_z\n1,0,0,0,1,0,0,0,0,1\n"
CABLES = "id,start,end,unstressed_length\n1,1,2,10.5\n2,2,3,2.5\n"  # slack: only the air acts
OWN, AREA = 50.0, 4.0  # kg, m2
MASS = OWN + 6.5 * LINE  # of node 2, with half of both cables, which stays with it; node 3 is as heavy
CUT = "[[remove]]\nelements = [1]\ntime = 0.005\n"
SEEN = 10  # number of the step at 0.01 s, at which the connectivity is evaluated


def plates(area: float = AREA) -> str:
    """Two equal plates on a cable, which hangs on a support by another one."""
    return NODES + f"2,10,0,0,0,{OWN},{area},0,0,1\n3,12,0,0,0,{OWN + 5.25 * LINE},{area},0,0,1\n"


def flight(wind: str, steps: int, load: str = "self_weight = false\n", after: str = "detached") -> str:
    """Both plates are cut free at 5 ms in a wind along y."""
    return (
        STRING
        + f'[wind]\nonset = "sudden"\ndirection = 90.0\nprofile_exponent = 0.0\nafter_fracture = "{after}"\n'
        + f"{wind}[load]\nsteps = 0\n{load}{CUT}[dynamics]\nduration = {steps * STEP}\ntime_step = {STEP}\n"
        + f"[output]\nhistory_interval = {STEP}\nprobes = [2, 3]\n"
    )


STEADY = "speed = 30.0\nturbulence_intensity = 0.0\npressure_coefficient = 0.0\n"


def place(v: np.ndarray) -> np.ndarray:
    """Positions after kicks that lead to the velocities v (n,), the first that of the start."""
    return np.concatenate([[0.0], np.cumsum(STEP * v[1:])])


@pytest.mark.parametrize("area", [AREA, 4e4])
def test_a_free_plate_accelerates_as_in_the_closed_form(workshop, area):
    """M dv/dt = rho A (u - v)^2 / 2 from rest: v = u - u / (1 + k u t), k = rho A / 2M.

    The force of a kick is that of the closed form over its length, so after j kicks v is the form at j dt, to
    rounding, also where one kick alone brings it to nine tenths of u (k u dt = 9). The work of the drag is
    all of the kinetic energy, and external; nothing is attached any more.
    """
    f = workshop.solve(flight(STEADY, 100), plates(area), CABLES)
    u, k = 30.0, 0.5 * RHO * area / MASS
    y = f["history/probe_displacement"][:, :, 1]
    kicks = np.maximum(0, np.arange(101) - SEEN)
    v = u - u / (1 + k * u * STEP * kicks)
    assert np.abs(y - place(v)[:, None]).max() < 1e-12 * y.max()
    d = f["detached"]
    assert (d["node_id"][:] == 2).all() and np.allclose(d["mass"][:], 2 * MASS, rtol=1e-14)
    at = np.round(d["time"][:] / STEP).astype(int)
    assert at.tolist() == list(range(10, 100, 10)) and np.abs(d["velocity"][:, 1] - v[at]).max() < 1e-12 * u
    assert d["largest_gust"][()] == u and np.abs(d["velocity"][:, 1]).max() < u
    h, last = f["history"], f["final/velocity"][1, 1]  # at the very end, half a kick after the last
    assert (audits(f) < 1e-12).all()
    assert np.isclose(h["external_work"][-1], MASS * last**2, rtol=1e-12)
    assert (h["attached_energy"][SEEN + 1 :] == 0.0).all()


@pytest.mark.parametrize("vertical", [1, 0])
def test_a_plane_net_detaches_although_each_node_is_guided(workshop, vertical):
    """Nodes held only across the plane are detached, unless the net has no vertical support."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass,area,normal_x,normal_y,normal_z\n"
    nodes += f"1,0,0,0,1,1,{vertical},0,0,0,0,1\n2,10,0,0,1,0,0,{OWN},{AREA},0,0,1\n"
    nodes += f"3,12,0,0,1,0,0,{OWN},{AREA},0,0,1\n"
    job = workshop.job(flight(STEADY, 60), nodes, CABLES)
    path, cache = workshop.folder / "result.vtkhdf", ResultCache()
    outcome = run_sample(MPI.COMM_SELF, lambda: read_job(job), path, cache)
    f = workshop.open()
    assert outcome["detached_area"] == vertical and ("detached" in f) == (vertical == 1)
    if vertical:
        assert f["history/attached_energy"][-1] == 0.0 and f["detached/velocity"][-1, 1] > 1.0


PRESSURES = 'pressures = "p.csv"\ntaps = "taps.csv"\n'


@pytest.mark.parametrize("speed", [None, 20.0])
def test_pressures_end_and_drag_needs_a_speed(workshop, speed):
    """Taps lift both plates with 100 N/m2 until they are cut free: then they fly on, or the mean wind drags.

    By kicks: v = dt F / M each, the first a half; then v + (u - v) b / (1 + b), b = rho A |u - v| dt / 2M.
    """
    (workshop.folder / "p.csv").write_text("time,a\n0,-100\n9,-100\n")
    (workshop.folder / "taps.csv").write_text("name,x,y\na,0,0\n")
    wind = PRESSURES + (f"speed = {speed}\n" if speed else "")
    f = workshop.solve(flight(wind, 60), plates(), CABLES)
    v, x, places = np.zeros(3), np.zeros(3), []
    u = np.array([0.0, speed or 0.0, 0.0])
    for n in range(61):
        places.append(x)
        kick = STEP if n else 0.5 * STEP
        if n < SEEN:
            v = v + kick * np.array([0.0, 0.0, 100.0 * AREA / MASS])
        elif speed:
            b = 0.5 * RHO * AREA * np.linalg.norm(u - v) * kick / MASS
            v = v + (u - v) * b / (1 + b)
        x = x + STEP * v
    moved = f["history/probe_displacement"][:]
    assert np.abs(moved - np.array(places)[:, None]).max() < 1e-13
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12
    gust = f["detached/largest_gust"][()]
    assert gust == speed if speed else np.isnan(gust)


def test_a_part_that_keeps_its_pressure_is_a_warning(workshop):
    """With "none" v = F t / M passes the wind of 5 m/s, as `info` and `run` say; not with "detached"."""
    wind = "speed = 5.0\nturbulence_intensity = 0.0\npressure_coefficient = -64.0\n"  # 1000 N/m2
    lift = 64.0 * 0.5 * RHO * 25.0 * AREA / MASS  # m/s2
    f = workshop.solve(flight(wind, 200, after="none"), plates(), CABLES)
    passed = np.ceil(5.0 / lift / 0.01) * 0.01  # the next evaluation
    (warning,) = detached_warnings_of(f)
    assert warning.startswith(f"warning: dynamics: from t = {passed:.4g} s a detached part (")
    assert warning in workshop.info() and "aerodynamic_damping" in warning
    f = workshop.solve(flight(wind, 200), plates(), CABLES, output="other.vtkhdf")
    assert [*detached_warnings_of(f)] == []
    assert "faster than" not in workshop.info("other.vtkhdf")


def test_the_energy_of_attached_parts_excludes_detached_ones(workshop):
    """N^2 L0 / 2 EA of a taut cable near the plates stays; the balance error is the largest so far."""
    nodes = plates() + "7,0,9,0,1,0,0,0,0,1\n8,4,9,0,0,1,0,0,0,1\n9,8,9,0,1,0,0,0,0,1\n"
    cables = CABLES + "3,7,8,3.99\n4,8,9,3.99\n"
    f = workshop.solve(flight(STEADY, 100), nodes, cables)
    h = {name: column[:] for name, column in f["history"].items() if column.ndim == 1 and len(column) == 101}
    EA = 1.95e11 * 1e-7
    stored = 2 * 0.5 * EA * (0.01 / 3.99) ** 2 * 3.99
    assert np.allclose(h["attached_energy"], stored, rtol=1e-12)
    assert h["kinetic_energy"][-1] > 100 * stored
    joules = h["energy_balance_error"] * np.maximum.accumulate(np.maximum(energy_in_play(h), 1e-4 * stored))
    assert np.allclose(h["balance_error_attached"] * stored, joules, rtol=1e-9, atol=1e-12 * stored)


@pytest.mark.parametrize("took_part, attached", [(2e-3, 1e-4), (1e-4, 2e-3)])
def test_either_share_of_the_balance_error_is_a_warning(took_part, attached):
    """Above the promise of 1e-3, by the larger one; below it netfall warns of nothing."""
    history = {"time": np.arange(3.0), "work_identity_error": np.full(3, 1e-12)}
    off = {
        "energy_balance_error": np.array([0, took_part, 0]),
        "balance_error_attached": np.array([0, -attached, 0]),
    }
    (line,) = balance_warnings(history | off)
    assert line.startswith("warning: dynamics: the energy balance is off by up to")
    assert "t = 1 s to 1 s" in line
    within = dict.fromkeys(off, np.full(3, -9e-4))
    assert [*balance_warnings(history | within)] == []
    (line,) = balance_warnings(history | within | {"work_identity_error": np.array([np.nan, -2e-6, 0.0])})
    assert line.startswith("warning: dynamics: the work identity of the time integration is off by 2.0e-06")
