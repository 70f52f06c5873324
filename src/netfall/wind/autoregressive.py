"""Coherent gust histories at a few control points by a vector autoregressive (AR) model, advanced in time.

    u(t) = sum_j Psi_j u(t - l_j dt) + w(t),    w ~ N(0, Sigma)

Psi and Sigma follow from the covariances R(tau) = integral S(n) coh(n) cos(2 pi n tau) dn by the
Yule-Walker equations at the lags l_j. The lags are not consecutive: four lags of 0.05 s see 0.2 s of a
process whose memory is half a minute, and such a model misses the spectrum by a third around its peak.
The same number of lags, spread from one step to the memory of the gust and chosen for the best fit,
keeps the half octaves above x = 0.4 within some 20 % (`spread_lags`).
"""

import itertools
from dataclasses import dataclass

import numpy as np

from netfall.wind.davenport import GUST_LENGTH, davenport_coherence, davenport_spectrum

LOWEST_BAND = 0.2  # x = 1200 n / U0 where the fit begins; less than 3 % of the variance lies below
BURN_IN = 8.0  # in units of 1200 m / U0: the memory of the start is gone
NUGGET = 1e-9  # of the variance, on the diagonal: control points close together make R nearly singular


def frequencies(speed: float, dt: float) -> np.ndarray:
    """Midpoint frequencies [Hz] up to Nyquist, fine enough for 20 gust lengths (1200 m / U0) of lag."""
    count = int(np.clip(np.ceil(20 * GUST_LENGTH / (speed * dt)), 4096, 2**20))
    return (np.arange(count) + 0.5) * (0.5 / dt / count)


def spread_lags(speed: float, dt: float, order: int) -> np.ndarray:
    """The `order` lags (in steps of dt) whose AR spectrum is closest to Davenport's, by half octaves.

    Chosen from a geometric set between one step and half of 1200 m / U0: one step, then the best three
    together (a long lag and a short one only help each other), then one by one.
    """
    memory = max(2.0, 0.5 * GUST_LENGTH / (speed * dt))
    candidates = np.unique(np.round(np.geomspace(1.0, memory, 24)).astype(int))
    n = frequencies(speed, dt)
    weight = davenport_spectrum(n, speed, 1.0) * (n[1] - n[0])
    differences = np.unique(np.abs(np.append(candidates, candidates[:, None] - candidates)))
    covariance = {int(lag): weight @ np.cos(2 * np.pi * n * lag * dt) for lag in differences}
    misfit = _spectral_misfit(speed, dt, candidates, covariance)
    lags, rest = (1,), [int(lag) for lag in candidates if lag > 1]
    while len(lags) < order and rest:
        count = min(3, order - 1, len(rest)) if len(lags) == 1 else 1
        chosen = min(itertools.combinations(rest, count), key=lambda some: misfit(tuple(sorted(lags + some))))
        lags, rest = tuple(sorted(lags + chosen)), [lag for lag in rest if lag not in chosen]
    return np.array(lags)


def _spectral_misfit(speed, dt, candidates, covariance):
    """Function of the lags: root mean square of the log ratio of the AR spectrum to Davenport's, by half octaves."""
    lowest, highest, per_band = LOWEST_BAND * speed / GUST_LENGTH, 0.5 / dt, 12
    bands = max(1, int(2 * np.log2(highest / lowest)))
    n = np.geomspace(lowest, highest, bands * per_band)
    target = davenport_spectrum(n, speed, 1.0)
    wave = {int(lag): np.exp(-2j * np.pi * n * dt * lag) for lag in candidates}

    def misfit(lags):
        right = np.array([covariance[lag] for lag in lags])
        psi = np.linalg.solve([[covariance[abs(i - j)] for j in lags] for i in lags], right)
        variance = covariance[0] - psi @ right
        response = 1.0 - sum(coefficient * wave[lag] for coefficient, lag in zip(psi, lags))
        ratio = 2 * dt * variance / np.abs(response) ** 2 / target
        return np.sqrt(np.mean(np.log(ratio.reshape(bands, per_band).mean(1)) ** 2))

    return misfit


@dataclass(frozen=True)
class GustModel:
    """Coefficients of the vector AR model.

    lags : (p,) [steps]; psi : (p, c, c); noise_root : (c, c), Sigma = noise_root noise_root^T
    covariance : (c, c) [m2/s2], of simultaneous gusts, the model's target
    """

    lags: np.ndarray
    psi: np.ndarray
    noise_root: np.ndarray
    covariance: np.ndarray


def fit_gust_model(points, mean, speed, roughness, decay, dt, order) -> GustModel:
    """Yule-Walker fit of the AR model to Davenport's spectrum and coherence.

    points : (c, 3) [m] control points; mean : (c,) [m/s] their mean speeds
    speed : U0 [m/s]; decay : (Cx, Cy, Cz); dt : [s] time step of the histories; order : number of lags
    """
    lags = spread_lags(speed, dt, order)
    needed = np.unique(np.abs(np.concatenate([[0], lags, (lags[:, None] - lags[None]).ravel()])))
    n = frequencies(speed, dt)
    waves = np.cos(2 * np.pi * np.outer(needed * dt, n)) * (davenport_spectrum(n, speed, roughness) * (n[1] - n[0]))
    c = len(points)
    R = np.empty((len(needed), c, c))
    for i in range(c):
        for j in range(i, c):
            coherence = davenport_coherence(n, points[i] - points[j], decay, 0.5 * (mean[i] + mean[j]))
            R[:, i, j] = R[:, j, i] = waves @ coherence
    at = {int(lag): R[k] for k, lag in enumerate(needed)}
    at[0] = at[0] + NUGGET * np.trace(at[0]) / c * np.eye(c)
    p = len(lags)
    # The coherence is real, so R(tau) = R(-tau) = R(tau)^T: blocks need no transposes.
    matrix = np.block([[at[abs(int(lags[i] - lags[j]))] for j in range(p)] for i in range(p)])
    right = np.vstack([at[int(lag)] for lag in lags])
    stacked = np.linalg.solve(matrix, right)  # (p c, c): Psi_j^T one below the other
    psi = np.array([stacked[k * c:(k + 1) * c].T for k in range(p)])
    sigma = at[0] - right.T @ stacked
    values, vectors = np.linalg.eigh(0.5 * (sigma + sigma.T))
    return GustModel(lags, psi, vectors * np.sqrt(np.maximum(values, 0.0)), at[0])


class GustRecursion:
    """The AR recursion, one time step a call. Its state is the ring of past speeds and the step count.

    The noise of step s is a function of (seed, s) alone (counter-based Philox), whatever was drawn before.
    """

    def __init__(self, model: GustModel, seed: int, speed: float, dt: float):
        self.model = model
        self.seed = seed
        self.past = np.zeros((int(model.lags[-1]), model.psi.shape[1]))  # row s % len: speeds of step s
        self.step = 0
        for _ in range(int(np.ceil(BURN_IN * GUST_LENGTH / (speed * dt)))):
            self.advance()

    def noise(self, step: int) -> np.ndarray:
        """Independent standard normal numbers (c,) of one step."""
        bits = np.random.Philox(key=self.seed, counter=[0, 0, 0, step])
        return np.random.Generator(bits).standard_normal(self.past.shape[1])

    def advance(self) -> np.ndarray:
        """Gust speeds (c,) [m/s] of the next step."""
        model, ring = self.model, len(self.past)
        u = model.noise_root @ self.noise(self.step)
        for lag, psi in zip(model.lags, model.psi):
            u = u + psi @ self.past[(self.step - lag) % ring]
        self.past[self.step % ring] = u
        self.step += 1
        return u
