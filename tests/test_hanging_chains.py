"""Chains of nodes with two cables each, which are mechanisms until they hang; undecided searches."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import StopAfter, run_on_standing_ranks
from nets import table
from scipy.optimize import brentq, root

EA, WEIGHT = 1.6e11 * 5e-4, 7850.0 * 5e-4 * 9.81  # N, N/m of unstressed length
CABLE = "[cable]\nmodulus = 1.6e11\narea = 5e-4\ndensity = 7850.0\n[load]\nself_weight = true\nsteps = 1\n"


class Chains:
    """Tables of a net to which chains are added."""

    def __init__(self):
        self.x, self.fixed, self.load, self.elements, self.length = [], [], [], [], []

    def node(self, x, fixed=0, load=(0.0, 0.0, 0.0)) -> int:
        """Add a node; return its id."""
        self.x.append(tuple(x))
        self.fixed.append(fixed)
        self.load.append(load)
        return len(self.x) - 1

    def chain(self, a: int, b: int, n: int, ratio: float, at=None, loads=None) -> list[int]:
        """Add n elements from node a to b, straight or at (n + 1, 3) [m]; return the ids of its nodes."""
        line = np.linspace(self.x[a], self.x[b], n + 1) if at is None else at
        inner = [self.node(line[k], 0, (loads or {}).get(k, (0.0, 0.0, 0.0))) for k in range(1, n)]
        ids = [a, *inner, b]
        self.elements += list(pairwise(ids))
        self.length += [ratio * np.linalg.norm(np.subtract(self.x[b], self.x[a])) / n] * n
        return ids

    def job(self, workshop, text=CABLE):
        """Return the job file."""
        rows = ((k, *x, fixed, *p) for k, (x, fixed, p) in enumerate(zip(self.x, self.fixed, self.load)))
        elements = ((*ends, L) for ends, L in zip(self.elements, self.length))
        nodes = table("id,x,y,z,fixed,load_x,load_y,load_z", rows)
        return workshop.job(text, nodes, table("start,end,unstressed_length", elements))


def positions(f) -> np.ndarray:
    """Return positions in the last load step [m]."""
    return f["net/particles"][:] + f["statics/displacement"][-1]


def hung(a, b, L0: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Nodes (n + 1, 3) [m] of a chain between points a and b, by shooting.

    L0 : (n,) [m]; p : (n - 1, 3) [N] at its inner nodes

    The tension at the first end is sought with which the chain ends at b; from there on it follows from the
    loads, element by element.
    """

    def shape(first):
        T = first - np.vstack([np.zeros(3), np.cumsum(p, 0)])
        size = np.linalg.norm(T, axis=1)
        steps = (L0 * (1.0 + size / EA) / size)[:, None] * T
        return np.vstack([a, a + np.cumsum(steps, 0)])

    chord, total = np.subtract(b, a), p.sum(0)
    pull = np.linalg.norm(total) * chord / np.linalg.norm(chord)
    solution = root(lambda first: shape(first)[-1] - b, 0.5 * total + pull, method="lm", tol=1e-13)
    assert np.abs(solution.fun).max() < 1e-8
    return shape(solution.x)


def catenary_force(L0: float) -> float:
    """Return the horizontal force [N] of a chain of a length [m] between supports 100 m apart."""
    span = lambda H: H * L0 / EA + 2.0 * H / WEIGHT * np.arcsinh(WEIGHT * L0 / (2.0 * H)) - 100.0
    return brentq(span, 1.0, 1e7, xtol=1e-9)


@pytest.mark.parametrize("n, ratio", [(150, 1.05), (200, 1.05), (1000, 1.05), (1000, 1.0001), (1000, 2.0)])
def test_a_long_chain_is_an_elastic_catenary(workshop, n, ratio):
    """Between supports 100 m apart on one level (Irvine 1981): 100 = H L0 / EA + 2 H / w asinh(w L0 / 2 H).

    It sags by w L0^2 / 8 EA + H / w (sqrt(1 + (w L0 / 2 H)^2) - 1). A chain of n straight parts with the
    weight at its nodes is off by less than 1 / n^2 of this at the middle, and of H.
    """
    net, L0 = Chains(), 100.0 * ratio
    net.chain(net.node((0.0, 0.0, 0.0), 1), net.node((100.0, 0.0, 0.0), 1), n, ratio)
    H = catenary_force(L0)
    half = WEIGHT * L0 / (2.0 * H)
    sag = WEIGHT * L0**2 / (8.0 * EA) + H / WEIGHT * (np.sqrt(1.0 + half**2) - 1.0)
    with workshop.run(net.job(workshop)) as f:
        x, N = positions(f), f["statics/tension"][-1]
        assert f["statics"].attrs["state"] == "equilibrium" and not f["statics/relaxed"][-1]
    assert -x[:, 2].min() == pytest.approx(sag, rel=1.0 / n**2 + 1e-6)
    in_parts = np.hypot(H, WEIGHT * L0 / (2.0 * n))  # at the lowest node, which carries one part's weight
    assert N.min() == pytest.approx(in_parts, rel=1.0 / n**2 + 1e-6)


def odd_chains() -> tuple[Chains, list[tuple]]:
    """Return chains of every kind in one net, with ids of the nodes and loads of each."""
    net, made = Chains(), []
    held = lambda *x: net.node(x, 1)
    a, b = held(0.0, 0.0, 0.0), held(80.0, 10.0, 40.0)
    made.append((net.chain(a, b, 120, 1.05), {}))
    points = {40: (0.0, 2e3, -5e4), 87: (1e4, 0.0, 1e4)}
    a, b = held(0.0, 30.0, 0.0), held(100.0, 30.0, 0.0)
    made.append((net.chain(a, b, 120, 1.05, loads=points), points))
    a, b = held(0.0, 90.0, 0.0), held(100.0, 90.0, 0.0)
    middle = net.node((50.0, 90.0, 0.0))  # from which another chain hangs
    made += [(net.chain(a, middle, 60, 1.05), {}), (net.chain(middle, b, 60, 1.05), {})]
    made.append((net.chain(middle, held(50.0, 150.0, -20.0), 60, 1.1), {}))
    folded = np.vstack(
        [np.linspace((0, 170, 0), (60, 170, 0), 61), np.linspace((60, 170, 0), (30, 170, 0), 61)[1:]]
    )
    made.append((net.chain(held(0.0, 170.0, 0.0), held(30.0, 170.0, 0.0), 120, 3.0, at=folded), {}))
    return net, made


def test_chains_of_every_kind_hang_as_in_the_reference(both_ways):
    """Inclined, with point loads, in a tree, given folded: nodes agree with shooting to 1e-5 m. The default
    tolerance is 1e-6 of displacements of up to 40 m.
    """
    net, made = odd_chains()
    with both_ways.run(net.job(both_ways)) as f:
        x = positions(f)
        assert f["statics"].attrs["state"] == "equilibrium"
        for ids, loads in made:
            first = net.elements.index((ids[0], ids[1]))
            L0 = np.array(net.length[first : first + len(ids) - 1])
            p = np.zeros((len(ids) - 2, 3))
            p[:, 2] = -WEIGHT * L0[0]
            for k, force in loads.items():
                p[k - 1] += force
            assert np.abs(hung(x[ids[0]], x[ids[-1]], L0, p) - x[ids]).max() < 4e-5


def test_a_chain_between_points_above_one_another_hangs_in_two_legs(workshop):
    """52 m between supports 40 m apart: legs of 46 and 6 m except for stretch, to the length of a part."""
    net, n = Chains(), 200
    line = np.linspace((0.0, 0.0, 0.0), (0.0, 0.0, 40.0), n + 1)
    line[1:-1, 0] += 1e-3 * np.sin(np.arange(n - 1))
    net.chain(net.node((0.0, 0.0, 0.0), 1), net.node((0.0, 0.0, 40.0), 1), n, 1.3, at=line)
    with workshop.run(net.job(workshop)) as f:
        x = positions(f)
    assert x[:, 2].min() == pytest.approx(-6.0, abs=52.0 / n) and np.abs(x[:, :2]).max() < 52.0 / n


def test_garlands_hang_in_a_net(workshop):
    """From nodes of a taut saddle: catenaries between the actual ends, to 1e-5 m."""
    net, cells, made = Chains(), 8, []
    at = {}
    for i in range(cells + 1):
        for j in range(cells + 1):
            s, t = 2.0 * i / cells - 1.0, 2.0 * j / cells - 1.0
            edge = abs(s) == 1.0, abs(t) == 1.0
            if not all(edge):
                load = (0.0, 0.0, -1e4) if (i, j) == (4, 4) else (0.0, 0.0, 0.0)
                at[i, j] = net.node((20.0 * s, 20.0 * t, 4.0 * (s * s - t * t)), int(any(edge)), load)
    for (i, j), p in at.items():
        for q in (at.get((i + 1, j)), at.get((i, j + 1))):
            if q is not None and not (net.fixed[p] and net.fixed[q]):
                net.chain(p, q, 1, 1.0 / 1.001)
    for one, other in (((2, 3), (4, 4)), ((4, 4), (6, 5)), ((2, 6), (6, 2))):
        made.append(net.chain(at[one], at[other], 100, 1.05))
    with workshop.run(net.job(workshop)) as f:
        x = positions(f)
        assert f["statics"].attrs["state"] == "equilibrium"
    for ids in made:
        L0 = np.full(100, net.length[net.elements.index((ids[0], ids[1]))])
        p = np.tile([0.0, 0.0, -WEIGHT * L0[0]], (99, 1))
        assert np.abs(hung(x[ids[0]], x[ids[-1]], L0, p) - x[ids]).max() < 1e-5


@pytest.mark.parametrize("before_the_end", [300, 8, 3])
def test_a_pause_changes_no_bit(workshop, before_the_end):
    """Stopped some checks before the end, while it is relaxed or hangs; resumed on other ranks."""
    net = Chains()
    net.chain(net.node((0.0, 0.0, 0.0), 1), net.node((60.0, 0.0, 20.0), 1), 150, 1.05)
    job, looks = net.job(workshop), StopAfter(10**9)
    whole = workshop.run_here(job, "whole.vtkhdf", stop=looks)
    workshop.assert_pause_changes_no_bit(job, 10**9 - looks.left - before_the_end, "", whole)


LINKS = CABLE.replace("[cable]\n", '[cable]\nkind = "bar"\n') + "max_iterations = 100\n"


def links(workshop, text=LINKS):
    """Return the job of a chain of 60 hinged bars under its weight, which are not hung beforehand."""
    net = Chains()
    net.chain(net.node((0.0, 0.0, 0.0), 1), net.node((100.0, 0.0, 0.0), 1), 60, 1.05)
    return net.job(workshop, text)


def test_a_search_without_result_is_undecided(workshop):
    """Hinged bars, relaxed in 100 iterations: exit code 3, the unproven property, and the remedy."""
    done = workshop.run(links(workshop), code=3)
    with workshop.open() as f:
        label = f["statics"].attrs
        assert label["state"] == "undecided" and f["provenance"].attrs["exit_state"] == "undecided"
    for words in (
        "the permanent loads: undecided: not in equilibrium after 100 iterations: largest residual ",
        "This does not show that the load cannot be carried. Raise [load] max_iterations",
    ):
        assert words in done.stderr
    everything = done.stdout + done.stderr
    assert "NO EQUILIBRIUM" not in everything and "no equilibrium" not in everything
    assert "statics: UNDECIDED: not in equilibrium after 100 iterations" in workshop.info()
    page = workshop.report().page
    assert "is undecided (there may be an equilibrium)" in page and "has no equilibrium" not in page


def test_more_iterations_decide_the_search(workshop):
    """The same chain with the default number has the depth of the first test's catenary, to 1 / 60^2."""
    with workshop.run(links(workshop, LINKS.replace("max_iterations = 100\n", ""))) as f:
        N = f["statics/tension"][-1]
        assert f["statics"].attrs["state"] == "equilibrium"
    assert N.min() == pytest.approx(catenary_force(105.0), rel=1.0 / 60**2)


def test_an_undecided_case_does_not_affect_others(workshop):
    """The run ends with 0, and run and report count the case. A study of it alone has no result."""
    net = Chains()
    held = [net.node((100.0 * k, 0.0, 0.0), 1) for k in range(2)]
    net.chain(*held, 60, 1.0 / 1.0005)
    case = '[[case]]\nname = "slack"\nset = {"load.temperature" = 500.0}\n'
    text = LINKS.replace("steps = 1\n", "steps = 0\n").replace("[load]", "thermal_expansion = 1e-4\n[load]")
    done = workshop.run(net.job(workshop, text + case), code=None)
    with workshop.open() as f:
        assert f["cases/slack"].attrs["state"] == "undecided"
        assert f["provenance"].attrs["exit_state"] == "finished"
    assert "warning: case slack: undecided: not in equilibrium after 100 iterations" in done.stdout
    page = (workshop.report().folder / "summary.md").read_text()
    assert "**For 1 of 1 cases no stable equilibrium before a limit point was found.**" in page
    study = workshop.folder / "study.toml"
    study.write_text('job = "job.toml"\n[vary]\n"load.tolerance" = [1e-6]\n')
    run_on_standing_ranks("study", study, "--workers", 1, "-o", workshop.folder / "s.study.h5", code=3)
    output = run_on_standing_ranks("info", workshop.folder / "s.study.h5").stdout
    assert "1 undecided (no equilibrium was found, but there may be one; left out of the curves)" in output
