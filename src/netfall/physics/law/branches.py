"""Constant axial damping ratio in a frequency band: Maxwell branches parallel to an element.

A branch is a spring and a dashpot. It stores a delayed axial force V with V' = (N - V) / tau, and adds alpha
(N - V). So a cable carries max(0, N + sum alpha (N - V)). N(n) counts from n - 1/2 to n + 1/2, which is
second-order accurate for steps of any length. The stored value is the remainder of alpha V(n-1/2) at n,
H = alpha exp(-dt / 2 tau) V(n-1/2):

    force at n   N (1 + sum alpha exp(-dt / 2 tau)) - sum H,    dt of the step before n
    to n + 1     H <- exp(-dt / tau) H + alpha exp(-dt / 2 tau) (1 - exp(-h / tau)) N,    dt after n

with the length h of the velocity update at n, the mean of both dt.
"""

import numpy as np

from netfall.core.arithmetic import exponential, exponential_minus_one
from netfall.core.arrays import FloatArray
from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import is_present
from netfall.physics.elements import ElementState
from netfall.physics.fields import Elements
from netfall.physics.law.law import LawParameters
from netfall.physics.state import State

# largest over smallest damping ratio in the band up to which two branches suffice
MAX_TWO_BRANCH_RATIO = 1.14
# largest step over the time constant of a branch: a faster one leaves nothing, and overflows `exponential`
MAX_FADING = 500.0


def band_branches(ratio: float, low: float, high: float) -> tuple[float, ...]:
    """Return alpha (k,) and tau (k,) [s] of two or three branches for a damping ratio in a band [Hz].

    A branch with the largest ratio e, at f, has alpha = 8 e^2 + 4 e sqrt(4 e^2 + 1) and
    tau = 1 / (sqrt(1 + alpha) 2 pi f). Let C = cosh(ln(high / low) / 2). Two equal branches at sqrt(low high)
    (sqrt(1 + C) + sqrt(C))^(+-1) give one ratio at low, high and the middle. Between these it is up to
    (1 + C) / (2 sqrt(C)) times as large: 1.14 if high is 30 times low. The mean of the least and the largest
    ratio is then the required one, with e such that both ends are equal (equal branches for small ratios). In
    wider bands three branches at low, the middle and high have the required ratio there. All this holds for
    small ratios. The true one is up to 11 % larger if the ratio is 0.02, up to 31 % if it is 0.1.
    """
    middle, C = np.sqrt(low * high), 0.5 * (np.sqrt(high / low) + np.sqrt(low / high))
    largest, spread = (1.0 + C) / (2.0 * np.sqrt(C)), np.sqrt(1.0 + C) + np.sqrt(C)
    centre, fit_at = [middle / spread, middle * spread], [low, high]
    target = ratio * 2.0 / (1.0 + largest)
    if largest > MAX_TWO_BRANCH_RATIO:
        centre, fit_at, target = [low, middle, high], [low, middle, high], ratio
    e = np.full(len(centre), 0.5 * ratio)
    for _ in range(100):
        alpha = 8.0 * e * e + 4.0 * e * np.sqrt(4.0 * e * e + 1.0)
        tau = 1.0 / (np.sqrt(1.0 + alpha) * 2.0 * np.pi * np.array(centre))
        e *= target / _ratio(alpha, tau, np.array(fit_at))
    return (*alpha.tolist(), *tau.tolist())


def _ratio(alpha: np.ndarray, tau: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Return damping ratios (n,) due to branches alpha, tau (k,) [s] at undamped frequencies (n,) [Hz]."""
    phase = 2.0 * np.pi * frequency[:, None] * tau
    stiffness = 1.0 + (alpha * phase * phase / (1.0 + phase * phase)).sum(1)
    phase *= np.sqrt(stiffness)[:, None]  # the branches raise the frequency
    share = alpha / (1.0 + phase * phase)
    return 0.5 * (share * phase).sum(1) / (1.0 + (share * phase * phase).sum(1))


def branch_stiffening(branches: tuple[float, ...]) -> float:
    """Return the largest factor by which branches stiffen an element: 1 + sum alpha."""
    return 1.0 + sum(branches[: len(branches) // 2])


@kernel
def set_branches(before_dt: float, dt: float, law: LawParameters) -> None:
    """Compute the factors of the branches for a step: rows 2 and 3 of their table, and entry (4, 0).

    They are the factor of H and the factor of N in H(n+1), and 1 + sum alpha exp(-dt / 2 tau).
    before_dt, dt : [s] the steps before and after
    """
    b, dt_v = law.branches, 0.5 * (before_dt + dt)
    b[4, 0] = 1.0
    for k in range(b.shape[1]):
        alpha, least_tau = b[0, k], max(before_dt, dt) / MAX_FADING
        rate = 1.0 / max(b[1, k], least_tau)
        b[2, k] = exponential(-dt * rate)
        b[3, k] = -alpha * exponential(-0.5 * dt * rate) * exponential_minus_one(-dt_v * rate)
        b[4, 0] += alpha * exponential(-0.5 * before_dt * rate)


@inner_kernel
def add_branches(
    x: FloatArray,
    elements: Elements,
    now: ElementState,
    law: LawParameters,
    f_int: FloatArray,
    f_band: FloatArray,
) -> None:
    """Add branch forces at x (n, 3) [m] to f_int (n, 3) [N], and write them separately to f_band (n, 3)."""
    f_band[:] = 0.0
    for e in range(elements.ends.shape[0]):
        if elements.EA[e] == 0.0:
            continue
        state_sum = elements.branch_a[e] + elements.branch_b[e]
        if is_present(elements.branch_c):
            state_sum += elements.branch_c[e]
        total = law.branches[4, 0] * now.N[e] - state_sum
        q = ((total if elements.bar[e] or total > 0.0 else 0.0) - now.N[e]) / now.L[e]
        start, end = elements.ends[e, 0], elements.ends[e, 1]
        for k in range(3):
            pull = q * (x[end, k] - x[start, k])
            f_band[start, k] += pull
            f_band[end, k] -= pull
            f_int[start, k] += pull
            f_int[end, k] -= pull


def add_branch_forces(state: State, N: np.ndarray, before_dt: float, dt: float) -> np.ndarray:
    """Return axial forces (m,) [N] including the branches, from N without them.

    before_dt, dt : [s], as of `set_branches`
    """
    if state.branches is None:
        return N
    set_branches(before_dt, dt, state.law)
    state_sum = state.branch_a + state.branch_b + (0.0 if state.branch_c is None else state.branch_c)
    total = state.branches[4, 0] * N - state_sum
    return np.where((state.bar != 0) | (total > 0.0), total, 0.0)
