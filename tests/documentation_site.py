"""Build the pages as a site: python tests/documentation_site.py [FOLDER]

The default folder is results/site. It needs the extra `docs`. The build fails at a link without a target.
mkdocstrings makes the page of the Python interface from the docstrings.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import netfall
from netfall.core.errors import InputError
from netfall.job.toml_text import toml_value

FOLDER = Path("results") / "site"
PAGES = Path(netfall.__file__).parent / "docs" / "pages"
PART = re.compile(r"(<!-- generated: ([^\n]*?) -->\n).*?(<!-- end -->)", re.S)  # made by tests/pages.py
READ = re.compile(r"<!-- read by netfall: .*?<!-- end -->", re.S)  # table that the program reads
SETTINGS = Path(__file__).with_suffix(".toml")
TABS = ("tutorials", "how-to", "reference", "explanation", "development")
COLOUR = re.compile(r"\x1b\[[0-9;]*m")  # codes of terminals
PYTHON_PAGE = "reference/python.md"


def navigation(pages: Path) -> list[object]:
    """Return the pages in the order of the menu: those at the top, then a tab for each folder."""

    def entries(folder: Path) -> list[object]:
        files = sorted(folder.glob("*.md"), key=lambda page: (page.stem != "index", page.stem))
        inner = [path for path in sorted(folder.iterdir()) if any(path.glob("*.md"))]
        return [*({title(path): entries(path)} for path in inner), *(relative(page) for page in files)]

    def relative(page: Path) -> str:
        return page.relative_to(pages).as_posix()

    def title(folder: Path) -> str:
        return "Job file" if folder.name == "job" else folder.name.capitalize()

    return [
        *sorted(map(relative, pages.glob("*.md"))),
        *({title(pages / tab): entries(pages / tab)} for tab in TABS if (pages / tab).is_dir()),
    ]


def build(folder: Path) -> None:
    """Build the site into a folder, which it replaces. Raises InputError if a link leads nowhere."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        shutil.copytree(PAGES, place / "docs")
        page = place / "docs" / PYTHON_PAGE
        names = "\n\n".join(f"::: netfall.{name}" for name in sorted(netfall.__all__, key=str.lower))
        page.write_text(PART.sub(names, page.read_text(encoding="utf-8")), encoding="utf-8")
        settings = SETTINGS.read_text(encoding="utf-8")
        menu = toml_value(navigation(place / "docs"))
        head = f'[project]\ndocs_dir = "docs"\nsite_dir = "site"\nnav = {menu}\n'
        (place / "zensical.toml").write_text(settings.replace("[project]\n", head, 1), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "zensical", "build", "--strict"],
            cwd=place,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        if done.returncode:
            raise InputError(COLOUR.sub("", done.stdout).partition("Traceback")[0].strip())
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(place / "site", folder)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    try:
        build(target)
    except InputError as error:
        sys.exit(str(error))
    print(
        f"{target / 'index.html'}: open it in a browser; the search needs: python -m http.server -d {target}"
    )
