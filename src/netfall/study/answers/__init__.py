"""Evaluation of a study: outcomes of samples, fragility, correlations, consequences of member removal."""
