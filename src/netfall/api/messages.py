"""Messages of the package `api`: arguments of `netfall.run` and arrays of a `Net`."""

from netfall.core.messages import Message

WRONG_RANKS = Message("E061", "ranks = {ranks!r}: expected a whole number >= 1")
UNDER_MPIRUN = Message(
    "E062",
    "netfall.run: starts the ranks of a run itself. Start the script without mpirun, as one process, and "
    "give ranks = P.",
)
NODES_WITHOUT_ELEMENTS = Message(
    "E063", "net: nodes without elements. Give both, as arrays or as names of tables."
)
WRONG_ARRAY = Message(
    "E064",
    "Net: {name} has the shape {shape} of {type}: expected {expected}",
    "Nodes have three coordinates in m, elements two ids of nodes, and ids are integers. Convert other "
    "arrays with numpy.asarray and astype.",
)
ARRAY_AS_COLUMN = Message("E065", "Net: {name} {column!r}: would replace {array}. Give it as {array}.")
WRONG_COLUMN = Message(
    "E066", "Net: {name} {column!r} has the shape {shape}: expected ({rows},), or one value"
)
WRONG_CELL = Message("E067", "Net: {name} {column!r}: {value!r} in row {row}: expected {expected}")
RAGGED_ARRAY = Message("E068", "Net: {name}: expected an array, whose rows have the same length")
NO_CHECKPOINT = Message("N069", "interrupted. Give output to keep a checkpoint")
