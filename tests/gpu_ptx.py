"""Compile the step for a GPU without one, and print the compilers' reports: python gpu_ptx.py FOLDER

A line of JSON for both ways, a net in all blocks or in one: plain products in PTX by their second factor
(such a product may be contracted with a sum), fused operations, registers of a thread, bytes that spill from
registers, seconds of compilation. Needs numba-cuda[cu12].
"""

import json
import re
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numba.cuda.compiler
import numba.cuda.dispatcher
from numba import cuda, types

from netfall.gpu import kernels, scalars

CAPABILITY = (9, 0)  # of an H100
WHOLES = types.Array(types.int64, 2, "C")


def signature():
    """Return the types of the arguments of `kernels.advance`."""
    return WHOLES, types.Array(types.int64, 1, "C"), types.Array(types.uint64, 1, "C")


def registers(ptx: Path) -> tuple[int, int]:
    """Return the registers of a thread, and bytes that spill, as ptxas reports them."""
    (place,) = find_spec("nvidia.cuda_nvcc").submodule_search_locations
    command = [f"{place}/bin/ptxas", "-c", "-v", "-arch=sm_90", ptx, "-o", ptx.with_suffix(".cubin")]
    report = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    spilled = sum(map(int, re.findall(r"(\d+) bytes spill", report)))
    return int(re.search(r"Used (\d+) registers", report)[1]), spilled


def main():
    """Compile and print."""
    here = SimpleNamespace(compute_capability=CAPABILITY)
    for module in (numba.cuda.dispatcher, numba.cuda.compiler):  # asks a device for no more than this
        module.get_current_device = lambda: here
    reports = {}
    for name in ("grid", "blocks"):
        begin = time.perf_counter()
        function = scalars.make_translator(cuda, name == "blocks").plain(kernels.advance)
        text, _ = cuda.compile(function, signature(), device=False, cc=CAPABILITY, output="ptx", abi="numba")
        seconds = time.perf_counter() - begin
        path = Path(sys.argv[1]) / f"{name}.ptx"
        path.write_text(text)
        count, spilled = registers(path)
        products = sorted(set(re.findall(r"mul\.f64\s+\S+ \S+ ([^;]+);", text)))
        report = {"products": products, "fused": text.count("fma.rn.f64"), "registers": count}
        reports[name] = report | {"spilled": spilled, "seconds": round(seconds, 1)}
    print(json.dumps(reports))


if __name__ == "__main__":
    main()
