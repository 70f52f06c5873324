"""Cables that slip over nodes: the law of one place, and their motion in the step."""
