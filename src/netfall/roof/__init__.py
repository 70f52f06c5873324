"""The roof of a net: its plan, faces, areas, panels and zones. Arrays, no MPI."""
