"""Wind over a flat roof by PyConTurb, for tests/test_validation_generators.py.

    python wind_reference.py          by a Python that has pyconturb; renews tests/wind_reference.npz

PyConTurb (Rinker 2018; Veers 1988: sums of cosines with random phases, correlated by Cholesky factors of
the coherence at each frequency) generates the speed at every node. The file contains the statistics of each
realisation, by `statistics`, of pyconturb 2.7.4. Cases:

    davenport   Davenport's spectrum and coherence, as in netfall
    kaimal      PyConTurb's own Kaimal spectrum (IEC 61400-1), Davenport's coherence
    iec         the same spectrum and the coherence of IEC 61400-1, which netfall does not have

PyConTurb's coherence uses distances across the wind only. Its positions are therefore x and y times the decay
along and across the wind.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.signal import csd

STORED = Path(__file__).with_name("wind_reference.npz")
SPEED, INTENSITY, DECAY = 40.0, 0.18, (8.0, 16.0)  # m/s at 10 m; along and across the wind
SIDE, CELLS = 60.0, 10  # m, and cells along a side
DURATION, DT, REALISATIONS = 600.0, 0.2, 40  # s, s
OCTAVES = 0.02 * 2.0 ** np.arange(6)  # Hz, lower ends
SEPARATIONS = (1, 3, 7)  # cells between the nodes of a pair
MEAN_OF = 15  # steps of the mean over 3 s
NEARLY_ONE = 1 - 1e-9  # coherence at no frequency: a Cholesky factor needs less than 1


def roof() -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n, 2) [m], x along the wind and y across it, and their areas (n,) [m2]."""
    line = np.linspace(-0.5 * SIDE, 0.5 * SIDE, CELLS + 1)
    share = np.full(CELLS + 1, SIDE / CELLS)
    share[[0, -1]] *= 0.5
    X, Y = np.meshgrid(line, line, indexing="ij")
    return np.column_stack([X.ravel(), Y.ravel()]), np.outer(share, share).ravel()


def davenport(n: np.ndarray) -> np.ndarray:
    """Return Davenport's spectrum (f,) [m2/s2/Hz] with the variance (I U)^2."""
    x = 1200.0 * n / SPEED
    return (INTENSITY * SPEED) ** 2 * 1200.0 / SPEED * 2 / 3 * x / (1 + x * x) ** (4 / 3)


def kaimal(n: np.ndarray) -> np.ndarray:
    """Return Kaimal's spectrum (f,) [m2/s2/Hz] of IEC 61400-1 at 10 m, with the variance (I U)^2."""
    return (INTENSITY * SPEED) ** 2 * 4 * 56.7 / SPEED / (1 + 6 * 56.7 * n / SPEED) ** (5 / 3)


SPECTRA = {"davenport": davenport, "kaimal": kaimal, "iec": kaimal}


def sampled_deviation(spectrum) -> float:
    """Return the standard deviation [m/s] between the lowest and highest frequency of a realisation."""
    n = np.geomspace(0.5 / DURATION, 0.5 / DT, 20_000)
    return float(np.sqrt(np.trapezoid(spectrum(n), n)))


def of_band(n: np.ndarray, low: float) -> np.ndarray:
    """Return the frequencies (f,) of an octave as a mask."""
    return (n >= low) & (n < 2 * low)


def statistics(speed: np.ndarray) -> dict[str, np.ndarray]:
    """Compute statistics of a realisation, total speeds (t, n) [m/s].

    deviation [m/s] at a node; gust_factor: largest mean over 3 s at a node over the mean speed; spectrum (6,)
    [m2/s2/Hz] at a node by octaves; along, across (3, 6): real part of the coherence of pairs by separation
    and octave; load_deviation, load_peak: standard deviation and largest value of the whole load, over that
    of the mean speed; load_spectrum (6,) [1/Hz]
    """
    area = roof()[1]
    grid = (speed - SPEED).reshape(len(speed), CELLS + 1, CELLS + 1)
    cumulated = np.cumsum(speed, axis=0)
    gusts = (cumulated[MEAN_OF:] - cumulated[:-MEAN_OF]) / MEAN_OF
    load = speed**2 @ area / (SPEED**2 * area.sum())

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        n, S = csd(a, b, 1 / DT, nperseg=1024, axis=0)
        S = S.real.reshape(len(n), -1).mean(1)
        return np.array([S[of_band(n, low)].mean() for low in OCTAVES])

    some = grid[:, ::2, ::2]
    power = cross(some, some)
    pairs = {
        "along": [cross(grid[:, :-k:2, ::5], grid[:, k::2, ::5]) for k in SEPARATIONS],
        "across": [cross(grid[:, ::5, :-k:2], grid[:, ::5, k::2]) for k in SEPARATIONS],
    }
    return {
        "deviation": np.sqrt(speed.var(0).mean()),
        "gust_factor": gusts.max(0).mean() / SPEED,
        "spectrum": power,
        **{name: np.array(values) / power for name, values in pairs.items()},
        "load_deviation": load.std(),
        "load_peak": load.max(),
        "load_spectrum": cross(load[:, None], load[:, None]),
    }


def stack(each: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Stack statistics with the realisations along the first axis."""
    return {name: np.array([one[name] for one in each]) for name in each[0]}


def realisations(case: str, folder: Path) -> Iterator[np.ndarray]:
    """Yield total speeds (t, n) [m/s] by PyConTurb."""
    import pandas as pd
    from pyconturb import gen_turb
    from pyconturb.coherence import generate_coherence_file
    from pyconturb.spectral_models import kaimal_spectrum

    x, _ = roof()
    count, steps = len(x), round(DURATION / DT)
    y, z = x.T if case == "iec" else (x * DECAY).T
    names = [f"u_p{k}" for k in range(count)]
    where = pd.DataFrame([np.zeros(count), np.zeros(count), y, z], ["k", "x", "y", "z"], names)

    def spectrum(n, spat_df, **more):
        if case == "davenport":
            return np.tile(davenport(np.asarray(n))[:, None], count)
        at_10_m = spat_df.copy()
        at_10_m.loc["z"] = 10.0
        return kaimal_spectrum(n, at_10_m, **more)

    def coherence(component, n, distance, **_):
        return NEARLY_ONE * np.exp(-n * distance / SPEED)

    common = dict(
        coh_model="iec" if case == "iec" else coherence, u_ref=SPEED, l_c=8.1 * 0.7 * 10.0, nf_chunk=250
    )
    factors = folder / "coherence.h5"
    generate_coherence_file(where, factors, freq=np.arange(steps // 2 + 1) / DURATION, **common)
    for seed in range(1, REALISATIONS + 1):
        yield gen_turb(
            where,
            T=DURATION,
            nt=steps,
            coh_file=factors,
            wsp_func=lambda *_, **more: np.full(count, SPEED),
            sig_func=lambda *_, **more: np.full(count, sampled_deviation(SPECTRA[case])),
            spec_func=spectrum,
            seed=seed,
            **common,
        ).to_numpy()


if __name__ == "__main__":
    stored = {}
    for case in SPECTRA:
        with tempfile.TemporaryDirectory() as folder:
            values = stack([statistics(speed) for speed in realisations(case, Path(folder))])
        stored |= {f"{case}/{name}": value for name, value in values.items()}
        print(case, {name: value.mean(0).round(4) for name, value in values.items()}, flush=True)
    np.savez_compressed(STORED, **stored)
