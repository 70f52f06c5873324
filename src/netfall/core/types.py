"""Types of arrays and numbers, for annotations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating[Any]]  # mostly of float64
IntArray = NDArray[np.integer[Any]]  # of any size, signed or not
BoolArray = NDArray[np.bool_]
Triple = tuple[float, float, float]
AnyArray = NDArray[Any]  # where several kinds occur, or one may stand for another
Integer = Any  # in kernels: an integer of any size
Lanes = Any  # in kernels: a number or a vector of LANES numbers (`core.vectors`), as the caller passes it
