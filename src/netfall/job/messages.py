"""Messages of the package `job`: files, sections, keys, values, units, tables with a header."""

from netfall.core.messages import Message

# files
UNREADABLE_JOB = Message("E101", "{path}: {reason}. Give the path of a {kind} file.")
NOT_TEXT = Message(
    "E102", "{path}: line {line}: not text in UTF-8. Give a {kind} file in TOML, saved as UTF-8."
)
INVALID_TOML = Message(
    "E103",
    "{path}: not valid TOML: {reason}.",
    "Usual causes are a missing quote or bracket, a string without quotes, a section that occurs "
    "twice, and a decimal comma. The message gives the line.",
)
STUDY_FILE = Message("E104", "{path}: a study file, not a job file. Run it with netfall study {path}.")
UNREADABLE_FILE = Message(
    "E105",
    "{path}: {reason}. Paths are relative to the job file, in a dict to the working directory.",
    "A path in a job is relative to the folder of the job file, not to the working directory.",
)
FILE_EXISTS = Message("E106", "{path}: the file exists already. Give another name or folder.")
NO_FOLDER = Message("E107", "{path}: the folder {folder} does not exist. Make it first.")
UNSUPPORTED_TYPE = Message(
    "E108",
    "{place}{value!r}: a job cannot hold a {type}. Give a number, a text, true or false, or a list or dict "
    "of them, or leave the key out.",
)

# overrides, --set
INVALID_OVERRIDE = Message(
    "E110", "--set {override}: expected SECTION.KEY=VALUE, for example wind.speed=45",
    "--set takes the name of one key with its section, an equals sign, and a value as in the job file. Quote "
    "the whole argument if the value has spaces or brackets.",
)  # fmt: skip
OVERRIDE_OF_LIST = Message(
    "E111",
    "--set {name}={value}: {part} is a list, [[{part}]]. --set does not reach it; change the job file.",
)
OVERRIDE_OF_KEY = Message("E112", "--set {name}={value}: {part} is a key, not a section.")

# names of earlier versions
RENAMED_KEY = Message("E113", "{name}: renamed in version 0.5; write {new}.")
REMOVED_KEY = Message("E114", "{name}: removed in version 0.5, {reason}. Remove the key.")
OTHER_GENERATOR = Message(
    "E117",
    "{name}: only for generator = {generators}. Remove it.",
    "Each generator of nets has its own dimensions, in [net.saddle], [net.stadium], [net.ring], [net.wheel] "
    "and [net.dome]. The job gives a dimension that its generator does not have.",
)
OTHER_DIMENSIONS = Message("E118", "only for generator = {generator}. Remove the section.")

# sections, keys, values
UNKNOWN_SECTION = Message("E120", "[{name}]: unknown section; {suggestion}")
NOT_A_SECTION = Message("E121", "{name} = {value}: not a section. Write [{section}], and its keys below it.")
NOT_TABLES = Message("E122", "{name} = {value}: expected tables, [{section}.NAME]")
NOT_ENTRIES = Message("E123", "{name} = {value}: expected entries, [[{name}]], each with its keys")
MISSING_SECTION = Message("E124", "[{name}]: the section is missing. Add it; every job needs it.")
UNKNOWN_KEY = Message(
    "E125",
    "{name}: unknown key; {suggestion}",
    "The section has no key of this name. Correct the spelling, or move the key to its section; netfall docs "
    "KEY names it.",
)
INVALID_VALUE = Message(
    "E126",
    "{name} = {value}: expected {expected}",
    "The value has the wrong type or lies outside the range of the key. Write a number with a unit in "
    'quotes, "90 km/h"; a bare number is in the unit that the message names.',
)
MISSING_KEY = Message(
    "E127",
    "{name}: missing; expected {expected}",
    "The section lacks a required key. The page on the keys of a job describes it.",
)
MISSING_ONE_OF = Message("E128", "{keys}: missing. Give one of them.")
MISSING_PARTNER = Message("E129", "{missing}: missing. {given} needs it; give both, or neither.")
EXCLUSIVE = Message(
    "E130",
    "{keys} exclude each other. Keep one of them.",
    "These keys define the same quantity in different ways, so only one of them can apply.",
)
NEEDS = Message(
    "E131",
    "{key}: has no effect without {needed}. Add {needed}, or remove {key}.",
    "The job gives something that acts only together with a section, key or file that is absent.",
)
AREA_WITHOUT_EFFECT = Message(
    "N145",
    "{area}: does not change {key}, which the job file or a type gives. It affects only the yield force. "
    "Give also {column} there to replace {key}.",
)
PRESTRESS_REPLACED = Message(
    "N146", "column prestress of {elements}: no effect: the same rows give {column}. Leave one of both empty."
)
DUPLICATE_ENTRY = Message("E132", "name: entry {first} has this name already. Names are unique.")
UNKNOWN_UNIT = Message(
    "E133",
    '"{given}" is not a known unit. Use a unit like {unit}, as in "{example}".',
    "Units are written as in mm2, kN/m2, km/h. Units are case-sensitive: MPa, not mpa. A ton "
    "is t, short_ton or long_ton.",
)
OTHER_DIMENSION = Message(
    "E134", '"{given}" has another dimension. Use a unit like {unit}, as in "{example}".'
)
NOT_KELVIN = Message(
    "E135",
    '"{given}" is not K. Temperatures are differences; give them in K, as in "{example}".',
    "A temperature of a job is a difference to the temperature at form finding. A difference of 20 degrees "
    "Celsius is 20 K.",
)

# [net], [cable], [group.NAME], [form_finding]
NO_NET_SOURCE = Message("E140", "generator: missing; expected one of {generators}, or nodes and elements")
UNIT_OF_GENERATOR = Message("E141", "unit = {value}: only for tables; dimensions are in m. Remove it.")
SUBDIVIDED_GIVEN_GEOMETRY = Message(
    "E142",
    'subdivide = {parts}: with method = "given_geometry" and permanent loads, new nodes would sag. Set '
    'subdivide = 1, or loads = "none".',
    'method = "given_geometry" keeps the geometry of the tables. A node inside a straight cable cannot carry '
    "a transverse load there, so it has no equilibrium in that geometry.",
)
MISSING_SECTION_KEY = Message(
    "E143",
    "{name}: missing{element}; expected {expected}, or {alternative}, or a type of the catalogue",
    "Each element needs a stiffness and a mass: modulus, area and density; or axial_stiffness and "
    "mass_per_length; or a type. [cable] gives them for all elements, [group.NAME] for a group.",
)
CLASHING_PATTERNS = Message(
    "E144",
    "[{section}.{one}] and [{section}.{other}] both give {key} to the group {group}. Keep it in one of them.",
    "Two patterns match one group, and no pattern takes precedence. A section with the exact name of the "
    "group takes precedence over patterns.",
)

# [wind], [dynamics]
NO_WIND_SPEED = Message(
    "E150",
    "speed: missing; expected a number > 0 m/s, or file = a table of time and speed, or pressures = a table "
    "of time and taps",
)
NO_DAMPING_SPEED = Message(
    "E151", "speed: missing. With pressures, aerodynamic_damping needs the mean speed at 10 m, in m/s."
)
NO_PRESSURE_COEFFICIENT = Message(
    "E152", "pressure_coefficient: missing; expected a number, or sectors = a table of them by wind direction"
)
NO_TURBULENCE = Message(
    "E153",
    "turbulence_intensity: missing; expected that of the gusts at 10 m, or surface_drag. 0 means no gusts.",
    "A generated wind has gusts, whose strength has no default. Codes give a turbulence intensity of 0.15 to "
    "0.2 at 10 m in open terrain. surface_drag is k of Davenport's spectrum, k = I^2 / 6.",
)
NO_BASE_HEIGHT = Message(
    "E154",
    "{key}: missing; expected the height of z = 0 above ground in m (0 if z counts from the ground), or "
    "profile_exponent = 0",
    "The mean wind speed grows with the height above ground, which the net does not "
    "define. profile_exponent = 0 gives the same speed at every height.",
)
TOO_MANY_ROWS = Message(
    "E156",
    "[{section}] {key} = {value:g}: gives {number:.3g} {rows} over the duration; at most {limit:.0e} are "
    "possible. Increase it, or shorten the duration.",
)
SLOW_GUSTS = Message(
    "E157",
    "[wind] speed = {speed:g}: a gust of {length:g} m lasts {samples:.3g} samples of time_step = {step:g} s; "
    "at most {most} are possible. Set [wind] time_step >= {least:.3g}, or {key} = 0 (no gusts).",
    "The gust model needs as many lags as samples in a gust, and takes minutes to fit with more. A slow wind "
    "has long gusts, so a longer time step resolves them as well.",
)
LARGE_BASE_HEIGHT = Message(
    "W158",
    "{path}: {key} = {value:g} m: z = 0 would lie more than {limit:g} m above ground. The wind speed is "
    "extrapolated to that height. Check the unit and the reference.",
    "base_height is the height of z = 0 of the net above the ground at the site, in m. Usual mistakes are a "
    'value in mm without a unit ("30000 mm" is a value with one) and a height above sea level.',
)

# cases, combinations
NOT_SETTABLE = Message(
    "E160",
    "{name}: not a key that a {kind} can set; {suggestion}",
    "A case can set only loads and a mean wind: the keys snow, ice, pressure, dead and temperature of [load] "
    "and of its zones, and some of [wind]. A stage sets those of [load].",
)
RESERVED_CASE_NAME = Message("E161", "name: {name} has a meaning in combinations. Choose another name.")
EMPTY_CASE = Message(
    "E162", "set, load_table, pressure_table or settlement: missing. Give the action of the case."
)
NO_CASE_SPEED = Message("E163", "set: wind.speed: missing; expected a number > 0 m/s here or in [wind]")
NO_CASE_COEFFICIENT = Message(
    "E164", "set: wind.pressure_coefficient: missing; expected it, or wind.sectors, here or in [wind]"
)
NAME_OF_CASE = Message("E165", "name: {name} is the name of {kind} already. Names are unique.")
UNKNOWN_FACTOR = Message(
    "E166",
    "factors: {name}: no case has this name; {suggestion}",
    "Factors are those of permanent, prestress, temperature, load, and of cases by name. A case that is not "
    "named has the factor 0.",
)
NEGATIVE_PRESTRESS = Message("E167", "factors: prestress = {factor:g}: expected a number >= 0")
NOT_FACTORS = Message(
    "E168", "[combinations] {name} = {value}: expected a table of factors, {{permanent = 1.35, NAME = 1.5}}"
)

# tables of loads
LOAD_COLUMNS = Message(
    "E155",
    "columns {given}: expected node with load_x, load_y, load_z; or element with line_x, line_y, line_z; "
    "or zone with dead, snow, pressure or pressure_x, pressure_y, pressure_z. Give one of the three, with at "
    "least one of its loads.",
    "A load table has loads of nodes [N], of elements [N/m of unstressed length], or of zones [N/m2]. Write "
    "a table for each of them; several cases can act in one combination.",
)
ZONE_TWICE = Message("E159", "{row}: zone = {name}: {first} has this zone already. Give each zone one row.")
NO_SPAN = Message(
    "E169",
    'span: missing. displacement = "{limit}" is a share of it; give the span in m, here or in [limits].',
)

# entries of other lists
WRONG_TARGET = Message("E170", "expected group and force, or node and height. Give one of these pairs.")
RAMP_WITH_REMOVAL = Message(
    "E172",
    "ramp: without [wind], a job with [[remove]] starts in equilibrium under its loads. Remove one.",
)
RECORD_WITHOUT_DIRECTION = Message(
    "E174", "direction: missing. A record has one component; give its direction, [x, y, z]."
)
NO_FORM_BY_DENSITY = Message(
    "E171",
    'horizontal_force: needs [form_finding] method = "force_density". Set this method, or give prestress.',
    "A horizontal force gives each element the force density H / length in plan. The other methods take "
    "tensions, and without [form_finding] the geometry stays.",
)
NO_LENGTH_IN_PLAN = Message(
    "E173",
    "horizontal_force: element {element} between nodes {start} and {end} has no length in plan. Give its "
    "group a prestress, or move its nodes apart in plan.",
)
BASELINE_OF_TABLE = Message("E175", "baseline: only for records (.AT2); a table is used as it is. Remove it.")
NO_DIRECTION = Message("E176", "{name} = [0, 0, 0]: has no direction. Give a vector that is not zero.")

# section and strength in the check of bending
NO_DESIGN_STRENGTH = Message(
    "E136",
    "element {element}: section_modulus = {value:g}: needs design_strength or yield_stress [Pa]. Add one.",
)
SHORT_BUCKLING_LENGTH = Message(
    "W147",
    "buckling_length = {value:g} m of {elements}: implausible for a length of {length:.4g} m. The Euler load "
    "may be too large. Check the unit, or add nodes where the bar is held.",
    "The buckling length is half the length if both ends are clamped, and all of it if they are hinged.",
)
LARGE_SECTION_MODULUS = Message(
    "E137",
    "element {element}: section_modulus = {value:g} m3; expected at most sqrt(second_moment area) = "
    "{largest:.4g} m3. Check the unit: mm3 or cm3?",
    "The outermost fibre is farther from the centroid than the radius of gyration, so every section has "
    "W <= sqrt(I A).",
)
UNUSED_DESIGN_STRENGTH = Message(
    "N138",
    "{place} design_strength: no effect: only the check of axial force with bending reads it, which "
    "needs section_modulus.",
)
CHECK_OF_CONCRETE = Message(
    "N139",
    "{place} section_modulus: asks for the check of axial force with bending, which is not for concrete; "
    "modulus and density could be those of concrete. If it is, remove section_modulus.",
)

# tables with a header
EMPTY_TABLE = Message("E180", "{path}: empty; expected a header with {columns}")
NO_ROWS = Message("E181", "{path}: no rows below the header. Add at least one.")
ROW_LENGTH = Message(
    "E182",
    "line {line}: {count} values, but the header has {columns} columns. Write one value per column.",
    "In a table separated by commas, a decimal comma makes two values of one number. Numbers are written "
    "with a decimal point.",
)
UNKNOWN_COLUMN = Message("E183", "line {line}: {name!r}: unknown column; {suggestion}")
IGNORED_COLUMNS = Message(
    "N184",
    "{path}: unknown columns, which netfall ignores: {names}; known: {known}.",
    "A column with a name close to a known one is an error instead.",
)
DUPLICATE_COLUMN = Message("E185", "column {name} occurs twice. Keep one of the two.")
MISSING_COLUMN = Message(
    "E186",
    "column {name} is missing; expected {columns}. Line {line} gives the columns {names}.",
    "The header is the first row that is no comment. Names of columns are separated by commas, semicolons "
    "or tabs, as the values are.",
)
INVALID_CELL = Message("E187", "{row}: {name} = {cell!r}: expected {expected}")
DECIMAL_COMMA = Message(
    "E188", "{row}: {name} = {cell!r}: expected a number with a decimal point, without commas"
)
EMPTY_CELL = Message("E189", "{row}: {name} is empty; expected a number")
EMPTY_CELLS = Message("E190", "empty cells; expected a number in each")
COLUMN_WITHOUT_UNIT = Message(
    "E191", "column {name}: unit {unit!r}: the column has no unit. Write - instead."
)
NOT_ASCENDING = Message(
    "E192",
    "{row}: {name} = {value:g}: not above the row before ({previous:g}). Sort the rows by ascending {name}.",
    "Values between the rows are interpolated, which needs ascending values. Two rows with the same value "
    "are an error too.",
)
MORE_ERRORS = Message("E193", "{path}: and {count} more errors")
TABLE_NOT_UTF8 = Message(
    "E194",
    "{path}: line {line}: not text in UTF-8. Save the table as UTF-8 text.",
    "Spreadsheets save tables in other encodings if names are not in ASCII. Choose UTF-8, or CSV UTF-8, "
    "when saving.",
)
NOT_CSV = Message("E195", "{path}: not a CSV table ({reason}).")
OPEN_QUOTE = Message(
    "E196",
    "{path}: line {line}: a quote is not closed on the line. Close or remove it; a cell has no line break.",
    "Text from a quote to the next one is one cell, with the rows between them.",
)
