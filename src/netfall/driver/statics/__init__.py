"""The static analysis: equilibria under constant loads, in the order of the job."""
