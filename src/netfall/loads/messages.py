"""Messages of the package `loads`: motion of supports, member removals, static cases, wind and its tables."""

from netfall.core.messages import Message

# --- motion of supports

UNKNOWN_MOTION_NODES = Message(
    "E301", "{path}: [[motion]] {number}: nodes: the net has no node {ids}. Give ids of its nodes."
)
FREE_MOTION_NODES = Message(
    "E302",
    "{path}: [[motion]] {number}: nodes: {ids}: free along all axes, and only supports can be moved. "
    "Hold these nodes (fixed) or leave them out.",
)
SPRUNG_MOTION_NODES = Message(
    "E303",
    "{path}: [[motion]] {number}: nodes: {ids}: on springs, whose feet cannot be moved. "
    "Replace each spring by an element of its stiffness, and move the support of that element.",
    "A spring support connects a node to the ground of the model, which does not move. An element to a "
    "support that moves gives the same stiffness.",
)
ROTATED_MOTION_NODES = Message(
    "E304",
    "{path}: [[motion]] {number}: nodes: {ids}: supports with an angle cannot be moved. "
    "Set their angle to 0 or leave them out.",
)
NO_SUPPORTS_TO_MOVE = Message(
    "E305", "{path}: [[motion]] {number}: the net has no supports. Hold nodes (fixed) or remove [[motion]]."
)
HALF_MOVED_ELEMENTS = Message(
    "W306",
    "[[motion]] {number}: {elements} between a support that moves and one that does not: the nodes of [net] "
    "subdivide there do not move. The part at the moving end has the whole elongation. Move both supports or "
    "set subdivide = 1.",
    "netfall holds the inner nodes of an element between two fixed nodes. If one of these supports moves, "
    "the force in the part at that end is too large by the number of parts.",
)
INITIAL_GROUND_VELOCITY = Message(
    "N307", "[[motion]]: the supports move at {velocity} m/s at the start, and the net moves with them."
)
LARGE_SUPPORT_DISPLACEMENT = Message(
    "W308",
    "[[motion]] {number}: {file}: displacements of up to {peak:.4g} m (plausible: up to {limit:g} m). "
    "Check the unit: the table is in m.",
)
RECORD_STARTS_LATE = Message(
    "E309", "the first row is at {time:g} s, expected 0 s or earlier. Add a row at time 0."
)
BASELINE_CORRECTION = Message(
    "N311",
    "[[motion]] {number}: the baseline correction changes accelerations by at most {peak:.3g} m/s2.",
    "The least-squares parabola through zero is subtracted from the velocity of a PEER record, so that "
    "measuring errors do not add up to a drift. To use the record as it is, set baseline = false.",
)
NO_VALUE_COLUMN = Message("E312", "no column of values. Give at least one of the columns x, y, z.")
NONZERO_START = Message(
    "E313",
    "displacement at time 0: {displacement} m, expected 0. Displacements count from the start of the "
    "dynamics: subtract that of time 0 from all rows.",
    "The net starts in equilibrium with its supports where the job has them. A jump at time 0 would be a "
    "shock.",
)
RECORD_DRIFT = Message(
    "N314",
    "[[motion]] {number}: accelerations of up to {acceleration:.3g} m/s2. Integrated displacements: up to "
    "{largest:.3g} m, {displacement:.3g} m after {end:g} s with a velocity of {velocity:.3g} m/s.",
    "An acceleration record is integrated twice. A large displacement or velocity at its end is usually a "
    "measuring error of the record: correct its baseline, or give displacements.",
)
RECORD_BEFORE_START = Message(
    "W322",
    "[[motion]] {number}: {file}: the accelerations before time 0 have no effect. Shift the times of the "
    "record so that its first row is at 0.",
    "The supports are at rest until time 0.",
)
RECORD_HEADER = Message("E316", '{path}: line 4: {line!r}, expected "NPTS= 3000, DT= .0100 SEC".')
RECORD_NOT_NUMERIC = Message(
    "E317", "{path}: {error}. Below the four header lines a record has only numbers."
)
RECORD_LENGTH = Message(
    "E318",
    "{path}: {found} finite numbers below the header, which gives NPTS = {count} and DT = {step:g}. "
    "Expected NPTS numbers, at least 2, and DT > 0.",
)
RECORD_UNIT = Message(
    "E319",
    "{path}: no header line has the words UNITS OF G, the unit of PEER. Convert the values to g and add the "
    "words, or give a table of time and acceleration in m/s2.",
)
MOTION_OF_FREE_AXES = Message(
    "W320",
    "[[motion]] {number}: {axes}: no effect: no support of the entry is held along it. Hold the axis "
    "(fixed_x, fixed_y, fixed_z), or move other nodes.",
    "Supports move only along their held axes. Along a free axis the node follows its elements.",
)
SUDDEN_LOADS_WITH_MOTION = Message(
    "W321",
    "[[motion]]: the loads act at once at the start, so forces and displacements include the motion that "
    "follows. Set [load] steps = 1 to start in equilibrium under them.",
    "A roof carries its weight before its supports move. Without load steps, wind or removals the dynamic "
    "stage starts in the form.",
)

# --- member removals

UNKNOWN_ELEMENTS = Message(
    "E331", "the net has no element {ids} (its ids are {first} to {last}). Give ids of its elements."
)
BENDING_BARS_REMOVED = Message(
    "E332",
    "{bars} of a bending chain, whose removal is not computed. Remove other members, or remove bending = "
    "true there.",
    "The neighbours of a removed bar would lose their bending moments at once, which the model does not "
    "cover. Without bending = true the bars are hinged at their nodes and can be removed.",
)
ALREADY_ABSENT = Message("N333", "[[remove]] {number}: no effect on {elements}, which {cause} removed.")
GUSTS_WITH_REMOVAL = Message(
    "N334",
    "[[remove]]: gusts act after the removal, so the largest forces and the dynamic factors include both. "
    "For the removal alone {remedy}.",
    "A dynamic factor relates the largest force after a removal to the static force after it. Gusts add to "
    "the largest force.",
)
SUDDEN_WIND_WITH_REMOVAL = Message(
    "W335",
    '[[remove]]: with [wind] onset = "sudden" {loads} at once at the start, so the tensions before the '
    "removal, the largest forces and the dynamic factors include the motion that follows. For the removal "
    'alone set [wind] onset = "static".',
    "A dynamic factor relates the largest force to the forces before and after the removal, which should be "
    "those of an equilibrium.",
)
MOTION_WITH_REMOVAL = Message(
    "W336",
    "[[remove]]: supports move too, so the largest forces and the dynamic factors include both. "
    "For the removal alone leave [[motion]] out.",
    "The static equilibrium after a removal, to which dynamic factors refer, is computed with the supports "
    "at their first positions. Displaced supports change the static forces too, so the factors may be "
    "wrong.",
)
RAMP_WITH_REMOVAL = Message(
    "W351",
    "[[remove]]: the pressure still grows at {time:g} s, over [load] ramp = {ramp:g} s, so the largest "
    "forces and the dynamic factors include its growth. Set ramp = 0, or remove the members after the ramp.",
    "The equilibrium after a removal contains the whole pressure, the forces before it only a part.",
)

# --- static cases and combinations

UNEQUAL_FACTORS = Message(
    "W341",
    "[[case]] {case}: {key} = {value}, but [load] has {base}. In combinations the factor of the case "
    "multiplies the difference, and the factor of {action} multiplies the value of [load] ({sums}). "
    "Give both the same factor, or give no such load in [load].",
    "A combination adds the difference between the values of a case and those of [load], times the factor "
    "of the case. If the two factors differ, the sum is not factor x value of the case.",
)
OMITTED_ACTION = Message(
    "W342",
    "[[combination]] {combinations}: the factors do not name {action}, so {loads} are left out. "
    "Give a factor; {action} = 0.0 states that this is intended.",
    "An action without a factor has the factor 0 in the combination. A forgotten live load makes it unsafe.",
)
OMITTED_CASES = Message(
    "W352",
    "[[case]] {cases}: in no combination, so no combination has these loads. Give a factor; 0.0 states that "
    "this is intended.",
)
ZONES_KEEP_VALUES = Message(
    "W354",
    "[[case]] {case}: set: {key} = {value}: no effect in zones that have a value of their own ({zones}). Set "
    "it for these zones too; their own value there states that this is intended.",
    "A value of a zone takes precedence over that of the whole roof, also if a case sets the latter. The "
    "change of the case in the zone is then zero, with any factor.",
)
CASE_DIRECTION_IGNORED = Message(
    "W343",
    "[[case]] {case}: set: wind.direction = {direction:g} ({origin}): the pressure coefficients do not "
    "depend on it. Give a table of coefficients by direction (wind.sectors), or set them in the case.",
    "A static wind acts along the normals of the roof. Its direction changes the forces only through the "
    "pressure coefficients.",
)
CASES_WITHOUT_GUSTS = Message(
    "W353",
    "[[case]] {cases}: set: no wind.pressure_factor, so the pressure{where} is that of the mean speed. Give "
    "the ratio of peak to mean velocity pressure, or 1 for the speed of a gust.",
    "Codes design for the peak velocity pressure, 1 + 7 I times that of the mean speed (EN 1991-1-4, 4.5): "
    "about twice. A static wind has no gusts.",
)
PRESSURE_COLUMNS = Message(
    "E344", "expected exactly one of the columns pressure [N/m2] and coefficient. Add or remove one."
)
MISSING_FACTOR = Message(
    "E345",
    "{path}: [[case]] {case}: factor: missing. Give the pressure in N/m2 that multiplies the coefficients.",
    "Coefficients of a wind tunnel are multiplied by the velocity pressure, which the case must give.",
)
UNKNOWN_SETTLEMENT_NODE = Message(
    "E346", "{path}: [[case]] {case}: settlement: the net has no node {node}. Give ids of its nodes."
)
FREE_SETTLEMENT_AXES = Message(
    "E347",
    "{path}: [[case]] {case}: settlement: node {node}: {axes}: neither held nor on a spring. "
    "Give 0.0 there or hold the node.",
)
ROTATED_SETTLEMENT = Message(
    "E348",
    "{path}: [[case]] {case}: settlement: node {node}: {axes}: a support with an angle that can move in "
    "plan settles only along z. Give 0.0 there.",
)

NO_SUCH_LOADED = Message(
    "E349", "{row}: {kind} = {number}: the net has no such {kind}. Give the id of one, or remove the row."
)

# --- wind: control points, tables

SINGULAR_GUSTS = Message(
    "E361",
    "[wind]: the equations of the gusts are singular to rounding. Set fewer control_points, a lower "
    "ar_order or a longer time_step.",
    "Histories at control points that are close together, sampled at short intervals, are nearly equal. The "
    "autoregressive model cannot distinguish them.",
)
UNSTABLE_GUSTS = Message(
    "E380",
    "[wind]: the generated gusts would grow without bound ({points} control points). Set fewer "
    "control_points or another ar_order.",
    "The lags of the autoregressive model are not consecutive, so its equations do not ensure that gusts "
    "decay. Many control points, close together, are the usual cause.",
)
COINCIDENT_CONTROL_POINTS = Message(
    "E362", "[wind]: two control points coincide to rounding. Set fewer control_points."
)
POINT_TOO_LOW = Message(
    "E363",
    "{path}: name = {name!r}: {height:g} m above ground (z + base_height = {base_height:g} m), expected at "
    "least {lowest:g} m. Correct z or base_height.",
)
TIMES_NOT_COVERED = Message(
    "E364",
    "{path}: covers {first:g} to {last:g} s, expected 0 to duration = {duration:g} s. Add rows or shorten "
    "the duration.",
    "netfall does not continue a table beyond its last row. Times are full-scale times in s, from 0 at "
    "the start of the dynamics.",
)
POINT_NAME = Message(
    "E365", "{row}: name = {name!r}: expected a unique name, that of a column of values other than time."
)
POINTS_ABOVE_ONE_ANOTHER = Message(
    "E366",
    "{row}: name = {name!r}: at the same x, y as {other!r}. Give one height at each place; the wind "
    "profile gives the speeds at others.",
)
TAPS_ABOVE_ONE_ANOTHER = Message(
    "E367",
    "{row}: name = {name!r}: at the same x, y as {other!r}. Give one tap at each place, with the sum of "
    "the pressures on both sides of the roof.",
    "A node takes the mean of taps at one place. The pressures above and below the roof must be added, "
    "not averaged: positive presses on the roof.",
)
NOT_HDF5 = Message(
    "E368", "{path}: {error}. Expected an HDF5 file with the datasets time (t,) and value (t, c)."
)
HDF5_SHAPES = Message(
    "E369",
    "{path}: time has the shape {time} and value {value}, expected (t,) and (t, {count}). "
    "Give a column for each of the {count} taps.",
)
HDF5_VALUE = Message(
    "E370", "{path}: value: row {row}: not a number or above {largest:g}. Give a finite number in each cell."
)
TIMES_NOT_ASCENDING = Message(
    "E371", "{path}: time = {time:g} is not after the row before ({before:g}). Sort the rows by time."
)
ZONES_DIFFER_BY_CASE = Message(
    "E372",
    "{path}: the names of some zones differ only in upper and lower case and have the same column. "
    "Rename these zones.",
)
SECTOR_DIRECTION = Message(
    "E373", "{row}: direction = {cell!r}: expected a number of degrees >= 0 and < 360."
)
SECTOR_CONFLICT = Message(
    "E374",
    "column {column} and [wind.zone.{zone}] {key} exclude each other. Keep one of the two.",
    "The table gives the coefficient of the zone by direction, the key gives one for all directions.",
)
