"""From a fragility curve to annual probabilities: hazard, reliability, criteria of failure; closed forms."""

import re
import tracemalloc

import h5py
import numpy as np
import pytest
from conftest import BIN, ROOT, run_on_standing_ranks, run_process
from scipy import integrate, stats
from study_files import columns, drawn_samples, study_lines, write_study
from test_study_runs import STUDY, write

from netfall.core.errors import InputError
from netfall.job.validate import Validator
from netfall.post.plots.study.study import pictures_of
from netfall.results.datasets import OUTCOMES
from netfall.study.answers import fragility, probit, samples
from netfall.study.answers.fragility import FailureCriterion, curve_sections, failure_section, failures
from netfall.study.answers.hazard import (
    Hazard,
    annual_bounds,
    annual_probability,
    over_years,
    reliability_index,
    tail_share,
)
from netfall.study.answers.read import read_study
from netfall.study.file import read_study_plan
from netfall.study.sections import failure_sections

SPEEDS = (30.0, 34.0, 38.0, 42.0, 46.0)
GUMBEL = Hazard("gumbel", {"mode": 25.0, "scale": 2.5})
WEIBULL = Hazard("weibull", {"shape": 9.0, "scale": 26.0})
EN = Hazard("en1991", {"basic_speed": 30.0, "K": 0.2, "n": 0.5})


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch):
    """Use a fifth of the resamples, for time."""
    monkeypatch.setattr(fragility, "RESAMPLES", 400)
    monkeypatch.setattr(samples, "RESAMPLES", 400)


def one(function, median: float, dispersion: float) -> float:
    return float(annual_probability(function, np.array([median]), np.array([dispersion]))[0])


def criteria(*each):
    """Return criteria of failure as in a study file, from name, outcome and limit of each."""
    return tuple(FailureCriterion(name=name, outcome=outcome, limit=limit) for name, outcome, limit in each)


def write_year(path, samples, own=()):
    """Write a study with a Gumbel hazard; return its sections."""
    sections = curve_sections(samples, own, GUMBEL)
    write_study(path, samples, sections["fragility"], hazard=sections["hazard"])
    return sections


def test_a_power_law_of_speeds_has_a_closed_form():
    """S = (20/v)^8 with median 60 and dispersion 0.1: (1/3)^8 exp(32 * 0.01) = 2.098960e-4."""
    exact = (20.0 / 60.0) ** 8 * np.exp(0.5 * 64 * 0.01)
    assert exact == pytest.approx(2.098960e-4, rel=1e-6)
    assert one(lambda v: (20.0 / v) ** 8, 60.0, 0.1) == pytest.approx(exact, rel=1e-12)  # rounding


@pytest.mark.parametrize(
    "hazard, density",
    [(GUMBEL, stats.gumbel_r(25.0, 2.5).pdf), (WEIBULL, stats.weibull_min(9.0, scale=26.0).pdf)],
)
def test_the_annual_probability_and_its_tail_agree_with_quadrature(hazard, density):
    """The integral of the curve times the density of annual maxima, by scipy's adaptive quadrature."""
    both = lambda v: stats.norm.cdf(np.log(v / 38.0) / 0.1) * density(v)
    whole, below = (integrate.quad(both, 1.0, top, epsabs=0, epsrel=1e-10, limit=400)[0] for top in (120, 31))
    assert one(hazard.exceedance, 38.0, 0.1) == pytest.approx(whole, rel=1e-9)  # of the quadrature
    # The trapezoidal rule meets a corner at 31 m/s: it errs by the square of its step, 1e-4 of the share.
    assert tail_share(hazard.exceedance, 38.0, 0.1, 31.0) == pytest.approx(below / whole, abs=2e-4)


@pytest.mark.filterwarnings("error")
def test_very_wide_curves_have_probabilities_without_overflow():
    """A curve that hardly rises fails at half of all speeds, so P is almost 1/2; speeds end at 10 km/s."""
    for hazard in (EN, Hazard("weibull", {"shape": 2.0, "scale": 20.0})):
        wide = np.array([1e3, 1e6])
        assert annual_probability(hazard.exceedance, np.full(2, 26.0), wide) == pytest.approx(0.5, abs=3e-3)
        assert 0.0 < tail_share(hazard.exceedance, 26.0, 1e3, 25.0) < 1.0


def test_the_code_is_a_gumbel_distribution_of_the_squared_speed():
    """EN 1991-1-4, eq. 4.2: the basic speed has a probability of 0.02 in a year; v(p) returns p, by hand."""
    for p in (0.5, 0.1, 0.02, 1e-3, 1e-6):
        v = 30.0 * ((1 - 0.2 * np.log(-np.log(1 - p))) / (1 - 0.2 * np.log(-np.log(0.98)))) ** 0.5
        assert EN.exceedance(np.array([v]))[0] == pytest.approx(p, rel=1e-9)  # ten digits of 1 - p are lost
    # Known figures of a stadium's curve (median 60.6 m/s, dispersion 0.079), by quadrature elsewhere.
    for basic, known in ((30.0, 2.24e-10), (32.5, 5.82e-9), (35.0, 8.83e-8)):
        hazard = EN._replace(parameters={**EN.parameters, "basic_speed": basic})
        assert one(hazard.exceedance, 60.6, 0.079) == pytest.approx(known, rel=2e-3)  # their digits


def test_many_years_and_the_reliability_index():
    """1 - (1 - P)^N without loss of digits; beta of EN 1990's 1e-6 and 7.2e-5 in table B2's pairs."""
    assert over_years(np.array(1e-12), 50) == pytest.approx(5e-11, rel=1e-9)
    assert over_years(np.array(0.1), 50) == pytest.approx(1 - 0.9**50, rel=1e-12)
    assert reliability_index(np.array([1e-6, 1.3e-6, 7.2e-5])) == pytest.approx([4.75, 4.7, 3.8], abs=5e-3)
    assert reliability_index(np.array([0.0, np.nan])).tolist()[0] == np.inf


def test_samples_without_a_curve_give_bounds():
    """No failure up to 38 m/s: an upper bound; failures from 38 m/s on: a lower one; separated: both."""
    speed, runs = np.array([34.0, 38.0, 42.0]), np.full(3, 10)
    beyond = GUMBEL.exceedance(speed)
    for failed, low, high in (
        ([0, 0, 0], 0.0, beyond[2]),
        ([10, 10, 10], beyond[0], 1.0),
        ([0, 0, 10], beyond[2], beyond[1]),
        ([0, 4, 10], 0.4 * (beyond[1] - beyond[2]) + beyond[2], 0.4 * (beyond[0] - beyond[1]) + beyond[1]),
        ([5, 3, 1], 0.0, 1.0),
    ):
        bounds = annual_bounds(GUMBEL.exceedance, probit.fit(speed, runs, np.array(failed)))
        assert np.ravel(bounds) == pytest.approx([low, high], rel=1e-12), failed


@pytest.mark.parametrize(("studies", "least"), [(8, 5), pytest.param(100, 83, marks=pytest.mark.long)])
def test_the_interval_contains_the_true_value(studies, least):
    """In 95 % of studies with 50 seeds; fewer than the limit have a probability of 1e-2 at 90 %."""
    generator, truth = np.random.default_rng(8), one(GUMBEL.exceedance, 38.0, 0.1)
    held = 0
    for _ in range(studies):
        samples = drawn_samples(generator, 50, SPEEDS, 38.0, 0.1)
        row = curve_sections(samples, hazard=GUMBEL)["hazard"]
        low, high = row["interval"][0]
        held += low <= truth <= high
    assert held >= least


def test_criteria_of_failure_are_those_of_the_columns():
    """A larger value is a failure, nan is neither. A run without equilibrium has failed by all criteria."""
    samples = drawn_samples(np.random.default_rng(2), 10, SPEEDS, 38.0, 0.1)
    samples["displacement_max"][0], samples["state"][1] = np.nan, "no_equilibrium"
    own = criteria(("much", "displacement_max", 0.4), ("late", "first_fracture", 3.0))
    measures = failures(samples, own)
    expected = samples["displacement_max"] > 0.4
    expected[1] = True
    failed, judged = measures["much"]
    assert list(measures)[-2:] == ["much", "late"] and (failed == expected).all() and not failed[0]
    assert (judged == (np.arange(len(failed)) > 0)).all() and measures["late"].judged.all()
    rows = curve_sections(samples, own)["fragility"]
    at = np.searchsorted(SPEEDS, samples["wind.speed"][0])
    assert rows["runs"][-2, at] == 9 and rows["runs"][-1, at] == 10 and (rows["runs"][-2] <= 10).all()
    assert np.array_equal(failure_section(samples, own)["runs"], [49, 50])


def test_an_outcome_that_no_finished_run_has_is_unknown():
    """Nothing can break in two runs, and two have no equilibrium, which are not two failures of two."""
    samples = columns({}, np.zeros(4), np.zeros(4))
    samples["utilisation_before_break"][:] = np.nan
    samples["state"][2:] = "no_equilibrium"
    own = criteria(("tears", "utilisation_before_break", 1.0))
    assert [failure_section(samples, own)[name][0] for name in ("failed", "runs")] == [0, 0]
    samples["state"][:] = "no_equilibrium"
    assert [failure_section(samples, own)[name][0] for name in ("failed", "runs")] == [4, 4]


def test_drawn_speeds_need_little_memory():
    """Each run has its own speed. The counts of one criterion need 7 MB, those of all criteria 37 MB."""
    generator = np.random.default_rng(2)
    samples = drawn_samples(generator, 500, np.linspace(30.0, 46.0, 2), 38.0, 0.1, shared=False)
    samples = {name: values[:500] for name, values in samples.items()}
    samples["wind.speed"] = generator.uniform(30.0, 46.0, 500)
    tracemalloc.start()
    section = curve_sections(samples, drawn=["wind.speed", "wind.seed"])["fragility"]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(section["speed"]) == 500 and peak < 15e6


def test_equilibria_fail_where_the_strength_is_exceeded():
    """Nothing breaks in equilibria, so "0 fractures" and "0 % of the roof lost" would seem safe."""
    samples = drawn_samples(np.random.default_rng(2), 10, SPEEDS, 38.0, 0.1)
    moving = curve_sections(samples)["fragility"]
    still = samples | {"duration": np.full(50, np.nan), "detached_area": np.zeros(50)}
    still["first_fracture"] = np.full(50, np.nan)
    section = curve_sections(still)["fragility"]
    assert section["measure"].tolist() == ["first fracture"]
    assert np.array_equal(section["failed"][0], moving["failed"][0]) and section["failed"][0].sum() > 9


@pytest.mark.parametrize("duration", [4.0, np.nan], ids=["motion", "equilibria"])
def test_a_net_in_which_nothing_can_break_has_no_fragility_of_fractures(tmp_path, duration):
    """Without strengths, "0 of 10 broke" would seem safe."""
    samples = drawn_samples(np.random.default_rng(2), 10, SPEEDS, 99.0, 0.1)
    assert curve_sections(samples)["fragility"]["runs"][0].tolist() == [10] * 5
    samples["utilisation_before_break"][:], samples["duration"][:] = np.nan, duration
    write_year(tmp_path / "a.study.h5", samples)
    text = study_lines(tmp_path / "a.study.h5")
    is_told = "fracture: none in the 50 samples that finished, as nothing can break" in text
    assert is_told == (duration == 4.0) and ": no finished run has its outcome" in text


def test_removals_without_a_dynamic_factor_have_failed():
    """More elements broke, or no equilibrium exists, so the worst removals have no factor."""
    samples = columns({}, np.array([False, True, False, False]), np.zeros(4))
    samples["dynamic_factor_max"] = np.array([1.2, np.nan, np.nan, np.nan])
    states = ["equilibrium", "breaks", "unstable", "equilibrium"]
    samples["equilibrium_after_removal"] = np.array(states, object)
    failed, judged = failures(samples, criteria(("swings", "dynamic_factor_max", 2.0)))["swings"]
    assert failed.tolist() == [False, True, True, False] and judged.tolist() == [True, True, True, False]


def test_info_and_plots_show_annual_probabilities(tmp_path):
    """Probability with its interval, reliability with its targets, the tail, and a warning of 6 s of wind."""
    samples = drawn_samples(np.random.default_rng(3), 100, SPEEDS, 38.0, 0.1)
    own = criteria(("moves by 0.5 m", "displacement_max", 0.5))
    row = write_year(tmp_path / "a.study.h5", samples, own)["hazard"]
    text = study_lines(tmp_path / "a.study.h5")
    assert f"{row['annual_probability'][0]:.3g} (" in text and "RC2 4.7, 3.8" in text
    assert "moves by 0.5 m" in text and "exposure 6 s in a run" in text
    samples["duration"] = samples["dynamics.duration"] = np.linspace(20.0, 60.0, 500)  # no single exposure
    write_year(tmp_path / "b.study.h5", samples)
    assert "exposure 20 to 60 s in a run" in study_lines(tmp_path / "b.study.h5")
    assert 0 < row["interval"][0][0] < row["annual_probability"][0] < row["interval"][0][1]
    study = read_study(tmp_path / "a.study.h5")
    pictures_of(study)["hazard"](study).savefig(tmp_path / "hazard.png", dpi=60)
    assert (tmp_path / "hazard.png").stat().st_size > 10_000


def test_excluded_samples_bound_the_annual_probability(tmp_path):
    """The bounds are those of studies in which these samples failed or did not."""
    samples = drawn_samples(np.random.default_rng(3), 100, SPEEDS, 38.0, 0.1)
    rows, probabilities = np.flatnonzero((samples["wind.speed"] == 30.0) & (samples["broken"] == 0))[:5], []
    for state in ("no_equilibrium", "diverged", "finished"):
        samples["state"][rows] = state
        hazard = write_year(tmp_path / f"{state}.study.h5", samples)["hazard"]
        probabilities.append(hazard["annual_probability"][0])
        if state == "diverged":
            bounds = hazard["if_left_out"][0]
    failed, _, held = probabilities
    assert bounds.tolist() == [failed, held] and failed > 1.3 * held
    line = f"if all samples that are left out failed, or none: first fracture {failed:.3g} or {held:.3g}"
    assert line in study_lines(tmp_path / "diverged.study.h5")
    assert "left out failed" not in study_lines(tmp_path / "finished.study.h5")
    drawn = pictures_of(read_study(tmp_path / "diverged.study.h5"))
    for name in ("fragility", "hazard"):
        title = drawn[name](read_study(tmp_path / "diverged.study.h5")).get_suptitle()
        assert "5 samples left out" in title


def test_a_bound_without_failures_is_explained_by_its_speed(tmp_path):
    """Ten runs without failure at 60 m/s bound the annual probability by that speed, though 26 % may fail."""
    samples = drawn_samples(np.random.default_rng(3), 10, (50.0, 60.0), 500.0, 0.01)
    sections = write_year(tmp_path / "a.study.h5", samples)
    text = study_lines(tmp_path / "a.study.h5")
    assert sections["hazard"]["interval"][0, 1] == pytest.approx(GUMBEL.exceedance(60.0), rel=1e-12)
    assert "no curve (< 8.3e-07)" in text and "With 10 samples at that speed, up to 25.9% of" in text


def test_a_bound_of_drawn_speeds_has_one_sample_at_the_highest(tmp_path):
    """A hundred runs without failure at different speeds say little of the highest speed: 95 % may fail."""
    samples = drawn_samples(np.random.default_rng(3), 100, (50.0,), 500.0, 0.01)
    samples["wind.speed"] = np.linspace(40.0, 60.0, 100)
    write_year(tmp_path / "a.study.h5", samples)
    text = study_lines(tmp_path / "a.study.h5")
    assert "no curve (<" in text and "With 1 sample at that speed, up to 95.0% of" in text


@pytest.mark.parametrize("ways, explanation", [(2, "all wind of a year blows from"), (12, "runs of every")])
def test_annual_probabilities_explain_their_wind_directions(tmp_path, ways, explanation):
    """Two directions have a curve each, with all annual maxima; twelve share one. Densities have none."""
    samples = drawn_samples(np.random.default_rng(3), 100, SPEEDS, 38.0, 0.1)
    for key in ("wind.direction", "wind.air_density"):
        write_year(tmp_path / "a.study.h5", samples | {key: 30.0 * (np.arange(500) % ways)})
        output = study_lines(tmp_path / "a.study.h5").splitlines()
        lines = [line for line in output if "wind.direction" in line and "note: " in line]
        assert [explanation in line for line in lines] == [True] * (key == "wind.direction")


@pytest.mark.parametrize("seed", ["wind.seed", "cable.strength_seed"])
def test_seeds_of_the_strength_are_not_realisations_of_the_gusts(tmp_path, seed):
    """One realisation of the gusts leaves its scatter out of the intervals, for any other seeds."""
    samples, path = drawn_samples(np.random.default_rng(3), 100, SPEEDS, 38.0, 0.1), tmp_path / "a.study.h5"
    samples[seed] = samples.pop("wind.seed")
    write_study(path, samples, curve_sections(samples)["fragility"])
    assert ("all samples have the same gusts" in study_lines(path)) == (seed != "wind.seed")
    samples["duration"][:] = np.nan  # equilibria, without gusts
    write_study(path, samples, curve_sections(samples)["fragility"])
    text = study_lines(path)
    assert "all samples have the same gusts" not in text and "failed of those that ran; static wind" in text


def test_counts_stand_below_their_speeds(tmp_path):
    """An outcome that no run at 30 m/s and no run at 50 m/s has is judged there in no run."""
    samples = drawn_samples(np.random.default_rng(3), 10, (30.0, 40.0, 50.0), 38.0, 0.1)
    samples["displacement_max"][samples["wind.speed"] != 40.0] = np.nan
    write_year(tmp_path / "a.study.h5", samples, criteria(("moves", "displacement_max", 0.1)))
    lines = study_lines(tmp_path / "a.study.h5").splitlines()
    head, row = (next(line for line in lines if text in line) for text in (" m/s  ", "  moves "))
    assert row[: head.index("   median")].split() == ["moves", "0/0", "10/10", "0/0"]
    assert row.index("10/10") + 5 == head.index("40 m/s") + 6


def test_a_net_without_roof_has_no_criteria_of_a_lost_roof(tmp_path):
    """A mast breaks, but no roof is lost: neither curves nor annual probabilities name one."""
    samples = drawn_samples(np.random.default_rng(3), 20, SPEEDS, 38.0, 0.1)
    samples["detached_area"][:] = np.nan
    assert list(write_year(tmp_path / "a.study.h5", samples)["hazard"]["measure"]) == ["first fracture"]
    assert "roof lost" not in study_lines(tmp_path / "a.study.h5")


def test_a_plot_marks_truncated_intervals(tmp_path):
    """A bar shorter than its interval ends in an arrow, and the axis explains it. Other bars do not."""
    samples = drawn_samples(np.random.default_rng(3), 100, SPEEDS, 38.0, 0.1)
    write_year(tmp_path / "a.study.h5", samples)
    study = read_study(tmp_path / "a.study.h5")
    for low, arrows in ((study.hazard["interval"][0, 0], 0), (1e-12, 1)):
        study.hazard["interval"][0, 0] = low
        axes = pictures_of(study)["hazard"](study).axes[1]
        assert [line.get_marker() for line in axes.lines].count("<") == arrows
        assert ("arrows: they go on" in axes.get_xlabel()) == bool(arrows)
    study.hazard["annual_probability"][1] = np.nan  # no curve: the measure was missing, also if all failed
    axes = pictures_of(study)["hazard"](study).axes[1]
    assert len(axes.get_yticks()) == 6 and "no curve, " in axes.texts[1].get_text()
    study.hazard["interval"][1] = 0.0, 1e-29  # far below all other probabilities
    axes = pictures_of(study)["hazard"](study).axes[1]
    assert min(line.get_xdata()[0] for line in axes.lines if line.get_marker() == "<") < 1e-29


ASKED = """title = "a roof by the sea"
[[failure]]
name = "moves"
outcome = "displacement_max"
limit = 0.001
[hazard]
distribution = "gumbel"
mode = 25.0
scale = 2.5
"""


def test_new_criteria_and_hazards_need_no_new_runs(tmp_path):
    """If all runs exist, the file is rewritten without a run."""
    study = write(tmp_path, STUDY.replace("20.0, 30.0, 180.0", "20.0, 21.0"))
    run_on_standing_ranks("study", study, cwd=tmp_path)
    text = study.read_text().replace('job = "roof.toml"', "", 1)
    study.write_text('job = "roof.toml"\n' + ASKED + text)
    done = run_on_standing_ranks("study", study, cwd=tmp_path)
    assert "runs to make" not in done.stdout and "written: " in done.stdout
    output = run_on_standing_ranks("info", tmp_path / "storm.study.h5", cwd=tmp_path).stdout
    assert "a roof by the sea" in output and "moves" in output and "gumbel (mode 25, scale 2.5)" in output
    assert "whole already, 4 runs" in run_on_standing_ranks("study", study, cwd=tmp_path).stdout


FAILS = '[[failure]]\nname = "{}"\noutcome = "{}"\n'


@pytest.mark.parametrize(
    "text, message",
    [
        (FAILS.format("a", "speed") + "limit = 1.0", 'expected one of "first_fracture"'),
        (FAILS.format("a", "dynamic_factor_max") + "limit = 1.0", '"dynamic_factor_max": only for member'),
        # it failed if the first fracture came late, and held if it came soon
        (
            FAILS.format("first fracture", "displacement_max") + "limit = 3.0",
            "name: each study has a measure",
        ),
        (FAILS.format("a", "first_fracture") + "limit = 3.0", "limit = 3.0: a fracture before that time"),
        (FAILS.format("a", "broken"), "[[failure]] a: limit: missing; expected a number"),
        ('[[failure]]\noutcome = "broken"\nlimit = 1', "name: missing; expected a text in quotes"),
        ('[hazard]\ndistribution = "normal"', 'distribution = "normal": expected gumbel, weibull, en1991'),
        ("[hazard]\nmode = 25.0", "[hazard] distribution: missing; expected gumbel, weibull, en1991"),
        ('[hazard]\ndistribution = "gumbel"\nmode = 25.0', "[hazard] scale: missing; expected a number > 0"),
        ('[hazard]\ndistribution = "en1991"\nbasic_sped = 30', 'unknown key; did you mean "basic_speed"'),
        (FAILS.format("a", "displacement_max") + 'limit = "8 kN"', '[[failure]] a: limit = "8 kN": '),
        ("title = 3", "title = 3: expected a text"),
    ],
)
def test_errors_in_these_sections_are_named(tmp_path, text, message):
    study = write(tmp_path)
    head, rest = (text, "") if text.startswith("title") else ("", text)
    study.write_text(head + STUDY + rest)
    assert message in run_on_standing_ranks("study", study, cwd=tmp_path, code=2).stderr


def test_limits_of_outcomes_take_units():
    """Limits have the units of lengths and forces of a job; a number is in SI units."""
    limits = {"displacement_max": "1.2 mm", "tension_max": "80 kN", "utilisation_max": 0.5}
    entries = [{"name": name, "outcome": name, "limit": limit} for name, limit in limits.items()]
    sections = failure_sections(entries, False, check := Validator("", []))
    assert not check.errors and [section.limit for section in sections] == [1.2e-3, 80e3, 0.5]


def test_a_hazard_needs_different_speeds(tmp_path):
    text = STUDY.replace('"wind.speed" = [20.0, 30.0, 180.0]', "")
    study = write(tmp_path, text + ASKED.partition("\n")[2])
    done = run_on_standing_ranks("study", study, cwd=tmp_path, code=2)
    assert "expected wind.speed in [vary] or [sampling]" in done.stderr


def test_only_named_elements_are_removed(tmp_path):
    """`ids` keeps their order. An unknown id is named."""
    text = 'job = "roof.toml"\n[vary]\nremove = {each = "element", ids = [IDS], time = 0.05}\n'
    ids = [9, 3, 7]
    plan = read_study_plan(write(tmp_path, text.replace("IDS", "9, 3, 7")))
    assert [plan.sample(k).remove["elements"] for k in range(len(plan))] == [[e] for e in ids]
    wrong = write(tmp_path, text.replace("IDS", "9, 9999"))
    done = run_on_standing_ranks("study", wrong, cwd=tmp_path, code=2)
    assert "ids: no element 9999; there are 0, 1" in done.stderr, done.stderr


def test_every_criterion_is_a_number_of_a_run():
    """Failures are judged by outcomes that state the damage of a run."""
    measured = {each.name for each in OUTCOMES if each.measured}
    assert measured >= {"broken", "detached_area", "displacement_max"}
    assert not any(each.measured for each in OUTCOMES if each.empty == "" or each.name.endswith("_id"))


def test_a_removed_section_of_a_study_is_named_with_its_replacement(tmp_path):
    """`[rare]` was part of version 0.4."""
    words = r"\[rare\]: removed in version 0.5. Use jobs/studies/rare_openturns.py"
    with pytest.raises(InputError, match=words):
        read_study_plan(write(tmp_path, STUDY + "[rare]\nabove = 1.0\n"))


@pytest.mark.long
def test_openturns_finds_the_probability_of_a_rare_failure():
    """The stadium at 50.8 m/s: 0.90e-2 by an earlier subset simulation with 1,400 runs, 0.50e-2 to 1.6e-2."""
    pytest.importorskip("openturns")
    script = ROOT / "jobs" / "studies" / "rare_openturns.py"
    done = run_process(BIN / "python", script, code=None, timeout=None)
    match = re.search(r"probability (\S+) \((\S+) to (\S+),", done.stdout)
    probability, low, high = map(float, match.groups())
    assert low <= 0.90e-2 <= high and 0.50e-2 <= probability <= 1.6e-2, done.stdout + done.stderr


def test_openturns_counts_a_roof_without_equilibrium_as_failed():
    """At 95 m/s the stadium has no equilibrium, so no utilisation."""
    pytest.importorskip("openturns")
    script = ROOT / "jobs" / "studies" / "rare_openturns.py"
    done = run_process(BIN / "python", script, "--speed", "95", "--runs", "2", "--block", "2")
    assert "probability 1 (1 to 1, 95 %), 2 runs" in done.stdout


def test_the_sunk_area_is_below_the_depth_and_the_utilisation_before_a_fracture_of_strain(tmp_path):
    """Share of the area at nodes below the depth at the end; tension over EA, over the fracture strain."""
    text = FAILS.format("sunk", "sunk_area") + 'limit = 0.1\ndepth = 0.01\n[run]\nkeep_results = "all"\n'
    study = write(tmp_path, STUDY.replace("20.0, 30.0, 180.0", "20.0, 30.0") + text)
    run_on_standing_ranks("study", study, cwd=tmp_path)
    shares = []
    for number in range(4):
        with h5py.File(tmp_path / f"storm.samples/{number:06d}.vtkhdf") as f:
            area, start = f["net/tributary_area"][:], f["form_finding/position"][:]
            sunk = start[:, 2] - f["final/position"][: len(start), 2]
            shares.append(area[sunk > 0.01].sum() / area.sum())
    with h5py.File(tmp_path / "storm.study.h5") as f:
        assert f["samples/sunk_area"][:].tolist() == shares and 0.0 < max(shares) < 1.0
        assert f["failures/failed"][0] == sum(share > 0.1 for share in shares)
        used, broken = f["samples/utilisation_before_break"][:], f["samples/broken"][:]
        assert (broken[2:] > 0).any() and ((used > 1.0) == (broken > 0)).all() and (used < 1.1).all()
        elastic = f["samples/tension_max"][0] / (1e11 * 5e-4) / 0.015
        assert used[0] == pytest.approx(elastic, rel=1e-12)
