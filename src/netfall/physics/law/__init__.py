"""The law of an element: strain, axial force, stiffness, energies, limits, damping in a frequency band."""
