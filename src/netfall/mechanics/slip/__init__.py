"""Sliding cables: the law of one slip point, and the motion of slips in the step."""
