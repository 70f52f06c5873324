"""Text of `netfall info` on a study file."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.messages import count_of
from netfall.job.values import format_list
from netfall.results.file import element_name
from netfall.results.removals import OUTCOME_TEXT, WHERE_SIGNIFICANT
from netfall.results.warning_text import BALANCE_COLUMNS, MAX_BALANCE_ERROR
from netfall.study import messages
from netfall.study.answers import statistics
from netfall.study.answers.fragility import failures, is_judged
from netfall.study.answers.hazard import DEFAULT_YEARS, TARGET_RELIABILITY
from netfall.study.answers.read import Study, read_study, unit_of_column, with_unit
from netfall.study.answers.removals import MAX_DYNAMIC_FACTOR, removals_of
from netfall.study.answers.samples import (
    SPEED,
    FragilityCurve,
    group_curves,
    input_text,
    varying_inputs,
)
from netfall.study.sections import FailureCriterion

NUMBERS = re.compile(r"(?:\d+(?:\.\d+)?(?:e[+-]?\d+)?(?:, \.\.\.|, (?=\d))?)+")  # one, or a list of them
COUNTED = re.compile(r"# (\w+)s \(#\)")  # "3 elements (4, 7, 9)"; a single one is "element 4"
MOST_NAMED = 5  # largest number of elements, removals or reasons in a list
FEW_WITHOUT = 0.02  # share of resamples without a curve up to which the width scales with 1 / sqrt(samples)
MOST_VALUES = 6  # largest number of values of an input in a list
CODE_AVERAGING_TIME_S = 600.0  # s, averaging time of the mean wind speed in EN 1991-1-4
MAX_TAIL_SHARE = 0.5  # share of the tail above which the probability depends on the shape of the curve


def print_study(path: Path, say: Callable[[str], None]) -> None:
    """Print a summary of a study file; elements are named by the ids of the tables."""
    study = read_study(path)
    say(f"{path}: {study.title}")
    for tell in (
        _print_inputs,
        _states,
        _time,
        _broken,
        _fragility,
        _hazard,
        _failures,
        _elements,
        _removals,
        _correlations,
        _print_energy_check,
    ):
        tell(study, say)


def _print_inputs(study: Study, say: Callable[..., Any]) -> None:
    names = varying_inputs(study.samples)
    n = len(study.samples["state"])
    what = f"{study.exposure} each" if study.moves else "equilibria without a dynamic stage"
    elements = len(study.net["elements"])
    nets = f" of {count_of(elements, 'element')}" if elements else ""
    if any(name.startswith("net.") for name in names) and not elements:
        nets = " of nets that differ"
    shard = re.search(r"\.(\d+)-of-(\d+)$", study.name)
    part = f", part {shard[1]} of {shard[2]} only" if shard else ""
    say(f"study{part}: {count_of(n, 'sample')}{nets}, {what}")
    for name in names:
        say(f"  {name}: {_values(study.samples[name], unit_of_column(name))}")
    for note in study.notes:
        say(note)
    if study.moves and SPEED in names and "wind.seed" not in names:
        say(messages.SAME_GUSTS())


def _values(values: np.ndarray, unit: str) -> str:
    different = np.unique(values)
    if values.dtype == object:
        return f"{len(different)} ({format_list(different, MOST_VALUES)})"
    if len(different) <= MOST_VALUES:
        return f"{', '.join(f'{v:g}' for v in different)} {unit}".rstrip()
    text = f"{different[0]:.6g} to {different[-1]:.6g} {unit}".rstrip()
    return f"{text}, {len(different)} values"


def _states(study: Study, say: Callable[..., Any]) -> None:
    state, reason = study.samples["state"], study.samples["reason"]
    all_states = ("finished", "no_equilibrium", "undecided", "diverged", "failed")
    what = {
        "no_equilibrium": " (no stable equilibrium: count as failed, with all of the roof)",
        "undecided": " (no equilibrium was found, but there may be one; left out of the curves)",
        "diverged": " (left out of the curves)",
        "failed": " (for technical reasons; left out of the curves)",
    }
    counts = {name: int((state == name).sum()) for name in all_states}
    listed = [f"{counts[name]} {name}{what.get(name, '')}" for name in all_states if counts[name]]
    say("samples: " + ", ".join(listed))
    for name in all_states[1:]:
        rows = np.flatnonzero(state == name)
        kinds = [COUNTED.sub(r"\1 #", NUMBERS.sub("#", text)) for text in reason[rows].astype(str)]
        _, first, kind, times = np.unique(kinds, return_index=True, return_inverse=True, return_counts=True)
        order = np.argsort(-times, kind="stable")
        for k in order[:MOST_NAMED]:
            row = rows[first[k]]
            inputs = input_text(study.samples, row, varying_inputs(study.samples))
            first_one = f"row {row}" + (f" ({inputs})" if inputs else "")
            differ = " with different numbers" * (len(set(reason[rows[kind == k]])) > 1)
            text = reason[row] or "no reason"
            say(f"  {name}, {count_of(times[k], 'time')}{differ}: {text}; first: {first_one}")
        if len(order) > MOST_NAMED:
            say(f"  {name}: {len(order) - MOST_NAMED} more reasons, in /samples/reason")
    for line in left_out_warnings(study):
        say(line)


def left_out_warnings(study: Study) -> list[str]:
    """Return a warning if samples are excluded from the shares of failures."""
    left_out = ~is_judged(study.samples)
    return [messages.LEFT_OUT(count=left_out.sum(), total=len(left_out))] if left_out.any() else []


def _time(study: Study, say: Callable[..., Any]) -> None:
    seconds = study.samples["seconds"][study.finished]
    if len(seconds):
        say(
            f"time: {np.median(seconds):.3g} s a sample (median; {seconds.min():.3g} to "
            f"{seconds.max():.3g}), {np.nansum(study.samples['seconds']):.4g} s in all"
        )


def _broken(study: Study, say: Callable[..., Any]) -> None:
    m, ran = study.samples, study.finished
    if not study.moves:
        beyond = ran & (m["utilisation_max"] > 1.0)
        if beyond.any():
            most = m["utilisation_max"][beyond].max()
            say(
                f"strength: exceeded in {beyond.sum()} of the {ran.sum()} samples that finished, "
                f"by a factor of up to {most:.3g}; nothing breaks in equilibria"
            )
        return
    broke = ran & (m["broken"] > 0)
    if not broke.any():
        is_elastic = ran.any() and np.isnan(m["utilisation_before_break"][ran]).all()
        why = ", as nothing can break" if is_elastic else ""
        say(f"fracture: none in the {ran.sum()} samples that finished{why}")
        return
    first, lost = m["first_fracture"][broke], 100.0 * m["detached_area"][broke]
    much = f" and {np.median(lost):.3g}% of the roof detaches (median; at most {lost.max():.3g}%)"
    much *= not np.isnan(lost).all()  # a net without a roof
    say(
        f"fracture: in {broke.sum()} of the {ran.sum()} samples that finished, first at "
        f"{np.median(first):.3g} s (median; {first.min():.3g} to {first.max():.3g}); there "
        f"{np.median(m['broken'][broke]):.0f} elements break (median; at most {m['broken'][broke].max()})"
        f"{much}"
    )


def _fragility(study: Study, say: Callable[..., Any]) -> None:
    g = study.fragility
    if not g:
        return
    pooled = f"; {', '.join(g['pooled'])} pooled" if len(g["pooled"]) else ""
    for name in dict.fromkeys(g["curve"]):
        rows = np.flatnonzero(g["curve"] == name)
        suffix = f" for {name}" if name else ""
        seconds = g["exposure"][rows[0]]
        exposure = f"exposure {seconds:g} s" if np.isfinite(seconds) else study.exposure
        say(f"fragility{suffix}: failed of those that ran; {exposure}{pooled}")
        _table(g, rows, say)
        _print_uncertainty(g, rows, say)


def _table(g: Any, rows: Any, say: Any) -> None:
    """Print a line for each criterion: counts at each speed, fitted parameters with intervals, the band."""
    most = g["runs"][rows].max(axis=0)  # the same bins for all criteria, also if few runs have an outcome
    column = max(11, 2 * len(str(most.max())) + 3)
    head = "".join(f"{f'{v:.4g} m/s':>{column}}" for v in statistics.bin_speeds(g["speed"], most, most)[0])
    wide = max(len(g["measure"][k]) for k in rows)
    say(f"  {'':{wide}}{head}   {'median [m/s]':<21}  {'dispersion':<21}  band")
    for k in rows:
        runs, failed = (statistics.bin_speeds(g["speed"], most, g[name][k])[2] for name in ("runs", "failed"))
        counts = "".join(f"{f'{y}/{n}':>{column}}" for n, y in zip(runs, failed))
        median = statistics.interval_text(g["median"][k], g["median_interval"][k], 4)
        dispersion = statistics.interval_text(g["dispersion"][k], g["dispersion_interval"][k], 3)
        half = 0.5 * np.diff(g["band_at_median"][k])[0]
        band = f"+-{half:.0%}" if np.isfinite(half) else "none"
        say(f"  {g['measure'][k]:{wide}}{counts}   {median:<21}  {dispersion:<21}  {band}")


def _print_uncertainty(g: Any, rows: Any, say: Any) -> None:
    """Print the kind of the intervals, the samples needed for narrower ones, and notes."""
    k = rows[0]
    samples, kind = g["samples"][k], g["resampled"][k]
    say(
        f"  (..): {g['level']:.0%} intervals, {kind} resampled; "
        "band: of the fraction that fails at the median speed"
    )
    half = 0.5 * np.diff(g["band_at_median"][k])[0]
    target, needed = statistics.next_half_width(half, samples)
    if needed and g["without_curve"][k] <= FEW_WITHOUT * g["resamples"]:
        advice = f"+-{100 * target:g}% would need some {needed}"
        say(f"  {g['measure'][k]}: +-{half:.0%} with {samples} independent samples; {advice}")
    for note in dict.fromkeys(g["note"][rows]):
        if note:
            listed = g["measure"][rows][g["note"][rows] == note]
            say(f"  note, {', '.join(listed) if len(listed) < len(rows) else 'all measures'}: {note}")
    if g["left_out"][k]:
        texts = [
            f"{g['measure'][k]} {least:.4g} or {most:.4g}"
            for k in rows
            for least, most in [g["median_if_left_out"][k]]
            if np.isfinite(least) and np.isfinite(most)
        ]
        listed = texts or ["none"]
        say(f"  {g['left_out'][k]} left out; the medians if all of them failed, or none: {', '.join(listed)}")


def _hazard(study: Study, say: Callable[..., Any]) -> None:
    """Print annual and long-term probabilities, reliability indices, and their uncertainties."""
    rows = study.hazard
    if not rows:
        return
    years = int(rows["years"])
    say(
        f"hazard: annual maxima of the mean wind speed, {rows['distribution']}; "
        "with the curve of each measure"
    )
    names = [f"{m}, {c}" if c else str(m) for m, c in zip(rows["measure"], rows["curve"])]
    wide = max(map(len, names))
    say(f"  {'':{wide}}  {'in a year':<31}{f'in {years} years':<14}{f'beta 1, {years} years':<19}tail")
    for k, name in enumerate(names):
        say(f"  {name:{wide}}  {_hazard_row(rows, k)}")
    left_out = np.flatnonzero(study.fragility["left_out"])
    if len(left_out) and "if_left_out" in rows:
        bounds = [(names[k], *rows["if_left_out"][k]) for k in left_out]
        texts = [f"{name} {most:.3g} or {least:.3g}" for name, most, least in bounds]
        say(f"  in a year if all samples that are left out failed, or none: {', '.join(texts)}")
    say(
        "  tail: fraction of the probability from speeds below the lowest at which a run failed; it depends "
        "only on the assumed shape of the curve"
    )
    targets = "; ".join(f"{name} {year:g}, {fifty:g}" for name, (year, fifty) in TARGET_RELIABILITY.items())
    say(f"  targets of beta (EN 1990:2002, table B2; 1, {DEFAULT_YEARS} years): {targets}")
    if (rows["tail_share"] > MAX_TAIL_SHARE).any():
        say(messages.TAIL_DOMINATES())
    if any("wind.direction = " in str(curve) for curve in rows["curve"]):
        say(messages.ONE_DIRECTION())
    if "wind.direction" in study.fragility["pooled"]:
        say(messages.EQUAL_DIRECTIONS())
    g = study.fragility
    held = (np.cumsum(g["failed"], axis=1) == 0) & (g["runs"] > 0)  # speeds up to which nothing failed
    bounded = ~np.isfinite(rows["annual_probability"]) & np.isfinite(rows["interval"][:, 0]) & held.any(1)
    if bounded.any():
        at_highest = [runs[which][-1] for runs, which in zip(g["runs"][bounded], held[bounded])]
        samples = np.minimum(g["samples"][bounded], at_highest).min()
        say(messages.BOUND_WITHOUT_CURVE(samples=samples, share=1.0 - 0.05 ** (1.0 / samples)))
    if (study.samples["duration"] < CODE_AVERAGING_TIME_S).any():
        say(messages.SHORT_WIND(exposure=study.exposure))


def _hazard_row(h: Any, k: int) -> str:
    low, high = h["interval"][k]
    annual = h["annual_probability"][k]
    bounds = "no interval" if np.isnan(low) else f"{low:.2g}..{high:.2g}" if low > 0 else f"< {high:.2g}"
    if not np.isfinite(annual):
        return f"no curve ({bounds})"
    beta = f"{h['beta'][k]:.2f}, {h['beta_of_years'][k]:.2f}"
    of_year, of_years = f"{annual:.3g} ({bounds})", f"{h['probability'][k]:.3g}"
    return f"{of_year:<31}{of_years:<14}{beta:<19}{h['tail_share'][k]:.0%}"


def _failures(study: Study, say: Callable[..., Any]) -> None:
    """Print the failure criteria of the study file, for the groups of samples of fragility curves.

    The lines name pooled values of a grid: these are chosen, so the share over them is not a probability.
    Nothing if the study has a fragility curve.
    """
    f = study.failures
    if not f or study.fragility:
        return
    samples = study.samples | {SPEED: np.zeros(len(study.samples["state"]))}
    counted, (curves, pooled) = is_judged(samples), group_curves(samples, study.drawn)
    chosen = [name for name in pooled if study.drawn is not None and name not in study.drawn]
    suffix = f"; {', '.join(chosen)} pooled" if chosen else ""
    rows = zip(f["measure"], f["outcome"], f["limit"])
    own = tuple(FailureCriterion(name=name, outcome=outcome, limit=limit) for name, outcome, limit in rows)
    verdicts = failures(samples, own)
    for each in own:
        verdict = verdicts[each.name]
        for curve in curves:
            runs = int((counted & verdict.judged)[curve.rows].sum())
            failed = int((counted & verdict.failed)[curve.rows].sum())
            text = _share_text(curve, runs, failed, left_out=int((~counted)[curve.rows].sum()))
            of = f", {curve.name}" if curve.name else ""
            say(f"failure, {each.name}{of}: {text or f'not known, as no sample has {each.outcome}'}{suffix}")


def _share_text(curve: FragilityCurve, runs: int, failed: int, left_out: int) -> str:
    """Return the share of failed runs with its interval, and with excluded runs; "" without runs.

    Runs that share a seed or a draw are dependent, so the interval is that of the number of seeds or draws.
    """
    if not runs:
        return ""
    independent, share = min(runs, curve.samples), failed / runs
    low, high = statistics.wilson(np.array([independent]), np.array([independent * share]))[:, 0]
    most = (failed + left_out) / (runs + left_out)
    share, low, high, most = (f"{100.0 * value:.3g}%" for value in (share, low, high, most))
    text = f"{failed} of {runs} samples, {share}"
    if independent > 1:
        of = f", of {independent} independent ones" if independent < runs else ""
        text += f" (95 %: {low} to {high}{of})"
    if left_out:
        text += f"; {left_out} left out, {most} if all of them failed"
    return text


def _elements(study: Study, say: Callable[..., Any]) -> None:
    ran, broke = study.finished.sum(), int(study.first_breaks.sum())
    for what, counts, of in (
        ("first to break", study.first_breaks, broke),
        ("break at all", study.breaks, ran),
    ):
        rows = np.argsort(-counts, kind="stable")[:MOST_NAMED]
        named = [f"{element_name(study.net, e)} in {counts[e]}" for e in rows if counts[e]]
        if named:
            runs = "samples that broke" if of is broke else "samples that finished"
            say(f"{what}, of {of} {runs}: element " + ", ".join(named))


def _removals(study: Study, say: Callable[..., Any]) -> None:
    removals = removals_of(study)
    if removals is None:
        return
    breaks, fails = removals.broken > 0, removals.no_equilibrium > 0
    unstable = removals.not_stable > 0
    say(
        f"member removals: {len(removals.name)} different; further elements break after {breaks.sum()}, "
        f"no equilibrium after {fails.sum()}{_named(removals.name[fails])}"
        + f", of which {unstable.sum()} not stable"
        * bool(unstable.any())
    )
    if (removals.left_out > 0).any():
        unknown = removals.name[removals.left_out > 0]
        say(f"  samples of {len(unknown)} of them are left out and may be worse{_named(unknown)}")
    if (removals.breaking > 0).any():
        breaking = removals.name[removals.breaking > 0]
        say(f"  after {len(breaking)} of them {OUTCOME_TEXT['breaks']}{_named(breaking)}")
    for title, values, text in (
        ("largest detached part of the roof", 100.0 * removals.detached_area, "{:.3g}%"),
        ("largest tension over tension before", removals.tension_ratio, "{:.3g}"),
        (f"largest dynamic factors, {WHERE_SIGNIFICANT}", removals.dynamic_factor, "{:.3g}"),
    ):
        rows = np.argsort(-np.nan_to_num(values), kind="stable")[:MOST_NAMED]
        worst = [f"{text.format(values[k])} (removal of {removals.name[k]})" for k in rows if values[k] > 0]
        if worst:
            say(f"  {title}: " + ", ".join(worst))
    if (removals.dynamic_factor > MAX_DYNAMIC_FACTOR).any():
        say(messages.LARGE_FACTORS(limit=MAX_DYNAMIC_FACTOR))
    if np.any(study.samples.get("gusts", 0)):
        say(messages.FACTORS_WITH_GUSTS())


def _named(names: np.ndarray) -> str:
    return f" ({format_list(names, MOST_NAMED)})" if len(names) else ""


def _correlations(study: Study, say: Callable[..., Any]) -> None:
    """Print the rank correlation of each drawn input with each outcome."""
    outcomes, lines = statistics.responses(study), []
    for name in statistics.drawn_inputs(study):
        text, combination = [], statistics.combination_codes(study, name)
        drawn, draws = study.samples[name].astype(float), statistics.draw_codes(study)
        for what, values in outcomes.items():
            rho, _, significant = statistics.spearman(drawn, values, draws, combination)
            if np.isfinite(rho):
                text.append(f"{what} {rho:+.2f}" if significant else f"{what} ({rho:+.2f})")
        if text:
            lines.append(f"  {with_unit(name)}: " + ", ".join(text))
    if not lines:
        return
    failed = int((study.samples["state"] == "no_equilibrium").sum())
    counted = f"of the {study.finished.sum()} samples that finished"
    counted += f" and the {failed} without equilibrium as the worst" * bool(failed)
    fixed = statistics.chosen_inputs(study)
    counted += f", within each {' and '.join(fixed)}" * bool(fixed)
    say(f"rank correlation (Spearman) with the random inputs, {counted}; (...): not significant")
    for line in lines:
        say(line)


def _print_energy_check(study: Study, say: Callable[..., Any]) -> None:
    in_play, attached = _balance_errors(study)
    error = np.fmax(in_play, attached)
    if not np.isfinite(error).any():
        return
    worst = int(np.nanargmax(error))
    say(
        f"energy check: balance to {in_play[worst]:.1e} of the energy that took part, {attached[worst]:.1e} "
        f"of the largest that attached parts stored, worst in row {worst}"
    )
    for line in balance_warnings(study):
        say(line)


def _balance_errors(study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Return both errors of the energy balance of the samples (N,), nan: not known."""
    in_play, attached = (np.abs(study.samples[name]) for name in BALANCE_COLUMNS)
    return in_play, attached


def balance_warnings(study: Study) -> list[str]:
    """Return a warning if the energy balance error of samples is too large."""
    off = int((np.fmax(*_balance_errors(study)) > MAX_BALANCE_ERROR).sum())
    return [messages.ENERGY_BALANCE(count=off, limit=MAX_BALANCE_ERROR)] if off else []
