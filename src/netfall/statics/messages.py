"""Messages of the package `statics`: search for equilibria, form finding, self-stress.

The texts on the search for an equilibrium are reasons inside other messages, so they end without a full stop.
"""

from netfall.core.messages import Message

MAX_LISTED_NODES = 5  # nodes that a message on a failure names

# search for an equilibrium
NOT_CONVERGED = Message("E501")
RESIDUAL_NOT_FINITE = Message("E502")
UNBOUNDED_YIELDING = Message("E503")
SLIPS_NOT_CONVERGED = Message("E505")
FRICTION_NOT_CONVERGED = Message("E506")
ERROR_TOO_LARGE = Message("E507")
ERROR_UNKNOWN = Message("E508")

# form finding
FORM_NOT_FOUND = Message("E521")
COINCIDENT_NODES = Message("E522")
FORM_LOAD_NOT_CONVERGED = Message("E523")
DENSITIES_NEARLY_SINGULAR = Message("E524")
NO_FORM_AT_NODE = Message("E525")
NODES_NOT_HELD = Message("E526")
PLAN_NOT_CONVERGED = Message("E536")

# states of self-stress
NO_SELF_STRESS = Message("E531")
PRESTRESS_NOT_IN_STATES = Message("E532")
NO_PRESTRESS = Message("E533")
TOO_MANY_GROUPS = Message("E534")
GEOMETRY_NOT_IN_EQUILIBRIUM = Message("E535")
