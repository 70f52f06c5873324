"""Compiled kernels on disk: one version of each, made once, and all there before an ordinary run."""

import ast
import re
import sys
from collections import Counter

import pytest
from conftest import ENVIRONMENT, ROOT, on_ranks, run_process
from other_vectors import OTHER_LANES, python_with
from processors import digest, stored_digests

from netfall.core import cache

# Without the kernels of larger nets, whose signatures are seen where seven jobs run in one process: 13 s less
ORDINARY = ("forms, loads, equilibria, modes", "wind, motion, yield, fracture")
FEWER = f"compile.GROUPS = {{name: compile.GROUPS[name] for name in {ORDINARY}}}"
NETFALL = python_with(OTHER_LANES, 64, f"from netfall.driver import compile\n{FEWER}\nmain()")
SADDLE = ("run", ROOT / "jobs" / "saddle.toml")
SAVED = re.compile(r"\[cache\] data saved to '(.*)'")


def compiled_files(folder) -> dict:
    """The files of compiled code below a folder, and when each was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder that was empty before a run on two ranks, and the files of code that they saved."""
    folder = tmp_path_factory.mktemp("compiled")
    own = ENVIRONMENT | {"NUMBA_CACHE_DIR": str(folder), "NUMBA_DEBUG_CACHE": "1"}  # prints saves
    job = (*SADDLE, "--set", "dynamics.duration=0.05", "-o", "two.vtkhdf")
    done = run_process(*on_ranks(2), *NETFALL, *job, cwd=folder, environment=own, timeout=900)
    return folder, SAVED.findall(done.stdout)


def test_of_two_ranks_one_compiles(compiled):
    """Each kernel is saved once, though both lack it at the same moment."""
    folder, saved = compiled
    assert len(saved) > 30 and set(Counter(saved).values()) == {1}
    assert {str(path) for path in compiled_files(folder)} == set(saved)


def test_an_ordinary_run_compiles_nothing_more(compiled):
    """`netfall compile` does not either. A storm has the same bits with other widths and chunks."""
    folder, _ = compiled
    before, own = compiled_files(folder), ENVIRONMENT | {"NUMBA_CACHE_DIR": str(folder)}
    run_process(*NETFALL, *SADDLE, "-o", "one.vtkhdf", cwd=folder, environment=own)
    assert digest(folder / "one.vtkhdf") == stored_digests()["saddle"]
    *groups, last = run_process(*NETFALL, "compile", environment=own).stdout.splitlines()
    assert len(groups) == len(ORDINARY) and all(re.fullmatch(r".+: \d+\.\d s", line) for line in groups)
    assert last.startswith(f"kept in {folder}") and compiled_files(folder) == before


JOBS = {  # and what makes them shorter: no kernel depends on it
    **dict.fromkeys(("bicycle", "clamps"), "load.tolerance=1e-4"),
    **dict.fromkeys(("quake", "taps"), "dynamics.duration=2.0"),
    "ring": "net.ring.spacing=1.5",
    **dict.fromkeys(("slide", "stadium"), "title=whole"),
}
IN_ONE_PROCESS = f"""
import sys
from netfall.__main__ import main
from numba.core.dispatcher import Dispatcher
for job, shorter in {JOBS}.items():
    line = ["run", f"{ROOT}/jobs/{{job}}.toml", "-o", "result.vtkhdf", "--quiet", "--set", shorter]
    sys.argv = ["netfall", *line]
    main()
modules = [module for name, module in sys.modules.copy().items() if name.startswith("netfall")]
kernels = {{one for module in modules for one in vars(module).values() if isinstance(one, Dispatcher)}}
compiled = [one for one in kernels if one.stats.cache_path and one.signatures]
assert len(compiled) > 40
for one in compiled:
    if len(one.signatures) > 1:
        print(one.py_func, *one.signatures, sep="\\n    ")
"""


def test_cached_kernels_have_one_signature(compiled, tmp_path):
    """numba numbers two versions alike if two processes compile them at once; this includes callees."""
    folder, _ = compiled
    assert run_process(sys.executable, "-c", IN_ONE_PROCESS, cwd=tmp_path).stdout == ""
    assert [path.name for path in compiled_files(folder) if not path.name.endswith(".1.nbc")] == []


def constants_of_kernels(tree: ast.Module) -> set[str]:
    """Names in capitals in functions that are kernels, or parts of them."""
    kernels = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and any(re.search("kernel|routine", ast.unparse(d)) for d in node.decorator_list)
    ]
    names = [one.id for kernel in kernels for one in ast.walk(kernel) if isinstance(one, ast.Name)]
    return {name for name in names if name.isupper()}


def test_constants_of_kernels_are_in_files_of_the_cache_key():
    """A kernel contains imported values. A change of any other file would leave old code in use."""
    covered, missing, count = set(cache.sources()), [], 0
    for path in cache.PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_bytes())
        used = constants_of_kernels(tree)
        for node in tree.body if used else ():
            if isinstance(node, ast.ImportFrom) and used & {each.name for each in node.names}:
                source = ROOT / "src" / f"{node.module.replace('.', '/')}.py"
                count += 1
                if source.read_bytes() not in covered:
                    missing.append((path.name, node.module))
    assert count > 5 and missing == []
