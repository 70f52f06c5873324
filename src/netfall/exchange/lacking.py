"""What a net has that a format cannot hold, in words."""

import numpy as np

from netfall.exchange.state import RECORD
from netfall.results.result import Result


def lacking(result: Result, ending: str, held: tuple[str, ...]) -> list[str]:
    """A line that names what of this net a file of this ending does not hold.

    held : what of `of_net` it holds
    """
    words = [word for word, there in of_net(result).items() if there and word not in held]
    return [f"note: a {ending} does not hold this net's {', '.join(words)}; a .csv does"]


def of_net(result: Result) -> dict[str, bool]:
    """What there is in a net, and whether this one has it."""
    f = result.file
    net, ids = f["net"], f["net/element_id"][:]
    known = lambda name: f[f"{RECORD}/{name}"][:]
    pieces = net["cable_names"].asstr()[:].astype(str)[net["cable"][:]]
    part_held = net["fixed"][:].any(1) & ~net["fixed"][:].all(1)
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
        "cables of several elements": len(np.unique(pieces)) < len(np.unique(ids)),
        "strengths": any(name in net for name in ("breaking_load", "yield_force", "fracture_strain")),
        "types": "type" in net,
        "axes of supports": bool(part_held.any()),
        "angles of supports": "angle" in net,
        "springs": "spring" in net,
        "loads of nodes": bool(known("load").any()),
        "masses of nodes": bool(known("mass").any()),
        "roof areas": bool(net["tributary_area"][:].any()),
        "zones": bool((net["zone"][:] >= 0).any()),
        "temperature": "load/temperature" in f,
    }
