"""Plain English: words that pages and docstrings (test_docstrings.py) do not use; the length of sentences."""

import re

import pytest
from conftest import ROOT

AVOIDED = re.compile(
    r"\b(told|tells|borne|anew|besides?|farther|lest|whoever|as yet|(of )?one's own|takes? up(?! to)|taken up"
    r"|comes? to rest|gives? way|runs? away|lends?|lent|borrows?|dear(er)?|begins? from"
    r"|(?<!or )(?<!anything )(?<!nothing )(?<!everything )else)\b",
    re.I,
)
DOCS = ROOT / "src" / "netfall" / "docs" / "pages"
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "jobs").rglob("*.md"), *DOCS.rglob("*.md")])
SHORT = [ROOT / "README.md", *sorted((DOCS / "how-to").glob("*.md"))]
MOST_WORDS = 30  # of a sentence
MARKS = r"```.*?```|<!--.*?-->|`[^`\n]*`|\]\([^)]*\)"  # code, comments, targets of links


def prose(page):
    """Return the text of a page without code, tables and headings."""
    text = re.sub(MARKS, "", page.read_text(encoding="utf-8"), flags=re.S)
    return "\n".join(line for line in text.splitlines() if not line.startswith(("|", "#", "    ")))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_use_plain_words(page):
    """The change log is excluded, because it quotes old names."""
    if page.name != "CHANGELOG.md":
        assert [match[0] for match in AVOIDED.finditer(prose(page))] == []


@pytest.mark.parametrize("page", SHORT, ids=lambda page: page.name)
def test_sentences_are_short(page):
    """Items of a list and paragraphs count separately."""
    parts = re.split(r"\n\s*\n|\n(?=- |\d+\. )", prose(page))
    sentences = [
        sentence for part in parts for sentence in re.split(r"(?<=[.!?:])\s+", " ".join(part.split()))
    ]
    assert [sentence for sentence in sentences if len(sentence.split()) > MOST_WORDS] == []
