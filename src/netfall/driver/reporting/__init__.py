"""Text that run and check print. The package computes no results."""
