"""Static equilibria of a net by Newton's method, an interior point method and relaxation. Knows no job."""
