"""`netfall export`: a result in the format that a file's ending names."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from netfall.exchange.formats import endings
from netfall.exchange.lacking import lacking
from netfall.exchange.state import MARK, state_of
from netfall.ground.errors import InputError
from netfall.results.file import telling_what_lacks
from netfall.results.result import Result


def export(source: Path, target: Path, time: float | None, say: Callable[[str], None]) -> None:
    """Write a result to a file, in the format of its ending. time : [s], None: the form; inf: the last frame

    Raises InputError for another ending, a time that there is not, or a file that is no result.
    """
    ending = target.suffix.lower() or ".csv"
    if ending not in endings():
        raise InputError(f"-o {target}: the ending names the format; expected one of {', '.join(endings())}")
    form = import_module(f"netfall.exchange.formats{ending}")
    if not target.parent.is_dir():
        raise InputError(f"-o {target}: the folder {target.parent} does not exist; make it")
    if target.is_dir() != form.FOLDER and target.exists():
        kind = "a folder" if target.is_dir() else "a file"
        raise InputError(f"-o {target}: is {kind} already; give another name")
    if target.is_file() and MARK.encode() not in target.read_bytes():
        raise InputError(f"-o {target}: exists, and is not what netfall exported; give another name")
    if form.AT_REST and time is not None:
        raise InputError(f"--time: a {ending} holds an equilibrium, not a state in motion; leave --time out")
    with Result(source) as result, telling_what_lacks(source):
        lines = form.write(result, state_of(result, time), target)
        if form.HOLDS is not None:
            lines += lacking(result, ending, form.HOLDS)
    for line in lines:
        say(line)
