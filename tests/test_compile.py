"""Compiled kernels on disk: one version of each, made once, and all of them there before an ordinary run."""

import ast
import re
import sys
from collections import Counter

import pytest
from conftest import ENVIRONMENT, ROOT, run_netfall, run_process

from netfall.core import cache

SADDLE = ("run", ROOT / "jobs" / "saddle.toml", "--set", "dynamics.duration=0.05")
SAVED = re.compile(r"\[cache\] data saved to '(.*)'")


def kept(folder) -> dict:
    """The files of compiled code below a folder, and when each was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder that was empty before a run on two ranks, and the files of code that they saved."""
    folder = tmp_path_factory.mktemp("compiled")
    own = {"NUMBA_CACHE_DIR": str(folder), "NUMBA_DEBUG_CACHE": "1"}  # then numba tells what it saves
    done = run_netfall(*SADDLE, "-o", "two.vtkhdf", ranks=2, cwd=folder, environment=own, timeout=900)
    return folder, SAVED.findall(done.stdout)


def test_of_two_ranks_one_compiles(compiled):
    """Each kernel is saved once, though both lack it at the same moment."""
    folder, saved = compiled
    assert len(saved) > 50 and set(Counter(saved).values()) == {1}
    assert {str(path) for path in kept(folder)} == set(saved)


def test_an_ordinary_run_compiles_nothing_more(compiled):
    """Nor does `netfall compile` then; it says where the code is."""
    folder, _ = compiled
    before, own = kept(folder), {"NUMBA_CACHE_DIR": str(folder)}
    run_netfall(*SADDLE, "-o", "one.vtkhdf", cwd=folder, environment=own)
    *groups, last = run_netfall("compile", environment=own).stdout.splitlines()
    assert len(groups) == 4 and all(re.fullmatch(r".+: \d+\.\d s", line) for line in groups)
    assert last.startswith(f"kept in {folder}") and kept(folder) == before


JOBS = ("bicycle", "clamps", "quake", "slide", "stadium", "taps")
IN_ONE_PROCESS = f"""
import sys
from netfall.__main__ import main
from numba.core.dispatcher import Dispatcher
for job in {JOBS}:
    sys.argv = ["netfall", "run", f"{ROOT}/jobs/{{job}}.toml", "-o", "result.vtkhdf", "--quiet"]
    main()
for name, module in sys.modules.copy().items():
    for one in vars(module).values() if name.startswith("netfall") else ():
        if isinstance(one, Dispatcher) and one.stats.cache_path and len(one.signatures) > 1:
            print(name, one.py_func.__qualname__, *one.signatures, sep="\\n    ")
"""


def test_kernels_that_are_kept_have_one_signature(compiled):
    """numba gives two versions one number if two processes compile them at the same time.

    Also of what kernels call: a second version would be a second file.
    """
    folder, _ = compiled
    own = ENVIRONMENT | {"NUMBA_CACHE_DIR": str(folder)}
    done = run_process(sys.executable, "-c", IN_ONE_PROCESS, environment=own, cwd=folder)
    assert done.stdout == ""
    assert [path.name for path in kept(folder) if not path.name.endswith(".1.nbc")] == []


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


def test_constants_of_kernels_stand_in_files_that_the_folder_is_named_by():
    """A kernel has the values of what it imports; else old code would run on after a change."""
    covered, missing, found = set(cache.sources()), [], 0
    for path in cache.PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_bytes())
        used = constants_of_kernels(tree)
        for node in tree.body if used else ():
            if isinstance(node, ast.ImportFrom) and used & {each.name for each in node.names}:
                source = ROOT / "src" / f"{node.module.replace('.', '/')}.py"
                found += 1
                if source.read_bytes() not in covered:
                    missing.append((path.name, node.module))
    assert found > 5 and missing == []
