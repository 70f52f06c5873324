"""A digest of the program's own sources, for what is valid only as long as they stay as they are."""

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parent


@functools.cache
def program_digest() -> str:
    """Fingerprint of the package's source files, names and contents."""
    total = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        content = path.read_bytes()
        total.update(f"{path.relative_to(PACKAGE)} {len(content)}\n".encode() + content)
    return total.hexdigest()
