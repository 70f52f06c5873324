"""Arithmetic with the same bits on any processor, for everything that affects a result of the simulation.

The modules replace numpy, LAPACK and scipy. Their users are:

- `arithmetic` (kernels): laws of material and slip, bending, equilibrium, gusts, multigrid
- `functions`: lengths everywhere; wind, random strengths and studies
- `normal`: random strengths, length errors, random draws of studies
- `linear`: models of gusts, multigrid, the time step
- `sparse`: force densities, the coarsest grid of multigrid
- `least_squares`: states of self-stress, lengths of an erection
- `rotation`: supports with rotated axes
- `sets`: numbers of nodes and elements, for which numpy's sets are slow
"""
