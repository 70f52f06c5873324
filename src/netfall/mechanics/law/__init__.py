"""Law of an element: strain, axial force, stiffness, energies, limits, constant axial damping in a band."""
