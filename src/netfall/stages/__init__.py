"""The stages of a run: statics, rests, modes, dynamics, and what belongs to one of them."""
