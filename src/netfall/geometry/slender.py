"""Slender elements: cables, masts and stays with a diameter, on which wind and ice act.

The wind acts across the axis of an element with the part U_n of its speed across it (independence principle,
EN 1991-1-4, 7.9):

    F = 1/2 rho c_d (d + 2 t) L |U_n| U_n,    t the thickness of the ice

Half of F acts at each end, with the speed at the height of this end. The axes are those of the form-found
geometry.
"""

from typing import NamedTuple

import numpy as np

from netfall.core.functions import cos, lengths, sin
from netfall.geometry.net import Net

ICE_DENSITY = 900.0  # kg/m3, of glaze (ISO 12494, table 1)


class SlenderElements(NamedTuple):
    """Elements with a diameter, of a net with n particles.

    particles : n; element : (k,) rows; ends : (k, 2) particles; axis : (k, 3) unit vectors; length : (k,) [m]
    L0 : (k,) [m], unstressed, covered by ice; diameter : (k,) [m]; drag_coefficient : (k,)
    """

    particles: int
    element: np.ndarray
    ends: np.ndarray
    axis: np.ndarray
    length: np.ndarray
    L0: np.ndarray
    diameter: np.ndarray
    drag_coefficient: np.ndarray

    def at_ends(self, values: np.ndarray) -> np.ndarray:
        """Add half of the values (k, ...) of the elements to each end; return the sums (n, ...)."""
        total = np.zeros((self.particles, *values.shape[1:]))
        for end in self.ends.T:
            np.add.at(total, end, 0.5 * values)
        return total

    def reference_areas(self, ice: float) -> np.ndarray:
        """Compute c_d (d + 2 t) L (k,) [m2], the drag area in wind across the axis; ice : t [m]."""
        return self.drag_coefficient * (self.diameter + 2.0 * ice) * self.length

    def drag_areas(self, direction: float, ice: float) -> np.ndarray:
        """Compute the drag area vectors (k, 3) [m2]; the force is rho U^2 / 2 times these.

        direction : of the wind [degrees] from x to y; ice : t [m]
        """
        angle = direction * (np.pi / 180.0)
        along = np.array([float(cos(angle)), float(sin(angle)), 0.0])
        across = along - np.sum(along * self.axis, axis=1)[:, None] * self.axis
        return (self.reference_areas(ice) * lengths(across))[:, None] * across

    def ice_mass(self, ice: float) -> np.ndarray:
        """Compute the mass (k,) [kg] of ice of the radial thickness t [m]: rho pi (d t + t^2) L0."""
        return ICE_DENSITY * np.pi * (self.diameter * ice + ice * ice) * self.L0

    def lengthened(self, L0: np.ndarray) -> "SlenderElements":
        """Return the elements with other unstressed lengths L0 (m,) [m]; 0: removed, without ice."""
        return self._replace(L0=L0[self.element])


def slender_elements(net: Net, x: np.ndarray, L0: np.ndarray) -> SlenderElements | None:
    """Return the existing elements with a diameter, None without any.

    x : (n, 3) [m]; L0 : (m,) [m], unstressed
    """
    if net.diameter is None or net.drag_coefficient is None:
        return None
    rows = np.flatnonzero((net.diameter > 0.0) & net.is_there)
    ends, diameter, drag = net.elements[rows], net.diameter[rows], net.drag_coefficient[rows]
    chord = x[ends[:, 1]] - x[ends[:, 0]]
    length = lengths(chord)
    return SlenderElements(net.n, rows, ends, chord / length[:, None], length, L0[rows], diameter, drag)
