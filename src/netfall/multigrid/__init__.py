"""Tangent stiffness and its approximate inverse, distributed over the ranks. Knows no Newton."""
