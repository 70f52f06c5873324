"""Sliding cables: the friction law of a slip point, and its motion in the time step."""
