"""The physics of elements and particles: material law, bending, slip, fracture, air, supports.

Arrays go in and out; no module reads or writes files. `element_step` and `particle_step` hold the formulas of
the time step as pure functions of numbers, or of vectors of numbers. Products are added only by `fma`, which
rounds once, so no compiler can contract anything and the bits are the same on every processor.
"""
