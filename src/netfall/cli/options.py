"""Definition of commands and their options, and conversion of values from the text of the command line."""

import argparse
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from netfall.cli import messages
from netfall.core.errors import InputError

MIN_POSITIVE = 1e-300  # smallest value that counts as > 0
DURATION = re.compile(r"(\d+):(\d+):(\d+)")
SIZE, LEAST_PIXELS, MOST_PIXELS = re.compile(r"(\d+)x(\d+)"), 300, 8000
SHARD = re.compile(r"(\d+)/(\d+)")


def argument_error(text: str, expected: str) -> argparse.ArgumentTypeError:
    """Return the error for an invalid text of an option."""
    return argparse.ArgumentTypeError(f"{text}: expected {expected}")


def file(text: str) -> Path:
    """Return the path of a file to write."""
    if text.endswith(os.sep) or not text:
        raise argparse.ArgumentTypeError(f"{text!r}: is a folder; expected the name of a file")
    return Path(text)


def count(text: str, least: int = 1) -> int:
    """Return a whole number >= least."""
    if not text.isdigit() or int(text) < least:
        raise argument_error(text, f"a whole number >= {least}")
    return int(text)


def counts(text: str) -> list[int]:
    """Return different whole numbers >= 1, in ascending order."""
    return sorted({count(word.strip()) for word in text.split(",")})


def words(text: str) -> list[str]:
    """Return names separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def bounded_number(text: str, low: float, high: float, what: str) -> float:
    """Return a number within limits; what : its description for messages"""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argument_error(text, what)
    return value


number = partial(count, least=0)
length = partial(bounded_number, low=MIN_POSITIVE, high=1e3, what="a length > 0 in m")
tension = partial(bounded_number, low=0.0, high=1e12, what="a tension >= 0 in N")
warming = partial(bounded_number, low=-273.0, high=1e3, what="a change of temperature from -273 to 1000 K")
factor = partial(bounded_number, low=MIN_POSITIVE, high=1e3, what="a number > 0")


def time(text: str) -> float:
    """Return seconds; inf for "end"."""
    return bounded_number("inf" if text == "end" else text, 0.0, float("inf"), "a time >= 0 in s, or end")


def view(text: str) -> tuple[float, float] | str:
    """Return elevation and azimuth [degrees], or the name of a view."""
    if text in ("space", "plan", "front", "side"):
        return text
    try:
        elevation, azimuth = map(float, text.split(","))
    except ValueError:
        names = "space, plan, front, side"
        raise argument_error(text, f"{names}, or elevation and azimuth in degrees: 28,-60") from None
    return elevation, azimuth


def size(text: str) -> tuple[int, int]:
    """Return width and height [pixels], even."""
    pixels = [int(part) for part in match.groups()] if (match := SIZE.fullmatch(text)) else []
    if not pixels or not all(LEAST_PIXELS <= length <= MOST_PIXELS for length in pixels):
        raise argument_error(text, f"WIDTHxHEIGHT, {LEAST_PIXELS} to {MOST_PIXELS} pixels each: 1280x720")
    return pixels[0] // 2 * 2, pixels[1] // 2 * 2


def duration(text: str) -> float:
    """Return the seconds of HH:MM:SS."""
    match = DURATION.fullmatch(text)
    if not match:
        raise argument_error(text, "HH:MM:SS")
    hours, minutes, seconds = map(int, match.groups())
    return 3600.0 * hours + 60.0 * minutes + seconds


def shard(text: str) -> tuple[int, int]:
    """Return I and N of I/N."""
    part, parts = map(int, match.groups()) if (match := SHARD.fullmatch(text)) else (0, 0)
    if not 1 <= part <= parts:
        raise argument_error(text, "I/N, the I-th of N parts, for example 2/8")
    return part, parts


def springs(text: str) -> tuple[str, tuple[float, ...]]:
    """Return a layer and stiffnesses (3,) [N/m] of LAYER=K or LAYER=KX,KY,KZ."""
    layer, _, values = text.rpartition("=")
    try:
        stiffness = tuple(float(value) for value in values.split(","))
    except ValueError:
        stiffness = ()
    is_valid = len(stiffness) in (1, 3) and all(0.0 <= k < 1e15 for k in stiffness) and any(stiffness)
    if not layer or not is_valid:
        raise argument_error(text, "LAYER=K or LAYER=KX,KY,KZ, with a stiffness > 0 in N/m")
    return layer.strip(), stiffness * (3 // len(stiffness))


def output_folder(path: Path) -> Path:
    """Return a folder for output, which need not exist yet. Raises InputError if a file is in its place."""
    existing = next((place for place in (path, *path.parents) if os.path.exists(place)), path)
    if os.path.exists(existing) and not existing.is_dir():
        raise InputError(messages.OUTPUT_IS_FILE(path=path, existing=existing))
    return path


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
        """Return the name of the command."""
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
