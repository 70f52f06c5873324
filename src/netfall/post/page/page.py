"""Command `netfall view`: a result as one HTML page, drawn in 3D by k3d, which the page includes.

`page.js` gets its texts, choices, numbers, colours, scales and units from this module.
"""

import html
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from matplotlib.colors import to_hex

from netfall.core.messages import count_of
from netfall.geometry.net import connected_parts, part_contains
from netfall.post.checks.cables import element_resistances
from netfall.post.checks.codes import read_codes
from netfall.post.checks.nodes import held_axes
from netfall.post.page.states import ArrayBlock, DrawnPart, StateSeries, select_drawn, shown_series
from netfall.post.plots import canvas, force
from netfall.post.plots.collapse import view
from netfall.post.plots.utilisation import OVERUSED_COLOUR
from netfall.results.file import Frames, open_checked, result_title
from netfall.results.locks import whole
from netfall.results.removals import fracture_times, removal_times
from netfall.results.states import start_name, start_position

MAX_DRAWN_DISPLACEMENT = 4.0  # displacement / largest extent of the net; points beyond this are not drawn
MAX_EVENT_MARKS = 400  # fractures and removals marked on the time bar
MOST_LOOKS = 25  # snapshots from which the view is computed
FAR = 100.0  # distance from zero / extent of the net, from which coordinates count from a nearer point
SHADES = 64  # colours of a scale
MAX_SAMPLES = 2_000_000  # values from which the ends of a scale are computed
Ends = tuple[float, float] | None  # of a scale


@dataclass(frozen=True)
class Page:
    """Page before it is written.

    data : content for `page.js` without the numbers; drawn : drawn part of the net; words : description of
        the content
    """

    data: dict[str, Any]
    numbers: ArrayBlock
    drawn: DrawnPart
    words: str


def build_page(f: h5py.File) -> Page:
    """Assemble the page of an open result file."""
    drawn = select_drawn(f)
    shown, left_out = shown_series(f, drawn)
    x, numbers, time = start_position(f), ArrayBlock(), shown[0].time
    frames = f"{len(time)} frames, " if len(time) else ""
    static_count = sum(not len(states.time) for states in shown)
    omissions = f"; of this result {', '.join(left_out)}" if left_out else ""
    description = f"{count_of(len(drawn.rows), 'element')}, {frames}equilibria: {static_count}{omissions}"
    bar, forces = f["net/bar"][:].astype(bool)[drawn.rows], []
    for N in (states.tension for states in shown):
        negligible = np.abs(N) < force.NEGLIGIBLE_COMPRESSION * np.nanmax(np.abs(N), initial=0.0)
        forces.append(np.where(bar & negligible, 0.0, N))
    events = np.unique(np.concatenate([fracture_times(f), removal_times(f)]))
    events = events[np.isfinite(events)]
    window, held = np.array([x.min(0), x.max(0)]), held_axes(f)
    if len(time):
        motion, supports = Frames(f), np.flatnonzero(held.any(1))
        looks = np.unique(np.linspace(0, len(motion.times) - 1, MOST_LOOKS).astype(int))
        hanging = [motion.lines(step)[select_hanging(motion, step, supports)] for step in looks]
        window = view(motion.lines(0), hanging)
    data = net_data(numbers, drawn, f["net/element_id"][:]) | {
        "title": result_title(f),
        "net": f"{len(x)} nodes, {count_of(len(f['net/elements']), 'element')}",
        "left_out": left_out,
        "from": start_name(f),
        "window": round_box(window).tolist(),
        "group": numbers.add(f["net/group"][:].astype(np.int16)[drawn.rows]),
        "groups": f["net/group_names"].asstr()[:].tolist(),
        "strokes": events[:: 1 + len(events) // MAX_EVENT_MARKS].tolist(),
        "quantities": _quantities(f, numbers, drawn, shown, forces),
    }
    extent = np.ptp(x, axis=0).max()
    data["states"] = [states_data(numbers, states, N, extent) for states, N in zip(shown, forces)]
    return Page(data, numbers, drawn, description)


def net_data(numbers: ArrayBlock, drawn: DrawnPart, ids: np.ndarray) -> dict[str, Any]:
    """Return the content of the page on a net: colours, and ids (m,) of the elements, long ones as text."""
    shown_ids, shades = ids[drawn.rows], np.linspace(0.0, 1.0, SHADES)
    small = np.abs(shown_ids).max(initial=0) < 2**31
    colours = {"slack": force.SLACK, "broken": canvas.BROKEN, "none": canvas.NO_VALUE_COLOUR}
    colours |= {"over": OVERUSED_COLOUR, "support": canvas.SUPPORT_COLOUR, "guided": canvas.GUIDED}
    scales = {"tension": force.TENSION, "compression": force.COMPRESSION}
    return {
        "colours": {name: [to_hex(c) for c in scale(shades)] for name, scale in scales.items()} | colours,
        "element": numbers.add(shown_ids.astype(np.int32)) if small else list(map(str, shown_ids)),
    }


def select_hanging(frames: Frames, step: int, held: np.ndarray) -> np.ndarray:
    """Select the elements (m,) that unbroken elements connect to a support; all without such elements.

    held : rows of the supports
    """
    ends, whole = frames.ends(step), frames.there & ~frames.broken(step)
    points = np.arange(int(ends.max()) + 1)
    part = connected_parts(ends[whole], len(points))
    hangs = whole & part_contains(part, np.isin(points, held))[ends[:, 0]]
    return hangs if hangs.any() else np.ones(len(ends), bool)


def round_box(window: np.ndarray) -> np.ndarray:
    """Enlarge a box (2, 3) [m] to round numbers of k3d's grid.

    The grid has lines at every tenth of the next power of ten, and at every fifth of this spacing along sides
    shorter than two spacings.
    """
    size = np.ptp(window, axis=0)
    tenth = 10.0 ** np.ceil(np.log10(size.max())) / 10.0
    step = np.where(size > 2.0 * tenth, tenth, tenth / 5.0)
    return np.array([np.floor(window[0] / step) * step, np.ceil(window[1] / step) * step])


def far_origin(window: np.ndarray) -> np.ndarray:
    """Return the round point (3,) [m] from which the page counts coordinates, to hold them in float32.

    It is zero along axes on which the window (2, 3) [m] is near zero.
    """
    step = 10.0 ** np.ceil(np.log10(np.ptp(window, axis=0).max()))
    middle = np.round(window.mean(0) / step) * step
    return np.where(np.abs(middle) > FAR * step, middle, 0.0)


def quantity_data(
    name: str, unit: str, factor: float, tension: Ends, compression: Ends = None, **more: str | dict[str, Any]
) -> dict[str, Any]:
    """Return a quantity that the page shows by colour.

    Values in `unit` are those of the file times `factor`.
    tension, compression : ends of the two scales in the file's unit, None: there is none
    more : at_rest, name of the quantity in static states; per, divisor (m,) of forces; values, (m,) of the
        elements in all states. Both are references to the block of numbers. over, the remark if values
        above the scale have a colour of their own
    """
    ends = {"tension": tension, "compression": compression}
    fields = {"name": name, "at_rest": name, "unit": unit, "factor": factor, "per": None, "values": None}
    fields |= {"over": ""}
    return fields | ends | more | {"of_file": name == "strain"}


def _quantities(
    f: h5py.File, numbers: ArrayBlock, drawn: DrawnPart, shown: list[StateSeries], forces: list[np.ndarray]
) -> list[dict[str, Any]]:
    """Return the quantities to choose from: force, utilisation if strengths are given, strain."""
    check = read_codes()[0]
    resistance = element_resistances(f, [check])[0][drawn.rows]
    EA = f["net/axial_stiffness"][:][drawn.rows]
    strains = [
        N / EA if states.strain is None else np.where(np.isnan(N), N, states.strain)
        for states, N in zip(shown, forces)
    ]
    in_motion = [len(states.time) > 0 for states in shown]
    ends = _ends(forces, in_motion)
    factor, unit = canvas.unit_of(max((end[1] for end in ends if end), default=0.0), "N")
    choices = [quantity_data("axial force", unit, factor, *ends)]
    if np.isfinite(resistance).any():
        name = f"utilisation by the tension in the middle, {check.title.split(':')[0]}"
        stored = numbers.add(resistance.astype(np.float32))
        choices.append(quantity_data(name, "-", 1.0, (0.0, 1.0), per=stored, over="magenta: above 1"))
    per = numbers.add(EA.astype(np.float32))
    choices.append(
        quantity_data("strain", "%", 100.0, *_ends(strains, in_motion), at_rest="elastic strain", per=per)
    )
    return choices


def _ends(values: list[np.ndarray], in_motion: list[bool]) -> tuple[Ends, Ends]:
    """Return the ends of the scales of positive and negative values, the same in all states.

    in_motion : whether each array is of a motion, whose scale ends at percentiles

    They are the widest limits of any state, so that many snapshots of a quiet motion do not hide a single
    state with an overload.
    """
    stride = 1 + sum(array.size for array in values) // MAX_SAMPLES
    taut, pressed = (
        [
            force.limits(sizes[sizes > 0.0], force.OF_MOTION if moves else force.OF_EQUILIBRIA)
            for array, moves in zip(values, in_motion)
            for sizes in [sign * array.ravel()[:: stride if moves else 1]]
        ]
        for sign in (1.0, -1.0)
    )
    return force.widest(taut), force.widest(pressed)


def states_data(numbers: ArrayBlock, states: StateSeries, N: np.ndarray, extent: float) -> dict[str, Any]:
    """Convert states for the page.

    N : (k, m) [N] axial forces that are shown; extent : of the net [m]
    """

    def largest(values: np.ndarray) -> np.ndarray:
        return np.fmax.reduce(np.abs(values), initial=0.0)

    reach = min(largest(states.displacement).max(), MAX_DRAWN_DISPLACEMENT * extent)
    page = {
        "name": states.name,
        "time": states.time.tolist(),
        "displacement": numbers.add_series(states.displacement, reach),
        "tension": numbers.add_series(N, largest(N), nonzero=True),
        "slack": states.slack.tolist(),
        "broken": states.broken.tolist(),
        "supports": numbers.add(states.supports.astype(np.int32)),
        "guided": numbers.add(states.guided.astype(np.int32)),
    }
    if states.away.any():
        page["away"] = numbers.add(states.away.astype(np.int16))
    if states.hanging is not None and states.hanging.any():
        page["hanging"] = numbers.add_series(states.hanging.astype(float), 1.0)
    if states.strain is not None:
        eps = np.where(np.isnan(N), np.nan, states.strain)
        page["strain"] = numbers.add_series(eps, largest(eps))
    return page


VIEW_FOLDER = Path(__file__).parent


def write_page(result: Path, path: Path) -> str:
    """Write the page of a result, and return its description. Raises InputError for a wrong file."""
    with open_checked(result) as f:
        page = build_page(f)
    return put(path, page)


def put(path: Path, page: Page) -> str:
    """Write a page, and return its description."""
    import k3d

    window, drawn = np.array(page.data["window"]), page.drawn
    origin = far_origin(window)
    data = page.data | {"window": (window - origin).tolist()}
    x, y, z = (f"{axis} {-o:+.12g}" if o else axis for axis, o in zip("xyz", origin))
    plot = k3d.plot(
        menu_visibility=False,
        camera_auto_fit=False,
        grid_auto_fit=False,
        grid=[*data["window"][0], *data["window"][1]],
        axes=[f"{x} [m]", f"{y} [m]", rf"{z} [m]\phantom{{mmmmm}}"],  # the space separates z from the numbers
        camera_fov=30.0,
        camera_up_axis="z",
        grid_color=0xF0F0F0,
        name="netfall",
    )
    times = data["states"][0]["time"]
    plot += k3d.lines(
        (drawn.start - origin).astype(np.float32),
        drawn.ends.astype(np.uint32),
        indices_type="segment",
        color=int(data["colours"]["none"][1:], 16),
        opacity=dict.fromkeys(times, 1.0) if times else 1.0,
        shader="simple",
        name="form",
    )
    text = plot.get_snapshot(additional_js_code="begin(netfallPage(K3DInstance));")
    data_text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    parts = {"title": html.escape(data["title"]), "data": data_text, "numbers": page.numbers.text()}
    parts["code"] = (VIEW_FOLDER / "page.js").read_text(encoding="utf-8")
    body = (VIEW_FOLDER / "page.html").read_text(encoding="utf-8")
    body = re.sub(r"\[\[(\w+)\]\]", lambda name: parts[name[1]], body)
    text = re.sub(r"<title>.*?</title>", lambda _: f"<title>{parts['title']}</title>", text, count=1)
    text = text.replace("<body>", f"<body>\n{body}", 1)
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return f"{path.stat().st_size / 1e6:.2g} MB, {page.words}"
