"""The law of an element (paper 2.2 and 2.3, Fig. 3), arranged for one root and one division.

N / L = EA (L / L0 - 1 - eps_p) / L = EA (1 / L0 - (1 + eps_p) / L)
"""

from types import SimpleNamespace

TINY = 1e-300  # [m2] keeps an element without length from dividing zero by zero


def make(target) -> SimpleNamespace:
    """The functions, compiled for a target."""
    inline, fma, sqrt, logarithm, maximum, minimum = target

    @inline
    def inverse_length(dx, dy, dz):
        """1 / L [1/m] and L [m] of an element along (dx, dy, dz) [m]."""
        L = sqrt(fma(dz, dz, fma(dy, dy, fma(dx, dx, TINY))))
        return 1.0 / L, L

    @inline
    def elastic_density(per_L, per_L0, eps_p, EA):
        """N / L [N/m] before any limit, in the engineering strain; eps_p : plastic strain."""
        return EA * fma(-1.0 - eps_p, per_L, per_L0)

    @inline
    def logarithmic_density(per_L, L, per_L0, eps_p, EA):
        """The same in the logarithmic strain."""
        return EA * (logarithmic_strain(L, per_L0) - eps_p) * per_L

    @inline
    def engineering_strain(L, per_L0):
        """(L - L0) / L0; per_L0 : 1 / L0 [1/m]"""
        return fma(L, per_L0, -1.0)

    @inline
    def logarithmic_strain(L, per_L0):
        """ln(L / L0), of an empty slot too."""
        return logarithm(maximum(L * per_L0, TINY))

    @inline
    def grown(eps, eps_p, limit):
        """Plastic strain at the strain eps of what had eps_p and yields in tension at `limit` more."""
        return maximum(eps_p, eps - limit)

    @inline
    def shrunk(eps, eps_p, limit):
        """The same of what yields in compression."""
        return minimum(eps_p, eps + limit)

    @inline
    def branch(state, N, decay, gain):
        """State [N] of a branch of axial damping one step on."""
        return fma(decay, state, gain * N)

    return SimpleNamespace(
        inverse_length=inverse_length,
        elastic_density=elastic_density,
        logarithmic_density=logarithmic_density,
        engineering_strain=engineering_strain,
        logarithmic_strain=logarithmic_strain,
        grown=grown,
        shrunk=shrunk,
        branch=branch,
    )
