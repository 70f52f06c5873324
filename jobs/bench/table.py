"""The table of the benchmark from its lines of JSON, and this machine's bandwidth. python table.py LINES"""

import json
import sys
import time

import numba
import numpy as np


@numba.njit
def triad(a, b, c):
    """a = b + 3 c"""
    for i in range(a.shape[0]):
        a[i] = b[i] + 3.0 * c[i]


def bandwidth(megabytes: float) -> float:
    """GB/s of a triad over three arrays that fill so many megabytes."""
    arrays = np.ones((3, int(megabytes * 1e6 / 24)))
    triad(*arrays)
    repeats = max(3, int(300 / megabytes))
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(repeats):
            triad(*arrays)
        best = min(best, (time.perf_counter() - begin) / repeats)
    return arrays.nbytes / best / 1e9


rows = [json.loads(line) for line in open(sys.argv[1])]
print(
    "| net | program | ranks | scene | element-steps/s | of netfall elastic, 1 rank | exchange "
    "| set-up [s] | memory, all ranks [MB] | state [bytes/element] |"
)
print("|---|---|---|---|---|---|---|---|---|---|")
reference = {
    row["N"]: row
    for row in rows
    if row["program"] == "netfall" and row["ranks"] == 1 and row["scene"] == "elastic"
}
for row in rows:
    own = reference[row["N"]]
    share = f"{100 * row['exchange']:.0f} %" if row.get("exchange") is not None else ""
    state = f"{row['state_bytes']:.0f}" if "state_bytes" in row else ""
    print(
        f"| {row['N']} x {row['N']} | {row['program']} | {row['ranks']} | {row['scene']} "
        f"| {row['rate']:.3g} | {row['rate'] / own['rate']:.2f} | {share} "
        f"| {row['set_up']:.1f} | {row['peak_bytes'] / 1e6:.0f} | {state} |"
    )
for N, own in reference.items():
    worst = max(
        abs(row["displacement"] / own["displacement"] - 1)
        for row in rows
        if row["N"] == N and row["scene"] == "elastic"
    )
    print(
        f"{N} x {N}: displacement in the middle after 0.1 s {own['displacement']:.12e} m; "
        f"all programs agree to {worst:.1e}"
    )
print("triad: " + ", ".join(f"{bandwidth(size):.0f} GB/s in {size:g} MB" for size in (0.3, 12, 96, 960)))
