"""Report sections on bending: moments by plane at the governing points, and members of concrete."""

import h5py
import numpy as np

from netfall.post.checks.bending import is_bending, is_concrete
from netfall.post.checks.cables import element_groups
from netfall.post.checks.codes import BENDING_KIND
from netfall.post.checks.counted import counted, stage_kinds
from netfall.post.report import markdown as md
from netfall.results.states import DYNAMIC_STAGE, Envelope

CONVENTION = (
    "Moments are positive if they pull at the lower side of the member (vertical), and at the side away from "
    "the middle of its group, outside in a ring (in plan). For upright members read: at the side of x, of y."
)
GOVERNING = {"N": "N", "moment_vertical": "M vertical", "moment_plan": "M in plan"}  # columns, in words


def bending(f: h5py.File, envelope: Envelope, tables: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """Return the forces and moments at the governing points of the groups that bend, and what is not checked.

    tables : of the report, see `report.Inputs`
    """
    elements = tables["elements.csv"]
    lines = [
        CONVENTION,
        "",
        "Moments are of second order. N / (A f) + M / (W f) is checked of groups with a section_modulus.",
        "Imperfections are in chi alone. A chain without buckling_length in the job has only the check of",
        "its section, so its geometry has to include them.",
        "",
        *_governing_points(f, envelope, tables["moments.csv"], is_bending(f)),
    ]
    moving = elements["bending_moment_max"][elements["case_moment"] == DYNAMIC_STAGE]
    if len(moving):
        lines += ["", f"In motion, where only the size is recorded: up to {md.moment(float(moving.max()))}."]
    return [*lines, *md.picture("largest bending moments", "moments.png")]


def concrete(f: h5py.File, envelope: Envelope, tables: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """Return the forces and moments at the governing points of the groups of concrete; empty: no group."""
    if not (rows := is_concrete(f)).any():
        return []
    explanation = "For the design of the sections: no check of axial force with bending includes them."
    return [f"{explanation} {CONVENTION}", "", *_governing_points(f, envelope, tables["moments.csv"], rows)]


def _governing_points(
    f: h5py.File, envelope: Envelope, table: dict[str, np.ndarray], shown: np.ndarray
) -> list[str]:
    """Return the table of the extremes of N and of both moments in each group, in the stages of ULS checks.

    table : see `bending.moment_table`; shown : (m,) bool
    """
    stages = counted(stage_kinds(f, envelope), BENDING_KIND)
    names = [name for name, counts in zip(envelope.names, stages) if counts]
    lines = []
    for group in dict.fromkeys(element_groups(f)[shown]):
        rows = np.flatnonzero((table["group"] == group) & np.isin(table["case"], names))
        points: dict[int, list[str]] = {}  # by row: the extremes that are there
        for column, words in GOVERNING.items():
            values = table[column][rows]
            for which, sign in (("least", -1.0), ("largest", 1.0)):
                if column == "N" or (sign * values > 0.0).any():
                    by_moment = np.nan_to_num(table["moment"][rows])
                    order = np.lexsort((-by_moment, -np.round(sign * values, 6)))
                    points.setdefault(int(rows[order[0]]), []).append(f"{which} {words}")
        for row, extremes in points.items():
            cells = (table[name][row] for name in ("element", "node", "case"))
            numbers = (
                md.force(table["N"][row]),
                *(md.moment(table[name][row]) for name in list(GOVERNING)[1:]),
            )
            lines.append([group or "(none)", ", ".join(extremes), *cells, *numbers])
    header = ["group", "governs", "element", "at node", "in", *GOVERNING.values()]
    return md.as_table(header, lines)
