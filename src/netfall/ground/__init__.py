"""What everything stands on: the compiler, errors, clocks, signals, progress, commands that are started."""
