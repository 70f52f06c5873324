"""Faces of the roof from a table, for nets whose faces do not follow from the plan."""

from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.geometry import messages
from netfall.geometry.faces import Faces, faces_of_rings, insert_side_particles, vector_areas
from netfall.geometry.net import Net, pair_key
from netfall.geometry.plan import Plan
from netfall.job.csv_table import Table
from netfall.job.job import Job
from netfall.job.values import format_value

AXES = ("x", "y", "z")
MIN_PLAN_RATIO = 1e-6  # ratio of plan to surface area below which a face has no orientation in plan


def read_faces(job: Job, net: Net) -> tuple[Faces, Plan]:
    """Read the faces of the table `[roof] faces`, and their sides as a plan. Sets `net.corners`.

    Rows of one face are consecutive: its corners in order, anticlockwise as seen from `[roof] normal` or
    from above, then those around each of its holes, clockwise; `ring` counts the rings, 0 for the outer one.
    The normals of the faces follow from this order by the right-hand rule. A node is given by its id, a point
    without a node by its position [m]. Raises InputError with all errors.
    """
    roof: Any = job.roof
    if keys := [key for key in ("groups", "openings", "lines") if getattr(roof, key)]:
        raise InputError(messages.FACES_AND_OTHERS(path=job.path, keys=" and ".join(keys)))
    table = Table(job.path.parent / roof.faces, ("face", "ring", "node", *AXES), ("face", "node"))
    corner, net.corners = _corners(table, net)
    face = table.integers("face")
    ring = table.integers("ring") if "ring" in table else np.zeros(len(table), np.int64)
    start = np.flatnonzero(np.append(True, (face[1:] != face[:-1]) | (ring[1:] != ring[:-1])))
    space = net.in_plan(np.concatenate([net.x, net.corners]))
    rings, points = Faces(np.append(start, len(face)), corner), space[:, :2]
    side = f"[roof] normal = {format_value(roof.normal)}" if roof.normal else "above"
    _check(table, face[start], ring[start], rings, space, side)
    table.finish()
    sides = rings.sides()  # each once, with the undivided element that lies on it
    sides = sides[np.unique(pair_key(sides, len(points)), return_index=True)[1]]
    key, side_key = pair_key(net.undivided(), len(points)), pair_key(sides, len(points))
    order = np.argsort(key, kind="stable")
    row = np.minimum(np.searchsorted(key[order], side_key), len(key) - 1)
    element = np.where(key[order][row] == side_key, order[row], -1)
    plan = Plan(points, sides, element, np.tile([0.0, 1.0], (len(sides), 1)))
    polygon = np.cumsum(np.append(False, face[start][1:] != face[start][:-1]))
    return faces_of_rings(insert_side_particles(rings, plan, net), polygon, points), plan


def _corners(table: Table, net: Net) -> tuple[np.ndarray, np.ndarray]:
    """Return the point (c,) of each row, from n on without a node, and positions (k, 3) [m] of the others."""
    ids = net.node_id[: net.given]  # nodes of `subdivide` are added later
    rows = {str(number): row for row, number in enumerate(ids.tolist())}
    place = table.stacked(AXES, unit="m")
    corner = np.zeros(len(table), np.int64)
    extra: dict[tuple[float, ...], int] = {}
    for row, word in enumerate(table.words("node")):
        if word:
            corner[row] = rows.get(word, 0)
            if word not in rows:
                at, number = table.at(row), word[:40]
                table.wrong(messages.NO_SUCH_NODE(row=at, name="node", number=number, nodes="the net"))
        elif np.isnan(place[row]).any():
            table.wrong(messages.FACE_POINT_MISSING(row=table.at(row)))
        else:
            corner[row] = net.n + extra.setdefault(tuple(place[row].tolist()), len(extra))
    return corner, np.array(list(extra)).reshape(-1, 3)


def _check(
    table: Table, number: np.ndarray, ring: np.ndarray, faces: Faces, points: np.ndarray, side: str
) -> None:
    """Report faces that are not consecutive, have too few corners, or run the wrong way.

    number, ring : (r,) of the rings `faces`; points : (k, 3) [m], as seen from above; side : name of above
    """
    first = np.append(True, number[1:] != number[:-1])
    values, times = np.unique(number[first], return_counts=True)
    for value in values[times > 1]:
        table.wrong(messages.SCATTERED_FACE(face=value))
    expected = np.arange(len(ring)) - np.maximum.accumulate(np.where(first, np.arange(len(ring)), 0))
    for f in np.flatnonzero(ring != expected):
        table.wrong(messages.WRONG_RING(face=number[f], ring=ring[f]))
    vector = vector_areas(points, faces)
    area, upright = vector[:, 2], np.abs(vector[:, 2]) < MIN_PLAN_RATIO * lengths(vector)
    for f in np.flatnonzero(upright)[:1]:
        surface = lengths(vector[f])
        error = messages.UPRIGHT_FACES(
            count=upright.sum(), side=side, face=number[f], plan=area[f], surface=surface
        )
        table.wrong(error)
    for f, corners in enumerate(np.split(faces.corner, faces.start[1:-1])):
        if len(np.unique(corners)) < max(3, len(corners)):
            table.wrong(messages.FEW_CORNERS(face=number[f]))
        elif not (upright[f] or (area[f] < 0.0 if ring[f] else area[f] > 0.0)):
            turned = messages.ANTICLOCKWISE_HOLE if ring[f] else messages.CLOCKWISE_FACE
            table.wrong(turned(face=number[f], area=area[f], side=side))
