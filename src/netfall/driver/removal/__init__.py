"""Member removal: the equilibria before and after it, and its steps in the dynamic stage."""
