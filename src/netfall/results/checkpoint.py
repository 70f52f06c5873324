"""Checkpoints: the complete state of a run in global numbers, for any number of ranks, sealed with a digest.

A checkpoint is a file NAME.checkpoint-STAGE-STEP.h5 next to the result file NAME.vtkhdf. For a RESULT with
another suffix it is RESULT-checkpoint-STAGE-STEP.h5. STAGE is the number of the stage in the order of
execution, from 1 for form finding and erection, which a resumed run repeats. STEP counts the iterations of
finished equilibria, or the steps of the dynamic stage. A checkpoint does not contain the result. The run
writes the result in segments, closes a segment at each checkpoint, and joins them at its end. A kill at any
moment leaves complete segments and a complete checkpoint that names them.

netfall keeps the last two checkpoints. A run removes its own older ones. A run that resumes a checkpoint next
to its own result file also removes older ones from earlier runs of the same job and result. It keeps the
checkpoint that it resumes, until a later run resumes a newer one.

Each part of a run registers functions that record and restore its state.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np

import netfall
from netfall.core.errors import InputError, other_version_error
from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.fields import FIELDS, Field
from netfall.physics.state import State
from netfall.results import messages
from netfall.results.h5 import SharedFile, find_segments, is_intact
from netfall.results.writer import Result

FORMAT = 18  # version of the layout and the meaning of a checkpoint
LOG, RESULT = "log", "result"  # names of records: the log of fractures, the segments of the result file
KEPT_CHECKPOINTS = 2  # number of checkpoints that a run keeps
NAME = re.compile(r"(.+)checkpoint-\d-\d{12,}\.h5")


def checkpoint_fields(state: State, entity: str) -> list[Field]:
    """Return the fields of a state's particles or elements that a checkpoint contains."""
    return [f for f in FIELDS if f.kept and f.entity == entity and getattr(state, f.name) is not None]


def checkpoint_path(result: Path, stage: int, step: int) -> Path:
    """Return the path of a checkpoint of a run that writes `result`. Sorted names are in order of age.

    No other result of the folder has the same checkpoint names.
    """
    return result.with_name(f"{_prefix(result)}checkpoint-{stage}-{step:012d}.h5")


def _prefix(result: Path) -> str:
    return f"{result.stem}." if result.suffix == ".vtkhdf" else f"{result.name}-"


def find_checkpoints(folder: Path, prefix: str) -> list[Path]:
    """Return the checkpoints in a folder with this prefix of `checkpoint_path`, by age."""
    matches = ((NAME.fullmatch(path.name), path) for path in folder.iterdir())
    return sorted(path for match, path in matches if match and match[1] == prefix)


def remove_old_checkpoints(newest: Path, result: Path, digest: str, given: Path | None) -> None:
    """Remove all but the last two checkpoints of a job and result up to the newest. Rank 0.

    given : the checkpoint that the run resumes, which is kept. Without one, or with one from another folder,
    checkpoints of earlier runs are kept.
    """
    if given is None or given.parent.resolve() != result.parent.resolve():
        return
    neighbours = find_checkpoints(result.parent, _prefix(result))
    if not any(path.samefile(given) for path in neighbours):
        return
    older = [path for path in neighbours if path <= newest and _job_of(path) == digest]
    for path in older[:-KEPT_CHECKPOINTS]:
        if not path.samefile(given):
            path.unlink(missing_ok=True)


def _job_of(path: Path) -> str | None:
    """Return the job digest of a checkpoint, None for another file."""
    try:
        with h5py.File(path, "r") as file:
            return json.loads(file["record"].asstr()[()])["job"]
    except (OSError, KeyError, ValueError):
        return None


def write_checkpoint(
    comm: MPI.Comm,
    path: Path,
    state: State | None,
    result: Result | None,
    record: dict[str, Any],
    parts: dict[str, tuple[Any, ...]],
) -> None:
    """Write the state, if it exists already, and the run's records. Collective.

    result : gives the row numbers, None without a state; record : of the run, small values for JSON
    parts : records by name: small values for JSON, and arrays in global order on rank 0
    """
    file = SharedFile(comm, path)
    try:
        if state is not None and result is not None:
            _write_state(file, state, result)

        def finish(h5: h5py.File) -> None:
            h5.attrs["format"], h5.attrs["netfall"] = FORMAT, netfall.__version__
            full_record = record | {"parts": {name: small for name, (small, _) in parts.items()}}
            h5.create_dataset("record", data=json.dumps(full_record), dtype=h5py.string_dtype())
            for part, (_, arrays) in parts.items():
                for name, values in arrays.items():
                    h5.create_dataset(f"arrays/{part}/{name}", data=values)

        file.close(finish, seal=True)
    except BaseException as error:
        file.discard_after(error)
        raise


def _write_state(file: SharedFile, state: State, result: Result) -> None:
    m = result.distribution.m
    points = result.log.points
    rows = state.owned_rows()
    for field in checkpoint_fields(state, "particle"):
        values = getattr(state, field.name)[rows].reshape(len(rows), int(np.prod(field.tail)))
        block = file.slabs.collect(result.log.row_of(state.gid[rows]), values, points)
        file.put(f"particles/{field.name}", block, points, field.dtype)
    owned = state.owned.astype(bool)
    gid = result.distribution.subdomain.element_gid[owned]
    for field in checkpoint_fields(state, "element"):
        block = file.slabs.collect(gid, getattr(state, field.name)[owned][:, None], m)[:, 0]
        file.put(f"elements/{field.name}", block, m, field.dtype)
    ends = file.slabs.collect(gid, state.gid[state.ends[owned]].reshape(-1, 2), m)
    file.put("elements/ends", ends, m, np.int64)


@final
class Checkpoint:
    """The contents of a checkpoint, on rank 0: `record`, `particles` and `elements` by name, and `part`."""

    def __init__(self, path: Path, job_digest: str):
        """Read a checkpoint. Raises InputError if it is missing, damaged, or of another job.

        The message names the newest complete checkpoint next to it.
        """
        if not path.is_file():
            raise InputError(messages.NO_CHECKPOINT(path=path, newest=_newest_complete(path)))
        if not is_intact(path):
            raise InputError(messages.DAMAGED_CHECKPOINT(path=path, newest=_newest_complete(path)))
        with h5py.File(path, "r") as file:
            if (file.attrs.get("format"), file.attrs.get("netfall")) != (FORMAT, netfall.__version__):
                remedy = "start the run again, or resume it with that version"
                raise other_version_error(path, file.attrs.get("netfall"), remedy)
            self.record = json.loads(file["record"].asstr()[()])
            self.particles, self.elements = _read_group(file, "particles"), _read_group(file, "elements")
            self.arrays = {part: _read_group(file, f"arrays/{part}") for part in file.get("arrays", ())}
        self.path = path
        if self.record["job"] != job_digest:
            raise InputError(messages.OTHER_JOB(path=path, name=self.record["name"]))

    def part(self, name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the record of a name: small values, and arrays."""
        return self.record["parts"][name], self.arrays.get(name, {})


def _read_group(file: h5py.File, group: str) -> dict[str, np.ndarray]:
    return {name: file[f"{group}/{name}"][()] for name in file.get(group, ())}


def _newest_complete(path: Path) -> Path | str:
    """Return the newest other complete checkpoint of the same result in the folder, or "none"."""
    match = NAME.fullmatch(path.name)
    if not match or not path.parent.is_dir():
        return "none"
    others = [p for p in find_checkpoints(path.parent, match[1]) if p != path]
    return next((p for p in reversed(others) if is_intact(p)), "none")


def restore_state(distribution: Distribution, state: State, checkpoint: Checkpoint | None) -> None:
    """Restore the arrays of one rank from a checkpoint that rank 0 has read. Collective.

    A fragment end belongs to the rank that owns its element, as in `fracture.split_particles`.
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


Record = tuple[dict[str, Any], dict[str, np.ndarray]]  # values for JSON, on every rank; arrays, on rank 0


class CheckpointWriter:
    """Writes the checkpoints of a run and keeps the last two; stage : of the resumed one, None: a new run"""

    def __init__(
        self,
        result: Result,
        name: str,
        digest: str,
        stages: tuple[str, ...],
        given: Path | None,
        checkpoint: Checkpoint | None,
    ):
        """Read the registered names of the checkpoint. Collective.

        name, digest : of the job; stages : names of all, in order
        given : the checkpoint that the run resumes; checkpoint : its contents, on rank 0
        """
        self.result, self.name, self.digest, self.stages = result, name, digest, stages
        self.comm, self.given, self.checkpoint = result.comm, given, checkpoint
        self.kept: list[Path] = []  # checkpoints of this run that still exist
        self.parts: dict[str, Callable[[], Record]] = {}
        record: dict[str, Any] = checkpoint.record if checkpoint else {"stage": None, "parts": ()}
        self.stage, self._restored = self.comm.bcast((record["stage"], set(record["parts"])))

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

        record() : collective; restore(small, arrays) : collective, None: the caller restores it. The arrays
        are on rank 0 alone, None elsewhere, unless `everywhere`. Collective.
        """
        self.parts[name] = record
        if restore and (restored := self.resumed_record(name, everywhere)):
            restore(*restored)

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

    def resumed_record(self, name: str, everywhere: bool = False) -> tuple[Any, Any] | None:
        """Return a record of the resumed checkpoint, None without one. Collective.

        everywhere : whether its arrays are on every rank; otherwise they are on rank 0 alone, None elsewhere
        """
        if name not in self._restored:
            return None
        small, arrays = self.checkpoint.part(name) if self.checkpoint else (None, None)
        return self.comm.bcast(small), self.comm.bcast(arrays) if everywhere else arrays

    def save(self, stage: str, step: int, state: State) -> Path:
        """Write a checkpoint of a state and of all registered parts, and return its path. Collective."""
        rows = self.result.cut()
        path = checkpoint_path(self.result.path, 1 + self.stages.index(stage), step)
        records = {name: record() for name, record in self.parts.items()}
        record = {"job": self.digest, "name": self.name, "stage": stage, "rows": rows}
        record["result"] = self.result.path.name
        write_checkpoint(self.comm, path, state, self.result, record, records)
        self.kept = [p for p in self.kept if p != path] + [path]
        if self.comm.rank == 0:
            for old in self.kept[:-KEPT_CHECKPOINTS]:
                if not (self.given and old.exists() and old.samefile(self.given)):
                    old.unlink(missing_ok=True)
            remove_old_checkpoints(path, self.result.path, self.digest, self.given)
        self.kept = self.kept[-KEPT_CHECKPOINTS:]
        return path

    @property
    def last(self) -> Path | None:
        """Return the last good checkpoint, None if there is none."""
        return self.kept[-1] if self.kept else self.given
