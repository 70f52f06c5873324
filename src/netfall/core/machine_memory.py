"""Memory: upper bounds for ranks and workers, and the free memory of this machine."""

RANK_BYTES = 250e6  # of Python and compiled code; the ranks of a machine share part of it
SETUP_BYTES = 900  # per element on rank 0, while the faces of the roof are computed
WORKER_BYTES = 2200  # per element, at most, for set-up, state and equilibria


def memory_left() -> float | None:
    """Return the memory [bytes] available to new processes; None if unknown."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            lines = dict(line.split(":", 1) for line in file)
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return None


def memory_message(workers: int, ranks: int, elements: int) -> str:
    """Describe the memory use of workers on this machine, and the possible number if there are too many."""
    worker_bytes = ranks * RANK_BYTES + WORKER_BYTES * elements
    available = memory_left()
    text = f"memory: at most {workers * worker_bytes / 1e9:.2g} GB for {workers} worker{'s' * (workers > 1)}"
    if available is None:
        return text
    text += f", {available / 1e9:.3g} GB are free"
    max_workers = max(1, int(available // worker_bytes))
    enough = f": note: that is enough for {max_workers}; expected --workers {max_workers}"
    return text + enough * (max_workers < workers)
