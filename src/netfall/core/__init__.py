"""Tools of every package: errors, progress, compiled kernels and bitwise reproducible arithmetic.

The arithmetic has the same bits on any processor. It replaces numpy, LAPACK and scipy for each value that
affects a result of the simulation:

- `arithmetic` (kernels): laws of material and slip, bending, equilibrium, gusts, multigrid
- `functions`: lengths everywhere; wind; random strengths, errors of length, parameters of studies; supports
  in rotated axes
- `linear`: models of gusts, multigrid; states of self-stress, lengths of an erection
- `sparse`: force densities, the coarsest grid of multigrid
"""
