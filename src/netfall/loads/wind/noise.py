"""Standard normal numbers by the ziggurat method (Marsaglia and Tsang 2000), with the same bits everywhere.

The density is covered by layers of equal area, the lowest with the tail. A draw takes a random layer and a
random position in it; 99.3 % of the positions are below the density at any height. numpy's generator uses the
same method and random bits and gives the same numbers, but its exponential and logarithm come from the C
library.
"""

from functools import cache

import numpy as np

from netfall.core.arithmetic import exponential, logarithm
from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import exp, log
from netfall.core.kernels import kernel, part_of_kernel

LAYERS = 256
TAIL = 3.6541528853610088  # start of the tail
AREA = 0.0049286732339746548702  # area of a layer
PLACES = 2.0**52  # positions in a layer
TAIL_WORDS = 64  # random words reserved for a number in the tail; if fewer remain, more are drawn


@cache
def _layers() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each layer: width of a position, positions below the density, density at the edge."""
    width, height, inside = np.empty(LAYERS), np.empty(LAYERS), np.empty(LAYERS)
    edge, height[0] = TAIL, 1.0
    height[-1] = exp(-0.5 * TAIL * TAIL)
    base = AREA / height[-1]
    width[0], width[-1], inside[0], inside[1] = base / PLACES, TAIL / PLACES, TAIL / base * PLACES, 0.0
    for k in range(LAYERS - 2, 0, -1):
        before, edge = edge, float(np.sqrt(-2.0 * log(AREA / edge + height[k + 1])))
        inside[k + 1] = edge / before * PLACES
        width[k], height[k] = edge / PLACES, exp(-0.5 * edge * edge)
    return width, inside.astype(np.uint64), height


@part_of_kernel
def _share(bits: int) -> float:
    """Convert random bits to a number from 0 to 1, 1 excluded."""
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@kernel
def fill_normal(
    raw: IntArray, width: FloatArray, inside: IntArray, height: FloatArray, numbers: FloatArray
) -> int:
    """Fill numbers (n,) from random bits raw (r,) by the layers; return how many numbers were filled."""
    enough, used = raw.shape[0] - TAIL_WORDS, 0
    for i in range(numbers.shape[0]):
        while used < enough:
            bits = raw[used]
            used += 1
            k, rest = bits & np.uint64(0xFF), bits >> np.uint64(8)
            place = (rest >> np.uint64(1)) & np.uint64(0x000FFFFFFFFFFFFF)
            x = np.float64(place) * width[k]
            if place < inside[k]:
                break
            if k > 0:
                used += 1
                level = (height[k - 1] - height[k]) * _share(raw[used - 1]) + height[k]
                if level < exponential(-0.5 * x * x):
                    break
                continue
            beyond = height_of = 0.0
            while not 2.0 * height_of > beyond * beyond and used < raw.shape[0] - 1:  # Marsaglia 1964
                beyond = -logarithm(1.0 - _share(raw[used])) / TAIL
                height_of = -logarithm(1.0 - _share(raw[used + 1]))
                used += 2
            x = TAIL + beyond
            rest = place >> np.uint64(8)
            break
        else:
            return i
        numbers[i] = -x if rest & np.uint64(1) else x
    return numbers.shape[0]


def standard_normal(bits: np.random.BitGenerator, count: int) -> np.ndarray:
    """Draw independent standard normal numbers (count,)."""
    raw, numbers = bits.random_raw(count + count // 8 + 8 * TAIL_WORDS), np.empty(count)
    while fill_normal(raw, *_layers(), numbers) < count:
        raw = np.concatenate([raw, bits.random_raw(count)])
    return numbers
