"""A run from job to result file; what check, a member of a study and a restart do."""
