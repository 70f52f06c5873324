"""Form finding: the start, the unstressed lengths, the end of the iterations.
Its forms: test_validation_statics.py.
"""

from pathlib import Path

import numpy as np
import pytest
from conftest import STEEL, StopAfter
from mpi4py import MPI

from netfall.errors import Interrupted
from netfall.job.read import read_job
from netfall.solve import large_form, newton
from netfall.solve.outcome import NotFound
from netfall.solve.setup import prepare
from netfall.timings import Phases


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


JOBS = Path(__file__).resolve().parents[1] / "jobs"
NEVER_LARGE = 10**9


@pytest.fixture
def form_of(monkeypatch):
    """The form of a job: as of a net that is large from so many particles on; options : of `prepare`."""

    def find(job, large, *settings, **options):
        monkeypatch.setattr(newton, "LARGE", large)
        job = read_job(JOBS / f"{job}.toml", list(settings))
        return prepare(MPI.COMM_SELF, job, Phases(), **options).form

    return find


@pytest.mark.parametrize("job", ["stadium", "stadium_whole", "ring"])
def test_newton_s_method_finds_the_form_that_relaxation_finds(form_of, job):
    """Flat at the start. Relaxed to 1e-10 of the prestress it is right to some 1e-7 of the net's extent:
    a residual of 1e-10 T over the net's 50 spacings, squared.
    """
    settings = "form_finding.modulus_factor=1e-3", "form_finding.tolerance=1e-10"
    relaxed, found = form_of(job, NEVER_LARGE, *settings), form_of(job, 0, *settings)
    assert found.iterations < 100 < relaxed.iterations
    assert np.abs(found.x - relaxed.x).max() < 1e-7 * np.ptp(relaxed.x)
    assert np.abs(found.N - relaxed.N).max() < 1e-7 * relaxed.N.max()
    assert found.residual <= 1e-10 * found.reference


def test_what_newton_s_method_does_not_find_is_relaxed(form_of, monkeypatch):
    """At constant tension, and where it gives up on the way: the bits of relaxation alone."""

    def give_up(newton, *_):
        newton.net.x[:] += 1.0
        raise NotFound

    monkeypatch.setattr(large_form.Newton, "find", give_up)
    for factor in 0, 1e-3:
        settings = f"form_finding.modulus_factor={factor}"
        relaxed, found = form_of("ring", NEVER_LARGE, settings), form_of("ring", 0, settings)
        assert np.array_equal(relaxed.x, found.x) and relaxed.iterations == found.iterations


def test_form_and_equilibria_of_a_large_net_have_the_same_bits_on_any_ranks(shared_workshop):
    """A saddle of 10,305 particles, loaded until it goes by parts of the load; one rank's bits on three."""
    load = "[load]\nself_weight = true\npressure = [0.0, 0.0, 1e3]\nsteps = 1\n"
    job = f'[net]\ngenerator = "saddle"\ncells = 100\n{STEEL}[form_finding]\n{load}'
    job = shared_workshop.job(job, name="large")
    one = shared_workshop.run(job, output="one.vtkhdf")
    three = shared_workshop.run(job, ranks=3, output="three.vtkhdf")
    form, steps = one["form_finding"], one["statics"]
    assert len(form["position"]) >= newton.LARGE and form["iterations"][()] < 100
    assert not steps["relaxed"][:].any() and steps["iterations"][:].max() > 60
    for group in "form_finding", "statics":
        assert all(np.array_equal(one[group][name][()], three[group][name][()]) for name in one[group])


def test_the_form_of_a_large_net_can_be_interrupted(form_of, tmp_path):
    """A run asked to stop between two corrections leaves a checkpoint that begins anew, to the same bits."""
    net = "ring", 0, "form_finding.modulus_factor=1e-3"
    with pytest.raises(Interrupted, match="in form finding, iteration 0") as stopped:
        form_of(*net, stop=StopAfter(1), result=tmp_path / "result.vtkhdf")
    checkpoint = Path(str(stopped.value).split("--restart ")[1])
    assert np.array_equal(form_of(*net, restart=checkpoint).x, form_of(*net).x)
