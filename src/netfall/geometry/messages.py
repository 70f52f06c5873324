"""Messages of the package `geometry`: tables, generators, sections, bars, slip points, roof, zones."""

from netfall.core.messages import Message

# tables of nodes and elements
SAME_NODE = Message("E201", "{row}: start and end are both node {node}. Give two different nodes.")
NO_SUCH_NODE = Message("E202", "{row}: {name} = {number}: no such node in {nodes}. Give the id of one.")
DUPLICATE_NODE_ID = Message("E203", "{row}: id = {number}: {first} has this id already. Ids are unique.")
DUPLICATE_ELEMENT_ID = Message("E204", "id = {number}: occurs {count} times. Ids are unique.")
WRONG_SHARES = Message(
    "E205",
    "{row}: zone_share = {cell!r} of zone = {zone!r}: expected a share above 0 for each zone, at most 1 in "
    'total, as in "0.25/0.5" of "edge/drift"',
)
LENGTHS_IN_NET_UNIT = Message(
    "E206",
    "{path}: column unstressed_length: these are the lengths of the elements in {unit}; expected m. [net] "
    "unit applies only to the coordinates.",
    "Unstressed lengths are in m, or in the unit that the row below the header names. The median of the "
    "column matches the distances of the nodes in the unit of the coordinates.",
)
NORMAL_COLUMN_MISSING = Message(
    "E207", "columns normal_x, normal_y, normal_z: one is missing. Give all three, or none."
)
INCOMPLETE_NORMAL = Message(
    "E208", "{row}: normal_x, normal_y, normal_z: expected three numbers, or all empty"
)
WRONG_NORMAL = Message(
    "E209", "{row}: normal = ({normal}): expected the upward normal, normal_z >= 0, not all 0"
)
PARALLEL_ELEMENTS = Message(
    "W210",
    "several elements join the same two nodes ({elements}). They count as parallel cables, and as one "
    "edge of the roof. Remove duplicates.",
    "Elements between the same nodes add their stiffness, mass and strength. If a drawing has the same line "
    "twice, the net is too stiff.",
)
CLOSE_NODES = Message(
    "W211",
    "nodes lie close to each other and are not joined ({pairs}). If two were meant as one, keep one of them.",
    "Elements that end at two close nodes do not act on each other. Drawings often have such gaps where "
    "lines should meet; the option --tolerance of netfall import closes them.",
)
LOOSE_ENDS = Message(
    "W238",
    "{nodes}: free, with one element only{beside}. Form finding pulls such an end to the other end of its "
    "element. Fix it, or join it to another node.",
    "Nothing balances the force of a single element at a free node. Usually a support is missing, for "
    "example at the foot of a mast, or the element ends next to the node that was meant.",
)

# net as a whole
TOO_MANY_ELEMENTS = Message(
    "E212",
    "{path}: [net] subdivide = {parts}: gives {number:.3g} elements; at most {most:.0e} fit. Decrease it.",
)
HELD_SUBDIVISION = Message(
    "W213",
    "[net] subdivide: {elements} between two fixed nodes: the new nodes are fixed too. Loads there go "
    "into the supports, and do not change the axial force.",
    "Such an element closes a face of the roof or stays in place, so subdivision must not let it sag. A "
    "cable that is to hang freely needs a node of nodes.csv between its ends.",
)
NO_ELEMENT_OF_GROUP = Message("E214", "[{section}.{name}]: no element is of this group; {suggestion}")
NO_GROUP_MATCHES = Message("E215", "[{section}.{name}]: no group matches this pattern; {suggestion}")
UNKNOWN_GROUP_IN_LIST = Message("E216", "groups: no element is of group {name}; {suggestion}")
UNKNOWN_GROUP = Message("E217", "no such group of elements; {suggestion}")
UNKNOWN_CABLE = Message("E218", "no cable {name}; {suggestion}")
NO_LENGTH = Message(
    "E219",
    "element {element} between nodes {start} and {end} has no length. Merge nodes that coincide.",
    "Two nodes with the same position, or an element drawn as a point. An element without length has no "
    "direction.",
)
UNUSED_NODE = Message("E220", "node {node} belongs to no element. Remove it or connect it.")
NO_SUPPORT = Message(
    "E221",
    "the part of the net with node {node} ({count:node}) has no {support}. Fix one of its nodes; form "
    "finding and statics need it.",
    "Without a support nothing balances the loads, and the part may move as a whole. A spring counts as a "
    "support.",
)
COMPRESSED_CABLE = Message(
    "E222",
    "element {element}: prestress = {force:g}: a cable carries no compression. Give a value >= 0, or "
    'kind = "bar" for its group.',
)
PRESTRESS_ABOVE_YIELD = Message(
    "E223",
    "element {element}: prestress = {force:g} N: above the yield force {limit:g} N. Lower it, or increase "
    "the area.",
)
NO_PRESTRESS = Message(
    "E224",
    '[form_finding] method = "fpm": no element that can move has a prestress. Give prestress > 0 in '
    '[cable] or as a column, or method = "force_density" with a column force_density.',
    "Without tension every shape is in equilibrium, so there is no form to find.",
)
SPRING_ON_FIXED_AXIS = Message(
    "E226",
    "node {node}: spring_{axis} = {stiffness:g}: the axis is fixed too. Keep one of the two.",
    "fixed holds an axis rigidly, so a spring along it has no effect. A node may be fixed along one axis "
    "and on a spring along another.",
)
ANGLE_NOT_SUPPORTED = Message(
    "E227",
    "angle: {nodes}: {key} does not support rotated supports. Set angle = 0 there, make both axes in plan "
    "alike, or remove {key}.",
)
CABLE_NAME_TAKEN = Message(
    "E228",
    "cable = {name}: a cable without a name has this name, from the lowest id of its elements. Rename one of "
    "the two.",
)
LARGE_DISPLACEMENT_LIMIT = Message(
    "W229",
    "[{place}] displacement = {value:g} m: more than the largest dimension of the net ({size:.4g} m), so it "
    "limits nothing. Check the unit.",
    'A bare number is in m. For 400 mm write displacement = 0.4 or displacement = "400 mm".',
)

# generators
TOO_MANY_GENERATED = Message("E230", "{key} = {value:g}: gives {number:.3g} elements; at most {most:.0e} fit")
WIDE_SPACING = Message(
    "E231", "spacing = {value:g}: expected at most {most:g} m, a quarter of the shorter axis"
)
SPOKES_NOT_BY_FOUR = Message(
    "E232", "spokes = {value:g}: expected a multiple of 4, for supports a quarter of the ring apart"
)
LARGE_OPENING = Message("E233", "opening = {value:g}: expected less than diameter = {diameter:g} m")
LARGE_BRACE_FORCE = Message(
    "E234",
    "brace_force = {value:g}: expected less than {most:.4g} N, above which the diagonals leave the tension "
    "rings slack",
)
CLOSE_RINGS = Message(
    "E235",
    "hoops = {value}: the rings are too close for {spokes} spokes. Decrease hoops, or increase spokes.",
    "No cable of the dome may be in compression. Therefore each ring must lie inside the polygon of the next "
    "larger one: its radius is at most cos(pi / spokes) of that.",
)
SHORT_STRUT = Message(
    "E237",
    "strut = {value:g}: expected more than {fall:.4g} m, by which the ridge falls from one ring to the next",
)

# sections and strengths
UNKNOWN_TYPE = Message(
    "E240",
    "type = {name}: no such type in the catalogue; {suggestion}",
    "type names a row of the table that [cable] catalogue names, by its column name.",
)
TYPE_WITHOUT_CATALOGUE = Message(
    "E241", "type = {name}: there is no catalogue. Add catalogue = a path to [cable]."
)
DUPLICATE_TYPE = Message("E242", "{row}: name = {name!r}: expected a name that occurs once")
WEAKER_THAN_PRESTRESS = Message(
    "E243",
    "{element}: breaking_load = {strength:.7g} N{drawn}: below its prestress {force:g} N. Lower the "
    "prestress, or choose a stronger cable.",
)
BREAKING_ABOVE_YIELD = Message(
    "E244",
    "{element}: breaking_load = {strength:.7g} N{drawn}: above the yield force {limit:g} N, which the "
    "tension never exceeds. Lower it, or add fracture_strain.",
    "The material yields at constant force, so the tension never reaches a higher breaking force. With "
    "fracture_strain the element breaks at that strain while it yields.",
)
BRITTLE_BAR = Message(
    "E245",
    "{element}: breaking_load = {strength:.7g} N{drawn}: below the yield force {limit:g} N of a bar. Remove "
    "yield_stress, raise breaking_load, or set buckling = true.",
    "A bar may yield in compression before it breaks in tension, which netfall does not compute for such "
    "a bar. With buckling = true it breaks by its strength both ways.",
)
MASS_SCALING_WITH_FRAGMENTS = Message(
    "E246",
    "[dynamics] mass_scaling = {value:g}: a fragment would keep the added inertia as mass. Set "
    "fragments = false, or remove the strengths.",
)
INHERITED_YIELD_STRESS = Message(
    "W247",
    "[group.{name}]: {bars} with yield_stress = {value:g} Pa from [cable], where it is that of cables. Give "
    "that of bars in [group.{name}].",
    "[cable] describes cables, whose yield stress is far above that of the steel of bars. The bars would "
    "yield too late.",
)
UNLIMITED_BARS = Message(
    "W248",
    "{bars}{group} without a strength, while others can break: nothing yields or breaks there. Give "
    "yield_stress, breaking_load or fracture_strain.",
    "The breaking force of [cable] applies only to cables. Without a separate strength these bars carry any "
    "force.",
)
SEED_WITHOUT_SCATTER = Message("N249", "[cable] {seed}: no effect: {scatter} = 0.")
SCATTER_WITHOUT_STRENGTH = Message("N250", "strength_cov: no effect: no cable has a strength.")
NOMINAL_YIELD_STRESS = Message(
    "W251",
    "yield_stress of element {element} and others without area: acts on the area of steel of the same mass, "
    "{area:.4g} m2. Give the metallic area, in [cable] or in the catalogue.",
)
UNUSED_CATALOGUE = Message("N252", "[cable] catalogue: no effect: no cable has a type.")

# bars
KEY_OF_BARS = Message(
    "E255",
    '[group.{name}] {key} = {value}: only for bars; a cable carries no compression. Set kind = "bar", or '
    "remove the key.",
)
MOMENT_WITHOUT_MODULUS = Message(
    "E256",
    "element {element}: second_moment = {value:g}: needs the modulus, which axial_stiffness alone does "
    "not give. Add modulus or area.",
)
NO_SECOND_MOMENT = Message(
    "E257", "element {element}: {key}: needs second_moment [m4]. Add it, or remove {key}."
)
BENDING_AND_BUCKLING = Message(
    "E258",
    "element {element}: bending and buckling exclude each other. Keep one of them.",
    "A chain of bars that bend buckles by itself, at the load that follows from its bending stiffness. "
    "buckling = true limits the compression of a single bar to its Euler load instead.",
)
BENDING_BARS_NOT_ACTIVE = Message(
    "E259",
    "[[stage]] {stages}: the stage leaves out bars that bend. Name their groups in active, or remove "
    "bending = true.",
)
TARGETS_WITH_BENDING = Message(
    "E260", "[[target]]: not possible with bars that bend. Remove the targets, or bending = true."
)
LENGTH_ERRORS_WITH_BENDING = Message(
    "E261", "[cable] length_std: not possible with bars that bend. Remove it, or bending = true."
)
BREAKABLE_BENDING = Message(
    "E262",
    "element {element}: bending = true, and it can break. netfall computes no fracture of bars that bend. "
    "Give strengths only to the groups of cables, and yield_stress here.",
    "fracture_strain or breaking_load in [cable] applies to all groups. Give these keys in the groups of "
    "cables.",
)
BAR_KEY_WITHOUT_MOMENT = Message("N263", "{key}: no effect: no bar has a second_moment.")
LARGE_SECOND_MOMENT = Message(
    "W264",
    "second_moment = {value:g} m4 of {elements}: implausible for an area of {area:g} m2, with a radius of "
    "gyration of {radius:.4g} m. Check the unit: mm4 or cm4?",
)
NO_BENDING_CHAIN = Message(
    "W265",
    "bending: no effect: nowhere do exactly two bars with bending of one group or cable meet. Set [net] "
    "subdivide, or add nodes along a bar.",
    "Bending acts between bars that continue each other. A bar without a neighbour of its group, or of "
    "its name in the column cable, is straight and has no bending moment.",
)

# slip points
ALREADY_SLIPS = Message(
    "E266", "node {node}: entry {entry} lets this cable slip there already. Keep one of the two."
)
NOTHING_SLIPS = Message(
    "E267",
    "nothing slips: nowhere do exactly two of these elements meet",
    "A cable slips over a node where exactly two of its elements meet. Where more elements of the group "
    "meet, the column cable of elements.csv tells which of them continue each other.",
)
NO_CABLE_THROUGH = Message(
    "E268",
    "nodes: {nodes}: no cable of this entry runs through, where exactly two of its elements meet. Name "
    "cables in the column cable, or remove the nodes.",
)
TWO_CONTINUATIONS = Message(
    "E269", "element {elements}: two entries continue it differently. Name cables in both."
)
CROWDED_NODE = Message(
    "E270",
    "{nodes}: more than {most} cables slip there. Name fewer in nodes or cables.",
    "The solver keeps at most three slips for each node. Clamp some of the cables, or divide the node into "
    "several.",
)
UNKNOWN_NODES = Message("E271", "nodes: no node {nodes}; give ids of nodes.csv")
BARS_SLIP = Message("E272", '{name}: {elements}: bars do not slip. Expected kind = "cable".')
YIELDING_SLIPS = Message(
    "E273",
    "{name}: {elements}: a cable that slips cannot yield. Remove yield_stress of this group; fracture_strain "
    "and breaking_load are allowed.",
)

# faces and areas of the roof
ROOF_REMEDY = (
    "Name in [roof] groups the groups that carry the roof, correct the drawing, give [roof] normal for a "
    "facade, or area, normal_x, normal_y, normal_z in nodes.csv."
)
STACKED_NODES = "{count} of nodes lie above one another in plan: {pairs}"
UPRIGHT_PLANE = (
    "{reason}. The nodes lie in a vertical plane. Give the outward direction, [roof] normal = [{x:.4g}, "
    "{y:.4g}, {z:.4g}], or the opposite"
)
CROSSINGS = (
    "{count} of elements ({pairs}) cross in plan without a node, the first at x, y = {x:.4g}, {y:.4g} m"
)
LOOSE_RING = (
    "nothing connects the ring of nodes ({inside}) to the face of the roof around it (nodes {outside})"
)
UNCLEAR_FACES = Message(
    "E274",
    "{reason}. " + ROOF_REMEDY,
    "netfall finds the faces of the roof in plan. Elements of two layers, or elements that cross without "
    "a node, leave it open which of them carry the roof.",
)
NO_FACES = Message(
    "N275",
    "the net has no faces: {reason}. Loads on areas would be refused.",
    ROOF_REMEDY,
)
UNCONNECTED_RING = Message(
    "E276",
    LOOSE_RING + ". Join them by elements or [roof] lines, or leave out the group in [roof] groups.",
    "It is not known what lies between the two rings: an opening, or panels whose edges are not elements.",
)
LOOSE_RING_NOTE = Message("N277", LOOSE_RING + ".")
WRONG_OPENING = Message(
    "E278",
    "[roof] openings: [{x:g}, {y:g}] lies in no face of the net in plan; expected a point [x, y] in m "
    "inside the face that is left out",
    "An opening is a point inside a closed ring of elements, whose face then carries no load.",
)
NO_CLOSED_FACE = Message(
    "E279",
    "{path}: the net has no closed face in plan, so loads on areas act on nothing. Close the outline by "
    "elements between the supports, or give `area` in nodes.csv.",
)
GIVEN_AREAS = Message("N280", "areas and normals of the roof are those of nodes.csv")
NODES_WITHOUT_AREA = Message(
    "W281",
    "{count} free nodes ({nodes}) carry no roof area. Loads on areas do not act there. Close the faces "
    "around them, or give `area` in nodes.csv.",
    "A node gets the areas of the faces around it. Nodes of masts and of lower layers have none by "
    "intention; name the roof's groups in [roof] groups to avoid the warning.",
)
UNUSED_LINES = Message(
    "W282",
    "[roof] lines: edges that bound no face: {count} ({lines}). Complete the faces; loads act only on faces.",
)
OPEN_RIM = Message(
    "W283",
    "elements continue beyond the faces at {count} free nodes ({nodes}). Closed faces cover {share:.1%} of "
    "the outline in plan. If the roof extends to the supports, close it by elements between them.",
    "netfall puts loads only on closed faces. Without edge elements, or edges in [roof] lines, the "
    "outermost strip of the roof has no faces and carries no load.",
)
NODES_WITHIN_ELEMENTS = Message(
    "W284",
    "nodes that lie within elements in plan, and not at their ends: {count} ({nodes}). They count as corners "
    "of the roof there. If they belong to another layer, set [roof] groups.",
    "The drawing may lack a connection: the element passes the node and they do not act on each other. Split "
    "the element at the node if they are connected.",
)
STEEP_ROOF = Message(
    "W239",
    "the roof is steep, {plan:.4g} m2 in plan of {surface:.4g} m2 of surface. The side that looks up counts "
    "as the outer one. Give [roof] normal, the outward direction.",
    "Pressure and wind act on the outer side, whose normals look upward unless [roof] normal is given. A "
    "facade that leans inward by a degree has another upper side than one that leans outward.",
)

# table of faces
FACES_AND_OTHERS = Message(
    "E285",
    "{path}: [roof] faces and {keys} exclude each other. Keep one of the two; the table defines all faces.",
)
FACE_POINT_MISSING = Message(
    "E286", "{row}: node is empty; expected an id, or x, y, z of a point without a node"
)
SCATTERED_FACE = Message("E287", "face = {face}: its rows are not consecutive. Put them one after another.")
WRONG_RING = Message(
    "E288", "face = {face}: ring = {ring}; expected 0 for the outer ring, then its holes from 1"
)
UPRIGHT_FACES = Message(
    "E289",
    "faces seen edge-on from {side}: {count}, the first is face = {face} ({plan:.4g} m2 seen, "
    "{surface:.4g} m2 of surface). Give [roof] normal, the outward direction.",
    "The order of the corners defines the outer side of a face: anticlockwise, seen from [roof] normal. "
    "Without the key it is seen from above. One direction serves several surfaces: [0, -1, 1] sees a canopy "
    "and a facade whose outer side faces -y.",
)
WRONG_CORNERS = Message(
    "E290",
    "face = {face}: {problem}; expected three corners or more, each once, in order around the face, and "
    "holes inside it",
)
WRONG_TURN = Message("E291", "face = {face}: {area:.4g} m2 in plan; expected {corners}, seen from {side}")
OVERLAPPING_FACES = Message(
    "W292",
    "{table}: faces overlap (pairs: {count}, the first face = {first} and {second} by {area:.4g} m2). Loads "
    "on areas count twice there. Correct their corners.",
    "Two faces of one surface must not cover each other. Surfaces above one another do not overlap.",
)

# zones
WRONG_POLYGON = Message(
    "E293", "polygon: {problem}; expected corners in order around an area, without sides that cross"
)
ZONE_IN_COLUMN = Message(
    "E294", "the column zone of nodes.csv has nodes of this zone already. Give only the name."
)
CUT_AND_SHARES = Message(
    "E295",
    "cut = true (the default) and the column zone_share of nodes.csv exclude each other. Set cut = false, or "
    "remove the column.",
    "zone_share gives the shares of each node in its zones; a cut would compute them from the polygon. Both "
    "cannot hold.",
)
ZONE_WITHOUT_NODES = Message(
    "E296",
    "polygon or groups: missing. A zone without them must be in the column zone of nodes.csv; {suggestion}",
)
UNKNOWN_ZONE = Message("E297", "{place}: there is no zone {name}; {suggestion}")
EMPTY_ZONE = Message(
    "W298", "zone {name}: no node lies in it. Its values act nowhere. Check its polygon, in m in plan."
)
COVERED_ZONE = Message(
    "W236",
    "zone {name}: later zones ({others}) cover {lost:.0%} of it. Its values ({values}) do not act there. "
    "Give the later zones these values, or change their order or polygons.",
    "A node in several zones belongs to the last of them, with all loads.",
)
INEXACT_ZONE = Message(
    "W299",
    "zone {name}, start geometry: of its {area:.4g} m2 in plan {outside:.4g} m2 ({share:.1%}) lie outside "
    "its polygon; {remaining:.4g} m2 inside do not belong to it. Set cut = true.",
    "With cut = false a zone takes nodes with their whole area. cut = true takes the part of each area that "
    "lies inside the polygon.",
)
CUT_WITHOUT_FACES = Message("N200", "zone {name}: cut: no effect: the net has no faces.")
