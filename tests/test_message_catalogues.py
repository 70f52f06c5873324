"""The messages of all packages: codes, templates, and who uses them."""

import ast
import re
import string
from functools import cache
from pathlib import Path

import pytest
from test_imports import MODULES

from netfall.core.errors import DivergedError
from netfall.core.messages import SEVERITIES, Message, code_of, is_note, is_warning, kN, warning_count
from netfall.docs.topics import pages, tables_of

FIRST_DIGIT = {  # of the codes of a package
    **dict.fromkeys(("core", "parallel", "gpu", "cli", "api", "docs"), "0"),
    "job": "1",
    "geometry": "2",
    "loads": "3",
    "model": "4",
    "statics": "5",
    "driver": "6",
    **dict.fromkeys(("results", "exchange"), "7"),
    "post": "8",
    "study": "9",
}
CATALOGUES = {name: path for name, path in MODULES.items() if name.endswith(".messages")}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def imported_catalogues(path: Path) -> dict[str, str]:
    """The catalogues that a module imports, by the names that it gives them."""
    result = {}
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("netfall"):
            for alias in node.names:
                module = f"{node.module}.{alias.name}".removeprefix("netfall.")
                if module in CATALOGUES:
                    result[alias.asname or alias.name] = module
    return result


@cache
def uses() -> list[tuple[str, str, ast.expr, ast.Call | None]]:
    """Each use of a message: catalogue, name, expression, and the call that fills it in."""
    result = []
    for path in MODULES.values():
        aliases = imported_catalogues(path)
        called = {id(node.func): node for node in ast.walk(tree(path)) if isinstance(node, ast.Call)}
        for node in ast.walk(tree(path)) if aliases else ():
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id in aliases
            ):
                result.append((aliases[node.value.id], node.attr, node, called.get(id(node))))
    return result


def catalogue(module: str) -> dict[str, Message]:
    values = vars(__import__(f"netfall.{module}", fromlist=["messages"]))
    return {name: value for name, value in values.items() if isinstance(value, Message)}


def fields(message: Message) -> set[str]:
    """The names that a template takes."""
    return {
        name.split(".")[0].split("[")[0] for _, name, _, _ in string.Formatter().parse(message.text) if name
    }


def test_each_code_has_one_message_of_its_package_and_one_row_of_the_page():
    messages = {module: catalogue(module) for module in CATALOGUES}
    codes = [message.code for values in messages.values() for message in values.values()]
    rows = tables_of(pages()["reference/messages"])[1][1:]
    assert [code for code, *_ in rows] == [f"`{code}`" for code in sorted(codes, key=lambda code: code[1:])]
    assert all(severity == SEVERITIES[code[1]] for code, severity, *_ in rows)
    for module, values in messages.items():
        for message in values.values():
            assert re.fullmatch(rf"[EWN]{FIRST_DIGIT[module.split('.')[0]]}\d\d", message.code), message


@pytest.mark.parametrize("module", sorted(CATALOGUES))
def test_calls_fill_in_the_templates(module):
    messages, used = catalogue(module), set()
    for place, name, node, call in uses():
        if place == module and name in messages:
            used.add(name)
            if call is not None:
                given = {keyword.arg for keyword in call.keywords}
                assert not call.args and given == fields(messages[name]), (
                    f"{name}, line {node.lineno}: {given}"
                )
    assert used == set(messages)


def test_texts_of_messages_are_in_catalogues():
    wrong = []
    for module, path in MODULES.items():
        if module.split(".")[0] not in CONVERTED or module in CATALOGUES or module == "core.messages":
            continue
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Constant) and re.match(r"(warning|note): \S", str(node.value)):
                wrong.append(f"{module}:{node.lineno}: {node.value}")
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in EXCEPTIONS:
                texts = [arg for arg in node.args if isinstance(arg, (ast.Constant, ast.JoinedStr))]
                wrong += [f"{module}:{node.lineno}: {ast.unparse(text)}" for text in texts]
    assert wrong == []


CONVERTED = tuple(FIRST_DIGIT)  # packages
EXCEPTIONS = (
    *("InputError", "DivergedError", "NoEquilibriumError", "UndecidedError", "Interrupted", "OutputError"),
)


def test_lines_end_in_their_code():
    warning, error = Message("W616"), Message("E931")
    line = warning(what="a target", residual=2500.0)
    assert line.startswith("warning: a target: the permanent load") and "of 2.5 kN remains" in line
    assert is_warning(line) and not is_note(line) and code_of(line) == "W616"
    assert error() == "expected a list of values, or {from = 1, to = 50} [E931]"
    assert code_of("[net] nodes [m]") == ""
    with pytest.raises(KeyError):
        warning(place="a target", residual=2500.0)


def test_the_sentence_on_a_checkpoint_precedes_the_code():
    error, other = (
        DivergedError("statics: no equilibrium. Lower the load [E619]"),
        DivergedError("it diverged"),
    )
    error.checkpoint = other.checkpoint = Path("x.h5")
    sentence = "The last good checkpoint is x.h5: resume with --restart x.h5"
    assert str(error) == f"statics: no equilibrium. Lower the load. {sentence} [E619]"
    assert str(other).startswith("it diverged. The last good checkpoint")


def test_warnings_are_counted_with_their_codes():
    assert warning_count([]) == "0 warnings"
    line = "warning: x [W612]"
    assert warning_count([line]) == "1 warning (W612; netfall docs CODE explains)"
    assert warning_count([line, line, "warning: y [W101]"]).startswith("3 warnings (W101, W612;")


def test_forces_have_an_exponent_beyond_all_forces():
    """A form that diverged was printed with 130 digits."""
    assert (kN(12_345.6), kN(1e14), kN(1.5e135)) == ("12.35 kN", "100000000000 kN", "1.5e+132 kN")
