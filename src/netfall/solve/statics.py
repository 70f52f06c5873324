"""The static stage: load steps to equilibrium by the same particles, under dynamic relaxation (paper 4.1.2)."""

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from netfall.errors import DivergedError
from netfall.mechanics.state import State
from netfall.output.result import Result
from netfall.parallel.halo import Halo
from netfall.solve.energy import take_snapshot
from netfall.solve.relax import Paused, Relaxation, net_forces, relax
from netfall.solve.stop import StopRequest


@dataclass
class StaticPath:
    """Load-displacement history: one entry for each load step that is done."""

    reference: float = 0.0  # N, which the tolerance refers to
    load_factor: list[float] = field(default_factory=list)
    residual: list[float] = field(default_factory=list)  # N
    slack: list[int] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)


def find_equilibrium(
    comm: MPI.Comm,
    state: State,
    settings,
    halo: Halo,
    result: Result,
    progress,
    stop: StopRequest,
    path: StaticPath | None,
    resume: Relaxation | None,
) -> StaticPath:
    """Bring the state to equilibrium under its load in equal steps. Collective.

    path, resume : how far an earlier run came, and where within the load step after that; None: from the start

    Within a load step the plastic strains are those of the step before; what has flowed is kept at its end.
    """
    if path is None:
        N = state.elements_now()[0]
        path = StaticPath(
            comm.allreduce(
                max(np.abs(N).max(initial=0.0), np.abs(state.load[: state.n_owned]).max(initial=0.0)), MPI.MAX
            )
        )
    progress.start()

    def bound(x):
        N, _, _, L = state.elements_now()
        return state.EA / state.L0 + np.abs(N) / np.maximum(L, 1e-300)

    for step in range(len(path.load_factor) + 1, settings.steps + 1):
        share = step / settings.steps
        try:
            iterations, residual = relax(
                comm,
                halo,
                state.x,
                state.free,
                state.ends,
                net_forces(state, share),
                bound,
                settings.tolerance * path.reference,
                settings.max_iterations,
                f"static load step {step} of {settings.steps}",
                stop=stop,
                resume=resume,
            )
        except Paused as pause:
            pause.path = path
            raise
        resume = None
        snapshot = take_snapshot(state, 0.0, 1.0, 0.0, 0.0)
        _stop_at_fracture(comm, state, snapshot, share, result)
        if state.scene.plastic:
            state.dissipated[:] = snapshot.heat
            state.eps_p[:] = snapshot.eps_p
        slack = comm.allreduce(snapshot.slack)
        path.load_factor.append(share)
        path.residual.append(residual)
        path.slack.append(slack)
        path.iterations.append(iterations)
        result.write_static_step(state, snapshot)
        progress.at(share, f"load factor {share:.3f}", sum(path.iterations), "iterations", f"slack {slack}")
    return path


def _stop_at_fracture(comm, state, snapshot, share, result):
    if not state.scene.fracture:
        return
    over = result.distribution.piece.element_gid[snapshot.eps > state.eps_u]
    first = comm.allreduce(int(over.min()) if len(over) else np.iinfo(np.int64).max, MPI.MIN)
    if first < np.iinfo(np.int64).max:
        raise DivergedError(
            f"the static load breaks element {first} at load factor {share:.4g}: there is no static equilibrium to start from; "
            "lower the load, or set steps = 0 to let it act at once in the dynamic stage"
        )
