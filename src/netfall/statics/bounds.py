"""Tolerances and limits of iterations that several methods of the statics share."""

# share of the scale of a quantity [-] that changes no result: a value below it is rounding error, and as much
# may be added to a matrix that would be singular
NEGLIGIBLE = 1e-9
# share of the largest force [-] in a sum of forces that is rounding error: a thousand terms of 1e-15 each
SUM_ROUNDING = 1e-12
# length over a reference length [-], below which it counts as zero: 0.1 mm in a roof of 100 m
NIL_LENGTH = 1e-6
# share of a stiffness [-] that replaces none: less would leave a tangent nearly singular, more would slow the
# directions that have stiffness
NIL_STIFFNESS = 1e-6
# share of the tolerance of an equilibrium [-]: a smaller change of what depends on it ends an outer iteration
SETTLED = 0.1
MAX_ROUNDS = 100  # equilibria of an outer iteration: each leaves 1 to 10 % of the change before
# steps of one method for one equilibrium: 10 to 30 suffice; 50 near a limit load; 95 for a chain that hangs
# folded
MOST_STEPS = 200
MAX_DECADES = 6  # times that a tolerance is divided by ten, if its residual is not small enough
MAX_LISTED_NODES = 5  # nodes that a message on a failure names
