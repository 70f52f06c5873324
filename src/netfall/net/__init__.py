"""Net: nodes, cables, supports, sections, areas and zones, from generators or tables. Arrays, no MPI."""
