"""report.html: the page of a report with its pictures in one file, for a browser and a word processor."""

import html
import re
from base64 import b64encode
from pathlib import Path

from markdown_it import MarkdownIt

from netfall.ground.progress import one_line

CELL = re.compile(r"<t[dh]\b.*?</t[dh]>")  # names in it may go on in the next line after a _
WIDE = 660  # pixels of a picture: a word processor goes by it, a browser fits it to the window
STYLE = """
body { font-family: Arial, Helvetica, sans-serif; font-size: 10pt; line-height: 1.35; color: #202020;
       max-width: 62em; margin: 2em auto; padding: 0 1em; }
h1, h2, h3 { font-family: Arial, Helvetica, sans-serif; }
h1 { font-size: 17pt; } h2 { font-size: 13pt; border-bottom: 1px solid #b0b0b0; margin-top: 1.8em; }
h3 { font-size: 10.5pt; margin-top: 1.4em; }
table { border-collapse: collapse; font-size: 8.5pt; }
th, td { border: 1px solid #b0b0b0; padding: 2px 6px; text-align: left; vertical-align: top; }
th { background: #ececec; }
/* of a word processor, which makes paragraphs of cells: without, each has a line of space below */
th p, td p { margin-top: 0cm; margin-bottom: 0cm; font-size: 7.5pt; line-height: 1.1; }
tr, img { page-break-inside: avoid; }
img { max-width: 100%; height: auto; }
@page { size: A4; margin: 18mm; }
"""
PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}</body>
</html>
"""


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
    return PAGE.format(title=html.escape(one_line(title)), style=STYLE, body=body)
