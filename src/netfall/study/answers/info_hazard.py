"""Text of `netfall info` on the annual probability of failure."""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.study import messages
from netfall.study.answers.hazard import DEFAULT_YEARS, TARGET_RELIABILITY
from netfall.study.answers.read import Study

CODE_AVERAGING_TIME_S = 600.0  # s, averaging time of the mean wind speed in EN 1991-1-4
MUCH = 0.5  # share of the tail above which the probability depends on the shape of the curve


def print_hazard(study: Study, say: Callable[..., Any]) -> None:
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
        say(f"  {name:{wide}}  {_row(rows, k)}")
    say(
        "  tail: share of the probability from speeds below the lowest at which a run failed, where the "
        "curve's form alone speaks"
    )
    targets = "; ".join(
        f"{name} {annual:g}, {fifty:g}" for name, (annual, fifty) in TARGET_RELIABILITY.items()
    )
    say(f"  targets of beta (EN 1990:2002, table B2; 1, {DEFAULT_YEARS} years): {targets}")
    if (rows["tail_share"] > MUCH).any():
        say(messages.TAIL_DOMINATES())
    if any("wind.direction = " in str(curve) for curve in rows["curve"]):
        say(messages.ONE_DIRECTION())
    if "wind.direction" in study.fragility["pooled"]:
        say(messages.EQUAL_DIRECTIONS())
    bounded = ~np.isfinite(rows["annual_probability"]) & np.isfinite(rows["interval"][:, 0])
    if bounded.any():
        samples = study.fragility["samples"][bounded].min()
        say(messages.BOUND_WITHOUT_CURVE(samples=samples, share=1.0 - 0.05 ** (1.0 / samples)))
    exposure = study.fragility["exposure"]
    if (exposure < CODE_AVERAGING_TIME_S).any():
        say(messages.SHORT_WIND(exposure=study.exposure))


def _row(h: Any, k: int) -> str:
    low, high = h["interval"][k]
    annual = h["annual_probability"][k]
    bounds = "no interval" if np.isnan(low) else f"{low:.2g}..{high:.2g}" if low > 0 else f"< {high:.2g}"
    if not np.isfinite(annual):
        return f"no curve ({bounds})"
    beta = f"{h['beta'][k]:.2f}, {h['beta_of_years'][k]:.2f}"
    of_year, of_years = f"{annual:.3g} ({bounds})", f"{h['probability'][k]:.3g}"
    return f"{of_year:<31}{of_years:<14}{beta:<19}{h['tail_share'][k]:.0%}"
