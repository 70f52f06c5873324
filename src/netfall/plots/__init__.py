"""Pictures from result files."""
