"""Section [net] of a job file, with the dimensions of each generator, [net.saddle] and so on."""

from typing import Literal

from netfall.job.keys.fields import Section, TablePath, key


class Saddle(Section):
    """Dimensions of a saddle over a square."""

    side: float = key("side of the square in plan", 73.2, unit="m", ge=0.001, le=1e6)
    rise: float = key(
        "height of the boundary's high points above the middle", 3.66, unit="m", ge=-1e6, le=1e6
    )
    cells: int = key("cells along a side", 8, ge=2, le=20000)


class Stadium(Section):
    """Dimensions of the roof of the paper, with an arch."""

    length: float = key("axis of the ellipse along x", 88.0, unit="m", ge=0.001, le=1e6)
    width: float = key("axis of the ellipse along y", 66.0, unit="m", ge=0.001, le=1e6)
    arch_rise: float = key("rise of the parabolic arch", 10.0, unit="m", ge=-1e6, le=1e6)
    spacing: float = key("spacing of the cables", 2.2, unit="m", gt=0.0, le=1e6)
    halves: int = key("1: the half on one side of the arch; 2: the whole", 1, ge=1, le=2)


class Ring(Section):
    """Dimensions of a net in an elliptic ring."""

    length: float = key("axis of the ellipse along x", ..., unit="m", ge=0.001, le=1e6)
    width: float = key("axis of the ellipse along y", ..., unit="m", ge=0.001, le=1e6)
    rise: float = key(
        "height of the ring's high points above the middle; 0: flat", ..., unit="m", ge=-1e6, le=1e6
    )
    spacing: float = key("spacing of the cables", ..., unit="m", gt=0.0, le=1e6)


class Wheel(Section):
    """Dimensions of a spoked wheel."""

    diameter: float = key("diameter of the compression ring", 120.0, unit="m", ge=0.001, le=1e6)
    opening: float = key("diameter of the tension rings", 50.0, unit="m", ge=0.001, le=1e6)
    ring_height: float = key(
        "height of the upper tension ring above the lower one", 9.0, unit="m", ge=0.001, le=1e6
    )
    ring_depth: float = key(
        "depth of the truss that the compression ring is part of", 3.0, unit="m", ge=0.001, le=1e6
    )
    spokes: int = key("radial cables of each layer, a multiple of 4", 36, ge=4, le=1000000)
    hoops: int = key("rings of cables between the rings, in the upper layer", 4, ge=0, le=100000)
    spoke_force: float = key(
        "horizontal force of each radial at the tension ring", 1e6, unit="N", ge=1.0, le=1e12
    )
    hoop_force: float = key("tension of the hoops", 0.0, unit="N", ge=0.0, le=1e12)
    brace_force: float = key(
        "tension of the crossed diagonals between the tension rings; 0: there are none",
        0.0,
        unit="N",
        ge=0.0,
        le=1e12,
    )
    ring_groups: bool = key(
        "whether each ring of a group becomes a separate group: hoop1, hoop2, ... from the middle", False
    )


class Dome(Section):
    """Dimensions of a cable dome."""

    diameter: float = key("diameter of the ring of supports", 120.0, unit="m", ge=0.001, le=1e6)
    opening: float = key("diameter of the central ring", 50.0, unit="m", ge=0.001, le=1e6)
    dome_height: float = key(
        "height of the central ring's upper nodes above the supports", 12.0, unit="m", ge=0.001, le=1e6
    )
    strut: float = key("length of the struts", 8.0, unit="m", ge=0.001, le=1e6)
    spokes: int = key("nodes of each ring", 36, ge=4, le=1000000)
    hoops: int = key("rings of struts between the central ring and the supports", 4, ge=0, le=100000)
    spoke_force: float = key(
        "radial force of the two ridge cables at each node of the central ring",
        1e6,
        unit="N",
        ge=1.0,
        le=1e12,
    )
    ring_groups: bool = key(
        "whether each ring of a group becomes a separate group: hoop1, hoop2, ... from the middle", False
    )


class Net(Section):
    """Source of the net: a generator or two tables."""

    generator: Literal["saddle", "stadium", "ring", "wheel", "dome"] | None = key(
        "generator of a net from dimensions"
    )
    nodes: TablePath | None = key("path of nodes.csv, relative to the job file")
    elements: TablePath | None = key("path of elements.csv, relative to the job file")
    unit: Literal["m", "cm", "mm", "ft", "in"] = key(
        "unit of the coordinates in nodes.csv; everything else is in SI units", "m"
    )
    subdivide: int = key(
        "elements per segment of the net; new nodes between two fixed ones are fixed, and move with them",
        1,
        ge=1,
        le=10000,
    )
    saddle: Saddle | None = None
    stadium: Stadium | None = None
    ring: Ring | None = None
    wheel: Wheel | None = None
    dome: Dome | None = None
