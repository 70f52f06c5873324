"""The program's kernels as plain Python: without the compiler, by Python's own arithmetic.

A folder to put on PYTHONPATH: Python imports a module of this name at its start, in every process. What the
kernels use that only compiled code has (vectors, records and routines by their address, ordered access to
shared memory, MPI's functions) is put in their place here. A vector has one number. The bits are those of
compiled code; only what adds products without fma may differ, if the compiler contracts it.
"""

import ctypes
import importlib.machinery
import json
import operator
import sys

ROUTINES = {}  # by the address that stands for each
TYPES = {"int32": ctypes.c_int32, "int64": ctypes.c_int64, "float64": ctypes.c_double}


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


def plain_kernels(module):
    """Decorators that leave functions as they are; routines stand under numbers, for calls by address."""

    def plain(function):
        function.py_func = function
        return function

    def address(routine):
        return next((k for k, one in ROUTINES.items() if one is routine.function), None) or enter(routine)

    def enter(routine):
        number = len(ROUTINES) + 1
        ROUTINES[number] = routine.function
        return number

    def calling(result):
        kind = TYPES[str(result)]

        def call(address, arguments):
            if address in ROUTINES:
                return ROUTINES[address](*arguments)
            words = [ctypes.c_int64] * len(arguments)
            return ctypes.CFUNCTYPE(kind, *words)(int(address))(*map(int, arguments))

        return call

    for name in ("kernel", "inner_kernel", "part_of_kernel", "copied_kernel"):
        setattr(module, name, plain)
    module.Routine.address, module.address_caller = property(address), calling
    module.call = calling("int64")


def plain_records(module):
    """Records as Python has them; an array without elements is absent."""
    module.is_present = lambda array: array.size > 0


def plain_vectors(module):
    """Vectors of one number; an access beyond the end of an array is an error."""
    import numpy as np

    np.seterr(all="ignore")  # to divide by zero, and to go round, is what kernels do

    def at(array, row, p):
        return p if array.ndim == 1 else (row, p)

    def store(array, row, p, value):
        array[at(array, row, p)] = value

    def put(p, high, array, row, value):
        array[at(array, row, p)] = value

    module.LANES, module.fma = 1, fused_of(np)
    module.where = lambda truth, a, b: a if truth else b
    module.maximum, module.minimum = (lambda a, b: a if a > b else b), (lambda a, b: a if a < b else b)
    module.sqrt, module.as_number = np.sqrt, np.float64
    module.bits_of = lambda a: np.float64(a).view(np.int64)
    module.number_of = lambda a: np.int64(a).view(np.float64)
    module.any_of, module.zeros, module.nowhere = bool, (lambda: np.float64(0.0)), (lambda: False)
    module.load = lambda array, row, p: array[at(array, row, p)]
    module.load_mask = lambda array, row, p: bool(array[at(array, row, p)])
    module.index_in = lambda array, row, p: (row, p)
    module.load_at = module.particle_at = lambda array, index: array[index]
    module.load_mask_at = lambda array, index: bool(array[index])
    module.load_or_repeat = lambda array, row, p, common: array[row, p] if array.size else common[0]
    module.store, module.store_below, module.store_at = store, put, operator.setitem
    module.gather = lambda array, row, other, index: array[row, other[index]]


def plain_access(module):
    """Ordered access to shared memory of parallel/mpi_calls.py."""
    cell = lambda address: ctypes.c_int64.from_address(int(address))

    def announce(address, number):
        cell(address).value = int(number)

    module.announce, module.announced = announce, lambda address: cell(address).value


def rows_at_once(module):
    """Dense algebra of linear.py by numpy, a row at a time: the same operations in the same order."""
    import numpy as np

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

    module.factorise_cholesky, module.solve_cholesky_columns = factorised, solve_columns


def nothing_to_compile(module):
    """Nothing is compiled before a run on several ranks."""
    module.compile_missing = lambda comm: None


PLAIN = {
    "netfall.core.kernels": plain_kernels,
    "netfall.core.records": plain_records,
    "netfall.core.vectors": plain_vectors,
    "netfall.core.linear": rows_at_once,
    "netfall.parallel.mpi_calls": plain_access,
    "netfall.driver.compile": nothing_to_compile,
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
