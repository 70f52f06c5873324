"""Contents of a result file for other programs: netfall info --json."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.core.text import json_text
from netfall.results import file, states


def print_info_json(path: Path, say: Callable[[str], None]) -> None:
    """Print the summary of a result file as JSON, in SI units. Raises InputError for a wrong file."""
    with file.open_checked(path) as f:
        say(json_text(info_of_result(f)))


def info_of_result(f: h5py.File) -> dict[str, Any]:
    """Return the summary of a result file: run, net, form, equilibria, dynamics, fractures, messages."""
    provenance = f["provenance"].attrs
    info: dict[str, Any] = {
        "file": Path(f.filename).name,
        "title": file.result_title(f),
        "netfall": provenance["netfall"],
        "exit_state": provenance["exit_state"],
        "ranks": provenance["ranks"],
        "overrides": file.provenance_text(f, "overrides").splitlines(),
        "particles": len(f["net/particles"]),
        "elements": len(f["net/elements"]),
        "roof_area": f["net/tributary_area"][:].sum(),
        "warnings": file.warnings_of_run(f),
        "notes": file.notes_of_run(f),
        "equilibria": {path: equilibrium_summary(f, path) for path in states.equilibrium_groups(f)},
        "seconds": {name: np.max(value) for name, value in f["provenance/timings"].attrs.items()},
    }
    if "form_finding" in f:
        g = f["form_finding"]
        info["form_finding"] = {
            "iterations": g["iterations"][()],
            "residual": g["residual"][()],
            "equilibrium": not states.no_equilibrium(g),
            **_range(g["tension"][:]),
        }
    if "history" in f:
        h, events = f["history"], f["events"]
        at_end = {name: h[name][-1] for name in h if h[name].ndim == 1 and len(h[name])}
        errors = {f"{name}_max": np.abs(h[name][:]).max() for name in h if name.endswith("_error")}
        steps = {"steps": provenance["steps"], "time_step": provenance["time_step"]}
        columns = {name: events[name][:] for name in ("time", "step", "strain", "node_id")}
        columns["element"] = f["net/element_id"][:][events["element"][:]]
        info["dynamics"] = steps | {"at_end": at_end} | errors
        info["fractures"] = [dict(zip(columns, row)) for row in zip(*columns.values())]
    return info


def equilibrium_summary(f: h5py.File, path: str) -> dict[str, Any]:
    """Return the last equilibrium of a group."""
    x = states.form_position(f) if path.startswith("stages/") else states.start_position(f)
    g, last = f[path], list(states.group_equilibria(f, path))[-1]
    displacement = lengths(last.position() - x)
    return {
        "title": states.group_title(f, path),
        "state": g.attrs["state"],
        "load_factor": g.attrs["load_factor"],
        "reason": g.attrs["reason"],
        "elements": g.attrs["elements"],
        "displacement_max": displacement.max(),
        "displacement_max_node": f["net/node_id"][displacement.argmax()],
        "slack": np.ravel(g["slack"][()])[-1],
        "stable": np.all(g["stable"][()]),
        **_range(last.tension()[~states.absent(f, path)]),
    }


def _range(tension: np.ndarray) -> dict[str, float]:
    """Return the smallest and the largest tension [N]."""
    return {"tension_min": tension.min(), "tension_max": tension.max()}
