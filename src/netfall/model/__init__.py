"""The model of a job on rank 0: loads, wind, losses, probes, and what is odd in it."""
