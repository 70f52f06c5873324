"""Compiled kernels on disk: one version of each, made once, and all of them there before an ordinary run.

All have vectors of another width than elsewhere, so that one compilation also serves the test of their bits.
"""

import ast
import re
from collections import Counter

import pytest
from conftest import ENVIRONMENT, ROOT, on_ranks, run_process
from other_vectors import OTHER_LANES, python_with
from processors import digest
from processors import kept as kept_digests

from netfall.core import cache

NETFALL = python_with(OTHER_LANES, 64)
SADDLE = ("run", ROOT / "jobs" / "saddle.toml")
SAVED = re.compile(r"\[cache\] data saved to '(.*)'")


def kept(folder) -> dict:
    """The files of compiled code below a folder, and when each was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder that was empty before a run on two ranks, and the files of code that they saved."""
    folder = tmp_path_factory.mktemp("compiled")
    own = ENVIRONMENT | {
        "NUMBA_CACHE_DIR": str(folder),
        "NUMBA_DEBUG_CACHE": "1",
    }  # numba tells what is saved
    job = (*SADDLE, "--set", "dynamics.duration=0.05", "-o", "two.vtkhdf")
    done = run_process(*on_ranks(2), *NETFALL, *job, cwd=folder, environment=own, timeout=900)
    return folder, SAVED.findall(done.stdout)


def test_of_two_ranks_one_compiles(compiled):
    """Each kernel is saved once, though both lack it at the same moment."""
    folder, saved = compiled
    assert len(saved) > 40 and set(Counter(saved).values()) == {1}
    assert {str(path) for path in kept(folder)} == set(saved)


def test_an_ordinary_run_compiles_nothing_more(compiled):
    """Nor does `netfall compile` then; it says where the code is.

    The run is a storm in which cables yield and break, and parts fly off: in vectors of another width and in
    chunks of another size it has the same bits.
    """
    folder, _ = compiled
    before, own = kept(folder), ENVIRONMENT | {"NUMBA_CACHE_DIR": str(folder)}
    run_process(*NETFALL, *SADDLE, "-o", "one.vtkhdf", cwd=folder, environment=own)
    assert digest(folder / "one.vtkhdf") == kept_digests()["saddle"]
    *groups, last = run_process(*NETFALL, "compile", environment=own).stdout.splitlines()
    assert len(groups) == 4 and all(re.fullmatch(r".+: \d+\.\d s", line) for line in groups)
    assert last.startswith(f"kept in {folder}") and kept(folder) == before


JOBS = ("bicycle", "clamps", "quake", "slide", "stadium", "taps")
IN_ONE_PROCESS = f"""
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
    python = python_with(OTHER_LANES, 64, IN_ONE_PROCESS)
    done = run_process(*python, environment=own, cwd=folder)
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
