"""Digests of the results of shipped jobs, and runs of them with the instructions of other processors.

    .venv/bin/python tests/processors.py                  as here; compare with digests.toml
    .venv/bin/python tests/processors.py --like all       as others too: each of LIKE, and all of them at once
    .venv/bin/python tests/processors.py --only stadium --ranks 3
    .venv/bin/python tests/processors.py --write          after an intended change of bits

A digest covers the names, types, shapes and bytes of all datasets and attributes except /provenance, and
/modes, whose vectors LAPACK and ARPACK find. Variables of numpy, OpenBLAS, the C library and the compiler
select the instructions of another processor. The exit code is 1 if a digest differs.
"""

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import h5py
from results import contents

ROOT = Path(__file__).resolve().parents[1]
MPIRUN = ROOT / ".venv" / "bin" / "mpirun"
DIGESTS = Path(__file__).with_name("digests.toml")
JOBS = {path.stem: path for path in sorted((ROOT / "jobs").glob("*.toml"))}
LEFT_OUT = ("provenance", "modes")
LIKE = {
    "numpy without AVX2": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    "OpenBLAS for Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "OpenBLAS for Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "C library without AVX2 and FMA": {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"
    },
    "kernels for Haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2"},
    "kernels for x86-64-v3": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+avx2,+fma,+f16c"},
    "kernels in registers of 128 bits": {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "+sse4.2,+avx,+fma",
    },
}
TOGETHER = {key: value for name in reversed(LIKE) for key, value in LIKE[name].items()}


def digest(result: Path) -> str:
    """Return the digest of a result file."""
    sha = hashlib.sha256()
    with h5py.File(result, "r") as file:
        for name, array in sorted(contents(file).items()):
            if not name.startswith(LEFT_OUT):
                data = array.tobytes() if array.dtype != object else repr(array.tolist()).encode()
                sha.update(f"{name} {array.dtype} {array.shape} ".encode() + data)
    return sha.hexdigest()[:16]


def stored_digests() -> dict[str, str]:
    """Return the digests in the repository by job."""
    return tomllib.loads(DIGESTS.read_text())


def run(job: Path, folder: Path, ranks: int = 1, environment: dict | None = None) -> str:
    """Run a job and return the digest of its result."""
    result = folder / "result.vtkhdf"
    command = [sys.executable, "-m", "netfall", "run", str(job), "-o", str(result), "--quiet"]
    subprocess.run(
        [*([str(MPIRUN), "-n", str(ranks)] if ranks > 1 else []), *command],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")} | (environment or {}),
        check=True,
    )
    return digest(result)


def ways_to_run(options: argparse.Namespace) -> dict:
    """Return functions of a job and a folder that give a digest, by name."""
    like = options.like or []
    variants = {"as here": {}} | {name: LIKE[name] for name in LIKE if {name, "all"} & set(like)}
    if {"all", "together"} & set(like):
        variants |= {"all of them together": TOGETHER}
    of = lambda more: lambda job, folder: run(job, folder, options.ranks, more)
    return {name: of(more) for name, more in variants.items()}


def main() -> int:
    """Run the selected jobs and print the differences."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", choices=JOBS)
    parser.add_argument("--like", action="append", choices=["all", "together", *LIKE])
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    expected, wrong = ({} if options.write else stored_digests()), 0
    for name in options.only or JOBS:
        for like, way in ways_to_run(options).items():
            begin = time.monotonic()
            with tempfile.TemporaryDirectory() as folder:
                digest = way(JOBS[name], Path(folder))
            same = digest == expected.setdefault(name, digest)
            wrong += not same
            took, state = time.monotonic() - begin, "equal" if same else "DIFFERS"
            print(f"{name:15} {digest} {state} {took:6.1f} s  {like}", flush=True)
    if options.write:
        digests = stored_digests() | expected if DIGESTS.exists() else expected
        lines = [f'{name} = "{value}"\n' for name, value in sorted(digests.items())]
        DIGESTS.write_text(
            "# Of the results of the jobs in jobs/, by tests/processors.py: whoever changes them says why.\n"
            + "".join(lines)
        )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
