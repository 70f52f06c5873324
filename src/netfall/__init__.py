"""netfall: form finding, load analysis and collapse of cable roofs by the finite particle
method, on MPI ranks.

`run` runs a job, `open` reads a result file, `Net` makes a net from arrays. The other packages are internal;
the page development/architecture describes them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from netfall.core.errors import DivergedError, InputError, Interrupted, OutputError

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

    from netfall.api.net import Net
    from netfall.results.reader import Result

__version__ = "0.6.0.dev0"
__all__ = ["DivergedError", "InputError", "Interrupted", "Net", "OutputError", "Result", "open", "run"]


def open(path: "str | Path") -> "Result":
    """Open a result file as a `Result`: result.history["kinetic_energy"], result.tension(element=17), ...

    All values are in SI units: m, s, N, J, kg. A printed table shows the unit of each column.
    Raises InputError if the file is not a result of netfall.
    """
    result: Result = import_module("netfall.results.reader").Result(path)
    return result


def run(
    job: "str | Path | dict[str, Any]",
    overrides: "dict[str, Any] | None" = None,
    ranks: int | None = None,
    output: "str | Path | None" = None,
    quiet: bool = True,
) -> "Result":
    """Run a job and return its `Result`.

    job : path of a job file; or a dict with its sections, {"net": {...}, "cable": {"modulus": 1.6e11, ...}}.
        In a dict, "net" may be a `Net` or contain its arrays: {"nodes": (n, 3) [m], "elements": (m, 2) by
        ids, "fixed": (n,), "groups": (m,)}. Paths in a dict and its overrides are relative to the working
        directory.
    overrides : values by key, {"wind.speed": 36.0} [m/s], as in --set of the command, but in SI units
    ranks : MPI ranks to start for the run. None: one
    output : path of the result file; None: a temporary one, which is removed with the result
    quiet : False: print the output of the command; True: only its warnings, as Python warnings

    The run computes in a separate process and leaves this one unchanged.
    KeyboardInterrupt stops the run. If `output` is given, the run leaves a checkpoint, from which `netfall
    run --restart` continues.

    Raises InputError if the job is wrong (one line per error), DivergedError if it has no solution,
    OutputError if the result cannot be written, Interrupted if a signal stops the run.
    """
    result: Result = import_module("netfall.api.run").run(job, overrides, ranks, output, quiet)
    return result


def __getattr__(name: str) -> "Any":
    """Import Net and Result at their first use, since they load numpy and h5py."""
    if name in ("Net", "Result"):
        return getattr(import_module("netfall.api.net" if name == "Net" else "netfall.results.reader"), name)
    raise AttributeError(f"module 'netfall' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names of the interface, also those not imported yet."""
    return [*__all__, "__version__"]
