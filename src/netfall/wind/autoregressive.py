"""Coherent gust histories at a few control points by a vector autoregressive (AR) model, advanced in time.

    u(t) = sum_j Psi_j u(t - l_j dt) + w(t),    w ~ N(0, Sigma)

Psi and Sigma follow from the covariances R(tau) = integral S(n) coh(n) cos(2 pi n tau) dn by the
Yule-Walker equations at the lags l_j. The lags are not consecutive: four lags of 0.05 s see 0.2 s of a
process whose memory is half a minute, and such a model misses the spectrum by a third around its peak.
The same number of lags, spread from one step to the memory of the gust and chosen for the best fit,
keeps the half octaves within some 15 % (`spread_lags`).
"""

import itertools
from dataclasses import dataclass

import numpy as np

from netfall.wind.davenport import GUST_LENGTH, davenport_coherence, davenport_spectrum

LOWEST_BAND = 0.3  # x = 1200 n / U0 where the fit begins; some 3 % of the variance lies below
BURN_IN = 8.0  # in units of 1200 m / U0: the memory of the start is gone
SOME_POINTS = 6  # control points on which the lags are chosen
NUGGET = 1e-9  # of the variance, on the diagonal: control points close together make R nearly singular


def frequencies(speed: float, dt: float) -> np.ndarray:
    """Midpoint frequencies [Hz] up to Nyquist, fine enough for 20 gust lengths (1200 m / U0) of lag."""
    count = int(np.clip(np.ceil(20 * GUST_LENGTH / (speed * dt)), 4096, 2**20))
    return (np.arange(count) + 0.5) * (0.5 / dt / count)


def covariances(points, mean, decay, n, weight, dt, lags) -> dict[int, np.ndarray]:
    """Covariances R(lag dt) (c, c) of the gusts at points (c, 3) [m] for each lag [steps].

    mean : (c,) [m/s]; weight : spectrum times frequency step at the frequencies n [Hz]
    """
    c = len(points)
    lags = np.unique(lags)
    waves = np.cos(2 * np.pi * np.outer(lags * dt, n)) * weight
    R = np.empty((len(lags), c, c))
    for i in range(c):
        for j in range(i, c):
            R[:, i, j] = R[:, j, i] = waves @ davenport_coherence(
                n, points[i] - points[j], decay, 0.5 * (mean[i] + mean[j])
            )
    R += NUGGET * R[0, 0, 0] * (lags == 0)[:, None, None] * np.eye(c)
    return {int(lag): R[k] for k, lag in enumerate(lags)}


def yule_walker(R: dict[int, np.ndarray], lags) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients Psi (p, c, c) at the lags and covariance Sigma (c, c) of the noise.

    The coherence is real, so R(tau) = R(-tau) = R(tau)^T and the blocks need no transposes.
    """
    p, c = len(lags), len(R[0])
    matrix = np.block([[R[abs(int(i - j))] for j in lags] for i in lags])
    right = np.vstack([R[int(lag)] for lag in lags])
    stacked = np.linalg.solve(matrix, right)  # (p c, c): Psi_j^T one below the other
    return stacked.reshape(p, c, c).transpose(0, 2, 1), R[0] - right.T @ stacked


def spread_lags(points, mean, speed, decay, dt, order) -> tuple[np.ndarray, float]:
    """The `order` lags [steps] whose AR spectrum is closest to Davenport's, by half octaves, and a gain.

    Chosen from a geometric set between one step and half of 1200 m / U0, on a few of the points: one step,
    the best pair, then one by one, then each once more against all others. The gain is the factor on the
    spectrum that centres what misfit is left, weighted by variance.
    """
    few = np.unique(np.linspace(0, len(points) - 1, SOME_POINTS).astype(int))
    memory = max(2.0, 0.5 * GUST_LENGTH / (speed * dt))
    candidates = np.unique(np.round(np.geomspace(1.0, memory, 24)).astype(int))
    n = frequencies(speed, dt)
    weight = davenport_spectrum(n, speed, 1.0) * (n[1] - n[0])
    R = covariances(
        points[few],
        mean[few],
        decay,
        n,
        weight,
        dt,
        np.abs(np.append([0, *candidates], candidates[:, None] - candidates)),
    )
    misfit, share = _spectral_misfit(R, speed, dt)
    size = lambda lags: float(np.sqrt(np.mean(misfit(np.sort(lags)) ** 2)))
    rest = [int(lag) for lag in candidates if lag > 1]
    order = min(order, 1 + len(rest))
    pairs = itertools.combinations(rest, min(2, order - 1))
    lags = [1, *min(pairs, key=lambda pair: size([1, *pair]))]
    while len(lags) < order:
        lags.append(min((lag for lag in rest if lag not in lags), key=lambda lag: size([*lags, lag])))
    for k in range(1, order):
        others = lags[:k] + lags[k + 1 :]
        lags[k] = min((lag for lag in rest if lag not in others), key=lambda lag: size([*others, lag]))
    lags = np.sort(lags)
    return lags, float(np.exp(-share @ misfit(lags)))


def _spectral_misfit(R, speed, dt):
    """Function of the lags: log ratio of the AR spectrum to Davenport's by half octaves.

    And the share of each half octave in the variance.
    """
    lowest, highest, per_band = LOWEST_BAND * speed / GUST_LENGTH, 0.5 / dt, 6
    bands = max(1, int(2 * np.log2(highest / lowest)))
    n = np.geomspace(lowest, highest, bands * per_band)
    target = davenport_spectrum(n, speed, 1.0)
    share = (target * n).reshape(bands, per_band).sum(1)

    def misfit(lags):
        psi, sigma = yule_walker(R, lags)
        waves = np.exp(-2j * np.pi * dt * np.outer(n, lags))
        transfer = np.linalg.inv(np.eye(len(sigma)) - np.tensordot(waves, psi, 1))
        spectrum = 2 * dt * np.einsum("fij,jk,fik->f", transfer, sigma, transfer.conj()).real / len(sigma)
        return np.log((spectrum / target).reshape(bands, per_band).mean(1))

    return misfit, share / share.sum()


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
    lags, gain = spread_lags(points, mean, speed, decay, dt, order)
    n = frequencies(speed, dt)
    weight = gain * davenport_spectrum(n, speed, roughness) * (n[1] - n[0])
    R = covariances(points, mean, decay, n, weight, dt, np.abs(np.append([0, *lags], lags[:, None] - lags)))
    psi, sigma = yule_walker(R, lags)
    values, vectors = np.linalg.eigh(0.5 * (sigma + sigma.T))
    return GustModel(lags, psi, vectors * np.sqrt(np.maximum(values, 0.0)), R[0])


class GustRecursion:
    """The AR recursion, one time step a call. Its state is the ring of past speeds and the step count.

    The noise of step s is a function of (seed, s) alone (counter-based Philox), whatever was drawn before.
    """

    def __init__(self, model: GustModel, seed: int, speed: float, dt: float):
        self.model = model
        self.past = np.zeros((int(model.lags[-1]), model.psi.shape[1]))  # row s % len: speeds of step s
        self.step = 0
        self._bits = np.random.Philox(key=seed)
        self._start = self._bits.state  # with nothing drawn
        self._generator = np.random.Generator(self._bits)
        for _ in range(int(np.ceil(BURN_IN * GUST_LENGTH / (speed * dt)))):
            self.advance()

    def record(self) -> dict:
        """The state that a continuation needs, for `restore`."""
        return {"past": self.past, "step": self.step}

    def restore(self, record: dict) -> None:
        """Take up the record of an earlier run."""
        self.past[:], self.step = record["past"], int(record["step"])

    def noise(self, step: int) -> np.ndarray:
        """Independent standard normal numbers (c,) of one step."""
        self._start["state"]["counter"][:] = (0, 0, 0, step)
        self._bits.state = self._start
        return self._generator.standard_normal(self.past.shape[1])

    def advance(self) -> np.ndarray:
        """Gust speeds (c,) [m/s] of the next step."""
        model, ring = self.model, len(self.past)
        u = model.noise_root @ self.noise(self.step)
        for lag, psi in zip(model.lags, model.psi):
            u = u + psi @ self.past[(self.step - lag) % ring]
        self.past[self.step % ring] = u
        self.step += 1
        return u
