"""Evaluation of a study: outcomes of samples, fragility, correlations, member removals."""
