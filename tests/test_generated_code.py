"""The compiled code of the pass over chunks of particles, and its bits with other vectors and chunks."""

import os
import re

import llvmlite.binding as llvm
import pytest
from conftest import run_process
from numba import cfunc, types
from other_vectors import python_with
from processors import JOBS, ROOT, digest, stored_digests

from netfall.core.kernels import OPTIONS
from netfall.core.vectors import LANES
from netfall.explicit.loop import elastic_forces, general_forces, move_any, move_plain, yielding_forces

VECTOR = r"<\d+ x double>"


ROUTINES = {one.function.__name__: one for one in (elastic_forces, yielding_forces, general_forces)}
ROUTINES |= {one.function.__name__: one for one in (move_plain, move_any)}


@pytest.fixture(scope="module", params=ROUTINES)
def text(request) -> str:
    """Return the optimised code of a routine that steps a chunk, in LLVM's language."""
    step = ROUTINES[request.param]
    return cfunc(types.int64(*step.kinds), **OPTIONS)(step.function).inspect_llvm()


def products_that_are_added(text: str) -> list[str]:
    """Return lines that add or subtract a product of vectors of the same function."""
    result, products = [], set()
    for line in text.splitlines():
        if line.startswith("define"):
            products = set()
        product = re.match(rf"\s*(%[\w.]+) = fmul (?:\w+ )*{VECTOR} ", line)
        if product:
            products.add(product[1])
        added = re.match(rf"\s*%[\w.]+ = f(?:add|sub) (?:\w+ )*{VECTOR} (.*)", line)
        if added and products & set(re.findall(r"%[\w.]+", added[1])):
            result.append(line.strip())
    return result


def test_products_are_added_only_by_fma(text):
    """A compiler has nothing to contract, so the bits are those of a GPU too."""
    assert len(re.findall(rf"fmul (?:\w+ )*{VECTOR}", text)) >= 2  # the pass is in it
    assert products_that_are_added(text) == []


def test_the_compiler_does_not_contract_operations(text):
    """Machine code has about the given number of fused operations, and no flag allows more."""
    assert not re.search(r"f(?:add|sub|mul|div) (?:fast|contract|reassoc|nnan|ninf)", text)
    expected = len(re.findall(rf"call {VECTOR} @llvm\.fma\.", text))
    features = llvm.get_host_cpu_features().flatten()
    if "+fma" not in features:
        pytest.skip("the processor has no fused operations")
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=features, opt=3
    )
    made = machine.emit_assembly(llvm.parse_assembly(text))
    registers = ("zmm", "ymm") if LANES == 8 else ("ymm", "xmm")  # a vector is in one or in two
    wide, half = (len(re.findall(rf"vfn?m(?:add|sub)\d*pd\s.*%{name}", made)) for name in registers)
    # equal operations become one, and the compiler writes a few blocks twice
    assert 0.9 * expected < wide + half // 2 < 1.05 * expected + 2


@pytest.mark.long
def test_the_bits_do_not_depend_on_the_width_of_vectors_or_the_size_of_chunks(tmp_path):
    """A storm with fractures, in wide vectors and large chunks. Others: test_compile.py."""
    result = tmp_path / "result.vtkhdf"
    own = os.environ | {"PYTHONPATH": str(ROOT / "src"), "NUMBA_CACHE_DIR": str(tmp_path)}
    run_process(*python_with(16, 4096), "run", JOBS["saddle"], "-o", result, "--quiet", environment=own)
    assert digest(result) == stored_digests()["saddle"]
