"""Write the parts of the pages that are generated from the program.

.venv/bin/python tests/pages.py          writes them again
.venv/bin/python tests/pages.py --map    prints a map of the code, from the first sentence of each file
"""

import ast
import re
import sys
from pathlib import Path

from reference_pages import write_pages

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "netfall"
PACKAGES = (  # each imports from those before it
    *("core", "physics", "physics/law", "physics/slip", "job", "job/keys", "geometry", "geometry/generators"),
    *("parallel", "loads", "loads/wind", "model", "explicit", "gpu", "results"),
    *("statics", "statics/multigrid", "statics/form"),
    *("driver", "driver/statics", "driver/erection", "driver/removal", "driver/dynamics", "driver/reporting"),
    *("study", "study/answers"),
    *("post", "post/checks", "post/plots", "post/plots/study", "post/report", "post/page", "post/accuracy"),
    *("exchange", "exchange/formats", "exchange/drawings", "docs", "api", "cli"),
)
HEAD = """# The map of the code

Packages stand in the order in which they import: each from those above it, as `tests/test_imports.py` says in
detail.
"""


def first_sentence(path: Path) -> str:
    """Return the first sentence of a module's docstring, on one line."""
    text = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.:;]) (?=[A-Z])", text)[0].rstrip(".:")


def code_map() -> str:
    """Return a page of all files."""
    parts = [HEAD]
    for package in PACKAGES:
        files = sorted(path for path in (PACKAGE / package).glob("*.py") if path.name != "__init__.py")
        rows = "".join(f"| `{path.name}` | {first_sentence(path)} |\n" for path in files)
        whole = ast.get_docstring(ast.parse((PACKAGE / package / "__init__.py").read_text()))
        about = " ".join(whole.split("\n\n")[0].split())
        parts.append(f"## {package}\n\n{about}\n\n| file | what |\n|---|---|\n{rows}")
    return "\n".join(parts)


if __name__ == "__main__":
    if "--map" in sys.argv:
        print(code_map())
    else:
        write_pages()
