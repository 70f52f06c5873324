"""The net and its roof: nodes, cables, supports, sections, faces, areas and zones. Arrays, no MPI."""
