"""Extreme input either runs right or is refused with the reason. `pytest tests/test_extremes.py -s` prints
the table of jobs/trade/README.md.
"""

import numpy as np
import pytest
from conftest import BARE, ROOT, STEEL, audits
from mpi4py import MPI
from nets import saddle, table

A, E = 683.08e-6, 1.95e11
EA, HALF = E * A, 0.5 * 7850.0 * A  # N; kg for each metre
QUICK = "[output]\nhistory_interval = {}\nframes = {}\n"


def reached(what: str, limit: str, figure: float, within: float) -> None:
    """Assert and print a row of the table."""
    print(f"| {what} | {limit} | {figure:.2g} |")
    assert figure <= within, what


def positions(f, particle: int) -> np.ndarray:
    """Return positions (frames, 3) [m] of a particle of the net."""
    return np.array([f["VTKHDF/Points"][int(o) + particle] for o in f["VTKHDF/Steps/PointOffsets"][:]])


def reached_audits(f, what: str, identity: str, balance: str, within: float = 0.01) -> None:
    """Assert both energy checks and print their rows. within : limit of the balance"""
    reached(f"{what}: work identity", identity, audits(f)[0], float(identity))
    reached("the same: physical balance", balance, audits(f)[1], within)


def oscillator(time_step, duration, zeta=0.0, history=1.0):
    """Return 1000 kg on a cable of 10 m under 20 kN, released 1 mm below its equilibrium."""
    L = 10.0 * (1 + 20e3 / EA) + 1e-3
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,{-L!r},0,1000,-20000\n"
    text = BARE + f"[dynamics]\nduration = {duration!r}\ntime_step = {time_step!r}\nmass_damping = {zeta!r}\n"
    text += QUICK.format(history, 10)
    return text, nodes, "start,end,unstressed_length\n1,2,10\n"


LIMIT = float(2 / np.sqrt(EA / 10.0 / (1000.0 + 10 * HALF)))


def test_a_million_steps_just_below_the_limit(workshop):
    """At 0.99 of it the amplitude stays 1 / sqrt(1 - 0.99^2) of the start, as in central difference."""
    dt = 0.99 * LIMIT
    f = workshop.solve(*oscillator(dt, 1e6 * dt, history=1e3 * dt))
    rest = -10.0 * (1 + 20e3 / EA)
    assert int(f["provenance"].attrs["steps"]) == 1_000_000
    amplitude = np.abs(positions(f, 1)[:, 2] - rest).max()
    reached("0.99 of the limit, 1e6 steps: amplitude, of the first", "bounded (7.1)", amplitude / 1e-3, 7.2)
    done = workshop.solve(*oscillator(1.01 * LIMIT, 1.0), code=2)
    assert "above the stable step" in done.stderr


@pytest.mark.parametrize("steps", [1_000_000, pytest.param(10_000_000, marks=pytest.mark.long)])
def test_the_energy_of_an_undamped_oscillator_does_not_drift(workshop, steps):
    """Except for the rounding of the energy checks."""
    dt = 0.1 * LIMIT
    f = workshop.solve(*oscillator(dt, steps * dt, history=steps * dt / 10_007))
    total = f["history/kinetic_energy"][:] + f["history/strain_energy"][:] - f["history/external_work"][:]
    swing = f["history/kinetic_energy"][:].max()
    drift = abs(np.polyfit(np.linspace(0, 1, len(total)), total, 1)[0]) / swing
    reached(f"no damping, {steps:.0e} steps: drift of the energy, of the swing", "1e-3", drift, 1e-3)


def test_damping_far_over_critical(workshop):
    """zeta = 1e4 1/s, 40 times critical: it approaches its equilibrium without vibration."""
    f = workshop.solve(*oscillator(0.5 * LIMIT, 20.0, zeta=1e4, history=0.01))
    z = positions(f, 1)[:, 2] + 10.0 * (1 + 20e3 / EA)
    assert (np.diff(z) >= -1e-12).all()
    k = EA / 10.0 / (1000.0 + 10 * HALF)
    slow = 5e3 - np.sqrt(25e6 - k)
    expected = -1e-3 * np.exp(-slow * f["VTKHDF/Steps/Values"][:])
    off = np.abs(z - expected).max() / 1e-3
    reached("damping 40 times critical: error of the creep", "1e-3 of the first", off, 1e-3)


def chain(lengths, moduli, masses, load, fixed=(0,), along="x"):
    """Return tables of an unstressed straight chain along x or z, with a load on its last particle."""
    x = np.concatenate([[0.0], np.cumsum(lengths)])
    last = len(x) - 1
    place = lambda x: (x, 0, 0) if along == "x" else (0, 0, x)
    nodes = [(k, *place(x[k]), int(k in fixed), masses[k], load if k == last else 0) for k in range(last + 1)]
    elements = [(k, k + 1, moduli[k]) for k in range(last)]
    return table(f"id,x,y,z,fixed,mass,load_{along}", nodes), table("start,end,modulus", elements)


def test_stiffness_and_mass_ratios_of_a_million(workshop):
    """Neighbours are 1e6 times as stiff and as heavy; both energy checks hold."""
    masses = [0.0, 1e6, 1.0, 1e6, 1.0, 1e6, 1.0]
    nodes, elements = chain([2.0] * 6, [1.95e11, 1.95e5] * 3, masses, 10.0, along="z")
    text = BARE + "fracture_strain = 0.9\n"  # never reached
    text += "[dynamics]\nduration = 2.0\n" + QUICK.format(0.01, 5)
    f = workshop.solve(text, nodes, elements)
    reached_audits(f, "stiffness and mass ratios of 1e6", "1e-10", "1e-3", 1e-3)


def test_a_millimetre_next_to_a_kilometre(workshop):
    """1 mm, 1 m and 1 km stretch to twice the static elongation. A step that is too long stops the run."""
    nodes, elements = chain([1e-3, 1.0, 1e3], [1.95e11] * 3, [0.0, 100.0, 100.0, 1e5], 1000.0)
    text = BARE + "[dynamics]\nduration = 20.0\n"
    text += "[output]\nhistory_interval = 0.02\nframes = 5\nprobes = [[1001.001, 0.0]]\n"
    job = workshop.job(text, nodes, elements)
    f = workshop.run(job)
    u = f["history/probe_displacement"][:, 0, 0]
    rest = 1000.0 * 1001.001 / EA
    what = "lengths from 1 mm to 1 km: largest elongation against twice the static one"
    reached(what, "1 %", abs(u.max() / (2 * rest) - 1), 0.01)
    reached("the same: work identity", "1e-9", audits(f)[0], 1e-9)
    longer = float(0.8 * f["provenance"].attrs["limit_any_shape"])
    assert longer > f["provenance"].attrs["limit_slackening"] > f["provenance"].attrs["time_step"]
    done = workshop.run(job, "--set", f"dynamics.time_step={longer!r}", code=3)
    assert "Use a smaller [dynamics] time_step or safety" in done.stderr
    assert "taut again (first: element" in done.stdout


@pytest.mark.parametrize(
    "phase, least, most",
    [
        (0.4, 0.0, 0.001),
        (0.693, 0.005, 0.006),  # the largest up to 0.8
        (0.8, 0.0, 0.005),
        (0.886, 0.015, 0.016),  # the largest up to 1
        (1.0, -1e-3, 1e-3),
        (1.5, 0.065, 0.075),
        (1.6, 0.25, 0.31),
        (1.8, 1.05, 1.09),
    ],
)
def test_a_slack_cable_returns_the_energy_of_an_impact(phase, least, most):
    """A mass runs into it and back with omega dt = phase: energy averaged over the moment of contact."""
    from netfall.explicit.loop import Interval
    from netfall.explicit.plan import StepPlan
    from netfall.parallel.halo import Halo
    from netfall.parallel.subdomain import split_net
    from netfall.physics.fields import Features
    from netfall.physics.state import State

    n, stiffness, mass, reach = 2000, 1e6, 10.0, 1e-5  # reach: m in a step, of a cable of 1 m
    dt = phase / np.sqrt(stiffness / mass)
    pairs = np.arange(2 * n).reshape(n, 2)
    (subdomain,) = split_net(2 * n, pairs, np.zeros(2 * n, np.int32), 1)
    state = State(Features(energy=False), 2 * n, 0, n)
    state.ends[:], state.L0[:], state.EA[:], state.mass[:] = subdomain.ends, 1.0, stiffness, mass
    far = np.isin(subdomain.particle_gid, pairs[:, 1])
    state.free[:] = far[:, None]
    state.x[far, 0] = 1.0 - reach * (np.arange(n) + 0.5) / n
    state.v[far, 0] = reach / dt
    halo = Halo(MPI.COMM_SELF, subdomain, 3)
    StepPlan(state, halo).run(Interval(1, 40, dt, dt, 0.0, 0.0, 1e9))
    assert (state.x[far, 0] < 1.0).all()  # slack again
    gain = float(np.mean((state.v[far, 0] * dt / reach) ** 2)) - 1.0
    assert least <= gain <= most
    what = f"energy gained from a slack cable, mean over the moment, omega dt = {phase}"
    reached(what, f"{least:g} to {most:g}", gain, most)


def test_short_edge_cables_have_the_right_strains(workshop):
    """The cables go slack and taut many times; strains are those of a quarter of the step at "auto"."""
    text = (ROOT / "jobs" / "stadium_paper.toml").read_text()
    lines = text.splitlines(keepends=True)
    job = workshop.job("".join(line for line in lines if not line.startswith("checkpoint_interval")))
    keys = ["--set", "dynamics.duration=2.5", "--set", "output.frames=250"]
    keys += ["--set", "cable.fracture_strain=0.9", "--set", "dynamics.fragments=false"]  # never reached
    strains = []
    for extra in ([], ["--set", "dynamics.safety=0.2"]):
        f = workshop.run(job, *keys, *extra)
        assert f["history/broken"][-1] == 0
        short = np.flatnonzero(
            np.linalg.norm(np.diff(f["net/particles"][:][f["net/elements"][:]], axis=1)[:, 0], axis=1) < 0.5
        )
        strains.append(f["VTKHDF/CellData/strain"][:].reshape(251, -1)[:, short].max())
    what = "largest strain of the stadium's cables below 0.5 m, auto against a quarter of its step"
    reached(what, "0.002", abs(strains[0] - strains[1]), 0.002)


def test_a_net_far_from_the_origin(workshop):
    """1e6 m from the origin it moves like at the origin, to the rounding of its coordinates."""
    results = []
    for shift in (0.0, 1e6):
        k = np.arange(6)
        x, z = 2.0 * k + shift, -0.1 * k * (5 - k) + shift
        rows = [(p, x[p], shift, z[p], int(p in (0, 5)), 100, -500) for p in k]
        nodes = table("id,x,y,z,fixed,mass,load_z", rows)
        text = STEEL.replace("100e3", "5e3") + "[dynamics]\nduration = 2.0\nmass_damping = 0.5\n"
        elements = "start,end\n" + "".join(f"{p},{p + 1}\n" for p in range(5))
        f = workshop.solve(text + QUICK.format(0.01, 20), nodes, elements, output=f"{shift:g}.vtkhdf")
        results.append(f["final/position"][:] - f["net/particles"][:])
    off = np.abs(results[1] - results[0]).max()
    reached("1e6 m from the origin: error of the displacements [m]", "1e-6", off, 1e-6)


def test_no_prestress_and_almost_yield(workshop):
    """Zero prestress, and 99 % of the yield force in equilibrium: nothing moves or yields."""
    for prestress in (0.0, 0.99 / 1.0277 * 1.75e9 * A):  # the steepest cable carries 1.0277 times as much
        text = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 40.0\ncells = 6\n'
        text += STEEL.replace("100e3", repr(prestress)) + "yield_stress = 1.75e9\nfracture_strain = 0.04\n"
        text += '[form_finding]\nmethod = "force_density"\n' if prestress else ""
        text += "[dynamics]\nduration = 0.5\n" + QUICK.format(0.05, 2)
        f = workshop.solve(text)
        start = f["form_finding/position" if prestress else "net/particles"][:]
        moved = np.abs(f["final/position"][:] - start).max()
        share = 1.0277 * prestress / (1.75e9 * A)
        reached(f"prestress {share:.0%} of yield at rest: motion [m]", "1e-9", moved, 1e-9)
        assert not f["final/plastic_strain"][:].any()
    done = workshop.solve(text.replace(repr(prestress), repr(1.02 * prestress)), code=2)
    assert "above the yield force" in done.stderr


@pytest.mark.parametrize("kind", ["cable", "bar"])
def test_an_element_pushed_through_zero_length(workshop, kind):
    """A cable stays slack, a bar pushes back with a bounded force; the energy checks hold."""
    force = -50.0 if kind == "cable" else -3.0 * EA
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,1,0,10,{force!r}\n"
    text = BARE.replace("modulus", f'kind = "{kind}"\nmodulus', 1)
    text += f"[dynamics]\nduration = {1.0 if kind == 'cable' else 0.001}\n"
    text += QUICK.format(1e-3 if kind == "cable" else 1e-6, 20)
    f = workshop.solve(text, nodes, "start,end\n1,2\n")
    z = positions(f, 1)[:, 2]
    assert z.min() < -0.1 and np.isfinite(f["final/tension"][:]).all()
    reached_audits(f, f"a {kind} through zero length", "1e-10", "1 %")


STORM = saddle(section=(E, A, 7850.0)).replace("modulus_factor = 0", 'method = "force_density"')
STORM += "[load]\nself_weight = false\ndead = 300.0\n"


def test_wind_of_150_metres_a_second(workshop):
    """The roof tears off, and both energy checks hold. A speed of 0 is refused."""
    wind = "[wind]\nonset = 'sudden'\nspeed = {}\npressure_coefficient = -1.5\n"
    wind += "base_height = 10.0\nsurface_drag = 0.03\ngust_field = 'point'\n"
    wind += "[dynamics]\nduration = 1.0\nmass_damping = 0.5\n" + QUICK.format(0.01, 5)
    f = workshop.solve(STORM + wind.format(150.0))
    assert f["history/broken"][-1] > 10
    reached_audits(f, "wind of 150 m/s", "1e-9", "1 %")
    done = workshop.solve(STORM + wind.format(0.0), code=2)
    assert "[wind] speed = 0.0: expected" in done.stderr


def test_a_gust_from_calm_within_a_step(workshop):
    """From 0 to 120 m/s within a microsecond."""
    (workshop.folder / "gust.csv").write_text("time,speed\n0,0\n0.1,0\n0.100001,120\n2,120\n")
    text = STORM.partition("[load]")[0] + '[wind]\nonset = "sudden"\nfile = "gust.csv"\n'
    text += "base_height = 10.0\npressure_coefficient = -1.5\n[dynamics]\nduration = 1.0\n"
    text += "mass_damping = 0.5\n"
    f = workshop.solve(text + QUICK.format(0.01, 5))
    assert f["events/time"][0] > 0.1 and not f["history/kinetic_energy"][:9].max() > 1e-6
    reached_audits(f, "gust from nothing to 120 m/s in 1e-6 s", "1e-9", "1 %")


@pytest.mark.parametrize("ranks", [1, 2])
def test_all_elements_break_in_the_same_step(workshop, ranks):
    """A star of twelve equal cables is pulled up at its hub, which flies on alone."""
    angle = 2 * np.pi * np.arange(12) / 12
    rim = [(k + 1, 5 * np.cos(a), 5 * np.sin(a), -5, 1, 0, 0) for k, a in enumerate(angle)]
    nodes = table("id,x,y,z,fixed,mass,load_z", [(0, 0, 0, 0, 0, 100, 200000), *rim])
    text = BARE + "fracture_strain = 2e-4\n[dynamics]\nduration = 0.2\n" + QUICK.format(0.001, 5)
    f = workshop.solve(text, nodes, "start,end\n" + "".join(f"0,{k + 1}\n" for k in range(12)), ranks=ranks)
    assert f["history/broken"][-1] == 12
    apart = float(np.ptp(f["events/step"][:]))
    what = f"all twelve of a star break, {ranks} ranks: steps between the first and the last"
    reached(what, "1", apart, 1.0)
    reached("the same: work identity", "1e-10", audits(f)[0], 1e-10)


def test_a_chain_of_100000_elements(workshop):
    """The chain is pulled at its end for 200 steps on two ranks; the wave has its speed."""
    m = 100_000
    nodes, elements = chain([1.0] * m, [1.95e11] * m, [0.0] * (m + 1), 1e5)
    c = np.sqrt(E / 7850.0)
    text = BARE + f"[dynamics]\nduration = {float(200 / c)!r}\n" + QUICK.format(float(100 / c), 1)
    f = workshop.solve(text, nodes, elements, ranks=2)
    u = (f["final/position"][:] - f["net/particles"][:])[:, 0]
    moved = np.flatnonzero(u > 1e-3 * u.max())
    short = abs((m - moved[0]) / 200 - 1)
    reached("a chain of 1e5 elements: reach of the wave against c t", "3 %", short, 0.03)
    reached("the same: end displacement against P c t / EA", "1 %", abs(u[-1] / (1e5 * 200 / EA) - 1), 0.01)
