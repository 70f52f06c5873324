"""report.html: the page of a report with its pictures in one file, for a browser and a word processor."""

import html
import re
from base64 import b64encode
from pathlib import Path

from markdown_it import MarkdownIt

from netfall.ground.progress import one_line

CELL = re.compile(r"<t[dh]\b.*?</t[dh]>")  # names in it may go on in the next line after a _
WIDE = 660  # pixels of a picture: a word processor goes by it, a browser fits it to the window
PAGE = Path(__file__).with_name("page.html")


def one_page(text: str, title: str, folder: Path, pictures: list[str]) -> str:
    """Return the page of a text in Markdown, which may show these pictures of a folder, and no other file."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(text)
    for token in tokens:
        if token.type == "table_open":  # a word processor has no lines and no width by the style
            token.attrs |= {"border": 1, "cellspacing": 0, "cellpadding": 3, "width": "100%"}
        for image in (child for child in token.children or () if child.type == "image"):
            if image.attrs["src"] not in pictures:
                image.type = "text"
                continue
            data = b64encode((folder / image.attrs["src"]).read_bytes()).decode()
            image.attrs |= {"src": f"data:image/png;base64,{data}", "width": WIDE}
    body = reader.renderer.render(tokens, reader.options, {})
    body = CELL.sub(lambda cell: cell[0].replace("_", "_\u200b"), body)
    parts = {"title": html.escape(one_line(title)), "body": body}
    return re.sub(r"\[\[(\w+)\]\]", lambda name: parts[name[1]], PAGE.read_text(encoding="utf-8"))
