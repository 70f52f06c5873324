"""The command line: its words, options, help, and what each command does."""
