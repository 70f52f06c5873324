"""The command line: options, help and commands."""
