"""Studies: the study file, random draws, workers, journal and table of many runs of one job."""
