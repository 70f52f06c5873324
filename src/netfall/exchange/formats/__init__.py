"""The formats of `netfall export`: a file for each, named after its ending. No file knows of another.

A format has
    HOLDS      what of `export.of_net` it holds, None: all
    FOLDER     whether it is a folder of files
    UNITS      whether coordinates may be in another unit than metres
    AT_REST    whether it holds an equilibrium alone, not a state in motion
    write(result, state, path)   writes it, and returns what to say
"""

from pathlib import Path


def endings() -> list[str]:
    """All of them, ".csv" for one."""
    return sorted(f".{path.stem}" for path in Path(__file__).parent.glob("[a-z]*.py"))
