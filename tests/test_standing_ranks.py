"""Ranks that persist are as good as new processes: no run affects the next, each failure is reported."""

from conftest import Workshop, assert_same_results, run_on_standing_ranks
from test_parallel import SMALL
from test_study import JOB


def test_a_job_after_others_has_the_bits_of_a_new_process(tmp_path, ranks=2):
    persistent, own = Workshop(tmp_path, standing=True), Workshop(tmp_path)
    small, collapse = persistent.job(SMALL, name="small"), persistent.job(JOB, name="collapse")
    assert len(persistent.run(collapse, ranks=ranks, output="collapse.vtkhdf")["events/step"]) > 3
    done = run_on_standing_ranks(
        "run", small, "--set", "net.saddle.cells=0", ranks=ranks, cwd=tmp_path, code=2
    )
    assert "[net.saddle] cells" in done.stderr
    after = persistent.run(small, ranks=ranks, output="after.vtkhdf")
    assert assert_same_results(after, own.run(small, ranks=ranks, output="own.vtkhdf")) > 20


def test_ranks_that_end_are_detected_and_restarted(tmp_path):
    """A run that ends its process at once, as an unexpected error does, fails. The next one runs."""
    persistent = Workshop(tmp_path, standing=True)
    small = persistent.job(SMALL, name="small")
    line = "run", small, "-o", "/dev/full/x.vtkhdf"
    done = run_on_standing_ranks(*line, cwd=tmp_path / "no such folder", code=None)
    assert done.returncode != 0 and "the ranks ended" in done.stderr and "no such folder" in done.stderr
    assert "final/position" in persistent.run(small)
