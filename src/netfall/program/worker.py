"""The ranks of a study that stay: they run one member after another (`study.pool` is the other side).

    mpirun -n 2 python -m netfall.program.worker

Each line of standard input is a task, JSON: `job`, a path; `overrides` of --set; `removes`, entries of
[[remove]]; `result`, a path or null; `profile`, whether the parts of a step are timed; `net`, whether the
net in its form is wanted in place of a run; `depth`, of `sunk_area`, or null. The first line of standard
output says that the ranks have started; then each answers a task, with what `program.member` tells. The end
of input ends the ranks.
"""

import base64
import json
import os
import signal
import sys
from pathlib import Path

from netfall.__main__ import abort  # which also sees to one thread for each rank

REMEMBERED = 4  # forms, rests and winds of earlier members


def next_task(comm) -> dict | None:
    """The task that rank 0 has read, on every rank; None at the end. Collective."""
    from netfall.parallel.agree import on_root

    line = comm.bcast(on_root(comm, sys.stdin.readline))
    return json.loads(line) if line.endswith("\n") else None


def packed(array) -> dict:
    """An array as text, to the last bit."""
    return {
        "type": array.dtype.str,
        "shape": array.shape,
        "bytes": base64.b64encode(array.tobytes()).decode(),
    }


def serve() -> None:
    """Work on tasks until there are no more."""
    from netfall.parallel.alone import world

    comm = world()
    from netfall.ground.sources import TELLING, program_digest
    from netfall.job.memory import Memory
    from netfall.job.read import read_job
    from netfall.parallel.agree import on_root
    from netfall.program.compile import compile_first
    from netfall.program.member import net_of, run_member

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a study that is interrupted ends its workers itself
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries that print by themselves
    compile_first(comm)  # of several workers too the first compiles
    if comm.rank == 0:
        print(json.dumps({"ranks": comm.size, "program": program_digest(TELLING)}), file=answers, flush=True)
    memory = Memory(REMEMBERED)
    while (task := next_task(comm)) is not None:
        words = task["job"], task["overrides"], task["removes"]
        read = lambda words=words: comm.bcast(on_root(comm, lambda: read_job(*words)))
        result = Path(task["result"]) if task["result"] else None
        if task["net"]:
            net = net_of(comm, read, memory)
            found = {"net": {name: packed(array) for name, array in (net or {}).items()}}
        else:
            found = run_member(comm, read, result, memory, task["profile"], task["depth"])
        if comm.rank == 0:
            print(json.dumps(found), file=answers, flush=True)


def main() -> None:
    """Entry point."""
    try:
        serve()
    except BaseException as error:
        abort(error)


if __name__ == "__main__":
    main()
