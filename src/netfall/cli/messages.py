"""Messages of the command line."""

from netfall.core.messages import Message

WRONG_ARGUMENTS = Message("E021", "{program}: {reason}; {program} --help lists its options")
UNKNOWN_OPTION = Message("E022", "{program}: {option}: unknown option; {advice}")
UNKNOWN_COMMAND = Message("E023", "netfall {word}: unknown command; {advice}")
OUTPUT_IS_FILE = Message("E026", "-o {path}: {existing} is a file; expected a folder")
NO_PARTS = Message("E031", "-n {parts}: expected a number of parts >= 1")
TOO_MANY_PARTS = Message("E032", "-n {parts}: expected at most as many parts as particles, {particles}")
JSON_OF_STUDY = Message("E033", "{path}: --json is for the result of one run, not for a study file")
ANIMATION_OPTIONS = Message("E034", "netfall plot: {names}: only for an animation; add --animate")
CASE_OF_STUDY = Message("E035", "--case {case}: {path} is a study file; give the result file of one run")
STUDY_WITHOUT_FRAMES = Message(
    "E036", "{path}: a study file has no frames; animate the result file of one run"
)
SAMPLE_OF_RESULT = Message("E037", "--sample {sample}: {path} is not a study file; leave the option out")
STUDY_UNDER_MPIRUN = Message(
    "E040", "netfall study: starts ranks itself; run it without mpirun, with [run] ranks = P"
)
NO_CACHE_FOLDER = Message("E042", "compiled code has no folder that can be written. Set {variable} to one")
NO_PAGE_NAME = Message("E041", "-o {path}: expected a name that ends in .html")
CASE_OF_ANIMATION = Message(
    "E043", "netfall plot: --case {case}: an animation shows all states; leave out --case or --animate"
)
