"""Runs: stretches of particles whose far ends are all as far away in number, so they load in one piece.

In most of them particles borrow: of their four elements, in ascending order of the far ends, the first two
are the others' fourth and third, computed there from the same bits. Those need not be computed twice.
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.compile import inner_kernel, kernel
from netfall.mechanics.fields import SLOTS

LANES = 8  # numbers of the widest registers: particles that one takes at once
ORDERED, BORROWING = 1, 2  # runs whose first two far ends come before; those that borrow their elements
LEAST_LOAN = 5 * LANES  # how far away in number a lender must be; in shorter rows blocks cost what loans save
MANY_LOOSE = 8  # one particle in so many outside a chunk's runs: then it is gone through without them


class Runs(NamedTuple):
    """How the vector loop goes through the particles of each chunk.

    gathered : (chunks,) 1 where it goes through all of them one after the other, whatever their far ends
    spans : (chunks, 6) from and up to which row of each of the next three
    whole : (., 3 + SLOTS) first and last particle of runs, a multiple of LANES apart, how far away the far
        ends are, and ORDERED or BORROWING: in these what is kept of the first two elements is at the others
    rest : (.,) particles in no run, the last of a chunk repeated up to a multiple of LANES
    loose : (., 2) first and last particle of stretches outside the runs, whose kick comes after all forces
    """

    gathered: np.ndarray
    spans: np.ndarray
    whole: np.ndarray
    rest: np.ndarray
    loose: np.ndarray


def make_runs(chunks: int, particles: int) -> Runs:
    """`Runs` with room for the most that there could be, for `find_runs`."""
    return Runs(
        np.ones(chunks, np.uint8),
        np.zeros((chunks, 6), np.int64),
        np.zeros((particles // LANES, 3 + SLOTS), np.int64),
        np.zeros(particles + LANES * chunks, np.uint32),
        np.zeros((particles // LANES + chunks, 2), np.int64),
    )


@inner_kernel
def borrows(p, other, inv_L0):
    """Whether the elements in the first two slots of p are in the fourth of one before, the third of p - 1.

    Empty slots count as alike. inv_L0 : (slots, n), the same bits at both ends of an element
    """
    lender = np.int64(other[0, p])
    if lender + LEAST_LOAN > p or other[1, p] != p - 1 or other[2, p] != p + 1:
        return False
    first = other[3, lender] == p and inv_L0[3, lender] == inv_L0[0, p]
    return first and other[2, p - 1] == p and inv_L0[2, p - 1] == inv_L0[1, p]


@inner_kernel
def end_of_run(p, high, other, inv_L0):
    """The first particle after p, at most `high`, whose far ends are farther or nearer, or loans others."""
    end, loans = p + 1, borrows(p, other, inv_L0)
    while end < high and (
        other[0, end] - end == other[0, p] - p
        and other[1, end] - end == other[1, p] - p
        and other[2, end] - end == other[2, p] - p
        and other[3, end] - end == other[3, p] - p
        and borrows(end, other, inv_L0) == loans
    ):
        end += 1
    return end


@inner_kernel
def is_torn(low, high, width, other, inv_L0):
    """Whether so few particles of a chunk are in runs that it had better be gone through without."""
    outside, p = high - low, low
    while p < high and width <= SLOTS:
        end = end_of_run(p, high, other, inv_L0)
        outside -= (end - p) // LANES * LANES
        p = end
    return outside * MANY_LOOSE > high - low


@kernel
def find_runs(chunks, other, inv_L0):
    """Write `chunks.runs` of particles that the rank has owned from the start.

    chunks : `plan.Chunks`; other : (slots, n) local number of the far end; inv_L0 : (slots, n) [1/m]
    """
    runs = chunks.runs
    gathered, spans, whole, rest, loose = runs.gathered, runs.spans, runs.whole, runs.rest, runs.loose
    wholes = rests = stretches = 0
    for c in range(chunks.low.shape[0]):
        if chunks.is_split[c]:
            continue
        low, high = chunks.low[c], chunks.high[c]
        gathered[c] = is_torn(low, high, chunks.width[c], other, inv_L0)
        if gathered[c]:
            continue
        spans[c, 0], spans[c, 2], spans[c, 4] = wholes, rests, stretches
        p = covered = low  # covered: where the last run ends
        while p < high:
            end = end_of_run(p, high, other, inv_L0)
            left = end - (end - p) % LANES  # so far in nothing
            if left > p:
                whole[wholes, 0], whole[wholes, 1] = p, left
                for s in range(SLOTS):
                    whole[wholes, 2 + s] = np.int64(other[s, p]) - p
                whole[wholes, 2 + SLOTS] = ORDERED if other[0, p] < p and other[1, p] < p else 0
                if borrows(p, other, inv_L0):
                    whole[wholes, 2 + SLOTS] = BORROWING
                wholes += 1
                if covered < p:
                    loose[stretches, 0], loose[stretches, 1] = covered, p
                    stretches += 1
                covered = left
            for p in range(left, end):
                rest[rests] = p
                rests += 1
            p = end
        if covered < high:
            loose[stretches, 0], loose[stretches, 1] = covered, high
            stretches += 1
        spans[c, 1], spans[c, 3], spans[c, 5] = wholes, rests, stretches
        while rests % LANES > 0:
            rest[rests] = rest[rests - 1]
            rests += 1


@inner_kernel
def end_loans(c, chunks, slots):
    """The particles of chunk c borrow no more, as elements of theirs are about to change."""
    spans, whole = chunks.runs.spans, chunks.runs.whole
    for r in range(spans[c, 0], spans[c, 1]):
        if whole[r, 2 + SLOTS] != BORROWING:
            continue
        whole[r, 2 + SLOTS] = ORDERED
        for p in range(whole[r, 0], whole[r, 1]):
            copy_slot(0, p, 3, p + whole[r, 2], slots)
            copy_slot(1, p, 2, p - 1, slots)
            if slots.eps_p is not None:
                chunks.has_yielded[c] |= slots.eps_p[0, p] != 0.0 or slots.eps_p[1, p] != 0.0


@kernel
def end_all_loans(chunks, slots):
    """`end_loans` of all chunks."""
    for c in range(chunks.low.shape[0]):
        end_loans(c, chunks, slots)


@inner_kernel
def copy_slot(s, p, t, far, slots):
    """What changes in the course of a run, into slot s of particle p from slot t of its element's far end."""
    if slots.eps_p is not None:
        slots.eps_p[s, p] = slots.eps_p[t, far]
    if slots.branch_a is not None:
        slots.branch_a[s, p], slots.branch_b[s, p] = slots.branch_a[t, far], slots.branch_b[t, far]
    if slots.branch_c is not None:
        slots.branch_c[s, p] = slots.branch_c[t, far]
