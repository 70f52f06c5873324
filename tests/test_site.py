"""The documentation site has every page, and is refused if a link has no target."""

from importlib.util import find_spec

import documentation_site as site
import pytest
from documentation_site import PAGES

from netfall.core.errors import InputError


def in_menu(entries):
    for entry in entries:
        if isinstance(entry, str):
            yield entry
        else:
            for inner in entry.values():
                yield from in_menu(inner)


def test_every_page_is_in_the_menu():
    pages = list(in_menu(site.navigation(PAGES)))
    assert sorted(pages) == sorted(page.relative_to(PAGES).as_posix() for page in PAGES.rglob("*.md"))
    assert pages[0] == "index.md"


@pytest.mark.long
@pytest.mark.skipif(not find_spec("zensical"), reason="needs the extra docs")
def test_the_site_is_built(tmp_path):
    """A warning would end the build. The Python interface comes from the docstrings."""
    site.build(tmp_path / "site")
    for page in PAGES.rglob("*.md"):
        assert (tmp_path / "site" / page.relative_to(PAGES).with_suffix(".html")).is_file(), page
    assert "Open a result file" in (tmp_path / "site" / "reference" / "python.html").read_text()


@pytest.mark.long
@pytest.mark.skipif(not find_spec("zensical"), reason="needs the extra docs")
def test_a_link_without_target_ends_the_build(tmp_path, monkeypatch):
    (tmp_path / "pages" / "reference").mkdir(parents=True)
    (tmp_path / "pages" / "index.md").write_text("# A page\n\n[nowhere](reference/none.md)\n")
    (tmp_path / "pages" / site.PYTHON_PAGE).write_text("# Python\n")
    monkeypatch.setattr(site, "PAGES", tmp_path / "pages")
    with pytest.raises(InputError, match=r"index\.md:3"):
        site.build(tmp_path / "site")
    assert not (tmp_path / "site").exists()
