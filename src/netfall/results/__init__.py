"""Reading of result files: frames, equilibria, member removals, tables. No MPI."""
