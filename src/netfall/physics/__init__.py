"""Physics of one element and one particle, as pure functions of numbers.

`make(target)` of each module compiles its functions for a target (`targets.Target`): vectors of numbers on a
CPU, or a GPU. Products are added only by `fma`, which rounds once. So no compiler can contract operations,
and the bits are the same on all targets.
"""
