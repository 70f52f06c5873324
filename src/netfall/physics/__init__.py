"""The physics of one element and one particle, as pure functions of numbers.

Each module has `make(target)`, which compiles its functions for a target (`targets.Target`): vectors of
numbers on a processor, or a GPU. No product is added except by `fma`, which rounds once. So nothing is left
that a compiler might contract, and the bits are the same on all of them.
"""
