"""The job file: its keys, its tables, validation, and values derived from the keys alone."""
