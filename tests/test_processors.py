"""The results of shipped jobs have the same bits on any processor, on any number of ranks."""

import os
import re
import sys

import h5py
import llvmlite.binding
import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks, run_process
from processors import ANOTHER, JOBS, digest, run, stored_digests
from test_output import assert_expected_size, check_output

FEATURES = [name for name, here in llvmlite.binding.get_host_cpu_features().items() if here]
CHANGED = "the bits of {}'s result have changed; if that is meant: tests/processors.py --write, and say why"


def test_every_shipped_job_has_a_digest():
    assert sorted(stored_digests()) == sorted(JOBS)


@pytest.mark.parametrize("name", sorted({*JOBS} - {"wheel_erection"}))  # it is run in test_erection.py
def test_shipped_jobs_have_the_stored_bits(name, tmp_path):
    result = tmp_path / "result.vtkhdf"
    run_on_standing_ranks("run", JOBS[name], "-o", result, "--quiet", cwd=tmp_path)
    assert digest(result) == stored_digests()[name], CHANGED.format(name)
    with h5py.File(result) as f:
        if "history" in f:
            assert np.abs(f["history/work_identity_error"][:]).max() < 1e-10  # of the energy that took part
            for share in ("energy_balance_error", "balance_error_attached"):
                assert np.abs(f[f"history/{share}"][:]).max() < 1e-3
        if "events" in f:
            assert stated_fractures(JOBS[name]) == computed_fractures(f)
        if name in ("ring", "dome"):
            cases = f["cases"].values()
            assert len(cases) == 2 and all(case["stable"][()] for case in cases)
            assert max(case["displacement_error"][()] for case in cases) < 1e-6
    if name in ("quake", "ring_storm", "stadium", "wheel"):
        assert_expected_size(check_output(name), result)
    if name == "stadium":
        readme = (ROOT / "README.md").read_text()
        assert f"breaks the first of {stated_fractures(JOBS[name])[1]} elements" in readme


def stated_fractures(job) -> tuple[str, int, float] | None:
    """Return the fractures in the head of a job: time of the first, number, end; None: no statement."""
    head = " ".join(job.read_text().split("\n\n")[0].replace("#", " ").split())
    first, all_of_them = (
        re.search(words, head)
        for words in (r"[Ff]irst fracture at ([\d.]+) s", r"(\d+) broken elements at ([\d.]+) s")
    )
    return (first[1], int(all_of_them[1]), float(all_of_them[2])) if first else None


def computed_fractures(result) -> tuple[str, int, float] | None:
    """Return the same values of its result."""
    times = result["events/time"][:]
    end = round(float(result["history/time"][-1]), 9)
    return (f"{times[0]:.2f}", len(times), end) if len(times) else None


@pytest.mark.long
@pytest.mark.parametrize("name", JOBS)
def test_shipped_jobs_on_three_ranks_as_on_another_processor(name, tmp_path):
    assert run(JOBS[name], tmp_path, 3, ANOTHER) == stored_digests()[name]


@pytest.mark.skipif("avx2" not in FEATURES, reason="there is nothing to leave out")
def test_the_variables_change_external_functions():
    """Otherwise equal digests would prove nothing: numpy's exponentials differ without newer instructions."""
    own = "import numpy as np; print(np.exp(np.linspace(-30, 30, 99999)).tobytes().hex())"
    outputs = [
        run_process(sys.executable, "-c", own, environment=os.environ | more, cwd=ROOT).stdout
        for more in ({}, ANOTHER)
    ]
    theirs = [np.frombuffer(bytes.fromhex(text.strip())) for text in outputs]
    assert 0 < (theirs[0] != theirs[1]).sum() and np.allclose(theirs[0], theirs[1], rtol=1e-14)


DRAWS = """
from netfall.study.sections import draw
asked = [{"distribution": kind, "mean": 38.0, "deviation": 4.0} for kind in ("normal", "lognormal")]
asked += [{"distribution": kind, "from": 1, "to": 7} for kind in ("uniform", "integer")]
methods = "sobol", "latin_hypercube", "random"
print("".join(draw(method, 1000, 5, asked).tobytes().hex() for method in methods))
"""


def test_draws_of_studies_as_on_another_processor():
    """Draws are part of a study's digest, because shards on several processors belong together."""
    command = [sys.executable, "-W", "ignore", "-c", DRAWS]
    here, elsewhere = (
        run_process(*command, environment=os.environ | more, cwd=ROOT).stdout for more in ({}, ANOTHER)
    )
    assert len(here) == 16 * 4 * 3000 + 1 and here == elsewhere
