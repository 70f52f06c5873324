"""Paths of the files of a study."""

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError
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
        """The folder of kept result files."""
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


class Watch:
    """Digest of files; `check` detects changes."""

    def __init__(self, files: list[Path]):
        """Compute the digest. Raises InputError for a file that cannot be read."""
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
