"""Damping over a band by Maxwell branches: its ratio in free vibration, its step, slack cables, the audit."""

import numpy as np
import pytest
from conftest import audits
from test_air import decrement
from test_motion import BAR, oscillators

from netfall.physics.law.branches import band_branches, branch_stiffening

BAND = "axial_damping_ratio = 0.01\naxial_damping_band = [0.3, 9.0]\n"


def struck(workshop, frequencies, keys, duration):
    """Oscillators on bars that a load along x lets swing from t = 0 on."""
    text, nodes, elements = oscillators([1.0 / f for f in frequencies], "", 5e-4, duration)
    rows = nodes.splitlines()
    rows = [rows[0] + ",load_x"] + [f"{row},{100.0 * (k % 2)}" for k, row in enumerate(rows[1:])]
    return workshop.solve(text.replace("[dynamics]", "[dynamics]\n" + keys), "\n".join(rows), elements)


def test_a_band_above_the_frequencies_of_a_step_damps_nothing(workshop):
    """Its branches fade within a step of 0.5 ms: the motion is that without them, to the last bit."""
    free = struck(workshop, [1.0], "", 0.2)["history/probe_displacement"][:]
    for low in (4e5, 4e4):  # a fade by exp(-1300) and more, and by exp(-130)
        keys = f"axial_damping_ratio = 0.02\naxial_damping_band = [{low}, 1e6]\n"
        assert (struck(workshop, [1.0], keys, 0.2)["history/probe_displacement"][:] == free).all()


def test_the_damping_ratio_of_free_vibration_is_that_of_the_job_over_the_band(workshop):
    """1 % at 0.3, 1, 3, 9 Hz, from the decrement, within 8 %. The energy check holds."""
    frequencies = [0.3, 1.0, 3.0, 9.0]
    f = struck(workshop, frequencies, BAND, 20.0)
    for k, frequency in enumerate(frequencies):
        x = f["history/probe_displacement"][:, k, 0]
        rest = 100.0 / ((100.0 + 0.5e-6) * (2 * np.pi * frequency) ** 2)
        assert decrement(x - rest, 0.05 * rest) / (2 * np.pi) == pytest.approx(0.01, rel=0.08), frequency
    h = f["history"]
    assert np.abs(h["work_identity_error"][:]).max() < 1e-10
    assert np.abs(h["energy_balance_error"][100:]).max() < 1e-3  # of a step of 0.03 / omega at 9 Hz
    assert h["band_damping_work"][-1] > 0.0 and "damping_work" in h


@pytest.mark.parametrize("high, count, within", [(9.0, 2, 0.08), (12.0, 3, 0.05)])
def test_two_branches_hold_the_ratio_over_thirty_times_and_three_over_more(high, count, within):
    """1 % from 0.3 Hz on, by the complex modulus. Of two: f = 1.643 (sqrt(3.83) + sqrt(2.83))^(+-1) Hz."""
    alpha, tau = np.reshape(band_branches(0.01, 0.3, high), (2, -1))
    assert len(alpha) == count
    at = 2 * np.pi * np.geomspace(0.3, high, 30)[:, None] * tau
    modulus = 1.0 + np.sum(alpha * 1j * at / (1.0 + 1j * at), axis=1)
    assert modulus.imag / modulus.real / 2 == pytest.approx(0.01, rel=within)
    if count == 2:
        assert 1 / (2 * np.pi * tau * np.sqrt(1 + alpha)) == pytest.approx([0.4515, 5.980], rel=1e-3)


@pytest.mark.parametrize(
    "ratio, high, least, largest",
    [(0.02, 29.0, 0.95, 1.11), (0.1, 29.0, 0.95, 1.31), (0.2, 29.0, 0.88, 1.48)]
    + [(ratio, 100.0, 0.92, 1.25) for ratio in (0.001, 0.2)]
    + [(0.02, 1e3, 0.6, 1.25), (0.2, 1e3, 0.59, 1.25), (0.02, 1e5, 0.21, 1.25), (0.2, 1e5, 0.19, 1.25)],
)
def test_the_ratio_of_a_mode_is_within_the_bounds_of_the_page(ratio, high, least, largest):
    """From 1 Hz to the high end, by the poles of x'' = -omega^2 (x + sum alpha (x - V)) (page [dynamics])."""
    alpha, tau = np.reshape(band_branches(ratio, 1.0, high), (2, -1))
    ratios = []
    for omega in 2 * np.pi * np.geomspace(1.0, high, 60):
        A = np.diag([0.0, 0.0, *(-1.0 / tau)])  # of x, x' / omega and V
        A[2:, 0] = 1.0 / tau
        A[:2, 0], A[0, 1], A[1, 2:] = [0.0, -omega * (1.0 + alpha.sum())], omega, omega * alpha
        pole = max(np.linalg.eigvals(A), key=lambda value: value.imag)
        ratios.append(-pole.real / abs(pole) / ratio)
    assert least < min(ratios) and max(ratios) < largest
    if high > 100.0:
        assert min(ratios) < 1.1 * least


HUNG_NODES = "id,x,y,z,fixed,load_z,mass\n4,0,0,0,1,,\n9,0,0,-10,0,-20000,1000\n"
HUNG_ELEMENTS = "start,end\n4,9\n"
HUNG = (
    "[cable]\nmodulus = 1.6e11\narea = 100e-6\ndensity = 0.001\n[dynamics]\nduration = {duration}\n"
    "time_step = 2e-4\n{keys}[output]\nprobes = [9]\nelements = [0]\nhistory_interval = 2e-4\n"
)


def test_the_step_is_shorter_by_the_stiffness_of_the_branches(workshop):
    """The stable step is that of elements stiffer by 1 + sum alpha: times 0.964."""
    job = [HUNG.format(keys=keys, duration=0.01) for keys in ("", BAND)]
    results = [workshop.solve(text, HUNG_NODES, HUNG_ELEMENTS) for text in job]
    limits = [f["provenance"].attrs["limit_any_shape"] for f in results]
    stiffer = branch_stiffening(band_branches(0.01, 0.3, 9.0))
    assert limits[1] / limits[0] == pytest.approx(1 / np.sqrt(stiffer), rel=1e-9)
    assert limits[1] / limits[0] == pytest.approx(0.964, abs=0.001)


def test_a_warning_bounds_the_difference_of_the_stored_force_and_the_force_that_acts(workshop):
    """The force that stops the weight exceeds the stored one. The warning bounds the difference."""
    keys = "axial_damping_ratio = 0.02\naxial_damping_band = [1.0, 20.0]\n"
    f = workshop.solve(HUNG.format(keys=keys, duration=0.2), HUNG_NODES, HUNG_ELEMENTS)
    t, z = f["history/time"][:], f["history/probe_displacement"][:, 0, 2]
    carried = 20e3 + 1000.0 * np.gradient(np.gradient(z, t), t)
    written, carried = f["history/probe_tension"][:, 0].max(), carried[3:-3].max()
    bound = branch_stiffening(band_branches(0.02, 1.0, 20.0)) - 1.0
    assert 0.02 < (carried - written) / (written - 20e3) < bound
    start = "warning: [dynamics] axial_damping_ratio = 0.02: vibration in its band and above has"
    assert f"{start} up to 15.1% more" in workshop.info()


def test_a_cable_that_goes_slack_is_never_in_compression_and_balances(workshop):
    """A mass thrown towards the support of its cable, and back into it: both audits hold."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n0,0,0,0,1,1,1,0\n1,0,0,-10,1,1,0,100\n2,0,0,-20,1,1,1,0\n"
    text = BAR.replace('kind = "bar"\n', "")
    text += "prestress = 200.0\n[load]\nself_weight = false\n[[remove]]\nelements = [1]\ntime = 0.02\n"
    text += f"[dynamics]\nduration = 3.0\ntime_step = 2e-4\n{BAND}[output]\nhistory_interval = 0.002\n"
    f = workshop.solve(text, nodes, "id,start,end\n0,0,1\n1,1,2\n")
    h = f["history"]
    assert h["slack"][:].max() == 1
    assert (audits(f) < (1e-10, 1e-3)).all()
    total = h["kinetic_energy"][:] + h["strain_energy"][:] + h["plastic_dissipation"][:]
    assert total[-1] < total[20] and h["band_damping_work"][-1] > 0.0


def test_a_fading_removal_begins_with_the_force_of_the_element(workshop):
    """A mass hangs between two cables, and one fades over 1000 s. It stays at first, with any step."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n0,0,0,0,1,1,1,0\n1,0,0,-10,1,1,0,100\n2,0,0,-20,1,1,1,0\n"
    text = BAR.replace('kind = "bar"\n', "prestress = 200.0\n") + "[load]\nself_weight = false\n"
    text += "[[remove]]\nelements = [1]\ntime = 0.02\nduration = 1000.0\n"
    band = "axial_damping_ratio = 0.1\naxial_damping_band = [0.3, 9.0]\n"
    text += f"[dynamics]\nduration = 0.2\ntime_step = 0.01\n{band}[output]\nprobes = [1]\n"
    f = workshop.solve(text, nodes, "id,start,end\n0,0,1\n1,1,2\n")
    faded = 200.0 * 0.18 / 1000.0  # N at the end
    assert np.abs(f["final/tension"][0] - 200.0) < 2.0 * faded


@pytest.mark.parametrize(
    "keys, message",
    [
        ("axial_damping_ratio = 0.01\n", "axial_damping_band: missing"),
        ("axial_damping_ratio = 0.01\naxial_damping_band = [9.0, 0.3]\n", "the second larger"),
    ],
)
def test_wrong_bands_are_refused(workshop, keys, message):
    """The exit code is 2, and the message names the expected values."""
    text, nodes, elements = oscillators([0.1], "", 1e-4, 0.01)
    done = workshop.solve(text.replace("[dynamics]", "[dynamics]\n" + keys), nodes, elements, code=2)
    assert message in done.stderr


def test_a_string_has_no_damping_of_the_band_across(workshop):
    """Across a string the stiffness is prestress, not stretch."""
    nodes = "id,x,y,z,fixed,mass\n0,0,0,0,1,0\n1,10,0,0,0,100\n2,20,0,0,1,0\n"
    text = BAR.replace('kind = "bar"\n', "prestress = 500.0\n")
    text += f"[dynamics]\nduration = 0.01\n{BAND}[modes]\ncount = 1\n"
    f = workshop.solve(text, nodes, "start,end\n0,1\n1,2\n")
    assert abs(f["modes/band_damping_ratio"][0]) < 1e-9


@pytest.mark.parametrize("ratio", [0.02, 0.2])
def test_the_ratio_of_a_mode_is_that_of_the_motion_with_its_branches(workshop, ratio):
    """Eigenvalues of a mass on a spring N = k x with branches alpha (N - V), V' = (N - V) / tau."""
    frequencies, keys = [2.7, 12.1], f"axial_damping_ratio = {ratio}\naxial_damping_band = [1.0, 20.0]\n"
    text, nodes, elements = oscillators([1.0 / f for f in frequencies], "", 1e-4, 0.01)
    text = text.replace("[dynamics]", "[dynamics]\n" + keys).replace(
        "[output]", "[modes]\ncount = 2\n[output]"
    )
    f = workshop.solve(text, nodes, elements)
    assert 1.0 / f["modes/period"][:] == pytest.approx(frequencies, rel=1e-3)
    (a, b), (s, t) = np.reshape(band_branches(ratio, 1.0, 20.0), (2, -1))
    for computed, period in zip(f["modes/band_damping_ratio"][:], f["modes/period"][:]):
        k = (2 * np.pi / period) ** 2
        system = [[0, 1, 0, 0], [-k * (1 + a + b), 0, a, b], [k / s, 0, -1 / s, 0], [k / t, 0, 0, -1 / t]]
        roots = np.linalg.eigvals(system)
        root = roots[roots.imag.argmax()]
        assert computed == pytest.approx(-root.real / abs(root), rel=1e-9)
