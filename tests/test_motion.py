"""Supports that move, against closed forms and direct integration; both audits close."""

import itertools

import numpy as np
import pytest
from conftest import STEEL, run_on_standing_ranks
from nets import table

from netfall.core.errors import InputError
from netfall.explicit.history import energy_in_play
from netfall.loads.base_motion import read_at2

EA, HALF = 1.95e11 * 683.08e-6, 0.5 * 7850.0 * 683.08e-6  # N; kg for each metre
# two supports and a node between them
SPAN = "id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,10,0,0,0,50\n3,20,0,0,1,\n", "start,end\n1,2\n2,3\n"
BAR = '[cable]\nkind = "bar"\nmodulus = 1e9\narea = 1e-4\ndensity = 1e-3\n'


def closes(f):
    """Both audits; the balance once there is some energy that its error could be a share of."""
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-10
    balanced = f["history/energy_balance_error"][:]
    assert np.abs(balanced[len(balanced) // 4 :]).max() < 1e-4


LOADS = [("steps = 0", "", True), ("steps = 1", "", False), ("", 'loads = "permanent"', False)]


@pytest.mark.parametrize("load, form, is_sudden", LOADS)
def test_loads_that_act_at_once_as_supports_begin_to_move_are_a_warning(workshop, load, form, is_sudden):
    """The weight of the cables: in a load step, in the form, or in neither."""
    text = f'{STEEL}[form_finding]\n{form}\n[load]\n{load}\n[[motion]]\ndisplacement = "move.csv"\n'
    job = workshop.job(text + "[dynamics]\nduration = 1.0\n", *SPAN)
    (job.parent / "move.csv").write_text("time,x\n0,0\n1,0.1\n")
    assert ("[[motion]]: the loads act at once" in run_on_standing_ranks("check", job).stdout) == is_sudden


@pytest.mark.parametrize("damping", [0.0, 0.8])
def test_all_supports_at_one_velocity_leave_the_tensions_as_at_rest(workshop, damping):
    """Galilei: a net that moves with its supports feels nothing; to rounding."""
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,10,0,0,0,50\n3,20,1,0,0,20\n4,30,0,3,1,\n"
    text = STEEL + '[group.idle]\nkind = "bar"\narea = 1e-8\nprestress = 0.0\n[form_finding]\n[dynamics]\n'
    text += f"duration = 0.5\ntime_step = 5e-4\nmass_damping = {damping}\n[output]\nhistory_interval = 0.01\n"
    motion = '[[motion]]\ndisplacement = "move.csv"\n'
    job = workshop.job(text + motion, nodes, "start,end,group\n1,2,\n2,3,\n3,4,\n1,4,idle\n")
    (job.parent / "move.csv").write_text("time,x,y,z\n0,0,0,0\n1,2.0,-1.0,0.5\n")
    f = workshop.run(job)
    job.write_text(job.read_text().replace(motion, ""))
    still = workshop.run(job, output="still.vtkhdf")
    # rounding of the place, times EA / L
    assert np.allclose(f["final/tension"][:], still["final/tension"][:], rtol=1e-9)
    moved = f["final/position"][:] - still["final/position"][:]
    assert np.allclose(moved, [1.0, -0.5, 0.25], atol=1e-11)
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-10


def test_the_support_that_damps_does_not_depend_on_order_or_rounding(workshop):
    """A mass midway between a support at rest and one that moves, a hundredth of a rounding error off."""
    supports, results = ["1,-0.7,0,0,1,0", "3,0.7,0,0,1,0"], []
    (workshop.folder / "move.csv").write_text("time,x\n0,0\n1,0.001\n")
    text = BAR + '[load]\nself_weight = false\n[[motion]]\nnodes = [3]\ndisplacement = "move.csv"\n'
    text += "[dynamics]\nduration = 0.05\ntime_step = 1e-4\nmass_damping = 50.0\n"
    for order, place in itertools.product((1, -1), (1e-16, -1e-16)):
        nodes = [*supports[::order], f"2,{place},0,0,0,100"]
        job = workshop.job(text, "id,x,y,z,fixed,mass\n" + "\n".join(nodes) + "\n", "start,end\n1,2\n2,3\n")
        results.append(workshop.run(job)["history/damping_work"][-1])
    assert np.ptp(results) <= 1e-9 * abs(results[0])


@pytest.mark.parametrize("air", [0.0, 40.0])
def test_a_net_that_moves_with_its_supports_breaks_at_the_same_end(workshop, air):
    """The larger of 15 and 10 kN at its ends decides in any moving frame, with any damping and air."""
    nodes = "id,x,y,z,fixed,mass,load_x,area\n1,0,0,0,1,,,0\n2,10,0,0,0,50,-20000,0\n"
    nodes += "3,20,0,0,0,50,25000,1\n4,30,0,0,1,,,0\n"
    text = BAR.replace("1e9", "2e9") + "[group.weak]\nfracture_strain = 0.05\n"
    text += f"[load]\nself_weight = false\nadded_mass = {air}\n[dynamics]\nduration = 0.1\ntime_step = 1e-4\n"
    text += 'mass_damping = 4.0\n[[motion]]\ndisplacement = "move.csv"\n'
    job = workshop.job(text, nodes, "start,end,group\n1,2,a\n2,3,weak\n3,4,a\n")
    ends = []
    for displacement in (0.0, -100.0):
        (job.parent / "move.csv").write_text(f"time,x,y,z\n0,0,0,0\n1,{displacement},0,0\n")
        ends.append(workshop.run(job)["events/node_id"][:].tolist())
    assert ends == [[3], [3]]


def oscillators(periods, extra, step, duration):
    """Masses of 100 kg that move along x alone, each on a bar of its own to a support."""
    nodes, elements = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n", "start,end,modulus\n"
    for k, period in enumerate(periods):
        nodes += f"{2 * k},0,{5 * k},0,1,1,1,0\n{2 * k + 1},10,{5 * k},0,0,1,1,100.0\n"
        stiffness = (100.0 + 0.5e-6) * (2 * np.pi / period) ** 2
        elements += f"{2 * k},{2 * k + 1},{stiffness * 10.0 / 1e-4!r}\n"
    text = BAR + extra + f"[dynamics]\nduration = {duration}\ntime_step = {step}\n"
    probes = [2 * k + 1 for k in range(len(periods))]
    return text + f"[output]\nhistory_interval = {max(step, 0.005)}\nprobes = {probes}\n", nodes, elements


def made_record():
    """Accelerations [g], 400 every 10 ms, of a made earthquake that ends at rest, nearly."""
    t = 0.01 * np.arange(400)
    rng = np.random.default_rng(3)
    waves = zip(rng.uniform(0.5, 8.0, 30), rng.uniform(0, 6, 30))
    a = sum(rng.uniform(0.5, 1.0) * np.sin(2 * np.pi * f * t + p) for f, p in waves)
    return 0.05 * a * np.sin(np.pi * t / t[-1]) ** 2


def spectral_acceleration(a, period, ratio):
    """Largest |w^2 u| of u'' + 2 ratio w u' + w^2 u = -a, exact for a linear in each of 40 parts of 10 ms."""
    from scipy.linalg import expm

    w, h = 2 * np.pi / period, 0.01 / 40
    A = np.zeros((4, 4))
    A[0, 1], A[1], A[2, 3] = 1.0, [-(w**2), -2 * ratio * w, -1.0, 0.0], 1.0
    step, most = expm(A * h), 0.0
    state = np.zeros(2)
    for first, last in itertools.pairwise(a):
        slope = (last - first) / 0.01
        for k in range(40):
            state = (step @ [*state, first + slope * k * h, slope])[:2]
            most = max(most, abs(w**2 * state[0]))
    return most


def test_the_spectrum_of_a_record_is_that_of_a_direct_integration(workshop):
    """Five oscillators on the ground of a record (.AT2), damped against the ground: S_a(T) to 1e-4."""
    a = made_record()
    periods, zeta = [0.2, 0.3, 0.5, 0.8, 1.3], 0.4
    extra = '[[motion]]\nacceleration = "quake.AT2"\ndirection = [1.0, 0.0, 0.0]\nbaseline = false\n'
    text, nodes, elements = oscillators(periods, extra, 5e-4, 4.0)
    text = text.replace("history_interval = 0.005", "history_interval = 5e-4")
    text = text.replace("[dynamics]", f"[dynamics]\nmass_damping = {zeta}")
    job = workshop.job(text, nodes, elements)
    head = "PEER NGA STRONG MOTION DATABASE RECORD\nmade\nACCELERATION TIME SERIES IN UNITS OF G\n"
    lines = "\n".join(" ".join(f"{v:.10E}" for v in a[k : k + 5]) for k in range(0, len(a), 5))
    (job.parent / "quake.AT2").write_text(f"{head}NPTS= {len(a)}, DT= .0100 SEC\n{lines}\n")
    f = workshop.run(job)
    output = run_on_standing_ranks("check", job).stdout
    assert f"note: [[motion]] 1: accelerations of up to {9.81 * np.abs(a).max():.3g} m/s2. Integr" in output
    most = np.maximum(f["envelope/tension_max"][:], -f["envelope/tension_min"][:]) / (100.0 + 0.5e-6)
    for k, period in enumerate(periods):
        expected = spectral_acceleration(9.81 * a, period, zeta * period / (4 * np.pi))
        assert most[k] == pytest.approx(expected, rel=1e-4), period
    closes(f)


def test_the_size_of_a_motion_is_its_length_in_space(workshop):
    """2 m/s2 for 1 s along (2, 1, 2) / 3: 1 m and 2 m/s. The baseline correction of a record removes them."""
    extra = '[[motion]]\nacceleration = "{}"\ndirection = [2.0, 1.0, 2.0]\n'
    extra = extra.format("a.csv") + extra.format("a.AT2") + '[[motion]]\ndisplacement = "d.csv"\n'
    job = workshop.job(*oscillators([0.5], extra, 1e-3, 1.0))
    (job.parent / "a.csv").write_text("time,acceleration\n0,2\n1,2\n")
    g = 2.0 / 9.81
    (job.parent / "a.AT2").write_text(f"\n\nIN UNITS OF G\nNPTS= 3, DT= 0.5 SEC\n{g} {g} {g}\n")
    (job.parent / "d.csv").write_text("time,x,y\n0,0,0\n1,4,4\n")
    output = run_on_standing_ranks("check", job).stdout
    for line in (
        "1: accelerations of up to 2 m/s2. Integrated displacements: up to 1 m, 1 m after 1 s "
        "with a velocity of 2 m/s",
        "2: the baseline correction changes accelerations by at most 2 m/s2",
        "3: d.csv: displacements of up to 5.657 m (plausible: up to 5 m)",
    ):
        assert f"[[motion]] {line}" in output, output


def test_a_support_that_settles_ends_as_a_net_built_so(workshop):
    elements = "start,end,unstressed_length\n1,2,9.99\n2,3,9.99\n"
    text = STEEL + "[dynamics]\nduration = 3.0\ntime_step = 1e-4\nmass_damping = 20.0\n"
    text += '[output]\nhistory_interval = 0.05\n[[motion]]\nnodes = [3]\ndisplacement = "move.csv"\n'
    job = workshop.job(text, SPAN[0], elements)
    (job.parent / "move.csv").write_text("time,z\n0,0\n0.5,-0.1\n")
    f = workshop.run(job, output="moved.vtkhdf")
    assert f["final/position"][2] == pytest.approx([20.0, 0.0, -0.1], abs=1e-12)
    length = np.hypot(20.0, 0.1)
    expected = EA * (length / 19.98 - 1.0)
    assert f["final/tension"][:] == pytest.approx(expected, rel=1e-6)
    closes(f)
    assert "Check the unit" not in run_on_standing_ranks("check", job).stdout
    (job.parent / "move.csv").write_text("time,z\n0,0\n0.5,-100\n")
    line = "warning: [[motion]] 1: move.csv: displacements of up to 100 m (plausible: up to 5 m). Check the"
    assert line in run_on_standing_ranks("check", job).stdout


def test_a_pulse_travels_along_a_string_and_a_wave_over_its_supports(workshop):
    """The pulse is at x after x / c, c = sqrt(N / mass per metre); the wave travels at its own speed."""
    n, N, mass, span = 240, 100e3, 2 * HALF, 60.0
    c = np.sqrt(N / mass)
    nodes = table("id,x,y,z,fixed", ((k, 0.25 * k, 0, 0, int(k in (0, n))) for k in range(n + 1)))
    elements = table("start,end", ((k, k + 1) for k in range(n)))
    text = STEEL + '[[motion]]\ndisplacement = "pulse.csv"\ntravel = [2.0, 0.0, 0.0]\n'
    text += f"speed = {span / 0.35}\n[dynamics]\nduration = 0.4\n"
    text += "[output]\nhistory_interval = 0.002\nprobes = [0, 80, 240]\n"
    job = workshop.job(text, nodes, elements)
    t = np.linspace(0.0, 0.1, 201)
    shape = lambda s: 0.001 * np.where((s > 0) & (s < 0.1), np.sin(np.pi * s / 0.1) ** 2, 0.0)
    (job.parent / "pulse.csv").write_text(table("time,z", zip(t, shape(t))))
    f = workshop.run(job)
    t = f["history/time"][:]
    z = f["history/probe_displacement"][:, :, 2]
    assert np.abs(z[:, 0] - shape(t)).max() < 1e-6
    assert np.abs(z[:, 2] - shape(t - 0.35)).max() < 1e-6
    before = t < (20 + span) / c  # until the echo
    assert np.abs(z[before, 1] - shape(t - 20 / c)[before]).max() < 1e-5  # dispersion of the lumped string
    closes(f)


@pytest.mark.parametrize("nodes, warned", [("nodes = [2]\n", True), ("", False)])
def test_a_motion_along_a_free_axis_is_a_warning(workshop, nodes, warned):
    """Node 2 can slide along x, so the x of its table moves nothing; node 1 is held along all axes."""
    text = f'{BAR}[[motion]]\n{nodes}displacement = "move.csv"\n[dynamics]\nduration = 0.01\n'
    guided = "id,x,y,z,fixed_x,fixed_y,fixed_z\n1,0,0,0,1,1,1\n2,5,0,0,0,1,1\n"
    job = workshop.job(text, guided, "start,end\n1,2\n")
    (job.parent / "move.csv").write_text("time,x,y,z\n0,0,0,0\n1,0.1,0,0.1\n")
    line = "warning: [[motion]] 1: x: no effect: no support of the entry is held along it. Hold"
    assert (line in workshop.check(job)) == warned


def test_a_node_that_a_stage_holds_can_be_moved(workshop):
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,10,0,0,0,50\n3,20,0,0,0,50\n4,30,0,0,1,\n"
    text = STEEL + "[dynamics]\nduration = 0.1\n"
    text += "[output]\nprobes = [2]\n[[motion]]\nnodes = [2]\ndisplacement = 'm.csv'\n"
    job = workshop.job(text + '[[stage]]\nname = "grip"\nhold = [2]\n', nodes, "start,end\n1,2\n2,3\n3,4\n")
    (job.parent / "m.csv").write_text("time,z\n0,0\n0.1,0.01\n")
    with workshop.run(job) as f:
        assert f["history/probe_displacement"][-1, 0] == pytest.approx([0.0, 0.0, 0.01], abs=1e-12)
    job.write_text(job.read_text() + '[[stage]]\nname = "let go"\nrelease = [2]\n')
    assert "[E302]" in workshop.run(job, output="none.vtkhdf", code=2).stderr


@pytest.mark.parametrize(
    "entry, message",
    [
        ("displacement = 'm.csv'\nacceleration = 'm.csv'\n", "exclude each other"),
        ("nodes = [2]\ndisplacement = 'm.csv'\n", "2: free along all axes"),
        ("nodes = [9]\ndisplacement = 'm.csv'\n", "the net has no node 9"),
        ("displacement = 'late.csv'\n", "expected 0. Displacements count"),
        ("displacement = 'm.csv'\nspeed = 100.0\n", "travel: missing"),
        ("acceleration = 'bad.AT2'\n", "direction: missing"),
        ("acceleration = 'm.csv'\nbaseline = true\n", "a table is used as it is"),
        ("acceleration = 'bad.AT2'\ndirection = [1.0, 0.0, 0.0]\n", "NPTS = 3"),
        (
            "acceleration = 'volts.AT2'\ndirection = [1.0, 0.0, 0.0]\n",
            "no header line has the words UNITS OF G",
        ),
    ],
)
def test_wrong_motions_are_refused(workshop, entry, message):
    """The exit code is 2, a line names the expected value, and there is no result."""
    job = workshop.job(f"{STEEL}[dynamics]\nduration = 0.1\n[[motion]]\n{entry}", *SPAN)
    (job.parent / "m.csv").write_text("time,x\n0,0\n1,1\n")
    (job.parent / "late.csv").write_text("time,x\n0,0.5\n1,1\n")
    (job.parent / "bad.AT2").write_text("a\nb\nc\nNPTS= 3, DT= .01 SEC\n0.1 0.2\n")
    head = "ACCELERATION TIME SERIES IN UNITS OF VOLTS"
    (job.parent / "volts.AT2").write_text(f"a\nb\n{head}\nNPTS= 3, DT= .01 SEC\n10 20 30\n")
    done = workshop.run(job, code=2)
    assert message in done.stderr and "Traceback" not in done.stderr


def test_the_first_steps_of_a_slow_motion_have_a_small_balance_error(workshop):
    """A weight follows its support, whose acceleration grows from 0: n steps later, 1 / n^2 of the work.

    Errors of later steps are relative to the energy so far, though it grows as t^4.
    """
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,0,0,-10,0,1000\n"
    text = BAR + "[load]\nsteps = 1\n[[motion]]\nacceleration = 'm.csv'\n"
    text += "[dynamics]\nduration = 0.2\ntime_step = 1e-3\n[output]\nhistory_interval = 1e-3\n"
    job = workshop.job(text, nodes, "start,end\n1,2\n")
    (job.parent / "m.csv").write_text("time,z\n0,0\n1,50\n")
    with workshop.run(job) as f:
        h = {name: column[:] for name, column in f["history"].items() if column.ndim == 1}
    assert np.abs(h["energy_balance_error"]).max() < 1e-3
    balance = h["kinetic_energy"] + h["strain_energy"] - h["external_work"] - h["support_work"]
    largest = np.maximum.accumulate(energy_in_play(h))
    assert np.allclose(h["energy_balance_error"][100:] * largest[100:], balance[100:], atol=1e-9)


@pytest.mark.parametrize(("before", "is_warned"), [(0.5, True), (0.0, False)])
def test_accelerations_before_time_zero_are_warned_of(workshop, before, is_warned):
    text = STEEL + "[form_finding]\n[dynamics]\nduration = 0.1\n[[motion]]\nacceleration = 'm.csv'\n"
    job = workshop.job(text, *SPAN)
    (job.parent / "m.csv").write_text(f"time,x\n-1,{before}\n0,0\n1,1\n")
    assert ("[[motion]] 1: m.csv: the accelerations before time 0" in workshop.check(job)) == is_warned


@pytest.mark.parametrize("words", ["ACCELERATION IN CM/S2", "LARGEST 0.3 G", "UNITS OF %G", "UNITS OF CM/S"])
def test_a_record_must_be_in_g(tmp_path, words):
    """The unit of PEER; other units and heads without a unit are refused."""
    record = tmp_path / "record.AT2"
    for line in ("ACCELERATION TIME SERIES IN UNITS OF G", words):
        record.write_text(f"made\n{line}\nby hand\nNPTS= 3, DT= .01 SEC\n0 10 20\n")
        if line != words:
            time, a = read_at2(record)
            assert (time.tolist(), a.tolist()) == ([0.0, 0.01, 0.02], [0.0, 10.0, 20.0])
        else:
            with pytest.raises(InputError, match="UNITS OF G, the unit of PEER"):
                read_at2(record)


RIM = """[cable]
modulus = 1.6e11
area = 1e-4
density = 7850.0
prestress = 1e4
[[stage]]
name = "rise"
move = {1 = [0, 0, 0.05], 2 = [0, 0, 0.05]}
[[stage]]
name = "let go"
release = [2]
[[case]]
name = "sunk"
settlement = {3 = [0, 0, -0.05], 4 = [0, 0, -0.05]}
[dynamics]
duration = 0.2
[output]
frames = 4
[[motion]]
nodes = [3, 4]
displacement = "course.csv"
"""


@pytest.mark.parametrize("parts", [1, 3])
def test_a_rim_moves_with_its_supports_in_any_number_of_parts(workshop, parts):
    """10 m x 10 m around a tent of 2 m: a rim whose ends move alike keeps its 10 kN, one of which one moves
    by 50 mm has EA (sqrt(100.0025) / L0 - 1) in all its parts, and one of which one end is let go is slack.
    """
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,10,10,0,1\n4,0,10,0,1\n5,5,5,2,0\n"
    pairs = ((1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5), (4, 5))
    elements = "id,start,end\n" + "".join(f"{k},{a},{b}\n" for k, (a, b) in enumerate(pairs))
    job = workshop.job(RIM, nodes, elements)
    (workshop.folder / "course.csv").write_text("time,z\n0,0\n0.1,0.02\n")
    f = workshop.run(job, "--set", f"net.subdivide={parts}")
    of_rim = lambda place: f[place + "/tension"][:].reshape(-1, parts)[:4]
    EA, L0 = 1.6e7, 10.0 / (1.0 + 1e4 / 1.6e7)
    pulled = lambda rise: EA * (np.sqrt(100.0 + rise * rise) / L0 - 1.0)
    for place, forces in {
        "stages/rise": (1e4, pulled(0.05), 1e4, pulled(0.05)),
        "stages/let go": (0.0, 0.0, 1e4, pulled(0.05)),
        "cases/sunk": (0.0, 0.0, 1e4, pulled(0.1)),
    }.items():
        assert of_rim(place) == pytest.approx(np.repeat(forces, parts).reshape(4, parts), rel=1e-6, abs=1e-3)
    assert f["final/tension"][:].reshape(-1, parts)[2] == pytest.approx([1e4] * parts, rel=1e-9)
    notes = f["provenance/notes"].asstr()[()]
    assert ("4 elements (0, 1, 2, 3) between two fixed nodes: the new nodes" in notes) == (parts > 1)
    assert ("element 3 between a support that moves and one that does not" in notes) == (parts > 1)


def test_a_support_that_starts_with_a_velocity_keeps_the_energy_balance(workshop):
    """One of two supports moves at 0.1 m/s from t = 0: its force in the first step does work over v dt."""
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,10,0,0,0,50\n3,20,1,0,0,20\n4,30,0,3,1,\n"
    text = STEEL + '[form_finding]\n[[motion]]\nnodes = [1]\ndisplacement = "move.csv"\n'
    text += "[dynamics]\nduration = 0.05\ntime_step = 1e-4\n[output]\nhistory_interval = 1e-4\n"
    job = workshop.job(text, nodes, "start,end\n1,2\n2,3\n3,4\n")
    (job.parent / "move.csv").write_text("time,x,y,z\n0,0,0,0\n1,-0.1,0,0\n")
    with workshop.run(job) as f:
        assert np.abs(f["history/energy_balance_error"][:]).max() < 1e-5
        assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12
        work = np.diff(f["history/support_work"][:2])[0]
        assert work == pytest.approx(f["form_finding/tension"][0] * 0.1 * 1e-4, rel=2e-2)
