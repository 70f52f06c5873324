"""Distribution of the net over ranks: partition, halo, exact sums, errors that reach every rank."""
