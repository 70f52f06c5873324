"""Memory: what a rank takes at most, what it keeps, and what this machine has left."""

import contextlib
import ctypes
import gc
from functools import cache

RANK_BYTES = 250e6  # of Python and of what is compiled, some of it shared by all ranks of a machine
SETUP_BYTES = 900  # per element on rank 0: while the faces of the roof are found
WORKER_BYTES = 2200  # per element, at most: of set-up, state and equilibria
KEPT_BYTES = 1 << 30  # of freed memory, at most
OF_ARRAYS, OF_THE_REST = -3, -1  # glibc's M_MMAP_THRESHOLD, M_TRIM_THRESHOLD


def keep_freed() -> None:
    """Let a rank keep the memory that arrays leave, for those that follow: with glibc.

    By itself it hands that back at once. The levels of an equilibrium are filled anew for each correction,
    and a page that is touched for the first time costs more than the arithmetic on it.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        for kind in (OF_ARRAYS, OF_THE_REST):
            ctypes.CDLL(None).mallopt(kind, KEPT_BYTES)


@cache
def keep_program() -> None:
    """Have searches for garbage leave out what is there by now, which is the program: once for a process.

    They went through it again and again, a fifth of the time of the stadium's collapse.
    """
    gc.freeze()


def memory_left() -> float | None:
    """Bytes that this machine has for new processes; None: it does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            lines = dict(line.split(":", 1) for line in file)
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return None


def memory_line(workers: int, ranks: int, elements: int) -> str:
    """What workers of a net take on this machine, and how many there may be where that is too much."""
    each = ranks * RANK_BYTES + WORKER_BYTES * elements
    left = memory_left()
    words = f"memory: at most {workers * each / 1e9:.2g} GB for {workers} worker{'s' * (workers > 1)}"
    if left is None:
        return words
    words += f", {left / 1e9:.3g} GB are free"
    most = max(1, int(left // each))
    enough = f": note: that is enough for {most}; expected --workers {most}"
    return words + enough * (most < workers)
