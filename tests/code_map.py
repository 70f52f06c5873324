"""The map of the code, src/netfall/MAP.md, made from the first lines of its docstrings.

    .venv/bin/python tests/code_map.py       writes it anew

test_readme.py compares it with the code.
"""

import ast
import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "netfall"
PAGE = PACKAGE / "MAP.md"
ROOMS = (  # from the ground up: a room imports from those before it
    *("ground", "numerics", "job", "net", "net/generators", "wind", "mechanics", "parallel", "step"),
    *("multigrid", "equilibrium", "model", "record", "write", "stages", "messages", "program"),
    *("results", "checks", "plots", "report", "study", "study/answers", "plots/study", "measure"),
    *("api", "exchange", "cli"),
)
HEAD = """# The map of the code

Made by `tests/code_map.py` from the first sentence of each file. Rooms stand in the order in which they
import: each from those above it, as `tests/test_imports.py` says in detail.
"""


def first_sentence(path: Path) -> str:
    """The first sentence of a module's docstring, on one line."""
    text = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.:;]) (?=[A-Z])", text)[0].rstrip(".:")


def page() -> str:
    """The text of the page."""
    parts = [HEAD]
    for room in ROOMS:
        files = sorted(path for path in (PACKAGE / room).glob("*.py") if path.name != "__init__.py")
        rows = "".join(f"| `{path.name}` | {first_sentence(path)} |\n" for path in files)
        about = " ".join(ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text())).split())
        parts.append(f"## {room}\n\n{about}\n\n| file | what |\n|---|---|\n{rows}")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
