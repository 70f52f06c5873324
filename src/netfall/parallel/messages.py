"""Messages of the package `parallel`: MPI, partition files, shared memory."""

from netfall.core.messages import Message

AGAIN = "run `netfall partition JOB -n {parts}` again, or remove the file"

NO_MPI = Message("E011", "no MPI library: {reason}. {install}")
UNREADABLE_GRAPH = Message("E012", "{graph}: cannot be read ({error}); {path} needs it; " + AGAIN)
OTHER_GRAPH = Message(
    "E013",
    "{graph}: belongs to another net, or was not written by this version (it has {head} vertices and edges, "
    "the net of the job {n} {edges}); " + AGAIN,
)
DAMAGED_PARTITION = Message(
    "E014", "{path}: damaged; expected {n} numbers from 0 to {last}, one per line; " + AGAIN
)
WRONG_RANKS_PER_NODE = Message(
    "E015",
    'environment variable {variable}: "{value}"; allowed is a number of ranks from 1; unset it to share '
    "memory between all ranks of a node",
)
OTHER_OPTIONS = Message(
    "E016",
    "netfall run: {name}: rank 0 has {first}, rank {rank} has {value}; start all ranks with the same options",
)
