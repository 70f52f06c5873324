"""Digest of the program's own sources, for data that is valid only while they do not change."""

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


# Parts of the package that present results and do not compute them.
PRESENTATION_PACKAGES = ("study/", "measure/", "exchange/", "api/", "checks/", "report/", "plots/", "cli/")


@functools.cache
def program_digest(without: tuple[str, ...] = ()) -> str:
    """Return a fingerprint of names and contents of the source files, except prefixes `without`."""
    total = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).as_posix().startswith(without):
            continue
        content = path.read_bytes()
        total.update(f"{path.relative_to(PACKAGE)} {len(content)}\n".encode() + content)
    return total.hexdigest()
