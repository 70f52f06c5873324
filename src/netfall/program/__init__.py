"""A run from job to result file, and the operations of check, of a sample of a study, and of a restart."""
