"""The dynamic stage compared with a plain one, step by step, and with prescribed motions."""

import contextlib
import os
import random
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest
from conftest import BIN, ENVIRONMENT, IN_PLAIN_PYTHON, PLAIN, assert_same_results, children_of, on_ranks
from plain_step import GRAVITY, Plain
from random_nets import table

from netfall.parallel.partition import write_partition

SIDE, SPACING = 5, 4.0  # nodes, m
MODULUS, AREA, DENSITY = 1.0e10, 1.0e-4, 7000.0
DT, STEPS = 2.5e-3, 130  # s
SAFETY = 0.4
YIELD, WEAK = 45.0e6, 5.0e6  # Pa, of cables and struts
BREAK, BRITTLE = 0.012, 0.003  # strains, likewise
WEAKER, FASTER = 0.003, 1.3  # strain and factor of the wind with which parts lose their supports
SPEEDS = np.array([[-0.1, 22.0], [0.061, 36.0], [0.2113, 25.0], [0.2718, 2.0], [2.0, 30.0]])
JOB = f"""
[cable]
modulus = {MODULUS}
area = {AREA}
density = {DENSITY}
yield_stress = {YIELD}
fracture_strain = {BREAK}
[group.strut]
kind = "bar"
yield_stress = {WEAK}
fracture_strain = {BRITTLE}
area = {2 * AREA}
[load]
self_weight = true
dead = 30.0
snow = 20.0
pressure = 60.0
ramp = 0.2
[wind]
onset = "sudden"
file = "wind.csv"
pressure_coefficient = -1.1
air_density = 1.25
profile_exponent = 0.0
after_fracture = "{{after}}"
[dynamics]
duration = {DT * STEPS}
time_step = {DT}
safety = {SAFETY}
mass_damping = 0.7
fragment_mass = 0.5
[output]
history_interval = {DT * 10}
frames = 4
probes = [12, [4.0, 8.0]]
elements = [41, 3, 29]
"""


def make_tables():
    """Return a bowl-shaped grid with held, sprung and partly held nodes, struts, areas, masses and loads."""
    rng = np.random.default_rng(5)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"))
    n = SIDE * SIDE
    x = np.column_stack([SPACING * i, SPACING * j, 0.05 * (i - 2.0) ** 2 - 0.04 * (j - 2.0) ** 2])
    x += rng.uniform(-0.2, 0.2, (n, 3))
    edge = (i == 0) | (i == SIDE - 1) | (j == 0) | (j == SIDE - 1)
    free = ~np.repeat(edge[:, None], 3, 1)
    free[6] = [False, True, True]
    sprung = np.flatnonzero(edge)[[3, 9]]
    free[sprung] = True
    spring = np.zeros((n, 3))
    spring[sprung] = [2e5, 3e5, 1.5e5]
    number = np.arange(n).reshape(SIDE, SIDE)
    ends = [*zip(number[:-1].ravel(), number[1:].ravel())]
    ends += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel())]
    ends = np.array([*ends, (6, 12), (12, 18), (8, 12), (12, 16)])
    bar = np.arange(len(ends)) >= len(ends) - 4
    length = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    normal = np.column_stack([rng.uniform(-0.2, 0.2, (n, 2)), np.ones(n)])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return dict(
        x=x,
        free=free,
        spring=spring,
        ends=ends,
        L0=length / (1.0 + np.where(bar, -4e-4, rng.uniform(-1e-3, 3e-3, len(ends)))),
        bar=bar,
        area=np.where(edge, 0.0, rng.uniform(12.0, 18.0, n)),
        normal=normal,
        carried=rng.uniform(25.0, 45.0, n),
        load=rng.uniform(-300.0, 300.0, (n, 3)),
    )


def as_files(t: dict) -> tuple[str, str]:
    """Return nodes.csv and elements.csv."""
    each = lambda name, values: {f"{name}_{k}": c.tolist() for k, c in zip("xyz", values.T)}
    nodes = {"id": t.get("names", range(len(t["x"])))} | dict(zip("xyz", t["x"].T.tolist()))
    nodes |= each("fixed", 1 - t["free"].astype(int)) | each("spring", t["spring"]) | each("load", t["load"])
    nodes |= {"mass": t["carried"].tolist(), "area": t["area"].tolist()} | each("normal", t["normal"])
    names = np.array(list(nodes["id"]))
    elements = {"id": t.get("ids", range(len(t["ends"]))), "unstressed_length": t["L0"].tolist()}
    elements |= dict(zip(("start", "end"), names[t["ends"]].T.tolist()))
    return table(nodes), table(elements | {"group": np.where(t["bar"], "strut", "")})


def plain_of(t: dict) -> Plain:
    """Return the same job computed by hand: the loads of [load] and [wind] on these areas and normals."""
    section = np.where(t["bar"], 2.0, 1.0) * AREA
    half = 0.5 * DENSITY * section * t["L0"]
    own = np.bincount(t["ends"].ravel(), np.repeat(half, 2), len(t["x"]))
    weight = 30.0 * t["area"] + 20.0 * t["area"] * t["normal"][:, 2]
    load = t["load"].copy()
    load[:, 2] -= weight + GRAVITY * own
    outward = t["area"][:, None] * t["normal"]
    return Plain(
        x=t["x"].copy(),
        free=t["free"],
        mass=own + t["carried"] + weight / GRAVITY,
        load=load,
        growing=-60.0 * outward,
        ramp=0.2,
        wind=1.1 * 0.5 * 1.25 * outward,
        speed=SPEEDS,
        spring=t["spring"],
        ends=t["ends"].copy(),
        L0=t["L0"],
        EA=MODULUS * section,
        limit=np.where(t["bar"], WEAK, YIELD) * section,
        eps_u=np.where(t["bar"], BRITTLE, BREAK),
        half=half,
        bar=t["bar"],
        zeta=0.7,
        stable_dt=DT / SAFETY,
        drag=0.5 * 1.25 * t["area"],
    )


MIDDLE = 70 * DT  # s, after some fractures


def run_here(workshop, text: str, tables: dict, name: str = "result", wind=(1.0, 1.0)):
    """Run the job in this process; return it and its result. wind : factors of the times and speeds"""
    rows = dict(zip(("time", "speed"), (SPEEDS * wind).T.tolist()))
    (workshop.folder / "wind.csv").write_text(table(rows))
    job = workshop.job(text, *as_files(tables), name=name)
    return job, workshop.run_here(job, f"{name}.vtkhdf")


def events_of(f) -> list[tuple]:
    """Return step, element, particle and new particle of each fracture."""
    names = ("step", "element", "particle", "new_particle")
    return list(zip(*(f[f"events/{name}"][:].tolist() for name in names)))


@pytest.fixture(scope="module")
def torn(shared_workshop):
    """Return the job, and its result on one rank."""
    return run_here(shared_workshop, JOB.format(after="particle"), make_tables())


def test_every_step_equals_the_plain_one(torn):
    """With all features, to rounding that fast fragments increase: 1e-9 of the largest of each quantity."""
    f, plain = torn[1], plain_of(make_tables())
    start = plain.energies(DT, 0.0)["strain"]
    plain.run(DT, STEPS)
    assert events_of(f) == [event[:4] for event in plain.events]
    close = lambda one, other: np.abs(one - other).max() <= 1e-9 * np.abs(other).max()
    assert close(f["events/mass"][:], np.array([event[4] for event in plain.events]))
    assert close(f["events/time"][:], DT * np.array([event[0] for event in plain.events]))
    row = np.argsort(f["final/particle_id"][:])
    order = np.argsort(plain.id)
    assert f["final/particle_id"][:][row].tolist() == sorted(plain.id)
    assert close(f["final/position"][:][row], plain.x[order])
    end = plain.energies(DT, DT * STEPS)
    assert close(f["final/velocity"][:][row], plain.velocity[order])
    assert close(f["final/tension"][:], plain.axial(plain.strains()[0])[0])
    assert close(f["final/plastic_strain"][:], plain.axial(plain.strains()[0])[1])
    last = lambda name: f[f"history/{name}"][-1]
    assert close(last("kinetic_energy"), end["kinetic"])
    assert close(last("plastic_dissipation"), end["plastic"])
    assert close(last("strain_energy"), end["strain"] - start)
    assert close(last("external_work"), end["external"]) and close(last("damping_work"), end["damping"])
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12  # rounding
    assert f["envelope/slack_time"][:] == pytest.approx(10 * DT * np.sum(plain.slack[1:], axis=0), abs=1e-12)
    assert f["VTKHDF/Steps/Values"][:] == pytest.approx(DT * STEPS * np.linspace(0, 1, 5), abs=DT)
    # error of the step; the plastic work is 7 %
    assert np.abs(f["history/energy_balance_error"][:]).max() < 0.02
    assert last("plastic_dissipation") > 0.05 * last("external_work")
    # what the case is to have: each kind of event, and slack
    assert len(plain.events) > 3 and (plain.eps_p < 0).any() and last("slack") > 3
    for k, e in enumerate(f["history/element"][:]):
        assert f["history/element_tension"][-1, k] == f["final/tension"][e]
    moved = f["final/position"][:] - f["net/particles"][:][f["final/particle_id"][:] % SIDE**2]
    at = [row[p] for p in f["history/probe_particle"][:]]
    assert (f["history/probe_displacement"][-1] == moved[at]).all() and len(at) == 2


@pytest.mark.parametrize("after, fragments", [("all", True), ("none", False)])
def test_options_of_the_wind_equal_the_plain_ones(workshop, after, fragments):
    """The wind ends with the first fracture, or never; broken elements are removed."""
    plain = plain_of(make_tables())
    plain.after, plain.fragments = after, fragments
    text = JOB.format(after=after).replace("[dynamics]", f"[dynamics]\nfragments = {str(fragments).lower()}")
    f = run_here(workshop, text, make_tables())[1]
    plain.run(DT, STEPS)
    assert fragments or any(plain.bar[event[1]] for event in plain.events)
    assert events_of(f) == [event[:4] for event in plain.events] != []
    position = f["final/position"][:][np.argsort(f["final/particle_id"][:])]
    assert np.abs(position - plain.x[np.argsort(plain.id)]).max() <= 1e-9 * np.abs(plain.x).max()
    heat = plain.energies(DT, DT * STEPS)["plastic"]
    assert f["history/plastic_dissipation"][-1] == pytest.approx(heat, rel=1e-9)


def test_detached_parts_have_the_drag_of_the_plain_step(workshop):
    """Detached parts have drag instead of pressure: positions, velocities and energies to rounding."""
    plain = plain_of(make_tables())
    plain.after, plain.eps_u = "detached", np.where(plain.bar, BRITTLE, WEAKER)
    plain.speed = SPEEDS * (1.0, FASTER)
    text = JOB.format(after="detached").replace(f"= {BREAK}", f"= {WEAKER}")
    f = run_here(workshop, text, make_tables(), wind=(1.0, FASTER))[1]
    plain.run(DT, STEPS)
    assert plain.loose[: SIDE**2].sum() > 2, plain.loose
    assert events_of(f) == [event[:4] for event in plain.events]
    row, order = np.argsort(f["final/particle_id"][:]), np.argsort(plain.id)
    end = plain.energies(DT, DT * STEPS)
    for name, other in (("position", plain.x), ("velocity", plain.velocity)):
        assert np.abs(f[f"final/{name}"][:][row] - other[order]).max() <= 1e-9 * np.abs(other).max(), name
    assert f["history/external_work"][-1] == pytest.approx(end["external"], rel=1e-9)
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12


def test_two_ranks_and_a_restart_give_its_bits(torn, shared_workshop):
    """Broken and yielding elements cross the ranks; then from its checkpoint."""
    job, one = torn
    more = "--set", f"output.checkpoint_interval={MIDDLE}"
    with shared_workshop.run(job, *more, ranks=2, output="two.vtkhdf") as two:
        assert_same_results(one, two)
    (checkpoint,) = shared_workshop.folder.glob("two.checkpoint*")
    with h5py.File(checkpoint) as file:  # each particle knows how many elements are left at it
        ends, n = file["elements/ends"][:].astype(int), SIDE**2
        rows = np.where(ends < n, ends, n + np.searchsorted(np.sort(ends[ends >= n]), ends))
        assert file["particles/valence"][:].ravel().tolist() == np.bincount(rows.ravel()).tolist()
    again = shared_workshop.run(job, *more, "--restart", checkpoint, ranks=2, output="again.vtkhdf")
    assert_same_results(one, again)
    assert 3 < one["history/broken"][int(MIDDLE / (10 * DT))] < one["history/broken"][-1]


@pytest.mark.skipif(IN_PLAIN_PYTHON, reason="nothing is compiled")
def test_compiled_code_gives_the_bits_of_plain_python(torn, shared_workshop):
    """The same functions without the compiler, by Python's arithmetic and the C library's fma."""
    job, compiled = torn
    with shared_workshop.run(job, output="plain.vtkhdf", environment=PLAIN) as plain:
        assert_same_results(compiled, plain)


def test_air_and_two_branches_have_equal_bits_on_ranks_and_after_a_restart(shared_workshop):
    """Until detached parts lose their added mass; the work identity holds."""
    text = JOB.format(after="detached").replace(f"= {BREAK}", f"= {WEAKER}")
    for section, keys in {
        "load": "added_mass = 2.0",
        "wind": "aerodynamic_damping = 0.8",
        "dynamics": "axial_damping_ratio = 0.01\naxial_damping_band = [1.0, 20.0]",
    }.items():
        text = text.replace(f"[{section}]\n", f"[{section}]\n{keys}\n")
    job, one = run_here(shared_workshop, text, make_tables(), name="air", wind=(1.0, 1.5))
    assert one["history/broken"][-1] > 3 and np.abs(one["history/work_identity_error"][:]).max() < 1e-10
    assert one["history/air_work"][-1] > 0.0 and one["history/band_damping_work"][-1] > 0.0
    more = "--set", f"output.checkpoint_interval={100 * DT}"
    with shared_workshop.run(job, *more, ranks=2, output="air2.vtkhdf") as two:
        assert_same_results(one, two)
    (checkpoint,) = shared_workshop.folder.glob("air2.checkpoint*")
    with h5py.File(checkpoint) as file:
        assert file["particles/detached"][: SIDE**2].sum() == 8
    again = shared_workshop.run(job, *more, "--restart", checkpoint, ranks=2, output="again.vtkhdf")
    assert_same_results(one, again)


PULLED = """
[cable]
modulus = 1e10
area = 1e-4
density = 1000.0
fracture_strain = 2e-3
[group.strong]
fracture_strain = 5e-3
[dynamics]
duration = 0.008
time_step = 1e-4
[output]
history_interval = 0.001
"""
THREE = "id,x,y,z,fixed,load_y\n0,-5,0,0,1,0\n1,0,0,0,0,2e4\n2,5,0,0,1,0\n"


@pytest.mark.parametrize("owners", ["001", "110"])
def test_a_node_that_separates_on_two_ranks_is_separate_on_both(workshop, owners):
    """The node loses one cable within its rank, then the one across the cut.

    Both break at the node: 20 kN across them against 2 and 5 kN in them. For either rank the second one takes
    the rest of the mass along, and the load ends.
    """
    job = workshop.job(PULLED, THREE, "start,end,group\n0,1,\n1,2,strong\n")
    one = workshop.run(job, output="one.vtkhdf")
    assert one["events/element"][:].tolist() == [0, 1] and (one["events/particle"][:] == 1).all()
    assert one["events/new_particle"][:].tolist() == [3 + 2 * 0 + 1, 3 + 2 * 1 + 0]
    # 20 kN on 0.5 kg; the cables hold up to 250 N of it, and a step is a fortieth of the time
    sag = 5.0 * np.sqrt(1.002**2 - 1.0)
    assert one["events/time"][0] == pytest.approx(np.sqrt(2.0 * sag / (2e4 / 0.5)), rel=0.04)
    ends = np.array([[0, 1], [1, 2]])
    folder = workshop.folder / "partitions"
    folder.mkdir()
    write_partition(folder, job.stem, ends, np.array(list(owners), int), 2)
    assert_same_results(one, workshop.run(job, ranks=2, output="two.vtkhdf"))


JUST = """
[cable]
modulus = 1e10
area = 1e-4
density = 1000.0
yield_stress = 4e7
[dynamics]
duration = {T}
time_step = {dt}
[output]
history_interval = {T}
"""


def test_a_cable_that_is_pulled_just_beyond_its_yield_force_yields(workshop):
    """Half of 1.005 N_y acts suddenly: it moves by N_y^2 / 2 k (N_y - F), by energy, and N_y / k back."""
    k, limit, force, mass = 2e5, 4e3, 0.5 * 1.005 * 4e3, 20.0 + 0.25
    period = 2.0 * np.pi * np.sqrt(mass / k)
    nodes = f"id,x,y,z,fixed_x,fixed_y,fixed_z,mass,load_x\n0,0,0,0,1,1,1,0,0\n1,5,0,0,0,1,1,20,{force}\n"
    job = workshop.job(JUST.format(T=0.6 * period, dt=period / 1000), nodes, "start,end\n0,1\n")
    f = workshop.run_here(job)
    left = (limit**2 / (2.0 * k * (limit - force)) - limit / k) / 5.0
    # the peak lies between steps: (2 pi / 1000)^2 / 8 of the way, which is 200 times what is left
    assert f["final/plastic_strain"][0] == pytest.approx(left, rel=2e-3)


# --- motions that were prescribed

TAPPED = """
[cable]
modulus = 1e10
area = 1e-4
density = 5000.0
strain_measure = "logarithmic"
[wind]
taps = "taps.csv"
pressures = "pressures.csv"
onset = "sudden"
[dynamics]
duration = {T}
time_step = {dt}
mass_damping = 0.6
[output]
history_interval = {T}
probes = [2, 3]
"""
HALF_LINE = (
    "id,x,y,z,fixed_x,fixed_y,fixed_z,mass,area,normal_x,normal_y,normal_z\n"
    "1,-4,0,0,1,1,1,0,,,,\n2,0,0,0,1,1,0,30,4,0,0,1\n3,4,0,0,1,1,0,50,5,0,0,1\n4,8,0,0,1,1,1,0,,,,\n"
)
RELAXED, SPAN, PERIOD = 3.99, 4.0, 1.2  # m, m, s
MASS = np.array([30.0, 50.0]) + 5000.0 * 1e-4 * RELAXED
SURFACE = np.array([4.0, 5.0])


def prescribed(t):
    """Return height, velocity and acceleration (2, t) of the two nodes, from equilibrium."""
    size, rate = np.array([[0.3], [-0.2]]), np.array([[3.0], [5.0]])
    return size * (1 - np.cos(rate * t)), size * rate * np.sin(rate * t), size * rate**2 * np.cos(rate * t)


def pressures_for(t):
    """Pressures (2, t) [N/m2] on the two nodes that make them move so: -A p = M (z'' + zeta z') - f(z)."""
    z, v, a = prescribed(t)
    rise = np.diff(np.vstack([0 * t, z, 0 * t]), axis=0)
    L = np.hypot(SPAN, rise)
    pull = 1e6 * np.log(L / RELAXED) * rise / L
    return -(MASS[:, None] * (a + 0.6 * v) - np.diff(pull, axis=0)) / SURFACE[:, None]


def test_a_prescribed_motion_is_met_at_second_order(workshop):
    """Tapped pressures at each step, damping and logarithmic strain give positions and works."""
    (workshop.folder / "taps.csv").write_text("name,x,y\nA,0,0\nB,4,0\n")
    own = np.array([1e6, 1 / 16]) / (1e6 + 1 / 16)  # weights of both taps at a node: 1 / d^2, d at least 1 mm
    weights = np.array([own, own[::-1]])
    fine = np.linspace(0.0, PERIOD, 20001)
    z, v, _ = prescribed(fine)
    power = -SURFACE[:, None] * pressures_for(fine) * v
    exact = {
        "external_work": np.trapezoid(power.sum(0), fine),
        "damping_work": np.trapezoid(0.6 * (MASS[:, None] * v**2).sum(0), fine),
        "kinetic_energy": 0.5 * (MASS * v[:, -1] ** 2).sum(),
    }
    errors = []
    for steps in (150, 300, 600):
        t = np.linspace(0.0, PERIOD, steps + 1)
        at_taps = np.linalg.solve(weights, pressures_for(t))
        columns = {"time": t.tolist(), "A": at_taps[0].tolist(), "B": at_taps[1].tolist()}
        (workshop.folder / "pressures.csv").write_text(table(columns))
        text, name = TAPPED.format(T=PERIOD, dt=PERIOD / steps), f"steps-{steps}"
        links = table({"start": [1, 2, 3], "end": [2, 3, 4], "unstressed_length": [RELAXED] * 3})
        job = workshop.job(text, HALF_LINE, links, name=name)
        f = workshop.run_here(job, f"{name}.vtkhdf")
        off = f["history/probe_displacement"][-1, :, 2] - z[:, -1]
        errors.append([*off, *(f[f"history/{name}"][-1] - value for name, value in exact.items())])
        errors[-1].append(f["history/energy_balance_error"][-1])
    errors = np.abs(errors)
    order = np.log2(errors[:-1] / errors[1:])
    assert order[1] == pytest.approx(2.0, abs=0.1), (errors, order)
    assert errors[-1, :2].max() < 1e-4  # m, of 0.6 m


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.parametrize("seed", range(3))
def test_ranks_that_are_stopped_at_random_change_no_bit(workshop, seed):
    run_long = JOB.format(after="particle").replace(f"duration = {DT * STEPS}", "duration = 10.0")
    run_long = run_long.replace(f"history_interval = {DT * 10}", "history_interval = 5.0")
    (workshop.folder / "wind.csv").write_text("time,speed\n-0.1,22.0\n0.06,36.0\n0.2,25.0\n70.0,12.0\n")
    job = workshop.job(run_long, *as_files(make_tables()))
    one = workshop.run(job, output="one.vtkhdf")
    line = [*on_ranks(3), BIN / "netfall", "run", job, "-o", workshop.folder / "three.vtkhdf"]
    process = subprocess.Popen(line, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
    choose, stops = random.Random(seed), 0
    while process.poll() is None:
        ranks = children_of(process.pid, b"netfall")
        time.sleep(choose.uniform(0.0, 0.02))
        if len(ranks) < 3:
            continue
        with contextlib.suppress(ProcessLookupError):
            stopped = choose.choice(ranks)
            os.kill(stopped, signal.SIGSTOP)
            time.sleep(choose.uniform(0.0, 0.03))
            os.kill(stopped, signal.SIGCONT)
            stops += 1
    assert process.returncode == 0 and stops > 5
    assert_same_results(one, workshop.open("three.vtkhdf"))
