"""Text that run and check print. No number is computed here."""
