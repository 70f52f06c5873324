"""The mass of particles as the step needs it."""

from netfall.core.kernels import inner_kernel


@inner_kernel
def inverse_mass(mass):
    """1 / mass [1/kg]; 0 for a particle left without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
