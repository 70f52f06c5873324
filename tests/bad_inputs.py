"""Malformed jobs and tables, made from the schema, and a check of netfall's answer to each of them.

    .venv/bin/mpirun -n 2 .venv/bin/python tests/bad_inputs.py 400

Each case runs in this process on every rank. It must end with exit code 2 on each rank, one line for each
error on rank 0 alone, no traceback and no file. One process runs all cases, because 800 starts of Python
would take longer.
"""

import contextlib
import io
import math
import os
import random
import re
import shutil
import sys
import tempfile
from pathlib import Path

from mpi4py import MPI

from netfall.__main__ import main as netfall
from netfall.job.keys.schema import TABLES

JOB = {
    "": {"title": '"bad input"'},
    "net": {"generator": '"saddle"'},
    "net.saddle": {"cells": "4"},
    "cable": {"modulus": "1.95e11", "area": "683.08e-6", "density": "7850.0", "prestress": "100e3"},
    "form_finding": {},
    "load": {},
    "wind": {
        "speed": "30.0",
        "turbulence_intensity": "0.2",
        "base_height": "0.0",
        "pressure_coefficient": "-1.0",
    },
    "dynamics": {"duration": "0.01"},
    "output": {},
}
NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"
ELEMENTS = "start,end\n1,2\n2,3\n"
BAD_TABLES = {
    "duplicate id": (NODES + "2,5,5,5,0\n", ELEMENTS, "line 3 has this id already"),
    "dangling end": (NODES, ELEMENTS + "2,9\n", "no such node"),
    "loop": (NODES, ELEMENTS + "2,2\n", "both node 2"),
    "word for number": (NODES.replace("2,1,0", "2,one,0"), ELEMENTS, "x = 'one': expected a number in m"),
    "nan": (NODES.replace("2,1,0", "2,nan,0"), ELEMENTS, "x = 'nan'"),
    "infinite": (NODES.replace("2,1,0", "2,1e999,0"), ELEMENTS, "x = '1e999'"),
    "empty cell": (NODES.replace("2,1,0", "2,,0"), ELEMENTS, "x is empty"),
    "missing column": (NODES.replace("id,x,y,z", "id,x,y,h"), ELEMENTS, "column z is missing"),
    "column twice": (NODES.replace("fixed", "x"), ELEMENTS, "nodes.csv"),
    "unknown column": (NODES.replace("fixed", "fixd"), ELEMENTS, 'unknown column; did you mean "fixed"?'),
    "short row": (NODES + "4,1\n", ELEMENTS, "2 values, but the header has 5 columns"),
    "long row": (NODES, ELEMENTS + "1,2,3\n", "elements.csv"),
    "fixed is 2": (NODES.replace("1,0,0,0,1", "1,0,0,0,2"), ELEMENTS, "expected 0 or 1"),
    "no length": (NODES.replace("2,1,0", "2,0,0"), ELEMENTS, "has no length"),
    "lonely node": (NODES + "4,1,1,1,0\n", ELEMENTS, "nodes.csv: node 4 belongs to no element"),
    "no rows": ("id,x,y,z\n", ELEMENTS, "no rows below the header"),
    "empty file": ("\n", ELEMENTS, "empty; expected a header"),
    "id not an integer": (NODES.replace("\n2,", "\n2.5,"), ELEMENTS, "expected an integer"),
    "negative area": (NODES, "start,end,area\n1,2,-1\n2,3,1\n", "area = '-1': expected a number >= 1e-12 m2"),
    "cable pushed": (NODES, "start,end,prestress\n1,2,-5\n2,3,-5\n", "a cable carries no compression"),
    "no support": (NODES.replace(",1\n", ",0\n"), ELEMENTS, "has no support"),
    "part without support": (NODES + "4,5,5,0,0\n5,6,5,0,0\n", ELEMENTS + "4,5\n", "has no support"),
    "binary": ("\x00\x01\x02", ELEMENTS, "nodes.csv"),
}  # fmt: skip
NONSENSE = (
    *("nan", "inf", "-inf", "1e999", "0x1f", "1,5", "--3", "1e"),
    *("٣x", "½", "true", "None", "\x07", "a_b"),
)
# Sizes that no machine holds, values that do not go together.
ABSURD = (
    *("dynamics.duration=1e300", "dynamics.duration=1e12", "dynamics.time_step=1e-18", "cable.area=1e-300"),
    *("dynamics.time_step=10.0", "output.history_interval=1e-15", "output.checkpoint_interval=1e-12"),
    *("wind.time_step=1e-14", "cable.prestress=1e300", "cable.density=1e-300", "net.saddle.side=1e-200"),
    *("net.saddle.side=1e200", "net.spacing=2.0", "group.nogroup.area=1.0", "cable.yield_stress=1.0"),
    *('net.nodes="nodes.csv"', "net.stadium.spacing=1e-6", "net.stadium.spacing=1e-300"),
    *("net.stadium.length=1e300", "net.stadium.spacing=1e6"),
)


def text_of(job: dict) -> str:
    """Return the job as a TOML file."""
    lines = []
    for section, keys in job.items():
        lines += [f"[{section}]"] * bool(section) + [f"{name} = {value}" for name, value in keys.items()]
    return "\n".join(lines) + "\n"


def wrong_values(key) -> list[str]:
    """Return values, as in the file, that the schema forbids for a key."""
    values = ["[[1]]", "{a = 1}"]
    if key.kind in ("number", "integer", "vector", "points"):
        values += ['"fast"', '"1.0"', "true", "nan", "inf", "-inf", "1979-05-27"]
    if key.kind == "integer":
        values += ["1.5", "1e3"]
    if key.kind in ("number", "integer"):
        if key.low is not None:
            values += [str(key.low - 1)] + ([str(key.low)] if key.low_open else [])
        if key.high is not None:
            values += [str(key.high + 1 if key.kind == "integer" else math.nextafter(key.high, math.inf))]
    if key.kind == "vector":
        values += ["[1, 2]", '[1, 2, "x"]', "[1, 2, nan]", "[1, 2, 1e300]"]
    if key.kind == "pressure":
        values += ["[1, 2]", "nan", '"up"', "true", "1e300", "[1e300, 0, 0]"]
    if key.kind == "points":
        values += ["[1, 2]", "[[1, 2, 3]]", "[[1, inf]]", "[[1, 1e300]]"]
    if key.kind == "places":
        values += ["[true]", "[1.5]", '["a"]', "[[1, 2, 3, 4]]", "[[1, inf]]", "3"]
    if key.kind == "choice":
        values += ['"nonsense"', "1", "true", '""']
    if key.kind == "flag":
        values += ["1", '"yes"']
    if key.kind in ("text", "path"):
        values += ["1", "true"] + ([] if key.name == "title" else ['""'])
    return values


def changed(section: str, name: str | None, value: str | None) -> dict[str, bytes]:
    """Return the job with another value of a key, without the key, or without the section."""
    job = {each: dict(keys) for each, keys in JOB.items()}
    if section.startswith("net.") and section != "net.saddle":
        del job["net.saddle"]
        job["net"] = {"generator": f'"{section.removeprefix("net.")}"'}
    if name is None:
        del job[section]
    elif value is None:
        del job[section][name]
    else:
        job.setdefault(section, {})[name] = value
    return {"job.toml": text_of(job).encode()}


def with_tables(nodes: str, elements: str) -> dict[str, bytes]:
    """Return the files of a job with tables."""
    job = text_of(JOB | {"net": {"nodes": '"nodes.csv"', "elements": '"elements.csv"'}})
    return {"job.toml": job.encode(), "nodes.csv": nodes.encode(), "elements.csv": elements.encode()}


def wrong_cell(pick: random.Random) -> dict[str, bytes]:
    """Return tables with a cell that is not a number, which may change the number of cells in a row."""
    tables = {"nodes": NODES, "elements": "start,end,id,prestress,area\n1,2,100,1e5,1e-3\n2,3,101,1e5,1e-3\n"}
    name = pick.choice(list(tables))
    rows = [line.split(",") for line in tables[name].splitlines()]
    row = pick.choice(rows[1:])
    row[pick.randrange(len(row))] = pick.choice(NONSENSE)
    tables[name] = "\n".join(map(",".join, rows)) + "\n"
    return with_tables(**tables)


def damaged(pick: random.Random) -> dict[str, bytes]:
    """Return a job or a table that is truncated, contains a byte that is no text, or is binary."""
    files = with_tables(NODES, ELEMENTS)
    name = pick.choice(list(files))
    text = files[name]
    end = text.index(b"density") if name == "job.toml" else len(text.splitlines()[0]) - 4
    at = pick.randrange(len(text))
    files[name] = pick.choice((
        text[: pick.randrange(end)],
        text[:at] + pick.choice((b"\xff", b"\x00", b"\xc3\x28")) + text[at:],
        b"\x89HDF\r\n\x1a\n" + pick.randbytes(200),
        None,
    ))  # fmt: skip
    return files


def make_case(pick: random.Random) -> tuple[dict[str, bytes | None], str]:
    """Return files (None: absent) and a name that the answer must contain."""
    every = [(section, key) for section, keys in TABLES.items() for key in keys]
    needed = [(section, key.name) for section, key in every if key.required and section in JOB]
    needed += [
        ("net", "generator"),
        ("wind", "speed"),
        ("cable", "prestress"),
        ("net", None),
        ("cable", None),
    ]
    kind = pick.choice(("key", "key", "unknown", "missing", "damaged", "cell", "table", "absurd"))
    if kind == "key":
        section, key = pick.choice(every)
        return changed(section, key.name, pick.choice(wrong_values(key))), key.name
    if kind == "unknown":
        name = "".join(pick.choices("abcdefghijklmnopqrstuvwxyz_", k=9))
        return changed(pick.choice([*JOB][1:]), name, pick.choice(("1", '"a"', "[1, 2]", "true"))), name
    if kind == "missing":
        section, name = pick.choice(needed)
        return changed(section, name, None), name or section
    if kind == "table":
        nodes, elements, _ = BAD_TABLES[pick.choice(list(BAD_TABLES))]
        return with_tables(nodes, elements), ""
    if kind == "absurd":
        place, _, value = pick.choice(ABSURD).partition("=")
        section, _, name = place.rpartition(".")
        return changed(section, name, value), ""
    return (damaged if kind == "damaged" else wrong_cell)(pick), ""


def answer(arguments: list[str]) -> tuple[object, str]:
    """Return exit code and standard error of a netfall command in this process."""
    error = io.StringIO()
    sys.argv = ["netfall", *arguments]
    os._exit = sys.exit  # an unexpected error on one rank is to be seen here
    with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
        try:
            netfall()
            code = 0
        except SystemExit as done:
            code = done.code
    return code, error.getvalue()


def complaints(folder: Path, files: dict, name: str, codes: list, errors: list[str]) -> list[str]:
    """Return the faults of netfall's answer to a case."""
    faults = []
    lines = errors[0].splitlines()
    if set(codes) != {2}:
        faults.append(f"exit codes {codes}")
    if not lines or any(errors[1:]):
        faults.append("rank 0 alone must speak")
    # what follows the path is to be in one line, free of control characters
    faults += [
        f"not a message of its own: {line!r}"
        for line in lines
        if not line.startswith(f"error: {folder}") or re.search(r"[\x00-\x1f]|Traceback|Error:", line)
    ]
    if name and name not in errors[0]:
        faults.append(f"does not name {name}")
    left = {p.name for p in folder.iterdir()} - set(files)
    if left:
        faults.append(f"left {left}")
    return faults


def main(cases: int) -> None:
    """Run a number of cases on all ranks; the exit code is 1 if an answer is wrong."""
    comm, pick, wrong = MPI.COMM_WORLD, random.Random(1), 0
    top = Path(comm.bcast(tempfile.mkdtemp(prefix="netfall-bad-") if comm.rank == 0 else None))
    for number in range(cases):
        (files, name), folder = make_case(pick), top / str(number)
        if comm.rank == 0:
            folder.mkdir()
            for file, content in files.items():
                if content is not None:
                    (folder / file).write_bytes(content)
        comm.Barrier()
        code, error = answer(["run", str(folder / "job.toml"), "-o", str(folder / "result.vtkhdf")])
        codes, errors = comm.gather(code), comm.gather(error)
        if comm.rank == 0:
            for complaint in complaints(folder, files, name, codes, errors):
                wrong += 1
                print(f"case {folder}: {complaint}: {errors[0][:300]!r}", flush=True)
    if comm.rank == 0:
        if not wrong:
            shutil.rmtree(top)
        print(f"{cases} malformed inputs on {comm.size} ranks, {wrong} answered wrong", flush=True)
    sys.exit(comm.bcast(1 if wrong else 0))


if __name__ == "__main__":
    main(int(sys.argv[1]))
