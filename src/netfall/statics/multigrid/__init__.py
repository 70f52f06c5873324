"""The tangent stiffness and multigrid cycles that approximate its inverse, distributed over the ranks."""
