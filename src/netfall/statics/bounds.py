"""Tolerances and limits of iterations that several methods of the statics share."""

# share of the scale of a quantity [-] that changes no result: a value below it is rounding error, and as much
# may be added to a matrix that would be singular
NEGLIGIBLE = 1e-9
# share of the largest force or potential [-] by which a sum of them may be wrong due to rounding
SUM_ROUNDING = 1e-12
# share of a reference length or stiffness [-] that takes the place of none, so that nothing is divided by
# zero: more would slow the directions that have stiffness
SUBSTITUTE_SHARE = 1e-6
# share of the tolerance of an equilibrium [-]: a smaller change of what depends on it ends an outer iteration
SETTLED_CHANGE = 0.1
# iterations of a loop that converges in far fewer, so that one without convergence ends: the interior point
# method takes 10 to 30 steps, 50 near a limit load, 95 for a chain that hangs folded
MOST_STEPS = 200
# large share of a quantity [-]: a prediction with a larger relative error does not hold, and a correction was
# too long if only a smaller share of it is possible
LARGE_SHARE = 0.5
MAX_DECADES = 6  # times that a tolerance is divided by ten, if its residual is not small enough
