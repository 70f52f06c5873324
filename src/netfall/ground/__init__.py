"""Services for all packages: errors, memory layout, timing, signals, progress, launchers, source digest."""
