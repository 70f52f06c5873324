"""Equilibria of a net by Newton's method and by relaxation. Knows no job."""
