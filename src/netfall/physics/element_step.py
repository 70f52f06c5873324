"""Law of an element (paper 2.2 and 2.3, Fig. 3), arranged for one square root and one division.

N / L = EA (L / L0 - 1 - eps_p) / L = EA (1 / L0 - (1 + eps_p) / L)
"""

from typing import Any

from netfall.core.arithmetic import logarithm
from netfall.core.kernels import part_of_kernel
from netfall.core.vectors import fma, maximum, minimum, sqrt

LENGTH2_OFFSET = 1e-300  # [m2]; avoids 0 / 0 for an element of zero length


@part_of_kernel
def inverse_length(dx: Any, dy: Any, dz: Any) -> Any:
    """Return 1 / L [1/m] and L [m] of an element along (dx, dy, dz) [m]."""
    L = sqrt(fma(dz, dz, fma(dy, dy, fma(dx, dx, LENGTH2_OFFSET))))
    return 1.0 / L, L


@part_of_kernel
def elastic_density(per_L: Any, per_L0: Any, eps_p: Any, EA: Any) -> Any:
    """Return N / L [N/m] before any limit, in the engineering strain; eps_p : plastic strain."""
    return EA * fma(-1.0 - eps_p, per_L, per_L0)


@part_of_kernel
def logarithmic_density(per_L: Any, L: Any, per_L0: Any, eps_p: Any, EA: Any) -> Any:
    """Return N / L [N/m] before any limit, in the logarithmic strain."""
    return EA * (logarithmic_strain(L, per_L0) - eps_p) * per_L


@part_of_kernel
def engineering_strain(L: Any, per_L0: Any) -> Any:
    """Return (L - L0) / L0; per_L0 : 1 / L0 [1/m]"""
    return fma(L, per_L0, -1.0)


@part_of_kernel
def logarithmic_strain(L: Any, per_L0: Any) -> Any:
    """Return ln(L / L0); the result is finite for an empty slot too."""
    return logarithm(maximum(L * per_L0, LENGTH2_OFFSET))


@part_of_kernel
def grown(eps: Any, eps_p: Any, limit: Any) -> Any:
    """Return the plastic strain at eps after eps_p; tension yields at the elastic strain `limit`."""
    return maximum(eps_p, eps - limit)


@part_of_kernel
def shrunk(eps: Any, eps_p: Any, limit: Any) -> Any:
    """Return the plastic strain at eps after eps_p; compression yields at the elastic strain -`limit`."""
    return minimum(eps_p, eps + limit)


@part_of_kernel
def branch(state: Any, N: Any, decay: Any, gain: Any) -> Any:
    """Advance the state [N] of a Maxwell branch of axial damping by one step."""
    return fma(decay, state, gain * N)
