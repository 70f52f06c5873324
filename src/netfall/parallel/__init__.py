"""The net over the ranks: partition, halo, exact sums, errors that reach every rank."""
