"""Accuracy and speed: run time against error, scaling."""
