"""Fracture compared with closed forms: time and place, the motion of fragments, and the wave."""

import numpy as np
import pytest
from conftest import BARE, STEEL
from nets import table
from scipy.optimize import brentq
from test_fracture import PULLED

THEME = "Fracture"
E, A, RHO, G = 1.95e11, 683.08e-6, 7850.0, 9.81
EA, C = E * A, float(np.sqrt(E / RHO))  # N; m/s, speed of a wave along a cable
WHOLE = 1.0 - 1e-12  # of the step L0 / c: below the limit in spite of rounding
EXACT = "central difference is exact for a constant force; rounding"
MAGIC = "with the step L0 / c central difference carries waves along a chain without error"


def states(f):
    """Return times (s,) [s] of the frames and positions [m] of the particles, split-off ones last."""
    steps = f["VTKHDF/Steps"]
    counts = f["VTKHDF/NumberOfPoints"][:][steps["PartOffsets"][:]]
    spans = zip(steps["PointOffsets"][:], counts)
    return steps["Values"][:], [f["VTKHDF/Points"][first : first + n] for first, n in spans]


def ends(f):
    """Return element, particle and new particle of each fracture; the latter is n + 2 element + end."""
    return list(zip(*(f[f"events/{name}"][:].tolist() for name in ("element", "particle", "new_particle"))))


def chain(n, length, fixed, load=0.0, weak=None):
    """Return tables of n elements in a row along z, `weak` in its own group, a load [N] at the last node."""
    nodes = [(k, 0, 0, k * length, int(k in fixed), load if k == n else 0) for k in range(n + 1)]
    elements = [(k, k + 1, "weak" if k == weak else "strong") for k in range(n)]
    return table("id,x,y,z,fixed,load_z", nodes), table("start,end,group", elements)


def modes(stiffness, mass):
    """Return frequencies (r,) [rad/s] and shapes (r, r) of free vibration, with unit modal mass."""
    root = 1.0 / np.sqrt(mass)
    values, vectors = np.linalg.eigh(root[:, None] * stiffness * root)
    return np.sqrt(values), root[:, None] * vectors


def test_weight_on_a_cable_that_breaks(both_ways, compare):
    """The cable breaks at a time in closed form. Then cable and weight fall, and the free end moves."""
    length, weight, limit, dt = 10.0, 98100.0, 1e-3, 2e-5
    nodes = f"id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,{-length},0,{weight / G},{-weight}\n"
    text = f"{BARE}fracture_strain = {limit}\n[dynamics]\nduration = 0.3\ntime_step = {dt}\n"
    f = both_ways.solve(text + "[output]\nframes = 30\n", nodes, "start,end\n1,2\n")
    assert ends(f) == [(0, 0, 2)]
    assert limit < f["events/strain"][0] < 1.01 * limit
    assert np.abs(f["history/work_identity_error"][:]).max() < 1e-12
    half, k = 0.5 * RHO * A * length, EA / length
    M = weight / G + half
    omega, step = np.sqrt(k / M), int(f["events/step"][0])
    broken_at = np.arccos(1 - limit * length * k / weight) / omega
    compare("weight put on a cable: time of the break", "acos(1 - eps_u EA / W) / omega").figures(
        f["events/time"][0], broken_at, dt, "first step past it", "s", scale=1.0
    )
    # the steps themselves in closed form: z(n) = (1 - cos n theta) W / k
    theta = np.arccos(1 - 0.5 * (omega * dt) ** 2)
    z = lambda n: -weight / k * (1 - np.cos(n * theta))
    first = next(n for n in range(10**6) if -z(n) > limit * length)
    case = compare("the same: number of the step", "central difference solved by hand")
    case.figures(step, first, 0, "both count steps")
    v = (z(step + 1) - z(step)) / dt  # half a step before it breaks, at x(step + 1)
    total = M + half
    a = -weight / total
    momentum = M * v + total * a * 0.5 * dt  # at step + 1
    tau = (f["history/time"][-1] / dt - step - 1) * dt
    x, moves = f["final/position"][:, 2], f["final/velocity"][:, 2]
    moves_on, momentum_then = M * moves[1] + half * moves[2], momentum + total * a * tau
    compare("weight and fragment together: momentum at the end", "M v + W t").figures(
        moves_on, momentum_then, 1e-11, "exact; rounding of 1e4 steps", "kg m/s"
    )
    fallen = (M * (x[1] + length - z(step + 1)) + half * x[2]) / total
    compare("their centre of mass: way since the break", "v t + W t^2 / 2 M").figures(
        fallen, momentum / total * tau + 0.5 * a * tau**2, 1e-10, EXACT, "m"
    )
    # The remainder keeps its strength. It yields until the end is at rest relative to the weight. Then it
    # springs towards the weight until it is slack, and keeps its speed.
    stretch, mu = limit * length, M * half / total
    omega = np.sqrt(k / mu)
    still = weight / M / omega**2  # elongation at which the two would fall side by side
    rate = -v + 0.5 * dt * (weight / M - k * -z(step + 1) / mu)  # of the stretch at step + 1
    away = omega * np.sqrt((stretch - still) ** 2 - still**2)
    slack = rate / (k * stretch / mu - weight / M) + np.arccos(-still / (stretch - still)) / omega
    times, points = states(f)
    late = [n for n, t in enumerate(times) if t > times[-1] - 0.1]
    early, last = points[late[0]][:, 2], points[late[-1]][:, 2]
    way = times[late[-1]] - times[late[0]]
    assert early[2] - early[1] < length and times[late[0]] > (step + 1) * dt + slack  # slack all the while
    compare("freed end while the cable is slack: speed", "ways of equal length in equal times").figures(
        (last[2] - early[2]) / way, moves[2], 1e-12, "no force; rounding", "m/s"
    )
    falls = moves[1] * way + 0.5 * weight / M * way**2
    compare("weight meanwhile: way", "v t + g t^2 / 2").figures(last[1] - early[1], falls, 1e-11, EXACT, "m")
    theirs, why = away - weight / M * (tau - slack), "what one step adds to the strength"
    compare("speed of the weight past the freed end", "energy at its strength, reduced mass").figures(
        moves[1] - moves[2], theirs, rate * dt / stretch, why, "m/s"
    )


@pytest.mark.parametrize("weak", [0, 5])
def test_step_load_breaks_the_weak_element_behind_the_reflection(both_ways, compare, weak):
    """A wave that doubles at the support breaks the weak element on its return."""
    n, length, load = 24, 0.5, 100e3
    strain = load / EA
    dt = length / C * WHOLE
    nodes, elements = chain(n, length, {0}, load, weak)
    text = BARE + f"[group.weak]\nfracture_strain = {1.5 * strain!r}\n"
    text += f"[dynamics]\nduration = {(n + weak + 4) * dt!r}\ntime_step = {dt!r}\n"
    f = both_ways.solve(text, nodes, elements)
    case = f"step load on a chain of {n}, weak element {weak}: "
    compare(case + "which breaks", "the one that is weak").figures(
        f["events/element"][0], weak, 0, "the wave comes back to no other first", scale=1.0
    )
    when, why = (n + weak + 0.5) * length / C, "the first step past it; half a step"
    compare(case + "when", "(n + weak + 1/2) L0 / c").figures(
        f["events/time"][0], when, 0.5001 * dt, why, "s", scale=1.0
    )
    compare(case + "strain there", "2 F / EA").figures(f["events/strain"][0], 2 * strain, 1e-9, MAGIC)


def test_whip_of_a_released_end(both_ways, compare):
    """The end link of a stretched cable breaks:
    behind the wave that runs from there the cable is slack and moves at c eps.

    It starts just whole; 1e-10 of the tension pulls it over its limit in the first step.
    """
    n, length, tension = 60, 0.5, 100e3
    strain = tension / EA
    L0 = length / (1 + strain)
    dt, m = L0 / C * WHOLE, RHO * A * L0
    nodes, elements = chain(n, length, {0, n}, weak=n - 1)
    nodes = nodes.replace(f"{(n - 1) * length!r},0,0\n", f"{(n - 1) * length!r},0,{-1e-10 * tension}\n")
    text = STEEL + f"[group.weak]\nfracture_strain = {strain * (1 + 1e-11)!r}\n"
    text += f"[dynamics]\nduration = {(n + 2) * dt!r}\ntime_step = {dt!r}\n"
    text += f"[output]\nhistory_interval = {dt!r}\nframes = 2\nprobes = [[0, 0]]\n"
    f = both_ways.solve(text, nodes, elements)
    v0, v = tension / (np.sqrt(E * RHO) * A), f["final/velocity"][:, 2]
    assert f["events/particle"][0] == n and f["events/step"][0] == 1 and len(v) == n + 2
    waves, behind = "linear wave theory: N / (sqrt(E rho) A)", np.abs(v[1:n])
    far = f["history/probe_tension"][:, 0]
    time = f["history/time"][:][far < 0.5 * tension][0]
    arrival = time - 2 * dt  # broken at the step after that of the event
    stored, whole = 0.5 * tension * strain * L0, "L0 / c of the whole cable"
    moving, energy = 0.5 * m * (behind**2).sum(), f["history/kinetic_energy"][-1]
    extra = "the free end is first kicked a whole step, not half of one: as much energy as one element has"
    as_many, all_elements = "strain energy of as many elements", "strain energy of all elements"
    for case, source, ours, theirs, within, why, unit in (
        ("end link of a cable breaks: speed behind, slowest", waves, behind.min(), v0, 1e-8, MAGIC, "m/s"),
        ("the same: fastest", waves, behind.max(), v0, 1e-8, MAGIC, "m/s"),
        ("the same: time until the far support is slack", whole, arrival, n * L0 / C, 1e-9, MAGIC, "s"),
        ("the same: kinetic energy behind the wave", as_many, moving, (n - 1) * stored, 1e-8, MAGIC, "J"),
        ("the same: with that of the free end", all_elements, energy, n * stored, 1.01 / n, extra, "J"),
    ):
        compare(case, source).figures(ours, theirs, within, why, unit)


def test_dead_load_falls_with_its_node(both_ways, compare):
    """A hanger breaks at the lower of two weights. The falling part has the acceleration g."""
    length, dead, area, limit, thread = 5.0, 4000.0, np.array([1.0, 5.0]), 2.1e-4, 100.0
    nodes = f"id,x,y,z,fixed,area\n1,0,0,0,1,1\n2,0,0,{-length},0,{area[0]}\n"
    nodes += f"3,0,0,{-2 * length},0,{area[1]}\n4,0,0,{-2 * length - 1},1,0\n"
    # a slack thread below the weight: an end with a single element would not break off from it
    elements = f"start,end,group,area,unstressed_length\n1,2,upper,{A},{length}\n2,3,lower,{A},{length}\n"
    elements += f"3,4,thread,1e-12,{thread}\n"
    text = BARE + f"[group.lower]\nfracture_strain = {limit}\n"
    text += f"[load]\nself_weight = true\ndead = {dead}\n[dynamics]\nduration = 0.25\ntime_step = 1e-3\n"
    text += "[output]\nframes = 250\nhistory_interval = 0.001\n"
    f = both_ways.solve(text, nodes, elements)
    dt = f["history/time_step"][0]
    step = int(f["events/step"][0])
    k = EA / length
    half = 0.5 * RHO * A * length
    mass = dead * area / G + half * np.array([2, 1]) + [0, 0.5 * RHO * 1e-12 * thread]
    omega, shape = modes(k * np.array([[2, -1], [-1, 1]]), mass)
    theta = np.arccos(1 - 0.5 * (omega * dt) ** 2)
    # the steps in closed form, by modes
    place = lambda n: shape @ (shape.T @ (-G * mass) / omega**2 * (1 - np.cos(n * theta)))
    first = next(n for n in range(10**4) if place(n)[0] - place(n)[1] > limit * length)
    force = np.abs(mass * (place(step + 1) - 2 * place(step) + place(step - 1)))
    removed = f["events/mass"][0]
    assert removed > 1.2 * half  # some of the dead load went along
    v = (place(step + 1) - place(step))[1] / dt - 0.5 * G * dt
    tau = f["history/time"][-1] - (step + 1) * dt
    falls, way = place(step + 1)[1] + v * tau - 0.5 * G * tau**2, f["final/position"][2, 2] + 2 * length
    by_hand, larger = "central difference solved by hand", "that with the larger resultant force"
    end, share, then = f["events/particle"][0], 0.5 * k * (dt / 0.8) ** 2, "modes, then v t + g t^2 / 2"
    for case, source, ours, theirs, within, why, unit in (
        ("two weights on a hanger: step of the break", by_hand, step, first, 0, "both count steps", ""),
        ("the same: end that breaks (1 upper, 2 lower)", larger, end, 1 + force.argmax(), 0, "paper 2.4", ""),
        ("the same: mass of the fragment", "k (dt / safety)^2 / 2", removed, share, 1e-12, "a formula", "kg"),
        ("the same: way of the weight", then, way, falls, 1e-11, EXACT, "m"),
    ):
        compare(case, source).figures(ours, theirs, within, why, unit)
    times, points = states(f)
    z = np.array([p[[1, -1], 2] for p in points if len(p) > 4])
    slack = z[:, 0] - z[:, 1] < length
    free = z[slack.argmax() :, 1]
    assert slack[slack.argmax() :].all() and len(free) > 100
    apart = len(free) // 4
    falls = np.diff(free[: 2 * apart + 1 : apart], 2)[0] / (apart * (times[1] - times[0])) ** 2
    compare("the same: fall of the fragment on a slack cable", "g").figures(falls, -G, 1e-10, EXACT, "m/s2")


def test_equal_forces_break_both_ends(both_ways, compare):
    """A symmetric chain pulled at both ends: its weak middle breaks at both and moves at c eps."""
    limit, load, dt = 1e-3, 1e5, 1e-6
    nodes = f"id,x,y,z,mass,load_z\n1,0,0,0,500,{-load}\n2,0,0,1,100,0\n3,0,0,2,100,0\n4,0,0,3,500,{load}\n"
    text = BARE + f"fracture_strain = {limit}\n[dynamics]\nduration = 0.012\ntime_step = {dt}\n"
    f = both_ways.solve(text, nodes, "start,end,area\n1,2,1e-3\n2,3,4e-4\n3,4,1e-3\n")
    # the half from the middle outwards; half of an element is twice as stiff
    k = E * np.array([1e-3, 2 * 4e-4])
    mass = np.array([500 + 0.5e-3 * RHO, 100 + 0.5 * 1.4e-3 * RHO])
    omega, shape = modes(np.array([[k[0], -k[0]], [-k[0], k.sum()]]), mass)
    pull = shape[0] * load / omega**2
    way = lambda t: float(shape[1] @ (pull * (1 - np.cos(omega * t))))  # of the middle's end
    first = next(t for t in np.arange(0, 0.012, 1e-5) if way(t) > 0.5 * limit)
    broken_at = brentq(lambda t: way(t) - 0.5 * limit, first - 1e-5, first)
    compare("symmetric chain pulled at both ends: time of the break", "its modes").figures(
        f["events/time"][0], broken_at, 2 * dt, "first step past it; second order in the step", "s", scale=1.0
    )
    case = compare("the same: ends that break", "both, as the forces are equal")
    case.figures(len(f["events/step"]), 2, 0, "rule of equal forces")
    assert ends(f) == [(1, 1, 4 + 2), (1, 2, 4 + 3)]
    assert len(set(f["events/step"][:])) == 1
    assert f["history/broken"][-1] == 1
    x, v = f["final/position"][:, 2], f["final/velocity"][:, 2]
    sums, ulp = np.abs(v + v[[3, 2, 1, 0, 5, 4]]), E * 1e-3 * np.spacing(3.0) * 0.012 / (0.5 * 4e-4 * RHO)
    case = compare("the same: sum of the velocities of mirror images", "zero")
    case.error(sums.max(), ulp, "rounding of the positions: k ulp t / M", "m/s")
    assert x[5] - x[4] < 1  # slack
    ringing = 2 * C  # of the loose element of 1 m: two halves of its mass on its stiffness
    case = compare("the same: speed of the ends that flew off", "c eps_u: it yields until they part no more")
    within, why = 3 * (ringing * dt) ** 2 / 8, "second order in the step: (omega dt)^2 / 8"
    case.figures(v[4], C * limit, within, why, "m/s")


def test_symmetric_net_breaks_symmetrically(both_ways, compare):
    f = both_ways.solve(PULLED.format(0.3))
    x = f["net/particles"][:, :2]
    elements = f["net/elements"][:]
    element = f["events/element"][:]
    step = f["events/step"][:]
    middle = 0.5 * (x[elements[:, 0]] + x[elements[:, 1]])
    alone = 0
    for mirror in (-1, 1), (1, -1):
        image = np.array([np.linalg.norm(middle - place * mirror, axis=1).argmin() for place in middle])
        alone += sum(image[e] not in element[step == s] for s, e in zip(step, element))
    assert len(np.unique(element)) >= 4
    case = compare("saddle under uniform load: fractures without mirror image in the same step", "symmetry")
    case.error(alone, 0, "rule of equal forces")
