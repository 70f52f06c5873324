"""Explicit time integration: the compiled time loop, energy check, history rows and envelope."""
