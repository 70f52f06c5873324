"""Messages of the package `post`: plots, films, pages, reports, code checks, accuracy studies."""

from netfall.core.messages import Message

# pages, plots, films
NO_COMMON_NET = Message("E801")
NO_SAMPLE_FILE = Message("E802")
OTHER_NET = Message("E803")
UNTIL_TOO_EARLY = Message("E804")
GIF_TOO_FAST = Message("E805")
NOTHING_TO_ANIMATE = Message("E806")
UNKNOWN_STATE = Message("E807")

# reports and checks
NO_DEDUCTIONS = Message("E821")
UNKNOWN_WORD = Message("E822")
DEDUCTION_TOO_LONG = Message("E823")
UNREADABLE_CODES = Message("E824")
NO_CHECKS = Message("E825")
CHECK_TWICE = Message("E826")
COLUMN_TWICE = Message("E830")
UNKNOWN_GROUP = Message("E827")
TENSION_AND_COMPRESSION = Message("E828")
FOREIGN_TABLE = Message("E829")
FORM_NOT_REACHED = Message("W841")
UNCHECKED_BENDING = Message("W843")
EXCESSIVE_MEASURING_LOAD = Message("W844")
NO_BREAKING_LOAD = Message("W845")
NO_YIELD_STRESS = Message("W846")
UNCHECKED_COMPRESSION = Message("W847")
UNDIVIDED_BENDING = Message("W848")
NO_EQUILIBRIUM = Message("W842")

# studies of accuracy and scaling
SAFETY_WITHOUT_EFFECT = Message("N861")
REFERENCE_FAILED = Message("E862")
AUTOMATIC_STEP_FAILED = Message("E863")
WRONG_VARIATION = Message("E864")
NO_DYNAMICS = Message("E865")
TRADE_INTERRUPTED = Message("N870")
NO_WEAK_SCALING = Message("N866")
SCALING_RUN_FAILED = Message("E867")
