"""Many runs of a job: the study file, draws, workers, journal, table."""
