"""Messages of the package `driver`: stages of a run, and doubtful values in a run or check."""

from netfall.core.messages import Message

# form, targets and stages of erection
TOLERANCE_BELOW_ROUNDING = Message("E601")
UNKNOWN_NAME = Message("E602")
UNKNOWN_GROUP = Message("E603")
UNKNOWN_NODES = Message("E604")
MOVED_FREE_NODES = Message("E605")
RELEASED_FREE_NODES = Message("E649")
UNKNOWN_PLACE = Message("E665")
TURNED_AXES = Message("E666")
NO_LENGTH_LEFT = Message("E606")
ABSENT_CABLE = Message("E607")
LENGTH_CHANGED_TWICE = Message("E669")
MOVED_TWICE = Message("E673")
UNSUPPORTED_PART = Message("E608")
PRESTRESS_FACTOR_AFTER_HEATING = Message("E609")
PRESTRESS_FACTOR_WITH_BENDING = Message("E671")
RELEASED_SETTLEMENT = Message("E610")
STAGE_LOADS_LOST = Message("W663")
TARGET_NODE = Message("E611")
REPEATED_TARGET = Message("E612")
TARGETS_MISSED = Message("E613")
STAGE_WITHOUT_EQUILIBRIUM = Message("E614")
ERRORS_WITHOUT_EQUILIBRIUM = Message("E615")
NO_INFLUENCE = Message("W664")
LOAD_CHANGES = Message("W616")

# equilibria
UNDECIDED = Message("E617")
UNDECIDED_CASE = Message("W618")
LOAD_FACTOR_REACHED = " (load factor reached {factor:.4g}{start})"
FROM_PERMANENT = ", from 0 at the permanent loads"
NO_EQUILIBRIUM = Message("E619")
NO_EQUILIBRIUM_AT_START = Message("E620")
NO_EQUILIBRIUM_IN_MEAN_WIND = Message("E621")
NO_EQUILIBRIUM_UNDER_PRESSURES = Message("E622")
CASE_WITHOUT_EQUILIBRIUM = Message("W623")
UNSTABLE = Message("W624")
STABILITY_UNKNOWN = Message("W625")
UNSUPPORTED_WITHOUT_MEMBERS = Message("W626")
REMOVAL_WITHOUT_EQUILIBRIUM = Message("W627")
MODES_WITHOUT_EQUILIBRIUM = Message("W628")
MECHANISMS = Message("W629")
UNSTABLE_MODES = Message("W630")

# start of a run
START_UNBALANCED = Message("W631")
NET_UNBALANCED = Message("W632")
FORM_SLIPS = Message("W633")
FAR_PROBE = Message("W634")
AMBIGUOUS_PROBE = Message("N635")
BAND_STIFFNESS = Message("W636")
DURATION_EXTENDED = Message("N637")
STEP_ABOVE_SLACK_LIMIT = Message("W638")
SLIP_INERTIA = Message("W639")

# wind
NEGATIVE_SPEEDS = Message("W640")
VARIANCE_LOST = Message("W641")
SPECTRUM_ERROR = Message("W642")
SLOW_GUSTS = Message("W643")
WEAK_GUSTS = Message("W645")
STRONG_GUSTS = Message("W646")
GUST_LENGTH_AT_TEN = Message("W647")

# dynamic stage
DIVERGED = Message("E650")
LARGE_STRAIN = Message("W651")
SEGMENT_CHANGED = Message("W652")
CABLE_RAN_OUT = Message("W653")
EVENT_UNFINISHED = Message("W670")
MUCH_ADDED_INERTIA = Message("W672")

# check and size of a run
LARGE_FACE = Message("N662")
