"""Plain English: words that pages, docstrings and comments do not use, names, and the length of sentences."""

import ast
import io
import re
import tokenize

import pytest
from conftest import ROOT
from test_imports import MODULES

AVOIDED = re.compile(
    r"\b(told|tells|borne|anew|besides?|farther|lest|whoever|as yet|(of )?one's own|takes? up(?! to)|taken up"
    r"|comes? to rest|gives? way|runs? away|lends?|lent|borrows?|dear(er)?|begins? from"
    r"|(?<!or )(?<!anything )(?<!nothing )(?<!everything )else)\b",
    re.I,
)
FIRST_WORDS = re.compile(r"(Of|As|That|Those|What|Which|Where|Nor|Else|It|They|None|By|Here|There|So)\b")
NAMES = {"found", "told", "mine", "kept", "there", "gone", "lent", "laid", "taken", "begun", "asked", "near"}
DOCS = ROOT / "src" / "netfall" / "docs" / "pages"
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "jobs").rglob("*.md"), *DOCS.rglob("*.md")])
SHORT = [ROOT / "README.md", *sorted((DOCS / "how-to").glob("*.md"))]
MOST_WORDS = 30  # of a sentence
MARKS = r"```.*?```|<!--.*?-->|`[^`\n]*`|\]\([^)]*\)"  # code, comments, targets of links


def prose(page):
    """The text of a page without code, tables and headings."""
    text = re.sub(MARKS, "", page.read_text(encoding="utf-8"), flags=re.S)
    return "\n".join(line for line in text.splitlines() if not line.startswith(("|", "#", "    ")))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_use_plain_words(page):
    """The change log quotes names of the past, and is left out."""
    if page.name != "CHANGELOG.md":
        assert [match[0] for match in AVOIDED.finditer(prose(page))] == []


@pytest.mark.parametrize("page", SHORT, ids=lambda page: page.name)
def test_sentences_are_short(page):
    """Items of a list and paragraphs are apart."""
    parts = re.split(r"\n\s*\n|\n(?=- |\d+\. )", prose(page))
    sentences = [
        sentence for part in parts for sentence in re.split(r"(?<=[.!?:])\s+", " ".join(part.split()))
    ]
    assert [sentence for sentence in sentences if len(sentence.split()) > MOST_WORDS] == []


def test_docstrings_comments_and_names_are_plain():
    """A docstring begins with a statement that stands alone; a variable is named by its content."""
    wrong = []
    for module, path in MODULES.items():
        text = path.read_text()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                words = ast.get_docstring(node) or ""
                if FIRST_WORDS.match(words) or AVOIDED.search(words):
                    wrong.append(f"{module}: {words.splitlines()[0]}")
            targets = node.targets if isinstance(node, ast.Assign) else []
            targets = [node.target] if isinstance(node, ast.NamedExpr) else targets
            for name in (name for target in targets for name in ast.walk(target)):
                if isinstance(name, ast.Name) and name.id in NAMES:
                    wrong.append(f"{module}:{name.lineno}: {name.id}")
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Lambda):
                wrong.append(f"{module}:{node.lineno}: a lambda with a name")
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT and AVOIDED.search(token.string):
                wrong.append(f"{module}:{token.start[0]}: {token.string}")
    assert wrong == []
