"""Faults made by hand: which of them does a quick set of tests find, and which test?

    python tests/faults.py [--only NAME]... [--part PART]... [--table] [--fresh]

faults.toml contains the faults, each an exact edit of one file and its meaning, and the quick set of tests of
each part of the program, the likely finder first. The command copies source and tests and applies one fault
at a time. Its quick set runs in plain Python (tests/uncompiled) until the first failure, because compilation
would take longer. Each result goes to a journal next to the copy, from which a killed run resumes. A row is
valid while the fault, its file and the names of its tests are unchanged. --table prints a table.
"""

import argparse
import hashlib
import importlib
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACE = Path(tempfile.gettempdir()) / f"netfall-faults-{ROOT.name}"
TREE, JOURNAL = PLACE / "tree", PLACE / "journal.jsonl"
COPIED = ("src", "tests", "jobs", "partitions", "pyproject.toml", "README.md", "CHANGELOG.md", "CITATION.cff")
LIMIT = 90  # CPU s of a quick set
LONGEST = 600  # s, also on a busy processor; a fault may make a run wait for ever
LOADED = ("numba", "numpy", "h5py", "shapely", "scipy.sparse", "pytest", "_pytest.assertion.rewrite")


@dataclass(frozen=True)
class Fault:
    """An edit: `old`, which occurs once in src/netfall/`file`, becomes `new`; tests : the quick set."""

    name: str
    part: str
    file: str
    old: str
    new: str
    means: str
    tests: tuple[str, ...]
    explained: str = ""  # why no test finds it

    def edited(self, source: Path) -> str:
        """Return the file's text with the fault. Raises ValueError unless the old text occurs once."""
        text = (source / "netfall" / self.file).read_text()
        count = text.count(self.old)
        if count != 1:
            raise ValueError(
                f"{self.name}: {self.file}: the old text stands there {count} times; expected once"
            )
        return text.replace(self.old, self.new)

    def key(self, root: Path) -> str:
        """Return a key of the fault, its file and the names of its tests."""
        return hashlib.sha256("\0".join([self.edited(root / "src"), *self.tests]).encode()).hexdigest()[:16]


def read_faults() -> list[Fault]:
    """Return the faults, each with its quick set: tests of its own first, then those of its part."""
    data = tomllib.loads((ROOT / "tests" / "faults.toml").read_text())
    faults = []
    for row in data["fault"]:
        row = dict(row)
        first = row.pop("first", [])
        tests = [*first, *(test for test in data["quick"][row["part"]] if test not in first)]
        faults.append(Fault(**row, tests=tuple(tests)))
    return faults


def fresh_copy() -> None:
    """Copy source and tests to a separate folder."""
    for name in COPIED:
        source, target = ROOT / name, TREE / name
        if source.is_dir():
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "faults.*"))
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    if not (TREE / ".venv").exists():
        (TREE / ".venv").symlink_to((ROOT / ".venv").resolve())


def run_tests(tests: list[str], longest: float = LONGEST) -> dict:
    """Run a quick set in the copy; return the first failed test ("" if none failed) and the duration."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    output = PLACE / "output.txt"
    child = os.fork()
    if child == 0:
        os._exit(in_the_copy(tests, output))
    code = None
    while code is None and time.monotonic() - begin < longest:
        pid, status = os.waitpid(child, os.WNOHANG)
        code = os.waitstatus_to_exitcode(status) if pid else None
        time.sleep(0.05)
    if code is None:
        os.killpg(child, 9)
        os.waitpid(child, 0)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "found": failed_in(output, code),
        "cpu": round(cpu, 1),
        "seconds": round(time.monotonic() - begin, 1),
    }


def in_the_copy(tests: list[str], output: Path) -> int:
    """Return pytest's exit code in a fork of this process, which need not load its modules again."""
    os.setsid()
    file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.chdir(TREE)
    path = [str(TREE / "tests" / "uncompiled"), str(TREE / "src")]
    sys.path[:0] = path
    os.environ["PYTHONPATH"] = os.pathsep.join(path)
    importlib.import_module("sitecustomize")
    import pytest

    options = ["-x", "-q", "-rfE", "-n", "0", "-p", "no:cacheprovider", "--tb=line"]
    return int(pytest.main([*options, *(f"tests/{test}" for test in tests)]))


def failed_in(output: Path, code: int | None) -> str:
    """Return the first failed test as pytest names it, "" if none failed. code : None if it was stopped"""
    if code in (0, None):
        return "" if code == 0 else "waits for ever"
    if code == 4:
        sys.exit(f"{output}: pytest knows no such test")
    rows = (row for row in output.read_text().splitlines() if row.startswith(("FAILED", "ERROR ")))
    row = next(rows, "the tests ended")
    return row.removeprefix("FAILED ").removeprefix("ERROR ").partition(" - ")[0].removeprefix("tests/")


def try_fault(fault: Fault) -> dict:
    """Apply a fault, run its quick set, and restore the file."""
    path = TREE / "src" / "netfall" / fault.file
    original = path.read_text()
    try:
        path.write_text(fault.edited(TREE / "src"))
        return run_tests(list(fault.tests))
    finally:
        path.write_text(original)


def rows_so_far() -> dict[str, dict]:
    """Return the rows of the journal by key."""
    if not JOURNAL.exists():
        return {}
    lines = [line for line in JOURNAL.read_text().splitlines() if line.endswith("}")]
    return {row["key"]: row for row in map(json.loads, lines)}


def known_of(faults: list[Fault], rows: dict[str, dict]) -> tuple[list[tuple[Fault, dict]], str]:
    """Return the rows of these faults, with the faults, and a line of totals."""
    known = [(fault, rows[fault.key(ROOT)]) for fault in faults if fault.key(ROOT) in rows]
    count, left = sum(bool(row["found"]) for _, row in known), len(faults) - len(known)
    return known, f"{count} of {len(known)} faults are found by their quick sets; {left} not run."


def print_table(faults: list[Fault], rows: dict[str, dict]) -> None:
    """Print the finder of each fault as a table."""
    known, total = known_of(faults, rows)
    lines = [
        "# Faults made by hand, and what finds them",
        "",
        "Each fault is an edit in faults.toml.",
        "The quick set of a part of the program stops at the first failure.",
        total,
        "",
        "| part | file | what the fault does | found by | CPU s |",
        "|---|---|---|---|---|",
    ]
    for fault, row in known:
        by = f"`{row['found']}`" if row["found"] else f"**not found** {fault.explained}"
        lines.append(f"| {fault.part} | {fault.file} | {fault.means} | {by} | {row['cpu']:.0f} |")
    print("\n".join(lines))


def options() -> argparse.Namespace:
    """Read the command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--only", action="append", default=[], metavar="NAME", help="faults whose names begin so")
    p.add_argument("--part", action="append", default=[], help="faults of this part of the program")
    p.add_argument("--fresh", action="store_true", help="forget the journal")
    p.add_argument("--table", action="store_true", help="print a table of the journal, and end")
    p.add_argument("--sound", action="store_true", help="run all quick sets without a fault first")
    p.add_argument("--place", type=Path, default=PLACE, help=f"of copy and journal (default: {PLACE})")
    return p.parse_args()


def main() -> None:
    """Try the faults that have no row, or print the table."""
    global TREE, JOURNAL, PLACE
    arguments, faults = options(), read_faults()
    PLACE = arguments.place
    TREE, JOURNAL = PLACE / "tree", PLACE / "journal.jsonl"
    for fault in faults:
        fault.edited(ROOT / "src")
    if arguments.table:
        print_table(faults, rows_so_far())
        return
    if arguments.fresh:
        JOURNAL.unlink(missing_ok=True)
    fresh_copy()
    for name in LOADED:
        importlib.import_module(name)
    chosen = [f for f in faults if not arguments.only or f.name.startswith(tuple(arguments.only))]
    chosen = [f for f in chosen if not arguments.part or f.part in arguments.part]
    if arguments.sound:
        tests = list(dict.fromkeys(test for fault in chosen for test in fault.tests))
        result = run_tests(tests, 5 * LONGEST)
        print("without a fault:", result, flush=True)
        if result["found"]:
            sys.exit("the quick sets fail without a fault")
    rows = rows_so_far()
    for fault in chosen:
        key = fault.key(ROOT)
        if key not in rows:
            row = {"name": fault.name, "key": key} | try_fault(fault)
            rows[key] = row
            with JOURNAL.open("a") as file:
                file.write(json.dumps(row) + "\n")
            late = "  LONGER THAN THE LIMIT" if row["cpu"] > LIMIT else ""
            print(f"{fault.name}: {row['found'] or 'NOT FOUND'} ({row['cpu']:.0f} CPU s){late}", flush=True)
    print(known_of(faults, rows)[1])


if __name__ == "__main__":
    main()
