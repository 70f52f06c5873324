"""Formats of `netfall export`: one file for each, named after its ending. No file depends on another.

A format defines
    CONTENTS      the entries of `export.net_contents` that it can store, None: all
    FOLDER        whether its output is a folder of files
    UNITS         whether coordinates may be in another unit than metres
    STATIC_ONLY   whether it can store only equilibria, no states in motion
    write(result, state, path, unit)   writes the output, and returns the lines that the command prints
"""

from pathlib import Path


def endings() -> list[str]:
    """Return the endings of all formats, for example ".csv"."""
    return sorted(f".{path.stem}" for path in Path(__file__).parent.glob("[a-z]*.py"))
