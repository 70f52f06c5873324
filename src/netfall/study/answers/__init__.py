"""What a study tells: outcomes of members, fragility, correlations, losses."""
