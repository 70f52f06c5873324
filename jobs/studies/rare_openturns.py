"""A rare failure by OpenTURNS: the probability that a cable of the stadium breaks in six seconds of wind.

    .venv/bin/python -m pip install '.[study]'
    .venv/bin/python jobs/studies/rare_openturns.py --speed 50.8

OpenTURNS draws the seeds of the gusts in blocks and estimates the probability with its interval. netfall runs
each block as a study, on all cores. Other random inputs (prestress, strength, damping) are further components
of the input vector and further keys of `[sampling]` or `[vary]`. OpenTURNS then also offers importance
sampling and subset simulation, which need continuous inputs.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
import openturns as ot

JOB = Path(__file__).resolve().parents[1] / "stadium.toml"
LARGEST_SEED = 2**53  # whole numbers up to it are exact in a double
STUDY = """
job = "{job}"
[vary]
"wind.speed" = [{speed}]
"wind.seed" = {seeds}
"""


def utilisation(seeds: list[int], speed: float, folder: Path) -> np.ndarray:
    """Return the largest utilisation before a break (b,) in the wind of each seed (b,); above 1 it breaks.

    Infinite if the run has no equilibrium under the mean wind, or did not finish.
    """
    study = folder / "block.toml"
    study.write_text(STUDY.format(job=JOB, speed=speed, seeds=seeds))
    result = folder / "block.study.h5"
    result.unlink(missing_ok=True)
    command = [Path(sys.executable).with_name("netfall"), "study", study, "-o", result, "--quiet"]
    subprocess.run(command, check=True, cwd=folder)
    with h5py.File(result) as f:
        used, ended = f["samples/utilisation_before_break"][:], f["samples/state"][:] == b"finished"
        found = dict(zip(f["samples/wind.seed"][:].tolist(), np.where(ended, used, np.inf)))
    return np.array([found[seed] for seed in seeds])


def main() -> None:
    """Estimate the probability and print it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--speed", type=float, default=50.8, help="mean wind speed at 10 m [m/s]")
    parser.add_argument("--runs", type=int, default=3000, help="largest number of runs")
    parser.add_argument("--variation", type=float, default=0.2, help="coefficient of variation to stop at")
    parser.add_argument("--block", type=int, default=100, help="runs of a block")
    parser.add_argument("--seed", type=int, default=1, help="of OpenTURNS")
    asked = parser.parse_args()

    ot.RandomGenerator.SetSeed(asked.seed)
    with tempfile.TemporaryDirectory() as name:

        def of_sample(sample):
            seeds = [int(row[0]) for row in sample]
            return [[value] for value in utilisation(seeds, asked.speed, Path(name))]

        response = ot.PythonFunction(1, 1, func_sample=of_sample)
        seed = ot.RandomVector(ot.Uniform(1.0, float(LARGEST_SEED)))
        breaks = ot.ThresholdEvent(ot.CompositeRandomVector(response, seed), ot.GreaterOrEqual(), 1.0)
        algorithm = ot.ProbabilitySimulationAlgorithm(breaks, ot.MonteCarloExperiment())
        algorithm.setBlockSize(asked.block)
        algorithm.setMaximumOuterSampling(-(-asked.runs // asked.block))
        algorithm.setMaximumCoefficientOfVariation(asked.variation)
        algorithm.run()
    found = algorithm.getResult()
    p, runs = found.getProbabilityEstimate(), found.getOuterSampling() * found.getBlockSize()
    half = 1.96 * np.sqrt(p * (1.0 - p) / runs)
    print(f"probability {p:.3g} ({max(p - half, 0.0):.2g} to {p + half:.2g}, 95 %), {runs} runs")


if __name__ == "__main__":
    main()
