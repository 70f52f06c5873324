"""The dynamic stage: time steps of a net with fractures, under loads that vary in time."""
