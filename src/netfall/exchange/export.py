"""Command `netfall export`: a result in the format that the ending of the file names."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

from netfall.core.errors import InputError
from netfall.exchange import messages
from netfall.exchange.formats import endings
from netfall.exchange.state import MARK, NET_RECORD, export_state
from netfall.results.file import missing_dataset_errors
from netfall.results.reader import Result


def export(
    source: Path,
    target: Path,
    say: Callable[[str], None],
    time: float | None = None,
    case: str | None = None,
    unit: str = "m",
) -> None:
    """Write a result to a file, in the format of its ending.

    time : [s], inf: the last snapshot; case : case or combination; without either it is the form
    unit : unit of the coordinates of a drawing

    Raises InputError for an unknown ending, an unknown time or case, and a file that is not a result.
    """
    ending = target.suffix.lower() or ".csv"
    if ending not in endings():
        raise InputError(messages.UNKNOWN_ENDING(target=target, endings=", ".join(endings())))
    form = import_module(f"netfall.exchange.formats{ending}")
    if not target.parent.is_dir():
        raise InputError(messages.NO_FOLDER(target=target, folder=target.parent))
    if target.is_dir() != form.FOLDER and target.exists():
        kind = "a folder" if target.is_dir() else "a file"
        raise InputError(messages.OUTPUT_KIND(target=target, kind=kind))
    if target.is_file() and MARK.encode() not in target.read_bytes():
        raise InputError(messages.FOREIGN_FILE(target=target))
    if form.STATIC_ONLY and time is not None:
        raise InputError(messages.TIME_OF_EQUILIBRIUM(ending=ending))
    if time is not None and case is not None:
        raise InputError(messages.TIME_AND_CASE())
    if unit != "m" and not form.UNITS:
        raise InputError(messages.METRES_ONLY(unit=unit, ending=ending))
    with Result(source) as result, missing_dataset_errors(source):
        state = export_state(result, time, case)
        lines = form.write(result, state, target, unit) + state.warnings
        if form.CONTENTS is not None:
            contents = [
                word for word, has in net_contents(result).items() if has and word not in form.CONTENTS
            ]
            lines.append(messages.CONTENTS_LEFT_OUT(ending=ending, contents=", ".join(contents)))
    for line in lines:
        say(line)


def net_contents(result: Result) -> dict[str, bool]:
    """List the possible contents of a net, and whether this net has them."""
    f = result.file
    net, ids = f["net"], f["net/element_id"][:]
    cables = net["cable_names"].asstr()[:].astype(str)[net["cable"][:]]
    partly_held = net["fixed"][:].any(1) & ~net["fixed"][:].all(1)
    return {
        "ids": True,
        "groups": len(net["group_names"]) > 1,
        "tensions": True,
        "unstressed lengths": True,
        "stiffness": True,
        "mass per length": True,
        "bars": bool(net["bar"][:].any()),
        "bending": "bending" in net,
        "bars that buckle": "buckling" in net,
        "cables that slip": "slide" in f,
        "cables of several elements": len(np.unique(cables)) < len(np.unique(ids)),
        "strengths": any(name in net for name in ("breaking_load", "yield_force", "fracture_strain")),
        "types": "type" in net,
        "axes of supports": bool(partly_held.any()),
        "angles of supports": "angle" in net,
        "springs": "spring" in net,
        "loads of nodes": bool(f[f"{NET_RECORD}/load"][:].any()),
        "masses of nodes": bool(f[f"{NET_RECORD}/mass"][:].any()),
        "roof areas": bool(net["tributary_area"][:].any()),
        "zones": bool((net["zone"][:] >= 0).any()),
        "temperature": "load/temperature" in f,
    }
