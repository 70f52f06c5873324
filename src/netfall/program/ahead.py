"""Compiling the time loop in a process of its own, while the run finds its form and its equilibria.

It is half of what the first run of a scene compiles, and what it is compiled for follows from what the scene
has, long before there is a state to step. The process makes a net of one element with the same features and
compiles what steps it, into the cache in which the run will look; a second one, its child, takes turns with
it at the loop and at what that calls by its address. Where they are late, or were wrong about the scene, the
run compiles for itself.
"""

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numba
import numpy as np

from netfall.ground.compile import once_for
from netfall.job.job import Job
from netfall.mechanics.fields import Features
from netfall.mechanics.fracture import FractureRules
from netfall.mechanics.state import State
from netfall.model.layout import features_of
from netfall.model.probes import Probes
from netfall.net.net import Net
from netfall.parallel.halo import buffers_alone
from netfall.record.energy import take_snapshot
from netfall.record.envelope import Envelope
from netfall.record.rows import RowTable
from netfall.step.loop import Interval, time_loop
from netfall.step.plan import Plan

# Without MPI: importing mpi4py would else start it, once more in the place of a rank.
START = "import mpi4py; mpi4py.rc.initialize = False; from netfall.program.ahead import main; main()"
CROWDED = 2.0  # times as many threads at work as processors: it would hold up the run
NONE = np.zeros(0, np.int64)


class Ahead(NamedTuple):
    """What the types of the time loop's arguments follow from.

    sideways : whether loads along x or y are to be expected; timed : whether its parts are
    """

    features: Features
    sideways: bool
    timed: bool


def compile_ahead(job: Job, net: Net, timed: bool) -> None:
    """Start the process if the time loop of such a scene has yet to be compiled. Rank 0."""
    if job.dynamics is None or not hasattr(time_loop, "overloads"):  # where kernels run as plain Python
        return
    if net.bending is not None or job.motions or job.slides:  # their types follow from where they are
        return
    ahead = ahead_of(job, net, timed)
    if once_for(ahead).exists() or at_work() > CROWDED * os.cpu_count():
        return
    with contextlib.suppress(OSError):  # where no more processes are allowed, or it was ended at once
        process = subprocess.Popen(
            [sys.executable, "-c", START],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # a Ctrl-C is for the run
        )
        threading.Thread(target=process.wait, daemon=True).start()
        with process.stdin:
            process.stdin.write(pickle.dumps((os.getpid(), ahead)))


def at_work() -> int:
    """Threads at work on this machine right now; of those of the last minute many are no more."""
    return int(Path("/proc/loadavg").read_text().split()[3].split("/")[0])


def ahead_of(job: Job, net: Net, timed: bool) -> Ahead:
    """What is known of a scene before it has a state."""
    loads = [vars(job.load), *job.load.zone.values()] if job.load else []
    pressures = [load.get("pressure") for load in loads]
    pressed = any(np.any(p[:2] if np.ndim(p) else p) for p in pressures if p is not None)
    return Ahead(features_of(job, net, None), pressed or bool(net.load[:, :2].any()), timed)


def main() -> None:
    """The process: what it compiles, from standard input. It ends with the run that started it."""
    run, ahead = pickle.load(sys.stdin.buffer)
    os.sched_setaffinity(0, range(os.cpu_count()))  # ranks may be bound to one processor each
    done, state = once_for(ahead), state_with(ahead)
    plan = plan_of(ahead, state)
    second = _work_through(
        [
            *(entry.prepare for entry in plan.apart),
            lambda: time_loop.compile(types_of(ahead, plan)),
            lambda: take_snapshot(state, 0.0, 1.0, 0.0, 0.0),
            plan.collect_yield,
        ],
        run,
    )
    os.waitpid(second, 0)
    done.touch()


def _work_through(tasks: list, run: int) -> int:
    """Do tasks in turn with a child of this process, which ends behind them; the child."""
    to_do, of_tasks = os.pipe()
    os.write(of_tasks, bytes(range(len(tasks))))
    os.close(of_tasks)
    me, second = os.getpid(), os.fork()
    threading.Thread(target=_end_with, args=(run if second else me,), daemon=True).start()
    while number := os.read(to_do, 1):
        tasks[number[0]]()
    if not second:
        os._exit(0)
    return second


def _end_with(run: int) -> None:
    """End this process when that which started it is no more."""
    while os.getppid() == run:
        time.sleep(0.2)
    os._exit(1)


def state_with(ahead: Ahead) -> State:
    """A state of one element with the features of the scene."""
    state = State(ahead.features, 2, 0, 1)
    state.ends[0], state.owned[:], state.free[:], state.mass[:] = (0, 1), 1, 1, 1.0
    state.EA[:], state.L0[:], state.x[1, 0] = 1.0, 1.0, 1.0
    state.load[:, 0] = 1.0 if ahead.sideways else 0.0
    return state


def plan_of(ahead: Ahead, state: State) -> Plan:
    """A plan as that of the scene."""
    features = ahead.features
    rules = FractureRules(2, 2, 2, np.zeros(1, np.int64), 1.0, True, True, True, 1.0)
    subdomain = SimpleNamespace(n_owned=2, particle_gid=np.arange(2), element_gid=np.arange(1))
    envelope, probes = Envelope(SimpleNamespace(subdomain=subdomain)), Probes(*[NONE] * 4)
    rows = RowTable(state, np.zeros(1, np.int64), 1.0, 1, subdomain, probes, envelope)
    alone = SimpleNamespace(boundary=0, buffers=buffers_alone())  # the exchange of one rank
    return Plan(state, alone, rules if features.fracture else None, rows)


def types_of(ahead: Ahead, plan: Plan) -> tuple:
    """The types of the arguments with which a run calls the time loop."""
    arguments = Interval(0, 0, 0.0, 1.0, 0.0, 0.0, 1.0), *plan.laid
    seconds = np.zeros(4) if ahead.timed else None
    return tuple(map(numba.typeof, (*arguments, buffers_alone(), seconds)))
