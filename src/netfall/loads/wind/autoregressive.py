"""Coherent gust histories at a few control points by a vector autoregressive (AR) model, advanced in time.

    u(t) = sum_j Psi_j u(t - l_j dt) + w(t),    w ~ N(0, Sigma)

Psi and Sigma follow from the covariances R(tau) = integral S(n) coh(n) cos(2 pi n tau) dn, up to the highest
frequency that the samples resolve, by the Yule-Walker equations at the lags l_j. Consecutive lags of 0.05 s
would cover a fraction of a second of a process with a memory of half a minute. The lags therefore grow
geometrically, from one step to the memory of the gust. The equations hold only between the lags, so
the variance of the model is not exactly R(0). It is computed from the spectrum of the model, and Sigma is
scaled to give R(0).

All results are smooth functions of the wind speed, except the lags: these are rounded to steps, with little
effect. The noise is a function of (seed, step). Similar speeds therefore give nearly the same gusts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.errors import InputError
from netfall.core.functions import cos, geometric, integral, log, sin
from netfall.core.kernels import kernel
from netfall.core.linear import factorise_cholesky, product, solve_cholesky_columns, solve_complex
from netfall.loads import messages
from netfall.loads.wind.noise import standard_normal
from netfall.loads.wind.surface import SurfaceMeans
from netfall.physics.wind_spectra import Gust, davenport_coherence

PER_OCTAVE = 24  # nodes of the integral over frequencies
LINEAR_BELOW = 1e-3  # share of U0 / memory: frequency below which the spectrum is linear
JUDGED_POINTS = 6  # number of control points at which variance and spectrum of the model are checked
NUGGET = 1e-9  # share of the variance added to the diagonal: close control points make R nearly singular
SHARE_BELOW_BANDS = 0.03  # share of the variance below the half octaves in which the spectrum is checked
MIN_TARGET_SHARE = 1e-12  # share of the largest spectrum: lower bound of the target in checks of the gusts
BURN_IN = 2.0  # memories of the gust after which less than 1e-3 of the initial zero state remains
DECAY_MEMORIES = 2, 8  # longest lags that gusts without noise may take to grow, and then to decay
NOISE_BLOCK = 64  # steps per draw of noise


def frequency_nodes(gust: Gust, dt: float) -> np.ndarray:
    """Return frequencies [Hz] in geometric progression from 0 to half of 1 / dt."""
    high = 0.5 / dt
    low = min(LINEAR_BELOW * gust.speed / gust.memory, 0.01 * high)
    octaves = float(log(high / low) / log(2.0))
    return np.append(0.0, geometric(low, high, max(2, int(np.ceil(PER_OCTAVE * octaves)))))


def cosine_weights(n: np.ndarray, lags: np.ndarray | list[int], dt: float) -> np.ndarray:
    """Return weights (lags, nodes) of values at nodes n, for their integral with cos(2 pi n lag dt).

    The integral is exact for values that are linear between the nodes: by parts, with the slopes. At
    the last node, 1 / 2 dt, the sine of the boundary term is zero.
    """
    h, omega = np.diff(n), 2.0 * np.pi * dt * np.asarray(lags, float)[:, None]
    weight = np.zeros((len(lags), len(n)))
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = -2.0 * sin(0.5 * omega * (n[1:] + n[:-1])) * sin(0.5 * omega * h) / (omega * omega * h)
    flat = np.asarray(lags) == 0
    weight[:, 1:] += np.where(flat[:, None], 0.5 * h, rise)
    weight[:, :-1] += np.where(flat[:, None], 0.5 * h, -rise)
    return weight


@dataclass(frozen=True)
class PointGusts:
    """Gusts at points (c, 3) [m], axes of the wind. mean : (c,) [m/s] at the points; decay : (Cx, Cy, Cz)"""

    points: np.ndarray
    mean: np.ndarray
    decay: tuple[Any, ...]

    def covariances(self, n: FloatArray, weight: FloatArray) -> np.ndarray:
        """Compute sums (w, c, c) of their coherence over frequencies n (f,) [Hz] with weights (w, f)."""
        points, mean = self.points, self.mean
        i, j = np.triu_indices(len(points))
        coherence = davenport_coherence(n, points[i] - points[j], self.decay, 0.5 * (mean[i] + mean[j]))
        sums = product(weight, coherence)
        R = np.empty((len(weight), len(points), len(points)))
        R[:, i, j] = sums
        R[:, j, i] = R[:, i, j]
        return R

    def kept(self, n: FloatArray, some: IntArray) -> np.ndarray:
        """Return the share (f,) of the spectrum at n (f,) [Hz] in gusts at points, which is 1."""
        return np.ones(len(n))


def yule_walker(R: np.ndarray, known: np.ndarray, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the coefficients Psi (p, c, c) at the lags and the covariance Sigma (c, c) of the noise.

    R : (l, c, c) at the lags `known`. The coherence is real, so R(tau) = R(-tau) = R(tau)^T.
    """
    p, c = len(lags), R.shape[1]
    between = np.searchsorted(known, np.abs(lags[:, None] - lags))
    matrix = R[between].transpose(0, 2, 1, 3).reshape(p * c, p * c)
    right = R[np.searchsorted(known, lags)].reshape(p * c, c)
    stacked = right.copy()  # (p c, c): Psi_j^T stacked
    factorise_covariance(matrix)
    solve_cholesky_columns(matrix, stacked)
    sigma = R[0] - product(right.T, stacked)
    return stacked.reshape(p, c, c).transpose(0, 2, 1), 0.5 * (sigma + sigma.T)


def factorise_covariance(matrix: np.ndarray) -> None:
    """Compute the Cholesky factor in place, as `linear.factorise_cholesky`.

    Raises InputError for a singular matrix.
    """
    if factorise_cholesky(matrix):
        raise InputError(messages.SINGULAR_GUSTS())


def cholesky_root(sigma: np.ndarray) -> np.ndarray:
    """Compute the lower Cholesky factor (c, c) of a covariance."""
    upper = sigma.copy()
    factorise_covariance(upper)
    return np.triu(upper).T


def model_spectrum(
    n: np.ndarray, lags: IntArray, psi: FloatArray, sigma: FloatArray, dt: float
) -> np.ndarray:
    """Compute one-sided spectra (f,) [m2/s2/Hz] of an AR model at n (f,) [Hz], mean over its points."""
    phase = 2.0 * np.pi * dt * np.multiply.outer(n, lags)
    waves = cos(phase) - 1j * sin(phase)
    systems = np.eye(len(sigma)) - np.add.reduce(waves[:, :, None, None] * psi, axis=1)
    response = np.repeat(cholesky_root(sigma).astype(complex)[None], len(n), axis=0)
    solve_complex(systems, response)
    power = (response.real**2 + response.imag**2).reshape(len(n), -1)
    return 2.0 * dt * np.add.reduce(power, axis=1) / len(sigma)


@dataclass(frozen=True)
class Losses:
    """Deficits of the generated gusts against the target, as shares.

    beyond : share of the variance at frequencies above those that samples dt apart resolve
    between : share of the rest lost by linear interpolation between samples, mean over time
    misfit : signed error of the spectrum in the worst half octave, which starts at `misfit_low` [Hz]
    slow_below : [Hz], start of these half octaves; slow : share of the carried variance below it
    slow_target : the same share of the target. As n goes to zero, the spectrum of so few lags is constant,
    Davenport's is zero
    """

    beyond: float
    between: float
    misfit: float
    misfit_low: float
    slow_below: float
    slow: float
    slow_target: float


@dataclass(frozen=True)
class GustModel:
    """Coefficients of the vector AR model.

    lags : (p,) [steps]; psi : (p c, c), Psi_j^T stacked
    noise_root : (c, c), upper, Sigma = noise_root^T noise_root
    covariance : (c, c) [m2/s2], of simultaneous gusts; burn_in : [steps]
    """

    lags: np.ndarray
    psi: np.ndarray
    noise_root: np.ndarray
    covariance: np.ndarray
    burn_in: int
    losses: Losses


def covariances(gusts: PointGusts | SurfaceMeans, gust: Gust, dt: float, lags: IntArray) -> np.ndarray:
    """Compute the covariances R(lag dt) (lags, c, c) of the gusts. lags : ascending from 0 [steps]"""
    n = frequency_nodes(gust, dt)
    R = gusts.covariances(n, cosine_weights(n, lags, dt) * gust.spectrum(n))
    R[0] += NUGGET * R[0, 0, 0] * np.eye(R.shape[1])
    return R


def fit_gust_model(gusts: PointGusts | SurfaceMeans, gust: Gust, dt: float, order: int) -> GustModel:
    """Fit the AR model to a spectrum and Davenport's coherence by the Yule-Walker equations.

    dt : [s] time step of the histories; order : number of lags
    """
    memory = max(2.0, gust.memory / (gust.speed * dt))  # of the gust, in steps
    lags = np.unique(np.round(geometric(1.0, memory, order)).astype(int))
    known = np.unique(np.abs(np.append([0, *lags], lags[:, None] - lags)))
    R = covariances(gusts, gust, dt, known)
    psi, sigma = yule_walker(R, known, lags)
    gain, losses = _gain_and_deficits(R, known, lags, gusts, gust, dt)
    root = cholesky_root(gain * sigma).T.copy()  # unique and smooth: similar speeds have the same gusts
    burn_in = int(np.ceil(BURN_IN * gust.memory / (gust.speed * dt)))
    model = GustModel(lags, np.vstack(list(psi.transpose(0, 2, 1))), root, R[0], burn_in, losses)
    if not is_stable(model):
        raise InputError(messages.UNSTABLE_GUSTS(points=R.shape[1]))
    return model


def is_stable(model: GustModel) -> bool:
    """Return whether gusts of the model decay without noise.

    The Yule-Walker equations ensure this for consecutive lags only.
    """
    ring, c = int(model.lags[-1]), len(model.noise_root)
    speeds = standard_normal(np.random.Philox(key=0), ring * c).reshape(-1, c)
    terms, largest, first = np.empty((2, c)), [], 0
    for memories in DECAY_MEMORIES:
        noise = np.zeros((memories * ring, c))
        step_gusts(noise, model.noise_root, model.lags, model.psi, first, speeds, terms)
        largest.append(float(np.abs(speeds).max()))
        first += len(noise)
    return largest[1] < largest[0]


def _gain_and_deficits(
    R: FloatArray, known: IntArray, lags: IntArray, gusts: PointGusts | SurfaceMeans, gust: Gust, dt: float
) -> tuple[float, Losses]:
    """Return the factor on Sigma that gives the variance R(0), and the deficits, at a few points."""
    points = np.unique(np.linspace(0, R.shape[1] - 1, JUDGED_POINTS).astype(int))
    R = R[:, points[:, None], points]
    psi, sigma = yule_walker(R, known, lags)
    n = frequency_nodes(gust, dt)[1:]
    model = model_spectrum(n, lags, psi, sigma, dt)
    variance = integral(model, n) + model[0] * n[0]
    variance_given = _mean_diagonal(R[0])
    gain = variance_given / variance
    between = (variance_given - _mean_diagonal(R[1])) / (3.0 * variance_given)
    spectrum, kept_share, octaves = gust.spectrum(n), gusts.kept(n, points), _half_octaves(n, gust)
    target = np.maximum(spectrum * kept_share, MIN_TARGET_SHARE * spectrum.max())
    error = (gain * model / target)[octaves].mean(1) - 1.0
    worst, first = int(np.argmax(np.abs(error))), int(octaves[0, 0])
    slow = (integral(model[: first + 1], n[: first + 1]) + model[0] * n[0]) / variance
    low, misfit, start = float(n[octaves[worst, 0]]), float(error[worst]), float(n[first])
    beyond = gust.share_above(0.5 / dt)
    kept_share = float(integral(spectrum * kept_share, n) / integral(spectrum, n))
    slow_target = (1.0 - gust.share_above(start)) / (1.0 - beyond) / kept_share
    return gain, Losses(beyond, between, misfit, low, start, float(slow), slow_target)


def _mean_diagonal(R: np.ndarray) -> float:
    """Compute the mean of the diagonal of R (c, c), exactly R[0, 0] if all of it is equal."""
    return R[0, 0] * float(np.mean(np.diagonal(R) / R[0, 0]))


def _half_octaves(n: FloatArray, gust: Gust) -> np.ndarray:
    """Return rows (bands, nodes) of n: the half octaves for checks of the spectrum, without the slowest."""
    power = n * gust.spectrum(n)
    first = int(np.searchsorted(np.cumsum(power), SHARE_BELOW_BANDS * power.sum()))  # nodes are geometric
    per = PER_OCTAVE // 2
    bands = max(1, (len(n) - first) // per)
    return np.arange(len(n))[-bands * per :].reshape(bands, -1)


@kernel
def step_gusts(
    noise: FloatArray,
    noise_root: FloatArray,
    lags: IntArray,
    psi: FloatArray,
    first: int,
    speeds: FloatArray,
    terms: FloatArray,
) -> None:
    """Advance the gusts from step `first` by one step per row of noise (s, c).

    noise_root, lags, psi : as in `GustModel`
    speeds : (r, c) [m/s], out, ring of past speeds, row s % r has those of step s; terms : (2, c),
    overwritten
    """
    ring, c = speeds.shape
    for s in range(noise.shape[0]):
        for j in range(c):
            terms[0, j] = terms[1, j] = 0.0
        for k in range(c):
            for j in range(c):
                terms[0, j] += noise[s, k] * noise_root[k, j]
        for i in range(lags.shape[0]):
            row = (first + s - lags[i]) % ring
            for k in range(c):
                for j in range(c):
                    terms[1, j] += speeds[row, k] * psi[i * c + k, j]
        for j in range(c):
            speeds[(first + s) % ring, j] = terms[0, j] + terms[1, j]


class GustRecursion:
    """AR recursion with its state: the ring of past speeds and the step count.

    Steps count from time 0; those of the burn-in are negative. The noise of step s is a function of
    (seed, s) alone (counter-based Philox), independent of the length of the burn-in and of earlier draws.
    """

    def __init__(self, model: GustModel, seed: int):
        self.model = model
        self.past = np.zeros((int(model.lags[-1]), len(model.noise_root)))  # row s % len: speeds of step s
        self._bits = np.random.Philox(key=seed)
        self._start = self._bits.state  # before the first draw
        self._block: int | None = None
        self._noise: Any = None
        self._terms = np.empty((2, self.past.shape[1]))
        self.step = -model.burn_in
        while self.step < 0:
            self.apply_noise(self.noise(self.step)[: -self.step])

    def noise(self, step: int) -> np.ndarray:
        """Return standard normal numbers (s, c) of a step and the later steps of its block."""
        block, row = divmod(step, NOISE_BLOCK)
        if block != self._block:
            self._start["state"]["counter"][:] = 0
            self._start["state"]["counter"][3] = np.int64(block).astype(np.uint64)
            self._bits.state, c = self._start, self.past.shape[1]
            self._block = block
            self._noise = standard_normal(self._bits, NOISE_BLOCK * c).reshape(NOISE_BLOCK, c)
        return self._noise[row:]

    def apply_noise(self, noise: np.ndarray) -> None:
        """Advance by one step per row of noise."""
        model = self.model
        step_gusts(noise, model.noise_root, model.lags, model.psi, self.step, self.past, self._terms)
        self.step += len(noise)

    def advance(self) -> np.ndarray:
        """Return the gust speeds (c,) [m/s] of the next step."""
        self.apply_noise(self.noise(self.step)[:1])
        return self.past[(self.step - 1) % len(self.past)].copy()
