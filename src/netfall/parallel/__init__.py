"""The net on several ranks: partition, halo exchange, exact sums, errors that reach every rank."""
