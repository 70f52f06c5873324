"""Paths of the files of a study, and its journal: the finished runs.

The journal survives a kill at any byte.

A line is a checksum and a record in JSON. If a study is killed while it writes a line, the incomplete line is
removed and its run repeated. An HDF5 file does not survive such a kill, so the study file is written from the
journal at the end. (A truncated SQLite file is lost as a whole. SQLite does not detect damage within a
record, and needs an option to open without locks.)
"""

import hashlib
import json
import os
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError
from netfall.results.locks import writing
from netfall.study import messages

SUFFIX, JOURNAL = ".study.h5", ".study.journal"


@dataclass(frozen=True)
class Place:
    """Paths of a study, or of a shard of it; stem : the common part of the file names."""

    folder: Path
    stem: str
    part: str = ""

    @property
    def result(self) -> Path:
        """The study file."""
        return self.folder / f"{self.stem}{self.part}{SUFFIX}"

    @property
    def journal(self) -> Path:
        """The journal of finished runs."""
        return self.folder / f"{self.stem}{self.part}{JOURNAL}"

    @property
    def samples(self) -> Path:
        """The folder of result files that the study keeps."""
        return self.folder / f"{self.stem}.samples"

    def parts(self) -> list["Place"]:
        """Return the shards of the study that have files, complete or not."""
        part = re.compile(rf"{re.escape(self.stem)}(\.\d+-of-\d+)({re.escape(SUFFIX)}|{re.escape(JOURNAL)})")
        names = map(part.fullmatch, os.listdir(self.folder))
        return [Place(self.folder, self.stem, part) for part in sorted({name[1] for name in names if name})]


def study_files(path: Path, output: Path | None, shard: tuple[int, int] | None) -> Place:
    """Return the paths of the results of a study file."""
    output = output or Path(f"{path.stem}{SUFFIX}")
    stem = output.name.removesuffix(".h5").removesuffix(".study")
    return Place(output.parent, stem, f".{shard[0]}-of-{shard[1]}" if shard else "")


class InputFiles:
    """The files that a study reads, with a digest; `check` detects changes."""

    def __init__(self, files: list[Path]):
        """Compute the digest. Raises InputError if a file cannot be read."""
        self.files = files
        self.stamps, self.digest = self._stamps(), self._digest()

    def check(self) -> None:
        """Check that no file has changed. Raises InputError."""
        stamps = self._stamps()
        if stamps != self.stamps:
            if self._digest() != self.digest:
                changed = [str(f) for f, a, b in zip(self.files, stamps, self.stamps) if a != b]
                raise InputError(messages.CHANGED_WHILE_RUNNING(files=", ".join(changed)))
            self.stamps = stamps

    def _stamps(self) -> list[tuple[Any, ...] | None]:
        stats = [path.stat() if path.exists() else None for path in self.files]
        return [stat and (stat.st_mtime_ns, stat.st_size, stat.st_ino) for stat in stats]

    def _digest(self) -> str:
        total = hashlib.sha256()
        for path in self.files:
            try:
                content = path.read_bytes()
            except OSError as error:
                raise InputError(messages.UNREADABLE(path=path, reason=error.strerror or error)) from None
            total.update(f"{path.name} {len(content)}\n".encode() + content)
        return total.hexdigest()


SYNC_EVERY = 64  # number of records between two flushes to the disk, which protect against a loss of power


def encode_record(record: dict[str, Any]) -> bytes:
    """Return the line of the file for a record."""
    text = json.dumps(record, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def decode_record(line: bytes) -> dict[str, Any] | None:
    """Return the record in a line, None if the line is damaged."""
    checksum, _, text = line.rstrip(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return None
    record: dict[str, Any] = json.loads(text)
    return record


def read_journal(path: Path) -> tuple[list[dict[str, Any]], int]:
    """Return the records of a journal and their size in bytes, without an incomplete last line.

    Raises InputError if the file is damaged in another place.
    """
    records, whole = [], 0
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            record = decode_record(line)
            if record is None:
                if file.read(1):
                    raise InputError(messages.DAMAGED_JOURNAL(path=path, number=number))
                break
            records.append(record)
            whole += len(line)
    return records, whole


class Journal:
    """Appends records to a file. A record survives a kill of the process once `add` returns."""

    def __init__(self, path: Path, header: dict[str, Any]):
        """Continue a journal, or start one with this header. Raises OutputError."""
        self.path, self._unsafe = path, 0
        valid_bytes = read_journal(path)[1] if path.exists() else 0
        with writing(path):
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
            os.truncate(self._file, valid_bytes)
            os.lseek(self._file, 0, os.SEEK_END)
        if not valid_bytes:
            self.add(header)

    def add(self, record: dict[str, Any]) -> None:
        """Append a record. Raises OutputError."""
        unwritten = memoryview(encode_record(record))
        with writing(self.path):
            while unwritten:
                unwritten = unwritten[os.write(self._file, unwritten) :]
            self._unsafe += 1
            if self._unsafe >= SYNC_EVERY:
                self.sync()

    def sync(self) -> None:
        """Flush all records to the disk."""
        os.fsync(self._file)
        self._unsafe = 0

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)
