"""Wind: mean profile, gusts and pressures at points in time. Arrays, no MPI."""
