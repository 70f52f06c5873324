"""What the pictures share: matplotlib without a display, titles, units, legends."""

import h5py
import matplotlib

from netfall.output.info import title_of

matplotlib.use("Agg")
LONGEST_TITLE = 90  # characters


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


def mark_first_fracture(axes, f) -> None:
    """A line at the first fracture, if there is one."""
    events = f["events/time"][:]
    if len(events):
        axes.axvline(events[0], color="0.5", lw=0.8, ls=":")
        axes.annotate(
            f"first fracture {events[0]:.3f} s",
            (events[0], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 3),
            textcoords="offset points",
            fontsize=7,
            color="0.4",
        )


def legend_below(axes, ncols=4) -> None:
    """A legend below the axes."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=ncols, frameon=False, fontsize=8)
