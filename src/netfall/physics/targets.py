"""Compilation targets of the physics, and its functions compiled for CPUs."""

from typing import NamedTuple

from netfall.core import vectors
from netfall.core.kernels import part_of_kernel
from netfall.numerics.arithmetic import logarithm
from netfall.physics import elements, particles


class Target(NamedTuple):
    """Decorator that compiles a function for inlining, and the operations that the function may call."""

    inline: object
    fma: object
    sqrt: object
    logarithm: object
    maximum: object
    minimum: object


CPU = Target(part_of_kernel, vectors.fma, vectors.sqrt, logarithm, vectors.maximum, vectors.minimum)
element, particle = elements.make(CPU), particles.make(CPU)
