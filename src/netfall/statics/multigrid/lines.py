"""Line smoother: lines of elements that continue over particles, each solved exactly.

A net is about a thousand times as stiff along a cable as across. Some errors vary little along cables and
strongly from one cable to the next. No point smoother damps them, and coarser grids do not contain them. So
the particles of a line are solved together: the stiffness of the line is a chain of 3 x 3 blocks. One rank
solves it, forward and back, in double precision. In single precision the inverse is not positive definite if
cables yield, because the stiffness along a line then varies strongly. The answers of all lines at a particle
are added in ascending order of the lines.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arithmetic import fused
from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.kernels import kernel
from netfall.parallel.agree import on_root
from netfall.parallel.subdomain import Distribution
from netfall.statics.multigrid.distributed import SharedRows
from netfall.statics.multigrid.levels import invert
from netfall.statics.multigrid.rows import BlockRows, Ghosts, Owners, ghosts_of, row_entries
from netfall.statics.multigrid.tangent import Incidence, Tangent, incidence_of, without_compression

MAX_LINE_COSINE = -0.8  # largest cosine of two elements at a particle: a line turns by at most 37 degrees
# largest number of lines that touch one element: with more the sum of the answers overshoots
MOST_TOUCHING = 7


class Lines(NamedTuple):
    """Lines that a rank solves. A place is a particle in one of them.

    start : (lines + 1,) first place of each
    node, element : (places,) the particle of each, and the element from there to the next place, -1: none
    particles, elements : ghosts that this rank needs for that; own rows come first, then these
    element_rows : own elements, of this rank's
    begin, place : the places of each own particle, from begin (n_owned + 1,) on; places : ghosts of these
    touching : largest number of places at one element, with the two of a line counted as one
    """

    start: np.ndarray
    node: np.ndarray
    element: np.ndarray
    particles: Ghosts
    elements: Ghosts
    element_rows: np.ndarray
    begin: np.ndarray
    place: np.ndarray
    places: Ghosts
    touching: int


@kernel
def pair_elements(at: Incidence, ends: IntArray, x: FloatArray, free: BoolArray, other: IntArray) -> None:
    """Fill other (m, 2) with the element in which the line continues beyond each end, -1: the line ends.

    at : `Incidence` of all particles; ends : (m, 2); x : (n, 3) [m]; free : (n, 3)

    The straightest pair of elements at a particle forms one line, then the straightest pair of the others.
    """
    for p in range(x.shape[0]):
        first, end = at.start[p], at.start[p + 1]
        # if more elements meet here, no two form a line: too many lines would touch each of them
        if end - first > 2 * (MOST_TOUCHING + 1) or not (free[p, 0] or free[p, 1] or free[p, 2]):
            continue
        for _ in range((end - first) // 2):
            best, first_best, second_best = MAX_LINE_COSINE, -1, -1
            for a in range(first, end):
                e, q = at.element[a], at.far[a]
                if other[e, 0 if ends[e, 0] == p else 1] >= 0:
                    continue
                for b in range(a + 1, end):
                    f, r = at.element[b], at.far[b]
                    if other[f, 0 if ends[f, 0] == p else 1] >= 0:
                        continue
                    product = square_q = square_r = 0.0
                    for k in range(3):
                        to_q, to_r = x[q, k] - x[p, k], x[r, k] - x[p, k]
                        product += to_q * to_r
                        square_q += to_q * to_q
                        square_r += to_r * to_r
                    if product < best * np.sqrt(square_q * square_r):
                        best, first_best, second_best = product / np.sqrt(square_q * square_r), e, f
            if first_best < 0:
                break
            other[first_best, 0 if ends[first_best, 0] == p else 1] = second_best
            other[second_best, 0 if ends[second_best, 0] == p else 1] = first_best


@kernel
def walk_lines(
    ends: IntArray, other: IntArray, seen: IntArray, start: IntArray, node: IntArray, element: IntArray
) -> int:
    """Fill start (m + 1,), node, element (2 m,) with all lines and return their number.

    other : of `pair_elements`; seen : (m,) of zeros, overwritten A closed line ends at the particle where it
        starts, which so has two places in it.
    """
    count = k = 0
    for first in range(ends.shape[0]):
        if seen[first]:
            continue
        e, end = first, 0
        while other[e, end] >= 0 and other[e, end] != first:
            p, e = ends[e, end], other[e, end]
            end = 1 if ends[e, 0] == p else 0
        start[count] = k
        while True:
            seen[e] = 1
            node[k], element[k] = ends[e, end], e
            k += 1
            p, following = ends[e, 1 - end], other[e, 1 - end]
            if following < 0 or seen[following]:
                break
            e, end = following, 0 if ends[following, 0] == p else 1
        node[k], element[k] = p, -1
        k, count = k + 1, count + 1
    start[count] = k
    return count


def all_lines(ends: np.ndarray, x: np.ndarray, free: BoolArray) -> tuple[Any, ...]:
    """Return start, node, element of all lines of a net, and `touching`. ends : (m, 2); x, free : (n, 3)"""
    n, m = len(x), len(ends)
    other, seen = np.full((m, 2), -1, np.int32), np.zeros(m, np.uint8)
    start, (node, element) = np.zeros(m + 1, np.int64), np.empty((2, 2 * m), np.int32)
    pair_elements(incidence_of(ends, np.arange(n), n), ends, x, free, other)
    count = walk_lines(ends, other, seen, start, node, element)
    node, element = node[: start[count]], element[: start[count]]
    moves = np.asarray(free.any(1))
    count_at = np.bincount(node, minlength=n) * moves
    touching = count_at[ends].sum(1) - moves[ends].all(1)
    return start[: count + 1], node, element, int(touching.max(initial=0))


def distribute_lines(distribution: Distribution, ends: np.ndarray, x: np.ndarray, free: IntArray) -> Lines:
    """Distribute the lines of a net: a line goes to the owner of its middle. Collective.

    ends : (m, 2) of this rank's elements; x, free : (n, 3) of its particles
    """
    comm, d = distribution.comm, distribution.subdomain
    whole: Any = distribution.gather_elements(d.particle_gid[ends])
    all_x: Any = distribution.gather_particles(x)
    all_free: Any = distribution.gather_particles(free)
    start, node, element, touching = comm.bcast(on_root(comm, lambda: all_lines(whole, all_x, all_free != 0)))
    particles = Owners(comm, d.particle_gid[: d.n_owned])
    elements = Owners(comm, d.element_gid[d.element_owned])
    counts = np.diff(start)
    own_lines = np.flatnonzero(particles.rank[node[start[:-1] + counts // 2]] == comm.rank)
    counts, own_places = row_entries(counts, own_lines)
    places = Owners(comm, own_places)
    order = np.argsort(node, kind="stable")
    number = np.bincount(node, minlength=distribution.n)
    counts_at, place = row_entries(number, particles.own_gid)
    node, element, place = node[own_places], element[own_places], order[place]
    continues = element >= 0
    node_ghosts = ghosts_of(comm, node, particles)
    element_ghosts = ghosts_of(comm, element[continues], elements)
    place_ghosts = ghosts_of(comm, place, places)
    node, place = node_ghosts.local_rows(node, particles), place_ghosts.local_rows(place, places)
    element[continues] = element_ghosts.local_rows(element[continues], elements)
    begin = np.concatenate([[0], np.cumsum(counts_at)])
    start, own_elements = np.concatenate([[0], np.cumsum(counts)]), np.flatnonzero(d.element_owned)
    return Lines(
        start, node, element, node_ghosts, element_ghosts, own_elements, begin, place, place_ghosts, touching
    )


@kernel
def factorise_lines(
    start: IntArray,
    node: IntArray,
    element: IntArray,
    diagonal: FloatArray,
    free: BoolArray,
    direction: FloatArray,
    axial: FloatArray,
    across: FloatArray,
    work: FloatArray,
    lower: FloatArray,
    inverse: FloatArray,
) -> None:
    """Factorise each line, L D L^T by blocks: lower (places, 9), inverse (places, 6) of D.

    start, node, element : of `Lines`; diagonal (n, 3, 3), free (n, 3) : of particles direction (m, 3), axial,
        across (m,) : of elements; inverse : entries as in `levels.invert`
    work : (4, 3, 3), overwritten
    """
    D, C, L, last_inverse = work[0], work[1], work[2], work[3]
    for line in range(start.shape[0] - 1):
        for k in range(start[line], start[line + 1]):
            p, trace = node[k], 0.0
            for i in range(3):
                trace += diagonal[p, i, i]
                for j in range(3):
                    D[i, j], L[i, j] = diagonal[p, i, j], 0.0
            if k > start[line]:
                q, link = node[k - 1], element[k - 1]
                for i in range(3):
                    along = (axial[link] - across[link]) * direction[link, i]
                    for j in range(3):
                        stiffness = -along * direction[link, j] - (across[link] if i == j else 0.0)
                        C[i, j] = stiffness if free[p, i] and free[q, j] else 0.0
                for i in range(3):
                    for j in range(3):
                        L[i, j] = (
                            C[i, 0] * last_inverse[0, j]
                            + C[i, 1] * last_inverse[1, j]
                            + C[i, 2] * last_inverse[2, j]
                        )
                for i in range(3):
                    for j in range(3):
                        D[i, j] -= L[i, 0] * C[j, 0] + L[i, 1] * C[j, 1] + L[i, 2] * C[j, 2]
            a, b, c, d, e, f = invert(D[0, 0], D[0, 1], D[0, 2], D[1, 1], D[1, 2], D[2, 2], trace)
            last_inverse[0, 0], last_inverse[0, 1], last_inverse[0, 2] = a, b, c
            last_inverse[1, 0], last_inverse[1, 1], last_inverse[1, 2] = b, d, e
            last_inverse[2, 0], last_inverse[2, 1], last_inverse[2, 2] = c, e, f
            for i in range(3):
                lower[k, 3 * i], lower[k, 3 * i + 1], lower[k, 3 * i + 2] = L[i, 0], L[i, 1], L[i, 2]
            inverse[k, 0], inverse[k, 1], inverse[k, 2] = a, b, c
            inverse[k, 3], inverse[k, 4], inverse[k, 5] = d, e, f


@kernel
def solve_lines(
    start: IntArray,
    node: IntArray,
    lower: FloatArray,
    inverse: FloatArray,
    x: FloatArray,
    work: FloatArray,
    y: FloatArray,
) -> None:
    """Solve each line for y (places, 3), with the rows of x (n, 3) at its places as right-hand side.

    start, node, lower, inverse : see `factorise_lines`; work : (places, 3), overwritten
    """
    for line in range(np.uint64(start.shape[0] - 1)):
        first, end = np.uint64(start[line]), np.uint64(start[line + 1])
        a = b = c = 0.0
        for k in range(first, end):
            p = np.uint64(node[k])
            u, v, w = np.float64(x[p, 0]), np.float64(x[p, 1]), np.float64(x[p, 2])
            a, b, c = (
                fused(-lower[k, 2], c, fused(-lower[k, 1], b, fused(-lower[k, 0], a, u))),
                fused(-lower[k, 5], c, fused(-lower[k, 4], b, fused(-lower[k, 3], a, v))),
                fused(-lower[k, 8], c, fused(-lower[k, 7], b, fused(-lower[k, 6], a, w))),
            )
            work[k, 0], work[k, 1], work[k, 2] = a, b, c
        a = b = c = 0.0
        for back in range(end - first):
            k = end - np.uint64(1) - back
            u, v, w = work[k, 0], work[k, 1], work[k, 2]
            u, v, w = (
                fused(inverse[k, 2], w, fused(inverse[k, 1], v, inverse[k, 0] * u)),
                fused(inverse[k, 4], w, fused(inverse[k, 3], v, inverse[k, 1] * u)),
                fused(inverse[k, 5], w, fused(inverse[k, 4], v, inverse[k, 2] * u)),
            )
            if back > 0:
                m = k + np.uint64(1)
                u, v, w = (
                    fused(-lower[m, 6], c, fused(-lower[m, 3], b, fused(-lower[m, 0], a, u))),
                    fused(-lower[m, 7], c, fused(-lower[m, 4], b, fused(-lower[m, 1], a, v))),
                    fused(-lower[m, 8], c, fused(-lower[m, 5], b, fused(-lower[m, 2], a, w))),
                )
            a, b, c = u, v, w
            y[k, 0], y[k, 1], y[k, 2] = a, b, c


@kernel
def add_places(begin: IntArray, place: IntArray, y: FloatArray, scale: Any, x: FloatArray) -> None:
    """Add scale times the sum over the places of each particle to x (n_owned, 3).

    begin, place : of `Lines`; y : (k, 3)
    """
    for i in range(np.uint64(x.shape[0])):
        a, b, c = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for k in range(np.uint64(begin[i]), np.uint64(begin[i + 1])):
            j = np.uint64(place[k])
            a, b, c = a + y[j, 0], b + y[j, 1], c + y[j, 2]
        x[i, 0], x[i, 1] = fused(scale, a, x[i, 0]), fused(scale, b, x[i, 1])
        x[i, 2] = fused(scale, c, x[i, 2])


class LineSmoother:
    """Damped smoother for matrix x = b that adds up the exact solutions of all lines."""

    def __init__(self, lines: Lines, matrix: BlockRows, net: Any, K: Tangent):
        """Factorise the lines of the tangent in `matrix`. Collective."""
        comm, n, K, own_rows = (
            matrix.comm,
            len(matrix.rows.own_gid),
            without_compression(K),
            lines.element_rows,
        )
        element_arrays = (
            rows if len(own_rows) == len(rows) else rows[own_rows]
            for rows in (K.direction, K.axial, K.across)
        )
        direction, axial, across = (lines.elements.joined(comm, rows) for rows in element_arrays)
        diagonal = lines.particles.joined(comm, matrix.diagonal())
        free = lines.particles.joined(comm, np.ascontiguousarray(net.free[:n] != 0))
        self.lines, places = lines, len(lines.node)
        self.work = np.empty((places, 3))
        self.lower, self.inverse = np.empty((places, 9)), np.empty((places, 6))
        factorise_lines(
            lines.start,
            lines.node,
            lines.element,
            diagonal,
            free,
            direction,
            axial,
            across,
            np.empty((4, 3, 3)),
            self.lower,
            self.inverse,
        )
        # bounds the eigenvalues; damped from there down to a third of it
        bound = lines.touching
        self.scale = np.float32(2.0 / (bound + max(1.0, bound / 3.0)))
        self.x, self.y = SharedRows(comm, n, lines.particles), SharedRows(comm, places, lines.places)

    def add_step(self, r: np.ndarray, x: np.ndarray) -> None:
        """Add to x the step that answers the residual r. Both (n_owned, 3). Collective."""
        lines = self.lines
        self.x.own[:] = r
        self.x.share()
        solve_lines(lines.start, lines.node, self.lower, self.inverse, self.x.rows, self.work, self.y.own)
        self.y.share()
        add_places(lines.begin, lines.place, self.y.rows, self.scale, x)
