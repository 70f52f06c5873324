"""The keys of [net] that give the dimensions of nets from generators."""

from netfall.job.keys import between, count, flag, not_negative, positive

DIMENSIONS = (
    between(1e-3, 1e6, "side", "m", 73.2, "saddle: side of the square in plan"),
    between(
        -1e6,
        1e6,
        "rise",
        "m",
        3.66,
        "saddle, ring: height of the boundary's high points above the middle; ring: 0 is flat",
    ),
    count("cells", 8, "saddle: cells along a side", low=2, high=20_000),
    between(1e-3, 1e6, "length", "m", 88.0, "stadium, ring: axis of the ellipse along x"),
    between(1e-3, 1e6, "width", "m", 66.0, "stadium, ring: axis of the ellipse along y"),
    between(-1e6, 1e6, "arch_rise", "m", 10.0, "stadium: rise of the parabolic arch"),
    positive("spacing", "m", 2.2, "stadium, ring: distance of the cables", high=1e6),
    count("halves", 1, "stadium: 1, the half on one side of the arch, or 2, the whole", low=1, high=2),
    between(1e-3, 1e6, "diameter", "m", 120.0, "wheel: of the compression ring; dome: of the supports"),
    between(
        1e-3, 1e6, "opening", "m", 50.0, "wheel: diameter of the tension rings; dome: of the central ring"
    ),
    between(1e-3, 1e6, "ring_height", "m", 9.0, "wheel: of the upper tension ring above the lower one"),
    between(1e-3, 1e6, "ring_depth", "m", 3.0, "wheel: of the truss that the compression ring is part of"),
    between(
        1e-3, 1e6, "dome_height", "m", 12.0, "dome: of the central ring's upper nodes above the supports"
    ),
    between(1e-3, 1e6, "strut", "m", 8.0, "dome: length of the struts"),
    count(
        "spokes",
        36,
        "wheel: radial cables of each layer, a multiple of 4; dome: nodes of each ring",
        low=4,
        high=1_000_000,
    ),
    count(
        "hoops",
        4,
        "wheel: rings of cables between the rings, in the upper layer; "
        "dome: rings of struts between the central ring and the supports",
        low=0,
        high=100_000,
    ),
    between(
        1.0,
        1e12,
        "spoke_force",
        "N",
        1e6,
        "wheel: horizontal force of each radial at the tension ring; "
        "dome: of the two ridge cables at each node of the central ring, along the radius",
    ),
    not_negative("hoop_force", "N", 0.0, "wheel: tension of the hoops", high=1e12),
    not_negative(
        "brace_force",
        "N",
        0.0,
        "wheel: tension of the crossed diagonals between the tension rings; 0: there are none",
        high=1e12,
    ),
    flag(
        "ring_groups",
        False,
        "wheel, dome: whether each ring of a group is a group of its own: hoop1, hoop2, ... from the middle",
    ),
)
GENERATOR_KEYS = {
    "saddle": ("side", "rise", "cells"),
    "stadium": ("length", "width", "arch_rise", "spacing", "halves"),
    "ring": ("length", "width", "rise", "spacing"),
    "wheel": (
        *("diameter", "opening", "ring_height", "ring_depth"),
        *("spokes", "hoops", "spoke_force", "hoop_force", "brace_force", "ring_groups"),
    ),
    "dome": ("diameter", "opening", "dome_height", "strut", "spokes", "hoops", "spoke_force", "ring_groups"),
}
