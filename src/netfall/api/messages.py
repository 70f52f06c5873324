"""Messages of the package `api`: arguments of `netfall.run` and arrays of a `Net`."""

from netfall.core.messages import Message

WRONG_RANKS = Message("E061")
UNDER_MPIRUN = Message("E062")
NODES_WITHOUT_ELEMENTS = Message("E063")
WRONG_ARRAY = Message("E064")
ARRAY_AS_COLUMN = Message("E065")
WRONG_COLUMN = Message("E066")
WRONG_CELL = Message("E067")
RAGGED_ARRAY = Message("E068")
NO_CHECKPOINT = Message("N069")
