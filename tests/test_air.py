"""Aerodynamic damping and added mass compared with closed forms; also in fractures, ranks and restarts."""

import numpy as np
import pytest
from conftest import BARE, audits

RHO = 1.25
STEADY = '[wind]\nonset = "sudden"\nspeed = 20.0\nsurface_drag = 0.0\nprofile_exponent = 0.0\n'
PLATE = "id,x,y,z,fixed,mass,load_z,area,normal_x,normal_y,normal_z\n1,0,0,0,1,0,0,0,0,0,1\n"


def free_plate(kappa, step, damping=0.0, air=0.0):
    """Return a plate of 4 m2 and 100 kg under 500 N upward, on a slack cable."""
    nodes = PLATE + "2,0,0,-9,0,100,500,4,0,0,1\n"
    text = BARE + STEADY
    text += f"pressure_coefficient = 0.0\naerodynamic_damping = {kappa}\n[load]\nself_weight = false\n"
    text += f"added_mass = {air}\n[dynamics]\nduration = 1.0\ntime_step = {step}\nmass_damping = {damping}\n"
    text += f"[output]\nhistory_interval = {step}\nprobes = [2]\n"
    return text, nodes, "start,end,unstressed_length\n1,2,10.0\n"


HALF_CABLE = 0.5 * 7850.0 * 683.08e-6 * 10.0  # kg


@pytest.mark.parametrize("damping, air", [(0.0, 0.0), (0.5, 30.0)])
def test_a_free_plate_in_steady_wind_decays_as_the_scheme_does(workshop, damping, air):
    """v(n+1/2) = ((1 - b) v(n-1/2) + dt F / M) / (1 + b), b = (kappa rho U A + zeta m) dt / 2M."""
    kappa, step = 0.7, 2e-3
    f = workshop.solve(*free_plate(kappa, step, damping, air))
    z = f["history/probe_displacement"][:, 0, 2]
    own, g = 100.0 + HALF_CABLE, kappa * RHO * 20.0 * 4.0
    M = own + 4.0 * air
    drag = g + damping * own
    expected = flight(lambda t, dt: drag / (1.0 + 0.5 * drag * dt / M), step, M)
    assert np.abs(z - expected).max() < 1e-13 * abs(z).max() + 1e-14
    t = f["history/time"][:]
    terminal = 500.0 / drag
    exact = terminal * (t - M / drag * (1 - np.exp(-drag / M * t)))
    assert np.abs(z - exact).max() < 1e-5 * exact.max()  # second order of a step of 1e-3 of the time it takes
    h = f["history"]
    assert np.abs(h["work_identity_error"][:]).max() < 1e-12
    speed = terminal * (1 - np.exp(-drag / M * t))
    work = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] ** 2 + speed[:-1] ** 2) * np.diff(t))]) * g
    assert np.allclose(h["air_work"][:], work, rtol=1e-4, atol=1e-4 * work[-1])


def test_between_samples_of_the_wind_the_factor_of_the_air_is_linear(workshop):
    """v(n+1/2) = v + dt (F - C (v + dt F / 2M)) / M, C = g / (1 + b), g = kappa rho U A, b = g dt / 2M.

    C at the samples and linear between them. With C of the very speed, which is linear too, C is off by
    b (dU / U)^2 / 4 at most, b of U half-way: 2.5e-4 here.
    """
    kappa, step = 0.7, 2e-3
    text, nodes, elements = free_plate(kappa, step)
    (workshop.folder / "wind.csv").write_text("time,speed\n0,20\n0.4,40\n1,10\n")
    text = text.replace("speed = 20.0", 'file = "wind.csv"').replace("surface_drag = 0.0\n", "")
    f = workshop.solve(text, nodes, elements)
    z, M = f["history/probe_displacement"][:, 0, 2], 100.0 + HALF_CABLE
    factor = lambda U, dt: kappa * RHO * 4.0 * U / (1 + 0.5 * dt / M * kappa * RHO * 4.0 * U)
    samples, speeds = [0.0, 0.4, 1.0], np.array([20.0, 40.0, 10.0])
    expected = flight(lambda t, dt: np.interp(t, samples, factor(speeds, dt)), step, M)
    assert len(z) == 501 and np.abs(z - expected).max() < 1e-12 * abs(z).max()
    exact = flight(lambda t, dt: factor(np.interp(t, samples, speeds), dt), step, M)
    off = np.abs(expected - exact).max() / abs(z).max()
    assert 1e-7 < off < 2.5e-4
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12


def flight(C, step, M):
    """Return positions of the free plate at 501 steps; C : [kg/s] by time [s] and length of update [s]."""
    x, v, positions = 0.0, 0.0, []
    for n in range(501):
        dt = step if n else 0.5 * step
        positions.append(x)
        v += dt / M * (500.0 - C(n * step, dt) * (v + 0.5 * dt / M * 500.0))
        x += step * v
    return np.array(positions)


def hanging_plate(extra):
    """Return a plate of 8 m2 and 1000 kg on a taut 10 m cable, released 1 mm below equilibrium."""
    L = 10.0 * (1 + 20e3 / (1.95e11 * 683.08e-6)) + 1e-3
    nodes = PLATE + f"2,0,0,{-L!r},0,1000,-20e3,8,0,0,1\n"
    text = (
        BARE + STEADY + f"pressure_coefficient = 0.0\n{extra}\n[dynamics]\nduration = 0.5\ntime_step = 2e-5\n"
    )
    text += "mass_damping = 0.0\n[output]\nhistory_interval = 2e-4\nprobes = [2]\n[modes]\ncount = 3\n"
    return text, nodes, "start,end,unstressed_length\n1,2,10.0\n"


def decrement(z, least=0.0):
    """Return the logarithmic decrement of an oscillation about 0 (n,), over its larger half periods."""
    z = np.abs(z)
    peaks = np.flatnonzero((z[1:-1] >= z[:-2]) & (z[1:-1] > z[2:]) & (z[1:-1] > least)) + 1
    # the vertex of a parabola through three rows
    top = [b + 0.125 * (a - c) ** 2 / (2 * b - a - c) for a, b, c in (z[k - 1 : k + 2] for k in peaks)]
    return 2.0 * np.log(top[0] / top[-1]) / (len(top) - 1)


def test_a_plate_on_a_spring_has_the_decrement_of_the_air(workshop):
    """2 pi xi / sqrt(1 - xi^2), xi = kappa rho U A / (2 M omega): to 1e-4, from interpolated peaks."""
    f = workshop.solve(*hanging_plate("aerodynamic_damping = 2.0"))
    M, k = 1000.0 + HALF_CABLE, 1.95e11 * 683.08e-6 / 10.0
    xi = 2.0 * RHO * 20.0 * 8.0 / (2 * M * np.sqrt(k / M))
    z = f["history/probe_displacement"][:, 0, 2] - 1e-3  # it rests 1 mm above where it begins
    assert decrement(z) == pytest.approx(2 * np.pi * xi / np.sqrt(1 - xi**2), rel=1e-4)
    assert (audits(f) < (1e-11, 1e-5)).all()


def test_added_mass_lengthens_the_period_of_a_known_mode(workshop):
    """30 kg/m2: the period times sqrt(1 + m_air / m) in /modes and in the motion, without weight."""
    text, nodes, elements = hanging_plate("[load]\nself_weight = false\nadded_mass = 30.0")
    f = workshop.solve(text, nodes, elements, output="with.vtkhdf")
    bare = workshop.solve(text.replace("added_mass = 30.0", ""), nodes, elements)
    own = 1000.0 + HALF_CABLE
    longer = np.sqrt(1.0 + 30.0 * 8.0 / own)
    assert f["modes/period"][2] == pytest.approx(longer * bare["modes/period"][2], rel=1e-12)
    z = f["history/probe_displacement"][:, 0, 2]
    t = f["history/time"][:]
    expected = 1e-3 * (1.0 - np.cos(2 * np.pi * t / f["modes/period"][2]))
    assert np.abs(z - expected).max() < 1e-4 * 1e-3  # its own change of stiffness, and the step


@pytest.mark.parametrize("load, area", [(0.0, 0.0), (500.0, 8.0)])
def test_a_removed_cable_leaves_half_of_its_air_damping_along_free_axes(workshop, load, area):
    """The node at its end is held in plan, and pulled along x. F / (kappa rho U A / 2) is its speed."""
    nodes = f"""id, x, y, z, fixed_x, fixed_y, fixed_z, load_z, mass, area, normal_x, normal_y, normal_z
0,  0, 0, 0, 1, 1, 1, 0,      0,   0,      0, 0, 1
1,  5, 0, 0, 0, 0, 0, 0,      1,   40,     1, 0, 1
2, 10, 0, 0, 1, 1, 0, {load}, 100, {area}, 1, 0, 1
3, 20, 0, 0, 1, 1, 1, 0,      0,   0,      0, 0, 1
"""
    elements = "start, end, cable, unstressed_length\n0,1,c,4.98\n1,2,c,4.98\n2,3,d,15\n"
    text = BARE + STEADY
    text += 'pressure_coefficient = 0.0\naerodynamic_damping = 1.0\nafter_fracture = "none"\n'
    text += '[load]\nself_weight = false\n[[remove]]\ncables = ["c"]\ntime = 0.1\n'
    text += "[dynamics]\nduration = 4.0\n[output]\nhistory_interval = 0.01\nprobes = [2]\n"
    f = workshop.solve(text, nodes, elements)
    assert f["removal/element"][:].tolist() == [0, 1]
    u = f["history/probe_displacement"][:, 0]
    assert np.abs(u[:, :2]).max() < 1e-12
    assert (u[-1] - u[-2])[2] / 0.01 == pytest.approx(load / (RHO * 20.0 * 28.0 / 2), rel=1e-3, abs=1e-10)


@pytest.mark.parametrize("zeta", [0.0, 0.8])
def test_air_damping_acts_across_the_held_axis_of_a_moving_support(workshop, zeta):
    """A plate at 45 degrees moves along x: z'' = -(b + zeta) z' - b x', b = kappa rho U A / 2M.

    The air pushes the support with M b (x' + z') against x, and takes energy from the motion along x and z.
    """
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass,area,normal_x,normal_y,normal_z\n1,0,0,0,1,1,1,0,0,0,0,1\n"
    nodes += "2,0,0,-9,1,1,0,100,8,1,0,1\n"
    text = BARE + STEADY + "pressure_coefficient = 0.0\naerodynamic_damping = 1.0\n"
    text += '[load]\nself_weight = false\n[[motion]]\ndisplacement = "move.csv"\n'
    text += f"[dynamics]\nduration = 1.0\nmass_damping = {zeta}\ntime_step = 1e-3\n[output]\nprobes = [2]\n"
    job = workshop.job(text, nodes, "start,end,unstressed_length\n1,2,10.0\n")
    (job.parent / "move.csv").write_text("time,x\n0,0\n2,4\n")
    f = workshop.run(job)
    t, b = f["history/time"][:], RHO * 20.0 * 8.0 / (2 * (100.0 + HALF_CABLE))
    decayed = (1.0 - np.exp(-(b + zeta) * t)) / (b + zeta)
    z = f["history/probe_displacement"][:, 0, 2]
    assert np.abs(z + 2.0 * b / (b + zeta) * (t - decayed)).max() < 1e-6 * 2.0
    assert audits(f)[0] < 1e-11
    h, mass, s = f["history"], 100.0 + HALF_CABLE, b + zeta
    A, B, decay = 2.0 * zeta / s, 2.0 * b / s, np.exp(-s * t)  # x' + z' = A + B decay
    dissipated = A**2 * t + (2.0 * A * B * (1.0 - decay) + 0.5 * B**2 * (1.0 - decay**2)) / s
    assert h["air_work"][:] == pytest.approx(mass * b * dissipated, rel=1e-3, abs=0.1)
    assert h["support_work"][:] - h["support_work"][0] == pytest.approx(
        2.0 * mass * b * (2.0 * t + z), rel=1e-3, abs=0.1
    )
    assert f["envelope/reaction_lowest"][1, 0] == pytest.approx(-2.0 * mass * b, rel=1e-3)
