"""Compile flags of all kernels, in one place.

No fast-math: sums keep their order, so that the bits do not depend on the number of ranks. numpy's error model:
a division by zero gives inf and not an exception (and does not stop vectorisation).
"""

import numba

kernel = numba.njit(cache=True, error_model="numpy", fastmath=False)
