"""What every kernel stands on: how it is compiled, what it is given, and vectors of numbers."""
