"""Form finding: by tensions, by force densities, or the given geometry with its self-stress."""
