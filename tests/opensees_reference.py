"""Answers of OpenSees for tests/test_validation_opensees.py: corotational trusses, slack without force.

    python opensees_reference.py CASE.npz ANSWER.npz      by any Python that has openseespy

The tests write the case, a form-found net, and compare netfall with the answers in
tests/opensees_reference.npz. If OpenSees is available they also compute these again. The stored answers are
those of openseespy 3.7.1.2. Only this command renews them:

    NETFALL_OPENSEES=store .venv/bin/python -m pytest tests/test_validation_opensees.py

A case: x (n, 3) [m], fixed (n, 3), elements (m, 2), EA (m,) [N], L0 (m,) [m], mass (n,) [kg]; static (n, 3)
[N], in ten steps, then sudden (n, 3) [N] at t = 0; damping [1/s], step [s], every: steps between rows, rows:
of the history, 0: statics alone, fine: steps [s] of the implicit scheme; particles, elements_at: of the
history; stride: of the particles and elements whose last state is stored; lost (optional): elements removed
at t = 0.
"""

import sys

import numpy as np
import openseespy.opensees as ops

STATIC_STEPS = 10


def make_net(case: dict) -> None:
    """Make the net in equilibrium without load."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for p, (x, held, m) in enumerate(zip(case["x"].tolist(), case["fixed"].tolist(), case["mass"].tolist())):
        ops.node(p, *x)
        ops.mass(p, m, m, m)
        ops.fix(p, *map(int, held))
    L = np.linalg.norm(case["x"][case["elements"][:, 1]] - case["x"][case["elements"][:, 0]], axis=1)
    for e, ((a, b), length, unstressed, EA) in enumerate(
        zip(case["elements"].tolist(), L.tolist(), case["L0"].tolist(), case["EA"].tolist())
    ):
        # OpenSees refers strains to the length at the start: modulus and initial strain follow from that; the
        # last 0 is the modulus in compression
        ops.uniaxialMaterial("Elastic", 2 * e, EA * length / unstressed, 0.0, 0.0)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * e + 1, 2 * e, (length - unstressed) / length)
        ops.element("corotTruss", e, a, b, 1.0, 2 * e + 1)
    ops.timeSeries("Constant", 1)
    ops.timeSeries("Linear", 2)
    ops.constraints("Plain")


def add_load(pattern: int, series: int, load) -> None:
    """Apply forces (n, 3) [N] to the nodes."""
    ops.pattern("Plain", pattern, series)
    for p in np.flatnonzero(load.any(1)).tolist():
        ops.load(p, *load[p].tolist())


def newton() -> None:
    """Select Newton's method, to the last digits of the displacements."""
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormDispIncr", 1e-12, 50, 0, 0)
    ops.algorithm("Newton")


def displacements(nodes) -> np.ndarray:
    """Return the displacements (n, 3) [m]."""
    return np.array([ops.nodeDisp(int(p)) for p in nodes])


def tensions(elements) -> np.ndarray:
    """Return the tensions (m,) [N]; 0 for removed elements."""
    present = set(ops.getEleTags())
    return np.array([ops.basicForce(int(e))[0] if int(e) in present else 0.0 for e in elements])


def find_equilibrium(case: dict) -> None:
    """Find the equilibrium under the static load, which remains."""
    if not case["static"].any():
        return
    add_load(1, 2, case["static"])
    newton()
    ops.integrator("LoadControl", 1.0 / STATIC_STEPS)
    ops.analysis("Static")
    assert ops.analyze(STATIC_STEPS) == 0
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()
    ops.constraints("Plain")


def history(case: dict, every: int, step: float, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements (t, p, 3) and tensions (t, k) at an interval of steps; first: before row 1."""
    d, N = [], []
    for row in range(int(case["rows"])):
        assert ops.analyze(every if row else first, step) == 0
        d.append(displacements(case["particles"]))
        N.append(tensions(case["elements_at"]))
    return np.array(d), np.array(N)


def lose(case: dict) -> np.ndarray:
    """Remove the lost elements; return their forces (n, 3) [N] on the nodes."""
    removed = np.zeros_like(case["x"])
    for e in map(int, case.get("lost", ())):
        a, b = case["elements"][e].tolist()
        xa, xb = (case["x"][p] + ops.nodeDisp(p) for p in (a, b))
        pull = ops.basicForce(e)[0] * (xb - xa) / np.linalg.norm(xb - xa)
        removed[a] -= pull
        removed[b] += pull
        ops.remove("element", e)
    return removed


def central_difference(case: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return the history by explicit central difference."""
    step, damping = float(case["step"]), float(case["damping"])
    make_net(case)
    find_equilibrium(case)
    if damping:
        ops.rayleigh(damping, 0.0, 0.0, 0.0)
    ops.numberer("Plain")
    ops.system("Diagonal")
    ops.algorithm("Linear", "-factorOnce")
    ops.integrator("CentralDifference")
    ops.analysis("Transient")
    # It starts from x(-1) = x(0), with a whole kick where half a step of motion is due: a load that makes it
    # half a kick, damped over half a step
    half = 0.5 * (1 + 0.5 * damping * step) / (1 + 0.25 * damping * step)
    add_load(2, 1, half * case["sudden"] - (1 - half) * lose(case))
    assert ops.analyze(1, step) == 0
    ops.remove("loadPattern", 2)
    add_load(3, 1, case["sudden"])
    return history(case, int(case["every"]), step, int(case["every"]) - 1)


def fourth_order(case: dict, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the history by Fox and Goodwin's method of fourth order (Newmark: gamma 1/2, beta 1/12)."""
    make_net(case)
    add_load(1, 1, case["sudden"])
    for p, axis in np.argwhere(
        case["fixed"] == 0
    ).tolist():  # without it OpenSees starts without acceleration: first order
        ops.setNodeAccel(p, axis + 1, float(case["sudden"][p, axis] / case["mass"][p]), "-commit")
    newton()
    ops.integrator("Newmark", 0.5, 1 / 12)
    ops.analysis("Transient")
    every = round(float(case["every"]) * float(case["step"]) / step)
    return history(case, every, step, every)


def answers(case: dict) -> dict:
    """Return all values that the tests compare."""
    particles, elements = range(len(case["x"])), range(len(case["elements"]))
    results = {}

    def keep_state(name: str) -> None:
        d, N = displacements(particles), tensions(elements)
        results[f"{name}_displacement"], results[f"{name}_tension"] = (
            d[:: int(case["stride"])],
            N[:: int(case["stride"])],
        )
        results[f"{name}_largest"] = np.array([np.linalg.norm(d, axis=1).max(), N.max()])
        results[f"{name}_slack"] = np.array((N == 0).sum())

    if case["static"].any():
        make_net(case)
        find_equilibrium(case)
        keep_state("static")
    if case["rows"]:
        results["displacement"], results["tension"] = central_difference(case)
        keep_state("final")
    if len(case["fine"]):
        coarse, fine = (fourth_order(case, float(step)) for step in case["fine"])
        ratio = (case["fine"][0] / case["fine"][1]) ** 4
        for name, a, b in zip(("fine_displacement", "fine_tension"), coarse, fine):
            results[name] = b + (b - a) / (ratio - 1)  # Richardson
    return results


if __name__ == "__main__":
    with np.load(sys.argv[1]) as f:
        given = dict(f)
    np.savez(sys.argv[2], **answers(given))
