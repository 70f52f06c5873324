"""Where a command keeps compiled kernels: in a folder for these very sources and this kind of processor.

numba looks only at the file of the kernel that is called, and would run on with old code after a change in
another one. And its list of what a kernel was compiled for is not safe against processes that write it for
different processors at the same time.
"""

import contextlib
import hashlib
import itertools
import os
import re
import shutil
import time
from pathlib import Path

FOLDER = "NUMBA_CACHE_DIR"  # environment, read by numba when it is imported
KEPT_DAYS = 30.0  # of folders for other sources; a run of theirs may still be going on
PACKAGE = Path(__file__).parents[1]
CONSTANTS = tuple(f"{PACKAGE / name}{os.sep}" for name in ("core", "mechanics", "physics"))  # of kernels
OURS = re.compile("netfall-[0-9a-f]{16}")
OF_PROCESSORS = ("vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features")


def choose_folder() -> None:
    """Set the folder, for this process and those that it starts, before numba is imported."""
    given, home = os.environ.get(FOLDER), os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    parents = [PACKAGE / "__pycache__", Path(home, "netfall")]
    if given:  # by the user, or by the command that started this process
        parents.insert(0, Path(given).parent if OURS.fullmatch(Path(given).name) else Path(given).absolute())
    name = f"netfall-{hashlib.sha256(b''.join([processor(), *sources()])).hexdigest()[:16]}"
    for parent in parents:
        with contextlib.suppress(OSError):  # where nobody may write, for example
            (parent / name).mkdir(parents=True, exist_ok=True)
            os.utime(parent / name)  # used now
            os.environ[FOLDER] = str(parent / name)
            break
    for old in parent.glob("netfall-*"):
        with contextlib.suppress(OSError):  # another process may be removing it
            if OURS.fullmatch(old.name) and time.time() - old.stat().st_mtime > KEPT_DAYS * 86400:
                shutil.rmtree(old, ignore_errors=True)


def sources() -> list[bytes]:
    """The files that say what is compiled: all that have kernels, or constants of theirs."""
    found = []
    for folder, below, names in os.walk(PACKAGE):
        below[:] = [name for name in below if name != "__pycache__"]  # which may hold thousands
        found += [os.path.join(folder, name) for name in names if name.endswith(".py")]
    texts = {path: Path(path).read_bytes() for path in sorted(found)}
    return [text for path, text in texts.items() if b"kernel" in text or path.startswith(CONSTANTS)]


def processor() -> bytes:
    """What tells this kind of processor from others, and for which numba is told to compile."""
    told = [os.uname().machine, *(os.environ.get(f"NUMBA_CPU_{name}", "") for name in ("NAME", "FEATURES"))]
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as file:
        of_first = itertools.takewhile(str.strip, file)  # of the first core
        told += [line for line in of_first if line.split(":")[0].strip() in OF_PROCESSORS]
    return repr(told).encode()
