"""Member removal: hand calculations, energies, equal bits, and the printed lines."""

import re
import shutil
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import StopAfter, assert_same_results, audits, error_lines, run_on_standing_ranks
from nets import saddle
from results import rows_of
from test_validation_opensees import (
    SADDLE,
    compare_histories,
    compare_states,
    make_case,
    reference,
    shipped,
    vertical,
)

from netfall.core.errors import Interrupted
from netfall.core.messages import is_warning, mm
from netfall.driver.removal import members
from netfall.driver.removal.equilibria import removed_names
from netfall.driver.reporting.run import _dynamics_lines
from netfall.driver.statics.equilibrium import solve_equilibrium
from netfall.job.read import read_job
from netfall.job.values import counted
from netfall.loads.removal import superposed_excitation_notes
from netfall.model.layout import make_layout
from netfall.post.report.info import _fractures
from netfall.post.report.report import write_report
from netfall.results.removals import largest_after_removals, removal_lines, significant_dynamic_factors
from netfall.results.states import described_removals

EA, L0, MASS, WEIGHT = 1.6e7, 10.0, 1000.0, 1e4  # N, m, kg, N

CABLE = """
[cable]
modulus = 1.6e11
area = 1e-4
density = 100.0
[load]
self_weight = false
tolerance = 1e-10
"""
HALF_CABLE = 0.5 * 100.0 * 1e-4 * L0  # kg
PERIOD = float(2 * np.pi * np.sqrt((MASS + 2 * HALF_CABLE) * L0 / EA))  # of the weight on one cable


def weights(count):
    """Return tables of weights on two vertical cables each (linear): elements 2 i and 2 i + 1 of weight i."""
    nodes, elements = ["id, x, y, z, fixed, mass, load_z"], ["id, start, end, unstressed_length"]
    for i in range(count):
        nodes += [f"{3 * i + k}, {5.0 * i}, 0, 0, 1, 0, 0" for k in range(2)]
        nodes.append(f"{3 * i + 2}, {5.0 * i}, 0, {-L0}, 0, {MASS}, {-WEIGHT}")
        elements += [f"{2 * i + k}, {3 * i + k}, {3 * i + 2}, {L0}" for k in range(2)]
    return "\n".join(nodes), "\n".join(elements)


def entry(elements, time, duration=0.0):
    return f"[[remove]]\nelements = {elements}\ntime = {time}\nduration = {duration!r}\n"


def dynamics(duration, steps, history=1e-2, more=""):
    """Return a dynamic stage with a number of steps in a period."""
    text = f"[dynamics]\nduration = {duration!r}\ntime_step = {PERIOD / steps!r}\n{more}"
    return f"{text}[output]\nframes = 1\nhistory_interval = {history}\n"


def test_a_fading_tension_moves_the_weight_as_in_closed_form(both_ways):
    """One of two cables is removed over d: the factor is 1 + abs(sin(pi d / T)) / (pi d / T), for d of 0 to 5
    periods T. m y'' + k y = W/2 t/d: after d the amplitude is that of sin(pi d / T) / (pi d / T).
    """
    shares = [1e-6, 0.1, 0.25, 0.5, 0.8, 1.0, 1.5, 2.0, 2.5, 3.3, 4.5, 5.0]
    nodes, elements = weights(len(shares))
    steps = 400
    text = CABLE + dynamics(8 * PERIOD, steps)
    text += "".join(entry([2 * i], 0.5 * PERIOD, s * PERIOD) for i, s in enumerate(shares))
    result = both_ways.solve(text, nodes, elements)
    before, after, peak = (result[f"removal/tension_{of}"][:] for of in ("before", "after", "peak"))
    factor = result["removal/dynamic_factor"][:]
    middles = np.arange(1, 2 * len(shares), 2)
    assert before[0, middles] == pytest.approx(WEIGHT / 2, rel=1e-9)  # 1e-10 of the load, in equilibrium
    assert after[0, middles] == pytest.approx(WEIGHT, rel=1e-9)
    assert (after[0, middles - 1] == 0).all() and np.isnan(peak[:, middles - 1]).all()
    turns = np.pi * np.array(shares)
    exact = 1 + np.abs(np.sin(turns)) / turns
    # the step rounds the peak down by up to (2 pi / 400)^2 / 8 = 3e-5, stretches the period by a third of
    # that, and rounds the start
    assert factor[0, middles] == pytest.approx(exact, abs=1e-4)
    assert (factor[:, middles] == factor[0, middles]).all() and np.isnan(factor[:, middles - 1]).all()
    # the step's own energy error, (2 pi / 400)^2 / 4, of energies that are as large as what takes part
    assert (audits(result) < (1e-13, 1e-4)).all()  # rounding


def test_a_sudden_removal_doubles_the_static_displacement(both_ways):
    """The peak is 3/2 W by energy, the static force W, the factor 2. Removed strain energy is dissipated."""
    steps = 1000
    text = CABLE + dynamics(2 * PERIOD, steps) + entry([0], 0.1 * PERIOD)
    nodes, elements = weights(1)
    result = both_ways.solve(text, nodes, elements)
    peak, factor = result["removal/tension_peak"][0], result["removal/dynamic_factor"][0]
    # of a peak between two steps, and of the first one at half a kick
    rounding = (2 * np.pi / steps) ** 2 / 4
    assert peak[1] == pytest.approx(1.5 * WEIGHT, rel=rounding)
    assert factor[1] == pytest.approx(2, abs=rounding)
    assert result["removal/element"][:].tolist() == [0] and result["removal/entry"][:].tolist() == [0]
    stored = 0.5 * (WEIGHT / 2) ** 2 * L0 / EA
    assert result["history/plastic_dissipation"][-1] == pytest.approx(stored, rel=1e-9)  # at rest to 1e-10
    assert (audits(result) < (1e-13, 4 * rounding)).all()  # rounding
    assert result["history/slack"][-1] == 0 and result["history/broken"][-1] == 0
    assert result["VTKHDF/CellData/broken"][-2:].tolist() == [1, 0]
    assert result["events/time"].shape == (0,)
    assert result["initial_state/tension"][:] == pytest.approx([5e3] * 2)


@pytest.mark.parametrize("duration", [0.0, 1e-6, 0.3])
@pytest.mark.parametrize("time", [0.25, 0.225])
def test_the_motion_after_a_removal_is_of_second_order_in_the_step(workshop, time, duration):
    """m y'' + k y = -W / 2 of what has faded, from the time that is asked for: on a step, and between two.

    y is that of a constant force from then on, averaged over the duration d, in closed form. In steps a third
    as long the times are as far from the next step.
    """
    w, t, d = 2.0 * np.pi / PERIOD, 0.9, duration
    exact = -0.5 * WEIGHT * L0 / EA * (1.0 - np.cos(w * (t - time) * PERIOD))
    if d:
        later = np.sin(w * (t - time) * PERIOD) - np.sin(w * (t - time - d) * PERIOD)
        exact = -0.5 * WEIGHT * L0 / EA * (1.0 - later / (w * d * PERIOD))
    errors = []
    for steps in (20, 60, 180):
        text = CABLE + dynamics(t * PERIOD, steps, t * PERIOD / 9, "mass_damping = 0.0\n")
        text += "probes = [2]\n" + entry([0], time * PERIOD, d * PERIOD)
        f = workshop.solve(text, *weights(1))
        y = f["history/probe_displacement"][:, 0, 2]
        errors.append(y[-1] - y[0] - exact)
        assert np.abs(f["history/work_identity_error"][:]).max() < 1e-13  # rounding
    size = WEIGHT * L0 / EA
    assert errors[0] / errors[1] == pytest.approx(9.0, rel=0.2)  # the error is of fourth order
    assert errors[1] / errors[2] == pytest.approx(9.0, rel=0.02)
    assert abs(errors[0]) < (2.0 * np.pi / 20) ** 2 * size  # of the scheme: (w dt)^2 / 24 w t, and the start


def breaking(strain: float) -> str:
    """Return the text of a job of a roof that yields, and breaks at a strain."""
    limits = f"yield_stress = 4.5e8\nfracture_strain = {strain}\n"
    return saddle(limits, parts=2) + "[load]\nself_weight = true\n"


# removals: some elements, then one, then a whole cable
LOSSES = entry([20, 21, 22], 0.1, 0.08) + entry([40], 0.15)
LOSSES += entry([], 0.25, 0.1).replace("elements = []", 'cables = ["e4"]')
GUSTS = """[wind]
speed = {}
pressure_coefficient = -0.3
base_height = 10.0
gust_field = "point"
surface_drag = 0.02
seed = 3
{}
[dynamics]
duration = 0.44
mass_damping = 0.2
"""
TORN = breaking(0.005) + GUSTS.format(35.0, "ramp = 0.0") + LOSSES
TORN += "[output]\nhistory_interval = 0.005\nframes = 88\n"
TORN += "probes = [[0.0, 0.0], 15, [10.0, 6.0, 2.0]]\nelements = [40, 20, 33]\n"
LOOKS = 80  # that each of many runs is given: one rest takes some 20


@pytest.fixture(scope="module")
def torn(shared_workshop):
    """Return a net in the wind after three removals, of elements and a cable; others break and yield."""
    return shared_workshop.solve(TORN, name="torn", output="torn.vtkhdf")


def test_a_pause_in_the_search_for_the_damaged_equilibrium_changes_no_bit(workshop, monkeypatch):
    """The pause falls between two removals, whose equilibria precede the dynamic stage."""
    stop, losses = SimpleNamespace(is_set=False), []

    def pausing(scene, each, *arguments, **options):
        losses.extend([each.title] * (each.kind == "removal"))
        stop.is_set = len(losses) == 2
        return solve_equilibrium(scene, each, *arguments, **options)

    text = CABLE + dynamics(PERIOD, 400) + entry([0], 0.1, 0.01) + entry([3], 0.11) + entry([5], 0.12)
    job = workshop.job(text, *weights(3))
    whole = workshop.run(job, output="whole.vtkhdf")
    assert np.isfinite(whole["removal/tension_after"][:]).all()
    monkeypatch.setattr("netfall.driver.removal.equilibria.solve_equilibrium", pausing)
    workshop.assert_pause_changes_no_bit(job, stop, "in statics, the net without element 3", whole)


def test_repeatedly_interrupted_damaged_equilibria_end(workshop, torn):
    """Each run resumes the last one, at the first equilibrium or at the interrupted step."""
    job, restart, places = workshop.job(TORN), None, []
    while True:
        try:
            again = workshop.run_here(job, restart=restart, stop=StopAfter(LOOKS))
        except Interrupted as interrupted:
            places.append(str(interrupted).split(";")[0])
            assert len(places) < 30
            restart = max(workshop.folder.glob("result.checkpoint*"))  # as a script selects the last by name
        else:
            break
    assert any("without" in where for where in places)
    assert_same_results(torn, again)


def test_displacements_of_the_equilibrium_after_a_removal_are_given(both_ways):
    """A weight on one of two cables sinks from W L / 2 EA to W L / EA; a removed node has no displacement."""
    nodes, elements = weights(1)
    nodes += "\n3, 8, 0, 0, 1, 0, 0\n4, 18, 0, 0, 0, 1000, -100\n5, 28, 0, 0, 1, 0, 0"
    elements += "\n2, 3, 4, 10\n3, 4, 5, 10"
    text = CABLE + dynamics(0.2, 400) + entry([0], 0.1) + entry([2, 3], 0.15)
    result = both_ways.solve(text, nodes, elements)
    after = result["removal/displacement_after"][:]
    sunk = WEIGHT * L0 / EA
    assert after[:, 2] == pytest.approx(np.array([[0, 0, -sunk]] * 2), rel=1e-9, abs=1e-12)
    assert np.isfinite(after[0]).all() and np.isnan(after[1, 4]).all() and np.isfinite(after[1, :4]).all()
    _, second = described_removals(result)
    assert f"equilibrium {mm(sunk)} (node 2), by removals so far {mm(sunk / 2)} (node 2); " in second
    shutil.copy(both_ways.folder / "result.vtkhdf", copied := both_ways.folder / "copied.vtkhdf")
    with h5py.File(copied, "r+") as f:  # a removal that moves nothing, with rounding errors
        f["initial_state/position"][:] = f["net/particles"][:] + after[1] - 1e-15
        assert f"{mm(sunk)} (node 2), by removals so far 0 mm" in described_removals(f)[1]
    write_report(both_ways.folder / "result.vtkhdf", folder := both_ways.folder / "report")
    row = (folder / "displacements.csv").read_text().splitlines()[3].split(",")
    assert float(row[8]) == pytest.approx(sunk, rel=1e-9)  # equilibrium after removal 1


def test_results_of_earlier_versions_are_reported_without_displacements_after_removals(workshop):
    """Version 0.5.0 does not write them."""
    workshop.solve(CABLE + dynamics(0.2, 100) + entry([0], 0.1), *weights(1)).close()
    with h5py.File(path := workshop.folder / "result.vtkhdf", "r+") as f:
        del f["removal/displacement_after"]
        (line,) = described_removals(f)
    assert "nothing broke afterwards; largest tension over tension before" in line
    write_report(path, folder := workshop.folder / "report")
    assert "after removal" not in (folder / "displacements.csv").read_text()


def test_a_removed_element_leaves_with_its_unsupported_nodes(torn):
    """Its tension is 0 and it is not a fracture. Nodes inside it do not move afterwards."""
    ids, lost = torn["net/element_id"][:], torn["removal/element"][:]
    entry = torn["removal/entry"][:]
    assert set(ids[lost[entry == 0]]) == {20, 21, 22} and set(ids[lost[entry == 1]]) == {40}
    cable = torn["net/cable"][:]
    assert (cable[lost[entry == 2]] == cable[ids == 4][0]).all() and (entry == 2).sum() > 4
    assert torn["removal/time"][:] == pytest.approx([0.1, 0.15, 0.25], abs=3e-4)  # a step
    assert (torn["final/tension"][:][lost] == 0).all()
    removed = dict(zip(lost.tolist(), torn["removal/time"][:][entry].tolist()))
    assert all(t < removed.get(e, 1.0) for e, t in zip(torn["events/element"][:], torn["events/time"][:]))
    inner = np.intersect1d(*torn["net/elements"][:][ids == 40])  # between the two halves
    assert (torn["final/velocity"][:][inner] == 0).all()
    each_damaged_equilibrium_exceeds_strengths(torn)
    extremes_contain_all_rows(torn)
    assert np.abs(torn["history/work_identity_error"][:]).max() < 1e-12  # rounding, of fragments that whip
    assert torn["history/plastic_dissipation"][-1] > 0


def each_damaged_equilibrium_exceeds_strengths(torn):
    """The named elements, and only these, have tensions above their strength in that equilibrium."""
    g = torn["removal"]
    assert g["state"].asstr()[:].tolist() == ["breaks"] * 3 and np.isfinite(g["tension_after"][:]).all()
    yield_force = 4.5e8 * 400e-6  # reached at a strain of 0.0023, below that at which they break
    for k in range(3):
        breaking = g["breaking_element"][:][g["breaking_entry"][:] == k]
        at_rest = g["tension_after"][k]
        assert len(breaking) and at_rest[breaking] == pytest.approx(yield_force, rel=1e-9)  # rounding
        assert at_rest.max() <= yield_force * (1 + 1e-9)
    (line, *_) = removal_lines(g, torn["events"], torn["net/element_id"][:])
    ids = torn["net/element_id"][:][g["breaking_element"][:][g["breaking_entry"][:] == 0]]
    assert f"strengths are exceeded: {counted('element', ids)}; " in line


def extremes_contain_all_rows(torn):
    """The extremes after each removal include all steps, so also the frames, one in 17 steps."""
    time, ends = torn["history/time"][:], [*torn["removal/time"][:], np.inf]
    frames = torn["VTKHDF/CellData/tension"][:].reshape(len(time), -1).astype(float)
    largest = frames.max()
    for k in range(3):
        rows = frames[(time >= ends[k]) & (time <= ends[k + 1])]
        high, low = (torn[f"removal/tension_{which}"][k] for which in ("highest", "lowest"))
        known = ~np.isnan(low)
        removed = torn["removal/element"][:][torn["removal/entry"][:] <= k]
        assert (np.isnan(high) == np.isin(np.arange(len(low)), removed)).all()
        single = 1e-7 * largest  # of the frames
        assert (high >= rows.max(0) - single)[known].all() and (low <= rows.min(0) + single)[known].all()
        assert (high > rows.max(0) + single)[known].any()


ON_FOUR = "id,x,y,z,fixed,mass,load_z\n5,0,0,0,0,50,-4000\n"  # a weight
ON_FOUR += "1,-4,0,3,1,,\n2,4,0,3,1,,\n3,0,-4,3,1,,\n4,0,4,3,1,,\n"


def test_extremes_exclude_remainders_of_broken_elements(workshop):
    """Two cables break at a removal and become taut again. Their highest tension is that of the fracture."""
    text = "[cable]\naxial_stiffness = 2e5\nmass_per_length = 0.5\nbreaking_load = 1700.0\n"
    text += "[dynamics]\nduration = 1.0\ntime_step = 1e-3\nmass_damping = 0.5\n"
    text += entry([13], 0.1) + entry([11], 0.5)
    f = workshop.solve(text, ON_FOUR, "id,start,end\n11,1,5\n12,2,5\n13,3,5\n14,4,5\n")
    assert f["events/element_id"][:].tolist() == [11, 12, 14]
    highest, broke = f["removal/tension_highest"][:], f["events/element"][:]
    assert highest[0, broke] == pytest.approx(2e5 * f["events/strain"][:], rel=1e-9)
    assert np.isnan(highest[1, broke[0]]) and highest[1, broke[1:]].tolist() == [0.0, 0.0]


def test_the_envelope_is_that_of_all_rows(torn):
    """All history rows: frames in single precision, probes exactly. The slack time counts rows."""
    time, m, n = torn["history/time"][:], len(torn["net/elements"]), len(torn["net/particles"])
    assert torn["VTKHDF/Steps/Values"][:] == pytest.approx(time, abs=1e-12)
    frames = torn["VTKHDF/CellData/tension"][:].reshape(len(time), m)
    envelope = {name: torn[f"envelope/{name}"][:] for name in torn["envelope"]}
    high, low = (torn[f"removal/tension_{which}"][:] for which in ("highest", "lowest"))
    assert (envelope["tension_max"].astype(np.float32) >= frames.max(0)).all()
    assert (envelope["tension_min"].astype(np.float32) <= frames.min(0)).all()
    assert not (high > envelope["tension_max"]).any() and not (low < envelope["tension_min"]).any()
    broken = torn["VTKHDF/CellData/broken"][:].reshape(len(time), m)
    slack = ((frames == 0) & (broken == 0))[1:]  # all are cables
    assert envelope["slack_time"] == pytest.approx((slack * np.diff(time)[:, None]).sum(0), abs=1e-12)
    assert slack.any() and not slack.all(0).any()
    points = torn["VTKHDF/PointData/displacement"][:]
    offsets = torn["VTKHDF/Steps/PointDataOffsets/displacement"][:]
    moved = np.linalg.norm([points[a : a + n] for a in offsets.tolist()], axis=2)
    assert envelope["displacement_max"] == pytest.approx(moved.max(0), rel=1e-6)  # single precision
    element, particle = torn["history/probe_element"][:], torn["history/probe_particle"][:]
    tension = torn["history/probe_tension"][:]
    assert (envelope["tension_max"][element] >= tension.max(0)).all()
    u = np.linalg.norm(torn["history/probe_displacement"][:], axis=2)
    assert envelope["displacement_max"][particle] == pytest.approx(u.max(0), rel=1e-15)  # its root
    assert (envelope["displacement_max_time"][particle] == time[u.argmax(0)]).all()


@pytest.mark.parametrize("strut", ["", ",strut"])
def test_the_envelope_contains_forces_between_rows_at_fractures(workshop, strut):
    """Cables vibrate after a fracture, a strut has the least force: equal for few rows and many."""
    nodes = ON_FOUR
    elements = "id,start,end,breaking_load,group\n11,1,5,5000,a\n12,2,5,5000,a\n"
    elements += "13,3,5,1500,a\n14,4,5,5000,a\n"
    job = "[cable]\naxial_stiffness = 2e5\nmass_per_length = 0.5\n"
    if strut:
        nodes, elements = nodes + "6,0,0,-2,1,,\n", elements + "15,6,5,,strut\n"
        job += '[group.strut]\nkind = "bar"\n'
    job += "[dynamics]\nduration = 0.5\ntime_step = 1e-3\nmass_damping = 0.5\n[output]\nhistory_interval = "
    results = [workshop.solve(job + at, nodes, elements)["envelope"] for at in ("0.25\n", "1e-3\n")]
    few, all_steps = ({name: rows[:] for name, rows in envelope.items()} for envelope in results)
    whole = np.arange(len(few["tension_max"])) != 2
    for name in ("tension_max", "tension_min") if strut else ("tension_max",):
        assert few[name][whole] == pytest.approx(all_steps[name][whole], rel=1e-9)
    late = few["tension_max_time"] - all_steps["tension_max_time"]
    assert ((late >= 0.0) & (late < 0.25))[whole].all() and late[whole].max() > 0.01


def test_the_envelope_contains_the_tension_at_the_removal(workshop):
    """A cable is removed between two rows while its tension rises by 5 % in each step."""
    text = CABLE + dynamics(2 * PERIOD, 20, history=1.0) + entry([0], 0.5 * PERIOD) + entry([1], 0.7 * PERIOD)
    f = workshop.solve(text, *weights(1))
    before, largest = f["removal/tension_before"][1, 1], f["envelope/tension_max"][1]
    assert largest == before > 0.6 * WEIGHT


def test_histories_by_id_equal_those_of_the_frames(torn):
    """Both halves of each element, one removed at 0.15 s; a node by its id, one by its position."""
    h, ids = torn["history"], torn["net/element_id"][:]
    assert h["element_id"][:].tolist() == [40, 40, 20, 20, 33, 33]
    assert (ids[h["element"][:]] == h["element_id"][:]).all() and np.ptp(h["element"][:].reshape(3, 2)) > 1
    m, frames = len(ids), len(torn["VTKHDF/Steps/Values"])
    assert torn["VTKHDF/Steps/Values"][:] == pytest.approx(h["time"][:])
    tension = torn["VTKHDF/CellData/tension"][:].reshape(frames, m)[:, h["element"][:]]
    assert (h["element_tension"][:].astype(np.float32) == tension).all() and (tension[0] > 1e4).all()
    assert (h["element_tension"][:, 0][h["time"][:] > 0.152] == 0).all()
    x = torn["net/particles"][:]
    nearest = np.argmin(np.linalg.norm(x - [10.0, 6.0, 2.0], axis=1))
    assert torn["net/node_id"][:][h["probe_particle"][1:]].tolist() == [15, torn["net/node_id"][nearest]]


def test_histories_of_unknown_ids_are_refused(workshop):
    job = workshop.job(CABLE + "[dynamics]\nduration = 1.0\n" + NONE_SUCH, *weights(1))
    of = "Give ids of its"
    assert error_lines(make_layout, read_job(job), 1) == [
        f"{job}: [output] probes: the net has no node 7 (its ids are 0 to 2). {of} nodes. [E402]",
        f"{job}: [output] elements: the net has no element 5, 9 (its ids are 0 to 1). {of} elements. [E402]",
    ]


NONE_SUCH = "[output]\nprobes = [0, 7, [0.0, 1.0]]\nelements = [9, 1, 5]\n"
NOT_THERE = [  # keys of an entry, and the message
    ("elements = [0, 7, 9]", "elements: the net has no element 7, 9 (its ids are 0 to 1)"),
    ('group = "hangar"', 'group = "hangar": no such group of elements; did you mean "hanger"?'),
    ('cables = ["e9"]', 'cables: no cable "e9"; did you mean'),
    ('elements = [0]\ngroup = "hanger"', "elements and group exclude each other. Keep one of"),
    ("", "elements or group or cables: missing. Give one"),
    ('elements = ["a"]', 'elements = ["a"]: expected a list of integers'),
]


@pytest.mark.parametrize(
    "text, line",
    [(f"{text}\ntime = 0", line) for text, line in NOT_THERE]
    + [
        ("elements = [0]", "time: missing; expected a number from 0 to 1e+09 s"),
        ("elements = []\ntime = -1", "time = -1: expected a number from 0 to 1e+09 s"),
    ],
)
def test_a_wrong_entry_is_refused(workshop, text, line):
    nodes, elements = weights(1)
    rows = elements.replace("unstressed_length", "unstressed_length, group")
    rows = "\n".join(r if i == 0 else f"{r}, hanger" for i, r in enumerate(rows.split("\n")))
    job = workshop.job(CABLE + dynamics(1.0, 10) + f"[[remove]]\n{text}\n", nodes, rows)
    lines = error_lines(lambda: make_layout(read_job(job), 1))
    assert any(message.startswith(f"{job}: [[remove]] 1: {line}") for message in lines), lines


def test_a_member_that_is_removed_twice_is_noted(workshop):
    """The earlier removal counts, whatever the order of the entries; an id may be repeated."""
    text = CABLE + dynamics(0.3, 100) + entry([0, 2], 0.2) + entry([2, 2], 0.1)
    output = workshop.check(workshop.job(text, *weights(2)))
    assert [line for line in output.splitlines() if "N333" in line] == [
        "note: [[remove]] 1: no effect on element 2, which an earlier removal removed. [N333]"
    ]


def test_run_and_info_describe_member_removals(workshop):
    """Removed members, the damaged equilibrium, fractures, factors, and removals after the end."""
    nodes, elements = weights(2)
    late = entry([3], 99.0) + entry([0, 1], 1.5 * PERIOD)
    job = workshop.job(CABLE + dynamics(2 * PERIOD, 1000) + entry([2], 0.1) + late, nodes, elements)
    done = run_on_standing_ranks("run", job, "-o", workshop.folder / "result.vtkhdf")
    assert "note: [[remove]] 2: no effect: time = 99 is not before the end" in done.stdout, done.stdout
    lines = [
        "removal 1, t = 0.1001 s: element 2; the net is in equilibrium; nothing broke afterwards; "
        "largest displacement in that equilibrium 6.25 mm (node 5), by removals so far 3.125 mm (node 5); "
        "largest tension over tension before 3 (element 3: 5 -> 15 kN), 1 (element 0: 5 -> 5 kN), "
        "1 (element 1: 5 -> 5 kN); largest dynamic factors 2 (element 3), if the equilibrium changes by "
        "more than 10% of the element's tension and 2% of the net's largest",
        "removal 2: nothing was removed: its time is after the end, or it was removed before",
        "2 elements (0, 1); the net has no equilibrium; nothing broke afterwards",
    ]
    output = run_on_standing_ranks("info", workshop.folder / "result.vtkhdf").stdout
    for line in lines:
        assert line in done.stdout and line in output, output
    assert "the net without elements 0, 1: no equilibrium: a part is connected to no support" in done.stdout
    assert "gusts act after" not in output
    report_describes_removals(workshop)
    with workshop.open() as result:  # the weight falls freely, with the weight and mass that it has
        fallen = result["history/time"][-1] - result["removal/time"][2]
        speed = WEIGHT / (MASS + 2 * HALF_CABLE) * fallen
        assert result["final/velocity"][2, 2] == pytest.approx(-speed, rel=2e-3)  # half a step of 1000
        assert np.isnan(result["removal/tension_after"][2]).all()


NO_EVENTS = {"time": np.zeros(0), "element": np.zeros(0, int)}


def removals(times, elements, before, after, highest, factor) -> dict:
    """Return datasets of /removal with an equilibrium after each; the last four: (removals, elements)."""
    rows = {"tension_before": before, "tension_after": after, "tension_highest": highest}
    return {name: np.array(values) for name, values in (rows | {"dynamic_factor": factor}).items()} | {
        "time": np.array(times),
        "entry": np.arange(len(elements)) if len(times) > 1 else np.zeros(len(elements), int),
        "element": np.array(elements),
        "state": np.array(["equilibrium"] * len(times)),
        "breaking_element": np.zeros(0, int),
        "breaking_entry": np.zeros(0, int),
    }


def test_a_note_says_that_factors_in_gusts_include_the_gusts(torn):
    """The result contains the note: the extremes after a removal are those of removal and gusts."""
    assert "note: [[remove]]: gusts act after" in run_on_standing_ranks("info", torn.filename).stdout


def test_a_removal_within_the_last_step_has_its_equilibrium(workshop):
    """It takes place at the start of that step, so that the other cable carries the weight afterwards."""
    nodes, elements = weights(1)
    time_step = PERIOD / 100
    text = CABLE + dynamics(10 * time_step, 100) + entry([1], 9.9 * time_step)
    with workshop.solve(text, nodes, elements) as f:
        assert f["removal/time"][0] == pytest.approx(9 * time_step)
        assert f["removal/tension_after"][0, 0] == pytest.approx(WEIGHT, rel=0.05)


STEADY = "speed = 20.0\nturbulence_intensity = 0.0\npressure_coefficient = 0.0\n"
AT = "speed = 20.0\npressure_coefficient = 0.1\n"
BY_TAPS, SUDDEN = 'pressures = "p.csv"\ntaps = "taps.csv"\n', STEADY + 'onset = "sudden"\n'
GROWS = "pressure = 100.0\nramp = 0.5\n"
SUPERPOSED = [  # of [load], of [wind], time of the removal, what is named and whether as a warning
    ("", AT + "turbulence_intensity = 0.1\n", 0.1, "alone set [wind] turbulence_intensity = 0.", False),
    ("", AT + "surface_drag = 0.005\n", 0.1, "For the removal alone set [wind] surface_drag = 0.", False),
    ("", BY_TAPS, 0.1, "For the removal alone replace p.csv by a table that stays at its mean.", False),
    (GROWS, STEADY, 0.1, "[load] ramp = 0.5 s", True),  # the equilibrium after it has the whole pressure
    (GROWS, STEADY, 0.6, "", True),
    ("steps = 0\n", SUDDEN, 0.1, 'onset = "sudden" all loads act at once', True),  # also the weights
    ("steps = 1\n", SUDDEN, 0.1, 'onset = "sudden" the wind acts at once', True),
]


@pytest.mark.parametrize("load, wind, time, words, warns", SUPERPOSED)
def test_excitation_that_joins_a_removal_is_named(workshop, load, wind, time, words, warns):
    """Gusts, with a key of that wind, and loads that grow or act suddenly."""
    text = CABLE + load + dynamics(PERIOD, 100) + entry([2], time) + "[wind]\nprofile_exponent = 0.0\n"
    job = read_job(workshop.job(text + wind, *weights(2)))
    notes = [*superposed_excitation_notes(job, varies=not warns)]
    assert len(notes) == bool(words) and all(words in line and is_warning(line) == warns for line in notes)


def test_a_warning_says_that_factors_include_moving_supports(workshop):
    """A removal while a support settles: extremes and equilibrium are not those of the removal alone."""
    (workshop.folder / "move.csv").write_text("time,z\n0,0\n0.2,-0.01\n")
    text = CABLE + dynamics(PERIOD, 100) + entry([2], 0.1) + '[[motion]]\ndisplacement = "move.csv"\n'
    output = workshop.check(workshop.job(text, *weights(2)))
    assert "warning: [[remove]]: supports move too, so the largest forces and the dynamic factors" in output


def test_the_parts_of_an_element_are_named_once():
    """In a removal, in its largest factors, and where elements start beyond a limit."""
    none, of_two = np.nan, np.array([7, 7, 9, 9])
    after, highest = [[2.0, 2.0, 0.0, 0.0]], [[2.0, 2.0, none, none]]
    removal = removals([0.1], [2, 3], [[1.0] * 4], after, highest, [[1.8, 1.9, none, none]])
    (line,) = removal_lines(removal, NO_EVENTS, of_two)
    assert line.startswith("removal 1, t = 0.1 s: element 9; ") and "factors 1.9 (element 7), if" in line
    assert "before 2 (element 7: 0.001 -> 0.002 kN); largest dynamic" in line
    entry = SimpleNamespace(elements=(7, 7, 7), cables=None, group=None)
    job, loss = SimpleNamespace(removes=[entry]), SimpleNamespace(entries=(0,))
    assert removed_names(job, loss) == "element 7"


@pytest.mark.parametrize("broke, factors", [(0.05, 0), (0.2, 0), (0.35, 1), (None, 2)])
def test_factors_need_a_net_without_fractures_until_the_next_removal(broke, factors):
    """The equilibrium is that of the unbroken net. A study has no factor after a fracture either."""
    before, after = [[1.0, 1.0, 1.0], [2.0, 1.0, 0.0]], [[2.0, 1.0, 0.0], [3.0, 0.0, 0.0]]
    highest, factor = [[3.0, 1.2, np.nan], [4.0, np.nan, np.nan]], [[2.0, np.nan, np.nan]] * 2
    removal = removals([0.1, 0.3], [2, 1], before, after, highest, factor)
    fractures = np.array([] if broke is None else [broke])
    events = {"time": fractures, "element": np.zeros(len(fractures), int)}
    has_factors = ["dynamic factors" in line for line in removal_lines(removal, events, np.array([7, 8, 9]))]
    assert has_factors == [k < factors for k in range(2)]
    f = {"removal": removal, "removal/time": removal["time"], "events": events, "net/elements": np.zeros(3)}
    assert np.isfinite(largest_after_removals(f)["dynamic_factor"]).sum() == bool(factors)


def test_parts_of_an_element_count_as_one_fracture():
    """Run and info count fractures and slack cables by the ids of the tables, like the lines on removals."""
    events = {"time": np.array([0.5, 0.6]), "element": np.array([4, 5]), "element_id": np.array([2, 2])}
    f = {"history": {"work_identity_error": np.array([np.nan])}, "events": events}
    (line,) = _dynamics_lines(SimpleNamespace(layout=SimpleNamespace(slides=None)), f)
    assert line == "fractures: 1 element, the first at t = 0.5000 s (element 2)"
    f |= {f"events/{name}": values for name, values in events.items()}
    net = {"elements": np.zeros((6, 2)), "element_id": np.array([0, 0, 1, 1, 2, 2]), "bar": np.zeros(6)}
    net |= dict.fromkeys(("mass_per_length", "unstressed_length"), np.ones(6))
    f |= {f"net/{name}": values for name, values in net.items()}
    f["final/tension"] = np.array([0.0, 1.0, 1e3, 1e3, 0.0, 0.0])
    assert next(_fractures(f)) == "slack at the end: 1 cable element; broken: 1 element"


@pytest.mark.parametrize("later, is_named", [(1.99, False), (1.5, True)])
def test_a_removal_during_the_motion_after_another_is_named(later, is_named):
    """The factors of a second removal include the motion from the first one, but not in equilibrium."""
    before, after = [[later, np.nan, 1.0], [1.0] * 3], [[3.0, np.nan, np.nan], [2.0, np.nan, 1.0]]
    highest = [[4.0, np.nan, np.nan], [3.0, np.nan, 1.2]]
    factor = [[1.8, np.nan, np.nan], [2.0, np.nan, np.nan]]
    removal = removals([0.3, 0.1], [2, 1], before, after, highest, factor)
    second, first = removal_lines(removal, NO_EVENTS, np.array([7, 8, 9]))
    assert ("the roof still moved from removal 2, with tensions up to 0.0005 kN off" in second) == is_named
    assert "still moved" not in first


def test_a_damaged_equilibrium_above_the_strength_has_tensions(workshop):
    """One of two cables carries W / 2 but not W. The lines state that its equilibrium would have W."""
    text = CABLE.replace("density", f"fracture_strain = {0.9 * WEIGHT / EA}\ndensity")
    whole = dynamics(PERIOD, 400, more="fragments = false\n")
    job = workshop.job(text + whole + entry([0], 0.1), *weights(2))
    output = workshop.printed(job)
    assert "the net without element 0: estimated error" in output
    assert "warning: the net without element 0: element 1: strength exceeded" in output
    breaks = "the net is in equilibrium, but strengths are exceeded: element 1"
    assert f"element 0; {breaks}; element 1 broke afterwards" in output
    with workshop.open() as f:
        g = f["removal"]
        assert g["tension_after"][0] == pytest.approx([0.0, WEIGHT, WEIGHT / 2, WEIGHT / 2], rel=1e-9)
        assert g["state"].asstr()[:].tolist() == ["breaks"]
        assert g["breaking_element"][:].tolist() == [1] and g["breaking_entry"][:].tolist() == [0]


def test_a_report_without_a_damaged_equilibrium_is_complete(workshop):
    """No element has a dynamic factor. The page states this without a picture; the table has the tensions."""
    text = CABLE + dynamics(PERIOD, 400) + entry([0, 1], 0.1)
    workshop.solve(text, *weights(2)).close()
    paths = write_report(workshop.folder / "result.vtkhdf", workshop.folder / "report")
    assert "dynamic_factors.png" not in [path.name for path in paths]
    assert all(path.stat().st_size > 0 for path in paths)
    text = (workshop.folder / "report" / "summary.md").read_text()
    assert "2 elements (0, 1); the net has no equilibrium; nothing broke afterwards" in text
    assert "**No dynamic factor is known: there is no equilibrium, no large change" in text
    assert "| 1 | e2 | 2 | 5 kN | 5 kN | none | 1 |  |  |" in text
    with workshop.open() as f:
        assert f["removal/state"].asstr()[:].tolist() == ["no_equilibrium"]


def test_no_check_passes_if_the_net_without_a_member_has_no_equilibrium(workshop):
    """A weight falls after the removal of both cables. The others are far below their strength.

    Checks of serviceability leave out accidental states.
    """
    text = CABLE.replace("density", "breaking_load = 1e5\ndensity") + f"[dynamics]\nduration = {PERIOD}\n"
    for lost, result in (([0, 1], "no equilibrium"), ([1], "passes")):
        workshop.solve(text + entry(lost, 0.1), *weights(2)).close()
        report = workshop.report()
        results = {(row["kind"], row["result"]) for row in rows_of(report.folder / "checks.csv")}
        assert results == {("ULS", result), ("SLS", "passes")}
        is_failure = "**FAILS: the net after removal 1 has no equilibrium.**" in report.page
        assert is_failure == (result == "no equilibrium")


def test_a_mast_that_topples_to_its_equilibrium_is_a_warning(workshop):
    """Without one of three stays it hangs 6 m below its foot, twice its height from its first position."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,6,0,2000,-20e3\n3,4,0,0,1,0,0\n"
    nodes += "4,-2,3.5,0,1,0,0\n5,-2,-3.5,0,1,0,0\n"
    elements = "id,start,end,kind,area\n0,1,2,bar,2e-3\n1,2,3,cable,4e-4\n2,2,4,cable,4e-4\n"
    elements += "3,2,5,cable,4e-4\n"
    text = CABLE + "[dynamics]\nduration = 0.02\n" + entry([1], 0.01)
    output = workshop.printed(workshop.job(text, nodes, elements))
    assert "without element 1: the net snaps through at 0 of the lost forces: node 2 jumps by 120" in output


def test_the_ratio_of_tensions_precedes_a_factor_near_one():
    """374 to 2416 kN with a factor of 1.09: the ratio of 6.5 comes first, and a factor of 78 is omitted."""
    before, after = [[374e3, 900e3, 5e3, 400e3]], [[2247.4e3, 0.0, 5e3, 443e3]]
    highest, factor = [[2416e3, np.nan, 50e3, 3910e3]], [[1.09, np.nan, np.nan, 78.0]]
    removal = removals([0.1], [1], before, after, highest, factor)
    (line,) = removal_lines(removal, NO_EVENTS, np.array([7, 8, 9, 10]))
    ratios = "9.78 (element 10: 400 -> 3910 kN), 6.46 (element 7: 374 -> 2416 kN)"
    assert (
        f"; largest tension over tension before {ratios}; largest dynamic factors 1.09 (element 7), " in line
    )


@pytest.mark.parametrize(
    "largest, change, is_named",
    [(1000.0, 0.099, False), (1000.0, 0.101, True), (2400.0, 0.125, True), (2600.0, 0.125, False)],
)
def test_a_factor_is_named_if_the_equilibrium_changes_enough(largest, change, is_named):
    """The limits are a tenth of the element's larger tension and 2 % of the net's, in either direction."""
    for larger, smaller in ((0, 1), (1, 0)):
        tensions = np.array([[largest, 400.0], [largest, 400.0 * (1.0 - change)]])
        removal = {
            "tension_before": tensions[larger : larger + 1],
            "tension_after": tensions[smaller : smaller + 1],
            "dynamic_factor": np.array([[np.nan, 2.5]]),
        }
        assert np.isfinite(significant_dynamic_factors(removal, 0)[1]) == is_named


def report_describes_removals(workshop):
    """The peak of 3/2 W governs, in a step between two rows. A removed element is not slack."""
    report = workshop.report(pictures=True)
    cables = {row["cable"]: row for row in report.rows("cables")}
    other = cables["e3"]
    with workshop.open() as f:
        assert f["envelope/tension_max"][3] == pytest.approx(1.5 * WEIGHT, rel=2e-5)  # of the steps
    assert float(other["tension_max"]) == pytest.approx(1.5 * WEIGHT, rel=2e-5)  # peak between two steps
    assert other["case_max"] == "removal 1, t = 0.1001 s" and other["lost_at"] == ""
    assert [cables[name]["lost_at"][:6] for name in ("e0", "e1", "e2")] == ["0.2356", "0.2356", "0.1000"]
    assert {row["slack_in"] for row in cables.values()} == {"as given"}  # before any load
    assert float(other["dynamic_factor"]) == pytest.approx(2.0, abs=2e-5)
    assert not cables["e2"]["dynamic_factor"]
    assert float(other["tension_ratio"]) == pytest.approx(3.0, rel=2e-5) and not cables["e2"]["tension_ratio"]
    assert (report.folder / "dynamic_factors.png").stat().st_size > 20_000
    text = report.page
    assert "(dynamic_factors.png)" in text and "No dynamic factor" not in text
    assert "| 1 | e3 | 3 | 5 kN | 15 kN | 10 kN | 3 | 2 |  |" in text  # no strength, so no utilisation
    assert "| e2 |  | 0.1001 s |  |" in text and "- removal 1, t = 0.1001 s: element 2; the net" in text


def test_a_removal_in_a_prestressed_net_agrees_with_opensees(both_ways, compare):
    """A saddle loses two elements, for 0.25 s: each link that snaps taut doubles differences every 0.03 s."""
    text = re.sub(r"yield_stress.*\n", "", shipped("saddle"))
    text += """
[load]
self_weight = false
pressure = [0.0, 0.0, 200.0]
tolerance = 1e-10
[dynamics]
duration = 0.25
time_step = 1e-4
mass_damping = 0.5
[[remove]]
elements = [17, 60]
time = 0.0
[output]
history_interval = 0.025
probes = [[0.0, 0.0], [0.0, -27.45], [18.3, 9.15]]
"""
    f = both_ways.solve(text)
    load, lost = vertical(f, 200.0), f["removal/element"][:]
    case = make_case(f, SADDLE, load, 0.0 * load, damping=0.5, every=250) | {"lost": lost}
    theirs = reference("loss", both_ways.folder, case)
    start = (1.1e-8, 1.1e-8), "residual: 1e-10 of 1800 kN is 1.1e-8 of the nodal load"
    what = "saddle, 0.2 kN/m2 upward"
    compare_states(compare, f"{what}, at rest", f, theirs, "static", *start)
    within = 1.1e-8, 3e-7  # what the rest has left; in tensions that way times EA / L0
    because = "the same scheme and step: what the rest has left"
    compare_histories(compare, f"{what}, two elements lost", f, theirs, within, because)
    compare_states(compare, f"{what}, 0.25 s after the loss", f, theirs, "final", within, because)


def test_the_impulse_of_a_long_fading_needs_no_list_of_its_steps(monkeypatch):
    """A fading over 1e12 steps is computed. Its later sum equals that of single steps."""
    fading = SimpleNamespace(time=0.13, duration=2.0)
    all_steps = members.impulse_times([fading], 0.15, 0.05, 0.05)[1]
    monkeypatch.setattr(members, "MAX_FADING_STEPS", 5)
    assert members.impulse_times([fading], 0.15, 0.05, 0.05)[1] == pytest.approx(all_steps, abs=2e-4)
    endless = members.impulse_times([SimpleNamespace(time=0.0, duration=1e9)], 0.0, 1e-3, 1e-3)[1]
    assert endless == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("temperature", ["", '[[case]]\nname = "warm"\nset = {"load.temperature" = 1.0}\n'])
def test_permanent_loads_act_before_live_ones_with_and_without_cases(workshop, temperature):
    """The upper cable yields at 5500 N under the weight; the lift of the node then takes half of 9810 N.

    Its prestress of 1000 N and half of the weight of 9810 N at the node would give 5905 N.
    """
    text = "[cable]\nmodulus = 1e11\narea = 1e-4\nmass_per_length = 1000.0\nprestress = 1000.0\n[load]\n"
    text += '[group.upper]\nyield_stress = 55e6\n[group.lower]\nkind = "bar"\n' + temperature
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,load_z\n1,0,0,2,1,1,1,0\n2,0,0,1,1,1,0,9810\n3,0,0,0,1,1,1,0\n"
    text += "[dynamics]\nduration = 0.001\n" + entry([1], 0.0005)
    with workshop.solve(text, nodes, "start,end,group\n1,2,upper\n2,3,lower\n") as f:
        assert f["initial_state/tension"][0] == pytest.approx(5500.0 - 0.5 * 9810.0, rel=1e-6)
