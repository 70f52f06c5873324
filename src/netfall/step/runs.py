"""Runs: stretches of particles whose far ends are all as far away in number, so they load in one piece."""

from typing import NamedTuple

import numpy as np

from netfall.ground.compile import inner_kernel, kernel
from netfall.mechanics.fields import SLOTS

LANES = 8  # numbers of the widest registers: particles that one takes at once
MANY_LOOSE = 8  # one particle in so many outside a chunk's runs: then it is gone through without them


class Runs(NamedTuple):
    """How the vector loop goes through the particles of each chunk.

    gathered : (chunks,) 1 where it goes through all of them one after the other, whatever their far ends
    spans : (chunks, 6) from and up to which row of each of the next three
    whole : (., 3 + SLOTS) first and last particle of runs, a multiple of LANES apart, how far away the far
        ends are, and 1 where those of the first two slots come before: these keep what is kept of elements
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
def end_of_run(p, high, other):
    """The first particle after p, at most `high`, whose far ends are farther or nearer in number."""
    end = p + 1
    while end < high and (
        other[0, end] - end == other[0, p] - p
        and other[1, end] - end == other[1, p] - p
        and other[2, end] - end == other[2, p] - p
        and other[3, end] - end == other[3, p] - p
    ):
        end += 1
    return end


@inner_kernel
def is_torn(low, high, width, other):
    """Whether so few particles of a chunk are in runs that it had better be gone through without."""
    outside, p = high - low, low
    while p < high and width <= SLOTS:
        end = end_of_run(p, high, other)
        outside -= (end - p) // LANES * LANES
        p = end
    return outside * MANY_LOOSE > high - low


@kernel
def find_runs(chunks, other):
    """Write `chunks.runs` of particles that the rank has owned from the start.

    chunks : `plan.Chunks`; other : (slots, n) local number of the far end
    """
    runs = chunks.runs
    gathered, spans, whole, rest, loose = runs.gathered, runs.spans, runs.whole, runs.rest, runs.loose
    wholes = rests = stretches = 0
    for c in range(chunks.low.shape[0]):
        if chunks.is_split is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
            if chunks.is_split[c]:
                continue
        low, high = chunks.low[c], chunks.high[c]
        gathered[c] = is_torn(low, high, chunks.width[c], other)
        if gathered[c]:
            continue
        spans[c, 0], spans[c, 2], spans[c, 4] = wholes, rests, stretches
        p = covered = low  # covered: where the last run ends
        while p < high:
            end = end_of_run(p, high, other)
            left = end - (end - p) % LANES  # so far in nothing
            if left > p:
                whole[wholes, 0], whole[wholes, 1] = p, left
                for s in range(SLOTS):
                    whole[wholes, 2 + s] = np.int64(other[s, p]) - p
                whole[wholes, 2 + SLOTS] = other[0, p] < p and other[1, p] < p
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
