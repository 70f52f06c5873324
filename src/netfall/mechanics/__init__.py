"""Mechanics of particles and elements, which an engineer may change: functions of arrays, without files."""
