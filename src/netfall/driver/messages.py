"""Messages of the package `driver`: stages of a run, and doubtful values in a run or check."""

from netfall.core.messages import Message

# --- form, targets and stages of erection

TOLERANCE_BELOW_ROUNDING = Message(
    "E601",
    "{path}: [form_finding] tolerance = {tolerance:g}: with the real material the residual is "
    "{residual:kN}, and the tension is {reference:kN}. Give a tolerance that rounding allows",
    "The unstressed lengths follow from the tensions of the form. Rounding them leaves a residual, which "
    "grows with the axial stiffness. A tolerance of 1e-6 is possible for usual cables.",
)
UNKNOWN_NAME = Message("E602", "{place}: {name}: neither a group nor a cable; {suggestion}")
UNKNOWN_GROUP = Message("E603", "{place}: active: no group {name}; {suggestion}")
UNKNOWN_NODES = Message("E604", "{place}: {key}: no node {nodes}. Give ids of nodes of the net")
MOVED_FREE_NODES = Message(
    "E605",
    "{place}: move: {nodes}: an axis that moves must be held. Add the nodes to hold, those with an angle "
    "along both axes in plan, and release in the next stage the axes that were free before",
)
RELEASED_FREE_NODES = Message(
    "E649",
    "{place}: release: {name}: not held, or kept by hold. Give held nodes, and axes along which they are "
    "held",
)
UNKNOWN_PLACE = Message("E665", "{place}: {key}: {name}: neither a group nor a zone with nodes; {suggestion}")
TURNED_AXES = Message(
    "E666",
    "{place}: {nodes}: have an angle, and at the start both axes in plan are either held or free. Release or "
    "hold both, x and y.",
    "The axes of a node with an angle are rotated. A stage cannot make such a node a guided support, unless "
    "the table of the nodes does.",
)
NO_LENGTH_LEFT = Message(
    "E606", "{place}: lengths: {elements}: no unstressed length remains. Shorten the cables by less"
)
ABSENT_CABLE = Message(
    "E607", "{place}: lengths: {name}: not active in this stage. Add its group to active, or change it later"
)
LENGTH_CHANGED_TWICE = Message(
    "E669",
    "{place}: lengths: {name}: {elements}: an earlier entry also changes their length. Give one entry, or "
    "the second in a separate stage.",
)
MOVED_TWICE = Message(
    "E673",
    "{place}: move: {nodes}: two entries give different displacements. Give one, or the second in a "
    "separate stage.",
)
UNSUPPORTED_PART = Message(
    "E608",
    "{place}: {nodes}: the part of the net with these nodes has no support. Hold a node of it, or activate "
    "the elements that connect it",
)
PRESTRESS_FACTOR_AFTER_HEATING = Message(
    "E609",
    "{path}: [[combination]] {name}: prestress {factor:g} is a factor of the forces at the temperature of "
    'form finding, but the last [[stage]] ends at {temperature:g} K. Give "load.temperature" = 0.0 in its '
    "set, or a factor of 1",
)
PRESTRESS_FACTOR_WITH_BENDING = Message(
    "E671",
    "{path}: [[combination]] {name}: prestress {factor:g} multiplies axial forces, but not the moments that "
    "bending chains have after the last [[stage]]. Forces would be too small. Give a factor of 1, and jack "
    "to the multiplied forces in a separate job",
)
RELEASED_SETTLEMENT = Message(
    "E610",
    "{path}: [[case]] {name}: settlement: {nodes}: released in a [[stage]], and so free. Give settlements "
    "of held nodes only",
)
STAGE_LOADS_LOST = Message(
    "W663",
    "[[stage]] {name}, the last: {keys}: differ from [load]. These loads end with the erection: cases, "
    "combinations, load steps and motion have those of [load]. Give lasting loads in [load], and set them to "
    "0 in earlier stages.",
    "Cladding that only the last stage sets is in no combination. Give its dead load in [load], and "
    "set load.dead to 0 in the first stage. A load_table of [load] acts in all stages.",
)
TARGET_NODE = Message("E611", "{place}: node = {node}: no such node. Give the id of a node of the net")
REPEATED_TARGET = Message(
    "E612",
    "{place}: adjust = {name}: already used in an earlier target. Give each target a different cable or "
    "group",
)
TARGETS_MISSED = Message(
    "E613",
    "{what}: {reason}. Choose cables in adjust that act on the targets, or other values of the targets",
    "netfall changes the unstressed lengths of the cables in adjust until all targets are reached. Cables "
    "that become slack, or that hardly change the target, cannot reach it.",
)
STAGE_WITHOUT_EQUILIBRIUM = Message(
    "E614", "{what}: no equilibrium: {reason}. Change lengths in smaller stages, or hold more nodes"
)
ERRORS_WITHOUT_EQUILIBRIUM = Message(
    "E615", "{what}: no equilibrium with them: {reason}. Reduce length_std, or raise the prestress"
)
NO_INFLUENCE = Message(
    "W664",
    "{what}: the net is a mechanism or unstable, so the linear influence of lengths on forces is unknown; "
    "the result is nan. Brace compressed bars, or tension the net.",
    "The linear influence follows from the tangent stiffness. If this has no inverse, or a displacement "
    "releases energy, small errors of length change the form by large amounts.",
)
LOAD_CHANGES = Message(
    "W616",
    "{what}: the permanent load changes with the lengths: a residual of {residual:kN} remains. Use the "
    "result only if this force is negligible.",
)

# --- equilibria

UNDECIDED_TEXT = (
    "{what}: undecided: {reason}; an equilibrium was found up to load factor {factor:.4g}. This does not "
    "show that the load cannot be carried. Raise [load] max_iterations, apply the load in more steps, or "
    "give coordinates closer to the equilibrium."
)
UNDECIDED = Message(
    "E617",
    UNDECIDED_TEXT,
    "The search ended before it found an equilibrium or showed that there is none. Slack cables, friction "
    "and mechanisms make it slow.",
)
UNDECIDED_CASE = Message("W618", UNDECIDED_TEXT, UNDECIDED.remedy)
LOAD_FACTOR_REACHED = " (load factor reached {factor:.4g}{start})"
FROM_PERMANENT = ", from 0 at the permanent loads"
NO_EQUILIBRIUM = Message(
    "E619",
    "{what}: no equilibrium: {reason}{reached}. Lower the load, or strengthen the structure",
    "Under the limit load an element breaks, a member buckles, or displacements are unbounded. The load "
    "factor is the part of the load up to which netfall found an equilibrium. Of a case or combination it "
    "is a share of the way from the permanent loads with factor 1.",
)
NO_EQUILIBRIUM_AT_START = Message(
    "E620",
    "{what}: no equilibrium to start from: {reason}{reached}. Lower the load, or set {keys} to apply it at "
    "once in the dynamic stage",
    NO_EQUILIBRIUM.remedy,
)
NO_EQUILIBRIUM_IN_MEAN_WIND = Message(
    "E621",
    "{what}: no equilibrium: {reason}. One was found up to {pressure} of its pressure, {speed} of its "
    'speed. Lower the speed, or set [wind] onset = "sudden" to apply the wind at once in the dynamic stage',
    NO_EQUILIBRIUM.remedy,
)
NO_EQUILIBRIUM_UNDER_PRESSURES = Message(
    "E622",
    "{what}: no equilibrium: {reason}. One was found up to {pressure} of the mean pressures. Lower the "
    'pressures, or set [wind] onset = "sudden" to apply them at once in the dynamic stage',
    NO_EQUILIBRIUM.remedy,
)
CASE_WITHOUT_EQUILIBRIUM = Message(
    "W623",
    "{what}: no equilibrium: {reason}{reached}. The result contains the last state of the load path. Lower "
    "the load, or strengthen the structure.",
    NO_EQUILIBRIUM.remedy,
)
UNSTABLE = Message(
    "W624",
    "{what}: unstable equilibrium: compressed bars buckle, node {node} moves most. The net does not stay in "
    "this equilibrium. Brace the bars, or raise the prestress.",
    "The tangent stiffness is not positive definite: there is a displacement that releases energy. Forces "
    "of this state must not be used for a design.",
)
STABILITY_UNKNOWN = Message(
    "W625",
    "{what}: netfall could not decide whether compressed bars buckle. Apply the load in more steps, or "
    "brace the bars.",
)
UNSUPPORTED_WITHOUT_MEMBERS = Message(
    "W626", "{what}: no equilibrium: a part is connected to no support. Add a second load path to it."
)
REMOVAL_WITHOUT_EQUILIBRIUM = Message(
    "W627",
    "{what}: no equilibrium: {reason}. Strengthen the other members, or add a second load path.",
)
MODES_WITHOUT_EQUILIBRIUM = Message(
    "W628",
    "modes: no equilibrium was found under {loads}. Periods are those of the initial state. Lower the load, "
    "or strengthen the structure.",
)
MECHANISMS = Message(
    "W629",
    "modes: {count} of these have no stiffness (mechanisms): nodes {nodes} move most. Support these nodes, "
    "or tension the net.",
)
UNSTABLE_MODES = Message(
    "W630",
    "modes: {count} of these are unstable ({total} of the net): nodes {nodes} move most. Brace the "
    "compressed bars there, or raise the prestress.",
)

# --- start of a run

START_UNBALANCED = Message(
    "W631",
    "start: not in equilibrium: largest residual {residual:kN}, largest tension {force:kN}. The net "
    "moves before a load changes. Find a start with [form_finding], or apply the loads with [load] steps = "
    "1.",
)
NET_UNBALANCED = Message(
    "W632",
    "net as given: not in equilibrium with its prestress: largest residual {residual:kN}, largest "
    "tension {force:kN}. Forces change before a load acts, and displacements count from the given "
    "geometry. Find a form with [form_finding].",
)
FORM_SLIPS = Message(
    "W633",
    "[[slide]]: in the form the tensions of {count} of {total} slip points differ by more than their slip "
    "resistance; at node {node}: {before:kN} and {after:kN}. Cables slip there before a load acts. Use "
    "constant tension ([form_finding] modulus_factor = 0), or raise the resistance.",
)
FAR_PROBE = Message(
    "W634",
    "[output] probes: [{probe}]: {distance:.4g} m away from every node (longest element {longest:.4g} m). "
    "Its histories are those of node {node}, at [{at}]. Give the id of a node, or another point.",
)
AMBIGUOUS_PROBE = Message(
    "N635",
    "[output] probes: [{probe}]: nodes {nodes} lie above one another there. Its histories are those of node "
    "{node}; [x, y, z] or an id selects another one.",
)
BAND_STIFFNESS = Message(
    "W636",
    "[dynamics] axial_damping_ratio = {ratio:g}: vibration in its band and above has up to {share:.1%} more "
    "axial stiffness. Tensions exclude this part: the variable part of a force is up to this share larger.",
    "The Maxwell branches that damp in a band also stiffen. Checks of strength and the written tensions use "
    "the elastic force without them.",
)
DURATION_EXTENDED = Message(
    "N637",
    "[dynamics] time_step = {dt:g} does not divide duration = {duration:g}: the run ends at t = {end:.6g} s.",
)
STEP_ABOVE_SLACK_LIMIT = Message(
    "W638",
    "[dynamics] time_step = {time_step:g} is above {limit:.4g} s, the limit for cables that become slack "
    "and taut again (first: element {element}, {length:.3g} m). Such cables gain energy. Use a smaller "
    "time_step, unless short cables stay taut.",
)
SLIP_INERTIA = Message(
    "W639",
    "slip: the step adds inertia at {count} of {total} slip points: {share:.2%} of the moving mass (limit "
    "{limit:.0%}), up to {ratio:.3g} times that of the cable at node {node}. Slip is slower by up to as "
    "much. Halve the step.",
)

# --- wind

NEGATIVE_SPEEDS = Message(
    "W640",
    "[wind] {key} = {value:g}: {share:.1%} of the wind speeds are negative. The force is proportional to the "
    "square of the speed, so suction remains suction. Check the value: codes give intensities of 0.15 to 0.2 "
    "in open terrain.",
)
VARIANCE_LOST = Message(
    "W641",
    "[wind] time_step = {time_step:g}: {share:.1%} of the variance of the gusts is lost (limit "
    "{limit:.0%}). Use a smaller time_step.",
    "Gusts are sampled at this step and interpolated in between, which removes fast gusts. The loss is "
    "proportional to the power 2/3 of the step.",
)
SPECTRUM_ERROR = Message(
    "W642",
    "[wind] ar_order = {order}: the spectrum is off by {error:+.0%} in the half octave from {low:.3g} Hz "
    "(limit {limit:.0%}). Use a larger ar_order.",
)
SLOW_GUSTS = Message(
    "W643",
    '[wind] spectrum = "{spectrum}": gusts slower than {period:.3g} s have {share:.1%} of the variance, in '
    "the spectrum {target:.1%}. Means over minutes scatter too much. Use a larger ar_order.",
)
WEAK_GUSTS = Message(
    "W645",
    '[wind] gust_field = "area_mean": gusts at a node have {mean:.0%} of the standard deviation (smallest '
    "{least:.0%}). Forces of elements that few nodes load are too low. Use more control_points, or compare "
    'with gust_field = "point".',
    "A gust field of area means gives the whole roof the right load, but smooths the gusts at single nodes.",
)
STRONG_GUSTS = Message(
    "W646",
    '[wind] gust_field = "point": with {points} control points the load on the whole roof is too strong: '
    "its standard deviation is {ratio:.3g} times that of the coherence, at {frequency:.2g} Hz "
    '{ratio_there:.3g} times. Use gust_field = "area_mean", or more control_points.',
    "Gusts at points are as strong at all nodes as at the control points, so between them they are too well "
    "correlated. The load on the roof is conservative.",
)

GUST_LENGTH_AT_TEN = Message(
    "W647",
    '[wind] spectrum = "{spectrum}": gust_length = "auto" is {length:g} m, that at 10 m. The roof is at '
    "{height:.3g} m above ground, where its formula gives {roof_length:.3g} m. Set gust_length.",
    "Longer gusts have more of their variance at low frequencies: with too short a length the gusts at the "
    "frequencies of a roof are too strong, and the slow ones too weak.",
)

# --- dynamic stage

DIVERGED = Message(
    "E650",
    "dynamics: diverged at t = {time:.6g} s (step {step}): kinetic energy {kinetic:.3g} J, more than the "
    "external work supplies; fastest {node}, largest strain in element {element}. Use a smaller [dynamics] "
    "time_step or safety",
    "The step is above the stable limit of the deformed net, for example after a fracture or an impact. The "
    "node and the element show where.",
)
LARGE_STRAIN = Message(
    "W651",
    "element {element}: strain of {strain:.3g}{at}, more than any cable can carry (limit {limit:g}), and no "
    "fracture_strain. Check loads and units, or give [cable] yield_stress and fracture_strain.",
)
SEGMENT_CHANGED = Message(
    "W652",
    "slip: the free segment with element {element} changed its length by {share:.0%} (limit {limit:.0%}). "
    "Masses, weights and the step limit are those of the initial lengths. Halve the step to see their "
    "effect, and divide the cable into more elements.",
)
CABLE_RAN_OUT = Message(
    "W653",
    "slip: at t = {time:.6g} s a cable had slipped over node {node} until {share:.0%} of its free segment "
    "remained, where the model stops it; {count} such points in all. Raise the slip resistance or friction.",
)

EVENT_UNFINISHED = Message(
    "W670",
    "{place}: lasts until t = {end:.4g} s, the dynamic stage until {duration:g} s. At its end {state}. "
    "Extend [dynamics] duration, or let this end earlier.",
    "The job contains more than the stage computes: a ramp, a tension that fades after a removal, or a "
    "motion of supports. Its largest forces may follow after the end.",
)
MUCH_ADDED_INERTIA = Message(
    "W672",
    "dynamics: mass scaling adds {share:.0%} of the moving mass as inertia (limit {limit:.0%}). Periods are "
    "too long, those of stiff parts most. Lower [dynamics] mass_scaling.",
)

# --- check and size of a run

LARGE_FACE = Message(
    "N662",
    "largest face: {area:.4g} m2 in plan around [{x:.4g}, {y:.4g}], the usual one has {usual:.4g} m2. If it "
    "is an opening, leave it out with [roof] openings = [[{x:.4g}, {y:.4g}]]",
)
