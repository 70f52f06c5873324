"""Run job.toml of folders on the CPU and on a simulated GPU: python simulated_gpu.py gpu_runs HOW FOLDER ...

HOW: alone, each net in all blocks as `netfall run` does; together, a net in each block, as studies do;
crowded, the same on a device that has memory for one net only; looped, alone, but each launch runs the loop
of the CPU on the memory of the device, which is fast enough for many steps.
Prints a line for each folder: its name, the exit codes, and the first datasets and outcomes that differ.
"""

import gc
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from weakref import WeakSet

import numpy as np
from results import differences

from netfall.__main__ import abort
from netfall.core.errors import DivergedError, InputError
from netfall.core.progress import Progress
from netfall.driver.run import run_job
from netfall.driver.sample import run_sample
from netfall.explicit.loop import Interval, time_loop
from netfall.gpu import kernels, scalars, stepper
from netfall.gpu.plan import plan_maker
from netfall.gpu.stepper import Gpu, GpuNet
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.parallel.mpi import MPI


def run_alone(folder: Path, device: str) -> int:
    """Return the exit code of a run on a device, whose result file has the device's name."""
    path = folder / f"{device}.vtkhdf"
    try:
        run_job(MPI.COMM_SELF, read_job(folder / "job.toml"), path, Progress(False), device=device)
    except (InputError, DivergedError) as error:
        return error.exit_code
    return 0


def run_as_sample(folder: Path, device: str, gpu: Gpu | None = None) -> dict:
    """Return the outcomes of a run on a device, whose result file has the device's name."""
    read = partial(read_job, folder / "job.toml")
    choose = lambda features: plan_maker(device, features, 1, lambda note: None, gpu)
    path = folder / f"{device}.vtkhdf"
    outcomes = run_sample(MPI.COMM_SELF, read, path, ResultCache(1), choose_plan=choose)
    return {name: value for name, value in outcomes.items() if not name.endswith("seconds")}


def run_all_together(folders: list[Path]) -> list[dict]:
    """Return outcomes of runs on a GPU that steps several nets at once."""
    gpu, results = Gpu(abort), {}
    for folder in folders:
        gpu.start(lambda f=folder: results.update({f: run_as_sample(f, "gpu", gpu)}))
    gpu.join()
    gc.collect()
    assert not any(isinstance(kept, GpuNet) for kept in gc.get_objects()), "nets of ended tasks"
    return [results[folder] for folder in folders]


def leave_memory_for_one_net() -> None:
    """Let a net have memory only if no other net has some."""
    allocate, nets = GpuNet.allocate, WeakSet()

    def allocate_alone(net: GpuNet, work: object) -> bool:
        nets.add(net)
        if any(other.memory.size for other in nets if other is not net):
            return False
        return allocate(net, work)

    GpuNet.allocate = allocate_alone


MOST_UPLOADS = 20  # in a run of a collapse: of the whole state, after removals and new detached parts


class LoopKernel:
    """`kernels.advance` by the loop of the CPU."""

    def __getitem__(self, size: tuple[int, int]) -> object:
        return self.advance

    def advance(self, orders, inputs, addresses) -> None:
        """Advance the only net."""
        order, memory = orders[0], scalars.record_reader(None)(addresses[0])
        work = memory.work
        memory.inputs[:] = inputs.copy_to_host()
        if order[kernels.TRIAL] and work.breaks:
            memory.saved[:] = memory.rest
        first, steps, stride, trial, row = order[: kernels.ROW + 1].copy_to_host().tolist()
        lengths = order[kernels.LENGTHS :].copy_to_host().view(float).tolist()
        interval = Interval(first, steps, *lengths, stride, trial > 0, 0, row > 0)
        order[kernels.DONE], order[kernels.PENDING], _ = time_loop(interval, work)
        order[kernels.MADE], order[kernels.TABLE_ROWS] = work.rows.made
        order[kernels.EVENT_COUNT] = work.spare.events[0]


def loop_in_launches() -> None:
    """Use `LoopKernel`, and refuse more uploads than MOST_UPLOADS of a net."""
    stepper.advance_kernel = lambda in_blocks: LoopKernel()
    upload, counts = GpuNet.upload, Counter()

    def upload_counted(net: GpuNet) -> None:
        counts[net] += 1
        assert counts[net] <= MOST_UPLOADS
        upload(net)

    GpuNet.upload = upload_counted


def same(a: object, b: object) -> bool:
    """Return whether two outcomes have the same bits."""
    return a == b or (a != a and b != b)


np.seterr(all="ignore")  # kernels compute infinities without a warning
how, folders = sys.argv[1], [Path(name) for name in sys.argv[2:]]
if how == "looped":
    loop_in_launches()
if how in ("alone", "looped"):
    on_cpu = [{"exit_code": run_alone(folder, "cpu")} for folder in folders]
    on_gpu = [{"exit_code": run_alone(folder, "gpu")} for folder in folders]
else:
    if how == "crowded":
        leave_memory_for_one_net()
    on_cpu = [run_as_sample(folder, "cpu") for folder in folders]
    on_gpu = run_all_together(folders)
for folder, cpu, gpu in zip(folders, on_cpu, on_gpu):
    lines = [name for name in cpu.keys() | gpu.keys() if not same(cpu.get(name), gpu.get(name))]
    if cpu["exit_code"] == 0 == gpu["exit_code"]:
        lines += differences(folder / "cpu.vtkhdf", folder / "gpu.vtkhdf")
    print(folder.name, cpu["exit_code"], gpu["exit_code"], "; ".join(lines[:5]), flush=True)
