"""Job file: its keys, its tables, and questions that a job answers by itself."""
