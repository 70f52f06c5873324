"""The parser of the command line, made of the functions of the commands."""

import argparse
import functools
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import netfall
from netfall.cli import messages
from netfall.cli.docs import docs
from netfall.cli.jobs import check, compile, init, partition, run, schema
from netfall.cli.options import QUIET, VERBOSE
from netfall.cli.results import export, import_, info, plot, report, view
from netfall.cli.studies import scale, study, trade
from netfall.core.errors import InputError
from netfall.core.progress import print_lines
from netfall.job.values import suggest

COMMANDS = {  # in the order of the help
    command.name: command
    for command in (
        *(init, schema, check, partition, run, info, plot, view, report, scale, trade, study),
        *(import_, export, compile, docs),
    )
}
EPILOG = """\
exit codes:
  0 finished; 2 wrong job or input; 3 diverged, or no equilibrium; 4 interrupted, with a checkpoint;
  1 any other error

netfall COMMAND --help prints the options of a command, with examples."""

RENAMED_OPTIONS = {"--member": "--sample"}  # by version 0.5: old name, new name


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        raise InputError(messages.WRONG_ARGUMENTS(program=self.prog, reason=message))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse words like argparse. Raises InputError for unknown words, with the nearest option."""
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown and unknown[0].startswith("-"):
            options = set(re.findall(r"--\w[\w-]*", self.format_help()))
            new = RENAMED_OPTIONS.get(unknown[0].partition("=")[0])
            advice = f"since version 0.5 it is {new}" if new else suggest(unknown[0], options)
            raise InputError(messages.UNKNOWN_OPTION(program=self.prog, option=unknown[0], advice=advice))
        if unknown:
            self.error(f"{unknown[0]}: unexpected argument")
        return namespace, unknown


@functools.cache
def parser() -> Parser:
    """Return the parser of all commands and their options."""
    about = "Form finding, load and collapse analysis of cable roofs on MPI ranks."
    layout = argparse.RawDescriptionHelpFormatter
    top = Parser(prog="netfall", description=about, epilog=EPILOG, formatter_class=layout)
    top.add_argument("-V", "--version", action="store_true", help="print the version, MPI and HDF5 in use")
    parsers = top.add_subparsers(dest="command", title="commands", metavar="COMMAND")
    for name, command in COMMANDS.items():
        about, _, examples = inspect.cleandoc(command.function.__doc__ or "").partition("\n\n")
        one = parsers.add_parser(name, help=about, description=about, epilog=examples, formatter_class=layout)
        volume = one.add_mutually_exclusive_group() if VERBOSE in command.options else one
        for option in command.options:
            place = volume if option in (QUIET, VERBOSE) else one
            place.add_argument(*option.names, **option.settings)
    return top


def read_command(words: list[str]) -> Callable[[], None]:
    """Return the command with its arguments. Raises InputError for unknown words and wrong values."""
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        verb = {".toml": "run", ".vtkhdf": "info"}.get(Path(words[0]).suffix)
        advice = f"did you mean netfall {verb} {words[0]}?" if verb else suggest(words[0], COMMANDS)
        raise InputError(messages.UNKNOWN_COMMAND(word=words[0], advice=advice))
    values = vars(parser().parse_args(words))
    name, shows_version = values.pop("command"), values.pop("version")
    if shows_version:
        return print_version
    return functools.partial(COMMANDS[name].function, **values) if name else print_help


def print_version() -> None:
    """Print the versions of netfall and of the libraries in use."""
    from netfall.driver.provenance import library_text

    print_lines(f"netfall {netfall.__version__}, {library_text()}")


def print_help() -> None:
    """Print the help of the command line, and end with the exit code of wrong input."""
    parser().print_help()
    raise SystemExit(InputError.exit_code)
