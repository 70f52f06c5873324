"""Measuring tools: run time against error, scaling, throughput."""
