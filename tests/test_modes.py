"""Periods and modes compared with closed forms, and the effect of damping in a run."""

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import run_on_standing_ranks
from nets import table

from netfall.driver.modes import modes_at
from netfall.geometry.net import Net

T, A, EA, M = 1e4, 2.0, 1e6, 30.0  # N tension, m spacing, N stiffness, kg of each node


def flat_net(x, fixed, elements):
    """Return a net of equal cables, with modulus 1 and a section of EA."""
    net = Net(x, fixed, elements, np.zeros(len(elements), int), [""])
    net.modulus, net.section = np.ones(net.m), np.full(net.m, EA)
    net.bar = np.zeros(net.m, bool)
    return net


def modes_of(net, tension, count):
    """Return the modes under one tension, with unstressed lengths from it, all masses M."""
    N, L0 = np.full(net.m, tension), net.lengths() / (1.0 + tension / EA)
    return modes_at(net, net.x, N, L0, np.full(net.n, M), count)


def string(nodes):
    """Return a straight string with a number of free nodes along x."""
    x = np.column_stack([A * np.arange(nodes + 2), np.zeros(nodes + 2), np.zeros(nodes + 2)])
    fixed = np.zeros((nodes + 2, 3), bool)
    fixed[[0, -1]] = True
    return flat_net(x, fixed, np.column_stack([np.arange(nodes + 1), np.arange(1, nodes + 2)]))


@pytest.mark.parametrize("nodes", [20, 400])  # all at once; by Lanczos's iteration
def test_a_taut_string_has_the_periods_of_the_discrete_chain(nodes):
    """omega_j = 2 sqrt(T / (a m)) sin(j pi / 2 (N + 1)) across, each twice: in y and in z."""
    modes = modes_of(string(nodes), T, 6)
    omega = 2.0 * np.sqrt(T / (A * M)) * np.sin(np.array([1, 1, 2, 2, 3, 3]) * np.pi / (2 * (nodes + 1)))
    # rounding of the stiffness, eps EA / a, against the lowest: 2 (N + 1)^2 / pi^2 EA / T = 3e6 times larger
    assert modes.period == pytest.approx(2.0 * np.pi / omega, rel=1e-8)
    assert modes.unstable == 0
    wave = np.sin(np.pi * np.arange(nodes + 2) / (nodes + 1))
    y, z = modes.shape[0, (nodes + 1) // 2, 1:]
    shape = np.outer(wave, [0.0, y, z]) / np.hypot(y, z) / wave.max()
    assert modes.shape[0] == pytest.approx(shape, abs=1e-6)


@pytest.mark.parametrize("nodes", [20, 400])
def test_the_effective_mass_of_a_string_is_that_of_its_waves(nodes):
    """Mode j across has (sum of sines)^2 over N times the sum of their squares, (N + 1) / 2; none for even j.

    The sum of sin(j k pi / (N + 1)) over k is cot(j pi / 2 (N + 1)) for odd j. The two directions of a wave
    share it. All modes of a free string have the whole mass along each axis.
    """
    modes = modes_of(string(nodes), T, 6)
    pairs = modes.effective_mass.reshape(3, 2, 3).sum(1)  # of each wave, along x, y, z
    cot = 1.0 / np.tan(np.array([1, 3]) * np.pi / (2 * (nodes + 1)))
    wave = cot**2 / (nodes * (nodes + 1) / 2)
    assert pairs[[0, 2], 1:] == pytest.approx(np.column_stack([wave, wave]), rel=1e-6)
    assert pairs[1] == pytest.approx(np.zeros(3), abs=1e-9)
    if nodes == 20:
        assert modes_of(string(nodes), T, 60).effective_mass.sum(0) == pytest.approx(np.ones(3), rel=1e-9)


def grid(cells):
    """Return a flat orthogonal net with held edges."""
    line = A * np.arange(cells + 1)
    X, Y = np.meshgrid(line, line, indexing="ij")
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    held = np.ones_like(number, bool)
    held[1:-1, 1:-1] = False
    inner = slice(1, -1)
    ends = (number[:-1, inner], number[1:, inner]), (number[inner, :-1], number[inner, 1:])
    elements = np.concatenate([np.stack(pair, -1).reshape(-1, 2) for pair in ends])
    used = np.unique(elements)
    row = np.searchsorted(used, elements)
    x = np.column_stack([X.ravel(), Y.ravel(), np.zeros(X.size)])[used]
    return flat_net(x, np.repeat(held.ravel()[used][:, None], 3, 1), row)


@pytest.mark.parametrize("cells", [6, 24])
def test_a_flat_net_has_the_periods_of_the_sums_of_sines(cells):
    """omega_jk^2 = 4 T / (a m) (sin^2(j pi / 2 n) + sin^2(k pi / 2 n)), out of its plane, the lowest."""
    modes = modes_of(grid(cells), T, 6)
    s = np.sin(np.arange(1, cells) * np.pi / (2 * cells)) ** 2
    omega = np.sqrt(np.sort((4.0 * T / (A * M) * (s[:, None] + s[None])).ravel())[:6])
    assert modes.period == pytest.approx(2.0 * np.pi / omega, rel=1e-9)  # rounding, as above with 3e4
    assert np.abs(modes.shape[..., :2]).max() < 1e-6  # rounding of the vectors: the root of it
    assert np.linalg.norm(modes.shape, axis=2).max(1) == pytest.approx(np.ones(6), rel=1e-12)


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
def test_a_mode_along_a_cable_has_the_tangent_of_the_law(workshop, strain):
    """A mass between two cables in line, N = EA / 100: omega^2 = 2 EA / L0 / m, and 2 EA / L / m with the
    logarithmic strain, whose N = EA ln(L / L0).
    """
    nodes = f"id,x,y,z,fixed,mass\n1,0,0,0,1,\n2,{A},0,0,0,{M}\n3,{2 * A},0,0,1,\n"
    text = f"[cable]\nmodulus = 1e10\narea = 1e-4\ndensity = 1e-3\nprestress = {T}\n"
    text += f'strain_measure = "{strain}"\n'
    text += "[form_finding]\n[dynamics]\nduration = 1e-3\n[output]\nframes = 1\n[modes]\ncount = 3\n"
    with workshop.solve(text, nodes, "start,end\n1,2\n2,3\n") as f:
        period = f["modes/period"][-1]
    length = A if strain == "logarithmic" else A / (1.0 + T / EA)
    # the cables' own mass is 4e-9 of M; L0 for L is 5e-3 of the period
    assert period == pytest.approx(2.0 * np.pi * np.sqrt(M * length / (2.0 * EA)), rel=1e-8)


def test_a_removed_prop_has_no_stiffness_in_modes(workshop):
    """A mass between two taut cables, across them: omega^2 = 2 T / A / m, independent of the prop."""
    nodes = f"id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n1,{-A},0,0,1,1,1,\n2,0,0,0,1,1,0,{M}\n3,{A},0,0,1,1,1,\n"
    text = f"[cable]\nmodulus = 1e10\narea = 1e-4\ndensity = 1e-3\nprestress = {T}\n[group.prop]\n"
    text += 'kind = "bar"\nprestress = 0.0\n[[stage]]\nname = "struck"\nactive = ["rope"]\n[dynamics]\n'
    text += "duration = 1e-3\n[output]\nframes = 1\n[modes]\ncount = 1\n"
    pairs = "start,end,group\n1,2,rope\n2,3,rope\n2,4,prop\n"
    with workshop.solve(text, nodes + "4,0,0,-3,1,1,1,\n", pairs) as f:
        assert f["modes/period"][0] == pytest.approx(2.0 * np.pi * np.sqrt(M * A / (2.0 * T)), rel=1e-6)


def test_elements_that_do_not_move_in_a_mode_leave_the_net_visible(workshop):
    """The heavier of two strings moves: two of four lines are coloured in space, all in plan."""
    from netfall.post.plots.states import modes

    rows = ((1 + k, k % 3 * A, 5 * (k > 2), 0, int(k % 3 != 1), M * (1 + (k > 2))) for k in range(6))
    nodes = table("id,x,y,z,fixed,mass", rows)
    text = f"[cable]\nmodulus = 1e10\narea = 1e-4\ndensity = 1e-3\nprestress = {T}\n[dynamics]\n"
    text += "duration = 1e-3\n[output]\nframes = 1\n[modes]\ncount = 1\n"
    with workshop.solve(text, nodes, "start,end\n1,2\n2,3\n4,5\n5,6\n") as f:
        space, plan = modes(f).axes[:2]
    for axes, count in (space, 2), (plan, 4):
        coloured = [lines.get_array() for lines in axes.collections]
        assert [len(values) for values in coloured if values is not None] == [count]


@pytest.mark.parametrize(
    "load, about", [("", "before any static load"), ("steps = 1\n", "under the static loads")]
)
def test_picture_and_info_of_modes_name_their_equilibrium(workshop, load, about):
    """Cases do not count: the modes of a static job without load steps are those of the unloaded form."""
    from netfall.post.plots.states import modes
    from netfall.post.report.info import print_info

    nodes = f"id,x,y,z,fixed,mass\n1,0,0,0,1,0\n2,{A},0,0,0,{M}\n3,{2 * A},0,0,1,0\n"
    text = f"[cable]\nmodulus = 1e10\narea = 1e-4\ndensity = 1e-3\nprestress = {T}\n[modes]\ncount = 1\n"
    text += f"[load]\n{load}[[case]]\nname = 'cold'\nset = {{\"load.temperature\" = -5.0}}\n"
    with workshop.solve(text, nodes, "start,end\n1,2\n2,3\n") as f:
        assert f"lowest modes {about}, largest" in " ".join(modes(f).get_suptitle().split())
        lines = []
        print_info(Path(f.filename), lines.append)
    period = 2.0 * np.pi * np.sqrt(M * A / (2.0 * T))
    assert f"modes {about}: periods {period:.4g} s" in lines


def test_the_damping_ratio_is_that_of_the_oscillator():
    """v' = -zeta v, so m u'' + zeta m u' + k u = 0: the ratio is zeta / (2 omega)."""
    modes = modes_of(string(20), T, 4)
    assert modes.damping_ratio(0.5) == pytest.approx(0.5 / (2.0 * (2.0 * np.pi / modes.period)), rel=1e-14)


def test_mechanisms_differ_from_unstable_equilibria():
    """Flat bars without force, flat bars with compression, and slack cables."""
    for cells in (6, 24):  # all at once; by Lanczos's iteration
        free = (cells - 1) ** 2
        net = grid(cells)
        assert np.isinf(modes_of(net, 0.0, 6).period).all()
        net.bar[:] = True
        bars = modes_of(net, 0.0, 6)
        assert np.isinf(bars.period).all() and bars.unstable == 0
        assert np.abs(bars.shape[..., :2]).max() < 1e-6  # rounding of the vectors
        pushed = modes_of(net, -100.0, 6)
        assert np.isnan(pushed.period).all() and pushed.unstable == free


def test_a_large_net_of_slack_cables_has_mechanisms():
    """Without any stiffness, 60,000 axes need no dense matrix, which would take 27 GiB."""
    assert np.isinf(modes_of(string(20_000), 0.0, 6).period).all()


def numbers(line):
    """Return the numbers of a line of `check` after its colon."""
    return [float(word) for word in re.findall(r"[\d.]+(?:e[+-]?\d+)?(?=,| s$| %)", line)]


def test_a_free_decay_has_the_period_and_decrement_that_check_prints(workshop):
    """A string with masses under a load in the shape of its first mode, put on at once: it swings in this
    mode alone, with period T / sqrt(1 - ratio^2) and logarithmic decrement 2 pi ratio / sqrt(1 - ratio^2).
    """
    nodes = ((k, k, 0, 0, int(k in (0, 16)), 10, -10.0 * np.sin(k * np.pi / 16)) for k in range(17))
    tables = table("id,x,y,z,fixed,mass,load_z", nodes), table("start,end", ((k, k + 1) for k in range(16)))
    text = "[cable]\nmodulus = 1e11\narea = 1e-5\ndensity = 7850.0\nprestress = 1e4\n[dynamics]\n"
    text += "duration = 2.2\nmass_damping = 0.5\n[output]\nprobes = [[8.0, 0.0]]\n[modes]\ncount = 2\n"
    path = workshop.job(text, *tables)
    done = run_on_standing_ranks("check", path)
    lines = {line.split()[0]: line for line in done.stdout.splitlines()}
    assert "without loads" in lines["modes"], done.stdout
    period, ratio = numbers(lines["modes"])[0], numbers(lines["damping:"])[1] / 100.0
    with workshop.run(path) as f:
        assert f["modes/period"][0] == pytest.approx(period, rel=1e-3)  # digits printed
        assert f["modes/damping_ratio"][0] == pytest.approx(ratio, rel=1e-3)
        t, z = f["history/time"][:], f["history/probe_displacement"][:, 0, 2]
    turns = [k for k in range(1, len(z) - 1) if (z[k] - z[k - 1]) * (z[k + 1] - z[k]) < 0.0][:3]
    parabolas = [np.polyfit(t[k - 1 : k + 2] - t[k], z[k - 1 : k + 2], 2) for k in turns]
    when = [t[k] - 0.5 * b / a for k, (a, b, _) in zip(turns, parabolas)]
    high = [c - 0.25 * b * b / a for a, b, c in parabolas]
    damped = np.sqrt(1.0 - ratio**2)
    decrement = 2.0 * np.log((high[0] - high[1]) / (high[2] - high[1]))
    assert when[2] - when[0] == pytest.approx(period / damped, rel=2e-3)  # 0.03 m of sag stretch it by 1e-3
    assert decrement == pytest.approx(2.0 * np.pi * ratio / damped, rel=1e-2)  # digits; the same
