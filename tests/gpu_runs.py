"""Runs job.toml of some folders on the CPU and in numba's simulator of a GPU: python gpu_runs.py FOLDER ...

Prints a line for each folder: its name, the exit code, and the first datasets that differ.
"""

import os
import sys
from pathlib import Path

os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # before numba is imported

import numpy as np
from results import differences

from netfall.core.errors import DivergedError, InputError
from netfall.core.progress import Progress
from netfall.driver.run import run_job
from netfall.job.read import read_job
from netfall.parallel.mpi import MPI


def exit_code(folder: Path, device: str) -> int:
    """Exit code of a run on a device, whose result file has the device's name."""
    try:
        run_job(
            MPI.COMM_SELF,
            read_job(folder / "job.toml"),
            folder / f"{device}.vtkhdf",
            Progress(False),
            device=device,
        )
    except (InputError, DivergedError) as error:
        return error.exit_code
    return 0


np.seterr(all="ignore")  # kernels compute infinities without a warning
for name in sys.argv[1:]:
    folder = Path(name)
    codes = exit_code(folder, "cpu"), exit_code(folder, "gpu")
    lines = differences(folder / "cpu.vtkhdf", folder / "gpu.vtkhdf") if codes == (0, 0) else []
    print(folder.name, *codes, "; ".join(lines[:5]), flush=True)
