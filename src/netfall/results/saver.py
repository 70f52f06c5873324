"""Checkpoints of a run. A part that has a state registers how to record and restore it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.physics.state import State
from netfall.results.checkpoint import (
    KEPT,
    LOG,
    RESULT,
    Checkpoint,
    checkpoint_path,
    remove_old_checkpoints,
    write_checkpoint,
)
from netfall.results.segments import find_segments
from netfall.results.writer import Result

Record = tuple[dict[str, Any], dict[str, np.ndarray]]  # values for JSON, on every rank; arrays, on rank 0


class CheckpointWriter:
    """Writes the checkpoints of a run and keeps the last two.

    stage : in which the resumed run was interrupted; None: a new run
    """

    def __init__(
        self,
        comm: MPI.Comm,
        result: Result,
        name: str,
        digest: str,
        stages: tuple[str, ...],
        given: Path | None = None,
        checkpoint: Checkpoint | None = None,
    ):
        """Read the registered names of the checkpoint. Collective.

        name, digest : of the job; stages : names of all, in order
        given : the checkpoint that the run resumes; checkpoint : its contents, on rank 0
        """
        self.comm, self.result, self.name, self.digest, self.stages = comm, result, name, digest, stages
        self.given, self.checkpoint = given, checkpoint
        self.kept: list[Path] = []  # checkpoints of this run that still exist
        self.parts: dict[str, Callable[[], Record]] = {}
        record: dict[str, Any] = checkpoint.record if checkpoint else {"stage": None, "parts": ()}
        self.stage, self._restored = comm.bcast((record["stage"], set(record["parts"])))

    def is_completed(self, stage: str) -> bool:
        """Return whether the resumed run had finished a stage."""
        position = self.stages.index
        return self.stage is not None and position(stage) < position(self.stage)

    def register(
        self,
        name: str,
        record: Callable[[], Record],
        restore: Callable[[Any, Any], None] | None = None,
        everywhere: bool = False,
    ) -> None:
        """Register a state to record in each checkpoint under a name. Restore it if the resumed one has it.

        record() : collective; restore(small, arrays) : collective, arrays on rank 0 alone, None elsewhere,
        unless `everywhere`; None: it is restored otherwise. Collective.
        """
        self.parts[name] = record
        if restore and name in self._restored:
            small, arrays = self._part(name, everywhere)
            restore(small, arrays)

    def register_constant(self, name: str, record: Record) -> None:
        """Register a record that does not change during the run, and that is restored otherwise."""
        self.register(name, lambda: record)

    def register_result(self) -> None:
        """Register the log of fractures and the segments of the result file, and restore them. Collective."""
        result = self.result
        self.register(
            LOG,
            lambda: ({}, result.log.columns()),
            lambda _, events: result.log.restore(events),
            everywhere=True,
        )
        self.register(RESULT, lambda: (result.record(), {}), lambda record, _: self._restore_result(record))

    def _restore_result(self, record: dict[str, Any]) -> None:
        """Restore the result file of an earlier run. Collective."""
        path, token = self.result.path, self.result.token
        rows = self.comm.bcast(self.checkpoint and self.checkpoint.record["rows"])

        def segments() -> list[Path]:
            assert self.checkpoint is not None  # on rank 0
            folder = self.checkpoint.path.parent
            results = [folder / self.checkpoint.record["result"], path]
            target = path.with_name(f".{path.name}.segment-{token}-recovered")
            return find_segments(folder, record["segments"], rows, results, self.digest, target)

        self.result.restore(record, rows, self.comm.bcast(on_root(self.comm, segments)))

    def taken_up(self, name: str) -> Record | None:
        """Return the record of a name in the resumed checkpoint, None without one. Collective.

        Its arrays are on rank 0 alone.
        """
        return self._part(name, False) if name in self._restored else None

    def _part(self, name: str, everywhere: bool) -> Record:
        small: Any = None
        arrays: Any = None
        if self.checkpoint:
            small, arrays = self.checkpoint.part(name)
        return self.comm.bcast(small), self.comm.bcast(arrays) if everywhere else arrays

    def save(self, stage: str, step: int, state: State, extra: dict[str, Record] | None = None) -> Path:
        """Write a checkpoint of a state and of all registered parts, and return its path. Collective.

        extra : records for this checkpoint alone, by name
        """
        rows = self.result.cut()
        path = checkpoint_path(self.result.path, 1 + self.stages.index(stage), step)
        records = {name: record() for name, record in self.parts.items()} | (extra or {})
        record = {"job": self.digest, "name": self.name, "stage": stage, "rows": rows}
        record["result"] = self.result.path.name
        write_checkpoint(self.comm, path, state, self.result, record, records)
        self.kept = [p for p in self.kept if p != path] + [path]
        if self.comm.rank == 0:
            for old in self.kept[:-KEPT]:
                if not (self.given and old.exists() and old.samefile(self.given)):
                    old.unlink(missing_ok=True)
            remove_old_checkpoints(path, self.result.path, self.digest, self.given)
        self.kept = self.kept[-KEPT:]
        return path

    @property
    def last(self) -> Path | None:
        """Return the last good checkpoint, None if there is none."""
        return self.kept[-1] if self.kept else self.given
