"""The pages: links lead somewhere, generated parts are current, pages are short and can be reached."""

import re
import tomllib

import documentation_site as site
import pages
import pytest
from conftest import ROOT
from documentation_site import PART, READ
from page_examples import blocks
from reference_pages import PARTS, command_parsers, part_names, renewed

import netfall
from netfall.geometry.sections import TYPE_COLUMNS
from netfall.geometry.tables import ELEMENT_COLUMNS, NODE_COLUMNS
from netfall.job.keys.schema import LIST_KEYS, TABLES

DOCS = site.PAGES
PAGES = sorted(
    page
    for pattern in ("*.md", "jobs/**/*.md", "partitions/*.md", "src/**/*.md", "tests/**/*.md")
    for page in ROOT.glob(pattern)
)
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
SHIPPED = [page for page in PAGES if page.is_relative_to(DOCS)]
WIDEST = 110  # characters of a line, except in tables
# Most words of prose: of a page, of README.md, of a how-to page, of all pages for users.
MOST_WORDS, MOST_OF_README, MOST_OF_HOW_TO, MOST_OF_ALL = 2500, 700, 500, 32000


def prose(page):
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.S | re.M)


def words(page):
    """Number of words outside tables that tests/pages.py makes or netfall reads, without code."""
    text = READ.sub("", PART.sub("", prose(page)))
    return len(re.sub(r"<!--.*?-->", "", text, flags=re.S).split())


def anchors(page):
    """The anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).strip().replace(" ", "-") for heading in plain}


def links(page):
    targets = re.findall(r"\]\((?!https?://)([^)\s]+)\)", prose(page))
    return [link.partition("#")[::2] for link in targets]


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page):
    wrong = []
    for path, anchor in links(page):
        target = (page.parent / path).resolve() if path else page
        is_inside = page not in SHIPPED or target.is_relative_to(DOCS)
        if not target.exists() or not is_inside or (anchor and anchor not in anchors(target)):
            wrong.append(f"{path}#{anchor}")
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_lines_are_readable(page):
    """No line but a table's is wider than 110 characters."""
    lines = page.read_text().splitlines()
    assert [line for line in lines if len(line) > WIDEST and not line.startswith("|")] == []


@pytest.mark.parametrize("page", SHIPPED, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_generated_parts_are_current(page):
    assert page.read_text() == renewed(page.read_text()), "python tests/pages.py writes it anew"


def test_every_generated_part_has_one_place():
    assert sorted(name for page in SHIPPED for name in part_names(page.read_text())) == sorted(PARTS)


def test_an_unknown_part_is_an_error():
    """A mark without a part is not left empty without a word."""
    with pytest.raises(KeyError, match="no such"):
        renewed("<!-- generated: no such -->\n<!-- end -->\n")


def test_pages_are_short():
    """A page is read in one sitting; all of them by an engineer in a day."""
    count = {page: words(page) for page in SHIPPED}
    assert {page.name: n for page, n in count.items() if n > MOST_WORDS} == {}
    how_to = {page.name: n for page, n in count.items() if page.parent.name == "how-to"}
    assert {name: n for name, n in how_to.items() if n > MOST_OF_HOW_TO} == {}
    assert words(ROOT / "README.md") <= MOST_OF_README
    of_users = sum(n for page, n in count.items() if page.parent.name != "development")
    assert of_users + words(ROOT / "README.md") <= MOST_OF_ALL


def test_every_page_can_be_reached():
    """Along links, from README.md or from the first shipped page, or by its name in a shipped page."""
    reached, to_read = set(), [ROOT / "README.md", DOCS / "index.md"]
    while to_read:
        page = to_read.pop()
        if page not in reached and page.exists():
            reached.add(page)
            to_read += [(page.parent / path).resolve() for path, _ in links(page) if path.endswith(".md")]
            to_read += [ROOT / path for path in re.findall(r"`((?:jobs|tests)/\S+\.md)`", page.read_text())]
    assert sorted(page.relative_to(ROOT).as_posix() for page in set(PAGES) - reached) == []


def test_the_map_has_every_package():
    packages = {path.parent.relative_to(pages.PACKAGE).as_posix() for path in pages.PACKAGE.rglob("*.py")}
    assert packages - {"."} == set(pages.PACKAGES)


def test_every_key_is_in_its_page():
    text = "\n".join(page.read_text() for page in SHIPPED)
    for name, keys in (TABLES | LIST_KEYS).items():
        part = text.split(f"<!-- generated: keys of {name or 'the job'} -->")[1].split("<!-- end -->")[0]
        rows = {row.split("`")[1]: row for row in part.splitlines() if row.startswith("| `")}
        for key in keys:
            assert key.meaning in rows[key.name] and f"[{key.unit}]" in rows[key.name] + "[]", key.name
            for bound in (key.low, key.high):
                assert bound is None or f"{bound:g}" in rows[key.name], key.name


def columns(page, heading):
    """The names of columns in the first column of the tables below a heading of a page."""
    part = page.read_text().split(f"\n{heading}\n")[1].split("\n## ")[0]
    cells = [row.split("|")[1] for row in part.splitlines() if row.startswith("| `")]
    return {name for cell in cells for name in re.findall(r"`(\w+)`", re.sub(r"\[.*?\]", "", cell))}


def test_columns_of_tables_are_those_that_are_read():
    page = DOCS / "reference" / "tables.md"
    assert columns(page, "## Nodes") == set(NODE_COLUMNS)
    assert columns(page, "## Elements") == set(ELEMENT_COLUMNS)
    assert columns(page, "## Catalogue") == {"name", *TYPE_COLUMNS}


def test_versions_agree():
    log = (ROOT / "CHANGELOG.md").read_text()
    (newest, day), *_ = re.findall(r"^## \[(\d.+?)\] - (\S+)$", log, re.M)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {newest}\n" in citation and f'\ndate-released: "{day}"\n' in citation
    assert f"netfall, version {newest}." in (DOCS / "explanation" / "citing.md").read_text()
    assert netfall.__version__ == version
    unreleased = log.split("## [Unreleased]\n")[1].split("\n## ")[0].strip()
    assert ".dev" in version if unreleased else version == newest


def test_each_version_of_the_change_log_is_short():
    """At most forty lines."""
    for part in re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)[1:]:
        assert len(part.splitlines()) <= 40, part.splitlines()[0]


@pytest.mark.parametrize(
    "word",
    [
        *("buckling", "pressure coefficient", "load combination", "partial factor", "erection"),
        *("natural frequenc", "ponding", "added mass", "aerodynamic damping", "creep", "fatigue", "slip"),
    ],
)
def test_explanations_contain_the_terms_of_engineers(word):
    """A search for a usual term finds the feature of the model."""
    assert any(word in page.read_text().lower() for page in (DOCS / "explanation").glob("*.md"))


def test_the_commands_of_the_readme_exist():
    named = {
        word
        for block in blocks((ROOT / "README.md").read_text())
        for word in re.findall(r"netfall (\w+) ", "\n".join(block.lines))
    }
    assert named <= set(command_parsers())
