"""Evaluation of a study: outcomes of samples, fragility, correlations, effects of member removal."""
