"""Constant loads compared with hand calculations: permanent loads, snow, temperature, elastic supports,
cases, the equilibrium under the mean wind and the ramp of gusts.
"""

import h5py
import numpy as np
import pytest
from conftest import assert_same_results, audits
from nets import LOW_SADDLE, WEAK
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from netfall.job.read import read_job
from netfall.model.layout import make_layout
from netfall.post.checks.nodes import reaction_columns
from netfall.results.datasets import find_group

EA, L0 = 1e6, 5.0  # N, m: two cables from the middle node to supports 5 m away at either side
CABLE = "[cable]\nmodulus = 1e10\narea = 1e-4\ndensity = 1000.0\n"
ELEMENTS = "start,end,unstressed_length\n1,2,5\n2,3,5\n"
IN_LINE = "start,end\n1,2\n2,3\n"


def nodes(more="", values=("", "", "")):
    """Return the table of three nodes in a row, the middle one with a roof area of 4 m2."""
    a, b, c = values
    head = f"id,x,y,z,fixed,area,normal_x,normal_y,normal_z{more}\n"
    return f"{head}1,-5,0,0,1,,,,{a}\n2,0,0,0,0,4,0,0,1{b}\n3,5,0,0,1,,,,{c}\n"


def pull(w):
    """Return the force [N] of the two cables at a sag w [m]."""
    L = np.hypot(5.0, w)
    return 2 * EA * (L / L0 - 1) * w / L


def sag(force):
    """Return the sag [m] of the middle of two elastic cables under a transverse force [N]."""
    return brentq(lambda w: pull(w) - force, 0.0, 5.0, xtol=1e-14)


def test_permanent_loads_act_before_the_load_steps(workshop):
    """Dead load and self weight, then two steps of snow of 500 N/m2 and a node's load of 300 N."""
    text = CABLE + "[load]\nself_weight = true\ndead = 250.0\nsnow = 500.0\nsteps = 2\ntolerance = 1e-10\n"
    tables = nodes(",load_z", (",", ",-300", ",")), ELEMENTS
    f = workshop.solve(text, *tables)
    own = 1000.0 * 1e-4 * 5.0 * 9.81  # half of each of two cables
    forces = own + 1000.0 + np.array([0.0, 0.5, 1.0]) * (2000.0 + 300.0)
    assert f["statics/load_factor"][:].tolist() == [0.0, 0.5, 1.0]
    w = -f["statics/displacement"][:, 1, 2]
    assert w == pytest.approx([sag(force) for force in forces], rel=1e-8)  # residual 1e-10 of the load


def test_snow_acts_on_the_area_in_plan_and_its_mass_moves(workshop):
    """On a slope of 3 in 4 it is 0.8 of that on the surface. The first acceleration is force / mass."""
    text = CABLE + "[load]\nself_weight = false\nsnow = 500.0\ndead = 100.0\n"
    text += "[dynamics]\nduration = 1e-3\n[output]\nhistory_interval = 1e-3\n"
    f = workshop.solve(text, nodes().replace("4,0,0,1", "4,-0.6,0,0.8"), ELEMENTS)
    assert f["net/plan_area"][1] == pytest.approx(3.2, rel=1e-12)
    weight = 500.0 * 3.2 + 100.0 * 4.0
    mass = 1000.0 * 1e-4 * 5.0 + weight / 9.81
    # in 1 ms it falls g' t^2 / 2, unhindered by cables that are straight: their pull is of third order
    assert -f["final/position"][1, 2] == pytest.approx(0.5 * weight / mass * 1e-6, rel=1e-3)


@pytest.mark.parametrize("strain", ["engineering", "logarithmic"])
def test_temperature_changes_the_unstressed_length(workshop, strain):
    """A cable with 20 kN in its form, between rigid supports, is cooled by 30 K: L0 (1 - 30 alpha)."""
    text = (
        CABLE + f'prestress = 20e3\nstrain_measure = "{strain}"\nthermal_expansion = 2e-5\n[form_finding]\n'
    )
    text += "[load]\nself_weight = false\ntemperature = -30.0\nsteps = 1\ntolerance = 1e-10\n"
    f = workshop.solve(text, nodes(), IN_LINE)
    lengths = f["form_finding/unstressed_length"][:]
    cold = lengths * (1.0 - 30.0 * 2e-5)
    expected = EA * (np.log(5.0 / cold) if strain == "logarithmic" else 5.0 / cold - 1.0)
    assert f["statics/tension"][0] == pytest.approx(expected, rel=1e-9)
    assert f["statics/tension"][0] == pytest.approx(20e3 + EA * 6e-4, rel=1e-2)


def sprung(k, load):
    """Return a cable of 5 m from a support to a node that moves along x, on a spring of k [N/m]."""
    head = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_x,load_x\n"
    return f"{head}1,0,0,0,1,1,1,,\n2,5,0,0,0,1,1,{k},{load}\n"


def test_a_spring_has_the_reaction_of_the_form_and_shares_later_loads(both_ways):
    """The form has 20 kN with the node held. Then 3 kN act: u = F / (k + EA / L0), and EA u / L0 is added."""
    text = CABLE + "prestress = 20e3\n[form_finding]\n[load]\nself_weight = false\nsteps = 1\n"
    f = both_ways.solve(text + "tolerance = 1e-10\n", sprung(4e5, 3000.0), "start,end\n1,2\n")
    unstressed = 5.0 / (1.0 + 20e3 / EA)
    u = 3000.0 / (4e5 + EA / unstressed)
    assert f["statics/displacement"][:, 1, 0] == pytest.approx([0.0, u], rel=1e-8, abs=1e-12)
    assert f["statics/tension"][-1] == pytest.approx([20e3 + EA * u / unstressed], rel=1e-9)
    reactions = reaction_columns(f)
    of_spring = reactions["force_x"][reactions["node"] == 2]
    # the spring carries the load of its own node too: 20 kN in the form, then k u in addition
    assert of_spring == pytest.approx([-20e3, -20e3, -20e3 + 4e5 * u], rel=1e-9)  # 1e-10 of the load
    at_both = [reactions["force_x"][reactions["stage"] == name].sum() for name in set(reactions["stage"])]
    assert sorted(at_both) == pytest.approx([0.0, 0.0, 3000.0], abs=1e-5)


def test_a_mass_on_a_spring_and_a_cable_vibrates_with_their_stiffness(both_ways):
    """A step load of 3 kN: u = u_s (1 - cos omega t), omega^2 = (k + EA / L0) / m; energies balance."""
    k, unstressed = 4e5, 5.0 / (1.0 + 20e3 / EA)
    omega = np.sqrt((k + EA / unstressed) / (50.0 + 0.5 * 0.1 * unstressed))
    table = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z,load_z,mass\n"
    table += f"2,0,0,-5,1,1,0,{k},-3000,50\n1,0,0,0,1,1,1,,,\n"  # of the two at [0, 0] the first is the probe
    text = CABLE + "prestress = 20e3\n[form_finding]\n[dynamics]\nduration = 0.2\ntime_step = 1e-5\n"
    text += "[output]\nhistory_interval = 0.01\nprobes = [[0.0, 0.0]]\n"
    f = both_ways.solve(text, table, "start,end\n1,2\n")
    t, u = f["history/time"][:], -f["history/probe_displacement"][:, 0, 2]
    static = 3000.0 / (k + EA / unstressed)
    # central difference: (omega dt)^2 / 24 of the phase, 1e-7
    assert u == pytest.approx(static * (1 - np.cos(omega * t)), abs=2e-6 * static)
    assert np.abs(f["history/energy_balance_error"][:]).max() < 1e-6


def test_a_stiff_support_is_in_the_step_limit(workshop):
    """One free axis: 2 / omega with the spring; a longer step is refused."""
    text = CABLE + "[dynamics]\nduration = 0.1\ntime_step = 2e-3\n"
    tables = sprung(1e8, 0.0), "start,end,unstressed_length\n1,2,5\n"
    job = workshop.job(text, *tables)
    limit = 2.0 / np.sqrt((1e8 + EA / 5.0) / 0.25)
    assert f"above the stable step {limit:.4g} s" in workshop.run(job, code=2).stderr
    workshop.run(job, "--set", f"dynamics.time_step={0.99 * limit}")


def test_cases_start_from_the_permanent_state_and_do_not_affect_load_steps(both_ways):
    """Two cases have their own equilibria; load steps have those of a job without cases."""
    base = CABLE + "[load]\nself_weight = false\ndead = 250.0\nsnow = 500.0\nsteps = 2\ntolerance = 1e-10\n"
    cases = '[[case]]\nname = "none"\nset = {"load.snow" = 0.0}\n[[case]]\nname = "lift"\n'
    cases += 'set = {"load.snow" = 0.0, "load.pressure" = -1000.0}\n'
    with both_ways.solve(base, nodes(), ELEMENTS) as alone:
        steps = alone["statics/displacement"][:]
    f = both_ways.solve(base + cases, nodes(), ELEMENTS)
    assert np.array_equal(f["statics/displacement"][:], steps)
    assert -f["cases/none/displacement"][1, 2] == pytest.approx(sag(1000.0), rel=1e-8)
    assert f["cases/lift/displacement"][1, 2] == pytest.approx(sag(3000.0), rel=1e-8)
    assert f["cases/lift/tension"][0] == pytest.approx(EA * (np.hypot(5, sag(3000.0)) / 5 - 1), rel=1e-8)


WIND = "[wind]\nspeed = 30.0\nsurface_drag = {k}\npressure_coefficient = -1.0\nbase_height = 10.0\n"
WIND += "gust_field = 'point'\n{more}"
MEASURED = '[wind]\nfile = "wind.csv"\nbase_height = 10.0\npressure_coefficient = -1.0\n'
TAPPED = '[wind]\npressures = "p.csv"\ntaps = "taps.csv"\n'
MOVES = "[dynamics]\nduration = {time}\n[output]\nhistory_interval = 0.01\nprobes = [[0.0, 0.0]]\n"
FORCE = 0.5 * 1.25 * 30.0**2 * 4.0  # N, at 10 m above ground


def test_a_steady_wind_stays_in_equilibrium(workshop):
    """Dead load and suction: the equilibrium by hand holds for 2 s. Applied suddenly the wind overshoots."""
    text = CABLE + "[load]\nself_weight = false\ndead = 100.0\ntolerance = 1e-10\n"
    text += WIND.format(k=0, more="") + MOVES.format(time=2)
    f = workshop.solve(text, nodes(), ELEMENTS)
    lift = sag(FORCE - 400.0)
    assert f["initial_state/position"][1, 2] == pytest.approx(lift, rel=1e-8)
    assert f["initial_state/tension"][0] == pytest.approx(EA * (np.hypot(5, lift) / 5 - 1), rel=1e-8)
    moved = f["history/probe_displacement"][:, 0, 2]
    assert np.abs(moved - lift).max() < 1e-6 * lift  # the residual, 1e-10 of the load, over its stiffness
    sudden = workshop.solve(text.replace("[wind]\n", '[wind]\nonset = "sudden"\n'), nodes(), ELEMENTS)
    moved = sudden["history/probe_displacement"][:, 0, 2]
    assert moved.max() > 1.3 * lift


def test_gusts_start_with_a_cosine_ramp(workshop):
    """Against the same seed without ramp: the mean, then (1 - cos(pi t / ramp)) / 2 of the gust, then all."""
    text = CABLE + "[load]\nself_weight = false\ndead = 100.0\n" + WIND.format(k=0.005, more="{onset}")
    text += MOVES.format(time=2)
    speed = {}
    for onset in ('onset = "static"\nramp = 1.0\n', 'onset = "sudden"\n'):
        f = workshop.solve(text.replace("{onset}", onset), nodes(), ELEMENTS)
        speed[onset[9:15]] = f["wind/speed"][:]
        t, mean = f["wind/time"][:], f["wind/mean_speed"][:]
    share = np.where(t < 1.0, 0.5 * (1 - np.cos(np.pi * t)), 1.0)[:, None]
    assert speed["static"] == pytest.approx(mean + share * (speed["sudden"] - mean), rel=1e-12)
    assert np.ptp(speed["sudden"]) > 5.0


def test_a_table_of_speeds_starts_in_equilibrium_under_its_mean(workshop):
    """Two rows, 20 m/s rising to 40 over 4 s: the mean is 30. Samples are added during the ramp."""
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n4,40\n")
    text = CABLE + MEASURED + MOVES.format(time=4)
    f = workshop.solve(text, nodes(), ELEMENTS)
    assert f["wind/mean_speed"][:] == pytest.approx([30.0])
    assert f["initial_state/position"][1, 2] == pytest.approx(sag(FORCE), rel=1e-4)
    # displacements do not count from that start, but from the net as given
    assert f["VTKHDF/PointData/displacement"][1, 2] == pytest.approx(sag(FORCE), rel=1e-4)
    described = {dataset.name: dataset.meaning for dataset in find_group("VTKHDF").datasets}
    assert "from the form or the net as given" in described["PointData/displacement"]
    t, speed = f["wind/time"][:], f["wind/speed"][:, 0]
    share = np.where(t < 2.0, 0.5 * (1 - np.cos(np.pi * t / 2)), 1.0)
    assert speed == pytest.approx(30 + share * (20 + 5 * t - 30), rel=1e-12)
    assert (t <= 2.0).sum() >= 16


def test_check_and_info_describe_the_measured_wind_that_acts(workshop):
    """A ramp twice as long as the stage leaves half of the rise from the mean of 30 to 40 m/s at its end."""
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n4,40\n")
    text = CABLE + MEASURED + "ramp = 8.0\n" + MOVES.format(time=4)
    job = workshop.job(text, nodes(), ELEMENTS)
    factor = workshop.run(job)["wind/gust_factor"][0]
    assert factor == pytest.approx(35.0 / 30.0, rel=1e-12)
    ratios = f"gust factors of {factor:.3g} to {factor:.3g}, without the ramp 1.33 to 1.33\n"  # 40 / 30
    assert ratios in workshop.check(job)
    assert "wind: mean 30.0 m/s, 29.8 to 35.0 m/s at 1 point" in workshop.info()


@pytest.mark.parametrize(
    "wind, force, remedy",
    [(WIND.format(k=0, more=""), FORCE, "of its pressure"), (TAPPED, 1000.0, "of the mean pressures. Lower")],
)
def test_a_mean_wind_that_breaks_a_cable_is_an_error_with_the_load_carried(workshop, wind, force, remedy):
    """The limit is the force at a strain of 1e-3, by hand, to 1/64. Taps give the share without a speed."""
    text = CABLE + "fracture_strain = 1e-3\n" + wind + MOVES.format(time=1)
    job = tapped(workshop, text, "name,x,y\nA,0,0\n", "time,A\n0,-250\n1,-250\n")
    errors = workshop.run(job, code=3).stderr
    L = 5.0 * 1.001
    borne = 2 * EA * 1e-3 * np.sqrt(L * L - 25.0) / L / force
    carried = float(errors.split("up to ")[1].split(f" {remedy}")[0])
    assert carried == pytest.approx(borne, abs=1 / 64 + 0.005)  # halved six times, two digits shown
    assert "the mean wind: no equilibrium: element 0 breaks" in errors
    assert ("speed" in errors) == ("speed" in wind)


def test_cables_that_yield_under_the_mean_wind_stay_longer(workshop):
    """In equilibrium they carry their yield force of 2 kN. Their plastic strain follows from the sag."""
    text = CABLE + "yield_stress = 2e7\nfracture_strain = 0.9\n" + WIND.format(k=0, more="")
    text += MOVES.format(time=0.5)
    f = workshop.solve(text, nodes(), ELEMENTS)
    assert f["initial_state/tension"][:] == pytest.approx([2000.0, 2000.0], rel=1e-12)
    sine = FORCE / 4000.0
    assert f["initial_state/position"][1, 2] == pytest.approx(5 * sine / np.sqrt(1 - sine**2), rel=1e-4)
    L = np.hypot(5.0, f["initial_state/position"][1, 2])
    assert f["final/plastic_strain"][:] == pytest.approx((L - 5) / 5 - 2e-3, rel=1e-6)
    assert f["history/kinetic_energy"][:].max() < 1e-6  # J, of 20 J that the cables store


CROSS = (
    "id,x,y,z,fixed\n0,0,0,0,0\n1,5,0,0,1\n2,0,5,0,1\n3,-5,0,0,1\n4,0,-5,0,1\n",
    "start,end,group\n0,1,weak\n0,2,\n0,3,\n0,4,\n1,2,\n2,3,\n3,4,\n4,1,\n",
)
TORN = (
    CABLE + "yield_stress = 1e12\n[group.weak]\nfracture_strain = 2e-4\n[load]\nself_weight = false\n"
    "dead = 50.0\n[wind]\nspeed = 20.0\nsurface_drag = 0.0\npressure_coefficient = -1.0\n"
    'base_height = 10.0\nonset = "sudden"\nafter_fracture = "{}"\n[dynamics]\nduration = 20\n'
    "mass_damping = 1.0\nfragment_mass = 0\n[output]\nhistory_interval = 0.5\n"
)


def on_three_cables(force):
    """Return the equilibrium of a node on cables to (0, +-5) and (-5, 0) under an upward force [N]."""
    ends = np.array([[0, 5, 0], [-5, 0, 0], [0, -5, 0]], float)

    def unbalanced(x):
        d = ends - x
        L = np.linalg.norm(d, axis=1)
        return (EA * np.maximum(L / 5 - 1, 0) / L) @ d + [0, 0, force]

    return fsolve(unbalanced, [-0.05, 0.0, 0.3], xtol=1e-13)


@pytest.mark.parametrize("after, share", [("panels", 0.5), ("none", 1.0)])
def test_panels_at_a_broken_cable_leave_with_their_wind_and_weight(both_ways, after, share):
    """Two of four triangles around a node belong to the cable that breaks: half of all loads remain."""
    f = both_ways.solve(TORN.format(after), *CROSS)
    assert f["events/element"][:].tolist() == [0] and f["net/tributary_area"][0] == pytest.approx(50.0 / 3.0)
    q = 0.5 * 1.25 * 20.0**2
    rest = on_three_cables(share * (q - 50.0) * 50.0 / 3.0)
    # what the damping of 1/s leaves of the swing after 20 s: exp(-10); no weight of the cables
    assert f["final/position"][0] == pytest.approx(rest, abs=1e-4)
    assert (audits(f) < (1e-9, 1e-3)).all()


def test_energies_balance_while_panels_tear_off(both_ways):
    """A collapse on one rank and on two has the same bits, and both energy checks hold."""
    text = (
        LOW_SADDLE + WEAK + "dead = 200.0\nsnow = 100.0\n[wind]\nspeed = 50.0\nturbulence_intensity = 0.2\n"
        'pressure_coefficient = -1.5\nonset = "sudden"\nafter_fracture = "panels"\n'
        "base_height = 10.0\ngust_field = 'point'\n"
        "[dynamics]\nduration = 1.0\nsafety = 0.2\n"
    )
    f = both_ways.solve(text)
    assert len(f["events/time"]) > 3
    assert (audits(f) < (1e-9, 1e-2)).all()


TAPS = "name,x,y\nA,-1,0\nB,1,0\n"


def tapped(workshop, text, taps=TAPS, pressures="time,A,B\n0,-400,-400\n2,-400,-400\n"):
    """Return a job with pressures at taps."""
    (workshop.folder / "taps.csv").write_text(taps)
    (workshop.folder / "p.csv").write_text(pressures)
    return workshop.job(text, nodes(), ELEMENTS)


@pytest.mark.parametrize("suffix", ["csv", "h5"])
def test_pressures_at_taps_start_in_equilibrium_under_their_mean(workshop, suffix):
    """Two taps are equally far from the node, which has their mean. The ramp starts from its equilibrium."""
    time, a = np.array([0.0, 1.0, 2.0]), np.array([-400.0, -800.0, -400.0])
    value = np.column_stack([a, a - 200.0])
    (workshop.folder / "taps.csv").write_text(TAPS)
    if suffix == "csv":
        rows = (",".join(map(str, [t, *row])) for t, row in zip(time, value))
        (workshop.folder / "p.csv").write_text("\n".join(["time,A,B", *rows]) + "\n")
    else:
        with h5py.File(workshop.folder / "p.h5", "w") as file:
            file["time"], file["value"] = time, value
    text = CABLE + f'[wind]\npressures = "p.{suffix}"\ntaps = "taps.csv"\nramp = 0.5\n' + MOVES.format(time=2)
    f = workshop.solve(text, nodes(), ELEMENTS)
    mean = -700.0  # of both taps over two seconds
    assert f["initial_state/position"][1, 2] == pytest.approx(sag(-mean * 4.0), rel=1e-4)
    assert f["wind/mean_pressure"][1] == pytest.approx(mean)
    t, pressure = f["wind/time"][:], f["wind/pressure"][:].mean(1)
    share = np.where(t < 0.5, 0.5 * (1 - np.cos(2 * np.pi * t)), 1.0)
    assert pressure == pytest.approx(mean + share * (np.interp(t, time, a) - 100.0 - mean), rel=1e-12)
    # by its own equation of motion, with the pressure of the file, linear between its samples
    mass = 1000.0 * 1e-4 * 5.0
    force = lambda now, w: -np.interp(now, t, pressure) * 4.0 - pull(w)
    rate, start = lambda t, y: [y[1], force(t, y[0]) / mass], [f["initial_state/position"][1, 2], 0]
    solution = solve_ivp(rate, (0, 2), start, rtol=1e-9, atol=1e-12)
    assert f["history/probe_displacement"][-1, 0, 2] == pytest.approx(solution.y[0, -1], rel=2e-3)


@pytest.mark.parametrize("x, is_far", [(-5000, True), (-5, False), (-30, False)])
def test_taps_far_outside_the_roof_are_a_warning(workshop, x, is_far):
    """A net from x = -5 to 5 m has a tap at -5000, probably in mm. It would count as much as any other."""
    text = CABLE + TAPPED + MOVES.format(time=2)
    output = workshop.check(tapped(workshop, text, f"name,x,y\nA,{x},0\nB,1,0\n"))
    line = "[wind] taps: 1 of 2 taps lie far outside the roof, the farthest at x, y = -5000, 0 m by 4995 m"
    assert (line in output) == is_far and ("far outside" in output) == is_far


@pytest.mark.parametrize(
    "load, weight, mass, expected",
    [
        ("self_weight = true", -4905, 0, "warning: load_z of node 2: 4905 N|500 kg in all"),
        ("self_weight = true", -4905, 500, None),
        ("self_weight = false\nsteps = 1", -4905, 0, None),
        ("self_weight = true", 0, 500, "warning: column mass of node 2: 500 kg without|-4905 N in all"),
        ("self_weight = false\ntemperature = 1.0", 0, 500, None),
    ],
)
def test_weights_without_mass_and_masses_without_weight_are_warnings(workshop, load, weight, mass, expected):
    """4905 N are 500 kg, if the node moves. 500 kg have no self weight, although elements have theirs."""
    nodes = f"id,x,y,z,fixed,load_z,mass\n1,0,0,0,1,{-9 * (mass == 0)},{7 * (weight == 0)}\n"
    nodes += f"2,0,0,-2,0,{weight},{mass}\n"
    text = CABLE + f"[load]\n{load}\n" + "[dynamics]\nduration = 1.0\n" * ("steps" not in load)
    notes = make_layout(read_job(workshop.job(text, nodes, "start,end\n1,2\n")), 1).notes
    warnings = [note for note in notes if "without mass" in note or "without weight" in note]
    assert len(warnings) == bool(expected)
    assert all(words in note for note in warnings for words in expected.split("|"))


@pytest.mark.parametrize("more, is_noted", [("", True), ('[[stage]]\nname = "s"\nrelease = [1]\n', False)])
def test_the_mass_of_a_held_node_is_a_note(workshop, more, is_noted):
    """The mass never moves, unless a stage releases the node."""
    nodes = "id,x,y,z,fixed,mass\n1,0,0,0,1,5000\n2,0,0,-2,0,0\n3,0,0,-4,1,0\n"
    text = CABLE + "[load]\nself_weight = true\n[dynamics]\nduration = 1.0\n" + more
    notes = make_layout(read_job(workshop.job(text, nodes, "start,end\n1,2\n2,3\n")), 1).notes
    note = "note: column mass of node 1: no effect: held along all axes. [N467]"
    assert (note in notes) == is_noted


@pytest.mark.parametrize("more, calm", [("", True), ("[[remove]]\nelements = [1]\ntime = 1.0\n", False)])
def test_a_net_with_member_removals_is_not_called_unloaded(workshop, more, calm):
    """A removal loads a prestressed net that has no other loads."""
    text = CABLE + "prestress = 1e3\nfracture_strain = 0.01\n" + MOVES.format(time=2) + more
    line = "elements can break, but no wind, load, temperature or removal acts on the net"
    assert (line in workshop.check(workshop.job(text, nodes(), IN_LINE))) == calm


def test_given_pressures_need_no_description_of_speeds(workshop):
    """No aerodynamic damping, because the speed is unknown, and no height of the profile; but the periods."""
    text = CABLE + TAPPED + "base_height = 0.0\n" + MOVES.format(time=2)
    output = workshop.check(tapped(workshop, text))
    assert "modes in equilibrium under the mean wind" in output
    assert "the air" not in output and "above ground" not in output
    assert "[wind] base_height: no effect: the wind comes from pressures" in output


@pytest.mark.parametrize(
    "lines, message",
    [
        ('pressures = "p.csv"\n', "taps: missing"),
        ('pressures = "p.csv"\ntaps = "taps.csv"\nspeed = 20\n', "speed and pressures exclude each other"),
        ('pressures = "p.csv"\ntaps = "taps.csv"\npressure_coefficient = 1\n', "exclude each other"),
        ('pressures = "p.csv"\ntaps = "taps.csv"\n', "p.csv: column"),
    ],
)
def test_wrong_pressures_are_refused(workshop, lines, message):
    """The error has a place and a remedy; nothing is computed."""
    text = CABLE + "[wind]\n" + lines + MOVES.format(time=2)
    assert message in workshop.run(tapped(workshop, text, TAPS, "time,A\n0,1\n2,1\n"), code=2).stderr


STORM = (
    LOW_SADDLE + WEAK + "dead = 200.0\nsnow = 100.0\nsteps = 2\ntemperature = -20.0\n"
    '[[case]]\nname = "deep"\nset = {"load.snow" = 300.0}\n[[case]]\nname = "none"\nset = {"load.snow" = 0}\n'
    "[wind]\nspeed = 33.0\nturbulence_intensity = 0.3\npressure_coefficient = -1.5\nramp = 0.2\n"
    "direction = 30.0\n"
    "base_height = 10.0\ngust_field = 'point'\n"
    'after_fracture = "panels"\n[dynamics]\nduration = 0.6\n'
    "[output]\ncheckpoint_interval = 0.31\nframes = 20\n"
)


@pytest.mark.parametrize("ranks", [2, *(pytest.param(n, marks=pytest.mark.long) for n in (3, 4))])
def test_a_storm_resumed_after_fractures_has_the_same_bits(workshop, ranks):
    """Cases, load steps, equilibrium, gusts and torn panels, resumed on another number of ranks."""
    job = workshop.job(STORM)
    whole = workshop.run(job)
    assert 0 < (whole["events/time"][:] < 0.31).sum() < len(whole["events/time"])
    (checkpoint,) = workshop.folder.glob("*checkpoint-5-*")
    again = workshop.run(job, "--restart", checkpoint, ranks=ranks, output="again.vtkhdf")
    assert assert_same_results(whole, again) > 60


CASES = STORM[: STORM.index("[wind]")].replace("steps = 2\n", "") + STORM[STORM.index("[dynamics]") :]


@pytest.mark.parametrize("text, after", [*((STORM, k) for k in (12, 24, 30, 42)), (CASES, 20)])
def test_a_pause_anywhere_in_the_equilibria_changes_no_bit(workshop, text, after):
    """Permanent state, cases, load steps, mean wind: stopped at a residual check, resumed on two ranks."""
    text = text.replace("duration = 0.6", "duration = 0.01").replace("checkpoint_interval = 0.31\n", "")
    workshop.assert_pause_changes_no_bit(workshop.job(text), after, "in statics, ")
