"""Messages of the package `model`: checks of a job's net and initial state, time step, unused keys."""

from netfall.core.messages import Message

UNITS_HINT = "Check the units of modulus (Pa), area (m2), prestress (N) and unstressed_length (m)."

# --- the net, its output and its roof

DAMPING_WITH_SLIDE = Message(
    "E401",
    "{path}: [dynamics] axial_damping_ratio: not together with [[slide]]. Remove it or use mass_damping.",
)
UNKNOWN_OUTPUT_IDS = Message(
    "E402",
    "{path}: [output] {key}: the net has no {kind} {ids} (its ids are {first} to {last}). Give ids of its "
    "{kind}s.",
)
CHAIN_TURNS_BACK = Message(
    "E403",
    "{path}: node {node}: the bending chain turns back by more than 170 degrees from element {first} to "
    "element {second}. Move the node, or put the two bars in different groups.",
    "Bars of a group that bend and meet at a node form one chain. If a chain folds back on itself, the axis "
    "of bending is not defined.",
)
PANELS_WITH_RAMP = Message(
    "E404", '{path}: [wind] after_fracture = "panels": not together with [load] ramp. Remove one of them.'
)
NO_PANELS = Message(
    "E405",
    '{path}: [wind] after_fracture = "panels": panels are the closed faces of the net, with the areas of '
    "their nodes. Give a net with faces and without a column area.",
)
NODES_WITHOUT_NORMAL = Message(
    "E406",
    "{path}: {count} free nodes with a roof area meet no closed face in plan (first: node {node}). Wind and "
    "pressure have no normal to act along. Close the faces with elements, give columns normal_x, normal_y, "
    "normal_z, or give pressure as [x, y, z].",
    "netfall finds the faces of a roof from the elements in plan, and the normals from the faces. Without "
    "faces the normals must be given.",
)

# --- the time step

STEP_ABOVE_DURATION = Message(
    "E411",
    "{path}: [dynamics] time_step = {step:g}: longer than duration = {duration:g} s. Give a shorter step.",
)
NOTHING_MOVES = Message("E412", "{path}: [dynamics]: no particle of the net can move. Free a node.")
TOO_MANY_STEPS = Message(
    "E413",
    "{path}: [dynamics] duration = {duration:g}: needs {steps:.3g} steps of {step:.3g} s, allowed are "
    "{most:.0e}. Shorten the duration or give a longer step.",
    "The stable step is very short, usually because of one short, stiff or light element, or the duration "
    "is not in s.",
)
UNSTABLE_STEP = Message(
    "E414",
    "{path}: [dynamics] time_step = {step:g}: above the stable step {limit:.4g} s of the {net}, set by "
    'element {element}. Give a shorter step or "auto", or use longer elements there.',
    "The explicit scheme is stable if the step is shorter than twice the inverse of the highest angular "
    "frequency. Short, stiff and light elements have the highest one.",
)
UNSTABLE_STEP_AFTER_FRACTURE = Message(
    "E415",
    "{path}: [dynamics] time_step = {step:g}: above the stable step {limit:.4g} s of the fragments after a "
    'fracture, set by element {element}. Give a shorter step or "auto", longer elements there, or a larger '
    "[dynamics] fragment_mass.",
    "A fragment has a smaller mass than the node that it splits off, and so a higher frequency. A larger "
    "fragment_mass lowers it.",
)

# --- values that no roof has

IMPLAUSIBLE_SECTION = Message(
    "W421",
    "{value} of {elements}: implausible for {kind} ({low:g} to {high:g}). {example}",
    "The value lies outside the range of the materials and sections of cables and bars. Most often the unit "
    "is wrong: keys and columns without a unit are in SI units.",
)
IMPLAUSIBLE_LOAD = Message(
    "W422",
    "{value}: implausible for roofs ({low:g} to {high:g}). {example}",
    "The magnitude of the value lies outside the range of roofs. The key may be set in its section, in a "
    "zone, a case or a stage. Most often the unit is wrong: keys without a unit are in SI units.",
)
IMPLAUSIBLE_TABLE = Message(
    "W423", "{table}: {value}: implausible for roofs ({low:g} to {high:g}). {example}"
)
IMPLAUSIBLE_FACTOR = Message(
    "W424",
    '[[combination]] "{combination}": factors: {name} = {factor:g}: implausible (codes give 0 to 2). '
    "Check the factor.",
)
HIGH_MASS_DAMPING = Message(
    "W425",
    "[dynamics] mass_damping = {damping:g} 1/s: implausible (up to {limit:g}). Each mode has the damping "
    "ratio mass_damping x period / (4 pi): see the modes in netfall check.",
)
IMPLAUSIBLE_WAVE_SPEED = Message(
    "W426",
    "stiffness and mass of {elements}: axial waves run along them at {speed:.4g} m/s (in steel: 5000 m/s). "
    "Check the units: axial_stiffness is in N, mass_per_length in kg/m.",
    "The speed of axial waves is the square root of stiffness over mass per length. It is the same for thin "
    "and thick cables of one material.",
)
IMPLAUSIBLE_BREAKING_STRAIN = Message(
    "W427",
    "breaking_load = {load:g} N of {elements}: a strain of {strain:.2g}, at which no cable breaks. "
    "Check the unit: the key is in N. Leave it out for an element that never breaks.",
)
IMPLAUSIBLE_EXTENT = Message(
    "W428",
    "[net]: the net is {size:.4g} m from end to end (plausible: {low:g} to {high:g} m). Check [net] unit, "
    "the unit of the coordinates.",
)
LOW_PRESTRESS = Message(
    "W429",
    "prestress of up to {force:g} N is a strain of at most {strain:.2g} (plausible: from {limit:g}). "
    "Check the unit: the value may be in kN.",
)
NO_ROW_IN_DURATION = Message(
    "W430",
    "{table}: no row between 0 and duration = {duration:g} s. Check the unit of the times: s.",
)
LOAD_WITHOUT_MASS = Message(
    "W431",
    "load_z of {nodes}: {weight:.4g} N downward without mass. Loads of nodes have no inertia, so "
    "periods are too short if these are weights. Give their mass, {mass:.4g} kg in all, in column mass.",
    "A load of a node is a force. If it is the weight of a lamp, a walkway or equipment, its mass takes "
    "part in the motion, and periods grow with it.",
)
MASS_WITHOUT_LOAD = Message(
    "W432",
    "column mass of {nodes}: {mass:.4g} kg without weight, since self_weight is that of elements. If the "
    "mass hangs there, give its weight, -{weight:.4g} N in all, in column load_z.",
    "Column mass gives only inertia, for example added mass of air or water. A mass that "
    "hangs on the net needs its weight as a load too.",
)
IMPLAUSIBLE_WEIGHT = Message(
    "W433",
    "load_z and mass of {nodes}: {load:.4g} N downward, but {mass:.4g} kg weigh {weight:.4g} N. "
    "Check the units: loads may be in kN, masses in t.",
)
START_STRAIN = Message(
    "W434",
    "elements that start {state} by more than {limit:.0%} of their unstressed length: {count}, most of all "
    "element {element} with a strain of {strain:.3g}. " + UNITS_HINT,
    "The unstressed length, the prestress or the stiffness of the element is in another unit, or one of "
    "its end nodes is wrong.",
)
STARTS_BEYOND_LIMIT = Message(
    "E435",
    "{path}: {elements}: beyond {name} at the start: {value:.4g} in element {element} at a length of "
    "{length:.6g} m, allowed {limit:.4g}, with EA = {stiffness:kN}. Reduce the forces of the form, "
    "[[target]] and [[stage]], or check the units of modulus (Pa), area (m2), prestress (N) and "
    "unstressed_length (m).",
    "The start is the state after form finding, targets, length errors and the last stage of erection. A "
    "breaking_load over EA counts as fracture_strain.",
)
BELOW_WIND_PROFILE = Message(
    "W436",
    "{place} base_height = {base_height:g}: nodes in the wind less than {lowest:g} m above ground: {count}; "
    "the lowest is node {node} at {height:.4g} m. They get the speed at {lowest:g} m. "
    "Check base_height, the height of z = 0 above ground.",
    "The power law of the wind profile ends near the ground. The speed below is not known; netfall uses that "
    "at the lowest height.",
)
FAR_POINTS = Message(
    "W437",
    "{place}: {count} of {total} {kind} lie far outside the roof, the farthest at x, y = {x:g}, {y:g} m by "
    "{distance:.4g} m. The net extends from {low} to {high} m. Give x and y in m, in the axes of the net.",
    "The points of this table are in metres, independent of [net] unit. A point far from the roof counts as "
    "much as others if it is among the four nearest.",
)
EQUALLY_NEAR_POINTS = Message(
    "W438",
    "{place}: {nodes}: five or more {kind} are equally near. Four of them count, by their order in the "
    "table. Add one at the node.",
    "A node takes the values of its four nearest points. If five are equally near, rounding or the order "
    "of rows decides, so the value at the node is arbitrary.",
)
SUBDIVIDED_BARS = Message(
    "W439",
    "[net] subdivide: {elements}: compressed bars without bending stiffness buckle at the nodes between "
    "their parts. Set subdivide = 1, or bending = true for these bars.",
    "A bar that is divided without bending stiffness is a chain of hinges, a mechanism under compression.",
)

# --- axial forces of the initial state

CABLE_COMPRESSED = Message(
    "E441",
    "{path}: element {element}: axial force {force:kN} in the initial state, but a cable carries no "
    'compression. Set kind = "bar" for its group.',
    "Form finding with negative prestress or force density gives compression. Only bars can carry it.",
)
ABOVE_YIELD_FORCE = Message(
    "E442",
    "{path}: element {element}: axial force {force:kN} in the initial state, above the yield force "
    "{limit:kN}. Lower the prestress or increase the area.",
)
BEYOND_EULER_LOAD = Message(
    "E443",
    "{path}: element {element}: axial force {force:kN} in the initial state, beyond the Euler load "
    "{limit:kN}. Choose a stiffer section.",
    "The Euler load is pi^2 EI / l^2 with the length of the element, or its buckling_length. A bar that "
    "is held laterally has a shorter buckling length.",
)
ABOVE_BREAKING_FORCE = Message(
    "E444",
    "{path}: element {element}: axial force {force:kN} in the initial state, above the breaking force "
    "{limit:kN}. Lower the prestress or choose a stronger cable.",
)
BEYOND_STIFFNESS = Message(
    "E445",
    "{path}: element {element}: axial force {force:kN} in the initial state, beyond its axial stiffness "
    "EA = {limit:kN}. Increase the area.",
)
FORM_COLLAPSED = Message(
    "E446",
    "{path}: [form_finding]: the form has collapsed: element {element} (nodes {nodes}) is {length:.3g} m "
    "long, {given:.4g} m as given. Fix more nodes, or give prestresses or force densities that hold the free "
    "nodes apart.",
    "If no tension pulls a free node outwards, the form shrinks until an element has no length. The axial "
    "forces of such a form have no meaning.",
)

# --- given, and without effect

KEYS_WITHOUT_EFFECT = Message(
    "N451",
    "[{section}] {keys}: no effect: {reason}.",
    "The key is read, but nothing in this job uses it. Remove it, or add the feature that uses it.",
)
LIMITS_NOT_CHECKED = Message(
    "W473", '[limits]: not checked: there is no combination of kind = "SLS". Add service combinations.'
)
REMOVAL_AFTER_END = Message(
    "N452",
    "[[remove]] {number}: no effect: time = {time:g} is not before the end (duration = {duration:g} s).",
)
LOAD_NOT_APPLIED = Message(
    "W453",
    "[load]: no effect: steps = 0 and there is no [dynamics]. Set steps = 1 for the equilibrium under it.",
)
NODE_LOADS_NOT_APPLIED = Message(
    "W454",
    "columns load_x, load_y, load_z: no effect: neither load steps nor [dynamics]. Set [load] steps = 1.",
)
NOTHING_LOADS = Message(
    "N455", "elements can break, but no wind, load, temperature or removal acts on the net."
)
WIND_WITHOUT_EFFECT = Message("N456", "[wind]: no effect: pressure_coefficient = 0.")
DIRECTION_IGNORED = Message(
    "N457",
    "[wind] direction = {direction:g} ({origin}): the pressure coefficients do not depend on it. For "
    "coefficients by direction give a table, sectors.",
    "The mean wind acts along the normals of the roof. Its direction changes the forces only through the "
    "coefficients; for gusts it also sets the axes of their coherence.",
)
MISSPELT_GROUPS = Message(
    "W458",
    "{groups}: no section has this name, so the elements have the values of [cable]. If {sections} is meant, "
    "correct the name in the table.",
    "Elements of a group without a section take the values of [cable], without an error. A capital letter "
    "or a typing error is enough.",
)
NO_WIND_ON_DIAMETERS = Message(
    "W470",
    "[wind] pressures: no wind acts on the elements with a diameter. Pressures at taps give no wind speed at "
    "cables; give their wind as a table, [load] load_table, or in a case with wind.speed.",
)
NO_WIND_ON_ROOF = Message(
    "W472",
    "{places}: pressure_coefficient: missing, so the wind acts only on the elements with a diameter, not on "
    "the {area:.4g} m2 of roof. Give it, or pressure_coefficient = 0 for a net without cladding.",
)
UNUSED_DIAMETER = Message("N471", "diameter: no effect: neither wind nor ice acts in this job.")
UNUSED_ZONE = Message(
    "N459", "zone {name}: no effect: neither [wind] nor [load] nor a case has a value for it."
)
ZONE_WITHOUT_AREA = Message(
    "W460",
    "zone {name}: no effect: its nodes have no roof area, on which its values act. Its loads are not "
    "applied. Check [roof] groups and openings, which select the faces of the roof.",
)
SNOW_ON_UPRIGHT = Message(
    "N466",
    "snow: no effect: it acts on the area in plan, and the {area:.4g} m2 of roof are vertical. Give a load "
    "of snow or ice at their edges as loads of nodes.",
)
UNUSED_FORCE_DENSITY = Message(
    "N461", "column force_density: no effect: there is no form finding by force density."
)
UNUSED_PRESTRESS = Message("N462", "prestress: no effect: every element has {column}.")
MASS_WITHOUT_DYNAMICS = Message(
    "N463",
    "column mass: no effect: it is inertia without weight, and there is neither [dynamics] nor [modes].",
)
MASS_ON_HELD_NODES = Message("N467", "column mass of {nodes}: no effect: held along all axes.")
UNUSED_ANGLE = Message(
    "N464", "column angle of {count:node}: no effect: the support is the same along both axes in plan."
)
UNUSED_YIELD_STRESS = Message(
    "N465",
    "yield_stress of {count:element}: no effect: element {element} breaks at a strain of {fracture:g}, "
    "before it yields at {yielding:.3g}.",
    "The fracture strain is below the yield strain. Fracture strains are total strains: they include the "
    "elastic part.",
)
