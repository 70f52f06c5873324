"""Messages of the command line."""

from netfall.core.messages import Message

WRONG_ARGUMENTS = Message("E021")
UNKNOWN_OPTION = Message("E022")
UNKNOWN_COMMAND = Message("E023")
OUTPUT_IS_FILE = Message("E026")
NO_PARTS = Message("E031")
TOO_MANY_PARTS = Message("E032")
JSON_OF_STUDY = Message("E033")
ANIMATION_OPTIONS = Message("E034")
CASE_OF_STUDY = Message("E035")
STUDY_WITHOUT_FRAMES = Message("E036")
SAMPLE_OF_RESULT = Message("E037")
STUDY_UNDER_MPIRUN = Message("E040")
NO_CACHE_FOLDER = Message("E042")
NO_PAGE_NAME = Message("E041")
CASE_OF_ANIMATION = Message("E043")
