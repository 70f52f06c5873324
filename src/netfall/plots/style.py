"""What the pictures share: matplotlib without a display, titles, units, legends."""

import h5py
import matplotlib
import numpy as np

from netfall.results.file import title_of
from netfall.results.losses import lost_at

matplotlib.use("Agg")
LONGEST_TITLE = 90  # characters
ROOM = 0.14  # of the width, from one time that is told to the next


def short_title(f: h5py.File) -> str:
    """The title, cut to what fits above a picture."""
    title = " ".join(title_of(f).split())
    return title if len(title) <= LONGEST_TITLE else title[: LONGEST_TITLE - 3] + "..."


def unit_of(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of a unit that keeps numbers readable: N, kN, MN."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if largest >= 2 * factor:
            return 1 / factor, prefix + unit
    return 1.0, unit


def mark_events(axes, f) -> None:
    """A line at each loss of members and at the first fracture, with its time where there is room."""
    lost = lost_at(f)
    marks = [(t, f"first fracture {t:.3f} s", ":") for t in f["events/time"][:1]]
    marks += [(t, f"loss {t:.3f} s", "--") for t in np.unique(lost[~np.isnan(lost)])]
    low, high = axes.get_xlim()
    told: list[float] = []
    for t, words, style in marks:
        axes.axvline(t, color="0.5", lw=0.8, ls=style)
        if all(abs(t - other) > ROOM * (high - low) for other in told):
            told.append(t)
            axes.annotate(
                words,
                (t, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, 3),
                textcoords="offset points",
                fontsize=7,
                color="0.4",
            )


def legend_below(axes, ncols=4) -> None:
    """A legend below the axes."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=ncols, frameon=False, fontsize=8)
