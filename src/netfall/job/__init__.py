"""What was asked: the job file, its keys, its tables, and the questions that it answers by itself."""
