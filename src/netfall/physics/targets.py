"""What the physics is compiled for, and the functions made for processors."""

from typing import NamedTuple

from netfall.core import vectors
from netfall.core.kernels import part_of_kernel
from netfall.numerics.arithmetic import inverse_root, logarithm
from netfall.physics import elements, particles


class Target(NamedTuple):
    """Decorator that compiles a function to be inlined, and the operations that it may call."""

    inline: object
    fma: object
    madd: object
    inverse_root: object
    logarithm: object
    maximum: object
    minimum: object
    where: object


@part_of_kernel
def _madd(a, b, c):
    return a * b + c


CPU = Target(
    part_of_kernel,
    vectors.fma,
    _madd,
    inverse_root,
    logarithm,
    vectors.maximum,
    vectors.minimum,
    vectors.where,
)
element = elements.make(CPU)
particle = particles.make(CPU)
