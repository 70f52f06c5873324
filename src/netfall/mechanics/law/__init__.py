"""The law of an element: strain, axial force, stiffness, energies, limits, damping over a band."""
