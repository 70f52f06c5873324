"""The static stage: load steps to equilibrium by the same particles, under dynamic relaxation (paper
4.1.2).
"""

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from netfall.errors import DivergedError
from netfall.solve.energy import take_snapshot
from netfall.solve.relaxation import Paused, Relaxation, largest_force, net_of, relax


@dataclass
class StaticPath:
    """Load-displacement history: one entry for each load step that is done."""

    reference: float = 0.0  # N, which the tolerance refers to
    load_factor: list[float] = field(default_factory=list)
    residual: list[float] = field(default_factory=list)  # N
    slack: list[int] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)


def find_equilibrium(run, path: StaticPath | None, resume: Relaxation | None) -> StaticPath:
    """Bring the state to equilibrium under its load in equal steps. Collective.

    run : `run.Run`; path, resume : how far an earlier run came, and where within the load step after
        that; None: from the start

    Within a load step the plastic strains are those of the step before; what has yielded is kept at its end.
    Raises Paused where it is asked to stop, DivergedError where there is no equilibrium.
    """
    comm, state, settings, progress = run.comm, run.setup.state, run.job.load, run.progress
    if path is None:
        N, load = state.elements_now().N, state.load[: state.n_owned]
        path = StaticPath(largest_force(comm, N, state.ends, state.free, load))
    progress.start()

    for step in range(len(path.load_factor) + 1, settings.steps + 1):
        factor = step / settings.steps
        try:
            iterations, residual = relax(
                comm,
                run.setup.halo,
                net_of(state, factor),
                settings.tolerance * path.reference,
                settings.max_iterations,
                f"static load step {step} of {settings.steps}",
                stop=run.stop,
                resume=resume,
            )
        except Paused as pause:
            pause.path = path
            raise
        resume = None
        snapshot = take_snapshot(state, 0.0, 1.0, 0.0, 0.0)
        _stop_at_fracture(run, snapshot, factor)
        if state.scene.plastic:
            state.dissipated[:] = snapshot.heat
            state.eps_p[:] = snapshot.eps_p
        slack = comm.allreduce(snapshot.slack)
        path.load_factor.append(factor)
        path.residual.append(residual)
        path.slack.append(slack)
        path.iterations.append(iterations)
        run.result.write_static_step(state, snapshot)
        progress.at(factor, f"load factor {factor:.3f}", sum(path.iterations), "iterations", f"slack {slack}")
    return path


def _stop_at_fracture(run, snapshot, factor: float) -> None:
    """A static stage has no fractures. Raises DivergedError where one is due."""
    state, setup = run.setup.state, run.setup
    if not state.scene.fracture:
        return
    none = np.iinfo(np.int64).max
    over = setup.distribution.subdomain.element_gid[snapshot.eps > state.eps_u]
    first = run.comm.allreduce(int(over.min()) if len(over) else none, MPI.MIN)
    if first < none:
        name = run.comm.bcast(setup.model and setup.model.id_of(first))
        raise DivergedError(
            f"the static load breaks element {name} at load factor {factor:.4g}: there is no static "
            "equilibrium to start from; lower the load, or set steps = 0 to let it act at once in the "
            "dynamic stage"
        )
