"""Messages of the package `statics`: search for equilibria, form finding, self-stress.

The texts on the search for an equilibrium are reasons inside other messages, so they end without a full stop.
"""

from netfall.core.messages import Message

MAX_LISTED_NODES = 5  # nodes that a message on a failure names

# --- search for an equilibrium

NOT_CONVERGED = Message(
    "E501",
    "{name}: not in equilibrium after {iterations} iterations: largest residual {residual:kN}, tolerance "
    "{tolerance:kN}",
    "Dynamic relaxation ended at [load] or [form_finding] max_iterations. Raise it, apply the load in more "
    "steps, or give coordinates closer to the equilibrium.",
)
RESIDUAL_NOT_FINITE = Message(
    "E502",
    "{name}: the residual is not finite after {iterations} iterations. Look for elements of nearly zero "
    "length, as at free ends, and wrong sections",
    "Very short elements, or stiffnesses that differ by orders of magnitude, make the relaxation unstable.",
)
UNBOUNDED_YIELDING = Message("E503", "yielding elements elongate without bound")
SLIPS_NOT_CONVERGED = Message("E505", "{name}: the slips of cables over nodes did not converge")
FRICTION_NOT_CONVERGED = Message(
    "E506",
    "{name}: the slip resistances still change by {change:kN} after {rounds} rounds, allowed {allowed:kN}",
    "The resistance of a slip point depends on the tensions, which depend on the slips. Apply the load in "
    "more steps.",
)
ERROR_TOO_LARGE = Message(
    "E507",
    "{name}: after {iterations} iterations of relaxation the residual is {residual:kN} and the estimated "
    "error {error:.1g}, tolerance {tolerance:.3g}",
    "The residual is small, but the net is so soft that displacements or tensions still change. Raise "
    "[load] max_iterations or tolerance.",
)
ERROR_UNKNOWN = Message(
    "E508",
    "{name}: after {iterations} iterations of relaxation the residual is {residual:kN} and the error is "
    "not known, tolerance {tolerance:.3g}",
    "The error cannot be estimated, because compressed bars buckle or a part of the net is a mechanism. "
    "Brace it, or raise its prestress.",
)

# --- form finding

FORM_NOT_FOUND = Message(
    "E521",
    "{reason}. Largest residuals: {nodes}. Check joints, supports and prestress there, or raise "
    "[form_finding] max_iterations or tolerance. For struts and rings set modulus_factor = 1 "
    'or method = "given_geometry".',
    "The prestresses have no form in which all nodes are in equilibrium, or the iterations end before it. "
    "Compressed elements of constant force are unstable; with modulus_factor = 1 they keep their stiffness. "
    'With method = "given_geometry" the form starts from a state of self-stress.',
)
COINCIDENT_NODES = Message(
    "E522",
    "form finding at constant tension: the nodes of element {element} coincide after {iterations} "
    "iterations. Nothing holds them apart, so these tensions have no form. "
    'Set [form_finding] modulus_factor = 1e-3 or method = "force_density".',
    "The work of a constant tension is least if its element has no length. The nodes of an edge cable, for "
    "example, move along it until they meet, unless the net pulls them apart.",
)
FORM_LOAD_NOT_CONVERGED = Message(
    "E523",
    'form finding, loads = "permanent": the load of the form still changes by {change:kN} after {turns} '
    "forms, tolerance {allowed:kN}. Increase the prestress or the tolerance.",
)
DENSITIES_NEARLY_SINGULAR = Message(
    "E524",
    "form finding by force density: largest residual {residual:kN}, tolerance {allowed:kN}. The force "
    "densities are nearly singular: change those that nearly cancel at a node.",
)
NO_FORM_AT_NODE = Message(
    "E525",
    "form finding by force density: no solution around node {node}. Give force densities (or prestress) that "
    "hold every free node.",
)
NODES_NOT_HELD = Message(
    "E526",
    "form finding by force density: no solution: the force densities do not hold {nodes} along {axes}. Hold "
    "one of them, connect them to supports, or give force densities (or prestress) that do not cancel.",
)

PLAN_NOT_CONVERGED = Message(
    "E536",
    "form finding by horizontal forces: after {solutions} solutions the length in plan of element {element} "
    "(nodes {start} and {end}), {length:.4g} m, still changes by {change:.2g} %. Give edge cables a "
    "prestress or a force_density instead of horizontal_force, or give a plan nearer to equilibrium.",
    "A constant horizontal force does least work if its element has no length in plan. The nodes of an edge "
    "cable, for example, move along it until they meet, unless the net holds them apart.",
)

# --- states of self-stress

NO_SELF_STRESS = Message(
    "E531",
    '[form_finding] method = "given_geometry": the geometry has no state of self-stress with one axial force '
    "in each of its {groups} groups. The nearest forces leave {misfit:.3g} of the largest at node {node}. "
    "Divide groups whose forces differ, correct the geometry, or raise tolerance if coordinates are rounded.",
    "A state of self-stress is a set of axial forces in equilibrium without load. All elements of a group "
    "have one force. Coordinates with few digits leave a residual; then a larger tolerance helps.",
)
PRESTRESS_NOT_IN_STATES = Message(
    "E532",
    '[form_finding] method = "given_geometry": prestress of group {groups}: no state of self-stress of the '
    "geometry has it ({count} known, with forces in {members}). The state nearest to the prestress is zero. "
    "Give a prestress to groups that take part, or correct the geometry or the groups.",
)
NO_PRESTRESS = Message(
    "E533",
    '[form_finding] method = "given_geometry": no element that can move has a prestress, which the '
    "self-stress is to match. Give [cable] prestress, or that of one group.",
)
TOO_MANY_GROUPS = Message(
    "E534",
    '[form_finding] method = "given_geometry": {groups} groups and {nodes} nodes make a matrix of '
    "{entries:.2g} entries, allowed are {most:.0e}. Use fewer groups.",
)
GEOMETRY_NOT_IN_EQUILIBRIUM = Message(
    "E535",
    '[form_finding] method = "given_geometry": {nodes}: not in equilibrium to {allowed:kN} with one axial '
    "force in each group ({residuals}). Divide groups, change the geometry, or raise tolerance.",
)
