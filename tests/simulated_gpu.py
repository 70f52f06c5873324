"""A GPU in numba's simulator, which runs kernels in Python: `use` makes it the GPU of this process.

python simulated_gpu.py [... -m] MODULE ARGUMENT ... runs a module with it, such as netfall. So it can launch
the workers of a study.
"""

import ctypes
import ctypes.util
import os
import runpy
import sys
from importlib import import_module
from threading import Barrier, current_thread
from types import SimpleNamespace

import numpy as np

THREADS = 3  # in a block; the simulator starts each as a Python thread, and runs blocks one after another


class Memory(np.ndarray):
    """Memory (bytes,) of the device, which is memory of the host here."""

    @property
    def __cuda_array_interface__(self) -> dict:
        return {"data": (self.ctypes.data, False)}

    def copy_to_device(self, source: np.ndarray) -> None:
        """Copy from the host, or from other memory of the device."""
        self[:] = source

    def copy_to_host(self, target: np.ndarray) -> None:
        """Copy to the host."""
        target[:] = self


def simulated_module() -> SimpleNamespace:
    """Return the functions of `numba.cuda` that netfall uses."""
    cuda = import_module("numba.cuda")
    read_size = lambda: cuda.current_context().get_memory_info()
    context = SimpleNamespace(deallocations=SimpleNamespace(clear=lambda: None), get_memory_info=read_size)
    return SimpleNamespace(
        jit=lambda function=None, device=False: (lambda inner: inner) if device else cuda.jit(function),
        to_device=cuda.to_device,
        device_array=lambda size, dtype: np.zeros(size, dtype).view(Memory),
        current_context=lambda: context,
    )


def simulated_operations(cuda, compiled, in_blocks):
    """Return what replaces `scalars.device_operations`."""
    from netfall.core import vectors

    library = ctypes.PyDLL(ctypes.util.find_library("m"))  # no other thread runs during a call
    library.fma.restype, library.fma.argtypes = ctypes.c_double, [ctypes.c_double] * 3
    atomic = import_module("numba.cuda.simulator.kernelapi").FakeCUDAAtomic()
    return {
        vectors.fma: lambda a, b, c: np.float64(library.fma(a, b, c)),
        vectors.sqrt: np.sqrt,
        vectors.bits_of: lambda a: np.float64(a).view(np.int64),
        vectors.number_of: lambda a: np.int64(a).view(np.float64),
    }, {
        "cuda": SimpleNamespace(local=SimpleNamespace(array=np.zeros), atomic=atomic),
        "net_number": lambda: current_thread().blockIdx.x,
        "thread": lambda: current_thread().threadIdx.x,
        "threads": lambda: THREADS,
        "meet": Barrier(THREADS).wait,
        "product": lambda a, b: a * b,
    }


def use() -> None:
    """Use the simulator; before numba is imported."""
    os.environ["NUMBA_ENABLE_CUDASIM"] = "1"
    from netfall.core.records import Record
    from netfall.gpu import memory, plan, scalars, stepper, target

    module, records, write_tables = simulated_module(), {}, memory.GpuNet.write_tables

    def record_in(net: memory.GpuNet, record: Record) -> Record:
        """Return a record whose arrays are in the memory of the device."""
        fields = {name: getattr(record, name) for name in record.kind.fields}
        for name, value in fields.items():
            if isinstance(value, Record):
                fields[name] = record_in(net, value)
            elif isinstance(value, np.ndarray) and value.size:
                fields[name] = net.view(value, net.memory)
        return type(record)(**fields)

    def write_and_keep(net: memory.GpuNet, address: int) -> None:
        """Write the tables, which Python cannot read, and keep the record for `net_at`."""
        write_tables(net, address)
        records[address] = record_in(net, net.net)

    for place in (memory, plan, stepper, target):
        place.cuda_module = lambda: module
    memory.GpuNet.write_tables = write_and_keep
    scalars.device_operations = simulated_operations
    scalars.record_reader = lambda kind: lambda address: records[int(address)]
    stepper.THREADS = THREADS
    stepper._blocks = lambda kernel, arguments, particles: 1


if __name__ == "__main__":
    use()
    del sys.argv[: sys.argv.index("-m") + 1 if "-m" in sys.argv else 1]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
