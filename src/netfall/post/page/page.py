"""Command `netfall view`: a result as one HTML page, drawn in 3D by k3d, which the page includes."""

import html
import json
import re
from pathlib import Path

import numpy as np

from netfall.post.page.describe import Page, build_page
from netfall.results.file import open_checked
from netfall.results.locks import whole

VIEW_FOLDER = Path(__file__).parent


def write_page(result: Path, path: Path) -> str:
    """Write the page of a result, and return its description. Raises InputError for a wrong file."""
    with open_checked(result) as f:
        page = build_page(f)
    return put(path, page)


def put(path: Path, page: Page) -> str:
    """Write a page, and return its description."""
    import k3d

    data, drawn = page.data, page.drawn
    plot = k3d.plot(
        menu_visibility=False,
        camera_auto_fit=False,
        grid_auto_fit=False,
        grid=[*data["window"][0], *data["window"][1]],
        axes=["x [m]", "y [m]", r"z [m]\phantom{mmmmm}"],  # the space keeps z clear of the numbers
        camera_fov=30.0,
        camera_up_axis="z",
        grid_color=0xF0F0F0,
        name="netfall",
    )
    times = data["states"][0]["time"]
    plot += k3d.lines(
        drawn.start.astype(np.float32),
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
