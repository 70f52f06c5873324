"""Messages of the package `parallel`: MPI, partition files, shared memory."""

from netfall.core.messages import Message

NO_MPI = Message("E011")
UNREADABLE_GRAPH = Message("E012")
OTHER_GRAPH = Message("E013")
DAMAGED_PARTITION = Message("E014")
WRONG_RANKS_PER_NODE = Message("E015")
OTHER_OPTIONS = Message("E016")
