"""Digests of the results of shipped jobs, and runs of them with the instructions of other processors.

    .venv/bin/python tests/processors.py            compare with digests.toml
    .venv/bin/python tests/processors.py --write    after an intended change of bits

A digest covers the names, types, shapes and bytes of all datasets and attributes except /provenance, and
/modes, whose vectors LAPACK and ARPACK find. Variables of numpy, OpenBLAS, the C library and the compiler
select the instructions of another processor. The exit code is 1 if a digest differs.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import h5py
from results import contents

ROOT = Path(__file__).resolve().parents[1]
MPIRUN = ROOT / ".venv" / "bin" / "mpirun"
DIGESTS = Path(__file__).with_name("digests.toml")
JOBS = {path.stem: path for path in sorted((ROOT / "jobs").glob("*.toml"))}
LEFT_OUT = ("provenance", "modes")
# Without AVX2 and FMA in numpy, OpenBLAS and the C library; the kernels of Haswell.
ANOTHER = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2",
}


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


def main(write: bool) -> int:
    """Run all jobs and print the differences."""
    expected, wrong = ({} if write else stored_digests()), 0
    for name, job in JOBS.items():
        with tempfile.TemporaryDirectory() as folder:
            found = run(job, Path(folder))
        same = found == expected.setdefault(name, found)
        wrong += not same
        print(f"{name:15} {found} {'equal' if same else 'DIFFERS'}", flush=True)
    if write:
        lines = [f'{name} = "{value}"\n' for name, value in sorted(expected.items())]
        DIGESTS.write_text(
            "# Of the results of the jobs in jobs/, by tests/processors.py: whoever changes them says why.\n"
            + "".join(lines)
        )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main("--write" in sys.argv[1:]))
