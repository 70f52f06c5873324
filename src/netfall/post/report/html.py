"""Page report.html: a report with its pictures in one file, for browsers and word processors."""

import html
import re
from base64 import b64encode
from pathlib import Path

from markdown_it import MarkdownIt

from netfall.core.progress import one_line

CELL = re.compile(r"<t[dh]\b.*?</t[dh]>")  # table cell; long names in it may break after a _
PICTURE_WIDTH = 660  # pixels; width of pictures in word processors, while browsers fit them to the window
PAGE = Path(__file__).with_name("page.html")


def one_page(text: str, title: str, folder: Path, pictures: list[str]) -> str:
    """Convert a Markdown text to HTML; only the named pictures of the folder are embedded, no other file."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(text)
    for token in tokens:
        if token.type == "table_open":  # word processors ignore the style sheet
            token.attrs |= {"border": 1, "cellspacing": 0, "cellpadding": 3, "width": "100%"}
        for image in (child for child in token.children or () if child.type == "image"):
            if image.attrs["src"] not in pictures:
                image.type = "text"
                continue
            data = b64encode((folder / image.attrs["src"]).read_bytes()).decode()
            image.attrs |= {"src": f"data:image/png;base64,{data}", "width": PICTURE_WIDTH}
    body = reader.renderer.render(tokens, reader.options, {})
    body = CELL.sub(lambda cell: cell[0].replace("_", "_\u200b"), body)
    parts = {"title": html.escape(one_line(title)), "body": body}
    return re.sub(r"\[\[(\w+)\]\]", lambda name: parts[name[1]], PAGE.read_text(encoding="utf-8"))
