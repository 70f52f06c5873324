"""What Python gets: run, Net."""
