"""The net on several ranks: partition, halo exchange, exact sums, propagation of errors to all ranks."""
