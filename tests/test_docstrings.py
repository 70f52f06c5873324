"""Docstrings and comments are plain English; names in them exist, so that a rename leaves no stale one."""

import ast
import builtins
import io
import keyword
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from conftest import ROOT
from test_words import AVOIDED

PACKAGE = ROOT / "src" / "netfall"
BACKTICKS = re.compile(r"(?<!`)`([^`]+)`(?!`)")
CAPITALS = re.compile(r"\b([A-Z]{2}[A-Z0-9_]*)\b(?!\.md)")
DESCRIBED = re.compile(r"(?:^|;)[ ]*((?:\w+, )*\w+)(?:\([^)\n]*\))? :(?=\s)", re.MULTILINE)
DEFINITION = ast.ClassDef | ast.FunctionDef
FIRST_WORDS = re.compile(r"(Of|As|That|Those|What|Which|Where|Nor|Else|It|They|None|By|Here|There|So)\b")
VAGUE = {"found", "told", "mine", "kept", "there", "gone", "lent", "laid", "taken", "begun", "asked", "near"}

# Names in backticks of programs and formats that the code does not import.
FOREIGN = {"srun", "json_load", "special"}
# Capital words that are no constants of the code: abbreviations, libraries, formats, symbols, placeholders.
ABBREVIATIONS = {
    *("AR", "ARPACK", "AS", "AVX", "AVX2", "BLAS", "BSR", "EI", "EI1", "EI2", "GPU", "HTML", "IEC", "II"),
    "ISO",
    *("KB", "LAPACK", "LLVM", "MN", "MP4", "MVAPICH", "PEER", "PPND16", "VTK", "XML"),
    *("FIELD", "GENERATOR", "STAGE", "STEP"),
    *("FALLOC_FL_KEEP_SIZE", "MPI_STATUSES_IGNORE", "PR_SET_PDEATHSIG", "VTK_LINE"),
}


class Module(NamedTuple):
    """A module of the package.

    name : path in the package; nodes : of its code without docstrings, the module first
    texts : first line and text of each docstring and comment
    described : first line and text of the docstring of each class and function, and its node
    """

    name: Path
    nodes: list[ast.AST]
    texts: list[tuple[int, str]]
    described: list[tuple[int, str, ast.AST]]


@cache
def modules() -> list[Module]:
    """Read all modules of the package."""
    result = []
    for path in sorted(PACKAGE.rglob("*.py")):
        code = path.read_text()
        nodes, texts, described = list(ast.walk(ast.parse(code))), [], []
        for node in nodes:
            if isinstance(node, ast.Module | DEFINITION) and (text := ast.get_docstring(node, clean=False)):
                texts.append((node.body[0].lineno, text))
                node.body[0].value.value = ""
                if isinstance(node, DEFINITION):
                    described.append((*texts[-1], node))
        for token in tokenize.generate_tokens(io.StringIO(code).readline):
            if token.type == tokenize.COMMENT:
                texts.append((token.start[0], token.string))
        result.append(Module(path.relative_to(PACKAGE), nodes, texts, described))
    return result


def names_in(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield the names of nodes, and the words of text constants."""
    for child in nodes:
        match child:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                yield name
            case ast.keyword(arg=str(name)) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.ImportFrom(module=str(name)):
                yield from name.split(".")
            case ast.alias(name=name, asname=other):
                yield from (*name.split("."), other or name)
            case ast.Constant(value=str(text)):
                yield from re.findall(r"\w+", text)


@cache
def known_names() -> set[str]:
    """Return the names of the package and of Python, and the words of texts and messages."""
    page = PACKAGE / "docs" / "pages" / "reference" / "messages.md"
    result = {
        *dir(builtins),
        *keyword.kwlist,
        *sys.stdlib_module_names,
        *re.findall(r"\w+", page.read_text()),
    }
    for module in modules():
        result |= {*module.name.with_suffix("").parts, *names_in(module.nodes)}
    return result


def unknown_parts(name: str) -> list[str]:
    """Return the parts of a name in backticks that do not exist."""
    if re.fullmatch(r"[\w/]+\.(py|js)", name):
        return [] if list(PACKAGE.rglob(name)) else [name]
    known = known_names() | FOREIGN
    return [part for part in re.findall(r"[A-Za-z_]\w*", name) if part not in known]


def occurrences(pattern: re.Pattern[str]) -> Iterator[tuple[str, str]]:
    """Yield the place and first group of each match of a pattern in docstrings and comments."""
    for module in modules():
        for line, text in module.texts:
            for match in pattern.finditer(text):
                yield f"{module.name}:{line + text.count(chr(10), 0, match.start(1))}", match[1]


def test_names_in_backticks_exist():
    """Each name in backticks is one of the code."""
    wrong = [f"{place}: {name}" for place, name in occurrences(BACKTICKS) if unknown_parts(name)]
    assert not wrong, "\n".join(wrong)


def test_capital_constants_exist():
    """A capital word is a name of the code, a word of its texts or an abbreviation."""
    known = known_names() | ABBREVIATIONS
    wrong = [f"{place}: {word}" for place, word in occurrences(CAPITALS) if word not in known]
    assert not wrong, "\n".join(wrong)


def test_described_arguments_exist():
    """Each name that a docstring describes as `name : meaning` occurs in the class or function."""
    wrong = []
    for module in modules():
        for line, text, node in module.described:
            for match in DESCRIBED.finditer(text):
                names = set(match[1].split(", ")) - set(names_in(ast.walk(node)))
                if names:
                    place = f"{module.name}:{line + text.count(chr(10), 0, match.start(1))}"
                    wrong.append(f"{place}: {', '.join(names)}")
    assert not wrong, "\n".join(wrong)


def test_exceptions_are_needed():
    """Each exception occurs."""
    assert not ABBREVIATIONS - {word for _, word in occurrences(CAPITALS)}
    assert not FOREIGN - {part for _, name in occurrences(BACKTICKS) for part in re.findall(r"\w+", name)}


def test_docstrings_comments_and_names_are_plain():
    """A docstring begins with a statement that stands alone; a variable is named by its content."""
    wrong = []
    for module in modules():
        for line, text in module.texts:
            if AVOIDED.search(text) or FIRST_WORDS.match(text):
                wrong.append(f"{module.name}:{line}: {text.splitlines()[0]}")
        for node in module.nodes:
            targets = node.targets if isinstance(node, ast.Assign) else []
            targets = [node.target] if isinstance(node, ast.NamedExpr) else targets
            for name in (name for target in targets for name in ast.walk(target)):
                if isinstance(name, ast.Name) and name.id in VAGUE:
                    wrong.append(f"{module.name}:{name.lineno}: {name.id}")
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Lambda):
                wrong.append(f"{module.name}:{node.lineno}: a lambda with a name")
    assert wrong == []
