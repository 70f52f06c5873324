"""A digest of the program's own sources, for what is valid only as long as they stay as they are."""

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


# What tells of results, and makes none.
TELLING = ("study/", "measure/", "exchange/", "api/", "checks/", "report/", "plots/", "cli/")


@functools.cache
def program_digest(without: tuple[str, ...] = ()) -> str:
    """Fingerprint of the package's source files, names and contents, but of those whose names begin so."""
    total = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).as_posix().startswith(without):
            continue
        content = path.read_bytes()
        total.update(f"{path.relative_to(PACKAGE)} {len(content)}\n".encode() + content)
    return total.hexdigest()
