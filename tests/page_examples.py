"""Run the code blocks of pages and compare their output with the pages.

    python tests/page_examples.py PAGE... [--write]      --write renews expected output in the pages

Each page has a scratch folder with a link `jobs` to the shipped jobs. Its blocks are handled in the order of
the page:

- toml, csv, python with a title: the block is written to a file of that name. Without a title, the syntax of
  TOML and Python is checked.
- console: bash runs each line that begins with "$ ", in the scratch folder, with netfall on PATH. If the line
  begins with netfall and needs bash only for a pipe, a persistent process runs netfall. The lines
  below a command are its expected output; without such lines the output is ignored. The exit code must be 0,
  or n if the command ends with "# exit n". A line "..." stands for any number of lines, and "..." inside a
  line for any characters. A line that begins with "> " continues the command.
- sh, text, json and blocks without a language are not run.
"""

import ast
import atexit
import difflib
import functools
import os
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from standing_ranks import StandingRanks

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "src" / "netfall" / "docs" / "pages").rglob("*.md"))]
NOT_RUN = ("sh", "text", "json", "")
FILES = ("toml", "csv", "python")
TIME_LIMIT = 300  # s, of one command
FENCE = re.compile(r"( *)```(\w*)(?: +(.*))?$")
PLAIN_NETFALL = re.compile(r"""netfall(?: +(?:"[^"\\$`]*"|'[^']*'|[^\s"'\\$<>&;|*?#`(]+))+""")
EXIT_CODE = re.compile(r"\s+# exit (\d+)$")
LEAST_SIMILARITY = 0.5  # of an old and a new line of output; below it they are not the same statement


class BlockError(Exception):
    """A code block that cannot be handled, or whose command fails."""


@dataclass
class Block:
    """A code block of a page."""

    line: int  # of its first line in the page, from 0
    indent: int
    kind: str
    title: str
    lines: list[str]


@dataclass
class Command:
    """A command of a console block and its expected output."""

    line: int  # of the first line of its output in the page, from 0
    text: str
    expected: list[str] = field(default_factory=list)


def blocks(text: str) -> list[Block]:
    """Return the code blocks of a page."""
    result, block = [], None
    for number, line in enumerate(text.splitlines()):
        fence = FENCE.match(line)
        if block and fence and not fence[2]:
            result.append(block)
            block = None
        elif block:
            block.lines.append(line[block.indent :] if line[: block.indent].isspace() else line)
        elif fence:
            title = re.search(r'title="([^"]+)"', fence[3] or "")
            block = Block(number + 1, len(fence[1]), fence[2], title[1] if title else "", [])
    if block:
        raise BlockError(f"line {block.line}: the code block has no end")
    return result


def commands(block: Block) -> list[Command]:
    """Return the commands of a console block."""
    result: list[Command] = []
    for number, line in enumerate(block.lines, block.line + 1):
        if line.startswith("$ "):
            result.append(Command(number, line[2:]))
        elif not result:
            raise BlockError(f'line {number}: {line!r}; a console block begins with "$ COMMAND"')
        elif line.startswith("> ") and not result[-1].expected:
            result[-1].text += "\n" + line[2:]
            result[-1].line = number
        else:
            result[-1].expected.append(line.rstrip())
    for command in result:
        while command.expected and not command.expected[-1]:  # an empty line before the next command
            command.expected.pop()
    return result


def is_match(expected: str, line: str) -> bool:
    """Return whether a line of output is as expected."""
    return re.fullmatch(".*".join(map(re.escape, expected.split("..."))), line) is not None


def matches(expected: list[str], output: list[str]) -> bool:
    """Return whether the lines of output are as expected."""
    if not expected:
        return not output
    if expected[0] == "...":
        return any(matches(expected[1:], output[skipped:]) for skipped in range(len(output) + 1))
    return bool(output) and is_match(expected[0], output[0]) and matches(expected[1:], output[1:])


def renew_line(old: str, new: str) -> str | None:
    """Return the new line with the elisions of the old one; None if it is not clear where they belong."""
    if "..." not in old:
        return new
    old_words, new_words = old.split(" "), new.split(" ")
    if len(old_words) == len(new_words):
        return " ".join(a if "..." in a else b for a, b in zip(old_words, new_words))
    elisions = [number for number, word in enumerate(old_words) if "..." in word]
    before, after = elisions[0], len(old_words) - elisions[-1] - 1
    if len(elisions) > 1 or before + after > len(new_words):
        return None
    end = new_words[len(new_words) - after :]
    return " ".join([*new_words[:before], "...", *end])


def renew(expected: list[str], output: list[str]) -> list[str]:
    """Return the expected lines, renewed from the output; raise BlockError if a line is ambiguous."""
    if "..." not in expected and not any("..." in line for line in expected):
        return output
    renewed, position, is_free = [], 0, False
    for old in expected:
        if old == "...":
            renewed.append(old)
            is_free = True
            continue
        rest = output[position:] if is_free else output[position : position + 1]
        line = next((line for line in rest if is_match(old, line)), None)
        new: str | None = old
        if line is None:
            likeness = [difflib.SequenceMatcher(None, old.lower(), line.lower()).ratio() for line in rest]
            best = max(likeness, default=0.0)
            line = rest[likeness.index(best)] if best >= LEAST_SIMILARITY else None
            new = renew_line(old, line) if line is not None else None
        if line is None or new is None:
            raise BlockError(f"no line of the output is clearly the new form of {old!r}")
        renewed.append(new)
        position, is_free = position + rest.index(line) + 1, False
    if not matches(renewed, output):
        raise BlockError("the output has other lines than the page shows")
    return renewed


def environment() -> dict[str, str]:
    """Return the environment of commands: this checkout's netfall, no colours, terminal of 110 columns."""
    paths = {
        "PATH": [str(ROOT / ".venv" / "bin"), os.environ.get("PATH", "")],
        "PYTHONPATH": [str(ROOT / "src"), os.environ.get("PYTHONPATH", "")],
    }
    joined = {name: os.pathsep.join(filter(None, parts)) for name, parts in paths.items()}
    return os.environ | joined | {"COLUMNS": "110", "OMPI_MCA_mpi_yield_when_idle": "1"}


@functools.cache
def standing() -> StandingRanks:
    """Return the process that persists, so that few commands need a start of netfall."""
    ranks = StandingRanks([sys.executable], environment())
    atexit.register(ranks.stop)
    return ranks


def run_line(line: str, folder: Path, given: str = "") -> subprocess.CompletedProcess:
    """Run a line of a page with `given` as its input; its output includes standard error."""
    netfall, pipe, rest = line.partition(" | ")
    if PLAIN_NETFALL.fullmatch(netfall):
        words = shlex.split(netfall)[1:]
        done = standing().run(*words, cwd=folder, timeout=TIME_LIMIT, one_stream=True)
        return run_line(rest, folder, done.stdout) if pipe else done
    return subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        env=environment(),
        input=given,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=TIME_LIMIT,
    )


def run_command(command: Command, folder: Path) -> list[str]:
    """Run a command; return the lines of its output. Raise BlockError if it ends with another exit code."""
    code = EXIT_CODE.search(command.text)
    done = run_line(EXIT_CODE.sub("", command.text), folder)
    if done.returncode != (int(code[1]) if code else 0):
        raise BlockError(f"exit code {done.returncode}\n{done.stdout}")
    return [line.rstrip() for line in done.stdout.splitlines()]


def write_file(block: Block, folder: Path) -> None:
    """Check the syntax of a block; if it has a title, write it to a file."""
    text = "\n".join([*block.lines, ""])
    try:
        if block.kind == "toml":
            tomllib.loads(text)
        elif block.kind == "python":
            ast.parse(text)
    except (tomllib.TOMLDecodeError, SyntaxError) as error:
        raise BlockError(f"line {block.line}: {error}") from None
    if block.title:
        path = folder / block.title
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def run_page(page: Path, folder: Path, write: bool = False) -> list[str]:
    """Run the blocks of a page; return its faults. `write` renews the expected output in the page."""
    text = page.read_text()
    (folder / "jobs").symlink_to(ROOT / "jobs")
    lines, faults, shift = text.splitlines(), [], 0
    for block in blocks(text):
        try:
            if block.kind in FILES:
                write_file(block, folder)
            elif block.kind not in ("console", *NOT_RUN):
                raise BlockError(
                    f"line {block.line}: no language {block.kind!r} (see tests/page_examples.py)"
                )
            runs = commands(block) if block.kind == "console" else []
        except BlockError as error:
            faults.append(f"{page.name}: {error}")
            continue
        for command in runs:
            place = f"{page.name}: line {command.line}: {command.text}"
            try:
                output = run_command(command, folder)
                if not command.expected or matches(command.expected, output):
                    continue
                if not write:
                    changes = difflib.unified_diff(command.expected, output, "page", "output", lineterm="")
                    raise BlockError("\n".join(["other output", *changes]))
                renewed = textwrap.indent("\n".join(renew(command.expected, output)), " " * block.indent)
                start, count = command.line + shift, len(command.expected)
                lines[start : start + count] = renewed.splitlines()
                shift += len(renewed.splitlines()) - count
            except (BlockError, subprocess.TimeoutExpired) as error:
                faults.append(f"{place}: {error}")
    if write and "\n".join([*lines, ""]) != text:
        page.write_text("\n".join([*lines, ""]))
    return faults


def main(arguments: list[str]) -> int:
    """Run the named pages; print their faults and return the number."""
    pages = [Path(word) for word in arguments if word != "--write"] or PAGES
    faults = []
    for page in pages:
        with tempfile.TemporaryDirectory() as folder:
            lines = run_page(page, Path(folder), "--write" in arguments)
        skipped = [
            f"{block.kind or 'plain'} (line {block.line})"
            for block in blocks(page.read_text())
            if block.kind in NOT_RUN
        ]
        print(f"{page}: {len(lines)} faults" + (f"; not run: {', '.join(skipped)}" if skipped else ""))
        faults += lines
    print(*faults, sep="\n")
    return len(faults)


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
