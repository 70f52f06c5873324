"""Gusts and pressures at points, in time. Arrays, no MPI."""
