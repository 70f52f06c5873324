"""Messages of the package `exchange`: export of results, import of drawings and meshes."""

from netfall.core.messages import Message

# export
UNKNOWN_ENDING = Message("E741")
NO_FOLDER = Message("E742")
OUTPUT_KIND = Message("E743")
FOREIGN_FILE = Message("E744")
FOREIGN_TABLE = Message("E745")
OTHER_COPY = Message("E746")
TIME_OF_EQUILIBRIUM = Message("E747")
TIME_AND_CASE = Message("E748")
METRES_ONLY = Message("E749")
CONTENTS_LEFT_OUT = Message("N750")
UNKNOWN_CASE = Message("E751")
CASE_WITHOUT_EQUILIBRIUM = Message("E752")
GUIDED_NODES = Message("E753")
LARGE_TAGS = Message("E788")
NOT_LINEAR_ELASTIC = Message("W754")
DOUBLE_EDGES = Message("W755")
STATE_WITHOUT_EQUILIBRIUM = Message("W786")
WITHOUT_LOADS = Message("N756")

# job.toml of an exported net
NO_JOB = Message("N768")
FILE_GONE = Message("W762")
FILE_CHANGED = Message("W764")
# import
IMPORT_TO_FILE = Message("E771")
FOREIGN_NODES = Message("E772")
UNKNOWN_DRAWING = Message("E773")
UNREADABLE_DRAWING = Message("E774")
DAMAGED_DRAWING = Message("E775")
NO_EDGES = Message("E776")
WRONG_COORDINATE = Message("E777")
NO_LINES = Message("E778")
ONLY_SHORT_LINES = Message("E779")
UNKNOWN_LAYER = Message("E780")
NO_UNIT = Message("E781")
NO_NODE_HELD = Message("E782")
UNUSUAL_EXTENT = Message("W783")
LARGEST_PART_LEFT_OUT = Message("W784")
CHAIN_OF_ENDS = Message("W785")
