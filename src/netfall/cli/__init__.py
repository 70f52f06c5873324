"""The command line: commands, options, help texts, and the function of each command."""
