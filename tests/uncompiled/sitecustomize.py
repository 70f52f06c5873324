"""The program's kernels as plain Python, for tests that would wait for the compiler longer than they run.

A folder to put on PYTHONPATH: Python imports a module of this name at its start, in every process. What the
kernels use that only compiled code has (fused operations, ordered access to shared memory, MPI's symbols) is
put in their place here. The bits are those of compiled code but for the order of what a compiler contracts.
"""

import ctypes
import importlib.machinery
import json
import os
import sys
import time
import warnings

KERNELS = (
    "kernel",
    "allocating_kernel",
    "kernel_apart",
    "kernel_both_ways",
    "inner_kernel",
    "part_of_kernel",
    "vector_kernel",
)


def fused_of(np):
    """a b + c rounded once, by the C library."""
    libm = ctypes.CDLL("libm.so.6")
    double, single = libm.fma, libm.fmaf
    double.restype, double.argtypes = ctypes.c_double, [ctypes.c_double] * 3
    single.restype, single.argtypes = ctypes.c_float, [ctypes.c_float] * 3

    def fused(a, b, c):
        if type(a) is type(b) is type(c) is np.float32:
            return np.float32(single(a, b, c))
        return np.float64(double(a, b, c))

    return fused


def plain_compile(module):
    """Decorators that leave functions as they are."""

    def plain(function):
        function.py_func = function
        return function

    for name in KERNELS:
        setattr(module, name, plain)
    module.wake = lambda: None


def plain_tuples(module):
    """Named tuples as Python has them."""
    module.laid = lambda value, kind=None: value


def plain_arithmetic(module):
    """The intrinsic functions of arithmetic.py."""
    import numpy as np

    module.fused = fused_of(np)
    module.bits_of = lambda a: np.float64(a).view(np.int64)
    module.number_of = lambda a: np.int64(a).view(np.float64)


def plain_symbols(module):
    """Ordered access of parallel/mpi_symbols.py; messages between nodes there are none."""
    cell = lambda address: ctypes.c_int64.from_address(int(address))

    def announce(address, number):
        cell(address).value = int(number)

    module.announce, module.announced = announce, lambda address: cell(address).value
    module.probe, module.yield_processor = (lambda *_: 0), (lambda: time.sleep(1e-5))
    module.wall_time = time.perf_counter


def rows_at_once(module):
    """Dense algebra of linear.py by numpy, a row at a time: the same operations in the same order."""
    import numpy as np

    def product(a, b, out):
        if 0 < a.size * b.shape[1] < 1e5:
            out[:] = np.cumsum(a[:, :, None] * b, axis=1)[:, -1] + 0.0  # a sum that begins with 0
            return
        out[:] = 0.0
        for k in range(b.shape[0]):
            out += a[:, k, None] * b[k]

    def factorised(matrix):
        singular = 0
        for k in range(matrix.shape[0]):
            root = matrix[k, k] ** 0.5 if matrix[k, k] > 0.0 else 0.0
            singular += root == 0.0
            matrix[k, k:] = matrix[k, k:] / root if root > 0.0 else np.arange(matrix.shape[0] - k) == 0
            matrix[k + 1 :, k + 1 :] -= np.triu(np.outer(matrix[k, k + 1 :], matrix[k, k + 1 :]))
        return singular

    def solve_columns(upper, b):
        n = len(b)
        for i in range(n):
            b[i] /= upper[i, i]
            b[i + 1 :] -= upper[i, i + 1 :, None] * b[i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                b[i] -= upper[i, k] * b[k]
            b[i] /= upper[i, i]

    module.product, module.factorised, module.solve_columns = product, factorised, solve_columns


PLAIN = {
    "netfall.ground.compile": plain_compile,
    "netfall.ground.handed": plain_tuples,
    "netfall.numerics.arithmetic": plain_arithmetic,
    "netfall.numerics.linear": rows_at_once,
    "netfall.parallel.mpi_symbols": plain_symbols,
}


class Finder:
    """Finds those modules as ever, and changes them once they are there."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name not in PLAIN:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        execute = spec.loader.exec_module

        def exec_module(module):
            execute(module)
            PLAIN[name](module)

        spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, Finder)
json.JSONEncoder.default = lambda self, number: number.item()  # what compiled code gives is Python's own
warnings.filterwarnings("ignore", category=RuntimeWarning)  # wrapping and dividing is what kernels do
os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"
