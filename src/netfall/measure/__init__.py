"""Measurements: run time against error, scaling, throughput."""
