"""Arithmetic that has the same bits on any processor, for what reaches a result of the simulation.

Who needs it, as `arithmetic`, `functions`, `linear`, `sparse` and `least_squares` take the place of numpy,
LAPACK and scipy there:

- `arithmetic` (kernels): laws of material and slip, bending, equilibrium, gusts, multigrid
- `functions`: lengths everywhere; wind, draws of strengths and of studies
- `normal`: random strengths, errors of length, draws of studies
- `linear`: models of gusts, multigrid, the time step
- `sparse`: force densities, the coarsest grid of multigrid
- `least_squares`: states of self-stress, lengths of an erection
- `rotation`: supports in axes of their own
- `sets`: numbers of nodes and elements, where numpy's sets are slow
"""
