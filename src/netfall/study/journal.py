"""The journal of a study: what has been run so far, in a file that survives a kill at any byte.

A line is a checksum and a record, JSON. A record whose line is not whole was being written when the study was
killed: it is cut off, and its run made again. HDF5 does not survive such a kill; so the study file is written
from the journal, at the end. (An SQLite file that is cut anywhere is lost as a whole, sees no damage within a
record, and opens without locks only if told that there are none.)
"""

import json
import os
import zlib
from pathlib import Path

from netfall.ground.errors import InputError
from netfall.write.locks import writing

SYNC_EVERY = 64  # records after which they are safe from a loss of power as well


def line_of(record: dict) -> bytes:
    """A record as it stands in the file."""
    text = json.dumps(record, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def record_in(line: bytes) -> dict | None:
    """The record in a line, None if the line is not what was written."""
    checksum, _, text = line.rstrip(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return None
    return json.loads(text)


def read_journal(path: Path) -> tuple[list[dict], int]:
    """The records of a journal, and the bytes that they take; an unfinished last one is left out.

    Raises InputError for a file that is damaged elsewhere.
    """
    records, whole = [], 0
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            record = record_in(line)
            if record is None:
                if file.read(1):
                    raise InputError(
                        f"{path}: line {number} is damaged; remove the file to run the study from its start"
                    )
                break
            records.append(record)
            whole += len(line)
    return records, whole


class Journal:
    """Takes records; each is in the hands of the system when `add` returns."""

    def __init__(self, path: Path, header: dict):
        """Go on with a journal, or begin one with this header. Raises OutputError."""
        self.path, self._unsafe = path, 0
        whole = read_journal(path)[1] if path.exists() else 0
        with writing(path):
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
            os.truncate(self._file, whole)
            os.lseek(self._file, 0, os.SEEK_END)
        if not whole:
            self.add(header)

    def add(self, record: dict) -> None:
        """Append a record. Raises OutputError."""
        rest = memoryview(line_of(record))
        with writing(self.path):
            while rest:
                rest = rest[os.write(self._file, rest) :]
            self._unsafe += 1
            if self._unsafe >= SYNC_EVERY:
                self.sync()

    def sync(self) -> None:
        """Make sure that all of it is on the disk."""
        os.fsync(self._file)
        self._unsafe = 0

    def close(self) -> None:
        """The end of writing."""
        os.close(self._file)
