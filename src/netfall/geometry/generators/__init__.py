"""Nets from a few dimensions."""
