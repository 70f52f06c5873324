"""How kernels are compiled: plain numba, with one set of options.

No fast-math: sums keep their order, so the bits do not depend on the number of ranks. numpy's error model: a
division by zero gives inf and not an exception.
"""

from numba import njit

OPTIONS = {"error_model": "numpy"}
# For kernels alone: without the ways in from Python and C, which take a third of the time to compile.
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

kernel = njit(**OPTIONS, cache=True, no_cfunc_wrapper=True)  # called from Python, and by kernels
inner_kernel = njit(**OPTIONS, **INNER)  # called by kernels
part_of_kernel = njit(**OPTIONS, **INNER, forceinline=True)  # a part of the loop that calls it
