"""METIS partitions of the net's graph, and their files in the text formats of METIS.

A particle is a vertex, weighted by its number of elements; an element is an edge. Edges between particles
with consecutive numbers weigh more. The step visits particles by number, and loads several far ends at once
if these are consecutive too (`incidence.particles_in_line`). The files are those of gpmetis: NAME.graph
(`n edges 011`, then for each vertex its weight, and each neighbour, from 1, with the edge's weight) and
NAME.graph.part.P (for each vertex its part, from 0).
"""

from pathlib import Path

import numpy as np
import pymetis

from netfall.core.arrays import distinct
from netfall.core.errors import InputError
from netfall.parallel import messages

SEED = 1
CUTS = 4  # number of partitions that METIS tries; it returns the best
# Weight of an edge along the numbering. Few parts then keep rows whole; many parts have a 10 % larger cut.
ALONG = 2
FOLDER = Path("partitions")


def graph_of(n: int, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the net's graph: xadj (n + 1,), adjncy, weights (n,) of vertices, weights of edges like adjncy.

    The weight of a vertex is its number of elements.
    """
    both = np.concatenate([elements, elements[:, ::-1]])
    key = distinct(both[:, 0] * np.int64(n) + both[:, 1])  # parallel elements become one edge
    xadj = np.zeros(n + 1, np.int64)
    start, end = key // n, key % n
    np.cumsum(np.bincount(start, minlength=n), out=xadj[1:])
    return xadj, end, np.bincount(elements.ravel(), minlength=n), np.where(np.abs(start - end) == 1, ALONG, 1)


def metis_partition(n: int, elements: np.ndarray, parts: int) -> np.ndarray:
    """Return the part of each particle (n,), by METIS's k-way method with a fixed seed."""
    if parts == 1 or n == 0:
        return np.zeros(n, np.int32)
    xadj, adjncy, weight, along = graph_of(n, elements)
    options = pymetis.Options(seed=SEED, ncuts=CUTS)
    _, part = pymetis.part_graph(
        parts,
        pymetis.CSRAdjacency(xadj, adjncy),
        vweights=weight,
        eweights=along,
        recursive=False,
        options=options,
    )
    return np.array(part, np.int32)


def graph_text(n: int, elements: np.ndarray) -> str:
    """Return the net's graph as the text of a METIS graph file."""
    xadj, adjncy, weight, along = graph_of(n, elements)
    neighbours = np.column_stack([adjncy + 1, along]).astype(str).ravel().tolist()
    lines = [f"{n} {len(adjncy) // 2} 011"]
    lines += [" ".join([str(weight[p])] + neighbours[2 * xadj[p] : 2 * xadj[p + 1]]) for p in range(n)]
    return "\n".join(lines) + "\n"


def edge_cut(elements: np.ndarray, part: np.ndarray) -> int:
    """Return the number of elements whose ends are in different parts."""
    return int((part[elements[:, 0]] != part[elements[:, 1]]).sum())


def imbalance(elements: np.ndarray, part: np.ndarray, parts: int) -> float:
    """Return the work of the largest part relative to the mean; 1 is perfect."""
    load = np.bincount(part[elements.ravel()], minlength=parts)
    return float(load.max() / max(load.mean(), 1e-300))


def write_partition(folder: Path, name: str, elements: np.ndarray, part: np.ndarray, parts: int) -> None:
    """Write NAME.graph and NAME.graph.part.P for a net with the parts (n,) of its particles."""
    (folder / f"{name}.graph").write_text(graph_text(len(part), elements))
    (folder / f"{name}.graph.part.{parts}").write_text("".join(f"{p}\n" for p in part))


def read_partition(
    name: str, n: int, elements: np.ndarray, parts: int, folder: Path = FOLDER
) -> np.ndarray | None:
    """Return the part of each particle (n,) from the files of `netfall partition`, None without files.

    Raises InputError if the files belong to another net or are damaged.
    """
    graph, path = folder / f"{name}.graph", folder / f"{name}.graph.part.{parts}"
    if parts == 1 or not path.exists():
        return None
    try:
        lines = [line.split() for line in graph.read_text().splitlines() if not line.startswith("%")]
        words = path.read_text().split()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            messages.UNREADABLE_GRAPH(graph=graph, error=error, path=path, parts=parts)
        ) from None
    if lines != [line.split() for line in graph_text(n, elements).splitlines()]:
        head = " ".join(lines[0][:2]) if lines else "nothing"
        edges = len(graph_of(n, elements)[1]) // 2
        raise InputError(messages.OTHER_GRAPH(graph=graph, head=head, n=n, edges=edges, parts=parts))
    try:
        part = np.array(words, np.int64)
        valid = len(part) == n and (n == 0 or (part.min() >= 0 and part.max() < parts))
    except (ValueError, OverflowError):
        valid = False
    if not valid:
        raise InputError(messages.DAMAGED_PARTITION(path=path, n=n, last=parts - 1, parts=parts))
    return part.astype(np.int32)
