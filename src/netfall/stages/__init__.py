"""The stages of a run: form, statics, rests, modes, dynamics, and what belongs to one of them."""
