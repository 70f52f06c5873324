"""Messages of the package `job`: files, sections, keys, values, units, tables with a header."""

from netfall.core.messages import Message

# files
UNREADABLE_JOB = Message("E101")
NOT_TEXT = Message("E102")
INVALID_TOML = Message("E103")
STUDY_FILE = Message("E104")
UNREADABLE_FILE = Message("E105")
FILE_EXISTS = Message("E106")
NO_FOLDER = Message("E107")
UNSUPPORTED_TYPE = Message("E108")

# overrides, --set
INVALID_OVERRIDE = Message("E110")
OVERRIDE_OF_LIST = Message("E111")
OVERRIDE_OF_KEY = Message("E112")

# names of earlier versions
RENAMED_KEY = Message("E113")
REMOVED_KEY = Message("E114")
OTHER_GENERATOR = Message("E117")
OTHER_DIMENSIONS = Message("E118")

# sections, keys, values
UNKNOWN_SECTION = Message("E120")
NOT_A_SECTION = Message("E121")
NOT_TABLES = Message("E122")
NOT_ENTRIES = Message("E123")
MISSING_SECTION = Message("E124")
UNKNOWN_KEY = Message("E125")
INVALID_VALUE = Message("E126")
MISSING_KEY = Message("E127")
MISSING_ONE_OF = Message("E128")
MISSING_PARTNER = Message("E129")
EXCLUSIVE = Message("E130")
NEEDS = Message("E131")
AREA_WITHOUT_EFFECT = Message("N145")
PRESTRESS_REPLACED = Message("N146")
DUPLICATE_ENTRY = Message("E132")
UNKNOWN_UNIT = Message("E133")
OTHER_DIMENSION = Message("E134")
NOT_KELVIN = Message("E135")

# [net], [cable], [group.NAME], [form_finding]
NO_NET_SOURCE = Message("E140")
UNIT_OF_GENERATOR = Message("E141")
SUBDIVIDED_GIVEN_GEOMETRY = Message("E142")
MISSING_SECTION_KEY = Message("E143")
CLASHING_PATTERNS = Message("E144")

# [wind], [dynamics]
NO_WIND_SPEED = Message("E150")
NO_DAMPING_SPEED = Message("E151")
NO_PRESSURE_COEFFICIENT = Message("E152")
NO_TURBULENCE = Message("E153")
NO_BASE_HEIGHT = Message("E154")
TOO_MANY_ROWS = Message("E156")
SLOW_GUSTS = Message("E157")
LARGE_BASE_HEIGHT = Message("W158")

# cases, combinations
NOT_SETTABLE = Message("E160")
RESERVED_CASE_NAME = Message("E161")
EMPTY_CASE = Message("E162")
NO_CASE_SPEED = Message("E163")
NO_CASE_COEFFICIENT = Message("E164")
NAME_OF_CASE = Message("E165")
UNKNOWN_FACTOR = Message("E166")
NEGATIVE_PRESTRESS = Message("E167")
NOT_FACTORS = Message("E168")

# tables of loads
LOAD_COLUMNS = Message("E155")
ZONE_TWICE = Message("E159")
NO_SPAN = Message("E169")

# entries of other lists
WRONG_TARGET = Message("E170")
RAMP_WITH_REMOVAL = Message("E172")
RECORD_WITHOUT_DIRECTION = Message("E174")
NO_FORM_BY_DENSITY = Message("E171")
NO_LENGTH_IN_PLAN = Message("E173")
BASELINE_OF_TABLE = Message("E175")
NO_DIRECTION = Message("E176")

# section and strength in the check of bending
NO_DESIGN_STRENGTH = Message("E136")
SHORT_BUCKLING_LENGTH = Message("W147")
LARGE_SECTION_MODULUS = Message("E137")
UNUSED_DESIGN_STRENGTH = Message("N138")
CHECK_OF_CONCRETE = Message("N139")

# tables with a header
EMPTY_TABLE = Message("E180")
NO_ROWS = Message("E181")
ROW_LENGTH = Message("E182")
UNKNOWN_COLUMN = Message("E183")
IGNORED_COLUMNS = Message("N184")
DUPLICATE_COLUMN = Message("E185")
MISSING_COLUMN = Message("E186")
INVALID_CELL = Message("E187")
DECIMAL_COMMA = Message("E188")
EMPTY_CELL = Message("E189")
EMPTY_CELLS = Message("E190")
COLUMN_WITHOUT_UNIT = Message("E191")
NOT_ASCENDING = Message("E192")
MORE_ERRORS = Message("E193")
TABLE_NOT_UTF8 = Message("E194")
NOT_CSV = Message("E195")
OPEN_QUOTE = Message("E196")
