"""Dynamics against closed forms of the differential equation and of central difference in its place.

Central difference turns an oscillation of omega into one of theta / dt with sin(theta / 2) = omega dt / 2:
too fast by (omega dt)^2 / 24, amplitude and start from rest kept. So where the difference equation has a
closed form the tolerance is rounding; elsewhere it is that term.
"""

import itertools

import numpy as np
from conftest import BARE, STEEL
from nets import table
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import curve_fit
from scipy.special import ellipe, ellipk, jn_zeros, jv, jvp

THEME = "Dynamics"
EXACT = "central difference is exact for a constant force; rounding of some hundred steps"
E, A, RHO, G = 1.95e11, 683.08e-6, 7850.0, 9.81
EA, HALF = E * A, 0.5 * RHO * A  # N; kg for each metre


def soft(modulus: float) -> str:
    """Return the cable section with another modulus [Pa]."""
    return BARE.replace("1.95e11", repr(modulus))


def timing(duration: float, dt: float, every: int, probes=(), frames=1, damping=0.0) -> str:
    """Return sections of a run with steps dt [s] and a history row every few steps."""
    return (
        f"[dynamics]\nduration = {float(duration)!r}\ntime_step = {float(dt)!r}\nmass_damping = {damping!r}\n"
        f"[output]\nhistory_interval = {float(every * dt)!r}\nframes = {frames}\n"
        f"probes = {[list(map(float, p)) for p in probes]}\n"
    )


def tracks(f) -> np.ndarray:
    """Return positions (frames, n, 3) [m] of a run without fractures."""
    return f["VTKHDF/Points"][:].reshape(len(f["VTKHDF/Steps/Values"]), -1, 3)


def crossings(t, q) -> np.ndarray:
    """Return times [s] at which q is zero, between rows by a cubic spline."""
    return CubicSpline(t, q).roots(extrapolate=False)


def crest(t, q) -> float:
    """Return the largest value of q, between rows by a cubic spline."""
    path = CubicSpline(t, q)
    return max(q.max(), path(path.derivative().roots(extrapolate=False)).max())


def test_free_fall(both_ways, compare):
    """Both particles of a slack cable fall by g t^2 / 2."""
    text = BARE + "[load]\nself_weight = true\n[dynamics]\nduration = 1.0\n"
    tables = "id,x,y,z\n1,0,0,0\n2,3,0,1\n", "start,end\n1,2\n"
    f = both_ways.solve(text, *tables)
    (one, other), speed = f["final/position"][:, 2], f["final/velocity"][0, 2]
    work, by_hand = f["history/external_work"][-1], HALF * np.sqrt(10) * G**2
    for what, source, ours, theirs, unit in (
        ("way", "g t^2 / 2", -one, 0.5 * G, "m"),
        ("way of the other end", "g t^2 / 2", 1.0 - other, 0.5 * G, "m"),
        ("speed", "g t", -speed, G, "m/s"),
        ("work of the weight", "m g^2 t^2 / 2", work, by_hand, "J"),
    ):
        compare(f"free fall for 1 s: {what}", source).figures(ours, theirs, 1e-12, EXACT, unit)


def test_taut_string(both_ways, compare):
    """Three modes: those of n masses to rounding, those of the continuous string to second order."""
    n, L, T, a, dt = 32, 20.0, 100e3, 1e-6, 1e-4
    x = np.linspace(0.0, L, n + 1)
    shapes = np.sin(np.pi * np.outer([1, 2, 3], x) / L)
    shapes[:, -1] = 0.0
    L0 = L / n / (1 + T / EA)
    rows = ((k, x[k], 0.0, a * shapes[:, k].sum(), int(k in (0, n))) for k in range(n + 1))
    tables = (
        table("id,x,y,z,fixed", rows),
        table("start,end,unstressed_length", ((k, k + 1, L0) for k in range(n))),
    )
    f = both_ways.solve(BARE + timing(0.3, dt, 100, frames=300), *tables)
    t, z = f["VTKHDF/Steps/Values"][:], tracks(f)[:, :, 2]
    mu = 2 * HALF * L0 * n / L  # mass of a metre of taut string
    own = EA / T * (1 + 4 + 9) / 8 * (np.pi * a / L) ** 2  # half the mean rise of the tension
    for k, shape in zip((1, 2, 3), shapes):
        q = z @ shape * 2 / n
        guess = np.pi / np.diff(crossings(t, q)).mean()
        frequency = curve_fit(lambda t, b, w: b * np.cos(w * t), t, q, p0=(a, guess))[0][1] / (2 * np.pi)
        omega = 2 * np.sqrt(T / (2 * HALF * L0 * L / n)) * np.sin(k * np.pi / (2 * n))
        lumped = 2 * np.arcsin(omega * dt / 2) / dt / (2 * np.pi)
        compare(f"taut string of {n} links: frequency of mode {k}", "lumped string, steps as taken").figures(
            frequency, lumped, 1.5 * own, "the swing's own tension", "Hz"
        )
        theirs, why = k / (2 * L) * np.sqrt(T / mu), "links: (k pi / n)^2 / 24; steps much less"
        compare("the same, against the continuous string", f"{k} / (2 L) sqrt(T / mu)").figures(
            frequency, theirs, (k * np.pi / n) ** 2 / 24, why, "Hz"
        )


N_WAVE, L_LINK = 60, 0.5  # elements, m unstressed
T_WAVE, P_WAVE = 100e3, 10e3  # N prestress, N more from t = 0 on
C_WAVE = float(np.sqrt(E / RHO))  # m/s, of unstressed length


def pulled_cables(steps: int, courant: float, every: int, frames: int):
    """Return two taut cables with P added at x = 0: fixed far end at y = 0, free one at y = 5."""
    n, length = N_WAVE, L_LINK * (1 + T_WAVE / EA)
    pull = lambda s, k: -(T_WAVE + P_WAVE) if k == 0 else T_WAVE if s and k == n else 0.0
    held = lambda s, k: int(s == 0 and k == n)
    both = [(s, k) for s in (0, 1) for k in range(n + 1)]
    nodes = [(100 * s + k, k * length, 5.0 * s, 0.0, held(s, k), pull(s, k)) for s, k in both]
    elements = [(100 * s + k, 100 * s + k + 1, L_LINK) for s in (0, 1) for k in range(n)]
    dt = courant * L_LINK / C_WAVE
    probes = [(5.4 * length, 0.0), (55.4 * length, 0.0), (20.4 * length, 0.0), (n * length, 0.0)]
    return (
        BARE + timing(steps * dt, dt, every, probes, frames),
        table("id,x,y,z,fixed,load_x", nodes),
        table("start,end,unstressed_length", elements),
        dt,
    )


def test_elastic_wave(both_ways, compare):
    """D'Alembert's wave, four lengths: twice the tension at a fixed end, twice the speed at a free end."""
    n, short = N_WAVE, 1e-9
    steps = 4 * n
    *tables, dt = pulled_cables(steps, 1.0 - short, 1, steps)
    f = both_ways.solve(*tables)
    why = f"Courant number 1e-9 short of 1, where the difference equation is d'Alembert's; {steps} steps"
    within = steps * short
    s, j = np.arange(steps + 1)[:, None], np.arange(n + 1)[None]
    unit = P_WAVE * L_LINK / EA  # m, of a step
    reach = lambda way: np.maximum(way, 0)
    there, back = lambda m: reach(s - j - 2 * m * n), lambda m: reach(s + j - 2 * (m + 1) * n)
    echo = lambda sign: sum(sign**m * (there(m) + sign * back(m)) for m in (0, 1, 2))
    u = tracks(f)[:, :, 0]
    u = u - u[0]
    fixed, free = -u[:, : n + 1] / unit, -u[:, n + 1 :] / unit
    N = {e: f["history/probe_tension"][:, k] - T_WAVE for k, e in enumerate(f["history/probe_element"][:])}
    passes = {e: np.interp(0.5, N[e][: n + 5] / P_WAVE, np.arange(n + 5)) * dt for e in (5, 54)}
    way = 49 * L_LINK * (1 + T_WAVE / EA)
    speed, moves, fast = way / (passes[54] - passes[5]), P_WAVE * C_WAVE / EA, C_WAVE * (1 + T_WAVE / EA)
    of_front, of_end = ((free[k] - free[k - 1]) * unit / dt for k in (40, n + 20))
    for case, source, ours, theirs, units in (
        ("wave along a taut cable: speed", "sqrt(EA / mu), stretched", speed, fast, "m/s"),
        ("the same: tension behind the front", "P", N[20][n - 10], P_WAVE, "N"),
        ("the same: tension at the fixed end", "2 P", N[n - 1][n + 10], 2 * P_WAVE, "N"),
        ("the same: speed behind the front", "P c / EA", of_front[20], moves, "m/s"),
        ("the same: speed of the free end", "2 P c / EA", of_end[n], 2 * moves, "m/s"),
    ):
        compare(case, source).figures(ours, theirs, within, why, units)
    echoes, reversal, mirrored = "d'Alembert, with echoes", "reversal of time", fixed[: 2 * n : -1]
    why, everywhere = "square of the Courant number, 2e-9 short of 1", "all places and times: difference"
    for case, source, off, size in (
        (f"the same, far end fixed, {everywhere}", echoes, fixed - echo(-1), echo(-1).max()),
        (f"the same, far end free, {everywhere}", echoes, free - echo(1), echo(1).max()),
        ("cable at rest after 2 L / c: x(T/2 + s) - x(T/2 - s)", reversal, fixed[: 2 * n] - mirrored, 2 * n),
        ("the same, after 4 L / c: distance from the start", reversal, fixed[-1], 2 * n),
    ):
        compare(case, source).error(unit * np.abs(off).max(), 1e-8, why, "m", scale=unit * size)


def test_wave_of_a_lumped_cable(both_ways, compare):
    """Ripples behind the front are those of Schroedinger's chain: P times the integral of J(2 j + 1)."""
    courant, j = 0.04, 20
    *tables, _ = pulled_cables(int(50 / courant), courant, 5, 1)
    f = both_ways.solve(*tables)
    z = 2 * C_WAVE * f["history/time"][:] / L_LINK
    N = f["history/probe_tension"][:, list(f["history/probe_element"][:]).index(j)] - T_WAVE
    ripple = lambda z: 2 * P_WAVE * sum(jv(2 * j + 2 + 2 * k, z) for k in range(60))
    # the steps bring each wave forward by its (omega dt)^2 / 24
    late = (2 * courant) ** 2 / 24 * (z * np.abs(jvp(2 * j + 1, z, 2))).max()
    why = "steps: (omega dt)^2 / 24 of every wave's phase"
    case = compare("wave of a cable of masses: largest difference of a tension", "series of Bessel functions")
    case.error(np.abs(N - ripple(z)).max(), 1.2 * late, why, "N", scale=P_WAVE)
    case = compare("the same: tension in the first crest", "integral of J(41) to its first zero")
    case.figures(crest(z, N), ripple(jn_zeros(2 * j + 1, 1)[0]), 1.2 * late, why, "N")


def test_pendulums(both_ways, compare):
    """From 30, 90, 150 degrees: the period by the elliptic integral, the tension by energy."""
    L, dt, angles = 2.0, 4e-4, (30, 90, 150)
    mass = 10.0 + L * HALF  # to 1e-6; the load makes up for the rest
    nodes, elements = [], []
    for k, angle in enumerate(angles):
        y, phi = 10.0 * k, np.deg2rad(angle)
        L0 = L / (1 + mass * G * np.cos(phi) / EA)  # starts without a jerk along the bar
        weight = -(10.0 + L0 * HALF) * G
        nodes.append((2 * k, 0.0, y, 0.0, 1, 0.0, 0.0))
        nodes.append((2 * k + 1, L * np.sin(phi), y, -L * np.cos(phi), 0, 10.0, weight))
        elements.append((2 * k, 2 * k + 1, L0))
    text = BARE.replace("modulus", 'kind = "bar"\nmodulus')
    text += timing(1.3, dt, 10, [row[1:3] for row in nodes[1::2]])
    tables = table("id,x,y,z,fixed,mass,load_z", nodes), table("start,end,unstressed_length", elements)
    f = both_ways.solve(text, *tables)
    t = f["history/time"][:]
    assert np.abs(f["history/energy_balance_error"][:]).max() < 1e-5
    for k, angle in enumerate(angles):
        phi = np.deg2rad(angle)
        x = nodes[2 * k + 1][1] + f["history/probe_displacement"][:, k, 0]
        m = np.sin(phi / 2) ** 2
        # mean of the elongation's effect on inertia and energy
        late = 3.75 * mass * G / EA * (2 * ellipe(m) / ellipk(m) - 1 - np.cos(phi)) + G / L * dt**2 / 24
        theirs, why = 4 * np.sqrt(L / G) * ellipk(m), "elongation of the bar under the swing"
        case = compare(f"pendulum let go at {angle} degrees: period", "elliptic integral")
        case.figures(4 * crossings(t, x)[0], theirs, 1.5 * late, why, "s")
        way = 1 - np.cos(phi)
        # by the elongation's own swing, and by energy and inertia
        change = mass * G / EA * abs(6 * way - 9 * way**2) / (1 + 2 * way)
        pull, theirs = crest(t, f["history/probe_tension"][:, k]), mass * G * (3 - 2 * np.cos(phi))
        compare("the same: largest tension", "m g (3 - 2 cos a)").figures(pull, theirs, 2 * change, why, "N")


def test_swing_across_two_cables(both_ways, compare):
    """A mass released far off the line of two taut cables: its hardening vibration by quadrature."""
    modulus, L0, T, carried, a, dt = 1.95e9, 5.0, 10e3, 500.0, 1.0, 2e-3
    k, b, mass = modulus * A / L0, L0 * (1 + T / (modulus * A)), carried + 2 * L0 * HALF
    rows = (0, -b, 0.0, 0.0, 1, 0.0), (1, 0.0, 0.0, a, 0, carried), (2, b, 0.0, 0.0, 1, 0.0)
    elements = table("start,end,unstressed_length", [(0, 1, L0), (1, 2, L0)])
    text = soft(modulus) + timing(1.36, dt, 1, [(0, 0)])
    f = both_ways.solve(text, table("id,x,y,z,fixed,mass", rows), elements)
    V = lambda q: k * (np.hypot(b, q) - L0) ** 2
    # over q = a sin s; even about its end, where it is 0 / 0
    slowness = lambda s: a * np.cos(s) / np.sqrt(2 / mass * (V(a) - V(a * np.sin(s))))
    period = 4 * (quad(slowness, 0, np.pi / 2 - 1e-4)[0] + 1e-4 * slowness(np.pi / 2 - 1e-4))
    t, z = f["history/time"][:], a + f["history/probe_displacement"][:, 0, 2]
    path, zero = CubicSpline(t, z), crossings(t, z)
    omega2 = 2 * k * (1 - L0 * b**2 / np.hypot(b, a) ** 3) / mass  # the stiffest, at the turning point
    case, why = "mass swinging across two cables: period", "steps: (omega dt)^2 / 24 where it is stiffest"
    ours, within = 2 * np.diff(zero).mean(), omega2 * dt**2 / 24
    compare(case, "quadrature of the energy").figures(ours, period, within, why, "s")
    splines, why = 2 * (omega2 * dt**2) ** 2 / 384, "the scheme mirrors too; splines between the steps"
    turn, case = zero[:-1] + np.diff(zero) / 2, "the same: turning point on the other side"
    compare(case, "mirror image").figures(path(turn[0]), -a, splines, why, "m")
    s = np.linspace(0, turn[0] - dt, 200)
    back, case = np.abs(path(turn[0] + s) - path(turn[0] - s)), "the same: x(T/2 + s) - x(T/2 - s), largest"
    compare(case, "reversal of time").error(back.max(), splines, why, "m", scale=a)


def test_snap_from_slack(both_ways, compare):
    """A falling mass is caught and thrown back: times, tension and height by parabola and sinusoid."""
    modulus, L0, h, dt = 1.95e8, 10.0, 1.0, 1e-3
    k, mass = modulus * A / L0, 100.0 + L0 * HALF
    rows = (0, 0.0, 0.0, 0.0, 1, 0.0, 0.0), (1, L0 - h, 0.0, 0.0, 0, 100.0, mass * G)
    tables = table("id,x,y,z,fixed,mass,load_x", rows), table("start,end,unstressed_length", [(0, 1, L0)])
    f = both_ways.solve(soft(modulus) + timing(1.35, dt, 1, [(L0 - h, 0)]), *tables)
    t = f["history/time"][:]
    way = f["history/probe_displacement"][:, 0, 0]
    N = f["history/probe_tension"][:, 0]
    caught, speed, omega, sag = np.sqrt(2 * h / G), np.sqrt(2 * G * h), np.sqrt(k / mass), mass * G / k
    held = (2 * np.pi - 2 * np.arctan2(speed / omega, sag)) / omega
    taut = np.flatnonzero(N)
    falling = slice(0, taut[0])
    assert (np.diff(taut) == 1).all() and np.abs(f["history/energy_balance_error"][:]).max() < 1e-3
    # where the straight line through two rows is zero
    line = lambda m, n: t[m] - N[m] * (t[n] - t[m]) / (N[n] - N[m])
    begin, end = line(taut[0], taut[1]), line(taut[-1], taut[-2])
    off = np.abs(way - G * t**2 / 2)[falling].max()
    case = compare("mass on a slack cable: way until it is taut, largest difference", "g t^2 / 2")
    case.error(off, 1e-12, EXACT, "m", scale=h)
    last = taut[-1] + 1 + np.argmin(way[taut[-1] + 1 :])
    # free again: a parabola
    a, b, c = np.polyfit(t[last - 1 : last + 2] - t[last], way[last - 1 : last + 2], 2)
    peak, kinks = k * (sag + np.hypot(sag, speed / omega)), (omega * dt) ** 2 / 8
    high, back, late = h - (c - b * b / (4 * a)), t[last] - b / (2 * a), (dt / caught) ** 2
    why, straight = "kinks and crest: (omega dt)^2 / 8", "line through two rows: g dt^2 over the speed"
    for case, source, ours, theirs, within, because, unit in (
        ("time at which it is caught", "sqrt(2 h / g)", begin, caught, late, straight, "s"),
        ("largest tension", "F + sqrt(F^2 + 2 k F h)", N.max(), peak, kinks, why, "N"),
        ("time for which it is taut", "half a swing and more", end - begin, held, kinks, why, "s"),
        ("height to which it is thrown back", "height of the start", high, h, 2 * kinks, why, "m"),
        ("time of the return", "parabola, sinusoid, parabola", back, 2 * caught + held, kinks, why, "s"),
    ):
        compare(f"the same: {case}", source).figures(ours, theirs, within, because, unit)


def test_two_masses_on_a_chain(both_ways, compare):
    """Released on a taut chain: each row is the sum of two modes of the difference equation."""
    lengths, carried, moved = np.array([[6.0, 4.0], [800.0, 300.0], [1e-3, -3e-4]])  # m, kg, m
    T, dt = 150e3, 1e-4
    k, mass = EA / lengths, carried + HALF * np.array([10.0, 4.0])
    rest = np.cumsum(lengths * (1 + T / EA))
    x = rest + moved
    rows = [(0, 0.0, 0.0, 0.0, 1, 0.0, 0.0), (1, x[0], 0.0, 0.0, 0, carried[0], 0.0)]
    nodes = table("id,x,y,z,fixed,mass,load_x", [*rows, (2, x[1], 0.0, 0.0, 0, carried[1], T)])
    tables = nodes, table("start,end,unstressed_length", [(0, 1, lengths[0]), (1, 2, lengths[1])])
    f = both_ways.solve(BARE + timing(0.2, dt, 4, [(v, 0.0) for v in x]), *tables)
    stiffness = np.array([[k[0] + k[1], -k[1]], [-k[1], k[1]]]) / np.sqrt(np.outer(mass, mass))
    squares, modes = np.linalg.eigh(stiffness)
    share = modes.T @ (np.sqrt(mass) * moved)
    motion = lambda omega, t: (np.cos(np.outer(t, omega)) * share) @ modes.T / np.sqrt(mass)
    t, u = f["history/time"][:], moved + f["history/probe_displacement"][:, :, 0]
    assert (f["history/slack"][:] == 0).all()
    omega = np.sqrt(squares)
    off, size = np.abs(u - motion(2 * np.arcsin(omega * dt / 2) / dt, t)).max(), np.abs(moved).max()
    compare("two masses on a chain for 0.2 s: largest difference", "modes, steps as taken").error(
        off, 1e-9, "rounding of 2000 steps: of a length, 1e-15", "m", scale=size
    )
    late = t[-1] * (omega**3 * dt**2 / 24 * np.abs(share) @ np.abs(modes / np.sqrt(mass)[:, None]).T).max()
    off, why = np.abs(u - motion(omega, t)).max(), "phase (omega dt)^2 / 24, of both modes"
    compare("the same, as time goes on", "modes").error(off, late / size, why, "m", scale=size)


def test_order_of_accuracy(both_ways, compare):
    """Half the step, a quarter of the error:
    a damped oscillator against its closed form, a damped mass on a soft cable that swings and stretches
    against an integration to 1e-12.
    """
    zeta, hold, L0, soft_k, carried = 2.0, 20e3, 10.0, 9e4, 100.0
    stretched = L0 * (1 + hold / EA) + 1e-3
    start = np.array([3.0 + 2.0 * np.sin(1.0), -2.0 * np.cos(1.0)])
    positions = {}  # each moves by itself: with one stiffness, loads along z
    for k, at, end, mass, load, length, modulus in (
        (0, [0.0, 0.0, 0.0], [0.0, 0.0, -stretched], 1000.0, -hold, L0, E),
        (1, [3.0, 0.0, 0.0], [start[0], 0.0, start[1]], carried, -carried * G, 1.99, soft_k * 1.99 / A),
    ):
        nodes = table("id,x,y,z,fixed,mass,load_z", [(1, *end, 0, mass, load), (0, *at, 1, 0.0, 0.0)])
        text = soft(modulus) + timing(0.5, 2e-3, 5, [(end[0], 0.0)], damping=zeta)
        job = both_ways.job(text, nodes, table("start,end,unstressed_length", [(0, 1, length)]))
        positions[k] = []
        for h, ranks in (2e-3, 2), (1e-3, 1), (5e-4, 1):
            step = "--set", f"dynamics.time_step={h}"
            positions[k].append(both_ways.run(job, *step, ranks=ranks, output=f"{k}-{h}.vtkhdf"))
    t = positions[0][0]["history/time"][:]
    mass, omega2 = carried + 1.99 * HALF, EA / L0 / (1000.0 + L0 * HALF)
    omega = np.sqrt(omega2 - zeta**2 / 4)
    decay = 1e-3 * np.exp(-zeta * t / 2) * (np.cos(omega * t) + zeta / 2 / omega * np.sin(omega * t)) - 1e-3
    down = -decay[:, None]

    def rate(_, s):
        arm = s[:2] - [3.0, 0.0]
        pull = -soft_k * (1 - 1.99 / np.hypot(*arm)) * arm / mass
        return [*s[2:], *(pull - zeta * s[2:] - [0.0, carried * G / mass])]

    path = solve_ivp(rate, (0, t[-1]), [*start, 0.0, 0.0], "DOP853", t, rtol=1e-12, atol=1e-13)
    swing = path.y[:2].T - start
    for name, source, k, axes, theirs, fast in (
        ("damped oscillator", "closed form", 0, [2], down, omega2),
        ("mass that swings on a soft cable", "integration to 1e-12", 1, [0, 2], swing, soft_k / mass),
    ):
        errors = [np.linalg.norm(f["history/probe_displacement"][:, 0, axes] - theirs) for f in positions[k]]
        for h, pair in zip((2e-3, 1e-3), itertools.pairwise(errors)):
            order, why = np.log2(pair[0] / pair[1]), "next term of the phase: 9/80 (omega h)^2 of the first"
            case = compare(f"{name}, step of {h * 1e3:g} ms and half of it: order of the error", source)
            case.figures(order, 2.0, 0.075 * fast * h * h, why)


def test_order_of_accuracy_of_a_net(both_ways, compare):
    """A saddle in a steady wind against a sixteenth of the step: half the step, a quarter of the error."""
    text = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 40.0\ncells = 6\n' + STEEL
    text += '[form_finding]\nmethod = "force_density"\n'
    text += "[wind]\nonset = 'sudden'\nspeed = 10.0\nsurface_drag = 0.0\npressure_coefficient = -1.3\n"
    text += "base_height = 10.0\n" + timing(0.2, 2e-4, 25, frames=100)
    job, steps = both_ways.job(text), (2e-4, 1e-4, 5e-5, 1.25e-5)
    step = lambda h: ("--set", f"dynamics.time_step={h}", "--set", "output.history_interval=0.1")
    results = [both_ways.run(job, *step(h), ranks=2 if h == 2e-4 else 1, output=f"{h}.vtkhdf") for h in steps]
    assert not any(f["history/slack"][:].any() for f in results)
    x = [tracks(f) for f in results]
    errors = [np.linalg.norm(v - x[-1]) for v in x[:-1]]
    # 1/s, neighbours in opposition: 4 EA / L over the mass of two elements
    fastest = np.sqrt(2) * C_WAVE / (40.0 / 6)
    for k, h in enumerate(steps[:2]):
        expected = np.log2((h**2 - steps[-1] ** 2) / (h**2 / 4 - steps[-1] ** 2))
        what = f"saddle roof in a steady wind, step of {h * 1e3:g} ms and half of it: order of the error"
        order, bound = np.log2(errors[k] / errors[k + 1]), 0.075 * (fastest * h) ** 2
        why = "next term of the phase: 9/80 (omega h)^2 of the first, for the fastest mode"
        compare(what, "a sixteenth of the first step").figures(order, expected, bound, why)
