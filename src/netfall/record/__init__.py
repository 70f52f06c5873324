"""Recorded quantities of a state: energies, envelope, history."""
