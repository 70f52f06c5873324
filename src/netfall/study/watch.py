"""The files that the runs of a study read, watched while they run."""

import hashlib
from pathlib import Path

from netfall.errors import InputError


class Watch:
    """Fingerprint of files; `check` sees whether they are still what they were."""

    def __init__(self, files: list[Path]):
        """Raises InputError for a file that cannot be read."""
        self.files = files
        self.stamps, self.digest = self._stamps(), self._digest()

    def check(self) -> None:
        """Raises InputError if a file has changed."""
        stamps = self._stamps()
        if stamps != self.stamps:
            if self._digest() != self.digest:
                changed = [str(f) for f, a, b in zip(self.files, stamps, self.stamps) if a != b]
                raise InputError(
                    f"{', '.join(changed)}: changed while the study ran; put the old text back and give the "
                    "same command to go on, or move the journal away to begin anew"
                )
            self.stamps = stamps

    def _stamps(self) -> list[tuple | None]:
        found = [path.stat() if path.exists() else None for path in self.files]
        return [there and (there.st_mtime_ns, there.st_size, there.st_ino) for there in found]

    def _digest(self) -> str:
        total = hashlib.sha256()
        for path in self.files:
            try:
                content = path.read_bytes()
            except OSError as error:
                raise InputError(f"{path}: {error.strerror or error}") from None
            total.update(f"{path.name} {len(content)}\n".encode() + content)
        return total.hexdigest()
