"""Segments: consecutive parts of a result file between checkpoints. They are joined at the end of the run."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.results import messages
from netfall.results.h5 import SPARE_BYTES, finish_file
from netfall.results.locks import reserved_h5, size_of, writing

COPY_BYTES = 1 << 26  # buffer while segments are joined


def append_rows(source: h5py.File, target: h5py.File, limit: dict[str, int] | None = None) -> None:
    """Append the rows of every dataset of one file to the other's.

    limit : number of rows per dataset; datasets without an entry are left out
    """

    def copy(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if not isinstance(item, h5py.Dataset) or (limit is not None and name not in limit):
            return
        rows = item.shape[0] if limit is None else limit[name]
        if name not in target:
            layout = {"maxshape": (None, *item.shape[1:]), "chunks": item.chunks, "dtype": item.dtype}
            target.create_dataset(name, (0, *item.shape[1:]), **layout)
        target_rows, first = target[name], target[name].shape[0]
        target_rows.resize(first + rows, axis=0)
        row_bytes = item.dtype.itemsize * int(np.prod(item.shape[1:], dtype=np.int64))
        slab = max(1, COPY_BYTES // max(1, row_bytes))
        for begin in range(0, rows, slab):
            end = min(begin + slab, rows)
            target_rows[first + begin : first + end] = item[begin:end]

    source.visititems(copy)


def join_segments(
    segments: list[Path],
    temporary: Path,
    path: Path,
    finish: Callable[..., Any],
    conclude: Callable[..., Any],
) -> None:
    """Write the result file from its segments and the small datasets, then remove the segments. Rank 0.

    finish, conclude : as of `SharedFile.close`
    """
    with writing(path):
        size = sum(segment.stat().st_size for segment in segments) + size_of(finish) + SPARE_BYTES
        with reserved_h5(temporary, size) as file:
            for segment in segments:
                with h5py.File(segment, "r") as part:
                    append_rows(part, file)
            finish(file)
            conclude(file)
        finish_file(temporary, path)
    pattern = _temporary_file_pattern(path)  # matches files of this run and of earlier runs that were killed
    for old in [each for each in path.parent.iterdir() if pattern.fullmatch(each.name)]:
        old.unlink(missing_ok=True)


def _temporary_file_pattern(path: Path) -> re.Pattern[str]:
    """Return a pattern for temporary files of a result.

    These are segments, unfinished files, and the lock files that Open MPI leaves next to them.
    """
    name, stem = re.escape(path.name), re.escape(path.stem)
    segment = rf"\.{name}\.segment-[0-9a-f]{{8}}-(\d{{6,}}|recovered)"
    checkpoint = rf"({stem}\.|{name}-)checkpoint-\d-\d{{12,}}\.h5"
    return re.compile(rf"{segment}|\.({name}|{segment}|{checkpoint})\.part(-\d+-\d+\.lock)?")


def find_segments(
    folder: Path, names: list[str], rows: dict[str, int], results: list[Path], digest: str, target: Path
) -> list[Path]:
    """Return the segments of an interrupted run. If it finished, make one from its result file. Rank 0.

    results : possible paths of that file; target : name of the new segment
    Raises InputError if there is neither.
    """
    segments = [folder / name for name in names]
    if all(segment.exists() for segment in segments):
        return segments
    for result in results:
        try:
            with h5py.File(result, "r") as file:
                if file["provenance"].attrs["job_digest"] == digest:
                    with reserved_h5(target, result.stat().st_size + SPARE_BYTES) as part:
                        append_rows(file, part, rows)
                    return [target]
        except (OSError, KeyError):
            continue
    missing = next(segment for segment in segments if not segment.exists())
    raise InputError(messages.MISSING_SEGMENT(segment=missing, result=results[0]))
