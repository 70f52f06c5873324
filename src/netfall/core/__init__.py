"""Tools of every package: errors, progress, compiled kernels and bitwise reproducible arithmetic.

The arithmetic has the same bits on any processor. It takes the place of numpy, LAPACK and scipy where a value
reaches a result of the simulation:

- `arithmetic` (kernels): laws of material and slip, bending, equilibrium, gusts, multigrid
- `functions`: lengths everywhere; wind, random strengths and parameters of studies
- `normal`: random strengths, errors of length, parameters of studies
- `linear`: models of gusts, multigrid, the time step
- `sparse`: force densities, the coarsest grid of multigrid
- `least_squares`: states of self-stress, lengths of an erection
- `rotation`: supports in turned axes
- `sets`: numbers of nodes and elements, where the sets of numpy are slow
"""
