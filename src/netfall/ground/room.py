"""Memory: what a rank takes at most, and what this machine has left."""

RANK_BYTES = 250e6  # of Python and of what is compiled, some of it shared by all ranks of a machine
SETUP_BYTES = 900  # per element on rank 0: while the faces of the roof are found
WORKER_BYTES = 2200  # per element, at most: of set-up, state and equilibria


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
