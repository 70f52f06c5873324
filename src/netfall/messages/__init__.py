"""The sentences of run and check. No number is computed here."""
