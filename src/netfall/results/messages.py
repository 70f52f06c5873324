"""Messages of the package `results`: files that are read and written, doubtful parts of a result."""

from netfall.core.messages import Message

# files that are read
MISSING_RESULT = Message("E701")
FOLDER_AS_RESULT = Message("E702")
UNREADABLE_RESULT = Message("E703")
OTHER_HDF5_FILE = Message("E704")
STUDY_AS_RESULT = Message("E705")
MISSING_DATASET = Message("E706")
TIME_OUTSIDE_FRAMES = Message("E707")

# files that are written
CANNOT_WRITE = Message("E708")
MISSING_FOLDER = Message("E709")
NAME_TOO_LONG = Message("E739")
FOLDER_AS_OUTPUT = Message("E710")
READ_ONLY_FOLDER = Message("E711")
OTHER_FILE_THERE = Message("E712")
OUTPUT_IN_USE = Message("E713")
FOLDER_NOT_SHARED = Message("E714")

# checkpoints
NO_CHECKPOINT = Message("E715")
DAMAGED_CHECKPOINT = Message("E716")
OTHER_JOB = Message("E717")
MISSING_SEGMENT = Message("E718")

# form finding
CHECK_FORM = "Check supports, prestress and force densities."
KEEP_POSITIONS = (
    "Constant tension moves nodes along cables; to keep their positions, use [form_finding] modulus_factor "
    '= 1e-3, method = "force_density" or method = "given_geometry".'
)
FORM_MOVED = Message("W719")
FORM_AREA_CHANGED = Message("W720")
BAR_LENGTH_CHANGED = Message("W740")
UNDETERMINED_NODES = Message("N721")

# equilibria
PRESTRESS_CHANGED = Message("W741")
FORCES_OF_GEOMETRY = "Give forces that the geometry can have, or the prestress of one group only."
FORCES_OF_FPM = "Decrease [form_finding] modulus_factor, or give a geometry closer to the form."
FORCES_UNBALANCED = Message("W722")
LIMIT_POINT = Message("W723")
SNAP_THROUGH = Message("W724")
TORSION_NOT_MODELLED = Message("W725")
TOLERANCE_BELOW_ROUNDING = Message("W726")
TOLERANCE_MISSED = Message("W727")
SLIP_AT_END = Message("W728")
LARGE_DISPLACEMENT = Message("W729")
STRENGTH_EXCEEDED = Message("W730")
BUCKLED = Message("W731")
EULER_LOAD_EXCEEDED = Message("W732")
YIELDING = Message("W733")
YIELDED = Message("W734")

# dynamic stage
ENERGY_UNBALANCED = Message("W735")
WORK_IDENTITY_BROKEN = Message("W736")
DETACHED_TOO_FAST = Message("W737")
OVERSHOOT = Message("W738")
RINGING = Message("W739")
