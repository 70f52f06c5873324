"""Compilation targets of the physics, and its functions compiled for CPUs."""

from collections.abc import Callable
from typing import Any, NamedTuple

from netfall.core import vectors
from netfall.core.arithmetic import logarithm
from netfall.core.kernels import Decorator, inner_kernel, part_of_kernel
from netfall.physics import element_step, particle_step


class Target(NamedTuple):
    """Decorator that compiles a function for inlining, and the operations that the function may call."""

    inline: Decorator
    fma: Callable[..., Any]
    sqrt: Callable[..., Any]
    logarithm: Callable[..., Any]
    maximum: Callable[..., Any]
    minimum: Callable[..., Any]


CPU = Target(part_of_kernel, vectors.fma, vectors.sqrt, logarithm, vectors.maximum, vectors.minimum)
element, particle = element_step.make(CPU), particle_step.make(CPU)


@inner_kernel
def inverse_mass(mass: float) -> float:
    """Return 1 / mass [1/kg]; 0 for a particle without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
