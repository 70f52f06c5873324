"""Messages of the package `geometry`: tables, generators, sections, bars, slip points, roof, zones."""

from netfall.core.messages import Message

# tables of nodes and elements
SAME_NODE = Message("E201")
NO_SUCH_NODE = Message("E202")
DUPLICATE_NODE_ID = Message("E203")
DUPLICATE_ELEMENT_ID = Message("E204")
WRONG_SHARES = Message("E205")
LENGTHS_IN_NET_UNIT = Message("E206")
NORMAL_COLUMN_MISSING = Message("E207")
INCOMPLETE_NORMAL = Message("E208")
WRONG_NORMAL = Message("E209")
UPWARD_NORMAL = "upward normal, normal_z >= 0"
OUTWARD_NORMAL = "outward normal, on the side to which [roof] normal points"
PARALLEL_ELEMENTS = Message("W210")
CLOSE_NODES = Message("W211")
LOOSE_ENDS = Message("W238")

# net as a whole
TOO_MANY_ELEMENTS = Message("E212")
HELD_SUBDIVISION = Message("W213")
NO_ELEMENT_OF_GROUP = Message("E214")
NO_GROUP_MATCHES = Message("E215")
UNKNOWN_GROUP_IN_LIST = Message("E216")
UNKNOWN_GROUP = Message("E217")
UNKNOWN_CABLE = Message("E218")
NO_LENGTH = Message("E219")
UNUSED_NODE = Message("E220")
NO_SUPPORT = Message("E221")
COMPRESSED_CABLE = Message("E222")
PRESTRESS_ABOVE_YIELD = Message("E223")
NO_PRESTRESS = Message("E224")
SPRING_ON_FIXED_AXIS = Message("E226")
ANGLE_NOT_SUPPORTED = Message("E227")
CABLE_NAME_TAKEN = Message("E228")
LARGE_DISPLACEMENT_LIMIT = Message("W229")

# generators
TOO_MANY_GENERATED = Message("E230")
WIDE_SPACING = Message("E231")
SPOKES_NOT_BY_FOUR = Message("E232")
LARGE_OPENING = Message("E233")
LARGE_BRACE_FORCE = Message("E234")
CLOSE_RINGS = Message("E235")
SHORT_STRUT = Message("E237")

# sections and strengths
UNKNOWN_TYPE = Message("E240")
TYPE_WITHOUT_CATALOGUE = Message("E241")
DUPLICATE_TYPE = Message("E242")
WEAKER_THAN_PRESTRESS = Message("E243")
BREAKING_ABOVE_YIELD = Message("E244")
BRITTLE_BAR = Message("E245")
MASS_SCALING_WITH_FRAGMENTS = Message("E246")
INHERITED_YIELD_STRESS = Message("W247")
UNLIMITED_BARS = Message("W248")
SEED_WITHOUT_SCATTER = Message("N249")
SCATTER_WITHOUT_STRENGTH = Message("N250")
NOMINAL_YIELD_STRESS = Message("W251")
UNUSED_CATALOGUE = Message("N252")

# bars
KEY_OF_BARS = Message("E255")
MOMENT_WITHOUT_MODULUS = Message("E256")
NO_SECOND_MOMENT = Message("E257")
BENDING_AND_BUCKLING = Message("E258")
BENDING_BARS_NOT_ACTIVE = Message("E259")
TARGETS_WITH_BENDING = Message("E260")
LENGTH_ERRORS_WITH_BENDING = Message("E261")
BREAKABLE_BENDING = Message("E262")
BAR_KEY_WITHOUT_MOMENT = Message("N263")
LARGE_SECOND_MOMENT = Message("W264")
NO_BENDING_CHAIN = Message("W265")

# slip points
ALREADY_SLIPS = Message("E266")
NOTHING_SLIPS = Message("E267")
NO_CABLE_THROUGH = Message("E268")
TWO_CONTINUATIONS = Message("E269")
CROWDED_NODE = Message("E270")
UNKNOWN_NODES = Message("E271")
BARS_SLIP = Message("E272")
YIELDING_SLIPS = Message("E273")

# faces and areas of the roof
STACKED_NODES = "{count} of nodes lie above one another in plan: {pairs}"
UPRIGHT_PLANE = (
    "{reason}. The nodes lie in a vertical plane. Give the outward direction, [roof] normal = [{x:.4g}, "
    "{y:.4g}, {z:.4g}], or the opposite"
)
CROSSINGS = (
    "{count} of elements ({pairs}) cross in plan without a node, the first at x, y = {x:.4g}, {y:.4g} m"
)
UNCLEAR_FACES = Message("E274")
NO_FACES = Message("N275")
UNCONNECTED_RING = Message("E276")
LOOSE_RING_NOTE = Message("N277")
WRONG_OPENING = Message("E278")
NO_CLOSED_FACE = Message("E279")
GIVEN_AREAS = Message("N280")
NODES_WITHOUT_AREA = Message("W281")
UNUSED_LINES = Message("W282")
OPEN_RIM = Message("W283")
NODES_WITHIN_ELEMENTS = Message("W284")
STEEP_ROOF = Message("W239")

# table of faces
FACES_AND_OTHERS = Message("E285")
FACE_POINT_MISSING = Message("E286")
SCATTERED_FACE = Message("E287")
WRONG_RING = Message("E288")
UPRIGHT_FACES = Message("E289")
WRONG_CORNERS = Message("E290")
WRONG_TURN = Message("E291")
OVERLAPPING_FACES = Message("W292")

# zones
WRONG_POLYGON = Message("E293")
ZONE_IN_COLUMN = Message("E294")
CUT_AND_SHARES = Message("E295")
ZONE_WITHOUT_NODES = Message("E296")
UNKNOWN_ZONE = Message("E297")
EMPTY_ZONE = Message("W298")
COVERED_ZONE = Message("W236")
INEXACT_ZONE = Message("W299")
CUT_WITHOUT_FACES = Message("N200")
