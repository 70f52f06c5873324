"""Damping over a band: Maxwell branches beside an element, each a spring and a dashpot.

Of the axial force N a branch holds V, which follows it: V' = (N - V) / tau. It adds alpha (N - V), so a
cable carries max(0, N + sum alpha (N - V)). N(n) holds from n - 1/2 to n + 1/2: second order, for steps of
any length. Kept is what of alpha V(n-1/2) is left at n, H = alpha exp(-dt / 2 tau) V(n-1/2):

    force at n   N (1 + sum alpha exp(-dt / 2 tau)) - sum H,    dt of the step before n
    to n + 1     H <- exp(-dt / tau) H + alpha exp(-dt / 2 tau) (1 - exp(-kick / tau)) N,    of that after
"""

import numpy as np

from netfall.core.kernels import inner_kernel
from netfall.core.records import has
from netfall.numerics.arithmetic import exponential, exponential_less_one

NARROW = 1.14  # largest over smallest ratio within a band for which two branches will do


def band_branches(ratio: float, low: float, high: float) -> tuple[float, ...]:
    """alpha, tau [s] of two or three branches for a damping ratio over a band [Hz]: as many of each.

    A branch with the largest ratio e, at f, has alpha = 8 e^2 + 4 e sqrt(4 e^2 + 1) and
    tau = 1 / (sqrt(1 + alpha) 2 pi f). With C = cosh(ln(high / low) / 2) two alike at
    sqrt(low high) (sqrt(1 + C) + sqrt(C))^(+-1) have one ratio at low, high and the middle, and between them
    (1 + C) / (2 sqrt(C)) times as much at most: 1.14 where high is 30 times low. There the least and the
    largest have the ratio asked in the mean, with e such that both ends are equal (alike for small ratios).
    Three, in wider bands, stand at low, the middle and high, and have the ratio asked there.
    """
    middle, C = np.sqrt(low * high), 0.5 * (np.sqrt(high / low) + np.sqrt(low / high))
    largest, apart = (1.0 + C) / (2.0 * np.sqrt(C)), np.sqrt(1.0 + C) + np.sqrt(C)
    at, where, target = [middle / apart, middle * apart], [low, high], ratio * 2.0 / (1.0 + largest)
    if largest > NARROW:
        at, where, target = [low, middle, high], [low, middle, high], ratio
    e = np.full(len(at), 0.5 * ratio)
    for _ in range(100):
        alpha = 8.0 * e * e + 4.0 * e * np.sqrt(4.0 * e * e + 1.0)
        tau = 1.0 / (np.sqrt(1.0 + alpha) * 2.0 * np.pi * np.array(at))
        e *= target / _ratio(alpha, tau, np.array(where))
    return (*alpha.tolist(), *tau.tolist())


def _ratio(alpha: np.ndarray, tau: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Damping ratio (n,) by branches alpha, tau (k,) [s] of what swings at frequencies (n,) [Hz] without."""
    phase = 2.0 * np.pi * frequency[:, None] * tau
    stiffness = 1.0 + (alpha * phase * phase / (1.0 + phase * phase)).sum(1)
    phase *= np.sqrt(stiffness)[:, None]  # it swings faster with them
    share = alpha / (1.0 + phase * phase)
    return 0.5 * (share * phase).sum(1) / (1.0 + (share * phase * phase).sum(1))


def stiffening(branches: tuple[float, ...]) -> float:
    """By how much branches make an element stiffer at most: 1 + sum alpha."""
    return 1.0 + sum(branches[: len(branches) // 2])


@inner_kernel
def set_branches(before_dt, dt, law):
    """What branches do at a step: rows 2 and 3 of their table, and the first number of row 4.

    What stays of H to n + 1, what joins it of N; 1 + sum alpha exp(-dt / 2 tau). before_dt, dt : [s]
    """
    b, kick_dt = law.branches, 0.5 * (before_dt + dt)
    b[4, 0] = 1.0
    for k in range(b.shape[1]):
        alpha, rate = b[0, k], 1.0 / b[1, k]
        b[2, k] = exponential(-dt * rate)
        b[3, k] = -alpha * exponential(-0.5 * dt * rate) * exponential_less_one(-kick_dt * rate)
        b[4, 0] += alpha * exponential(-0.5 * before_dt * rate)


@inner_kernel
def add_branches(x, elements, now, law, f_int, f_band):
    """Add the forces of the branches at x (n, 3) [m] to f_int (n, 3) [N]; alone to f_band (n, 3) [N]."""
    f_band[:] = 0.0
    for e in range(elements.ends.shape[0]):
        if elements.EA[e] == 0.0:
            continue
        held = elements.branch_a[e] + elements.branch_b[e]
        if has(elements.branch_c):
            held += elements.branch_c[e]
        total = law.branches[4, 0] * now.N[e] - held
        q = ((total if elements.bar[e] or total > 0.0 else 0.0) - now.N[e]) / now.L[e]
        start, end = elements.ends[e, 0], elements.ends[e, 1]
        for k in range(3):
            pull = q * (x[end, k] - x[start, k])
            f_band[start, k] += pull
            f_band[end, k] -= pull
            f_int[start, k] += pull
            f_int[end, k] -= pull


def with_branches(state, N: np.ndarray) -> np.ndarray:
    """Axial forces (m,) [N] with those of the branches, which N is without; of steps that are short."""
    if state.branches is None:
        return N
    held = state.branch_a + state.branch_b + (0.0 if state.branch_c is None else state.branch_c)
    total = (1.0 + state.branches[0].sum()) * N - held
    return np.where((state.bar != 0) | (total > 0.0), total, 0.0)
