"""The sketches of the pages."""

import xml.etree.ElementTree as ET

import pytest

from netfall.docs.sketches import FIGURES, SKETCHES


@pytest.mark.parametrize("name", SKETCHES)
def test_sketches_are_current(name):
    """The file of a sketch is what the program draws, and is well-formed."""
    text = SKETCHES[name]().svg()
    assert (FIGURES / f"{name}.svg").read_text(encoding="utf-8") == text, "python -m netfall.docs.sketches"
    ET.fromstring(text)


def test_every_figure_is_shown():
    """Each figure stands in a page."""
    pages = "".join(page.read_text(encoding="utf-8") for page in FIGURES.parent.rglob("*.md"))
    assert [path.name for path in FIGURES.iterdir() if f"figures/{path.name}" not in pages] == []
