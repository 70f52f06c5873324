"""Formats of `netfall export`: one file for each, named after its ending. No file depends on another.

A format has
    HOLDS      contents of `export.net_contents` that it holds, None: all
    FOLDER     whether it is a folder of files
    UNITS      whether coordinates may be in another unit than metres
    AT_REST    whether it holds an equilibrium alone, not a state in motion
    write(result, state, path)   writes it, and returns the messages
"""

from pathlib import Path


def endings() -> list[str]:
    """Return the endings of all formats, for example ".csv"."""
    return sorted(f".{path.stem}" for path in Path(__file__).parent.glob("[a-z]*.py"))
