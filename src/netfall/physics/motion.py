"""Mass of particles in the form that the step needs."""

from netfall.core.kernels import inner_kernel


@inner_kernel
def inverse_mass(mass: float) -> float:
    """Return 1 / mass [1/kg]; 0 for a particle without mass, which keeps its velocity."""
    return 1.0 / mass if mass > 0.0 else 0.0
