"""Messages of the package `exchange`: export of results, import of drawings and meshes."""

from netfall.core.messages import Message

# --- export

UNKNOWN_ENDING = Message("E741", "-o {target}: the ending names the format, expected one of {endings}.")
NO_FOLDER = Message("E742", "-o {target}: the folder {folder} does not exist. Make it.")
OUTPUT_KIND = Message("E743", "-o {target}: is {kind} already. Give another name.")
FOREIGN_FILE = Message(
    "E744", "-o {target}: exists, and netfall did not export it. Give another name or remove the file."
)
FOREIGN_TABLE = Message(
    "E745",
    "-o {folder}: has {file} already, and netfall did not export it. Give another name.",
    "An export replaces only files that an earlier export wrote, so that tables of yours are not lost.",
)
OTHER_COPY = Message("E746", "-o {folder}: has another {file} already. Give another name.")
TIME_OF_EQUILIBRIUM = Message(
    "E747", "--time: a {ending} contains an equilibrium, not a state in motion. Leave --time out."
)
TIME_AND_CASE = Message("E748", "--time and --case: each names a state. Leave one of them out.")
METRES_ONLY = Message(
    "E749", "--unit {unit}: a {ending} is written in metres. Leave --unit out or export a .dxf."
)
CONTENTS_LEFT_OUT = Message("N750", "a {ending} does not contain this net's {contents}. A .csv does.")
UNKNOWN_CASE = Message("E751", "--case {case}: no such case in {path}; {advice}")
CASE_WITHOUT_EQUILIBRIUM = Message(
    "E752", "--case {case}: has no equilibrium ({reason}). Give a case that has one."
)
GUIDED_NODES = Message(
    "E753",
    "{path}: {nodes}: held along one axis at an angle, for which OpenSees has no fix. Put a stiff spring "
    "in place of fixed_x or fixed_y there.",
)
LARGE_TAGS = Message(
    "E788", "{path}: ids up to {last}: OpenSees takes tags up to {limit}. Number nodes and elements from 1."
)
NOT_LINEAR_ELASTIC = Message(
    "W754",
    "{path}: elements that are not linear elastic in this state: {count}. Their unstressed lengths give "
    "the same force only in this equilibrium, and OpenSees may not reach it from the form.",
    "They yielded or slipped, the strain is logarithmic, or the case changes lengths. The exported trusses "
    "are linear elastic. Compare equilibria under other loads with care.",
)
DOUBLE_EDGES = Message(
    "W755",
    "{path}: elements between nodes that another element joins: {count}. A Graph contains one of them; "
    "export a .csv for all.",
)
FORM_OF_FAILED_STAGE = Message(
    "W786",
    "{stage}: no equilibrium was found. The exported geometry, forces and unstressed lengths are those that "
    "the search left, not a form. Correct the stage and run again.",
)
WITHOUT_LOADS = Message(
    "N756", "{state}: without loads, masses, springs and sections, which belong to the form."
)

# --- job.toml of an exported net

NO_JOB = Message(
    "N768",
    "job.toml: not written: {reason}, so the job of the run would compute something else with the tables.",
    "For a run of the exported net write a job that reads the tables. They contain the form, its unstressed "
    "lengths with their errors, and the random strengths if elements left the net: leave out [form_finding], "
    "[[target]], [[stage]], length_std, and in that case strength_cov. Parts of subdivided bars need the "
    "buckling_length of the whole bar. Nodes between parts of elements end free segments of sliding cables.",
)
FILE_GONE = Message("W762", "{key} = {name}: {source} no longer exists. Put it next to job.toml.")
FILE_CHANGED = Message(
    "W764",
    "{target}: copied from {source}, which has changed since the run. Put the file of the run there.",
)
# --- import

IMPORT_TO_FILE = Message("E771", "-o {folder}: is a file. Give a folder.")
FOREIGN_NODES = Message(
    "E772",
    "-o {folder}: contains a nodes.csv that no import wrote. Give another folder.",
)
UNKNOWN_DRAWING = Message("E773", "{path}: expected a file with one of the endings {endings}.")
UNREADABLE_DRAWING = Message("E774", "{path}: {reason}. Give {kind}.")
DAMAGED_DRAWING = Message("E775", "{path}: not {kind} that can be read: {error}")
NO_EDGES = Message("E776", "{path}: no edges. Give a Graph, Network or Mesh of COMPAS.")
WRONG_COORDINATE = Message("E777", "{path}: a coordinate is not a number, or larger than {limit:g}.")
NO_LINES = Message(
    "E778",
    "{path}: no lines of a net{omissions}.",
    "netfall reads lines, polylines, curves and sides of faces of the model space. Entities on layers that "
    "are off or frozen, and those of layers that --layers does not name, are left out.",
)
ONLY_SHORT_LINES = Message(
    "E779",
    "{path}: no line is longer than the tolerance of {tolerance:g} m. Reduce --tolerance, or give --unit.",
)
UNKNOWN_LAYER = Message(
    "E780", "{option} {name}: expected {alternatives}a layer or group with lines; {advice}"
)
NO_UNIT = Message(
    "E781",
    "{path}: the drawing has no unit that is known ({source}). Give --unit, one of {units}; the extent is "
    "{extent} in that unit.",
)
NO_NODE_HELD = Message(
    "E782",
    "{path}: no node is held. Give --supports: a layer, points or outline. Layers: {layers}.",
)
UNUSUAL_EXTENT = Message(
    "W783",
    "unit: an extent of {extent:.4g} m is unusual for a roof ({low:g} to {high:g} m). Check whether the unit "
    "is {unit}; --unit sets another.",
)
LARGEST_PART_LEFT_OUT = Message(
    "W784",
    "largest part left out: {count} of {total} elements have no support. Give --supports: a layer, points "
    "or outline.",
    "Parts of a net without a support are mechanisms and are left out. If this is the largest part, the "
    "supports of the roof were not found.",
)
CHAIN_OF_ENDS = Message(
    "W785",
    "joining: chains of ends became one node over {moved:.3g} m (tolerance {tolerance:g} m). Lines are lost. "
    "Reduce --tolerance.",
    "Ends within the tolerance are one node. Short lines, such as those of a dense polyline, make chains of "
    "such ends, and all ends of a chain become one node.",
)
