"""Saving a run and taking it up again, on any number of ranks."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from mpi4py import MPI

from netfall.job.read import Job
from netfall.mechanics.state import State
from netfall.output.checkpoint import KEPT, Checkpoint, checkpoint_path, kept_fields, write_checkpoint
from netfall.output.result import Result, find_segments
from netfall.parallel.distribute import Distribution
from netfall.parallel.root import on_root
from netfall.solve.form_finding import Form

PREFIX = "wind_"  # of the wind's arrays in a checkpoint


class Saver:
    """Writes the checkpoints of a run and keeps the last two."""

    def __init__(self, comm: MPI.Comm, job: Job, roof, statics, kept: list[Path]):
        self.comm, self.job, self.roof, self.statics, self.kept = comm, job, roof, statics, kept

    def __call__(self, simulation) -> Path:
        """Write a checkpoint of the simulation at its present step; its path. Collective."""
        result: Result = simulation.result
        rows = result.cut()
        path = checkpoint_path(result.path, simulation.n)
        record, arrays = result.record()
        record |= {"job": self.roof.digest, "name": self.job.title or self.job.name, "result": result.path.name, "rows": rows,
                   "simulation": simulation.record(), "residual": self.roof.residual, "statics": asdict(self.statics) if self.statics else None}
        if self.roof.form:
            record["form"] = {"iterations": self.roof.form.iterations, "residual": self.roof.form.residual, "reference": self.roof.form.reference}
        if simulation.wind:
            wind = simulation.wind.record()
            record["wind"] = {"k": wind["k"], "step": wind["history"].get("step")}
            arrays |= {f"{PREFIX}time": wind["time"], f"{PREFIX}gust": wind["gust"], f"{PREFIX}past": wind["history"].get("past", np.zeros(0))}
        if self.roof.whole:
            arrays |= {"x": self.roof.whole.x, "N": self.roof.whole.N}
        write_checkpoint(self.comm, path, simulation.state, result, record, arrays)
        self.kept = [p for p in self.kept if p != path] + [path]
        while len(self.kept) > KEPT:
            old = self.kept.pop(0)
            if self.comm.rank == 0:
                old.unlink(missing_ok=True)
        return path


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
        getattr(state, field.name)[:] = distribution.elements(checkpoint.elements[field.name] if checkpoint else None)
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
    """The result file's parts so far, and what was kept of it in memory. Collective."""
    record, arrays = comm.bcast((checkpoint.record, {k: v for k, v in checkpoint.arrays.items() if k.startswith(("events_", "history", "probes"))})
                                if checkpoint else None)

    def segments():
        folder = checkpoint.path.parent
        results = [folder / record["result"], result.path]
        target = result.path.with_name(f".{result.path.name}.segment-{result.token}-recovered")
        return find_segments(folder, record["segments"], record["rows"], results, digest, target)

    found = comm.bcast(on_root(comm, segments))
    result.restore(record, arrays, record["rows"], found)


def restore_wind(comm: MPI.Comm, wind, state: State, checkpoint: Checkpoint | None) -> None:
    """The wind's samples and, on rank 0, the recursion that makes the next ones. Collective."""
    record = comm.bcast({"k": checkpoint.record["wind"]["k"], "time": checkpoint.arrays[f"{PREFIX}time"], "gust": checkpoint.arrays[f"{PREFIX}gust"]}
                        if checkpoint else None)
    record["history"] = {"past": checkpoint.arrays[f"{PREFIX}past"], "step": checkpoint.record["wind"]["step"]} if checkpoint else {}
    wind.restore(state, record)
