"""Compilation of kernels in advance: `netfall compile`, and the first run on several ranks.

Small jobs run through the stages of ordinary runs, and numba caches the compiled kernels. Kernels of rarer
features are compiled at their first use: sliding cables, bending chains, elastic and moving supports,
self-stress, damping of axial strains.
"""

import contextlib
import fcntl
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

from netfall.core.cache import CACHE_VARIABLE
from netfall.core.progress import Progress
from netfall.core.timings import NEVER_STOP, StopFlag
from netfall.driver.run import run_job
from netfall.explicit.loop import general_forces, receive_forces, send_forces
from netfall.job.read import read_job
from netfall.parallel.agree import sleeping_barrier
from netfall.parallel.halo import buffers_without_neighbours, exchange_rows
from netfall.parallel.mpi import MPI

COMPILE_PATIENCE = 300.0  # s during which a process waits for another process to compile
SADDLE = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 24.0\nrise = 3.0\ncells = 4\n'
RING = '[net]\ngenerator = "ring"\n[net.ring]\nlength = 40.0\nwidth = 40.0\nrise = 3.0\nspacing = 1.0\n'
ROOF = """
[cable]
modulus = 1.6e11
area = 400e-6
density = 7850.0
prestress = 60e3
yield_stress = 1e9
fracture_strain = 0.03
[form_finding]
[load]
dead = 300.0
steps = 2
"""
CASE = '[[case]]\nname = "snow"\nset = {"load.snow" = 500.0}\n[modes]\ncount = 1\n'
MOTION = """
[wind]
speed = 20.0
turbulence_intensity = 0.2
pressure_coefficient = -1.0
base_height = 10.0
[[remove]]
elements = [20]
time = 0.01
[dynamics]
duration = 0.02
[output]
frames = 2
history_interval = 0.01
"""
GROUPS = {  # group of kernels: a job that compiles them
    "forms, loads, equilibria, modes": SADDLE + ROOF + CASE,
    "areas and equilibria of larger nets": RING + ROOF,
    "force densities": SADDLE + ROOF.replace("[load]", 'method = "force_density"\n[load]'),
    "wind, motion, yield, fracture": SADDLE + ROOF + MOTION,
}
ROUTINES = send_forces, receive_forces, general_forces  # for several ranks, and for bars, which are in no job


def compile_all(say: Callable[[str], None] = lambda line: None, stop: StopFlag = NEVER_STOP) -> None:
    """Compile or load the kernels of ordinary runs, and report the time of each group. Raises Interrupted."""
    with tempfile.TemporaryDirectory(prefix="netfall-", ignore_cleanup_errors=True) as folder:
        for name, text in GROUPS.items():
            begin, job = time.perf_counter(), Path(folder, "job.toml")
            job.write_text(text)
            run_job(MPI.COMM_SELF, read_job(job), Path(folder, "job.vtkhdf"), Progress(False), stop=stop)
            say(f"{name}: {time.perf_counter() - begin:.1f} s")
    exchange_rows(np.zeros((0, 3)), np.zeros((0, 3)), buffers_without_neighbours())
    for one in ROUTINES:
        one.address_if(True)
    compiled_marker().touch()


def compile_missing(comm: MPI.Comm, stop: StopFlag = NEVER_STOP) -> None:
    """Let one rank of each node compile missing kernels, until `stop`; the others wait. Collective."""
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    if node.rank == 0 and CACHE_VARIABLE in os.environ and not compiled_marker().exists():
        # if it fails, each rank compiles what it needs
        with contextlib.suppress(Exception), one_process_at_a_time():
            if not compiled_marker().exists():
                compile_all(stop=stop)
    sleeping_barrier(comm)
    node.Free()


def compiled_marker() -> Path:
    """Return the path of the file that marks complete compilation by this numba for this processor."""
    host = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    name = hashlib.sha256(repr((numba.__version__, sys.version, *host)).encode()).hexdigest()[:16]
    return Path(os.environ[CACHE_VARIABLE], f"compiled-{name}")


@contextlib.contextmanager
def one_process_at_a_time() -> Iterator[None]:
    """Let one process at a time run the block; without file locks, all run it at once.

    A process waits no longer than COMPILE_PATIENCE.
    """
    end = time.monotonic() + COMPILE_PATIENCE
    with open(Path(os.environ[CACHE_VARIABLE], "compiling"), "a") as file:
        while time.monotonic() < end:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(0.05)
            except OSError:
                break
        yield
