"""Malformed jobs and tables, made from the schema itself, and what netfall must answer to each of them.

    .venv/bin/mpirun -n 2 .venv/bin/python tests/bad_inputs.py --cases 400

Every case is run in this process on every rank, as the command line would: exit code 2 on each rank, one line
for each error on rank 0 alone, no traceback, no file left. (One process for all cases: starting Python 800
times would take longer than the answers.)
"""

import argparse
import contextlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
from mpi4py import MPI

from netfall.__main__ import main as netfall
from netfall.job.keys import REQUIRED, Key
from netfall.job.schema import SECTIONS

JOB = {
    "title": {"title": '"bad input"'},
    "net": {"generator": '"saddle"', "cells": "4"},
    "cable": {"modulus": "1.95e11", "area": "683.08e-6", "density": "7850.0", "prestress": "100e3"},
    "form_finding": {},
    "load": {},
    "wind": {"speed": "30.0", "turbulence": "0.2", "base_height": "0.0", "shape_coefficient": "-1.0"},
    "dynamics": {"duration": "0.01"},
    "output": {},
}
NODES = [["id", "x", "y", "z", "fixed", "load_z", "mass"]] + [
    [str(10 * i + j), str(2.0 * i), str(2.0 * j), "0.0", str(int(i in (0, 3) or j in (0, 3))), "0.0", "0.0"]
    for i in range(4)
    for j in range(4)
]
ELEMENTS = [["start", "end", "id", "prestress", "area"]] + [
    [str(a), str(b), str(100 + k), "1e5", "1e-3"]
    for k, (a, b) in enumerate(
        [(10 * i + j, 10 * i + j + 1) for i in range(4) for j in range(3)]
        + [(10 * i + j, 10 * i + j + 10) for i in range(3) for j in range(4)]
    )
]
NUMBERS = {"nodes": ("x", "y", "z", "load_z", "mass"), "elements": ("prestress", "area")}

words = st.text("abcdefghijklmnopqrstuvwxyz_", min_size=1, max_size=12)
nonsense = st.one_of(
    words,
    st.sampled_from(
        ["nan", "inf", "-inf", "1e999", "0x1f", "1,5", "--3", "1e", "٣x", "½", "true", "None", "\x07"]
    ),
)


def text_of(job: dict) -> str:
    """The job as a TOML file."""
    lines = [f"title = {job['title']['title']}"] if "title" in job else []
    for section, keys in job.items():
        if section != "title":
            lines += [f"[{section}]"] + [f"{name} = {value}" for name, value in keys.items()]
    return "\n".join(lines) + "\n"


def table_of(rows: list[list[str]]) -> bytes:
    """Rows as a CSV file."""
    return ("\n".join(",".join(row) for row in rows) + "\n").encode()


def below_and_above(key: Key):
    """Numbers outside the range of a key, and those between integers."""
    whole, found = key.kind == "integer", []
    finite = dict(allow_nan=False, allow_infinity=False)
    if key.low is not None:
        found.append(
            st.integers(max_value=key.low - 1)
            if whole
            else st.floats(max_value=key.low, exclude_max=not key.low_open, **finite)
        )
    if key.high is not None:
        found.append(
            st.integers(min_value=key.high + 1)
            if whole
            else st.floats(min_value=key.high, exclude_min=True, **finite)
        )
    if whole:
        found.append(st.floats(-1e9, 1e9))  # 2.0 is no integer either
    return [strategy.map(repr) for strategy in found]


def wrong_values(key: Key):
    """Values, as they would stand in the file, that the key's row of the schema forbids."""
    always = [st.sampled_from(["{a = 1}", "[[1]]", "1979-05-27", "[[[]]]"])]
    quoted = words.map(lambda w: f'"{w}"')
    if key.kind in ("number", "integer"):
        return st.one_of(
            *always,
            st.sampled_from(["true", "false", "nan", "inf", "-inf", '""', '"1.0"']),
            quoted.filter(lambda w: w[1:-1] not in key.also),
            *below_and_above(key),
        )
    if key.kind == "flag":
        return st.one_of(*always, quoted, st.integers().map(str))
    if key.kind in ("text", "path"):
        return st.one_of(
            *always,
            st.integers().map(str),
            st.sampled_from(["true", '"\\u0000"'] + ([] if key.name == "title" else ['""'])),
        )
    if key.kind == "choice":
        return st.one_of(
            *always,
            quoted.filter(lambda w: w[1:-1] not in key.choices),
            st.integers().map(str),
            st.just("true"),
        )
    numbers = st.lists(st.floats(0, 9), max_size=6)
    lists = (
        numbers.filter(lambda v: len(v) != 3).map(repr)
        if key.kind not in ("points", "places")
        else numbers.filter(len).map(repr)
    )
    return st.one_of(
        *always, quoted, lists, st.sampled_from(["[1, 2, nan]", "[inf, 1, 2]", '[1, 2, "x"]', "true"])
    )


@st.composite
def wrong_key(draw):
    """One key with a value that its row forbids."""
    section = draw(st.sampled_from(sorted(SECTIONS)))
    key = draw(st.sampled_from(SECTIONS[section]))
    job = {name: dict(keys) for name, keys in JOB.items()}
    job.setdefault(section or "title", {})[key.name] = draw(wrong_values(key))
    return {"job.toml": text_of(job).encode()}, key.name


@st.composite
def unknown_name(draw):
    """A key or a section that does not exist."""
    name = draw(
        words.filter(
            lambda w: (
                w not in SECTIONS and not any(w == key.name for keys in SECTIONS.values() for key in keys)
            )
        )
    )
    section = draw(st.sampled_from([s for s in JOB if s != "title"] + [None]))
    job = {key: dict(keys) for key, keys in JOB.items()}
    if section is None:
        job[name] = {"a": "1"}
    else:
        job[section][name] = draw(st.sampled_from(["1", '"a"', "[1, 2]", "true"]))
    return {"job.toml": text_of(job).encode()}, name


@st.composite
def missing_key(draw):
    """A required key or section left out."""
    section, name = draw(
        st.sampled_from(
            [(s, key.name) for s, keys in SECTIONS.items() for key in keys if key.default is REQUIRED]
            + [
                ("net", "generator"),
                ("wind", "speed"),
                ("wind", "shape_coefficient"),
                ("cable", "prestress"),
                ("net", None),
                ("cable", None),
            ]
        )
    )
    job = {key: dict(keys) for key, keys in JOB.items()}
    if name is None:
        del job[section]
    else:
        del job[section][name]
    return {"job.toml": text_of(job).encode()}, name or section


@st.composite
def damaged_job(draw):
    """A job file cut off within its required part, with a byte that is no text, or binary."""
    text = text_of(JOB).encode()
    kind = draw(st.sampled_from(["cut", "byte", "binary"]))
    if kind == "cut":
        return {"job.toml": text[: draw(st.integers(0, text.index(b"density")))]}, ""
    if kind == "byte":
        at = draw(st.integers(0, len(text)))
        return {
            "job.toml": text[:at] + draw(st.sampled_from([b"\xff", b"\x00", b"\xc3\x28"])) + text[at:]
        }, ""
    return {"job.toml": b"\x89HDF\r\n\x1a\n" + draw(st.binary(max_size=200))}, ""


def with_tables(nodes, elements, **files):
    """Files of a job with tables."""
    job = {name: dict(keys) for name, keys in JOB.items()}
    job["net"] = {"nodes": '"nodes.csv"', "elements": '"elements.csv"'}
    return {
        "job.toml": text_of(job).encode(),
        "nodes.csv": table_of(nodes),
        "elements.csv": table_of(elements),
    } | files


@st.composite
def wrong_cell(draw):
    """A cell that is no number, out of range, or names what is not there."""
    name = draw(st.sampled_from(["nodes", "elements"]))
    tables = {"nodes": [list(row) for row in NODES], "elements": [list(row) for row in ELEMENTS]}
    rows = tables[name]
    row = draw(st.integers(1, len(rows) - 1))
    column = draw(st.sampled_from(rows[0]))
    k = rows[0].index(column)
    if column in ("mass", "area"):
        value = draw(
            st.one_of(
                nonsense,
                st.floats(max_value=-1e-300, allow_infinity=False, allow_nan=False).map(repr),
                st.just("0" if column == "area" else "-1"),
            )
        )
    elif column == "fixed":
        value = draw(st.one_of(nonsense, st.sampled_from(["2", "-1", "0.5"])))
    elif column in NUMBERS[name]:
        value = draw(nonsense)
    else:  # id, start, end
        value = draw(st.one_of(nonsense, st.sampled_from(["1.5", "", "99999999999999999999"])))
    if "," in value or value in ("", "\x07"):
        column = ""  # another number of columns, or an empty cell: the line is named
    rows[row][k] = value
    return with_tables(tables["nodes"], tables["elements"]), column


@st.composite
def wrong_table(draw):
    """Mistakes of a whole row or table."""
    nodes, elements = [list(row) for row in NODES], [list(row) for row in ELEMENTS]
    row, other = draw(st.integers(1, len(nodes) - 1)), draw(st.integers(1, len(elements) - 1))
    kind = draw(
        st.sampled_from(
            [
                "duplicate node",
                "duplicate element",
                "dangling",
                "loop",
                "no length",
                "short row",
                "long row",
                "no column",
                "other column",
                "twice",
                "no rows",
                "empty",
                "binary",
                "cut",
                "absent",
                "lonely",
                "no support",
                "pushed",
                "tables alone",
            ]
        )
    )
    files = {}
    if kind == "duplicate node":
        nodes.append(nodes[row])
    elif kind == "duplicate element":
        elements.append(elements[other])
    elif kind == "dangling":
        elements[other][draw(st.integers(0, 1))] = str(draw(st.integers(1000, 10**15)))
    elif kind == "loop":
        elements[other][1] = elements[other][0]
    elif kind == "no length":
        a, b = elements[other][:2]
        place = {r[0]: r for r in nodes[1:]}
        place[b][1:4] = place[a][1:4]
    elif kind == "short row":
        draw(st.sampled_from([nodes, elements]))[row].pop()
    elif kind == "long row":
        draw(st.sampled_from([nodes, elements]))[row].append("1")
    elif kind == "no column":
        table, name = draw(
            st.sampled_from(
                [(nodes, "id"), (nodes, "x"), (nodes, "z"), (elements, "start"), (elements, "end")]
            )
        )
        k = table[0].index(name)
        for line in table:
            del line[k]
    elif kind == "other column":
        table = draw(st.sampled_from([nodes, elements]))
        k = draw(st.integers(0, 1))  # of those that must be there; others are named in a note alone
        table[0][k] = table[0][k] + draw(words)
    elif kind == "twice":
        nodes[0][6] = draw(st.sampled_from(["x", "y", "fixed"]))
    elif kind == "no rows":
        nodes = nodes[:1]
    elif kind == "lonely":
        nodes.append(["777", "1.1", "1.1", "5", "0", "0", "0"])
    elif kind == "no support":
        for line in nodes[1:]:
            line[4] = "0"
    elif kind == "pushed":
        elements[other][3] = "-1e5"
    whole = with_tables(nodes, elements)
    name = draw(st.sampled_from(["nodes.csv", "elements.csv"]))
    if kind == "empty":
        files[name] = draw(st.sampled_from([b"", b"\n\n", b" \n"]))
    elif kind == "binary":
        files[name] = draw(st.sampled_from([b"\xff\xfe", b"\x00\x01", b"PK\x03\x04"])) + draw(
            st.binary(max_size=300)
        )
    elif kind == "cut":
        files[name] = whole[name][: draw(st.integers(0, len(whole[name].splitlines()[0]) - 4))]
    elif kind == "absent":
        files[name] = None
    elif kind == "tables alone":
        files["job.toml"] = whole["job.toml"].replace(b'elements = "elements.csv"\n', b"")
    return whole | files, ""


@st.composite
def absurd(draw):
    """Sizes that no machine holds, and values that do not go together."""
    job = {name: dict(keys) for name, keys in JOB.items()}
    section, key, value = draw(
        st.sampled_from(
            [
                ("net", "cells", "20000"),
                ("dynamics", "duration", "1e300"),
                ("dynamics", "duration", "1e12"),
                ("output", "history", "1e-15"),
                ("output", "checkpoint", "1e-12"),
                ("wind", "time_step", "1e-14"),
                ("dynamics", "time_step", "1e-18"),
                ("dynamics", "time_step", "10.0"),
                ("stadium", "spacing", "1e-6"),
                ("stadium", "spacing", "1e-300"),
                ("stadium", "length", "1e300"),
                ("stadium", "spacing", "1e6"),
                ("cable", "prestress", "1e300"),
                ("cable", "area", "1e-300"),
                ("cable", "density", "1e-300"),
                ("net", "side", "1e-200"),
                ("net", "side", "1e200"),
                ("cable.nogroup", "area", "1.0"),
                ("cable", "yield_stress", "1.0"),
                ("net", "nodes", '"nodes.csv"'),
                ("net", "spacing", "2.0"),
            ]
        )
    )
    if section == "stadium":
        job["net"] = {"generator": '"stadium"'}
        section = "net"
    if (section, key, value) == ("net", "cells", "20000"):
        job["net"]["subdivide"] = "10000"
    job.setdefault(section, {})[key] = value
    return {"job.toml": text_of(job).encode()}, ""


def make_cases(count: int, seed: int) -> list[tuple[dict, str]]:
    """That many different cases, the same for the same seed."""
    cases: dict[bytes, tuple[dict, str]] = {}

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=3 * count,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(
        st.one_of(
            wrong_key(),
            wrong_key(),
            unknown_name(),
            missing_key(),
            damaged_job(),
            wrong_cell(),
            wrong_table(),
            absurd(),
        )
    )
    def collect(case):
        cases.setdefault(repr(sorted(case[0].items(), key=lambda item: item[0])).encode(), case)

    collect()
    every = list(cases.values())
    return every[:: max(1, len(every) // count)][:count]


def answer(arguments: list[str]) -> tuple[object, str]:
    """Exit code and standard error of a netfall command in this process."""
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
    """What is wrong with netfall's answer to a case."""
    found = []
    lines = errors[0].splitlines()
    if set(codes) != {2}:
        found.append(f"exit codes {codes}")
    if not lines or any(errors[1:]):
        found.append("rank 0 alone must speak")
    # what follows the path is to be in one line, free of control characters
    found += [
        f"not a message of its own: {line!r}"
        for line in lines
        if not line.startswith(str(folder)) or re.search(r"[\x00-\x1f]|Traceback|Error:", line)
    ]
    if name and name not in errors[0]:
        found.append(f"does not name {name}")
    left = {p.name for p in folder.iterdir()} - set(files)
    if left:
        found.append(f"left {left}")
    return found


def main() -> None:
    """Run the cases on all ranks; exit code 1 if any is answered wrong."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--cases", type=int, default=400)
    options.add_argument("--seed", type=int, default=1)
    arguments = options.parse_args()
    comm = MPI.COMM_WORLD
    top = Path(comm.bcast(tempfile.mkdtemp(prefix="netfall-bad-") if comm.rank == 0 else None))
    cases = comm.bcast(make_cases(arguments.cases, arguments.seed) if comm.rank == 0 else None)
    wrong = 0
    for number, (files, name) in enumerate(cases):
        folder = top / str(number)
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
            import shutil

            shutil.rmtree(top)
        print(f"{len(cases)} malformed inputs on {comm.size} ranks, {wrong} answered wrong", flush=True)
    sys.exit(comm.bcast(1 if wrong else 0))


if __name__ == "__main__":
    main()
