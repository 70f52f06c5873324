"""The physics of elements and particles: material law, bending, slip, fracture, air, supports.

Arrays go in and out; no module reads or writes files. `element_step` and `particle_step` hold the formulas of
the time step as pure functions of numbers. Their `make(target)` compiles the functions for a target
(`targets.Target`): vectors on a processor, or a GPU. Products are added only by `fma`, which rounds once, so
no compiler can contract anything and the bits are the same on every target.
"""
