"""The paper's two collapses over 40 wind histories: `python jobs/measured/paper.py [-n 40]`.

The paper gives one wind history for each roof, and neither the sections of the saddle nor the roughness, the
pressure coefficient and the damping. So times can be compared only as one figure beside a distribution.
Writes results/measured/paper.csv and prints medians and ranges. Takes some five minutes on one core.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import netfall

JOBS = Path(__file__).parents[1]
PAPER = {  # [s]: first fracture, and separation, as the paper's text and figures give them
    "saddle_paper": (3.50, 4.43),
    "stadium_paper": (3.00, 4.16),
}
SEPARATED = 0.1  # share of the nodes that counts as the separation of a part


def separation(result: netfall.Result) -> float:
    """Return the time [s] at which so many nodes have lost their connection to the supports; nan: never."""
    events, nodes = result.events, result.nodes
    ends = np.array(result.file["net/elements"][:])
    held = nodes["fixed"].any(axis=1)
    count = max(len(held), int(events["new_particle"].max()) + 1)
    for time, row, old, new in zip(*(events[k] for k in ("time", "element_row", "particle", "new_particle"))):
        ends[row][ends[row] == old] = new
        links = coo_array((np.ones(len(ends)), ends.T), shape=(count, count))
        label = connected_components(links, directed=False)[1][: len(held)]
        if np.mean(~np.isin(label, label[held])) >= SEPARATED:
            return float(time)
    return np.nan


def main() -> None:
    """Run both roofs with wind histories 1 to n, write the table, and print medians and ranges."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=40, help="wind histories of each roof")
    parser.add_argument("-o", dest="folder", type=Path, default=Path("results/measured"))
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in PAPER:
        for seed in range(1, wanted.n + 1):
            with netfall.run(JOBS / f"{name}.toml", {"wind.seed": seed, "output.frames": 2}) as result:
                broken = "events" in result.file and len(result.events["time"])
                first = float(result.events["time"][0]) if broken else np.nan
                apart = separation(result) if broken else np.nan
            rows.append((name, seed, first, apart - first, int(broken)))
    with open(wanted.folder / "paper.csv", "w", newline="") as f:
        csv.writer(f).writerows([("job", "seed", "first_fracture_s", "to_separation_s", "broken"), *rows])
    for name, (first, apart) in PAPER.items():
        values = np.array([row[2:] for row in rows if row[0] == name])
        for what, k, paper in (("first fracture [s]", 0, first), ("to separation [s]", 1, apart - first)):
            sound = values[np.isfinite(values[:, k]), k]
            print(f"{name}, {what}: paper {paper:.2f}, netfall median {np.median(sound):.2f}", end=" ")
            print(f"({sound.min():.2f} to {sound.max():.2f}, {len(sound)} of {len(values)} histories)")
        print(
            f"{name}, broken elements: median {np.median(values[:, 2]):.0f}, {values[:, 2].min():.0f} to",
            end=" ",
        )
        print(f"{values[:, 2].max():.0f}")


if __name__ == "__main__":
    main()
