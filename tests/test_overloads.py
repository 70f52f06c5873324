"""Tensions after a fracture that no element can carry; bars without strength, or with that of cables."""

from contextlib import contextmanager

import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks
from nets import table

from netfall.core.messages import kN
from netfall.driver.sample import run_sample
from netfall.geometry.build import build_net
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.parallel.mpi import MPI
from netfall.results.locks import h5_in_memory
from netfall.results.warning_text import exceeds_strength, overload_warnings_of

# A post of 6 m between four ropes above and four below, 20 m out; each rope has 2000 kN, the top carries
# 150 kN. Without element 1 it swings, and the ropes break one after another.
H = 2000e3 * 20.0 / np.hypot(20.0, 3.0)
NODES = "id,x,y,z,fixed,load_z\n1,20,0,0,1,0\n2,0,20,0,1,0\n3,-20,0,0,1,0\n4,0,-20,0,1,0\n"
NODES += "5,0,0,3,0,-150e3\n6,0,0,-3,0,0\n"
ROPES = [(level * 4 + k + 1, k + 1, 5 + level, "rope", 2000e3) for level in (0, 1) for k in range(4)]
ELEMENTS = table("id,start,end,group,prestress", [*ROPES, (9, 5, 6, "post", -4 * H * 3 / 20)])
JOB = """
[cable]
modulus = 1.6e11
area = 2300e-6
density = 8000.0
[group.rope]
breaking_load = 3000e3
[group.post]
kind = "bar"
area = 6000e-6
[load]
self_weight = true
[[remove]]
elements = [1]
time = 0.1
[dynamics]
duration = 2.0
[output]
frames = 4
"""


@contextmanager
def moved(most, strength, broke, time=2.0):
    """A result of two elements in line between three nodes."""
    rows = np.flatnonzero(np.isfinite(broke))
    with h5_in_memory() as f:
        f["net/particles"] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
        f["net/elements"] = [[0, 1], [1, 2]]
        f["net/node_id"], f["net/element_id"] = [1, 2, 3], [1, 2]
        f["net/axial_stiffness"], f["net/fracture_strain"] = [1.0, 1.0], strength
        f["envelope/tension_max"], f["envelope/tension_max_time"] = most, [time, time]
        f["events/element"], f["events/time"] = rows, np.array(broke)[rows]
        yield f


def test_the_overshoot_of_one_step_at_a_fracture_is_no_warning():
    """5 % above the strength is allowed. More gives a warning with time and strength, if an element broke."""
    broke = [1.0, np.nan]
    with moved([104.0, 50.0], [100.0, 100.0], broke) as f:
        assert not [*overload_warnings_of(f)]
    with moved([320.0, 50.0], [100.0, 100.0], broke) as f:
        (line,) = overload_warnings_of(f)
        assert exceeds_strength(f).tolist() == [True, False]
    assert "1 element had tensions above the strength; worst: element 1 (1-2) with 0.32 kN at t = 2 s" in line
    assert "(strength 0.1 kN, fracture at t = 1 s)" in line and "safety" in line
    with moved([320.0, 50.0], [100.0, 100.0], [np.nan] * 2) as f:
        assert not [*overload_warnings_of(f)]


def test_an_element_without_strength_is_compared_with_its_neighbours():
    """100 N in line with it. No warning before the first fracture, or if no neighbour has a strength."""
    broke = [1.0, np.nan]
    with moved([90.0, 150.0], [100.0, np.inf], broke) as f:
        (line,) = overload_warnings_of(f)
    assert "1 element without strength carried more than the adjoining elements can carry" in line
    assert "worst: element 2 (2-3) with 0.15 kN at t = 2 s (bound 0.1 kN)" in line
    with moved([90.0, 150.0], [100.0, np.inf], broke, time=0.5) as f:
        assert not [*overload_warnings_of(f)]
    with moved([90.0, 150.0], [np.inf, np.inf], broke) as f:
        assert not [*overload_warnings_of(f)]


@pytest.fixture
def broken(workshop):
    """Return the output of the post's run, and its result."""
    job, result = workshop.job(JOB, NODES, ELEMENTS), workshop.folder / "result.vtkhdf"
    done = run_on_standing_ranks("run", job, "-o", result)
    return done.stdout, result


def test_run_info_and_report_name_the_post_and_its_ropes(workshop, broken):
    """All name the elements and forces of /envelope, above the 3000 kN of the ropes. A sample has no file."""
    out, result = broken
    with workshop.open() as f:
        most, end = f["envelope/tension_max"][:], f["history/time"][-1]
        ropes = np.flatnonzero(most[:8] > 1.05 * 3000e3)
        broke, strain = f["events/element"][:], f["events/strain"][:]
        over = most[broke] / (1.6e11 * 2300e-6 * strain)  # remnants bear no more
        assert (over > 1.0 - 1e-9).all() and (over < 1.0 + 1e-9).sum() >= len(broke) - 1
        assert most[:8].max() < 1.3 * 3000e3  # what the step in which it breaks, and the next one, add
        assert len(ropes) and most[8] > 1.05 * 3000e3 and end == 2.0  # otherwise the case shows nothing
    worst = ropes[np.argmax(most[ropes])]
    had = "1 element had" if len(ropes) == 1 else f"{len(ropes)} elements had"
    lines: list[str] = []
    job = read_job(workshop.folder / "job.toml")
    run_sample(MPI.COMM_WORLD, lambda: job, None, ResultCache(), say=lines.extend)
    for text in (out, workshop.info(result), workshop.report(result).page, "\n".join(lines)):
        assert f"arning: dynamics: {had} tensions above" in text, text
        assert f"worst: element {worst + 1} ({worst % 4 + 1}-{5 + worst // 4}) with {kN(most[worst])}" in text
        assert (
            "1 element without strength carried more than the adjoining elements can carry; worst: " in text
        )
        assert f"element 9 (5-6) with {kN(most[8])}" in text


def test_a_bar_without_strength_next_to_ropes_with_one_is_a_warning(workshop):
    note = 'warning: bar 9 of group "post" without a strength, while others can break'
    job = workshop.job(JOB, NODES, ELEMENTS)
    assert note in run_on_standing_ranks("check", job).stdout
    strong = run_on_standing_ranks("check", job, "--set", "group.post.yield_stress=355e6").stdout
    assert "without a strength" not in strong


def test_a_bar_does_not_have_the_breaking_load_of_cables(workshop):
    """The strength of [cable] is that of cables."""
    inherited = JOB.replace("[group.rope]\nbreaking_load", "breaking_load")
    net = build_net(read_job(workshop.job(inherited, NODES, ELEMENTS)))
    assert np.isinf(net.breaking_load[net.bar]).all() and (net.breaking_load[~net.bar] == 3e6).all()


def test_an_unknown_group_is_named_before_its_consequences(workshop):
    text = JOB.replace("modulus = 1.6e11\n", "", 1).replace("[group.post]", "[group.posts]\nmodulus = 2e11")
    text = text.replace("[group.rope]", "[group.rope]\nmodulus = 1.6e11")
    done = workshop.solve(text, NODES, ELEMENTS, code=2)
    first, second = done.stderr.splitlines()
    assert "[group.posts]: no element is of this group" in first and "post" in first.split("group;")[1]
    assert "modulus" in second and "element 9" in second


def test_elements_that_break_in_equilibrium_are_named(workshop):
    """1.5 MN on the post pull at the lower ropes."""
    done = workshop.solve(JOB, NODES.replace("-150e3", "-1500e3"), ELEMENTS, code=3)
    message = "all loads: no equilibrium: element 5 breaks (load factor reached 0.9271). Lower the load"
    assert message in done.stderr


def test_elements_that_break_before_the_wind_are_named_with_the_key_that_helps(workshop):
    """Without load steps the start of the wind needs an equilibrium."""
    wind = "[wind]\nspeed = 10.0\npressure_coefficient = -1.0\nbase_height = 10.0\nsurface_drag = 0.0\n"
    text = JOB.replace("[[remove]]\nelements = [1]\ntime = 0.1\n", wind)
    head, *rows = NODES.replace("-150e3", "-1500e3").splitlines()
    nodes = "\n".join([head + ",area,normal_x,normal_y,normal_z", *(row + ",1,0,0,1" for row in rows)])
    done = workshop.solve(text, nodes, ELEMENTS, code=3)
    words = 'Lower the load, or set [wind] onset = "sudden" to apply it at once in the dynamic stage'
    assert (
        "the constant loads: no equilibrium to start from: element 5 breaks (load factor reached 0.9271)"
        in done.stderr
    )
    assert words in done.stderr


@pytest.mark.parametrize("name", ["wheel", "dome", "stadium", "olympia"])
def test_shipped_jobs_have_no_such_note(name):
    out = run_on_standing_ranks("check", ROOT / "jobs" / f"{name}.toml").stdout
    assert "without a strength" not in out and "from [cable]" not in out
