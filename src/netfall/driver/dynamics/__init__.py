"""The dynamic stage: steps of a net in motion that breaks, under loads that vary in time."""
