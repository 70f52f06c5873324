"""Fragility curves, their intervals, and descriptions and plots of studies: files with known properties."""

import csv
import math
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from conftest import ROOT
from scipy.special import ndtr
from study_files import columns, drawn_samples, net, study_lines, write_study

from netfall.cli.parser import read_command
from netfall.cli.results import info
from netfall.core.errors import InputError
from netfall.post.plots.canvas import MARK
from netfall.post.plots.study.maps import loss_map
from netfall.post.plots.study.study import pictures_of
from netfall.results.file import open_result
from netfall.study.answers import fragility, probit, samples
from netfall.study.answers.fragility import FailureCriterion, curve_sections, failure_section
from netfall.study.answers.hazard import Hazard
from netfall.study.answers.info import _failures, _share_text, print_study
from netfall.study.answers.read import read_study
from netfall.study.answers.removals import removal_of_element, removals_of
from netfall.study.answers.samples import FragilityCurve
from netfall.study.answers.statistics import next_half_width, spearman
from netfall.study.table import FORMAT

SPEEDS = (30.0, 34.0, 38.0, 42.0, 46.0)


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch):
    """Use a fifth of the resamples, for time; the ends of an interval move by 2 % of its width."""
    monkeypatch.setattr(fragility, "RESAMPLES", 400)
    monkeypatch.setattr(samples, "RESAMPLES", 400)


def fragility_section(samples: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return /fragility by the names of its datasets; empty unless the wind speed varies."""
    return curve_sections(samples).get("fragility", {})


def test_bakers_collapses_give_bakers_curve():
    """Baker (2015), Earthquake Spectra 31(1), 579: 40 ground motions at each intensity, four decimals."""
    at, collapses = np.array([0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0]), np.array([0, 0, 0, 4, 6, 13, 12, 16])
    fit = probit.fit(at, np.full(8, 40), collapses)
    assert np.round([fit.median[0], fit.dispersion[0]], 4).tolist() == [1.0761, 0.4292]


def test_the_fit_has_the_largest_likelihood():
    """For 300 random studies the likelihood decreases on all sides of the fit, at the right rate."""
    generator, speed = np.random.default_rng(1), np.array(SPEEDS)
    runs = generator.integers(1, 60, (300, 5))
    share = ndtr(np.log(speed / generator.uniform(32, 44, (300, 1))) / generator.uniform(0.02, 0.5, (300, 1)))
    failed = generator.binomial(runs, share)
    fit = probit.fit(speed, runs, failed)
    is_fitted = fit.verdict == probit.FITTED
    assert is_fitted.sum() > 250

    def likelihood(median, dispersion):
        z = np.log(speed / median[is_fitted, None]) / dispersion[is_fitted, None]
        return (failed[is_fitted] * np.log(ndtr(z)) + (runs - failed)[is_fitted] * np.log(ndtr(-z))).sum(1)

    best = likelihood(fit.median, fit.dispersion)
    for step in (0.999, 1.001):
        assert (likelihood(step * fit.median, fit.dispersion) < best).all()
        assert (likelihood(fit.median, step * fit.dispersion) < best).all()
        assert (likelihood(step * fit.median, step * fit.dispersion) < best).all()


@pytest.mark.parametrize(
    ("failed", "words", "bounds"),
    [
        ([0, 0, 0, 0, 0], "none failed up to 46 m/s", (46, np.inf)),
        ([20, 20, 20, 20, 20], "all failed, even at 30 m/s", (0, 30)),
        ([0, 0, 20, 20, 20], "between 34 and 38 m/s", (34, 38)),
        ([0, 0, 5, 20, 20], "between 38 and 42 m/s", (38, 42)),
        ([0, 0, 15, 20, 20], "between 34 and 38 m/s", (34, 38)),
        ([0, 0, 10, 20, 20], "at 38 m/s, where half failed", (38, 38)),
        ([0, 0, 0, 0, 5], "above 46 m/s", (46, np.inf)),
        ([9, 7, 5, 3, 1], "do not increase", (0, np.inf)),
        ([4, 4, 4, 4, 4], "do not increase", (0, np.inf)),
    ],
)
def test_studies_without_a_curve_have_bounds_only(failed, words, bounds):
    """The note gives the reason, and the speeds that enclose the median."""
    speed, k = np.repeat(SPEEDS, 20), np.tile(np.arange(20), 5)
    broke = k < np.repeat(failed, 20)
    inputs = {"wind.speed": speed, "wind.seed": np.arange(100)}
    section = fragility_section(columns(inputs, broke, 0.5 * broke))
    assert np.isnan([section["median"][0], section["dispersion"][0], *section["median_interval"][0]]).all()
    assert section["median_bounds"][0].tolist() == list(bounds)
    assert words in section["note"][0]
    assert section["failed"][0].tolist() == failed


def test_the_curve_of_known_capacities_is_found():
    """200 seeds: median and dispersion are within their intervals. Seeds, not runs, are the samples."""
    section = fragility_section(drawn_samples(np.random.default_rng(4), 200, SPEEDS, 38.0, 0.1))
    (low, high), (least, most) = section["median_interval"][0], section["dispersion_interval"][0]
    assert low < 38.0 < high and least < 0.1 < most
    assert section["samples"][0] == 200 and section["resampled"][0] == "wind.seed"
    assert section["runs"][0].tolist() == [200] * 5
    inside = section["band"][0][:, 0] <= ndtr(np.log(section["band_speed"] / 38.0) / 0.1)
    assert inside.mean() > 0.9
    assert abs(np.subtract(*section["band_at_median"][0])) < 0.14  # +-7 % of 196 samples at one speed
    section = fragility_section(drawn_samples(np.random.default_rng(9), 5, SPEEDS, 38.0, 0.2))  # too few
    assert np.isfinite(section["median"][0]) and np.isnan(section["median_interval"]).all()
    assert "5 independent samples" in section["note"][0]


def test_speeds_do_not_replace_seeds():
    """With many speeds the capacity of each seed is known, and the median to 1.96 dispersion / sqrt(n). The
    same runs with one seed each are more certain, because each is a capacity.
    """
    generator = np.random.default_rng(5)
    speeds = np.linspace(26.0, 54.0, 57)
    halves = []
    for shared in (True, False):
        section = fragility_section(drawn_samples(generator, 50, speeds, 38.0, 0.1, shared))
        halves.append(0.5 * np.subtract(*section["median_interval"][0][::-1]) / section["median"][0])
    # A fifth: what 50 draws leave open of the deviation (10 %), and percentiles of 400 samples (7 %).
    assert halves[0] == pytest.approx(1.96 * 0.1 / math.sqrt(50), rel=0.2)
    assert halves[1] < 0.5 * halves[0]


def test_the_interval_contains_the_true_value_as_often_as_stated(monkeypatch):
    """Of sixty studies with 50 seeds, 95 % would be 57. Fewer than 50 have a probability of 1e-4 at 94 %.

    An interval of half the width would contain the value in 40.
    """
    monkeypatch.setattr(fragility, "LOST_ROOF", {})
    generator, held = np.random.default_rng(6), 0
    for _ in range(60):
        section = fragility_section(drawn_samples(generator, 50, SPEEDS, 38.0, 0.1))
        low, high = section["median_interval"][0]
        held += low <= 38.0 <= high
    assert 50 <= held < 60


def test_runs_without_equilibrium_count_as_failed():
    """A run that diverged or had an error is excluded, with bounds."""
    samples = drawn_samples(np.random.default_rng(7), 50, SPEEDS, 38.0, 0.1)
    plain = fragility_section(samples)
    standing = np.flatnonzero((samples["broken"] == 0) & (samples["wind.speed"] == 38.0))[:6]
    samples["state"][standing] = ["no_equilibrium"] * 3 + ["diverged"] * 2 + ["failed"]
    for name in ("first_fracture", "detached_area"):
        samples[name][standing] = np.nan
    section = fragility_section(samples)
    assert (section["failed"][:, 2] == plain["failed"][:, 2] + 3).all()
    assert (section["runs"][:, 2] == 47).all() and (section["left_out"] == 3).all()
    if_failed, if_held = section["median_if_left_out"][0]
    assert if_failed < section["median"][0] < if_held
    speed = {"wind.speed": samples["wind.speed"]}
    everything = columns(speed, samples["broken"] > 0, 0.0 * samples["broken"])
    everything["state"][:] = "failed"
    assert "no finished run has its outcome" in fragility_section(everything)["note"][0]


def test_a_fracture_of_another_element_does_not_fail_the_tension_ratio():
    """The ratio is known after fractures and without equilibrium; the dynamic factor is not."""
    runs = columns({"removed": np.array(["a", "b", "c"], object)}, np.array([1, 0, 0]), np.zeros(3))
    runs["tension_ratio_max"] = np.array([2.46, 3.0, 2.0])
    runs["dynamic_factor_max"] = np.array([np.nan, 1.5, np.nan])
    runs["equilibrium_after_removal"] = np.array(["equilibrium", "equilibrium", "no_equilibrium"], object)
    criteria = [("tension_ratio_max", 100.0), ("tension_ratio_max", 2.5), ("dynamic_factor_max", 100.0)]
    own = tuple(FailureCriterion(name=f"{of} {limit}", outcome=of, limit=limit) for of, limit in criteria)
    assert failure_section(runs, own)["failed"].tolist() == [0, 1, 2]


def test_combinations_have_curves_and_draws_are_pooled():
    """Two prestresses have two curves, forty random ones have one. If seeds cross draws, the fewer count."""
    generator = np.random.default_rng(8)
    parts = [drawn_samples(generator, 40, SPEEDS, median, 0.1) for median in (36.0, 42.0)]
    both = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    section = fragility_section(both | {"cable.prestress": np.repeat([8e4, 12e4], 200)})
    assert section["curve"][0] == "cable.prestress = 80000" and len(section["measure"]) == 12
    for part, first in zip(parts, (0, 6)):
        alone = fragility_section(part)
        for name in ("median", "dispersion", "median_interval", "band"):
            assert np.array_equal(alone[name], section[name][first : first + 6], equal_nan=True)
    drawn = parts[0] | {"cable.prestress": generator.normal(1e5, 5e3, 40)[parts[0]["wind.seed"] - 1]}
    pooled = fragility_section(drawn)
    assert pooled["pooled"].tolist() == ["cable.prestress"] and set(pooled["curve"]) == {""}
    assert pooled["samples"][0] == 40
    assert np.array_equal(pooled["median"], fragility_section(parts[0])["median"])
    crossed = {name: np.tile(values, 9) for name, values in parts[0].items()}
    crossed["cable.prestress"] = np.repeat(generator.normal(1e5, 5e3, 9), 200)
    section = fragility_section(crossed)
    assert section["samples"][0] == 9 and section["resampled"][0] == "wind.seed and cable.prestress"
    crew = {"load.crew": np.random.default_rng(2).integers(0, 3, 40)[parts[0]["wind.seed"] - 1]}
    for drawn, curves in ((["load.crew"], 1), ([], 3)):  # whole numbers from few are as random as others
        section = curve_sections(parts[0] | crew, drawn=drawn)["fragility"]
        assert len(set(section["curve"])) == curves and section["pooled"].tolist() == drawn
    section = curve_sections(crossed, drawn=[])["fragility"]  # a grid of prestresses
    assert section["samples"][0] == 40 and section["resampled"][0] == "wind.seed"
    assert section["pooled"].tolist() == ["cable.prestress"]


def test_a_key_of_a_group_with_a_slash_is_an_input(tmp_path):
    """HDF5 puts "group.side/a.area" into a group; it vanished, and samples of both areas were pooled."""
    inputs = {"group.side/a.area": np.repeat([1e-4, 2e-4], 8), "wind.seed": np.arange(16) % 8}
    samples = columns(inputs, np.zeros(16), np.zeros(16))
    write_study(tmp_path / "a.study.h5", samples, {})
    study = read_study(tmp_path / "a.study.h5")
    assert study.samples.keys() == samples.keys()
    assert "group.side/a.area: 0.0001, 0.0002 m2" in study_lines(tmp_path / "a.study.h5")


def roots_of_wilson(n: int, share: float) -> np.ndarray:
    """Return the percentages p with (share - p)^2 = 1.96^2 p (1 - p) / n."""
    extra = 1.959964**2 / n
    return 100.0 * np.sort(np.roots([1.0 + extra, -2.0 * share - extra, share**2]))


def test_the_failed_share_counts_independent_samples():
    """Five random prestresses at each of 20 seeds are five independent runs, five chosen ones are 20."""
    seed = np.arange(20).repeat(10)
    inputs = {"cable.strength_seed": seed, "load.snow": np.tile([1e3, 2e3], 100)}
    inputs["cable.prestress"] = np.tile(np.linspace(1e5, 2e5, 5).repeat(2), 20)
    samples = columns(inputs, np.zeros(200), np.zeros(200))
    samples["tension_max"] = np.where((inputs["load.snow"] > 1e3) & (seed < 4), 3e5, 1e5)
    samples["state"][-10:] = "undecided"  # the last seed
    own = {"measure": ["torn"], "outcome": ["tension_max"], "limit": [2e5]}
    drawn_lines, chosen_lines = [], []
    study = SimpleNamespace(failures=own, fragility={}, samples=samples, drawn=["cable.prestress"])
    _failures(study, drawn_lines.append)
    study.drawn = []
    _failures(study, chosen_lines.append)
    low, high = roots_of_wilson(20, 20 / 95)
    assert f"(95 %: {low:.3g}% to {high:.3g}%, of 20 independent ones)" in chosen_lines[1]
    assert chosen_lines[1].endswith("; cable.prestress pooled") and "pooled" not in drawn_lines[1]
    assert drawn_lines[0].startswith("failure, torn, load.snow = 1000: 0 of 95 samples, 0% (95 %: 0% to")
    low, high = roots_of_wilson(5, 20 / 95)  # 20 of 95 runs, but five prestresses
    assert drawn_lines[1] == (
        f"failure, torn, load.snow = 2000: 20 of 95 samples, 21.1% (95 %: {low:.3g}% to {high:.3g}%, of 5 "
        "independent ones); 5 left out, 25% if all of them failed"
    )
    samples["tension_max"][2:] = 1e5  # the first run, and one of 5000 without a common seed
    samples["tension_max"][0] = 3e5
    _failures(study, chosen_lines.append)
    low, high = roots_of_wilson(20, 1 / 95)
    assert f": 1 of 95 samples, 1.05% (95 %: {low:.3g}% to {high:.3g}%, of 20" in chosen_lines[2]
    curve = FragilityCurve("", np.arange(5000), {}, np.zeros(5000, int))
    low, high = roots_of_wilson(5000, 1 / 5000)
    assert _share_text(curve, 5000, 1, 0) == f"1 of 5000 samples, 0.02% (95 %: {low:.3g}% to {high:.3g}%)"


@pytest.mark.parametrize("crossed", [True, False])
def test_runs_with_a_common_seed_are_dependent(crossed):
    """Twelve seeds with 20 draws of speed and prestress, or one draw for each run: 12 gusts, not 240."""
    generator = np.random.default_rng(5)
    seed = np.tile(np.arange(12), 20) if crossed else generator.integers(0, 12, 240)
    draws, repeats = (20, 12) if crossed else (240, 1)
    of_speed, of_prestress = generator.uniform(size=(2, draws)).repeat(repeats, 1)
    inputs = {"wind.seed": seed, "wind.speed": 30.0 + 16.0 * of_speed, "cable.prestress": 1e5 * of_prestress}
    capacity = 38.0 * np.exp(generator.normal(0.0, 0.1, 12))[seed]
    section = fragility_section(columns(inputs, inputs["wind.speed"] > capacity, np.zeros(240)))
    assert section["samples"][0] == 12 and "wind.seed" in section["resampled"][0]


def test_a_narrower_band_needs_quadratically_more_samples():
    """+-14 % with 50: 10 % needs 98. There is no number for a narrow or an unknown band."""
    assert next_half_width(0.14, 50) == (0.1, 98)
    assert next_half_width(0.0693, 200) == (0.05, 390)
    assert next_half_width(0.45, 50)[1] == 0 and next_half_width(math.nan, 50)[1] == 0


def test_rank_correlation_of_a_known_case():
    """1 - 6 sum d^2 / (n (n^2 - 1)) with d = 2 0 -2 2 0 -2 1 -1 by hand. nan and inf do not count."""
    x = np.array([1.0, 2, 3, 4, 5, 6, 7, 8, np.nan])
    y = np.array([3.0, 2, 1, 6, 5, 4, 8, 7, 1.0])
    one = np.arange(9)
    same = np.zeros(18, int)
    assert spearman(x, y, one, same[:9])[0] == pytest.approx(1 - 6 * 18 / (8 * 63), rel=1e-12)  # rounding
    assert spearman(x, y, one, same[:9])[1:] == (8, True)
    assert np.isnan(spearman(x[:5], y[:5], one[:5], same[:5])[0])
    # the same draws at two combinations of [vary] are no further evidence
    y = np.array([4.0, 2, 3, 1, 6, 5, 8, 7, 1.0])  # 0.738, of chance 1.96 / sqrt(7) = 0.741
    assert spearman(np.repeat(x, 2), np.repeat(y, 2), np.arange(18), same)[1:] == (16, True)
    assert spearman(np.repeat(x, 2), np.repeat(y, 2), np.repeat(one, 2), same)[1:] == (8, False)


def test_rank_correlations_are_within_each_combination_of_chosen_values(tmp_path):
    """The sag grows with each drawn mass, but a hundred times as much with the snow, which is chosen."""
    mass = np.tile(np.random.default_rng(4).permutation(12) + 1.0, 7)
    snow = np.repeat(1e3 * np.arange(1, 8), 12)
    samples = columns({"load.snow": snow, "net.mass": mass}, np.zeros(84), np.zeros(84))
    samples["displacement_max"] = snow + mass
    write_study(tmp_path / "a.study.h5", samples, {})
    with h5py.File(tmp_path / "a.study.h5", "a") as file:
        file["provenance/drawn"] = ["net.mass"]
    output = study_lines(tmp_path / "a.study.h5")
    assert "displacement_max +1.00" in output and "samples that finished, within each load.snow; " in output
    study = read_study(tmp_path / "a.study.h5")
    titles = [axes.get_title(loc="right") for axes in pictures_of(study)["inputs"](study).axes]
    assert "rank correlation +1.00, n = 12" in titles


def test_samples_without_a_value_have_the_ranks_of_the_worst_or_the_best(tmp_path):
    """Six of 16 without equilibrium, of the least prestress, or without a fracture, of the largest: 13.5."""
    strength, path, order = np.arange(1.0, 17.0), tmp_path / "a.study.h5", np.random.default_rng(1)
    standing, breaks, severity = strength > 6, strength < 11, order.permutation(16) / 16
    samples = columns({"cable.prestress": strength}, breaks, severity)
    fallen = columns({"cable.prestress": strength}, np.zeros(16), np.zeros(16))
    fallen["displacement_max"] = np.where(standing, 16 * severity, np.nan)
    fallen["state"][~standing], fallen["detached_area"][~standing] = "no_equilibrium", np.nan
    for name, of, known, sign in (
        ("displacement_max", fallen, standing, -1),
        ("first_fracture", samples, breaks, 1),
    ):
        write_study(path, of, {})
        rho = np.corrcoef(strength, np.where(known, of[name].argsort().argsort() + 1.0, 13.5))[0, 1]
        assert f"{name} {rho:+.2f}" in study_lines(path) and sign * rho > 0.5
        worst = "of the 10 samples that finished and the 6 without equilibrium as the worst"
        assert (worst in study_lines(path)) == (of is fallen)
        pictures_of(read_study(path))["inputs"](read_study(path))
    fallen["state"][:] = "no_equilibrium"
    for none in fallen, {name: values[:7] for name, values in samples.items()}:  # too few for a correlation
        write_study(path, none, {})
        assert "rank correlation" not in study_lines(path)


@pytest.fixture(scope="module")
def storm(tmp_path_factory):
    """Return a study of five speeds and 30 seeds, with samples of every state."""
    path = tmp_path_factory.mktemp("study") / "storm.study.h5"
    samples = drawn_samples(np.random.default_rng(10), 30, SPEEDS, 38.0, 0.1)
    rows = [149, 1, 2, 0, 3, 4]
    samples["state"][rows] = ["no_equilibrium", "diverged", "diverged", "failed", "undecided", "undecided"]
    samples["reason"][rows[0]] = "no equilibrium under the mean wind"
    samples["reason"][[1, 2]] = "t = 2 s: speeds without bound"
    samples["reason"][[0, 3, 4]] = ["no answer within 60 s", "load factor 0.993", "load factor 0.9941"]
    for name in (
        "first_fracture",
        "detached_area",
        "displacement_max",
        "tension_max",
        "energy_balance_error",
    ):
        samples[name][rows] = np.nan
    samples["broken"][rows], samples["first_element"][rows], samples["first_element_id"][rows] = 0, -1, -1
    write_study(path, samples, fragility_section(samples), title="a storm")
    return path


def test_info_describes_a_study(storm, capsys):
    """States with reasons, shares by speed, the median, the samples of a narrower band, elements by id."""
    info.function(storm, json=False)
    output = capsys.readouterr().out
    with h5py.File(storm) as file:
        g, state = file["fragility"], file["samples/state"].asstr()[:]
        counts = [f"{f}/{n}" for f, n in zip(g["failed"][0], g["runs"][0])]
        median, first = g["median"][0], file["first_breaks"][:]
    assert "a storm" in output and f"{(state == 'finished').sum()} finished, 1 no_equilibrium" in output
    assert "diverged, 2 times: t = 2 s: speeds without bound; first: row 1 (" in output
    assert "undecided, 2 times with different numbers: load factor 0.993; first: row 3 (" in output
    assert "failed, 1 time: no answer within 60 s" in output and "exposure 6 s" in output
    line = next(line for line in output.splitlines() if line.strip().startswith("first fracture  "))
    assert [word for word in line.split() if "/" in word] == counts and f"{median:.4g} (" in line
    assert "with 30 independent samples; +-" in output and "would need some" in output
    assert f"element 1008 (111-118) in {first[7]}" in output and "5 left out" in output
    assert f"warning: 5 of {len(state)} samples are left out" in output


def test_reasons_that_differ_in_ids_are_one(tmp_path):
    """However many ids each of them lists."""
    samples = columns({"cable.prestress": np.arange(4.0)}, np.zeros(4), np.zeros(4))
    samples["state"][:] = "undecided"
    samples["reason"][:] = ["element 4", "3 elements (4, 7, 9)", "9 elements (4, 7, 9, 11, 12, ...)", "none"]
    write_study(tmp_path / "a.study.h5", samples, {})
    text = study_lines(tmp_path / "a.study.h5")
    assert "undecided, 3 times with different numbers: element 4;" in text
    assert "undecided, 1 time: none" in text


def test_a_study_is_plotted_and_exported(storm, tmp_path, capsys):
    """Pictures depend on its data; earlier others go. The table has every number, with units in line 1."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "storm_hazard.png").write_bytes(MARK)
    read_command(["plot", str(storm), "-o", str(tmp_path / "out")])()
    written = capsys.readouterr().out.split()
    names = [f"storm_{name}" for name in ("fragility.png", "breaks.png", "samples.csv")]
    assert written == [str(tmp_path / "out" / name) for name in names]
    assert all((tmp_path / "out" / name).stat().st_size > 10_000 for name in names)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*names}
    with open(tmp_path / "out" / "storm_samples.csv") as file:
        head = file.readline()
        rows = list(csv.DictReader(file))
    assert head.startswith("# wind.seed, wind.speed [m/s], first_fracture [s]") and len(rows) == 150
    with h5py.File(storm) as file:
        for name in ("wind.speed", "first_fracture", "detached_area"):
            read = np.array([float(row[name] or "nan") for row in rows])
            assert np.array_equal(read, file[f"samples/{name}"][:], equal_nan=True)
        assert [row["state"] for row in rows] == file["samples/state"].asstr()[:].tolist()


def test_removals_and_random_keys_are_plotted_and_described(tmp_path):
    """One study removes each element, with seeds; the other draws prestress and speed, with one run each."""
    generator, roof = np.random.default_rng(11), net()
    m = len(roof["elements"])
    ids = np.repeat(roof["element_id"], 2).astype(str).astype(object)
    severity = np.where(ids == "1020", 0.9, 0.0)
    factor = np.where(severity > 0, np.nan, 1.5 + np.arange(2 * m) / (4 * m))
    samples = columns({"removed": ids, "wind.seed": np.tile([1, 2], m)}, severity > 0, severity)
    samples |= {"dynamic_factor_max": factor, "dynamic_factor_element_id": np.full(2 * m, 1003)}
    samples |= {"tension_ratio_max": 1.0 + factor, "tension_ratio_element_id": np.full(2 * m, 1003)}
    samples["state"][8] = "no_equilibrium"  # the first seed of the fifth
    samples["state"][22:24] = "diverged"  # both of the twelfth
    write_study(tmp_path / "loss.study.h5", samples, {}, roof)
    output = study_lines(tmp_path / "loss.study.h5")
    assert "60 different" in output and "no equilibrium after 1 (1005)" in output
    assert "samples of 1 of them are left out and may be worse (1012)" in output
    assert "98% (removal of 1020)" in output and f"{factor[-1]:.3g} (removal of 1060)" in output
    first = output.index(f"largest tension over tension before: {1.0 + factor[-1]:.3g} (removal of 1060)")
    assert first < output.index("largest dynamic factors, if the equilibrium changes by more than 10% of the")
    n = 200
    speed, prestress = generator.uniform(30, 46, n), generator.normal(1e5, 5e3, n)
    capacity = 38.0 * (prestress / 1e5) ** 3
    inputs, severity = {"wind.speed": speed, "cable.prestress": prestress}, 2 * (speed / capacity - 1)
    samples = columns(inputs, speed > capacity, np.clip(severity, 0, 1))
    section = fragility_section(samples)
    write_study(tmp_path / "draws.study.h5", samples, section, roof)
    assert section["samples"][0] == n and section["resampled"][0] == "runs"
    # The capacity's deviation: 3 times 5 %.
    assert section["dispersion_interval"][0][0] < 0.15 < section["dispersion_interval"][0][1]
    output = study_lines(tmp_path / "draws.study.h5")
    assert "cable.prestress pooled" in output and "all samples have the same gusts" in output
    assert "(Spearman) with the random inputs, of the 200 samples that finished" in output
    assert "wind.speed [m/s]: first_fracture -" in output and "cable.prestress [N]: " in output
    for name, known, new in (
        ("loss", ["breaks"], ["loss_map"]),
        ("draws", ["fragility", "breaks"], ["inputs"]),
    ):
        study = read_study(tmp_path / f"{name}.study.h5")
        pictures = pictures_of(study)
        assert [name for name, draw in pictures.items() if draw] == known + new
        for picture in new:
            pictures[picture](study).savefig(tmp_path / f"{picture}.png", dpi=60)
            assert (tmp_path / f"{picture}.png").stat().st_size > 10_000


def test_the_removal_of_a_cable_is_that_of_its_elements(tmp_path):
    """If /net names cables, an element has the removal of its cable, or none."""
    roof = net()
    m = len(roof["elements"])
    roof["cable"] = np.array(["north"] * 4 + ["south"] * 5 + [""] * (m - 9), object)
    samples = columns({"removed": np.array(["south", "north"], object)}, np.zeros(2, bool), np.zeros(2))
    write_study(tmp_path / "cables.study.h5", samples, {}, roof)
    study = read_study(tmp_path / "cables.study.h5")
    assert removal_of_element(study, removals_of(study)).tolist() == [1] * 4 + [0] * 5 + [-1] * (m - 9)
    for gusts in (0, 1):
        gusty = samples | {"gusts": np.full(2, gusts)}
        write_study(tmp_path / "gusty.study.h5", gusty, {}, roof)
        output = study_lines(tmp_path / "gusty.study.h5")
        assert ("gusts continue after a removal" in output) == bool(gusts)


def test_negative_dynamic_factors_are_drawn_with_large_ones(tmp_path):
    """A factor above `TELLING` makes the scale logarithmic; that of an opposite peak is negative."""
    roof = net()
    removed = roof["element_id"][:2].astype(str).astype(object)
    members = columns({"removed": removed}, np.zeros(2, bool), np.zeros(2))
    members["dynamic_factor_max"] = np.array([-0.5, 20.0])
    write_study(tmp_path / "away.study.h5", members, {}, roof)
    study = read_study(tmp_path / "away.study.h5")
    loss_map(study).savefig(tmp_path / "away.png", dpi=60)


def test_a_study_is_not_a_result_and_must_be_complete(storm, tmp_path):
    """Commands on results refuse it. A file without some columns is refused with their names."""
    with pytest.raises(InputError, match=r"a study file\. Read it with netfall info or plot"):
        open_result(storm)
    with h5py.File(tmp_path / "part.study.h5", "w") as file:
        file.attrs["netfall_study"] = FORMAT
        file["samples/state"] = ["finished"]
    with pytest.raises(InputError) as refused:
        print_study(tmp_path / "part.study.h5", print)
    assert "no /samples/detached_area" in str(refused.value) and "no /events/time" in str(refused.value)


def test_every_dataset_of_a_study_is_described(storm):
    """The page of the study file names each dataset."""
    text = (ROOT / "src/netfall/docs/pages/reference/study-file.md").read_text()
    with h5py.File(storm) as file:
        names = [name for group in ("samples", "events", "fragility") for name in file[group]]
    samples = drawn_samples(np.random.default_rng(1), 10, SPEEDS, 38.0, 0.1)
    hazard = Hazard("gumbel", {"mode": 25.0, "scale": 2.5})
    names += curve_sections(samples, hazard=hazard)["hazard"]
    names += failure_section(samples, (FailureCriterion(name="much", outcome="broken", limit=3.0),))
    assert [name for name in names if f"`{name}`" not in text] == []
