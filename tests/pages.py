"""The pages, or parts of them, that are made from the code, so that they cannot be other than it.

    .venv/bin/python tests/pages.py          writes them anew

src/netfall/MAP.md, from the first sentence of each file; the tables of datasets in
src/netfall/results/README.md. test_readme.py compares them with the code.
"""

import ast
import re
from pathlib import Path

from netfall.results.datasets import tables

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "netfall"
ROOMS = (  # from the ground up: a room imports from those before it
    *("ground", "numerics", "job", "net", "net/generators", "roof", "wind", "mechanics", "parallel", "step"),
    *("multigrid", "equilibrium", "model", "record", "write", "stages", "messages", "program"),
    *("results", "checks", "plots", "report", "study", "study/answers", "plots/study", "measure"),
    *("api", "exchange", "exchange/drawings", "cli"),
)
HEAD = """# The map of the code

Made by `tests/pages.py` from the first sentence of each file. Rooms stand in the order in which they
import: each from those above it, as `tests/test_imports.py` says in detail.
"""


def first_sentence(path: Path) -> str:
    """The first sentence of a module's docstring, on one line."""
    text = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.:;]) (?=[A-Z])", text)[0].rstrip(".:")


def code_map() -> str:
    """The text of MAP.md."""
    parts = [HEAD]
    for room in ROOMS:
        files = sorted(path for path in (PACKAGE / room).glob("*.py") if path.name != "__init__.py")
        rows = "".join(f"| `{path.name}` | {first_sentence(path)} |\n" for path in files)
        about = " ".join(ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text())).split())
        parts.append(f"## {room}\n\n{about}\n\n| file | what |\n|---|---|\n{rows}")
    return "\n".join(parts)


def with_part(page: Path, name: str, part: str) -> str:
    """A page with the part between its marks `<!-- name: ... -->` and `<!-- end -->` anew."""
    return re.sub(
        rf"(<!-- {name}: [^\n]*-->\n).*?(<!-- end -->)",
        lambda found: f"{found[1]}\n{part}\n{found[2]}",
        page.read_text(),
        flags=re.S,
    )


DATASETS = PACKAGE / "results" / "README.md"
PAGES = {  # page: its text as the code says it
    PACKAGE / "MAP.md": code_map,
    DATASETS: lambda: with_part(DATASETS, "datasets", tables()),
}

if __name__ == "__main__":
    for path, text in PAGES.items():
        path.write_text(text())
