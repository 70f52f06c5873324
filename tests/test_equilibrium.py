"""Equilibria compared with a sparse direct solver in Newton's method, at any refinement, taut, slack,
yielding.
"""

import re
from dataclasses import replace
from itertools import chain, repeat
from types import SimpleNamespace
from unittest.mock import Mock

import h5py
import numpy as np
import pytest
from conftest import ROOT, StopAfter
from nets import bare_saddle, elastic, equilibrium, problem_of, saddle
from random_nets import star, table

from netfall.core.timings import NEVER_STOP, StopRequested
from netfall.driver import check
from netfall.driver.check import check_job
from netfall.driver.erection.settings import jack_of
from netfall.driver.statics import stage as statics
from netfall.geometry.net import GRAVITY
from netfall.job.read import read_job
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import restore_saved, save_state
from netfall.statics import interior_point, newton, solver
from netfall.statics.bounds import NEGLIGIBLE
from netfall.statics.newton import NoConvergence

SADDLE = saddle("{cable}\n", "{cells}", 1, 1800e3, side=73.2, rise=3.66, section=(1.95e11, 3600e-6, 7900.0))
SADDLE += "[load]\nself_weight = true\npressure = {pressure}\nsteps = 2\n"
EA = 1.95e11 * 3600e-6
AREA_LOAD = 2000.0
LEFT = 1e-4  # N, of some 1e6: residual of the reference


def errors(f: h5py.File, pressure, yield_force=np.inf) -> tuple[float, float, int]:
    """Return relative errors of displacement and tension in the last step, and the slack cables."""
    net, form = f["net"], f["form_finding"]
    elements, L0 = net["elements"][:], form["unstressed_length"][:]
    weight = 3600e-6 * 7900.0 * GRAVITY * L0
    load = net["tributary_area"][:][:, None] * np.array(pressure)
    np.add.at(load[:, 2], elements.ravel(), -0.5 * np.repeat(weight, 2))
    start = form["position"][:]
    x = start + f["statics/displacement"][-1]
    exact, N = equilibrium(x, elements, elastic(L0, EA, yield_force), net["fixed"][:] > 0, load, LEFT)
    largest = np.linalg.norm(exact - start, axis=1).max()
    moved = np.linalg.norm(exact - x, axis=1).max() / largest
    return moved, np.abs(N - f["statics/tension"][-1]).max() / N.max(), int((N == 0.0).sum())


CASES = {  # pressure [N/m2], more of [cable], yield force [N]
    "taut": ([0.0, 0.0, AREA_LOAD], "", np.inf),
    "slack": ([0.0, 0.0, 12 * AREA_LOAD], "", np.inf),
    "yielding": ([0.0, 0.0, 8 * AREA_LOAD], "yield_stress = 0.75e9\n", 0.75e9 * 3600e-6),
}


LARGE = [pytest.param(120, case, marks=pytest.mark.long) for case in ("taut", "slack")]


@pytest.mark.parametrize("cells, case", [*((8, case) for case in CASES), *LARGE])
def test_the_estimated_error_of_an_equilibrium_holds(workshop, cells, case):
    """The default tolerance, 1e-6, holds at any refinement, and the estimate is about the actual error."""
    pressure, cable, yield_force = CASES[case]
    pressure = [each * cells / 8 for each in pressure]  # so that each cable carries the same
    f = workshop.solve(SADDLE.format(cells=cells, cable=cable, pressure=pressure))
    moved, tension, slack = errors(f, pressure, yield_force)
    estimates = f["statics/displacement_error"][-1], f["statics/tension_error"][-1]
    assert max(estimates) <= 1e-6
    # an estimate, good to a factor of two; 1e-8: the reference's own rounding, and what yields or slackens
    assert moved <= max(2 * estimates[0], 1e-8) and tension <= max(2 * estimates[1], 1e-8)
    assert (slack > 0) == (case == "slack")
    assert f["statics/stable"][:].all()


@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.long), 3])
def test_the_levels_give_the_same_bits_on_any_number_of_ranks(both_ways, ranks):
    """1225 free particles need a level above the direct solver, whose aggregates cross the ranks."""
    job = both_ways.job(SADDLE.format(cells=36, cable="", pressure=[0.0, 0.0, 4000.0]))
    assert not both_ways.run(job, ranks=ranks)["statics/relaxed"][:].any()


STRUT = """
[cable]
modulus = 2e11
density = 7850.0
area = 1e-3
[group.tie]
prestress = 10e3
[group.strut]
kind = "bar"
[load]
self_weight = false
steps = 1
"""


@pytest.mark.parametrize("share, stable", [(0.99, True), (1.01, False)])
def test_a_strut_without_lateral_support_is_a_warning(workshop, share, stable):
    """A strut of h = 3 m between ties of a = 5 m along y alone: across, these hold with 2 T / a, the strut
    pushes with N / h: critical at N = 2 T h / a = 12 kN. (They gain less than 1e-3 of T when it shortens.)
    """
    nodes = "id,x,y,z,fixed,load_z\n" + f"1,0,0,0,1,0\n2,0,-5,3,1,0\n3,0,5,3,1,0\n4,0,0,3,0,{-12e3 * share}\n"
    elements = "start,end,group\n1,4,strut\n2,4,tie\n4,3,tie\n"
    output, f = workshop.printed(workshop.job(STRUT, nodes, elements)), workshop.open()
    assert bool(f["statics/stable"][-1]) == stable
    assert f["statics/tension"][-1][0] == pytest.approx(-12e3 * share, rel=1e-3)  # ties take a little
    assert ("warning: statics: unstable equilibrium" in output and "node 4" in output) != stable


class Statics:
    """The static stage of a job in this process."""

    def __init__(self, job):
        self.job, self.seen = read_job(job), []
        self.scene = problem_of(self.job)

    def find(self, stop=NEVER_STOP, path=None):
        """Find all equilibria; return the positions of the last one. Raises StopRequested."""
        self.path = path or statics.StaticPath()
        statics.find_equilibria(self.scene, Mock(stop=stop), self.path, self.seen)
        return self.scene.state.x.copy()

    def off(self, yield_force=np.inf) -> tuple[float, float]:
        """Return the relative errors of displacement and tension in the last equilibrium."""
        model = self.scene.model
        net, load = model.net, model.loading.permanent + model.loading.live
        x, law = self.scene.state.x, elastic(model.L0, EA, yield_force)
        exact, N = equilibrium(x, net.elements, law, net.fixed, load, LEFT)
        tension = self.seen[-1][0].equilibrium.snapshot.N
        moved = np.linalg.norm(exact - x, axis=1).max()
        far = np.linalg.norm(exact - model.x, axis=1).max()
        return moved / far, np.abs(N - tension).max() / N.max()


def large_load(workshop, cells, times, cable=""):
    """Return the static stage of a saddle under a large load."""
    text = SADDLE.format(cells=cells, cable=cable, pressure=[0.0, 0.0, times * AREA_LOAD])
    return Statics(workshop.job(text))


@pytest.mark.parametrize("cable", ["", "fracture_strain = 0.5\n"])
def test_a_large_load_needs_no_relaxation(workshop, monkeypatch, cable):
    """Under twelve times the load cables are slack. The interior point method finds the right equilibrium."""
    monkeypatch.setattr(solver, "relax", None)
    statics = large_load(workshop, 24, 36, cable)
    statics.find()
    assert max(statics.off()) < 1e-6 and statics.path.steps[-1]["slack"] > 0


def test_yielding_cables_need_no_relaxation(workshop, monkeypatch):
    """Cables flow until the saddle has moved by a third of its span; the equilibrium is right."""
    monkeypatch.setattr(solver, "relax", None)
    statics = large_load(workshop, 12, 9, "yield_stress = 0.75e9\n")
    statics.find()
    assert max(statics.off(0.75e9 * 3600e-6)) < 1e-6 and np.abs(statics.scene.state.eps_p).max() > 0.1


def test_relaxation_replaces_methods_that_fail(workshop, monkeypatch):
    """If the interior point method fails, the positions are restored and relaxation finds the equilibrium."""
    monkeypatch.setattr(interior_point, "MOST_STEPS", 3)
    statics = large_load(workshop, 24, 36)
    statics.find()
    assert statics.path.steps[1]["iterations"] > 300 and max(statics.off()) < 1e-6


HUNG = """
[cable]
modulus = 2e11
area = 1e-3
density = 7850.0
strain_measure = "{strain}"
{yields}
[load]
self_weight = false
steps = 1
"""
SUPPORTS, SIDE, EA_HUNG, YIELD = 10.0, 12.0, 2e8, 1e6


def hung(workshop, strain, yields):
    """Return Newton's method for two slack cables between supports and a third slack one.

    12 m each span 20 m, and 1.2 MN act where they meet. Also returns the state and the depth of that node by
    hand: 2 N sin(slope) = P, with N = N_y if they yield, otherwise with the L that carries N.
    """
    P = 1.2e6
    nodes = f"id,x,y,z,fixed,load_z\n1,-10,0,0,1,0\n2,10,0,0,1,0\n3,1,0,-1,0,{-P}\n4,0,0,-40,1,0\n"
    elements = "start,end,unstressed_length\n1,3,12\n2,3,12\n3,4,60\n"
    text = HUNG.format(strain=strain, yields="yield_stress = 1e9" if yields else "")
    job = workshop.job(text, nodes, elements)
    scene = problem_of(read_job(job))
    low, high = SIDE, 4 * SIDE
    for _ in range(100):
        L = 0.5 * (low + high)
        strain_of = np.log(L / SIDE) if strain == "logarithmic" else L / SIDE - 1.0
        N = EA_HUNG * strain_of if not yields else min(EA_HUNG * strain_of, YIELD)
        carried = 2.0 * N * np.sqrt(L * L - SUPPORTS**2) / L
        low, high = (L, high) if carried < P else (low, L)
    assert (N == YIELD) == yields
    load = scene.model.loading.permanent + scene.model.loading.live
    return scene.finder.newton(load), scene.state, np.sqrt(L * L - SUPPORTS**2)


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
@pytest.mark.parametrize("yields", [False, True])
@pytest.mark.parametrize("until", [(1e-5, 0.0), (0.0, 1e-6)])
def test_slack_cables_are_found_with_tensions_as_unknowns(workshop, strain, yields, until):
    """The error is that of the last step, by hand. Tensions are those of the law."""
    method, state, depth = hung(workshop, strain, yields)
    way = interior_point.InteriorPoint(method, state, NEVER_STOP)
    way.iterate(*until)
    assert state.x[2] == pytest.approx([0.0, 0.0, -depth], rel=1e-6, abs=1e-5)
    assert max(way.errors) < 1e-5 and way.unknowns[0, 2] < 1e-5 * way.unknowns[0, 0]
    assert (state.present_element_state().eps_p[:2] > 0.01).all() == yields


GIVEN = bare_saddle("{cells}", 80e3, side=200.0, rise=20.0, section=(1.6e11, 400e-6, 7850.0))
GIVEN += "[load]\nself_weight = true\n"


def test_a_start_far_from_a_slack_equilibrium_needs_no_relaxation(workshop, monkeypatch):
    """A saddle moves by a ninth of its span. Steps with tensions as unknowns end near a singular tangent."""
    states, errors_told, text = [], [], GIVEN.format(cells=24)
    for steps, tolerance in ((interior_point.MOST_STEPS, 1e-6), (0, 1e-9)):
        monkeypatch.setattr(interior_point, "MOST_STEPS", steps)
        job = read_job(workshop.job(text + f"tolerance = {tolerance}\nmax_iterations = 1000000\n"))
        scene = problem_of(job)
        load = scene.model.loading.permanent
        with monkeypatch.context() as only:
            if steps:
                only.setattr(solver, "relax", None)
            result = scene.finder.find(load, solver.Criterion(tolerance, 80e3, 1_000_000, "weight"))
        errors_told.append((result.displacement_error, result.tension_error))
        states.append((scene.state.x.copy(), scene.state.present_element_state().N))
    (x, N), (rest, exact) = states
    far = np.linalg.norm(rest - scene.state.x_start, axis=1).max()
    assert far > 20.0 and np.count_nonzero(exact == 0.0) > 0.15 * len(exact)
    assert np.linalg.norm(x - rest, axis=1).max() < 1e-6 * far
    assert np.abs(N - exact).max() < 1e-6 * exact.max()
    assert max(errors_told[0]) < 1e-6


def given(workshop, cells):
    """Return Newton's method for the saddle as given, which is far from equilibrium, and the state."""
    scene = problem_of(read_job(workshop.job(GIVEN.format(cells=cells))))
    return scene.finder.newton(scene.model.loading.permanent), scene.state


def test_newtons_method_stops_early_far_from_equilibrium(workshop, monkeypatch):
    """If another method is better, the first correction that is too long by half is the last one."""
    method, state = given(workshop, 8)
    shares, move_along = [], method.move_along
    monkeypatch.setattr(method, "move_along", lambda *to: shares.append(move_along(*to)) or shares[-1])
    with pytest.raises(NoConvergence):
        method.find(1e-6, state.x_start, quick=True)
    assert [part < newton.LARGE_SHARE for part in shares] == [False] * (len(shares) - 1) + [True]


@pytest.mark.filterwarnings("error")
def test_an_overflow_of_the_cycle_is_a_failure_to_converge(workshop):
    """The direct solver of a singular tangent gives infinite displacements, also if no force acts."""
    method, _ = given(workshop, 8)
    method.begin()
    K, r = method.tangent(), method.residual()
    r[::2] = 0.0
    with pytest.raises(NoConvergence):
        method.solve(K, lambda rows: np.full_like(rows, np.inf), r)


def test_the_share_of_a_correction_that_never_helps_is_that_of_the_positions():
    """The returned share is that of the positions, also after the last reduction."""
    net = SimpleNamespace(x=np.zeros((2, 3)))
    spread = np.ones((2, 3))
    slopes = chain([[1.0]], repeat([-np.inf]))
    method = Mock(net=net, u=spread, inner_products=lambda *_: next(slopes), allowed_share=lambda s: 1.0)
    share = newton.Newton.move_along(method, spread, spread)
    assert 0.1 * NEGLIGIBLE <= share <= NEGLIGIBLE and (net.x == share).all()


def test_check_estimates_the_time_of_equilibria_of_large_nets(workshop, monkeypatch):
    """1,104 elements, three equilibria; two digits are printed."""
    monkeypatch.setattr(check, "MIN_LARGE_NET", 0)
    lines = []
    text = SADDLE.format(cells=24, cable="", pressure=[0.0, 0.0, 3 * AREA_LOAD])
    check_job(read_job(workshop.job(text)), lines.append)
    line = next(line for line in lines if "expected run time" in line)
    assert float(re.search(r"equilibria ([0-9.]+) s", line)[1]) == pytest.approx(1104 * 3 * 4.5e-6, rel=0.05)
    assert "up to ten times as long" in line


def hung_wheel(monkeypatch):
    """Return the state of a wheel in slack radials, and a function that finds its equilibrium."""

    def not_found(*_):
        raise NoConvergence

    monkeypatch.setattr(newton.Newton, "solve", not_found)
    changes = ["net.wheel.spokes=8", "net.wheel.hoops=1"]
    job = replace(read_job(ROOT / "jobs" / "wheel_erection.toml", changes), stages=(), cases=())
    scene = problem_of(job)
    L0 = scene.model.cut_length
    for name in ("upper", "lower"):
        L0 = jack_of(scene.model.net, name).changed(L0, 0.35)
    set_slipless_lengths(scene.state, L0)
    load = scene.distribution.particles(scene.model.loading.permanent)
    criterion = lambda tolerance: solver.Criterion(tolerance, 3e6, 500_000, "hung")
    return scene.state, lambda tolerance, *stop: scene.finder.find(load, criterion(tolerance), *stop)


def test_the_error_without_a_tangent_is_within_the_tolerance(monkeypatch):
    """Relaxation continues to tenths of the residual until the error is stable. Reference: a tighter one."""
    state, find = hung_wheel(monkeypatch)
    result = find(1e-6)
    assert result.relaxed and result.unstable_at == newton.UNKNOWN and result.error <= 1e-6
    x = state.x.copy()
    find(1e-9)
    assert np.abs(state.x - x).max() < 1e-6 * np.abs(state.x - state.x_start).max()


@pytest.mark.parametrize("seed", [0, 2])
def test_a_stage_without_changes_does_not_move_a_net_in_national_coordinates(workshop, seed):
    """Its coordinates are rounded to 1e-9 m, which exceeds a millionth of its motion."""
    x, ends, held = star(np.random.default_rng(seed))
    east, north, z = (x + [5e5, 5.4321e6, 0.0]).T
    nodes = table({"id": range(len(x)), "x": east, "y": north, "z": z, "fixed": held.astype(int)})
    text = "[cable]\naxial_stiffness = 3.2e7\nmass_per_length = 1.6\nprestress = 2e4\n"
    text += '[form_finding]\nmethod = "force_density"\n[[stage]]\nname = "idle"\n'
    f = workshop.solve(text, nodes, table({"start": ends[:, 0], "end": ends[:, 1]}))
    assert f["stages/idle"].attrs["state"] == "equilibrium"
    assert np.abs(f["stages/idle/displacement"][:]).max() < 1e-8


@pytest.mark.parametrize("corrections", [2, 5, 8])
def test_a_run_can_be_interrupted_in_its_equilibria(workshop, corrections):
    """The run stops between two corrections in one of three load steps. The resumed run has the same bits."""
    text = SADDLE.format(cells=24, cable="", pressure=[0.0, 0.0, 0.3 * AREA_LOAD])
    job = workshop.job(text.replace("steps = 2", "steps = 3"))
    x = Statics(job).find()
    stopped = Statics(job)
    with pytest.raises(StopRequested):
        stopped.find(StopAfter(corrections))
    again = Statics(job)
    restore_saved(again.scene.state, save_state(stopped.scene.state))
    assert np.array_equal(again.find(NEVER_STOP, stopped.path), x)
