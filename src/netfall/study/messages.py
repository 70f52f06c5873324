"""Messages of the package `study`: study files, workers, fragility, hazard, removals."""

from netfall.core.messages import Message

# --- the study file

IS_A_JOB = Message(
    "E901", "{path}: is a job file. Run it with netfall run {path}, or name it as job in a study file"
)
TOO_MANY_RUNS = Message("E902", "{path}: asks for {count} runs; at most {most} are possible")
RARE_REMOVED = Message(
    "E903",
    "[rare]: removed in version 0.5. Use jobs/studies/rare_openturns.py instead",
    "jobs/studies/rare_openturns.py is a worked example: subset simulation by OpenTURNS that calls netfall.",
)
UNKNOWN_NAME = Message("E904", "{name}: unknown; {advice}")
NO_TITLE = Message("E905", "title = {value}: expected a text")
NO_JOB = Message("E906", "job = {value}: expected the path of a job file, relative to this file")
NO_SECTION = Message("E907", "{name} = {value}: expected a section, [{name}]")
NOTHING_DRAWN = Message("E908", "names no key of the job to draw")
NOTHING_VARIES = Message("E909", "nothing varies; expected [vary] or [sampling]")
KEY_TWICE = Message("E911", "{key}: given twice; give it once")
KEY_OF_RUNS = Message(
    "E912", "{path}: {name}: no outcome of a sample depends on it. Remove it, or set it in the job"
)
NO_KEY_OF_JOB = Message("E913", "{path}: {name} = {value}: expected a key of the job, SECTION.KEY")
NOTHING_TO_RUN = Message(
    "E914",
    "{job}: a study needs a dynamic stage or equilibria; expected [dynamics], [[case]], [[combination]], or "
    "[load] with steps",
)
REMOVAL_WITHOUT_DYNAMICS = Message(
    "E915", "{path}: [vary] remove needs a dynamic stage; expected [dynamics] in {job}"
)
DYNAMIC_OUTCOME = Message(
    "E916",
    "{path}: [[failure]] {name}: outcome = {value} belongs to a dynamic stage, and nothing breaks in "
    "equilibria; expected another outcome, or [dynamics] in {job}",
)
REMOVAL_OF_CHANGING_NETS = Message(
    "E917",
    "{path}: [vary] remove: the varied keys of [net] change the elements, so the list of members to remove "
    "differs between samples; make one study per net",
)
UNKNOWN_GROUP = Message("E918", "{job}: no element has the group {group}{moment}; groups: {known}")
UNKNOWN_MEMBER = Message("E919", "{job}: [vary] remove: ids: no {each} {value}; there are {known}")
EXPECTED_REMOVAL = Message("E922", 'expected {{each = "element", ...}} or {{each = "cable", ...}}')
NO_GROUPS = Message("E924", "group = {value}: expected the name of a group of elements, or a list of names")
NO_IDS = Message("E925", "ids = {value}: expected a list of ids of elements, or of names of cables")
ID_TWICE = Message("E926", "ids: one id is listed twice; list each once")
NO_TIME = Message("E927", "time: missing; expected {expected}")
NO_RANGE = Message("E929", "expected {{from = 1, to = 50}}, whole numbers, both included, or a list")
TOO_MANY_VALUES = Message("E930", "more than {most} values")
NO_VALUES = Message("E931", "expected a list of values, or {{from = 1, to = 50}}")
VALUE_TWICE = Message("E932", "{value} is listed twice; list each value once")
VARIED_AND_DRAWN = Message("E933", "is in [vary] too; give it in one of both")
NO_DISTRIBUTION = Message(
    "E934",
    'expected {{distribution = "normal", mean = 1.0, deviation = 0.1}}; known distributions: {known}',
)
NO_PARAMETERS = Message("E935", "expected numbers {names}, and no other key")
NO_WHOLE_ENDS = Message("E936", "expected whole numbers from and to")
NO_ORDER = Message("E937", "expected from < to")
NO_DEVIATION = Message("E938", "expected deviation > 0")
NO_MEAN = Message("E939", "expected mean > 0")
OUTCOME_OF_REMOVALS = Message("E940", "outcome = {value}: only for member removals; expected [vary] remove")
NO_DEPTH = Message("E941", "depth: missing; expected the depth from which a node counts as sunk, in m, > 0")
DEPTH_WITHOUT_EFFECT = Message("E942", "depth: has an effect only with outcome = {value}; remove it")
LATE_FRACTURE = Message(
    "E948",
    "limit = {value}: a fracture before that time would not be a failure; expected 0: each fracture is one",
)
CASES_WITHOUT_EFFECT = Message(
    "N949",
    "{job}: [[case]] and [[combination]] have no effect on a study of a dynamic stage. Make a study of a job "
    "without [dynamics] for them",
)
STAGES_WITHOUT_EFFECT = Message(
    "N981", "{job}: outcomes leave out the equilibria of [[stage]]. Check the stages in a run of the job"
)
RESERVED_MEASURE = Message("E950", "name: each study has a measure of failure of this name; give another one")
SEVERAL_DEPTHS = Message("E943", "depth: {depths}: expected one depth per study")
MOVING_SUPPORTS = Message(
    "W947",
    "[[failure]] {name}: {outcome} contains the motion of the supports, [[motion]]. Choose limits that "
    "include this motion, or another outcome.",
    "Displacements count from the form or the last stage of erection. Supports that settle move the net with "
    "them, so a net that follows them without a change of its forces has moved too.",
)
KEY_OF_CASES = Message(
    "W984",
    "[[case]] {cases}: set gives {key}, which the study varies. The varied value has no effect on these "
    "cases. Remove {key} from set, or from the study.",
)
HAZARD_WITHOUT_GUSTS = Message(
    "W985",
    "[hazard]: {wind}. In gusts the roof fails at lower mean speeds, so the probabilities are too small. "
    "Give {remedy}.",
)
HAZARD_WITHOUT_SPEED = Message(
    "E944", "needs a mean wind speed that varies; expected wind.speed in [vary] or [sampling]"
)
UNKNOWN_HAZARD = Message("E945", "distribution = {value}: expected {known}")
MISSING_HAZARD = Message("E946", "distribution: missing; expected {known}")

# --- files and workers

DAMAGED_JOURNAL = Message(
    "E951", "{path}: line {number} is damaged; remove the file to run the study from its start"
)
CHANGED_WHILE_RUNNING = Message(
    "E952",
    "{files}: changed while the study ran. Put the old text back and give the same command to continue, or "
    "move the journal away to start again",
)
UNREADABLE = Message("E953", "{path}: {reason}")
OTHER_STUDY = Message(
    "E954",
    "{path}: was made before {changed} changed, so its runs do not belong to this study; move it away to run "
    "the study from its start, or give another name with -o",
)
INCOMPLETE = Message("E955", "{path}: no /{name}; expected a complete study file")
TOO_MANY_FILES = Message(
    "E956",
    "{workers} workers at once need {needed} open files, and the limit is {limit} (ulimit -Hn); expected "
    "--workers of at most {most}; run the rest as shards (--shard)",
)
NO_LAUNCHER = Message(
    "E957", "{command}: {reason}; give the command that starts MPI ranks on this machine with --launcher"
)
WRONG_RANKS = Message(
    "E958",
    "--launcher: started {started} ranks; expected a command that starts {{ranks}} of them, here {expected}",
)
OTHER_PROGRAM = Message(
    "E959",
    "netfall has changed while the study ran; give the command again to see which runs are still valid",
)
NO_START = Message("E960", "{command}: does not start: {reason}. Give another command with --launcher")
FILES_NOT_KEPT = Message(
    "N986",
    '{path}: [run] keep_results = "{keep}": {count} of {total} finished runs have no result file, and '
    "finished runs are not repeated. For the files, run the study under another name with -o",
)
INTERRUPTED = Message("N961", "interrupted after {done} of {total} runs. Give the same command to continue")
RUN_AGAIN = Message("N962", "{task} is run once more: {reason}")

# --- answers

SAME_GUSTS = Message(
    "W971",
    "all samples have the same gusts, so the intervals exclude their scatter. Vary wind.seed",
    "A seed gives one realisation of the gusts. The intervals of a fragility curve assume independent "
    "realisations.",
)
LARGE_FACTORS = Message(
    "N972",
    "dynamic factors above {limit:g} are of elements whose tension in equilibrium hardly changes, or of a "
    "roof that continued to break",
)
FACTORS_WITH_GUSTS = Message(
    "N973",
    "gusts continue after a removal, so dynamic factors contain both effects. For the removal alone, use the "
    "mean wind ([wind] turbulence_intensity = 0)",
)
ENERGY_BALANCE = Message(
    "W975",
    "the energy balance of {count:sample} is off by more than {limit:.1%}. The time step is too long for "
    "some events. Compare with a smaller [dynamics] safety or time_step",
)
TAIL_DOMINATES = Message(
    "W976",
    "more than half of a probability comes from speeds below the lowest at which a run failed. There only "
    "the shape of the curve counts. Add runs at lower speeds",
)
ONE_DIRECTION = Message(
    "N977",
    "each row assumes that all wind of a year blows from its wind.direction. Draw wind.direction in "
    "[sampling] for one probability of all directions",
)
EQUAL_DIRECTIONS = Message(
    "N978",
    "runs of every wind.direction have equal weight: the probabilities are of a year in which each direction "
    "is as frequent as among the runs",
)
BOUND_WITHOUT_CURVE = Message(
    "N979",
    "the bounds without a curve assume that nothing fails up to a speed at which no run failed. With "
    "{samples:sample} at that speed, up to {share:.1%} of failures are possible there (95 %)",
)
SHORT_WIND = Message(
    "W980",
    "{exposure} in a run, and the mean speeds of codes are those of ten minutes. In ten "
    "minutes the roof fails at lower speeds: the probabilities are too small",
)
NO_RESULT = Message(
    "E983",
    "{path}: none of {total:sample} has a result, so nothing is known about the roof. See the reasons with "
    "netfall info",
)
LEFT_OUT = Message(
    "W982",
    "{count} of {total} samples are left out of shares, curves and probabilities. If the roof fails in them, "
    "these are too small. See the reasons with netfall info; repeat failed samples with --retry",
)
