"""Restart of a run on any number of ranks: its state, its log of fractures, its result file."""

from pathlib import Path
from typing import Any

import numpy as np

from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.state import State
from netfall.results.checkpoint import Checkpoint, checkpoint_fields
from netfall.results.saver import CheckpointWriter
from netfall.results.segments import find_segments
from netfall.results.writer import Result

LOG, RESULT = "log", "result"  # names of records in checkpoints


def restore_state(distribution: Distribution, state: State, checkpoint: Checkpoint | None) -> None:
    """Restore the arrays of one rank from a checkpoint that rank 0 has read. Collective.

    A fragment end goes to the rank that keeps its element, as in `fracture.split_particles`.
    """
    comm, n = distribution.comm, distribution.n
    particles = checkpoint_fields(state, "particle")
    split = comm.bcast({f.name: checkpoint.particles[f.name][n:] for f in particles} if checkpoint else None)
    fragments = checkpoint.part(LOG)[1]["new_particle"] if checkpoint else None
    gid = comm.bcast(None if fragments is None else np.sort(fragments[fragments >= 0]))
    for field in particles:
        rows = distribution.particles(checkpoint.particles[field.name][:n] if checkpoint else None)
        getattr(state, field.name)[: state.n_local] = rows.reshape(len(rows), *field.tail)
    for field in checkpoint_fields(state, "element"):
        rows = distribution.elements(checkpoint.elements[field.name] if checkpoint else None)
        getattr(state, field.name)[:] = rows
    if not state.features.fragments:
        state.EA[state.broken != 0] = 0.0
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


def register_result(comm: MPI.Comm, result: Result, saver: CheckpointWriter) -> None:
    """Register the log of fractures and the segments of the result file, and restore them. Collective."""

    def restore_log(_: dict[str, Any], events: dict[str, np.ndarray]) -> None:
        result.log.restore(events)

    def restore_result(record: dict[str, Any], _: object) -> None:
        _restore(comm, result, saver, record)

    saver.register(LOG, lambda: ({}, result.log.columns()), restore_log, everywhere=True)
    saver.register(RESULT, lambda: (result.record(), {}), restore_result)


def _restore(comm: MPI.Comm, result: Result, saver: CheckpointWriter, record: dict[str, Any]) -> None:
    checkpoint = saver.checkpoint
    rows = comm.bcast(checkpoint and checkpoint.record["rows"])

    def segments() -> list[Path]:
        assert checkpoint is not None  # on rank 0
        folder = checkpoint.path.parent
        results = [folder / checkpoint.record["result"], result.path]
        target = result.path.with_name(f".{result.path.name}.segment-{result.token}-recovered")
        return find_segments(folder, record["segments"], rows, results, saver.digest, target)

    result.restore(record, rows, comm.bcast(on_root(comm, segments)))
