"""Definition of commands and their options."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from netfall.cli.values import file


@dataclass(frozen=True)
class Option:
    """An option, or an argument that is given by its position.

    names, settings : arguments of `argparse.ArgumentParser.add_argument`
    """

    names: tuple[str, ...]
    settings: dict[str, Any]


@dataclass(frozen=True)
class Command:
    """A command: a function, whose docstring is the help, and the options that give its arguments."""

    function: Callable[..., None]
    options: tuple[Option, ...]

    @property
    def name(self) -> str:
        """Return the word on the command line."""
        return self.function.__name__.rstrip("_")


def command(*options: Option) -> Callable[[Callable[..., None]], Command]:
    """Make a command of a function and options. Each option gives the argument that bears its name."""
    return lambda function: Command(function, options)


def option(
    name: str,
    value: str | None,
    help: str | None,
    take: Callable[[str], Any] = str,
    several: bool = False,
    **settings: Any,
) -> Option:
    """Define an option with a value, or an argument.

    value : its name in the help, None: the words of `choices`; take : converts its text
    several : whether it may be repeated
    settings : others of `add_argument`; a default is text, which is converted as if it were typed
    """
    if "default" in settings:
        help = f"{help} (default: {settings['default']})"
    if several:
        settings |= {"action": "append", "default": []}
    return Option((name,), {"metavar": value, "help": help, "type": take, **settings})


def flag(*names: str, help: str) -> Option:
    """Define an option without a value."""
    return Option(names, {"action": "store_true", "help": help})


def to_file(help: str, value: str = "FILE") -> Option:
    """Define the option -o for a file to write."""
    return option("-o", value, help, file, dest="output")


def to_folder(help: str, value: str = "DIR", **settings: Any) -> Option:
    """Define the option -o for a folder to write."""
    return option("-o", value, help, Path, dest="folder", **settings)


JOB, RESULT = option("job", "JOB", None, Path), option("result", "RESULT", None, Path)
OVERRIDE = "override a key of the job file; may be repeated"
SET = option("--set", "SECTION.KEY=VALUE", OVERRIDE, several=True, dest="overrides")
JSON = flag("--json", help="print one JSON object in SI units instead of text")
LAUNCHER = option("--launcher", "COMMAND", 'what starts the ranks (default: "mpirun -n {ranks}")')
QUIET = flag("-q", "--quiet", help="print errors only")
VERBOSE = flag("-v", "--verbose", help="print residuals and step limits too")
