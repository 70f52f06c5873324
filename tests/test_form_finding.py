"""Form finding: the start, the unstressed lengths, the end of the iterations.
Its forms: test_validation_statics.py.
"""

import numpy as np
import pytest
from conftest import STEEL


@pytest.mark.parametrize("start", ["given", "force_density"])
def test_start_does_not_matter_at_constant_tension(workshop, start):
    """The same form from the flat start and from the force-density one."""
    f = workshop.run(
        workshop.job(
            f'[net]\ngenerator = "saddle"\n{STEEL}[form_finding]\n'
            f'modulus_factor = 0\ntolerance = 1e-10\nstart = "{start}"\n'
        )
    )
    x = f["form_finding/position"][:]
    row = np.flatnonzero((np.abs(x[:, 0]) < 1e-6) & (x[:, 1] > 26) & (x[:, 1] < 30))
    assert abs(x[row[0], 1] - 26.92) < 0.005  # the particle nearest the edge slides from y = 27.45 (theory)


def test_unstressed_lengths_in_closed_form(workshop):
    """L0 = L / (1 + N / EA), and L exp(-N / EA) for the logarithmic strain."""
    for strain, law in (
        ("engineering", lambda L, e: L / (1 + e)),
        ("logarithmic", lambda L, e: L * np.exp(-e)),
    ):
        f = workshop.run(
            workshop.job(
                f'[net]\ngenerator = "saddle"\ncells = 4\n{STEEL}strain = "{strain}"\n'
                f"[form_finding]\nmodulus_factor = 0\n"
            )
        )
        x, elements = f["form_finding/position"][:], f["net/elements"][:]
        L = np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1)
        assert np.allclose(
            f["form_finding/unstressed_length"][:], law(L, 100e3 / (1.95e11 * 683.08e-6)), rtol=1e-14
        )


def test_iterations_that_run_out_end_the_run(workshop):
    """Not in equilibrium: exit code 3, a line that says how far it came, no file."""
    job = workshop.job('[net]\ngenerator = "saddle"\n' + STEEL + "[form_finding]\nmax_iterations = 20\n")
    done = workshop.run(job, code=3)
    assert "not in equilibrium after 20 iterations" in done.stderr
    assert {p.name for p in workshop.folder.iterdir()} == {"job.toml"}


def test_a_subdivided_net_has_the_form_of_the_net_as_given(both_ways):
    """At constant tension nothing keeps the new nodes apart: they are spaced evenly on straight lines."""
    job = '[net]\ngenerator = "saddle"\nside = 20.0\nrise = 2.0\ncells = 4\nsubdivide = {}\n' + STEEL
    form = "[form_finding]\nmodulus_factor = 0\ntolerance = 1e-9\n"
    whole = both_ways.run(both_ways.job(job.format(1) + form, name="whole"))
    parts = both_ways.run(both_ways.job(job.format(40) + form, name="parts"), output="parts.vtkhdf")
    x, elements = parts["form_finding/position"][:], parts["net/elements"][:]
    given = whole["form_finding/position"][:]
    assert np.array_equal(x[: len(given)], given)
    L = np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1).reshape(-1, 40)
    assert np.ptp(L, axis=1).max() < 1e-13 * L.max() * 40  # rounding of places, some 10 m
    assert parts["form_finding/residual_real_material"][()] < 1.1e-9  # as asked, in the divided net too
