"""Journal of a study: the finished runs, in a file that survives a kill at any byte.

A line is a checksum and a record, JSON. An incomplete line was being written when the study was killed: it is
cut off, and its run is repeated. An HDF5 file does not survive such a kill, so the study file is written from
the journal at the end. (An SQLite file that is cut anywhere is lost as a whole, does not detect damage within
a record, and needs an option to open without locks.)
"""

import json
import os
import zlib
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError
from netfall.results.locks import writing
from netfall.study import messages

SYNC_EVERY = 64  # records between two flushes to the disk, which protect against a loss of power


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
    """Return the records of a journal, and the bytes that they take, without an incomplete last line.

    Raises InputError for a file that is damaged elsewhere.
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
