"""Compile flags of all kernels, in one place.

No fast-math: sums keep their order, so that the bits do not depend on the number of ranks. numpy's error model:
a division by zero gives inf and not an exception (and does not stop vectorisation).
"""

import contextlib
import hashlib
import shutil
import time
from pathlib import Path

import llvmlite.binding
import numba
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions

KEPT_DAYS = 30  # of compiled code that these sources did not make; a run of theirs may still be going on
PACKAGE = Path(__file__).parents[1]


def _choose_cache() -> str:
    """Folder of the compiled code of these very sources; that of versions that nobody runs any more is removed.

    numba looks only at the file of the function that is called, and would run on with an old law after a change in another file.
    """
    total = hashlib.sha256(
        b"".join(path.read_bytes() for path in sorted([*PACKAGE.glob("*.py"), *PACKAGE.glob("*/*.py")]))
    )
    parent = Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__")
    folder = parent / f"netfall-{total.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # installed where nobody may write
        parent = Path.home() / ".cache" / "netfall"
        folder = parent / folder.name
    for old in parent.glob("netfall-*"):
        with contextlib.suppress(OSError):  # another rank may be removing it
            if old != folder and time.time() - old.stat().st_mtime > KEPT_DAYS * 86400:
                shutil.rmtree(old, ignore_errors=True)
    return str(folder)


numba.config.CACHE_DIR = _choose_cache()
FLAGS = {"cache": True, "error_model": "numpy", "fastmath": False}

# Hardware gathers are a trap on processors whose microcode was mended against leaks through them: four times slower
# there than plain loads into the lanes of a vector, which are as fast elsewhere or nearly so. And where there are registers
# of 512 bits, the step is a third faster with them, also on processors for which the compiler prefers halves.
numba.config.CPU_FEATURES = (
    numba.config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
) + ",+prefer-no-gather,-prefer-256-bit"

# The compiler vectorises a loop that reads x of neighbours and writes v only if it knows that the two are different
# arrays. numba has the flag (its own parallel loops use it) but gives it no name in the decorator: this does.
CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

allocating_kernel = numba.njit(**FLAGS)
# What makes no arrays needs no count of their owners, which would take a microsecond of every step.
kernel = numba.njit(**FLAGS, _nrt=False)
part_of_kernel = numba.njit(
    **FLAGS, _nrt=False, forceinline=True
)  # a call within a loop would keep it from being vectorised
vector_kernel = numba.njit(**FLAGS, _nrt=False, noalias=True)  # no two array arguments may overlap


@kernel
def _nothing():
    return 0


def wake() -> None:
    """Pay for the first call of compiled code, some 0.3 s, at a time when there is nothing else to do."""
    _nothing()
