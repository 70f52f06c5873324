"""The falling folded chain: both ends at one height, one let go; by energy in closed form.

    v^2 = g x (2 L - x) / (L - x),    it has fallen the length L after 1.198140 sqrt(L / g)

(Calkin and March 1989; Tomaszewski, Pieranski and Geminard 2006.) Links in place of a smooth chain, in a fold
as wide as two of them: the error is of the first order of their length.
"""

import numpy as np
import pytest
from conftest import audits

L, G, LINE_MASS, EA = 10.0, 9.81, 10.0, 1e7  # m, m/s2, kg/m, N: stretched by 5e-5 of its length
WHOLE = 1.198140  # of sqrt(L / g)

JOB = """
[cable]
modulus = 1e9
area = 1e-2
density = 1000.0
[group.hanger]
density = 1e-3
[load]
self_weight = true
max_iterations = 1000
[dynamics]
duration = 1.3
[[remove]]
elements = [0]
time = 0.0
[output]
frames = 1
history_interval = 5e-4
"""


def folded(links):
    """Positions x, z (links + 1,) [m] of an odd number of links at rest between ends as far apart as two, and
    the forces along and down [N] of the half above the lowest link.
    """
    h = L / links
    down = LINE_MASS * h * G * np.arange((links - 1) // 2 + 1)
    low, high = 0.0, down[-1]  # of the horizontal force
    for _ in range(200):
        along = 0.5 * (low + high)
        N = np.hypot(along, down)
        length = h * (1 + N / EA)
        dx, dz = length * along / N, length * down / N
        low, high = (along, high) if dx[0] + 2 * dx[1:].sum() < 2 * h else (low, along)
    x = np.concatenate([[0.0], np.cumsum(np.concatenate([dx[:0:-1], dx]))])
    z = np.concatenate([[0.0], np.cumsum(np.concatenate([-dz[:0:-1], dz]))])
    return x, z, along, down[-1]


def tables(links):
    """Return tables of the chain, whose last node hangs on element 0, in line with the pull."""
    x, z, along, down = folded(links)
    h = L / links
    down += 0.5 * LINE_MASS * h * G
    force = np.hypot(along, down)
    length = h * (1 + force / EA)
    x, z = np.append(x, x[-1] + length * along / force), np.append(z, z[-1] + length * down / force)
    held = [1] + [0] * links + [1]
    nodes = [f"{i}, {a!r}, 0, {b!r}, {f}" for i, (a, b, f) in enumerate(zip(x.tolist(), z.tolist(), held))]
    elements = [f"{i + 1}, {i}, {i + 1}, chain, {h!r}" for i in range(links)]
    elements.append(f"0, {links}, {links + 1}, hanger, {h!r}")
    head = "id, start, end, group, unstressed_length"
    return "\n".join(["id, x, y, z, fixed", *nodes]), "\n".join([head, *elements]), float(x[links])


def fallen(workshop, links):
    """Times [s] and depths [m] of the end that is let go, down to its lowest place."""
    nodes, elements, end = tables(links)
    with workshop.solve(JOB + f"probes = [[{end!r}, 0.0]]\n", nodes, elements) as result:
        assert result["history/probe_particle"][0] == links
        time, depth = result["history/time"][:], -result["history/probe_displacement"][:, 0, 2]
        # rounding of 1e4 steps; links that go slack and snap taut: a shorter step lessens it, and moves the
        # times by less than 1e-4
        assert (audits(result) < (1e-11, 0.03)).all()
    lowest = int(depth.argmax())
    return time[: lowest + 1], depth[: lowest + 1]


def time_between(start, stop):
    """Time [s] in which it falls from one share of L to another, by v of the closed form."""
    root = np.linspace(np.sqrt(start), np.sqrt(stop), 20_001)  # of s, for the integrand begins as 1 / root
    y = 0.5 * (root[1:] + root[:-1])
    return float(np.sum(2.0 * np.sqrt(L * (1 - y * y) / (G * (2 - y * y))) * np.diff(root)))


def errors(workshop, links):
    """Relative errors of the whole time, and of the speed over parts of the way."""
    time, depth = fallen(workshop, links)
    at = lambda share: float(np.interp(share * L, depth, time))
    parts = [(0.2, 0.4), (0.4, 0.6), (0.6, 0.8)]
    speed = [time_between(a, b) / (at(b) - at(a)) - 1 for a, b in parts]
    return time[-1] / (WHOLE * np.sqrt(L / G)) - 1, speed


def test_closed_form_of_the_whole_time():
    """The figure of the literature is the integral of the speed."""
    digits = 5e-7 / WHOLE  # that are given; the midpoints end at a root, and are good to (1 / 20,000)^1.5
    assert time_between(0.0, 1.0) == pytest.approx(WHOLE * np.sqrt(L / G), rel=digits)


def test_a_folded_chain_falls_in_the_time_and_with_the_speed_of_the_closed_form(workshop, compare):
    """Faster than in free fall, sqrt(2) sqrt(L / g); the error falls with the links' length."""
    coarse, _ = errors(workshop, 21)
    fine, speed = errors(workshop, 41)
    whole, because = (1 + fine) * WHOLE, "41 links: their length, and half of one at the end"
    source = "Calkin and March 1989"
    compare("falling folded chain: time", source, "Fracture").figures(
        whole, WHOLE, 0.02, because, "sqrt(L/g)"
    )
    assert np.log(coarse / fine) / np.log(41 / 21) > 0.7
    # as above, over parts of 8 links of which one may be half over
    assert np.abs(speed).max() < 0.05, speed


@pytest.mark.long
def test_the_order_of_the_falling_chain(workshop):
    """From 21 to 321 links the time becomes right to 0.3 %, the speed over a fifth of the way to 1.2 %."""
    links = [21, 41, 81, 161, 321]
    computed = [errors(workshop, n) for n in links]
    times, speeds = [abs(t) for t, _ in computed], [np.abs(v).max() for _, v in computed]
    order = -np.diff(np.log(times)) / np.diff(np.log(links))
    print(times, speeds, order)
    assert (order > 0.7).all() and times[-1] < 4e-3 and speeds[-1] < 1.5e-2, (times, speeds, order)
