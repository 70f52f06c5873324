"""The element law in whole runs, against closed forms and energies by hand, for both measures of strain."""

import numpy as np
import pytest
from conftest import STEEL
from nets import table
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from test_validation_dynamics import timing

THEME = "Material"
E, A, RHO, G = 1.95e11, 683.08e-6, 7850.0, 9.81
EA, NY, HALF = E * A, 1.75e9 * A, 0.5 * RHO * A  # N; N at yield; kg for each metre
MEASURES = ["engineering", "logarithmic"]


def section(strain: str) -> str:
    return STEEL.replace("prestress = 100e3\n", f'strain_measure = "{strain}"\n')


@pytest.mark.parametrize("strain", MEASURES)
def test_elongation_under_a_known_force(both_ways, compare, strain):
    """Cables of two elements and a strut under 100 kN: unstressed length times 1 + N / EA, or exp(N / EA)."""
    N, L0, shares = 100e3, 6.0, (0.001, 0.04, 0.2, -0.04)
    nodes, elements = [], []
    for s, share in enumerate(shares):
        pull = lambda k: np.copysign(N, share) if k == 2 else 0.0
        nodes += [(10 * s + k, L0 * k / 2, 5.0 * s, 0.0, int(k == 0), 1, 1, pull(k)) for k in (0, 1, 2)]
        group, first = "strut" if share < 0 else "", 10 * s
        elements += [(first + k, first + k + 1, group, N / abs(share) / A) for k in (0, 1)]
    elements = table("start,end,group,modulus", elements)
    tables = table("id,x,y,z,fixed_x,fixed_y,fixed_z,load_x", nodes), elements
    text = section(strain) + '[group.strut]\nkind = "bar"\n[load]\nself_weight = false\nsteps = 2\n'
    f = both_ways.solve(text + "tolerance = 1e-10\n", *tables)
    x, why = f["final/position"][:, 0], "residual of the statics, 1e-10 of the load"
    for s, share in enumerate(shares):
        theirs = L0 * (1 + share) if strain == "engineering" else L0 * np.exp(share)
        source = "L0 (1 + N / EA)" if strain == "engineering" else "L0 exp(N / EA)"
        compare(f"length of {L0:g} m under N = {share:g} EA, {strain} strain", source).figures(
            x[3 * s + 2] - x[3 * s], theirs, 2e-10 * abs(share), why, "m"
        )


@pytest.mark.parametrize("strain", MEASURES)
def test_weight_dropped_on_a_cable_that_yields(both_ways, compare, strain):
    """Caught, thrown back to slack, caught again: lengths and energies by balance, times by quadrature."""
    L0, h, carried, dt = 10.0, 0.6, 36e3, 5e-4
    mass = carried + HALF * L0
    F = mass * G
    at = (1, 0.0, 0.0, h - L0, 0, carried, -F), (0, 0.0, 0.0, 0.0, 1, 0.0, 0.0)  # the first is the probe
    tables = table("id,x,y,z,fixed,mass,load_z", at), table("start,end,unstressed_length", [(0, 1, L0)])
    text = section(strain) + "yield_stress = 1.75e9\n" + timing(1.2, dt, 1, [(0.0, 0.0)])
    f = both_ways.solve(text, *tables)
    t = f["history/time"][:]
    L = L0 - h - f["history/probe_displacement"][:, 0, 2]
    N = f["history/probe_tension"][:, 0]
    if strain == "engineering":
        at_yield, stored = L0 * (1 + NY / EA), lambda L, rest: EA / L0 * (L - rest) ** 2 / 2
        remains = lambda L, N: L - L0 * N / EA
        plastic = lambda rest: rest / L0 - 1
        force = lambda L, rest: EA / L0 * (L - rest)
    else:
        at_yield, stored = L0 * np.exp(NY / EA), lambda L, rest: EA * (L * np.log(L / rest) - L + rest)
        remains = lambda L, N: L * np.exp(-N / EA)
        plastic = lambda rest: np.log(rest / L0)
        force = lambda L, rest: EA * np.log(L / rest)
    # F (h + L - L0) = stored + NY (L - at_yield)
    longest = (stored(at_yield, L0) - NY * at_yield - F * (h - L0)) / (F - NY)
    rest = remains(longest, NY)
    spring = stored(longest, rest)
    heat = NY * (longest - at_yield) - (spring - stored(at_yield, L0))
    thrown = longest - spring / F  # shortest length after the rebound: F recovers the stored energy
    speed = lambda L: np.sqrt(2 / mass * (F * (h + L - L0) - stored(L, L0)))
    at_the_yield_force = mass * speed(at_yield) / (NY - F)
    # back from the longest, over s = sqrt(longest - L), in which the integrand has no singular end
    slowness = lambda s: 2 * s / np.sqrt(2 / mass * (spring - stored(longest - s * s, rest) - F * s * s))
    rebound = quad(slowness, 1e-4, np.sqrt(longest - rest))[0] + 1e-4 * slowness(1e-4)
    peak = np.sqrt(2 * h / G) + quad(lambda L: 1 / speed(L), L0, at_yield)[0] + at_the_yield_force
    again = peak + rebound + 2 * np.sqrt(2 * (rest - thrown) / G)
    taut = np.flatnonzero(N)
    gap = np.flatnonzero(np.diff(taut) > 1)[0]
    first, second = taut[: gap + 1], taut[gap + 1 :]
    path = CubicSpline(t[first], L[first])
    turn = path.derivative().roots(extrapolate=False)[0]
    residual = remains(L[first[-1]], N[first[-1]])  # of the last row on the way down
    free = slice(first[-1] + 1, second[0])
    lowest = np.poly1d(np.polyfit(t[free] - t[free].mean(), L[free], 2))
    kinks, what = EA / L0 / mass * dt**2 / 4, "kinks at catch and yield: (omega dt)^2 / 8 of the speed each"
    sure = kinks * (F * h + stored(at_yield, L0)) / (NY - F)  # m, effect of the kinks' energy on the longest
    name, energy = f"weight dropped on a cable that yields, {strain} strain", "balance of energy"
    lost, thrown_back = f["history/plastic_dissipation"][-1], residual - lowest(lowest.deriv().roots[0])
    caught = t[second[0]] - (L[second[0]] - rest) / ((L[second[0]] - L[second[0] - 1]) / dt)
    of_longest, of_rest = sure / (longest - L0), sure / (rest - L0)
    for case, source, ours, theirs, within, unit in (
        (f"{name}: largest elongation", energy, path(turn) - L0, longest - L0, of_longest, "m"),
        ("the same: plastic strain", energy, f["final/plastic_strain"][0], plastic(rest), of_rest, ""),
        ("the same: dissipated", "work of yield force less stored", lost, heat, of_rest, "J"),
        ("the same: time of the longest", "quadrature", turn, peak, kinks, "s"),
        ("the same: residual elongation, where slack", energy, residual - L0, rest - L0, of_rest, "m"),
        ("the same: way thrown back from there, slack", energy, thrown_back, rest - thrown, kinks, "m"),
        ("the same: time of the second catch", "quadrature and parabola", caught, again, kinks, "s"),
    ):
        compare(case, source).figures(ours, theirs, within, what, unit)
    up = second[: np.argmax(L[second])]
    up = up[N[up] < NY * (1 - 1e-9)]  # before it yields again, by what the kinks have added
    compare("the same: tension on the way up again, largest difference", "the line of the way down").error(
        np.abs(N[up] - force(L[up], residual)).max(), 1e-9, "rounding", "N", scale=NY
    )
    case = compare("the same: largest elongation the second time", "the first time")
    case.figures(L[second].max() - L0, longest - L0, of_longest, what, "m")


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
def test_cycles_with_slack(both_ways, compare, strain):
    """Paper Fig. 3: on a mass of two modes a cable yields, slackens, yields again; a bar yields both ways."""
    L0, k, heavy, area, dt = 10.0, 1e8, 1e6, 1e-6, 2e-3
    ea, ny = E * area, 1.75e9 * area
    modes = np.linalg.eigh(k / heavy * np.array([[1.0, -1.0], [-1.0, 2.0]]))[1]
    shapes = modes / modes[0]  # of the mass that pulls the cable, 1 in both modes
    start = shapes @ [0.12, -0.20]
    nodes, elements = [], []
    for s, group in enumerate(("cable", "strut")):
        x = L0 + 0.02 + start[0], 2 * L0 + 0.02 + start[1]
        nodes += [
            (10 * s + j, v, 5.0 * s, 0.0, int(j in (0, 3)), 1, 1, heavy if j in (1, 2) else 0.0)
            for j, v in enumerate((0.0, *x, 3 * L0 + 0.02))
        ]
        sections = (group, L0, area, E), *[("driver", L0, 1e-2, k * L0 / 1e-2)] * 2
        elements += [(10 * s + j, 10 * s + j + 1, *of) for j, of in enumerate(sections)]
    text = section(strain) + 'yield_stress = 1.75e9\n[group.strut]\nkind = "bar"\n'
    text += '[group.driver]\nkind = "bar"\nyield_stress = 1e14\n'  # which never yields
    text += timing(2.5, dt, 1, [(nodes[1][1], 0.0), (nodes[5][1], 5.0)])
    elements = table("start,end,group,unstressed_length,area,modulus", elements)
    f = both_ways.solve(text, table("id,x,y,z,fixed_x,fixed_y,fixed_z,mass", nodes), elements)
    heat = 0.0
    for s, group in enumerate(("cable", "bar")):
        L = nodes[1][1] + f["history/probe_displacement"][:, s, 0]
        N = f["history/probe_tension"][:, list(f["history/probe_element"][:]).index(3 * s)]
        eps, eps_p, theirs, stages = (L / L0 - 1 if strain == "engineering" else np.log(L / L0)), 0.0, [], []
        for value in eps:
            before, eps_p = eps_p, max(eps_p, value - ny / ea)
            if group == "bar":
                eps_p = min(eps_p, value + ny / ea)
            if strain == "engineering":
                heat += ny * L0 * abs(eps_p - before)
            else:  # work of the yield force less what is stored: at yield that grows with the residual length
                u = np.copysign(ny / ea, eps_p - before)
                longer = L0 * (np.exp(eps_p) - np.exp(before))
                heat += ea * u * np.exp(u) * longer - ea * (np.exp(u) * (u - 1) + 1) * longer
            theirs.append(max(ea * (value - eps_p), 0.0) if group == "cable" else ea * (value - eps_p))
            of_taut = "yield" if abs(theirs[-1]) > ny * (1 - 1e-12) else "elastic"
            stage = "slack" if theirs[-1] == 0 else of_taut
            stages += [stage] if stages[-1:] != [stage] else []
        if group == "cable":
            twice = ["slack", "elastic", "yield", "elastic"] * 2
            assert stages == [*twice, "slack", "elastic", "slack"], stages
        else:
            assert stages.count("yield") >= 4
        how = " and slack" if group == "cable" else " both ways"
        name = f"{group} through cycles of yield{how}, {strain} strain"
        compare(f"{name}: largest difference of the tension", "paper Fig. 3 along the path").error(
            np.abs(N - theirs).max(), 1e-9, "rounding", "N", scale=ny
        )
        compare("the same: plastic strain at the end", "paper Fig. 3 along the path").figures(
            f["final/plastic_strain"][3 * s], eps_p, 1e-9, "rounding"
        )
    of = "plastic elongation" if strain == "engineering" else "elongation at yield, less stored"
    case = compare(f"both through these cycles, {strain} strain: dissipated", f"yield force times {of}")
    case.figures(f["history/plastic_dissipation"][-1], heat, 1e-9, "rounding", "J")


def test_three_cables_past_yield(both_ways, compare):
    """The middle one of three cables yields: its force remains, the inclined ones carry the rest."""
    H, P = 5.0, 2.2 * NY
    above = [(k, x, 0.0, H, 1, 0.0) for k, x in enumerate((-H, 0.0, H))]
    nodes = table("id,x,y,z,fixed,load_z", [*above, (3, 0.0, 0.0, 0.0, 0, -P)])
    text = "yield_stress = 1.75e9\n[load]\nself_weight = false\nsteps = 11\ntolerance = 1e-10\n"
    f = both_ways.solve(section("engineering") + text, nodes, "start,end\n0,3\n1,3\n2,3\n")
    middle, slant = lambda v: min(EA * v / H, NY), lambda v: EA * (np.hypot(H, H + v) / np.hypot(H, H) - 1)
    carried = lambda v: middle(v) + 2 * slant(v) * (H + v) / np.hypot(H, H + v)
    assert slant(brentq(lambda v: carried(v) - P, 0, 1)) < NY  # the slanted ones stay elastic
    source, why = "equilibrium in place", "residual of the statics, 1e-10 of the load; softer past yield"
    for step in (8, 9, 11):
        v = brentq(lambda v: carried(v) - step / 11 * P, 0, 1, xtol=1e-15)
        load = f"three cables under {step / 5:.1f} times the yield force"
        moved, N = f["statics/displacement"][step, 3, 2], f["statics/tension"][step, 0]
        compare(f"{load}: displacement", source).figures(-moved, v, 1e-9, why, "m")
        compare("the same: force of a slanted cable", source).figures(N, slant(v), 1e-9, why, "N")
