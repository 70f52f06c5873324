"""The saddle and the stadium against OpenSees:
static equilibrium and motion of the same nets, elastic, taut and slack.

The answers of OpenSees are stored in opensees_reference.npz, made by opensees_reference.py, and every run
compares with them. If a Python has openseespy, they are also computed again and must be the same.
"""

import functools
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run_process

THEME = "Other programs"
OPENSEES, FOURTH = "OpenSees, corotational trusses", "OpenSees, implicit, fourth order, step to zero"
STORED = ROOT / "tests" / "opensees_reference.npz"
MODULUS, GRAVITY = 1.95e11, 9.81
SADDLE, STADIUM = {"area": 3600e-6, "density": 7900.0}, {"area": 683.08e-6, "density": 7850.0}
YIELD = 1.75e9
STEP = 1e-4  # s, of the saddle


def shipped(name: str) -> str:
    """Return net, cables and form finding of a shipped job without fracture, the form to rounding."""
    text = (ROOT / "jobs" / f"{name}.toml").read_text().split("[load]")[0]
    return re.sub(r"tolerance = \S+", "tolerance = 1e-11", re.sub(r"fracture_strain.*\n", "", text))


@functools.cache
def python_with_opensees() -> str | None:
    for python in (sys.executable, ROOT / ".venv-bench" / "bin" / "python"):
        command = [python, "-c", "import openseespy.opensees"]
        if Path(python).exists() and not run_process(*command, timeout=120, code=None).returncode:
            return str(python)
    return None


def opensees(folder, case: dict) -> dict:
    """Return the present results of OpenSees for a case."""
    np.savez(folder / "case.npz", **case)
    script, files = ROOT / "tests" / "opensees_reference.py", (folder / "case.npz", folder / "answer.npz")
    run_process(python_with_opensees(), script, *files)
    with np.load(folder / "answer.npz") as f:
        return dict(f)


def reference(name: str, folder, case: dict) -> dict:
    """Return the stored results of a case; they equal present ones if OpenSees is installed."""
    store = os.environ.get("NETFALL_OPENSEES") == "store"
    now = opensees(folder, case) if store or python_with_opensees() else {}
    stored = {}
    if STORED.exists():
        with np.load(STORED) as f:
            stored = dict(f)
    if store:
        stored = {key: values for key, values in stored.items() if not key.startswith(f"{name}/")}
        stored |= {f"{name}/{key}": values for key, values in now.items()}
        np.savez_compressed(STORED, **stored)
    own = [key for key in stored if key.startswith(f"{name}/")]
    theirs = {key.removeprefix(f"{name}/"): stored[key] for key in own}
    for key, values in now.items():
        # rounding, as in the rows below
        assert np.abs(values - theirs[key]).max() <= 1e-9 * np.abs(theirs[key]).max(), key
    return theirs


def make_case(
    f, section: dict, static=None, sudden=None, dead=0.0, damping=0.0, step=STEP, every=1, fine=(), stride=1
) -> dict:
    """The net that form finding left, with masses and loads from the job's numbers.
    static, sudden : (n, 3) [N]; the rest as in opensees_reference.py
    """
    elements = f["net/elements"][:]
    L0 = f["form_finding/unstressed_length"][:]
    area = f["net/tributary_area"][:]
    half = 0.5 * section["density"] * section["area"] * L0
    mass = np.bincount(elements.ravel(), np.repeat(half, 2), len(area)) + dead / GRAVITY * area
    zero, moves = np.zeros((len(area), 3)), sudden is not None
    return {
        "x": f["form_finding/position"][:],
        "fixed": f["net/fixed"][:],
        "elements": elements,
        "L0": L0,
        "EA": np.full(len(L0), MODULUS * section["area"]),
        "mass": mass,
        "static": zero if static is None else static,
        "sudden": sudden if moves else zero,
        "damping": damping,
        "step": step,
        "every": every,
        "rows": len(f["history/time"]) - 1 if moves else 0,
        "fine": np.array(fine),
        "stride": stride,
        "particles": f["history/probe_particle"][:] if moves else np.zeros(0, int),
        "elements_at": f["history/probe_element"][:] if moves else np.zeros(0, int),
    }


def vertical(f, pressure: float) -> np.ndarray:
    """Return forces (n, 3) [N] of a pressure [N/m2], upward."""
    return f["net/tributary_area"][:][:, None] * np.array([0.0, 0.0, pressure])


def saddle_wind(f, speed: float, shape: float) -> np.ndarray:
    """Forces (n, 3) [N] of a steady wind on the saddle: -u_s rho U^2 / 2 on the upward vector areas.

    Of each of the four faces around a node, half the cross product of its diagonals, by the corner's share of
    the four triangles from the centroid of the surface to the sides.
    """
    x = f["form_finding/position"][:]
    i, j = np.rint((f["net/particles"][:, :2] + 36.6) / 9.15).astype(int).T
    a = np.array([-36.6, 36.6])
    grid = np.zeros((9, 9, 3))
    grid[::8, ::8, 0], grid[::8, ::8, 1] = a[:, None], a  # the corners, which are no particles
    grid[i, j] = x
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]])
    after = np.roll(corners, -1, axis=0)
    size = lambda top: 0.5 * np.linalg.norm(np.cross(corners - top, after - top), axis=-1)
    middle = corners.mean(0)
    weight = size(middle)
    centroid = np.sum(weight[..., None] * (corners + after + middle) / 3, axis=0) / weight.sum(0)[..., None]
    side = size(centroid)
    share = 0.5 * (side + np.roll(side, 1, axis=0)) / side.sum(0)
    part = share[..., None] * 0.5 * np.cross(corners[2] - corners[0], corners[3] - corners[1])
    vector = np.zeros((9, 9, 3))
    for corner, (down, right) in zip(part, ((0, 0), (1, 0), (1, 1), (0, 1))):
        vector[down : 8 + down, right : 8 + right] += corner
    U = speed * ((x[:, 2] + 10.0) / 10.0) ** 0.16
    return (-shape * 1.25 * U**2 / 2)[:, None] * vector[i, j]


def state_at(f, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements (n, 3) [m] and tensions (m,) [N] of a result: last load step, or final."""
    if name == "static" and "statics" in f:
        return f["statics/displacement"][-1], f["statics/tension"][-1]
    group = f["initial_state" if name == "static" else name]
    return group["position"][:] - f["form_finding/position"][:], group["tension"][:]


def compare_states(compare, what: str, f, theirs: dict, name: str, within: tuple, because: str, stride=1):
    """Compare displacements and tensions of a state, the largest and all."""
    (d, N), most = state_at(f, name), theirs[f"{name}_largest"]
    of = lambda case: compare(f"{what}: {case}", OPENSEES, THEME)
    of("largest displacement").figures(np.linalg.norm(d, axis=1).max(), most[0], within[0], because, "m")
    of("largest tension").figures(N.max(), most[1], within[1], because, "N")
    where = "anywhere" if stride == 1 else f"at every {stride}th"
    for quantity, ours, largest, bound in zip(("displacement", "tension"), (d, N), most, within):
        off = np.abs(ours[::stride] - theirs[f"{name}_{quantity}"]).max() / largest
        of(f"{quantity} {where}, of the largest").error(off, bound, because)


def history_error(f, theirs: dict) -> np.ndarray:
    """Return the largest differences over all rows, relative to the largest displacement and tension."""
    names = "displacement", "tension"
    pairs = [(f[f"history/probe_{name}"][1:], theirs[name]) for name in names]
    return np.array([np.abs(ours - others).max() / np.abs(others).max() for ours, others in pairs])


def compare_histories(compare, what: str, f, theirs: dict, within: tuple, because: str) -> None:
    """Compare the histories at the probes."""
    for quantity, error, bound in zip(("displacement", "tension"), history_error(f, theirs), within):
        case = compare(f"{what}: {quantity} at any time, of the largest", OPENSEES, THEME)
        case.error(error, bound, because)


def rounding(
    f, case: dict, theirs: dict, slack_length: float | None = None
) -> tuple[tuple[float, float], str]:
    """Return the largest effect of rounding, of displacement and tension, and its description.

    A strain is right to its last bit, EA 2^-52 of force: for two elements in both programs it pushes a
    particle freely for the whole time.
    slack_length : [m] of the elements that go slack; as they snap taut, that way meets their full stiffness.
        None: none does
    """
    EA, mass, time = case["EA"][0], np.median(case["mass"][case["fixed"][:, 0] == 0]), f["history/time"][-1]
    way = 0.5 * (2 * EA * np.finfo(float).eps / mass) * time**2
    d, N = np.abs(theirs["displacement"]).max(), np.abs(theirs["tension"]).max()
    shares = way / d, EA / slack_length * way / N if slack_length else way / d
    return shares, f"the same scheme and step: the last bit of the strains, EA 4e-16, pushing for {time:g} s"


def fastest_square(case: dict) -> float:
    """Return a bound of the squared frequency [1/s2] of all modes: largest stiffness over mass."""
    k, ends = case["EA"] / case["L0"], case["elements"]
    square = np.where(case["fixed"].any(1), 0.0, np.bincount(ends.ravel(), np.repeat(k, 2)) / case["mass"])
    return square[ends].sum(1).max()


def elastic(f, section: dict) -> None:
    assert not f["final/plastic_strain"][:].any()
    assert f["VTKHDF/CellData/tension"][:].max() < YIELD * section["area"]


def needs_opensees() -> None:
    """Skip the test without OpenSees, with the command to install it."""
    if python_with_opensees() is None:
        pytest.skip(
            "stored answers only: no Python has openseespy; `bash jobs/bench/run.sh` "
            "makes .venv-bench with it, or pip install .[validation]"
        )


def tensions_in_opensees(model: Path) -> dict[int, float]:
    """Return tensions [N] of an exported model by OpenSees, or skip without it."""
    needs_opensees()
    answer = model.with_name("a.npz")
    run_process(python_with_opensees(), ROOT / "tests" / "opensees_tcl.py", model, answer)
    answers = np.load(answer)
    return dict(zip(answers["element"].tolist(), answers["tension"]))


@pytest.mark.parametrize("stretch", [-1e-3, 1e-3, 5e-2])
def test_the_element_of_opensees_has_the_expected_law(tmp_path, stretch):
    """EA (L - L0) / L0 for a cable that hangs vertically, for any start length."""
    needs_opensees()
    L0, EA = 10.0, 1e6
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -L0 * (1 + stretch)]])
    case = {"x": x, "fixed": np.array([[1, 1, 1], [1, 1, 0]]), "elements": np.array([[0, 1]])}
    case |= {"L0": np.array([L0]), "EA": np.array([EA]), "mass": np.ones(2), "rows": 0, "fine": []}
    case |= {"static": np.array([[0, 0, 0], [0, 0, -2e3]]), "stride": 1}
    if stretch < 0:  # without stiffness until it is taut: held, and without force
        case["fixed"] = np.ones((2, 3), int)
    tensions = opensees(tmp_path, case)
    assert np.isclose(tensions["static_tension"][0], 2e3 if stretch > 0 else 0.0, rtol=1e-12)
    moved = -(L0 * (1 + 2e3 / EA) - L0 * (1 + stretch))
    assert stretch < 0 or np.isclose(tensions["static_displacement"][1, 2], moved, rtol=1e-10)


def test_saddle_under_static_load_and_then_wind(both_ways, compare):
    """2 kN/m2 in ten steps (paper 4.1.2), then a steady downward wind, damped."""
    text = """
[load]
self_weight = false
pressure = [0.0, 0.0, 2000.0]
steps = 10
tolerance = 1e-10
[wind]
onset = "sudden"
speed = 40.0
surface_drag = 0
pressure_coefficient = 0.8
base_height = 10.0
[dynamics]
duration = 1.0
time_step = 1e-4
mass_damping = 0.5
[output]
history_interval = 0.025
probes = [[0.0, 0.0], [0.0, -27.45], [18.3, 9.15]]
"""
    f = both_ways.solve(shipped("saddle") + text)
    case = make_case(f, SADDLE, vertical(f, 2000.0), saddle_wind(f, 40.0, 0.8), damping=0.5, every=250)
    theirs = reference("saddle", both_ways.folder, case)
    elastic(f, SADDLE)
    within, because = (1.1e-9, 1.1e-9), "residual: 1e-10 of 1800 kN is 1.1e-9 of the nodal load"
    compare_states(compare, "saddle, 2 kN/m2 upward", f, theirs, "static", within, because)
    what = "the same, then steady wind, damped"
    because = "the same scheme and step: what the static stage left"
    compare_histories(compare, what, f, theirs, within, because)
    compare_states(compare, f"{what}, after 1 s", f, theirs, "final", within, because)


def test_saddle_under_sudden_load(both_ways, compare):
    """0.8 kN/m2 suddenly, undamped: equal motion; second order against a scheme of fourth order."""
    text = """
[load]
self_weight = false
pressure = [0.0, 0.0, 800.0]
[dynamics]
duration = 0.5
time_step = 1e-4
[output]
history_interval = 0.025
probes = [[0.0, 0.0], [0.0, -27.45], [18.3, 9.15]]
"""
    job = both_ways.job(shipped("saddle") + text)
    f = both_ways.run(job)
    double = both_ways.run(job, "--set", f"dynamics.time_step={2 * STEP}", ranks=1, output="double.vtkhdf")
    case = make_case(f, SADDLE, sudden=vertical(f, 800.0), every=250, fine=(5e-4, 2.5e-4))
    theirs = reference("sudden", both_ways.folder, case)
    elastic(f, SADDLE)
    within, because = rounding(f, case, theirs)
    what = "saddle, 0.8 kN/m2 at once"
    compare_histories(compare, what, f, theirs, within, because)
    compare_states(compare, f"{what}, after 0.5 s", f, theirs, "final", within, because)
    size = lambda f, name: f[f"history/probe_{name}"][1:] - theirs[f"fine_{name}"]
    # a mode's frequency is too high by (w dt)^2 / 24 + 3 (w dt)^4 / 640: the second term is 0.11 (w dt)^2 of
    # the first, and thrice that in the ratio
    for name in ("displacement", "tension"):
        one, two, largest = size(f, name), size(double, name), np.abs(theirs[f"fine_{name}"]).max()
        within, off = 0.5 * np.abs(two - one).max() / largest, np.abs(one).max() / largest
        why = "second order: a third of the change from twice the step, half as much again"
        compare(f"{what}: {name} at any time, of the largest", FOURTH).error(off, within, why)
        ratio, within = np.sqrt(np.sum(two**2) / np.sum(one**2)), 0.34 * fastest_square(case) * STEP**2
        why = "second order; next term of the fastest mode"
        compare(f"{what}: {name}, error of twice the step over error", FOURTH).figures(
            ratio, 4.0, within, why
        )


def test_stadium_under_dead_load(both_ways, compare):
    """The stadium's cladding is applied slowly: 42 cables become slack."""
    load = "[load]\nself_weight = false\ndead = 1000.0\nsteps = 1\ntolerance = 1e-10\n"
    f = both_ways.solve(shipped("stadium") + load)
    case = make_case(f, STADIUM, vertical(f, -1000.0), dead=1000.0, stride=8)
    theirs = reference("stadium", both_ways.folder, case)
    within, because = (2.2e-9, 2.2e-9), "residual: 1e-10 of 104 kN is 2.2e-9 of the nodal load"
    compare_states(compare, "stadium, 1 kN/m2 of cladding", f, theirs, "static", within, because, stride=8)
    ours, others = f["statics/slack"][-1], theirs["static_slack"]
    compare("the same: slack cables", OPENSEES).figures(ours, others, 0, "counted", scale=1.0)


def test_stadium_under_sudden_dead_load(both_ways, compare):
    """The first half second of the shipped job, with its damping but no wind: up to 358 cables go slack.

    As they snap taut again, after 0.6 s, rounding grows tenfold in every 0.06 s: the two programs are 3e-5
    apart after 1 s, and OpenSees parts from itself in the same way if its load changes by 1e-14.
    """
    text = """
[load]
self_weight = false
dead = 1000.0
[dynamics]
duration = 0.5
time_step = 2.5e-4
mass_damping = 0.5
[output]
history_interval = 0.025
probes = [[0.0, 15.4], [0.0, 2.2], [22.0, 15.4]]
"""
    f = both_ways.solve(shipped("stadium") + text)
    motion = dict(dead=1000.0, damping=0.5, step=2.5e-4, every=100, stride=8)
    case = make_case(f, STADIUM, sudden=vertical(f, -1000.0), **motion)
    theirs = reference("stadium at once", both_ways.folder, case)
    elastic(f, STADIUM)
    assert f["history/slack"][:].max() > 300
    within, because = rounding(f, case, theirs, 2.2)
    what = "stadium, cladding at once, damped"
    compare_histories(compare, what, f, theirs, within, because)
    compare_states(compare, f"{what}, after 0.5 s", f, theirs, "final", within, because, stride=8)
