"""Compile flags of all kernels, in one place.

No fast-math: sums keep their order, so that the bits do not depend on the number of ranks. numpy's error model:
a division by zero gives inf and not an exception (and does not stop vectorisation).
"""

import llvmlite.binding
import numba
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions

FLAGS = {"cache": True, "error_model": "numpy", "fastmath": False}

# Hardware gathers are a trap on processors whose microcode was mended against leaks through them: four times slower
# there than plain loads into the lanes of a vector, which are as fast elsewhere or nearly so.
numba.config.CPU_FEATURES = (numba.config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()) + ",+prefer-no-gather"

# The compiler vectorises a loop that reads x of neighbours and writes v only if it knows that the two are different
# arrays. numba has the flag (its own parallel loops use it) but gives it no name in the decorator: this does.
CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

kernel = numba.njit(**FLAGS)
vector_kernel = numba.njit(**FLAGS, noalias=True)  # no two array arguments may overlap
