"""Content of the page of a result for `page.js`: texts, choices and numbers."""

from dataclasses import dataclass

import numpy as np

from netfall.post.checks.reactions import held_axes
from netfall.post.page.numbers import ArrayBlock
from netfall.post.page.quantities import Quantity, palette, quantities, without_negligible
from netfall.post.page.states import DrawnPart, StateSeries, select_drawn, shown_series
from netfall.post.plots.collapse import view
from netfall.post.plots.force import has_spring
from netfall.results.file import result_title
from netfall.results.frames import Frames
from netfall.results.losses import broken_at, lost_at
from netfall.results.states import start_name, start_position

FARTHEST = 4.0  # displacement / largest extent of the net; points beyond are not drawn
MAX_EVENT_MARKS = 400  # fractures and removals marked on the time bar
MOST_LOOKS = 25  # snapshots from which the view is computed


@dataclass(frozen=True)
class Page:
    """Page before it is written.

    data : content for `page.js` without the numbers; drawn : drawn part of the net; words : description of
        the content
    """

    data: dict
    numbers: ArrayBlock
    drawn: DrawnPart
    words: str


def build_page(f) -> Page:
    """Assemble the page of an open result file."""
    drawn = select_drawn(f)
    shown, left_out = shown_series(f, drawn)
    x, numbers = start_position(f), ArrayBlock()
    frames = f"{len(shown[0].time)} frames, " if len(shown[0].time) else ""
    static_count = sum(not len(states.time) for states in shown)
    omissions = f"; of this result {', '.join(left_out)}" if left_out else ""
    description = f"{len(drawn.rows)} elements, {frames}{static_count} states at rest{omissions}"
    net = net_data(numbers, drawn, result_title(f), f["net/element_id"][:], x, held_axes(f), has_spring(f))
    data = net | {
        "net": f"{len(x)} nodes, {len(f['net/elements'])} elements",
        "left_out": left_out,
        "from": start_name(f),
        "window": round_box(_window(f, shown, x)).tolist(),
        "group": numbers.add(f["net/group"][:].astype(np.int16)[drawn.rows]),
        "groups": f["net/group_names"].asstr()[:].tolist(),
        "strokes": _event_times(f),
        "quantities": [choice(numbers, quantity) for quantity in quantities(f, drawn, shown)],
        "states": [
            states_data(
                numbers, states, without_negligible(f, drawn, states.tension), np.ptp(x, axis=0).max()
            )
            for states in shown
        ],
    }
    return Page(data, numbers, drawn, description)


def net_data(numbers: ArrayBlock, drawn: DrawnPart, title: str, ids, x: np.ndarray, held, sprung) -> dict:
    """Return the content of the page on a net.

    ids : (m,) of all elements; x : (n, 3) [m]; held : (n, 3) bool, axes; sprung : (n,) bool, on springs
    """
    fully_held = held.all(1) & ~sprung
    return {
        "title": title,
        "colours": palette(),
        "element": _ids(numbers, ids[drawn.rows]),
        "supports": numbers.add(x[fully_held].astype(np.float32)),
        "guided": numbers.add(x[held.any(1) & ~fully_held].astype(np.float32)),
    }


def _window(f, shown: list[StateSeries], x: np.ndarray) -> np.ndarray:
    """Compute the box (2, 3) [m] of the view."""
    if not len(shown[0].time):
        return np.array([x.min(0), x.max(0)])
    frames = Frames(f)
    return view(frames, np.unique(np.linspace(0, len(frames.times) - 1, MOST_LOOKS).astype(int)).tolist())


def round_box(window: np.ndarray) -> np.ndarray:
    """Enlarge a box (2, 3) [m] to round numbers of k3d's grid.

    The grid has them at every tenth of the next power of ten, and at every fifth of that along sides
    shorter than two of them.
    """
    size = np.ptp(window, axis=0)
    tenth = 10.0 ** np.ceil(np.log10(size.max())) / 10.0
    step = np.where(size > 2.0 * tenth, tenth, tenth / 5.0)
    return np.array([np.floor(window[0] / step) * step, np.ceil(window[1] / step) * step])


def _ids(numbers: ArrayBlock, ids: np.ndarray) -> dict | list[str]:
    """Return the ids of elements, as text if they exceed 32 bits."""
    small = np.abs(ids).max(initial=0) < 2**31
    return numbers.add(ids.astype(np.int32)) if small else [str(number) for number in ids]


def _event_times(f) -> list[float]:
    """Return the times [s] of fractures and removals."""
    times = np.unique(np.concatenate([broken_at(f), lost_at(f)]))
    times = times[np.isfinite(times)]
    return times[:: 1 + len(times) // MAX_EVENT_MARKS].tolist()


def choice(numbers: ArrayBlock, quantity: Quantity) -> dict:
    """Convert a quantity for the page."""
    fields = {name: getattr(quantity, name) for name in Quantity.__dataclass_fields__}
    for name in ("per", "values"):
        if fields[name] is not None:
            fields[name] = numbers.add(fields[name].astype(np.float32))
    return fields | {"of_file": quantity.name == "strain"}


def _largest(values: np.ndarray) -> float:
    """Return the largest magnitude, 0 if there is none."""
    return float(np.nanmax(np.abs(values), initial=0.0))


def states_data(numbers: ArrayBlock, states: StateSeries, N: np.ndarray, extent: float) -> dict:
    """Convert states for the page.

    N : (k, m) [N] axial forces that are shown; extent : of the net [m]
    """
    reach = min(_largest(states.displacement), FARTHEST * extent)
    page = {
        "name": states.name,
        "time": states.time.tolist(),
        "displacement": numbers.add_series(states.displacement, reach),
        "tension": numbers.add_series(N, _largest(N), nonzero=True),
        "slack": states.slack.tolist(),
        "broken": states.broken.tolist(),
    }
    if states.away.any():
        page["away"] = numbers.add(states.away.astype(np.int16))
    if states.strain is not None:
        eps = np.where(np.isnan(N), np.nan, states.strain)
        page["strain"] = numbers.add_series(eps, _largest(eps))
    return page
