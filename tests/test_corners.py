"""Bending chains with corners or curves without moment: moments, deflections, limits, frequencies."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import audits
from nets import table
from scipy.linalg import eigh
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from test_bending import BAR, chain_job, dense, elements_stiffness, energies, row_of, tangents

from netfall.physics.bending import Joints, curvatures

EXACT = "[load]\nself_weight = false\nsteps = 1\ntolerance = 1e-7\n"
STIFF_LEG = (1e8, 1.0, 1e-3)  # modulus, area, second moment: EI = 1e5 N m2, EA = 1e8 N


def frame(n, degrees):
    """Return nodes (2 n + 2, 2) of two legs of 1 m, n bars each, at an angle, the first clamped by a stub."""
    up = np.column_stack([np.zeros(n + 1), np.arange(n + 1) / n])
    turn = np.radians(180.0 - degrees)
    out = up[-1] + np.arange(1, n + 1)[:, None] / n * [np.sin(turn), np.cos(turn)]
    return np.concatenate([[[0.0, -1e-3 / n]], up, out])


def tip_load(n, P):
    return np.where(np.arange(2 * n + 2) == 2 * n + 1, float(P), 0.0)


def bent_frame(workshop, n, degrees, P, section=STIFF_LEG, more=EXACT):
    """Return the open result file of the frame under a force P [N] down at its tip."""
    places = frame(n, degrees)
    clamped = np.arange(2 * n + 2)[:, None] < [2, 2]
    return workshop.run(chain_job(workshop, places, clamped, tip_load(n, P), section, more))


@pytest.mark.parametrize("degrees, by_hand", [(90.0, 100.0), (120.0, 86.60254)])
@pytest.mark.parametrize("n", [1, 4, 16])
def test_the_moment_at_a_corner_is_that_of_statics(workshop, n, degrees, by_hand):
    """100 N at an arm of sin(angle) x 1 m, at any refinement."""
    with bent_frame(workshop, n, degrees, 100.0) as f:
        moment, d = f["statics/bending_moment"][-1], f["statics/displacement"][-1]
    arm = np.sin(np.radians(180.0 - degrees)) + d[-1, 0] - d[n + 1, 0]
    assert moment[n, 1] == moment[n + 1, 0] == pytest.approx(100.0 * arm, rel=1e-6)
    assert moment[n, 1] == pytest.approx(by_hand, rel=2e-3)  # the arm changes by a thousandth


def independent_frame(n, P, section, phi0):
    """Return angles (2 n,) of the bars from vertical, and their lengths, with the least energy. The unknowns
    are angles and forces of bars, so that no angle is computed from positions: U = sum k (theta_(i+1) -
    theta_i - phi0_i)^2 / 2 + EA / (2 l) (L - l)^2 + P z.
    """
    modulus, area, inertia = section
    EI, EA, side = modulus * inertia, modulus * area, 1.0 / n
    k = np.append(2.0 * EI / (side + 1e-3 * side), np.full(2 * n - 1, EI / side))
    rest = np.zeros(2 * n)
    rest[n] = phi0

    def slope(unknown):
        theta, L = unknown.reshape(2, -1)
        m = k * (np.diff(theta, prepend=0.0) - rest)
        by_angle = m - np.append(m[1:], 0.0) - P * L * np.sin(theta)
        return np.append(by_angle, EA / side * (L - side) + P * np.cos(theta))

    start = np.append(np.repeat([0.0, phi0], n), np.full(2 * n, side))
    solution = root(slope, start, tol=1e-13)
    assert np.abs(slope(solution.x)).max() < 1e-7 * P
    theta, L = solution.x.reshape(2, -1)
    places = np.cumsum(L[:, None] * np.column_stack([np.sin(theta), np.cos(theta)]), axis=0)
    return places, k * (np.diff(theta, prepend=0.0) - rest)


@pytest.mark.parametrize("degrees, P", [(90.0, 1.0), (120.0, 0.8), (60.0, 1.5)])
def test_a_frame_bends_as_the_least_energy_of_an_independent_chain(workshop, degrees, P):
    """Positions and moments of five bars a leg with turns of up to a right angle; EI = 1 N m2, EA = 1e4 N."""
    n, section = 5, (1e4, 1.0, 1e-4)
    more = EXACT.replace("steps = 1", "steps = 4")
    with bent_frame(workshop, n, degrees, P, section, more) as f:
        moved, moment = f["statics/displacement"][-1], f["statics/bending_moment"][-1]
    x = frame(n, degrees) + moved[:, [0, 2]]
    places, m = independent_frame(n, P, section, np.radians(180.0 - degrees))
    assert np.abs(x[2:] - places).max() < 1e-7  # m, of 2 m: the tolerances of both
    assert moment[:-1, 1] == pytest.approx(np.abs(m), abs=1e-6)
    assert np.abs(places[-1] - frame(n, degrees)[-1]).max() > 0.3  # m: large


def test_a_ring_vibrates_as_an_oval():
    """omega^2 = 36 / 5 EI / (m r^4) in its plane (Hoppe 1871), by the tangent, extrapolated."""
    omega2s = []
    for n in (24, 48):
        turn = 2.0 * np.pi * np.arange(n) / n
        x = np.asfortranarray(np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n)]))
        ends = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)]).astype(np.uint32)
        particles = np.column_stack([np.roll(ends[:, 0], 1), ends]).astype(np.uint32)
        side = 2.0 * np.sin(np.pi / n)
        joints = Joints(particles, np.full(n, 1.0 / side), curvatures(x, particles))
        K = dense(joints, tangents(x, joints)[0], n) + elements_stiffness(x, ends, 1e7, np.zeros(n))
        plane = np.flatnonzero(np.arange(3 * n) % 3 < 2)
        omega2 = eigh(K[np.ix_(plane, plane)], side * np.eye(2 * n), eigvals_only=True)
        assert np.abs(omega2[:3]).max() < 1e-3  # rigid motions in the plane, of which none has stiffness
        omega2s.append(omega2[3:5].mean())
    assert (4.0 * omega2s[1] - omega2s[0]) / 3.0 == pytest.approx(7.2, rel=1e-4)  # of the fourth order


def rotated(x, axis, angle):
    return np.asfortranarray(x @ Rotation.from_rotvec(angle * np.asarray(axis, float)).as_matrix().T)


def test_joints_of_any_angle_have_the_plane_energy():
    """U = k (phi - phi0)^2 / 2, also if phi changes its sign, for corners of up to 165 degrees."""
    particles, k = np.array([[0, 1, 2]], np.uint32), np.array([3.0])
    plane = Rotation.from_rotvec([0.3, -0.7, 1.1])

    def places(phi):
        flat = np.array([[-1.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.8 * np.cos(phi), 0.8 * np.sin(phi), 0.0]])
        return np.asfortranarray(plane.apply(flat))

    for phi0 in np.radians([-165.0, -90.0, -10.0, 0.0, 1e-4, 45.0, 165.0]):
        joints = Joints(particles, k, curvatures(places(phi0), particles))
        for phi in np.linspace(-1.0, 1.0, 9):
            away = phi - phi0
            if abs(away) < np.radians(179.0):
                assert energies(places(phi), joints)[0] == pytest.approx(1.5 * away**2, rel=1e-9, abs=1e-28)


def test_the_energy_does_not_depend_on_axes_or_order():
    """A rotation about the normal of the plane, reversed nodes, a shift; a straight chain: any rotation."""
    rng = np.random.default_rng(5)
    turn = np.linspace(0.0, 2.0, 7)
    x0 = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(7)])
    x = np.asfortranarray(x0 + rng.normal(0.0, 0.05, (7, 3)))
    joints = Joints(row_of(7), np.full(5, 2.0), curvatures(x0, row_of(7)))
    U = energies(x, joints)
    assert energies(rotated(x, [0.0, 0.0, 1.0], 0.7) + 3.0, joints) == pytest.approx(U, rel=1e-10)
    back = row_of(7)[:, ::-1].copy()
    assert energies(x, Joints(back, joints.stiffness, curvatures(x0, back))) == pytest.approx(U, rel=1e-10)
    straight = joints.with_values(rest=np.zeros((5, 3)))
    turned = energies(rotated(x, [0.6, 0.0, 0.8], 1.1), straight)
    assert turned == pytest.approx(energies(x, straight), rel=1e-10)


def arc_job(workshop, n, load="load_z"):
    """Return a quarter of a circle, r = 1 m, EI = 1 N m2, n bars and a stub, with 1 mN at its end."""
    turn = np.concatenate([[-1e-3 / n], np.linspace(0.0, np.pi / 2.0, n + 1)])
    rows = [(k, np.cos(t), np.sin(t), 0, int(k < 2), -1e-3 if k == n + 1 else 0) for k, t in enumerate(turn)]
    elements = table("start,end", pairwise(range(n + 2)))
    text = "[cable]\n" + BAR.format(1e6, 1.0, 1e-6) + EXACT.replace("1e-7", "1e-5")
    return workshop.job(text, table(f"id,x,y,z,fixed,{load}", rows), elements)


@pytest.mark.parametrize("n", [6, 32])
def test_across_its_plane_a_curved_chain_bends_as_a_straight_one(workshop, n):
    """P L^3 / 3 EI and P L of the developed length L, 1.292 and 1.571; and a warning at any refinement.

    A tube of that shape with torsion, GJ = EI / 1.3, has 1.248, and a moment of 1 with a torsion of 1.
    """
    done = workshop.run(arc_job(workshop, n), code=None)
    assert "warning: statics: the curved bending chain at node" in done.stdout
    assert "of the largest bending moment" in done.stdout and "is not modelled" in done.stdout
    with workshop.open() as f:
        sinks, moment = -f["statics/displacement"][-1, -1, 2] / 1e-3, f["statics/bending_moment"][-1]
    L = 2.0 * n * np.sin(np.pi / (4.0 * n))
    assert sinks == pytest.approx(L**3 / 3.0 * (1.0 + 1.0 / (2.0 * n * n)), rel=1e-3)  # the stub
    assert moment[1, 0] / 1e-3 == pytest.approx(L, rel=1e-3)


def test_a_curved_chain_has_no_warning_in_its_plane(workshop):
    """The same arc with the force in its plane."""
    assert "bends out of its plane" not in workshop.run(arc_job(workshop, 6, "load_x"), code=None).stdout


def test_a_chain_that_folds_back_is_refused(workshop):
    """Exit code 2, with the node and both elements."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,1\n3,2,0,0,0\n4,1,0.1,0,0\n"
    job = workshop.job("[cable]\n" + BAR.format(1e6, 1.0, 1e-6), nodes, "id,start,end\n7,1,2\n8,2,3\n9,3,4\n")
    text = workshop.run(job, code=2).stderr
    assert "node 3: the bending chain turns back by more than 170 degrees from element 8 to element 9" in text


def test_the_corner_of_a_moving_frame_has_the_moment_of_statics(workshop):
    """A mass at the tip under a force put on at once: M = (P - m a_z) L, a of two modes of the mass.

    Its flexibility along x and z is ((1/3, 1/2), (1/2, 4/3)) L^3 / EI, more by 1 / 6 n^2 on the diagonal for
    joints, and L / EA.
    """
    n, P, mass = 3, 100.0, 1000.0
    flexibility = (np.array([[1.0 / 3.0, 0.5], [0.5, 4.0 / 3.0]]) + np.eye(2) / (6.0 * n * n)) / 1e5
    flexibility += np.eye(2) / 1e7
    mobility, shapes = np.linalg.eigh(flexibility * mass)
    omega = 1.0 / np.sqrt(mobility)
    end = 1.2 * np.pi / omega[1]
    t = np.linspace(0.0, end, 2000)[:, None]
    acceleration = P / mass * (shapes[1] ** 2 * np.cos(omega * t)).sum(1)
    places, last = frame(n, 90.0), 2 * n + 1
    of_last = lambda p: (-P, mass) if p == last else (0.0, 0.0)
    rows = [(p, x, 0, z, int(p < 2), 1, int(p < 2), *of_last(p)) for p, (x, z) in enumerate(places)]
    nodes = table("id,x,y,z,fixed_x,fixed_y,fixed_z,load_z,mass", rows)
    elements = table("start,end", pairwise(range(last + 1)))
    bar = BAR.format(1e7, 1.0, 1e-2).replace("7850.0", "5.0")
    more = f"[load]\nself_weight = false\n[dynamics]\nduration = {end}\nmass_damping = 0.0\n"
    more += f"[output]\nhistory_interval = {end / 500}\n[modes]\ncount = 2\n"
    with workshop.solve("[cable]\n" + bar + more, nodes, elements) as f:
        periods = np.sort(f["modes/period"][:])
        assert periods == pytest.approx(2.0 * np.pi / omega, rel=0.01)  # the mass of the bars
        most = f["envelope/bending_moment_max"][n]
        assert most == pytest.approx(np.abs(P - mass * acceleration).max(), rel=0.02)
        assert (audits(f) < (1e-12, 1e-4)).all()
