"""How far the step scales past two cores: a model of its work, halo and messages on each rank.

    .venv/bin/mpirun -n 2 .venv/bin/python jobs/bench/model.py [--elements 1e6 1e7] [--parts 64 512 4096]

Square nets as in the benchmark. The step of a rank takes
    T = elements t_element + calls t_call + messages t_message + bytes / bandwidth
with the numbers from METIS cuts; t_element in and out of the cache from the step's benchmark (two ranks at
once); t_message and bandwidth from an exchange between two ranks of this machine as the step does it, and,
for a network, from --network-message and --network-bandwidth. Sizes that are not cut here follow from the
cuts: a subdomain's boundary is a multiple of the root of its particles (fitted, printed with its spread).
"""

import argparse
import time

import numpy as np
from mpi4py import MPI

from netfall.core.kernels import kernel
from netfall.parallel.halo import Halo, exchange_rows
from netfall.parallel.partition import metis_partition
from netfall.parallel.subdomain import Subdomain

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--elements", type=float, nargs="+", default=[1e6, 1e7], help="nets that are cut")
parser.add_argument(
    "--further", type=float, nargs="*", default=[1e8], help="nets that are computed from the fit"
)
parser.add_argument("--parts", type=int, nargs="+", default=[64, 512, 4096])
parser.add_argument(
    "--element-in-cache",
    type=float,
    default=1.7e-9,
    help="s for an element and step, from step.py 200 elastic on two ranks, times 2",
)
parser.add_argument(
    "--element-in-memory",
    type=float,
    default=3.6e-9,
    help="s, from step.py 1000 elastic on two ranks, times 2",
)
parser.add_argument(
    "--cache-elements", type=float, default=2e5, help="elements of a rank that its share of the cache holds"
)
parser.add_argument("--step", type=float, default=1.0e-6, help="s of a step without elements")
parser.add_argument(
    "--network-message", type=float, default=2e-6, help="s for a message between nodes (assumed)"
)
parser.add_argument(
    "--network-bandwidth", type=float, default=10e9, help="bytes/s of a rank between nodes (assumed)"
)
arguments = parser.parse_args()
comm = MPI.COMM_WORLD


@kernel
def exchanges(sent, arrived, buffers, times):
    """So many exchanges, one after another; MPI's error code."""
    error = 0
    for _ in range(times):
        error |= exchange_rows(sent, arrived, buffers)
    return error


def seconds_of_exchange(particles: int) -> float:
    """Of one exchange of three numbers for so many particles each way between ranks 0 and 1."""
    index, nothing = np.arange(particles, dtype=np.uint32), np.zeros((0, 2), np.uint32)
    halo = Halo(
        comm,
        Subdomain(
            particles,
            np.arange(2 * particles),
            nothing[:, 0],
            nothing,
            nothing[:, 0] > 0,
            (1 - comm.rank,),
            (particles,),
            (particles,),
            index,
        ),
        3,
    )
    sent, arrived = np.zeros((2, particles, 3))
    best = np.inf
    for times in [100] + 7 * [2000]:
        comm.Barrier()
        begin = time.perf_counter()
        assert exchanges(sent, arrived, halo.buffers, times) == 0
        best = min(best, (time.perf_counter() - begin) / times)
    halo.free()
    return comm.allreduce(best, MPI.MAX)


def cut(elements: float, parts: int) -> dict:
    """The fullest part and the longest boundary of a METIS cut of a square net."""
    N = round(np.sqrt(elements / 2))
    number = np.arange(N * N).reshape(N, N)
    pairs = np.concatenate(
        [
            np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
            np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
        ]
    )
    part = metis_partition(N * N, pairs, parts)
    owner = part[pairs]
    crossing = owner[:, 0] != owner[:, 1]
    held = (
        np.bincount(part[pairs].ravel(), minlength=parts) / 2
    )  # an element at both of its ends: half the work each
    one, other = np.concatenate([pairs[crossing], pairs[crossing][:, ::-1]]).T
    wanted = np.unique(
        part[one].astype(np.int64) * (N * N) + other
    )  # part, and particle that it holds as halo
    halo = np.bincount(wanted // (N * N), minlength=parts)
    messages = np.bincount(
        np.unique(part[one].astype(np.int64) * parts + part[other]) // parts, minlength=parts
    )
    return {
        "elements": len(pairs),
        "parts": parts,
        "work": held.max(),
        "mean": held.mean(),
        "halo": halo.max(),
        "messages": messages.max(),
    }


def step_time(
    work: float, halo: float, messages: float, message: float, bandwidth: float
) -> tuple[float, float, float]:
    """Seconds of a step for its work, its messages and its bytes (24 for a particle)."""
    element = arguments.element_in_cache if work < arguments.cache_elements else arguments.element_in_memory
    return work * element + arguments.step, messages * message, 24 * halo / bandwidth


if comm.size != 2:
    raise SystemExit("model.py: run it on two ranks; it measures the exchange between them")
small, large = seconds_of_exchange(1), seconds_of_exchange(10_000)
if comm.rank == 0:
    message, bandwidth = small, 10_000 * 24 / (large - small)
    print(
        f"exchange between two ranks here: {1e6 * message:.2f} us, {bandwidth / 1e9:.1f} GB/s each way "
        "(NETFALL_RANKS_PER_NODE=1: by a message)"
    )
    print(
        f"element and step: {1e9 * arguments.element_in_cache:.2f} ns in the cache, "
        f"{1e9 * arguments.element_in_memory:.2f} ns beyond"
    )
    rows = [cut(elements, parts) for elements in arguments.elements for parts in arguments.parts]
    roots = [row["halo"] / np.sqrt(row["elements"] / 2 / row["parts"]) for row in rows]
    imbalance = [row["work"] / row["mean"] for row in rows]
    print(
        f"boundary: {np.mean(roots):.2f} (from {min(roots):.2f} to {max(roots):.2f}) times the root of a "
        f"subdomain's particles; fullest subdomain {max(imbalance):.3f} of the mean"
    )
    for elements in arguments.further:
        for parts in arguments.parts:
            rows.append(
                {
                    "elements": elements,
                    "parts": parts,
                    "work": elements / parts * max(imbalance),
                    "mean": elements / parts,
                    "halo": max(roots) * np.sqrt(elements / 2 / parts),
                    "messages": max(row["messages"] for row in rows),
                    "fit": True,
                }
            )
    print(
        "| elements | ranks | elements of a rank | halo particles | messages | step [us], network "
        "| work, messages, bytes [%] | speed-up | efficiency | step [us], within a node | efficiency |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for row in rows:
        alone = sum(step_time(row["elements"], 0, 0, 0, 1))
        parts_of_it = step_time(
            row["work"], row["halo"], row["messages"], arguments.network_message, arguments.network_bandwidth
        )
        inside = sum(step_time(row["work"], row["halo"], row["messages"], message, bandwidth))
        total = sum(parts_of_it)
        shares = " / ".join(f"{100 * t / total:.0f}" for t in parts_of_it)
        fit = " (fit)" if row.get("fit") else ""
        print(
            f"| {row['elements']:.3g}{fit} | {row['parts']} | {row['work']:.0f} | {row['halo']:.0f} "
            f"| {row['messages']} | {1e6 * total:.1f} | {shares} | {alone / total:.0f} "
            f"| {alone / total / row['parts']:.2f} | {1e6 * inside:.1f} "
            f"| {alone / inside / row['parts']:.2f} |"
        )
