"""The time loop that advances the particles; measure every change with `jobs/bench`."""
