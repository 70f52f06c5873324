"""Loads of a job on rank 0: permanent and variable loads, load cases, member removal, base motion, wind."""
