"""Many runs of a job: the study file, random draws, workers, journal, table."""
