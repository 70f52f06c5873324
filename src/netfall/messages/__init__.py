"""Messages of run and check; no number is computed here."""
