"""The form of a net: by tensions, by force densities, or the geometry that is given with its self-stress."""
