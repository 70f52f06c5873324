"""The physics of particles and elements, which an engineer may change. Arrays, no files."""
