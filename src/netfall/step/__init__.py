"""The fast machine that steps the particles; change it only with jobs/bench beside you."""
