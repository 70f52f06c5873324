"""Form finding: start, unstressed lengths, end of the iterations. Forms: test_validation_statics.py."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, STEEL, StopAfter
from mpi4py import MPI
from nets import MAST, along, mast_and_ring, pulls, saddle

from netfall.core.errors import Interrupted
from netfall.core.messages import mm
from netfall.core.timings import PhaseTimes
from netfall.driver.setup import prepare_problem
from netfall.geometry.build import build_net
from netfall.job.read import read_job
from netfall.results.text import bar_length_warnings, form_lines
from netfall.statics import newton
from netfall.statics.form import find as form_finding
from netfall.statics.newton import NoConvergence


@pytest.mark.parametrize("start", ["given", "force_density"])
def test_the_form_at_constant_tension_does_not_depend_on_the_start(workshop, start):
    """The flat start and that of force densities give the same form."""
    f = workshop.solve(saddle("", 8, side=73.2) + f'tolerance = 1e-10\nstart = "{start}"\n')
    x = f["form_finding/position"][:]
    row = np.flatnonzero((np.abs(x[:, 0]) < 1e-6) & (x[:, 1] > 26) & (x[:, 1] < 30))
    assert abs(x[row[0], 1] - 26.92) < 0.005  # the particle nearest the edge slides from y = 27.45 (theory)


@pytest.mark.parametrize("factor, error", [(1e-3, 0.0), (1e-3, 0.02), (0.0, 0.0)])
def test_forces_of_fpm_far_from_the_prestress_are_a_warning(workshop, factor, error):
    """Two cables of 100 MN that form finding shortens from 12.81 to 10 m lose 0.22 x 1e-3 x 100 of 50 kN.

    The forces are those before errors of length, which change them too.
    """
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,-8,0\n3,20,0,0,1\n"
    cable = f"[cable]\nmodulus = 1e11\narea = 1e-3\ndensity = 8e3\nlength_std = {error}\n"
    text = cable + f"[form_finding]\nmodulus_factor = {factor}\n"
    job = workshop.job(text, nodes, "start,end,prestress\n1,2,5e4\n2,3,5e4\n")
    lines = [line for line in workshop.check(job).splitlines() if "[W741]" in line]
    assert len(lines) == (factor > 0.0)
    assert factor == 0.0 or "2 elements by more than 10%; most in element 0: 28.09 kN instead" in lines[0]


PYRAMID = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,10,10,0,1\n4,0,10,0,1\n5,5,5,{top},0\n"
SIDES = "start,end,force_density\n1,2,1\n2,3,1\n3,4,1\n4,1,1\n1,5,1\n2,5,1\n3,5,1\n4,5,1\n"
LINEAR = '[form_finding]\nmethod = "force_density"\n'


def test_an_element_pulled_to_zero_length_is_an_error(workshop):
    """Force densities pull node 6 to node 5, where the stiffness EA / L is infinite; NumPy does not warn."""
    nodes = PYRAMID.format(top=5.0) + "6,5,5,2,0\n"
    elements = SIDES.replace(",1\n", ",\n").replace("force_density", "prestress") + "5,6,\n"
    form = '[form_finding]\nmodulus_factor = 0.01\nstart = "force_density"\n'
    done = workshop.solve(STEEL + form, nodes, elements, code=2)
    assert "element 8 (nodes 5-6) is 0 m long, 3 m as given" in done.stderr
    assert "RuntimeWarning" not in done.stderr


def outputs_of(workshop, job):
    """Return the output of the run of a job, `check` and `info`, and the report's page."""
    return workshop.printed(job), workshop.check(job), workshop.info(), workshop.report().page


@pytest.mark.parametrize("top, far", [(5.0, True), (0.4, False)])
def test_displacements_and_roof_area_of_the_form_are_named(workshop, top, far):
    """The top of a pyramid over a square of 10 m sinks to its base: its four sides, of the height
    sqrt(5^2 + top^2), become 100 m2. netfall warns if the area changes by more than 5 %.
    """
    job = workshop.job(STEEL + LINEAR, PYRAMID.format(top=top), SIDES)
    before = 4 * 0.5 * 10.0 * np.hypot(5.0, top)
    line = (
        f"form: nodes moved by up to {mm(top)} (node 5), {mm(top)} on average; roof area {before:.1f} m2 as "
        f"given, 100.0 m2 in the form ({100.0 / before - 1.0:+.1%})"
    )
    change = 100.0 / before - 1.0
    note = f"warning: form finding: the area of the roof changed by {change:+.1%} (limit 5%). The form that"
    for text in outputs_of(workshop, job):
        assert line[1:] in text, text
        assert (note[1:] in text) == far


def test_rounding_is_no_displacement_of_the_form(workshop):
    """A movement below 1e-9 m is 0 mm, and one above keeps its digits."""
    net = build_net(read_job(workshop.job(STEEL + LINEAR, PYRAMID.format(top=5.0), SIDES)))
    for distance, text in ((9.6e-12, "0 mm"), (2.0**-16, "0.01526 mm")):
        line = next(form_lines(net, net.x + [0.0, 0.0, distance]))
        assert line == f"form: nodes moved by up to {text} (node 5), {text} on average"


CROSS = "id,x,y,z,fixed_x,fixed_y,fixed_z\n1,0,0,0,1,1,1\n2,3,0.5,0,0,0,0\n3,5,0,1,0,0,0\n"
CROSS += "4,7,0,0,{held},0,0\n5,10,0,0,1,1,1\n6,5,-8,0,1,1,1\n7,5,8,0,1,1,1\n8,5,4,0,0,0,0\n"


@pytest.mark.parametrize("factor, held", [(0, 0), (0, 1), (1e-3, 0)])
def test_nodes_free_along_a_cable_at_constant_tension_are_named(workshop, factor, held):
    """Nodes 2, 4 and 8 are on straight cables, node 3 on two. Node 4 may be held along its cable."""
    text = f"{STEEL}[form_finding]\nmodulus_factor = {factor}\n"
    elements = "start,end\n1,2\n2,3\n3,4\n4,5\n6,3\n3,8\n8,7\n"
    job = workshop.job(text, CROSS.format(held=held), elements)
    named = "2 nodes (2, 8)" if held else "3 nodes (2, 4, 8)"
    note = f"at constant tension: {named}: nothing holds them along their straight cable"
    for text in outputs_of(workshop, job):
        assert (note in text) == (factor == 0), text


def test_a_cable_that_is_slack_in_the_form_is_counted(workshop):
    """The form shortens a cable of little prestress until it is slack. A bar without force does not count."""
    nodes = "id,x,y,z,fixed\n1,-10,0,1,1\n2,10,0,1,1\n3,0,-8,-1,1\n4,0,8,-1,1\n5,1,0.5,0,0\n"
    elements = "start,end,prestress,kind\n1,5,4e4,cable\n5,2,4e4,cable\n3,5,100,cable\n5,4,100,cable\n"
    elements += "3,4,0,bar\n"
    job = workshop.job(STEEL.replace("683.08", "250.0") + "[form_finding]\n", nodes, elements)
    for text in (workshop.printed(job), workshop.info()):
        assert "tensions 0 to " in text and "; 1 of 5 elements slack" in text, text


def test_densities_that_cancel_are_refused_with_the_nodes(workshop):
    """0.1 + 0.2 - 0.3 is 5.6e-17, so the node would have no position; none of its axes is held."""
    elements = "start,end,force_density\n1,5,0.1\n2,5,0.2\n3,5,-0.3\n4,1,1\n"
    bars = '[cable]\nkind = "bar"\nmodulus = 1.6e11\narea = 1e-3\ndensity = 7850.0\n'
    done = workshop.solve(bars + LINEAR, PYRAMID.format(top=5.0), elements, code=2)
    assert "do not hold node 5 along x and y and z." in done.stderr


def test_nodes_without_stiffness_along_an_axis_are_refused(workshop):
    """A chain held only across and vertically may move along itself. All its nodes are named."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z\n1,0,0,0,0,1,1\n2,5,1,0,0,0,0\n3,10,0,0,0,1,1\n"
    done = workshop.solve(STEEL + LINEAR, nodes, "start,end,force_density\n1,2,3\n2,3,3\n", code=2)
    assert "do not hold 3 nodes (1, 2, 3) along x." in done.stderr


def test_nodes_that_coincide_at_constant_tension_are_named(workshop):
    """50 kN and 20 kN pull a node between two supports to one support, wherever it is. With force densities,
    50 kN over 4.12 m and 20 kN over 6.08 m, it has a position between them.
    """
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,10,0,0,1\n3,4,1,0,0\n"
    elements = "id,start,end,group,prestress\n7,1,3,edge,50e3\n8,2,3,net,20e3\n"
    job = workshop.job(STEEL + "[form_finding]\nmodulus_factor = 0\n", nodes, elements)
    done = workshop.run(job, code=3)
    assert "the nodes of element 7 (1-3) coincide" in done.stderr, done.stderr
    assert "modulus_factor = 1e-3" in done.stderr and "force_density" in done.stderr
    workshop.run(job, "--set", 'form_finding.method="force_density"')


def test_nodes_within_straight_cables_at_constant_tension(workshop):
    """Such nodes move along the cable. Relaxation moves them together, Newton's method does not."""
    cells, at = 40, {}
    for i in range(2 * cells + 1):
        for j in range(2 * cells + 1):
            if (i % 2 == 0 or j % 2 == 0) and not {i, j} <= {0, 2 * cells}:
                at[i, j] = len(at) + 1
    on_edge = lambda i, j: i in (0, 2 * cells) or j in (0, 2 * cells)
    rows, pairs = [], []
    for (i, j), node in at.items():
        x, y = 100.0 * (i / (2 * cells) - 0.5), 100.0 * (j / (2 * cells) - 0.5)
        held = on_edge(i, j)
        rows.append(f"{node},{x},{y},{0.002 * (x * x - y * y) if held else 0.0},{int(held)}")
        pairs += [
            f"{node},{at[other]}"
            for other in ((i + 1, j), (i, j + 1))
            if other in at and not (held and on_edge(*other))
        ]
    used = {int(node) for pair in pairs for node in pair.split(",")}
    nodes = "id,x,y,z,fixed\n" + "\n".join(row for row in rows if int(row.split(",")[0]) in used)
    elements = "start,end\n" + "\n".join(pairs)
    f = workshop.solve(STEEL + "[form_finding]\nmodulus_factor = 0\n", nodes, elements)
    x, ends, free = f["form_finding/position"][:], f["net/elements"][:], f["net/fixed"][:, 0] == 0
    pull, L = pulls(x, ends, np.ones(len(ends))), along(x, ends)[1]
    assert np.linalg.norm(pull[free], axis=1).max() < 1e-6
    assert np.sum(np.bincount(ends.ravel()) == 2) > 3000 and L.min() > 0.05


def test_iterations_that_run_out_end_the_run(workshop):
    """Without equilibrium: exit code 3, a line with the largest residuals of the last state, no file."""
    job = workshop.job(STEEL + MAST + "[form_finding]\nmax_iterations = 20\n", *mast_and_ring())
    done = workshop.run(job, code=3)
    (largest,) = re.findall(r"not in equilibrium after 20 iterations: largest residual (\S+) kN", done.stderr)
    match = re.search(r"Largest residuals: ((?:node \d+: [\d.e+]+ kN(?:, )?){5})\. Check joints", done.stderr)
    sizes = [float(size) for size in re.findall(r": (\S+) kN", match[1])]
    assert sizes == sorted(sizes, reverse=True) and sizes[0] == float(largest)
    two = workshop.run(job, ranks=2, code=3)
    assert match[0] in two.stderr  # the same nodes on any number of ranks
    assert not list(workshop.folder.glob("result*"))


def test_a_subdivided_net_has_the_form_of_the_given_net(both_ways):
    """At constant tension inner nodes are free along cables, so they are spaced evenly on straight lines."""
    whole, parts = (
        both_ways.solve(
            saddle("", 4, parts, side=20.0, rise=2.0) + "tolerance = 1e-9\n", output=f"{parts}.vtkhdf"
        )
        for parts in (1, 40)
    )
    x, elements = parts["form_finding/position"][:], parts["net/elements"][:]
    given = whole["form_finding/position"][:]
    assert np.array_equal(x[: len(given)], given)
    L = np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1).reshape(-1, 40)
    assert np.ptp(L, axis=1).max() < 1e-13 * L.max() * 40  # rounding of places, some 10 m
    assert parts["form_finding/residual_real_material"][()] < 1.1e-9  # as asked, in the divided net too


@pytest.fixture
def form_of(monkeypatch):
    """Return the form of a job, by relaxation or as in a run; options : of `prepare_problem`."""

    def find(job, *settings, relaxed=False, **options):
        job = read_job(ROOT / "jobs" / f"{job}.toml", list(settings))
        with monkeypatch.context() as only:
            if relaxed:
                only.setattr(form_finding, "newton_form", lambda *_: None)
            return prepare_problem(MPI.COMM_SELF, job, PhaseTimes(), **options)[0].form

    return find


@pytest.mark.parametrize(
    "job, factor", [("stadium", 1e-3), ("stadium_whole", 1e-3), ("ring", 1e-3), ("ring", 0), ("saddle", 0)]
)
def test_newtons_method_finds_the_form_of_relaxation(form_of, job, factor):
    """Flat at the start. Relaxed to 1e-10 of the prestress it is right to some 1e-7 of the net's extent:
    a residual of 1e-10 T over the net's 50 spacings, squared.
    """
    settings = f"form_finding.modulus_factor={factor}", "form_finding.tolerance=1e-10"
    relaxed, form = form_of(job, *settings, relaxed=True), form_of(job, *settings)
    assert form.iterations < 100 < relaxed.iterations
    assert np.abs(form.x - relaxed.x).max() < 1e-7 * np.ptp(relaxed.x)
    assert np.abs(form.N - relaxed.N).max() < 1e-7 * relaxed.N.max()
    assert form.residual <= 1e-10 * form.reference


def test_relaxation_replaces_newtons_method_in_form_finding(form_of, monkeypatch):
    """At constant tension, and if it fails: the bits of relaxation alone."""

    def give_up(newton, *_):
        newton.net.x[:] += 1.0
        raise NoConvergence

    monkeypatch.setattr(newton.Newton, "find", give_up)
    for factor in 0, 1e-3:
        settings = f"form_finding.modulus_factor={factor}"
        relaxed, form = form_of("ring", settings, relaxed=True), form_of("ring", settings)
        assert np.array_equal(relaxed.x, form.x) and relaxed.iterations == form.iterations


def test_form_and_equilibria_of_a_large_net_have_equal_bits_on_ranks(shared_workshop):
    """A saddle of 10,305 particles, under parts of its load; one and two ranks."""
    load = "[load]\nself_weight = true\npressure = [0.0, 0.0, 1e3]\nsteps = 1\n"
    job = f'[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 100\n{STEEL}[form_finding]\n{load}'
    job = shared_workshop.job(job, name="large")
    one = shared_workshop.run(job, output="one.vtkhdf")
    two = shared_workshop.run(job, ranks=2, output="two.vtkhdf")
    form, steps = one["form_finding"], one["statics"]
    assert len(form["position"]) > 10_000 and form["iterations"][()] < 100
    assert not steps["relaxed"][:].any() and steps["iterations"][:].max() > 30
    for group in "form_finding", "statics":
        assert all(np.array_equal(one[group][name][()], two[group][name][()]) for name in one[group])


def test_newtons_method_can_be_interrupted_in_form_finding(form_of, tmp_path):
    """The run stops between two corrections. Its checkpoint restarts the search, to the same bits."""
    net = "ring", "form_finding.modulus_factor=1e-3"
    with pytest.raises(
        Interrupted, match="in form finding or erection, which the resumed run repeats"
    ) as stopped:
        form_of(*net, stop=StopAfter(1), result=tmp_path / "result.vtkhdf")
    checkpoint = Path(str(stopped.value).split("--restart ")[1].split(" [")[0])
    assert np.array_equal(form_of(*net, restart=checkpoint).x, form_of(*net).x)


@pytest.mark.parametrize("looks", [1, 4])
def test_a_pause_in_the_relaxation_of_a_form_changes_no_bit(workshop, looks):
    """Newton's method leaves nets with struts to relaxation; stopped and resumed on two ranks."""
    text = STEEL + MAST + "[form_finding]\nmodulus_factor = 1\ntolerance = 1e-10\n"
    job = workshop.job(text, *mast_and_ring())
    whole = workshop.run(job, output="whole.vtkhdf")
    assert whole["form_finding/iterations"][()] > 100
    workshop.assert_pause_changes_no_bit(job, looks, "in form finding", whole)


def test_a_bar_that_form_finding_lengthens_is_a_warning():
    """A mast of 8 m becomes 12 m long and is named. Cables and a bar within 10 % are not."""
    given = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 8.0], [9.0, 0.0, 0.0], [9.0, 0.0, 8.0]])
    form = given + np.array([[0, 0, 0], [0, 0, 4.0], [0, 0, 0], [0, 0, 0.7]])
    ends, ids = np.array([[0, 1], [2, 3], [0, 1]]), np.array([7, 8, 9])
    net = SimpleNamespace(x=given, elements=ends, bar=np.array([True, True, False]), element_id=ids)
    (line,) = bar_length_warnings(net, form)
    assert "bar 7 changed from 8 to 12 m (+50%, limit 10%)" in line and line.endswith("[W740]")
    net.bar = np.ones(3, bool)
    assert [*bar_length_warnings(net, given)] == []
