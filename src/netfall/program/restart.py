"""Saving a run and taking it up again, on any number of ranks."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.relaxation import Paused, Relaxation
from netfall.job.read import Job
from netfall.mechanics.events import COLUMNS
from netfall.mechanics.state import State
from netfall.parallel.agree import on_root
from netfall.parallel.subdomain import Distribution
from netfall.stages.form import Form
from netfall.write.checkpoint import (
    KEPT,
    Checkpoint,
    checkpoint_path,
    kept_fields,
    remove_older,
    write_checkpoint,
)
from netfall.write.result import Result
from netfall.write.segments import find_segments

PREFIX, EVENTS = "wind_", "events_"  # of the arrays of the wind and of the log in a checkpoint
RELAXED = ("x", "v", "mass")  # arrays of a relaxation


class Saver:
    """Writes the checkpoints of a run and keeps the last two; given : the one that the run goes on from."""

    def __init__(self, job: Job, setup, result: Result, given: Path | None):
        self.job, self.setup, self.result, self.given = job, setup, result, given
        self.comm = result.comm
        self.kept: list[Path] = []  # written by this run
        self.statics = None  # the static stage, as far as it is done

    def naming_the_last(self, error: Exception) -> Exception:
        """The same error, with the checkpoint to go on from, if there is one."""
        last = self.kept[-1] if self.kept else self.given
        if last:
            error.args = (f"{error}; the last good checkpoint is {last} (--restart)",)
        return error

    def __call__(self, simulation) -> Path:
        """Write a checkpoint of the simulation at its present step; its path. Collective."""
        record, arrays = {"simulation": simulation.record()}, simulation.history.arrays()
        arrays |= simulation.envelope.arrays(simulation.state)
        if simulation.removal:
            arrays |= simulation.removal.arrays()
        if simulation.wind:
            wind = simulation.wind.record()
            record["wind"] = {"k": wind["k"], "history": wind["history"]}
            arrays |= {f"{PREFIX}{name}": values for name, values in wind["arrays"].items()}
        return self._write("dynamics", simulation.n, simulation.state, record, arrays)

    def pause_statics(self, pause: Paused) -> Path:
        """Write a checkpoint of the static stage where its relaxation was paused; its path. Collective."""
        self.statics = pause.path
        record, arrays = relaxation_record(self.result.distribution, pause.at)
        step = pause.path.total + pause.at.total + pause.at.iteration
        return self._write("statics", step, self.setup.state, record, arrays)

    def _write(self, stage: str, step: int, state: State, own_record: dict, own_arrays: dict) -> Path:
        result, setup = self.result, self.setup
        rows = result.cut()
        path = checkpoint_path(result.path, stage, step)
        record = result.record() | {
            "job": setup.digest,
            "name": self.job.title or self.job.name,
            "stage": stage,
            "result": result.path.name,
            "rows": rows,
            "residual": setup.residual,
            "statics": asdict(self.statics) if self.statics else None,
        }
        if setup.form:
            names = ("iterations", "residual", "reference")
            record["form"] = {name: getattr(setup.form, name) for name in names}
        arrays = {f"{EVENTS}{name}": values for name, values in result.log.columns().items()}
        if setup.model:
            arrays |= {"x": setup.model.x, "N": setup.model.N}
        write_checkpoint(self.comm, path, state, result, record | own_record, arrays | own_arrays)
        self.kept = [p for p in self.kept if p != path] + [path]
        if self.comm.rank == 0:
            self._remove_older(result.path)
        self.kept = self.kept[-KEPT:]
        return path

    def _remove_older(self, result: Path) -> None:
        for old in self.kept[:-KEPT]:
            if not (self.given and old.exists() and old.samefile(self.given)):
                old.unlink(missing_ok=True)
        remove_older(self.kept[-1], result, self.setup.digest, self.given)


def pause_form_finding(
    job: Job, result_path: Path, digest: str, distribution: Distribution, pause: Paused, given: Path | None
) -> Path:
    """Write a checkpoint of the form finding where it was paused; its path.

    Collective. given : as in `Saver`
    """
    path = checkpoint_path(result_path, "form finding", pause.at.iteration)
    record, arrays = relaxation_record(distribution, pause.at)
    record |= {"job": digest, "name": job.title or job.name, "stage": "form finding"}
    write_checkpoint(distribution.comm, path, None, None, record, arrays)
    if distribution.comm.rank == 0:
        remove_older(path, result_path, digest, given)
    return path


def relaxation_record(distribution: Distribution, at: Relaxation) -> tuple[dict, dict[str, np.ndarray]]:
    """A relaxation as small values and, on rank 0, global arrays, for `restore_relaxation`. Collective."""
    arrays = {f"relax_{name}": distribution.gather_particles(getattr(at, name)) for name in RELAXED}
    small = {"iteration": at.iteration, "previous": at.previous, "rested": bool(at.rested), "stage": at.stage}
    small["total"] = at.total
    return {"relax": small}, arrays if distribution.comm.rank == 0 else {}


def restore_relaxation(distribution: Distribution, checkpoint: Checkpoint | None) -> Relaxation | None:
    """The relaxation that a checkpoint was written in, None if it was none. Collective."""
    record = distribution.comm.bcast(checkpoint and checkpoint.record.get("relax"))
    if record is None:
        return None
    return Relaxation(
        **record,
        **{
            name: distribution.particles(checkpoint and checkpoint.arrays[f"relax_{name}"])
            for name in RELAXED
        },
    )


def restored_form(record: dict) -> Form | None:
    """What is known of the form finding of the interrupted run."""
    if "form" not in record:
        return None
    return Form(None, None, **record["form"])


def restore_state(distribution: Distribution, state: State, checkpoint: Checkpoint | None) -> None:
    """The arrays of one rank from a checkpoint that rank 0 has read. Collective.

    Particles that split off go to the rank that keeps their element, as in `fracture.split_particles`.
    """
    comm, n = distribution.comm, distribution.n
    particles = kept_fields(state, "particle")
    split = comm.bcast({f.name: checkpoint.particles[f.name][n:] for f in particles} if checkpoint else None)
    gid = comm.bcast(_split_numbers(checkpoint) if checkpoint else None)
    for field in particles:
        rows = distribution.particles(checkpoint.particles[field.name][:n] if checkpoint else None)
        getattr(state, field.name)[: state.n_local] = rows.reshape(len(rows), *field.tail)
    for field in kept_fields(state, "element"):
        getattr(state, field.name)[:] = distribution.elements(
            checkpoint.elements[field.name] if checkpoint else None
        )
    if not state.features.fragments:
        state.EA[state.broken == 1] = 0.0
    if state.lost is not None:
        state.EA[state.lost == 1] = 0.0
    ends = distribution.elements(checkpoint.elements["ends"] if checkpoint else None)
    state.reserve(int((ends >= n).sum()))
    for e in np.flatnonzero((ends >= n).any(1)).tolist():
        parted = np.flatnonzero(ends[e] >= n).tolist()
        keeper = state.ends[e, 1 - parted[0]] if len(parted) == 1 else state.ends[e, 0]
        state.owned[e] = state.own(keeper)
        if not state.owned[e]:
            state.EA[e] = 0.0
            continue
        for end in parted:
            j = state.n_local
            state.n_local += 1
            row = int(np.searchsorted(gid, ends[e, end]))
            for field in particles:
                getattr(state, field.name)[j] = split[field.name][row].reshape(field.tail)
            state.gid[j] = ends[e, end]
            state.ends[e, end] = j


def _split_numbers(checkpoint: Checkpoint) -> np.ndarray:
    new = checkpoint.arrays["events_new_particle"]
    return np.sort(new[new >= 0])


def restore_result(comm: MPI.Comm, result: Result, checkpoint: Checkpoint | None, digest: str) -> None:
    """The log of fractures and the result file's parts so far. Collective."""
    known = lambda: {name: checkpoint.arrays[f"{EVENTS}{name}"] for name in COLUMNS}
    record, events = comm.bcast((checkpoint.record, known()) if checkpoint else None)

    def segments():
        folder = checkpoint.path.parent
        results = [folder / record["result"], result.path]
        target = result.path.with_name(f".{result.path.name}.segment-{result.token}-recovered")
        return find_segments(folder, record["segments"], record["rows"], results, digest, target)

    found = comm.bcast(on_root(comm, segments))
    result.log.restore(events)
    result.restore(record, record["rows"], found)


def restore_history(comm: MPI.Comm, history, checkpoint: Checkpoint | None) -> None:
    """The rows of the history so far. Collective."""
    history.restore(
        comm.bcast({name: checkpoint.arrays[name] for name in history.arrays()} if checkpoint else None)
    )


def restore_wind(comm: MPI.Comm, wind, checkpoint: Checkpoint | None) -> None:
    """The wind's samples and, on rank 0, the history that makes the next ones. Collective."""

    def kept():
        named = {name: values for name, values in checkpoint.arrays.items() if name.startswith(PREFIX)}
        arrays = {name.removeprefix(PREFIX): values for name, values in named.items()}
        return checkpoint.record["wind"] | {"arrays": arrays}

    wind.restore(comm.bcast(kept() if checkpoint else None))
