"""The one reader of result files: frames, states, losses, columns. No MPI."""
