"""Compiles the step for a GPU without one, and prints what the compilers say: python gpu_ptx.py FOLDER

A line of JSON: plain products in PTX by their second factor (such a product may be contracted with a sum),
fused operations, registers of a thread, bytes that spill from registers, seconds of compilation.
Needs numba-cuda[cu12].
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

from netfall.core.records import RecordType
from netfall.explicit.loop import Interval, LoopState
from netfall.gpu import kernels, stepper, target

CAPABILITY = (9, 0)  # of an H100
ARRAY = types.Array(types.float64, 2, "C")
COUNTS = types.Array(types.int64, 1, "C")


def device_type(kind):
    """Type on the device of a field of a record."""
    if isinstance(kind, RecordType):
        fields = [device_type(field) for field in kind.fields.values()]
        return types.NamedTuple(fields, target.tuple_of(kind))
    return kind


def signature():
    """Types of the arguments of `kernels.advance`."""
    numbers = {int: types.int64, float: types.float64, bool: types.boolean}
    interval = types.NamedTuple([numbers[kind] for kind in stepper.KINDS], Interval)
    loop = LoopState.kind.fields
    own = {"absent": ARRAY, "y": ARRAY, "counts": COUNTS, "result": COUNTS}
    own |= dict.fromkeys(("traits", "breaks", "width"), types.int64)
    own |= {name: loop["fractures"].fields[name] for name in ("rules", "events")}
    work = [device_type(own.get(name) or loop[name]) for name in kernels.Work._fields]
    return interval, types.NamedTuple(work, kernels.Work)


def registers(ptx: Path) -> tuple[int, int]:
    """Registers of a thread, and bytes that spill, as ptxas reports them."""
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
    begin = time.perf_counter()
    function = stepper.make_translator(cuda).plain(kernels.advance)
    text, _ = cuda.compile(function, signature(), device=False, cc=CAPABILITY, output="ptx", abi="numba")
    seconds = time.perf_counter() - begin
    path = Path(sys.argv[1]) / "advance.ptx"
    path.write_text(text)
    count, spilled = registers(path)
    products = sorted(set(re.findall(r"mul\.f64\s+\S+ \S+ ([^;]+);", text)))
    report = {"products": products, "fused": text.count("fma.rn.f64"), "registers": count}
    print(json.dumps(report | {"spilled": spilled, "seconds": round(seconds, 1)}))


if __name__ == "__main__":
    main()
