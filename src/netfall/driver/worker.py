"""Worker ranks of a study, which run one sample after another (`study.pool` is the other side).

    mpirun -n 2 python -m netfall.driver.worker

Each line of standard input is a task, JSON: `job`, a path; `overrides` of --set; `removes`, entries of
[[remove]]; `result`, a path or null; `profile`, whether the parts of a step are timed; `net`, whether to
return the net in its form instead of a run; `depth`, of `sunk_area`, or null. The first line of standard
output says that the ranks have started. Each further line answers a task with the outcomes of
`driver.sample`. The ranks end when the input ends.
"""

import base64
import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from netfall.__main__ import abort  # its import also limits each rank to one thread

if TYPE_CHECKING:
    import numpy as np

    from netfall.job.job import Job
    from netfall.parallel.mpi import MPI

CACHE_SIZE = 4  # number of cached forms, equilibria and winds of earlier samples


def next_task(comm: "MPI.Comm") -> dict[str, Any] | None:
    """Return the next task from the input of rank 0, on every rank; None at its end. Collective."""
    from netfall.parallel.agree import on_root

    line = comm.bcast(on_root(comm, sys.stdin.readline))
    return json.loads(line) if line.endswith("\n") else None


def encode_array(array: "np.ndarray") -> dict[str, Any]:
    """Encode an array as text without loss."""
    return {
        "type": array.dtype.str,
        "shape": array.shape,
        "bytes": base64.b64encode(array.tobytes()).decode(),
    }


def run_tasks() -> None:
    """Run tasks until the input ends."""
    from netfall.parallel.alone import world_communicator

    comm = world_communicator()
    from netfall.core.cache import PRESENTATION_PACKAGES, program_digest
    from netfall.driver.compile import compile_missing
    from netfall.driver.sample import run_sample, study_net
    from netfall.job.cache import ResultCache
    from netfall.job.read import read_job
    from netfall.parallel.agree import on_root

    def read(task: dict[str, Any]) -> "Job":
        return comm.bcast(on_root(comm, lambda: read_job(task["job"], task["overrides"], task["removes"])))

    def send(answer: dict[str, Any] | None) -> None:
        if comm.rank == 0:
            print(json.dumps(answer), file=answers, flush=True)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted study ends its workers itself
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of libraries must not mix with answers
    compile_missing(comm)  # one of several workers compiles for all
    send({"ranks": comm.size, "program": program_digest(PRESENTATION_PACKAGES)})
    memory = ResultCache(CACHE_SIZE)
    while (task := next_task(comm)) is not None:
        result = Path(task["result"]) if task["result"] else None
        if task["net"]:
            net = study_net(comm, partial(read, task), memory) or {}
            send({"net": {name: encode_array(array) for name, array in net.items()}})
        else:
            send(run_sample(comm, partial(read, task), result, memory, task["profile"], task["depth"]))


def main() -> None:
    """Run the worker as a program."""
    try:
        run_tasks()
    except BaseException as error:
        abort(error)


if __name__ == "__main__":
    main()
