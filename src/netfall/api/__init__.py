"""The Python interface: run, Net."""
