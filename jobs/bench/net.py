"""The net of the benchmark, for netfall and its peers alike: a square hypar under one force density.

N x N particles 2.2 m apart, z = h ((x/a)^2 - (y/a)^2), the outer ring fixed, E A = 1.33e8 N, force density
100 kN / 2.2 m, 517 kg on each particle, a downward load of 200 N/m2, steps of 0.1 s / 70 (0.49 of the stable
step), no damping: then velocity Verlet and central difference are the same. Taut for the 0.1 s that are
compared, so that elements that carry compression have the same answer.
"""

from dataclasses import dataclass

import numpy as np

SPACING, EA, PRESTRESS = 2.2, 1.95e11 * 6.83e-4, 100e3  # m, N, N
MASS = 1000.0 * SPACING**2 / 9.81 + 7850.0 * 6.83e-4 * 2 * SPACING  # kg
LOAD = 200.0 * SPACING**2  # N
DT, CHECKED = 0.1 / 70, 70  # s; steps after which the displacement in the middle is compared


@dataclass
class BenchNet:
    """x (n, 3) [m], elements (m, 2), L0 (m,) [m], fixed (n,), and the particle in the middle."""

    x: np.ndarray
    elements: np.ndarray
    L0: np.ndarray
    fixed: np.ndarray
    centre: int


def make_net(N: int) -> BenchNet:
    """The net of N x N particles."""
    a = 0.5 * (N - 1) * SPACING
    line = np.linspace(-a, a, N)
    X, Y = (grid.ravel() for grid in np.meshgrid(line, line))
    x = np.column_stack([X, Y, 0.1 * a * ((X / a) ** 2 - (Y / a) ** 2)])
    number = np.arange(N * N).reshape(N, N)
    elements = np.concatenate(
        [
            np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
            np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
        ]
    )
    elements = elements[np.lexsort((elements[:, 1], elements[:, 0]))]
    L = np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1)
    L0 = L / (1.0 + PRESTRESS / SPACING * L / EA)
    edge = np.ones((N, N), bool)
    edge[1:-1, 1:-1] = False
    return BenchNet(x, elements, L0, edge.ravel(), int(number[N // 2, N // 2]))


TORN_STEPS, TORN_DT, SEED = 2600, 1.0e-4, 7  # steps of the net that is torn, and their length [s]
SIDEWAYS = 24e3  # N, scatter of the load of a node along x and y, which comes at once
STRENGTH = 1.0e-3  # strain at fracture, the mean where it is scattered


def sideways_load(N: int, random) -> np.ndarray:
    """Load (n, 2) [N] of each node along x and y, the first that a generator of SEED draws."""
    return SIDEWAYS * random.standard_normal((N * N, 2))


def make_even_net(N: int) -> BenchNet:
    """The net of N x N particles, flat and with elements of one length."""
    whole = make_net(N)
    whole.x[:, 2] = 0.0
    whole.L0[:] = SPACING / (1.0 + PRESTRESS / EA)
    return whole
