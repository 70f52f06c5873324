"""Model of a job on rank 0: loads, wind, member removals, probes, and plausibility notes."""
