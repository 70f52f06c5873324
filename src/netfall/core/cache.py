"""Digest of the sources, and a folder of compiled kernels for each version of the sources and processor.

numba checks only the file of the called kernel. After a change in another file it would run old code. Its
index of compiled signatures is also unsafe if processes write it for different processors at the same time.
"""

import contextlib
import functools
import hashlib
import itertools
import os
import re
import shutil
import time
from pathlib import Path

CACHE_VARIABLE = "NUMBA_CACHE_DIR"  # environment variable that numba reads on import
# age at which folders of other sources are removed; runs may still use younger ones
MAX_CACHE_AGE_DAYS = 30.0
PACKAGE = Path(__file__).parents[1]
CONSTANTS = tuple(f"{PACKAGE / name}{os.sep}" for name in ("core", "physics", "statics"))  # used in kernels
CACHE_FOLDER_NAME = re.compile("netfall-[0-9a-f]{16}")
CPU_IDENTITY_KEYS = ("vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features")


def set_cache_folder() -> None:
    """Set the folder for this process and its children; call it before numba is imported."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    parents = [PACKAGE / "__pycache__", Path(home, "netfall")]
    if given := os.environ.get(CACHE_VARIABLE):  # by the user, or by the command that started this process
        folder = Path(given)
        parents.insert(0, folder.parent if CACHE_FOLDER_NAME.fullmatch(folder.name) else folder.absolute())
    name = f"netfall-{hashlib.sha256(b''.join([processor(), *sources()])).hexdigest()[:16]}"
    for parent in parents:
        with contextlib.suppress(OSError):  # for example a read-only folder
            (parent / name).mkdir(parents=True, exist_ok=True)
            os.utime(parent / name)  # mark as used
            os.environ[CACHE_VARIABLE] = str(parent / name)
            break
    for old in parent.glob("netfall-*"):
        with contextlib.suppress(OSError):  # another process may be removing it
            if (
                CACHE_FOLDER_NAME.fullmatch(old.name)
                and time.time() - old.stat().st_mtime > MAX_CACHE_AGE_DAYS * 86400
            ):
                shutil.rmtree(old, ignore_errors=True)


def sources() -> list[bytes]:
    """Return the contents of all files that define kernels, or constants used in them."""
    paths = []
    for folder, below, names in os.walk(PACKAGE):
        below[:] = [name for name in below if name != "__pycache__"]  # it may hold thousands of files
        paths += [os.path.join(folder, name) for name in names if name.endswith(".py")]
    texts = {path: Path(path).read_bytes() for path in sorted(paths)}
    return [text for path, text in texts.items() if b"kernel" in text or path.startswith(CONSTANTS)]


def processor() -> bytes:
    """Return an identifier of this processor type and of the target for which numba compiles."""
    identity = [
        os.uname().machine,
        *(os.environ.get(f"NUMBA_CPU_{name}", "") for name in ("NAME", "FEATURES")),
    ]
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as file:
        first_core = itertools.takewhile(str.strip, file)
        identity += [line for line in first_core if line.split(":")[0].strip() in CPU_IDENTITY_KEYS]
    return repr(identity).encode()


# Parts of the package that only present results.
PRESENTATION_PACKAGES = ("api/", "cli/", "docs/", "exchange/", "post/", "study/")


@functools.cache
def program_digest() -> str:
    """Return a fingerprint of names and contents of the source files that compute results."""
    total = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).as_posix().startswith(PRESENTATION_PACKAGES):
            continue
        content = path.read_bytes()
        total.update(f"{path.relative_to(PACKAGE)} {len(content)}\n".encode() + content)
    return total.hexdigest()
