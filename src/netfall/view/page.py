"""`netfall view`: a result as one HTML page that turns and plays, drawn by k3d, which is within the page."""

import html
import json
import re
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from netfall.checks.reactions import held_axes
from netfall.ground.errors import InputError
from netfall.plots.collapse import view
from netfall.results.file import reading, title_of
from netfall.results.frames import Frames
from netfall.results.losses import broken_at, lost_at
from netfall.results.states import start_position
from netfall.view.numbers import Numbers
from netfall.view.quantities import Quantity, palette, quantities, without_traces
from netfall.view.states import Drawn, States, drawn_part, states_shown

HERE = Path(__file__).parent
FARTHEST = 4.0  # largest extents of the net, beyond which what moves is not drawn
MOST_STROKES = 400  # fractures and losses on the bar of the time
MOST_LOOKS = 25  # frames from which the room is found
GET_K3D = "netfall view: needs k3d, which is not installed; get it with: pip install 'netfall[view]'"


def write_page(result: Path, path: Path) -> str:
    """Write the page of a result; a line that says what it is. Raises InputError for a wrong file."""
    need_k3d()
    with reading(result) as f:
        page, numbers, drawn, words = describe(f)
    return put(path, page, numbers, drawn) + words


def need_k3d() -> None:
    """Raises InputError where k3d is not installed."""
    if find_spec("k3d") is None:
        raise InputError(GET_K3D)


def describe(f) -> tuple[dict, Numbers, Drawn, str]:
    """What the page is, but for its numbers; these; and what it shows, in words."""
    drawn = drawn_part(f)
    shown, left_out = states_shown(f, drawn)
    numbers, x = Numbers(), start_position(f)
    window = _window(f, shown, x)
    page = {
        "title": title_of(f),
        "net": f"{len(x)} nodes, {len(f['net/elements'])} elements",
        "left_out": left_out,
        "window": window.tolist(),
        "colours": palette(),
        "element": _ids(numbers, f["net/element_id"][:][drawn.rows]),
        "bar": numbers.add(f["net/bar"][:].astype(np.int16)[drawn.rows]),
        "group": numbers.add(f["net/group"][:].astype(np.int16)[drawn.rows]),
        "groups": f["net/group_names"].asstr()[:].tolist(),
        "supports": numbers.add(x[held_axes(f).any(1)].astype(np.float32)),
        "strokes": _strokes(f),
        "quantities": [_choice(numbers, each) for each in quantities(f, drawn, shown)],
        "states": [_states(numbers, f, drawn, states, np.ptp(x, axis=0).max()) for states in shown],
    }
    frames = f"{len(shown[0].time)} frames, " if len(shown[0].time) else ""
    rest = sum(not len(states.time) for states in shown)
    thinned = f"; of this result {', '.join(left_out)}" if left_out else ""
    return page, numbers, drawn, f"{len(drawn.rows)} elements, {frames}{rest} states at rest{thinned}"


def _window(f, shown: list[States], x: np.ndarray) -> np.ndarray:
    """The room (2, 3) [m] that is looked at."""
    if not len(shown[0].time):
        return np.array([x.min(0), x.max(0)])
    frames = Frames(f)
    return view(frames, np.unique(np.linspace(0, len(frames.times) - 1, MOST_LOOKS).astype(int)).tolist())


def _ids(numbers: Numbers, ids: np.ndarray) -> dict | list[str]:
    """Ids of elements, as text where they are large."""
    small = np.abs(ids).max(initial=0) < 2**31
    return numbers.add(ids.astype(np.int32)) if small else [str(each) for each in ids]


def _strokes(f) -> list[float]:
    """Times [s] of fractures and losses."""
    times = np.unique(np.concatenate([broken_at(f), lost_at(f)]))
    times = times[np.isfinite(times)]
    return times[:: 1 + len(times) // MOST_STROKES].tolist()


def _choice(numbers: Numbers, quantity: Quantity) -> dict:
    """A quantity, for the page."""
    plain = {name: getattr(quantity, name) for name in Quantity.__dataclass_fields__ if name != "per"}
    per = None if quantity.per is None else numbers.add(quantity.per.astype(np.float32))
    return plain | {"per": per, "of_file": quantity.name == "strain"}


def _states(numbers: Numbers, f, drawn: Drawn, states: States, extent: float) -> dict:
    """States, for the page."""
    N = without_traces(f, drawn, states.tension)
    largest = lambda values: float(np.nanmax(np.abs(values), initial=0.0))
    reach = min(largest(states.displacement), FARTHEST * extent)
    page = {
        "name": states.name,
        "time": states.time.tolist(),
        "displacement": numbers.add_in_time(states.displacement, reach),
        "tension": numbers.add_in_time(N, largest(N), nonzero=True),
        "slack": states.slack.tolist(),
        "broken": states.broken.tolist(),
    }
    if states.strain is not None:
        eps = np.where(np.isnan(N), np.nan, states.strain)
        page["strain"] = numbers.add_in_time(eps, largest(eps))
    return page


def put(path: Path, page: dict, numbers: Numbers, drawn: Drawn) -> str:
    """Write a page; its size in words."""
    import k3d

    from netfall.write.locks import whole

    plot = k3d.plot(
        menu_visibility=False,
        camera_auto_fit=False,
        grid_auto_fit=False,
        grid=[*page["window"][0], *page["window"][1]],
        axes=["x [m]", "y [m]", "z [m]"],
        camera_fov=30.0,
        camera_up_axis="z",
        grid_color=0xF0F0F0,
        name="netfall",
    )
    times = page["states"][0]["time"]
    plot += k3d.lines(
        drawn.start.astype(np.float32),
        drawn.ends.astype(np.uint32),
        indices_type="segment",
        color=int(page["colours"]["none"][1:], 16),
        opacity=dict.fromkeys(times, 1.0) if times else 1.0,
        shader="simple",
        name="form",
    )
    text = plot.get_snapshot(additional_js_code="begin(netfallPage(K3DInstance));")
    data = json.dumps(page, allow_nan=False).replace("<", "\\u003c")
    parts = {"title": html.escape(page["title"]), "data": data, "numbers": numbers.text()}
    parts["code"] = (HERE / "page.js").read_text()
    ours = (HERE / "page.html").read_text()
    ours = re.sub(r"\[\[(\w+)\]\]", lambda name: parts[name[1]], ours)
    text = re.sub(r"<title>.*?</title>", lambda _: f"<title>{parts['title']}</title>", text, count=1)
    text = text.replace("<body>", f"<body>\n{ours}", 1)
    with whole(path) as place:
        place.write_text(text, encoding="utf-8")
    return f"{path.stat().st_size / 1e6:.2g} MB, "
