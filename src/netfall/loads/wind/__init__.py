"""Wind: mean profile, gusts and pressures at points over time. Arrays, no MPI."""
