"""A net torn by netfall, OpenSees and LAMMPS under nine loads: the intact motion to digits, the order of the
first fractures, and the distribution of chaotic results over 20 runs.

The answers of the others are stored in collapse_reference.npz; collapse_reference.py describes and makes
them. Both remove an element before the force of the step in which it exceeds its strength, netfall after it
(paper 2.4), so the order differs after some twenty fractures. A loop in plain numpy shows the same.
"""

import sys
from pathlib import Path

import collapse_reference as torn
import numpy as np
import pytest
from conftest import ROOT, run_process
from nets import table

THEME, OTHERS = "Other programs", {"opensees": "OpenSees, MinMax", "lammps": "LAMMPS, fix bond/break"}
FIRST = 12  # fractures with compared order
JOB = f"""
[cable]
modulus = {torn.MODULUS!r}
area = {torn.AREA!r}
density = {torn.DENSITY!r}
[load]
self_weight = false
steps = 0
[dynamics]
duration = {{duration!r}}
time_step = {torn.STEP!r}
fragments = {{fragments}}
[output]
frames = 1
history_interval = {{duration!r}}
"""


def tear(workshop, load: float, run: int = 0, steps: int = torn.STEPS, fragments: bool = False):
    """Return step and number of each broken element, final positions (n, 3) [m], and the outcome."""
    x, fixed, elements, kind = torn.net()
    corners = np.unique(elements)  # all except the corners
    numbers = np.column_stack([corners, x[corners], fixed[corners], torn.loads(load, run)[corners]])
    rows = ((int(p), *xyz, int(held), force, torn.CARRIED) for p, *xyz, held, force in numbers.tolist())
    nodes = table("id,x,y,z,fixed,load_z,mass", rows)
    rows = ((*pair, torn.L0, strain) for pair, strain in zip(elements, torn.CLASSES[kind]))
    text = JOB.format(duration=steps * torn.STEP, fragments=str(fragments).lower())
    with workshop.solve(text, nodes, table("start,end,unstressed_length,fracture_strain", rows)) as f:
        events = f["events"]
        first = np.unique(events["element"][:], return_index=True)[1]
        order = np.column_stack([events["step"][:], events["element"][:]])[np.sort(first)]
        v = np.zeros_like(x)
        x = x.copy()
        x[corners], v[corners] = f["final/position"][: len(corners)], f["final/velocity"][: len(corners)]
    unbroken = np.ones(len(elements), bool)
    unbroken[order[:, 1]] = False
    return order[np.lexsort(order.T[::-1])], x, torn.outcome(unbroken, *torn.energies(x, v, unbroken))


def plain_order(load: float, delay: int) -> list[list[int]]:
    """Return step and number of broken elements by numpy; delay : steps for which an element still acts."""
    x, fixed, elements, kind = torn.net()
    a, b = elements.T
    limit, pulls = torn.L0 * (1 + torn.CLASSES[kind]), np.ones(len(a), bool)
    v, outer, order = np.zeros_like(x), torn.loads(load, 0), []
    for step in range(torn.STEPS):
        d = x[b] - x[a]
        length = np.sqrt((d * d).sum(1))
        new = np.flatnonzero(pulls & (length > limit))
        order += [[step, e] for e in new.tolist()]
        if not delay:
            pulls[new] = False
        tension = np.where(pulls, torn.EA / torn.L0 * np.maximum(length - torn.L0, 0.0), 0.0)
        pull = (tension / length)[:, None] * d
        force = np.zeros_like(x)
        np.add.at(force, a, pull)
        np.add.at(force, b, -pull)
        force[:, 2] += outer
        v += (0.5 if step == 0 else 1.0) * torn.STEP / torn.MASS * force * ~fixed[:, None]
        x = x + torn.STEP * v
        pulls[new] = False
    return order


def alike(one, other) -> int:
    """Return the number of equal leading entries of two lists."""
    count = min(len(one), len(other))
    differs = np.flatnonzero(np.asarray(one[:count]) != np.asarray(other[:count]))
    return int(differs[0]) if len(differs) else count


@pytest.fixture(scope="module")
def theirs():
    """Return the results of the other programs."""
    with np.load(torn.STORED) as f:
        return dict(f)


LONG = [pytest.param(k, marks=() if k == 4 else pytest.mark.long) for k in range(len(torn.LOADS))]


@pytest.mark.parametrize("k", LONG)
def test_intact_motion_and_first_fractures(shared_workshop, compare, theirs, k):
    load = float(torn.LOADS[k])
    _, x, _ = tear(shared_workshop, load, steps=torn.INTACT)
    order = tear(shared_workshop, load)[0]
    early, late = (np.array(plain_order(load, delay), int).reshape(-1, 2)[:, 1] for delay in (0, 1))
    case = f"flat net under {load / 1e3:g} kN at each node"
    compare(f"{case}: fractures in the same order", "plain loop, fracture at the end of a step").figures(
        alike(order[:, 1], late), len(late), 0, "one rule", scale=max(len(late), 1)
    )
    for name, source in OTHERS.items():
        compare(f"{case}, {torn.INTACT * torn.STEP:g} s: largest difference of positions", source).error(
            np.abs(x - theirs[f"{name}/{k}/intact"]).max(), 1e-10, "rounding of 380 steps", "m"
        )
        other = theirs[f"{name}/{k}/order"]
        assert np.array_equal(other[:, 1], early)  # a plain loop with the other's rule: all fractures
        if not len(other):
            assert not len(order)
            continue
        of = lambda what: compare(f"{case}: {what}", source)
        of("step of the first fracture").figures(order[0, 0], other[0, 0], 0, "the same step")
        both, why = np.isin(order[:FIRST, 1], other[:FIRST, 1]).sum(), "the last one may be the next"
        of(f"of the first {FIRST} broken elements, the same").figures(both, FIRST, 1, why, scale=1.0)


@pytest.mark.long
@pytest.mark.parametrize("name, package", [("opensees", "openseespy.opensees"), ("lammps", "lammps")])
def test_stored_results_equal_present_ones(theirs, tmp_path, name, package):
    script = ROOT / "tests" / "collapse_reference.py"
    for python in (sys.executable, ROOT / ".venv-bench" / "bin" / "python"):
        if not Path(python).exists() or run_process(python, "-c", f"import {package}", code=None).returncode:
            continue
        run_process(python, script, name, tmp_path / "now.npz", timeout=600)
        with np.load(tmp_path / "now.npz") as f:
            for k in range(len(torn.LOADS)):
                assert np.array_equal(f[f"{name}/{k}/order"], theirs[f"{name}/{k}/order"])
        return
    pytest.skip(f"no Python here has {package}")


@pytest.mark.long
@pytest.mark.parametrize("k", range(len(torn.LOADS)))
def test_distribution_of_chaotic_results(shared_workshop, compare, theirs, k):
    """Medians of 20 runs with loads that differ by 1e-4 are within the scatter of both programs."""
    load = float(torn.LOADS[k])
    ours = np.array([tear(shared_workshop, load, run)[2] for run in range(1, torn.RUNS + 1)])
    for name, source in OTHERS.items():
        other = theirs[f"{name}/outcomes"][k, 1:]
        for j, what, most, unit in (
            (0, "broken elements", 0.15, ""),
            (3, "kinetic energy after 1 s", 0.05, "J"),
        ):
            a, b = np.median(ours[:, j]), np.median(other[:, j])
            case = compare(f"the same net under {load / 1e3:g} kN, 20 runs: median of {what}", source)
            case.figures(a, b, most, "netfall takes an element out one step later", unit, max(b, 1.0))
        hanging = ours[:, 2].mean(), other[:, 2].mean()
        assert abs(hanging[0] - hanging[1]) < 0.5, hanging
