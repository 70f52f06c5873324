"""The law of an element (paper 2.2 and 2.3, Fig. 3), arranged for one inverse root.

    N / L = EA (L / L0 - 1 - eps_p) / L = EA (1 / L0 - (1 + eps_p) / L)
"""

from types import SimpleNamespace

TINY = 1e-300  # [m2] keeps an element without length from dividing zero by zero


def make(target) -> SimpleNamespace:
    """The functions, compiled for a target."""
    inline, fma, logarithm = target.inline, target.fma, target.logarithm
    inverse_root, maximum, minimum, where = (
        target.inverse_root,
        target.maximum,
        target.minimum,
        target.where,
    )

    @inline
    def inverse_length(dx, dy, dz):
        """1 / L [1/m] and L [m] of an element along (dx, dy, dz) [m]."""
        square = fma(dz, dz, fma(dy, dy, fma(dx, dx, TINY)))
        per_L = inverse_root(square)
        return per_L, square * per_L

    @inline
    def elastic_density(per_L, per_L0, eps_p, EA):
        """N / L [N/m] before any limit, in the engineering strain; eps_p : plastic strain."""
        return EA * fma(-1.0 - eps_p, per_L, per_L0)

    @inline
    def logarithmic_density(stretch, per_L, eps_p, EA):
        """The same in the logarithmic strain; stretch : L / L0"""
        return EA * (logarithm(maximum(stretch, TINY)) - eps_p) * per_L

    @inline
    def logarithmic_strain(stretch):
        """Logarithmic strain at L / L0 = stretch."""
        return logarithm(maximum(stretch, TINY))

    @inline
    def grown(eps, eps_p, limit):
        """Plastic strain at the strain eps of what had eps_p and yields at the elastic strain `limit` in tension."""
        return maximum(eps_p, eps - limit)

    @inline
    def shrunk(eps, eps_p, limit):
        """The same of what yields in compression."""
        return minimum(eps_p, eps + limit)

    @inline
    def within(q, lowest, highest):
        """A force density [N/m] kept between two."""
        q = where(q > highest, highest, q)
        return where(q > lowest, q, lowest)

    @inline
    def branch(state, N, decay, gain):
        """State of a branch of axial damping one step on [N]."""
        return fma(decay, state, gain * N)

    return SimpleNamespace(
        inverse_length=inverse_length,
        elastic_density=elastic_density,
        logarithmic_density=logarithmic_density,
        logarithmic_strain=logarithmic_strain,
        grown=grown,
        shrunk=shrunk,
        within=within,
        branch=branch,
    )
