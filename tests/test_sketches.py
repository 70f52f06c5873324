"""The sketches of the pages."""

import xml.etree.ElementTree as ET

import pytest

from netfall.docs.site import PAGES

FIGURES = sorted((PAGES / "figures").iterdir())


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.stem)
def test_a_sketch_is_well_formed_and_stands_in_a_page(figure):
    """An SVG file with a title, which browsers read out."""
    assert ET.parse(figure).getroot().find("{http://www.w3.org/2000/svg}title").text
    assert any(f"figures/{figure.name}" in page.read_text(encoding="utf-8") for page in PAGES.rglob("*.md"))
