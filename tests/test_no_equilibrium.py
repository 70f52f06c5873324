"""Loads that a net cannot carry: the limit load factor, the elements at the limit, and the stored results."""

import io
import re
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import STEEL, assert_same_results, run_on_standing_ranks
from mpi4py import MPI
from nets import problem_of

from netfall.core.errors import DivergedError, UndecidedError
from netfall.core.progress import Progress
from netfall.core.timings import NEVER_STOP
from netfall.driver.run import run_job
from netfall.driver.statics.stage import StaticPath, find_equilibria
from netfall.job.read import read_job
from netfall.statics import interior_point, solver
from netfall.statics.limit_load import (
    NO_UTILISATION,
    LimitUtilisation,
    Trial,
    limit_utilisation_of,
    search_limit,
)

CABLES = """
[cable]
modulus = 2e11
area = 1e-3
density = 7850.0
yield_stress = 1e9
fracture_strain = 0.04
[load]
self_weight = false
stop_at_strength = true
steps = {steps}
"""
SUPPORTS, SAG, YIELD, FRACTURE = 10.0, 1.0, 1e6, 0.04
ENDS = "id,start,end\n1,1,3\n2,2,3\n"


def nodes(load: float) -> str:
    """Return two cables that meet 1 m below supports 20 m apart, with a load [N] where they meet."""
    return f"id,x,y,z,fixed,load_z\n1,-10,0,0,1,0\n2,10,0,0,1,0\n3,0,0,-1,0,{-load}\n"


def carried() -> float:
    """Return the load of two cables that yield until they break: 2 N_y sin(slope) at L0 (1 + fracture)."""
    L = np.hypot(SUPPORTS, SAG) * (1.0 + FRACTURE)
    return 2.0 * YIELD * np.sqrt(L * L - SUPPORTS * SUPPORTS) / L


def printed_reason(workshop, text: str, load: float, times: float) -> str:
    """Return the reason why a multiple of the load [N] has no equilibrium; the file states it to 1 %."""
    done = workshop.solve(text, nodes(times * load), ENDS, code=3)
    with workshop.open() as f:
        label = dict(f["statics"].attrs)
        assert label["state"] == f["provenance"].attrs["exit_state"] == "no_equilibrium"
        assert label["load_factor"] == f["statics/load_factor"][-1] == pytest.approx(1 / times, rel=0.01)
        assert label["elements"].tolist() == [1, 2]
        sank = SAG - f["statics/displacement"][-1, 2, 2]
        slope = sank / np.hypot(SUPPORTS, sank)
        assert f["statics/tension"][-1] == pytest.approx(YIELD, rel=1e-9)
        assert 2.0 * YIELD * slope == pytest.approx(label["load_factor"] * times * load, rel=1e-6)
    assert f"load factor reached {label['load_factor']:.4g}" in done.stderr
    return label["reason"]


def test_a_load_just_below_the_limit_is_an_equilibrium(workshop):
    with workshop.solve(CABLES.format(steps=1), nodes(0.99 * carried()), ENDS) as f:
        label = dict(f["statics"].attrs)
        assert label["state"] == "equilibrium" and label["load_factor"] == 1.0
        assert label["reason"] == "" and len(label["elements"]) == 0


def test_a_limit_load_factor_below_the_accuracy_is_zero(workshop):
    """5.8e-4 of the load is carried, and the search finds 3.9e-4, less than its resolution."""
    done = workshop.solve(CABLES.format(steps=1), nodes(1e9), ENDS, code=3)
    assert "(load factor reached 0)" in done.stderr
    with workshop.open() as f:
        assert f["statics"].attrs["load_factor"] == f["statics/load_factor"][-1] == 0.0


PLASTIC = CABLES.replace("fracture_strain = 0.04\n", "").replace("stop_at_strength = true\n", "")


def carried_without_fracture() -> float:
    """Return the load without fracture, at which the node has sunk by the distance of the supports."""
    sank = SAG + 2.0 * SUPPORTS
    return 2.0 * YIELD * sank / np.hypot(SUPPORTS, sank)


@pytest.mark.parametrize("steps, times", [(1, 1.5), (4, 1.5), (1, 1.01), (2, 3.0)])
def test_the_limit_load_of_two_cables_by_hand(workshop, steps, times):
    assert printed_reason(workshop, CABLES.format(steps=steps), carried(), times) == "element 1 breaks"


@pytest.mark.parametrize("times", [1.02, 1.5, 20.0])
def test_unbounded_yielding_starts_at_the_load_computed_by_hand(workshop, times):
    reason = printed_reason(workshop, PLASTIC.format(steps=1), carried_without_fracture(), times)
    assert reason.startswith("element 1 yields without bound")


STRONG = STEEL.replace("683.08e-6", "3600e-6").replace("7850.0", "7900.0").replace("100e3", "1800e3")
SADDLE = f"""[net]
generator = "saddle"
{STRONG}yield_stress = 0.75e9
fracture_strain = 0.04
[form_finding]
modulus_factor = 0
start = "force_density"
[load]
self_weight = true
pressure = [0.0, 0.0, 9000.0]
stop_at_strength = true
steps = {{steps}}
"""


def test_the_limit_load_does_not_depend_on_load_steps(workshop):
    """A saddle that yields before it breaks, in 1 and in 50 load steps: equal to 1 %, with equal elements."""
    labels = []
    for steps in (1, 50):
        workshop.solve(SADDLE.format(steps=steps), code=3)
        with workshop.open() as f:
            labels.append(dict(f["statics"].attrs))
    one, many = labels
    assert 0.02 < many["load_factor"] < 0.98
    assert one["load_factor"] == pytest.approx(many["load_factor"], rel=0.01)
    assert one["reason"] == many["reason"] and set(one["elements"]) & set(many["elements"])


def test_progress_describes_the_search_without_a_remaining_time(workshop, monkeypatch):
    """Each line names the search or the relaxation. The remaining time is unknown."""
    monkeypatch.setattr("netfall.core.progress.LINE_EVERY", 0.0)
    monkeypatch.setattr(interior_point, "MOST_STEPS", 0)
    job, out = workshop.job(PLASTIC.format(steps=1), FAN.format(load=-6e6), HANGERS), io.StringIO()
    with pytest.raises(DivergedError):
        run_job(MPI.COMM_WORLD, read_job(job), workshop.folder / "result.vtkhdf", Progress(True, stream=out))
    text = out.getvalue()
    assert "static load step 1 of 1: searching the limit load factor, 0 to 1" in text
    assert "static load step 1 of 1: relaxing, residual" in text and "left" not in text, text


FAN = """id,x,y,z,fixed,load_z
1,-0.5,0,0,1,0
2,0,0,0,1,0
3,0.5,0,0,1,0
4,0,0,-10,0,0
5,0,0,-12,0,{load}
"""
HANGERS = "id,start,end,area\n11,1,4,1e-3\n12,2,4,1e-3\n13,3,4,1e-3\n14,4,5,4e-3\n"
# N_y (1 + 2 cos) of three hangers, steep from the first and steeper as they stretch; to 1e-3
FAN_LIMIT = YIELD * (1.0 + 10.0 / np.hypot(10.0, 0.5) + 22.0 / np.hypot(22.0, 0.5))


@pytest.mark.parametrize("load", [3.03e6, 6e6])
def test_the_limit_load_of_a_fan_is_its_plastic_limit_load(workshop, load):
    workshop.solve(PLASTIC.format(steps=1), FAN.format(load=-load), HANGERS, code=3)
    with workshop.open() as f:
        label, tension = dict(f["statics"].attrs), f["statics/tension"][-1]
    assert label["load_factor"] == pytest.approx(FAN_LIMIT / load, rel=4e-3)
    assert sorted(label["elements"].tolist()) == [11, 12, 13]
    assert tension[:3] == pytest.approx(YIELD, rel=0.01)
    assert tension[3] == pytest.approx(label["load_factor"] * load, rel=1e-6)


def statics_of(job):
    """Return the problem of a job after its equilibria, and the last row of these."""
    scene, path = problem_of(read_job(job)), StaticPath()
    find_equilibria(scene, Mock(stop=NEVER_STOP), path)
    return scene, path.steps[-1]


def test_a_load_that_only_rough_trials_carry_is_undecided(workshop, monkeypatch):
    """Each precise search diverges; the trials of the limit load, at 1e-3, reach the whole load."""
    find = solver.EquilibriumFinder.find

    def find_roughly(finder, load, criterion, stop=NEVER_STOP):
        if criterion.tolerance < 1e-3:
            raise DivergedError("not within the tolerance")
        return find(finder, load, criterion, stop)

    monkeypatch.setattr(solver.EquilibriumFinder, "find", find_roughly)
    job = workshop.job(CABLES.format(steps=1), nodes(0.5 * carried()), ENDS)
    with pytest.raises(UndecidedError, match="not within the tolerance"):
        run_job(MPI.COMM_SELF, read_job(job), workshop.folder / "rough.vtkhdf", Progress(True))


SIDEWAYS = "id,x,y,z,fixed,load_x\n1,0,0,0,1,0\n2,0,0,-10,0,0\n3,0,0,-20,0,{load}\n"
ROPE = "id,start,end\n1,1,2\n2,2,3\n"


@pytest.mark.parametrize("steps", [interior_point.MOST_STEPS, 0])
def test_a_rope_pulled_sideways_carries_its_yield_force(workshop, monkeypatch, steps):
    """Steps with tensions as unknowns and relaxation both find the equilibrium after a large motion."""
    job = workshop.job(PLASTIC.format(steps=1), SIDEWAYS.format(load=3.0 * YIELD), ROPE)
    with monkeypatch.context() as only:
        only.setattr(interior_point, "MOST_STEPS", steps)
        _, row = statics_of(job)
    assert row["load_factor"] == pytest.approx(1.0 / 3.0, rel=4e-3)


LINE = """id,x,y,z,fixed,load_x,load_y,load_z
1,0.02,0,0.04,1,0,0,0
2,4.03,0.07,0.02,0,{0},{1},{2}
3,8,0.05,-0.06,0,{3},{4},{5}
4,11.92,-0.08,0,0,0,0,0
5,15.98,-0.06,-0.03,0,0,0,0
6,20.03,0.04,0.05,0,0,0,0
7,23.96,-0.1,0.05,1,0,0,0
"""
AREAS = 144e-6, 147e-6, 145e-6, 120e-6, 104e-6, 129e-6


@pytest.mark.parametrize("times", [0.8, 1.05, 1.2])
def test_the_state_at_the_load_carried_is_below_the_limit(workshop, times):
    """A cable carries little, then moves far under little more. The state in the file is not beyond that."""
    loads = (round(times * load) for load in (120.8e3, 2.4e3, 38.9e3, 106.9e3, -11.3e3, 36.1e3))
    ends = "id,start,end,area\n" + "".join(f"{i},{i},{i + 1},{A}\n" for i, A in enumerate(AREAS, 1))
    text = PLASTIC.format(steps=1).replace("1e9", "1e8")
    text = text.replace("2e11", '1.6e11\nstrain_measure = "logarithmic"')
    scene, row = statics_of(workshop.job(text, LINE.format(*loads), ends))
    assert row["load_factor"] * times == pytest.approx(0.06, rel=0.02)
    assert limit_utilisation_of(scene.comm, scene.distribution, scene.state, False).most <= 1.0


def test_the_search_brackets_the_limit():
    """To 0.4 % of the limit in few trials, for any result of loads beyond it."""
    for power, known in ((1.0, True), (8.0, True), (0.2, True), (1.0, False)):
        factors = []

        def trial(at, power=power, known=known, factors=factors):
            factors.append(at)
            most = (at / 0.37) ** power
            beyond = LimitUtilisation(most if known else np.inf, (), "breaks")
            return Trial(at, beyond if most > 1.0 else LimitUtilisation(most))

        whole = trial(1.0)
        low, high = search_limit(trial, Trial(0.0, NO_UTILISATION), whole, lambda *ends: None)
        assert low.factor <= 0.37 < high.factor and high.factor - low.factor <= 0.004 * high.factor
        assert len(factors) < 17


def test_relaxation_replaces_the_interior_point_method_in_the_search(workshop, monkeypatch):
    """For the whole load and for shares of it, if steps with tensions as unknowns are too few."""
    job = workshop.job(PLASTIC.format(steps=1), FAN.format(load=-6e6), HANGERS)
    relaxed, relax = [], solver.relax
    monkeypatch.setattr(solver, "relax", lambda *to, **more: relaxed.append(1) or relax(*to, **more))
    monkeypatch.setattr(interior_point, "MOST_STEPS", 0)
    _, row = statics_of(job)
    assert relaxed and row["load_factor"] == pytest.approx(FAN_LIMIT / 6e6, rel=5e-3)


@pytest.mark.parametrize("looks, ranks", [(8, 2), (16, 2), (23, 1)])
def test_a_pause_in_the_search_changes_no_bit(workshop, looks, ranks):
    job = workshop.job(PLASTIC.format(steps=1), FAN.format(load=-6e6), HANGERS)
    workshop.run(job, output="whole.vtkhdf", code=3)
    checkpoint, message = workshop.pause(job, looks)
    assert "in statics" in message
    workshop.run(job, "--restart", checkpoint, ranks=ranks, code=3)
    with workshop.open("whole.vtkhdf") as whole, workshop.open() as again:
        assert_same_results(whole, again)


def test_permanent_loads_above_the_limit_state_the_share_carried(workshop):
    """Permanent loads have no load factor. Cables that yield at 0.2 kN hang under their own weight."""
    text = PLASTIC.replace("1e9", "2e5").replace("self_weight = false", "self_weight = true")
    done = workshop.solve(text.format(steps=1), nodes(0.0), ENDS, code=3)
    weight = 7850.0 * 1e-3 * np.hypot(SUPPORTS, SAG) * 9.80665  # half of each cable at the node
    share = float(done.stderr.split("is wide at ")[1].split(" of these loads")[0])
    assert share == pytest.approx(carried_without_fracture() * 2e5 / 1e9 / weight, rel=0.01)
    with workshop.open() as f:
        assert f["statics"].attrs["elements"].tolist() == [1, 2] and np.isnan(f["statics/load_factor"][-1])


ROOFED = "id,x,y,z,fixed,area\n1,-10,0,0,1,0\n2,10,0,0,1,0\n3,0,0,-1,0,10\n"
CASES = """
[roof]
[[case]]
name = "heavy"
set = {{"load.snow" = {heavy}}}
[[case]]
name = "light"
set = {{"load.snow" = {light}}}
"""


def test_a_case_without_equilibrium_does_not_affect_others(workshop):
    """Exit code 0 with a line of counts. The next case equals that of a job without it."""
    set_up, snow = CABLES.format(steps=0), carried() / 10.0
    both = set_up + CASES.format(heavy=2.0 * snow, light=0.5 * snow)
    done = workshop.solve(both, ROOFED, ENDS, code=None)
    assert done.returncode == 0, done.stderr
    assert len(re.findall(r"^warning: case .*\[W623\]$", done.stdout, re.M)) == 1
    with workshop.open() as f:
        heavy, light = (dict(f[f"cases/{name}"].attrs) for name in ("heavy", "light"))
        after = f["cases/light/displacement"][:]
    assert heavy["state"] == "no_equilibrium" and heavy["load_factor"] == pytest.approx(0.5, rel=0.01)
    assert light["state"] == "equilibrium" and light["load_factor"] == 1.0
    with workshop.solve(set_up + CASES.format(heavy=0.1, light=0.5 * snow), ROOFED, ENDS) as f:
        assert np.array_equal(f["cases/light/displacement"][:], after)


def test_all_commands_read_a_result_without_equilibrium(workshop):
    workshop.solve(CABLES.format(steps=2), nodes(1.5 * carried()), ENDS, code=3)
    failure = "NO EQUILIBRIUM: element 1 breaks (elements 1, 2); load factor reached 0.66"
    assert failure in workshop.info()
    run_on_standing_ranks("plot", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "plot")
    report = workshop.report()
    assert "reached of 1" in report.page and "**FAILS: statics has no equilibrium.**" in report.page
    assert "passes" not in (report.folder / "checks.csv").read_text()


def test_cases_without_permanent_state_are_rows_with_that_reason(workshop):
    """Permanent loads exceed the limit load: exit code 3, and each case is a row of file and report."""
    heavy = f"steps = {{steps}}\ndead = {1.5 * carried() / 10.0}\n"
    text = CABLES.replace("steps = {steps}\n", heavy).format(steps=0) + CASES.format(heavy=200.0, light=100.0)
    text += '[[combination]]\nname = "less"\nfactors = {permanent = 0.5}\n'
    done = workshop.solve(text, ROOFED, ENDS, code=3)
    (line,) = re.findall(r"^warning: (?:case|combination) .*\[W623\]$", done.stdout, re.M)
    assert line.startswith("warning: case heavy, case light, combination less: no equilibrium: the permanent")
    with workshop.open() as f:
        assert f["cases"].attrs["order"].tolist() == ["heavy", "light", "less"]
        for name in f["cases"]:
            label = f[f"cases/{name}"].attrs
            assert label["state"] == "no_equilibrium" and np.isnan(label["load_factor"])
            assert label["reason"].startswith("the permanent loads have no equ")
            assert np.isnan(f[f"cases/{name}/reaction"][:]).all()
    assert "the permanent loads have no equilibrium" in workshop.info()
    run_on_standing_ranks("plot", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "plot")
    page = workshop.report().page
    assert page.count("the permanent loads have no equilibrium") >= 3 and "nan" not in page


def test_a_load_factor_of_a_combination_counts_from_the_permanent_loads(workshop):
    """Four times a permanent load of half the limit load: the factor is (1 - 1/2) / (2 - 1/2)."""
    text = CABLES.replace("steps = {steps}\n", f"steps = 0\ndead = {0.5 * carried() / 10.0}\n")
    text += '[[combination]]\nname = "P"\nfactors = {permanent = 4.0}\n'
    job = workshop.job(text, ROOFED, ENDS)
    lines = run_on_standing_ranks("run", job, "-o", workshop.folder / "result.vtkhdf").stdout
    (factor,) = re.findall(r"load factor reached (\S+), from 0 at the permanent loads", lines)
    assert float(factor) == pytest.approx(1.0 / 3.0, abs=4e-3)
