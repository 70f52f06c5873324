"""Docstrings and comments are plain English; names in them exist, so that a rename leaves no stale one."""

import ast
import builtins
import io
import keyword
import re
import sys
import tokenize
from collections import defaultdict
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
            case ast.alias(name=name, asname=other):
                yield from (*name.split("."), other or name)
            case ast.Constant(value=str(text)):
                yield from re.findall(r"\w+", text)


@cache
def local_names() -> dict[Path, set[str]]:
    """Return the names and words of the code of each module."""
    return {module.name: set(names_in(module.nodes)) for module in modules()}


@cache
def members() -> dict[str, set[str]]:
    """Return the names that each module, package and class of the code defines."""
    result: dict[str, set[str]] = {}
    for name, nodes, *_ in modules():
        if name.stem == "__init__":
            defined = local_names()[name] | {child.stem for child in (PACKAGE / name).parent.iterdir()}
            result.setdefault((PACKAGE / name).parent.name, set()).update(defined)
        else:
            statements = [node for node in nodes[0].body if not isinstance(node, DEFINITION)]
            assigned = {word for node in statements for word in names_in(ast.walk(node))}
            defined = {node.name for node in nodes[0].body if isinstance(node, DEFINITION)}
            result.setdefault(name.stem, set()).update(assigned | defined)
        for node in nodes:
            if isinstance(node, ast.ClassDef):
                result.setdefault(node.name, set()).update(names_in(ast.walk(node)))
    return result


@cache
def names_everywhere() -> set[str]:
    """Return the names that count in each module.

    These are modules and definitions, parameters, attributes, keywords, imported packages, and texts that are
    one name: keys and datasets. A local variable counts in its own module alone.
    """
    result = {*dir(builtins), *keyword.kwlist, *sys.stdlib_module_names, "netfall"}
    for module in modules():
        result |= set(module.name.with_suffix("").parts)
        for node in module.nodes[0].body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                result |= {child.id for child in ast.walk(node) if isinstance(child, ast.Name)}
        for node in module.nodes:
            match node:
                case ast.ClassDef(name=name):
                    fields = [child.target for child in node.body if isinstance(child, ast.AnnAssign)]
                    result |= {name, *(field.id for field in fields)}
                case ast.Attribute(attr=name) | ast.arg(arg=name) | ast.keyword(arg=str(name)):
                    result.add(name)
                case ast.FunctionDef(name=name):
                    result.add(name)
                case ast.ImportFrom(module=str(name)) | ast.alias(name=name):
                    result.add(name.split(".")[0])
                case ast.Constant(value=str(text)) if text.isidentifier():
                    result.add(text)
    return result


@cache
def assigning_packages() -> dict[str, set[Path]]:
    """Return the packages that assign each name in capitals."""
    result = defaultdict(set)
    for module in modules():
        for node in module.nodes:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id.isupper():
                result[node.id].add(module.name.parent)
    return result


@cache
def words_of_texts() -> set[str]:
    """Return the words of text constants in all modules, and of messages."""
    constants = (node for module in modules() for node in module.nodes if isinstance(node, ast.Constant))
    page = PACKAGE / "docs" / "pages" / "reference" / "messages.md"
    return set(names_in(constants)) | set(re.findall(r"\w+", page.read_text()))


def unknown_parts(name: str, local: set[str]) -> list[str]:
    """Return the parts of a name in backticks that do not exist. local : names of the module that names it"""
    if re.fullmatch(r"[\w/]+\.(py|js)", name):
        return [] if list(PACKAGE.rglob(name)) else [name]
    if re.fullmatch(r"\w+(\.\w+)+", name):
        owner, member = name.split(".")[-2:]
        if owner in members() and owner not in local and member not in members()[owner]:
            return [name]
    known = names_everywhere() | local | FOREIGN
    return [part for part in re.findall(r"[A-Za-z_]\w*", name) if part not in known and not part.isupper()]


def occurrences(pattern: re.Pattern[str]) -> Iterator[tuple[str, Path, str]]:
    """Yield the place, module and first group of each match of a pattern in docstrings and comments."""
    for module in modules():
        for line, text in module.texts:
            for match in pattern.finditer(text):
                place = f"{module.name}:{line + text.count(chr(10), 0, match.start(1))}"
                yield place, module.name, match[1]


def test_names_in_backticks_exist():
    """A name in backticks is defined in the module, package or class that it names, or else in the code."""
    wrong = [
        f"{place}: {name}"
        for place, module, name in occurrences(BACKTICKS)
        if unknown_parts(name, local_names()[module])
    ]
    assert not wrong, "\n".join(wrong)


def test_capital_constants_exist():
    """A capital word is a name of the module, its package or one other package, a text or an abbreviation."""
    known, packages, wrong = words_of_texts() | ABBREVIATIONS, assigning_packages(), []
    for place, module, word in occurrences(CAPITALS):
        is_of_package = len(packages[word]) == 1 or module.parent in packages[word]
        if not is_of_package and word not in known | local_names()[module]:
            wrong.append(f"{place}: {word}")
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
    assert not ABBREVIATIONS - {word for *_, word in occurrences(CAPITALS)}
    assert not FOREIGN - {part for *_, name in occurrences(BACKTICKS) for part in re.findall(r"\w+", name)}


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
