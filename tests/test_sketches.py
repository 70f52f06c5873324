"""The sketches and pictures of the pages."""

import xml.etree.ElementTree as ET

import pytest
from documentation_site import PAGES

FIGURES = sorted((PAGES / "figures").iterdir())


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.stem)
def test_each_figure_is_in_a_page(figure):
    assert any(f"figures/{figure.name}" in page.read_text(encoding="utf-8") for page in PAGES.rglob("*.md"))


@pytest.mark.parametrize(
    "sketch", [figure for figure in FIGURES if figure.suffix == ".svg"], ids=lambda figure: figure.stem
)
def test_a_sketch_is_well_formed(sketch):
    """An SVG file with a title, which browsers read out."""
    assert ET.parse(sketch).getroot().find("{http://www.w3.org/2000/svg}title").text
