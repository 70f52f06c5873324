"""Defaults that changed in this version, and warnings for jobs that relied on the old ones.

Each changed default is a row of CHANGED. Every command that starts a run or describes a job prints the
warnings.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from netfall.geometry import messages
from netfall.geometry.net import Net
from netfall.geometry.sections import default_breaking_force, is_bar_among_cables
from netfall.job.derived import carries_permanent, has_gusts, load_steps
from netfall.job.job import Job, parse_tables
from netfall.job.keys.groups import displacement_limits
from netfall.job.keys.schema import LIST_KEYS
from netfall.job.values import SINCE, counted, format_value


class ChangedDefault(NamedTuple):
    """Key of a section, or of the entries of a list, whose default changed from `old` to `new`.

    affects : whether the results of a job that does not set the key depend on its default
    """

    section: str
    key: str
    new: object
    old: object
    affects: Callable[[Job, Net], bool]


def _breaks_in_wind(job: Job, net: Net) -> bool:
    """Tell whether elements can break or are removed in a dynamic stage with wind."""
    return bool(job.wind and job.dynamics and (np.isfinite(net.fracture_strain).any() or job.removes))


def _cuts_by_default(job: Job, net: Net) -> bool:
    """Tell whether a zone with a polygon does not set `cut`."""
    return any(zone.polygon is not None and zone.cut is None for zone in job.zones)


def _limits_displacements(job: Job, net: Net) -> bool:
    """Tell whether a limit of displacements counts, and permanent loads act that the form does not carry."""
    limits, loads = job.limits, job.load and (job.load.self_weight or any(job.loads("dead")))
    is_checked = any(combination.kind == "SLS" for combination in job.combinations)
    has_limit = bool(limits and displacement_limits(limits, net.group_names))
    return bool(has_limit and is_checked and loads) and not carries_permanent(job)


CHANGED: tuple[ChangedDefault, ...] = (
    ChangedDefault("load", "self_weight", True, False, lambda job, net: job.load is not None),
    ChangedDefault("load", "steps", 1, 0, lambda job, net: load_steps(job) == 1),
    ChangedDefault("zone", "cut", True, False, _cuts_by_default),
    ChangedDefault("wind", "gust_field", "area_mean", "point", lambda job, net: has_gusts(job)),
    ChangedDefault("wind", "after_fracture", "detached", "particle", _breaks_in_wind),
    ChangedDefault("limits", "from", "permanent", "form", _limits_displacements),
)


def default_warnings(job: Job, net: Net) -> Iterator[str]:
    """Yield a warning for each key with a changed default that affects a job and that it does not set."""
    given = parse_tables(job.text, job.overrides)
    for section, key, new, old, affects in CHANGED:
        entries = given.get(section, []) if section in LIST_KEYS else [given.get(section, {})]
        place = f"[[{section}]]" if section in LIST_KEYS else f"[{section}]"
        if any(key not in table for table in entries) and affects(job, net):
            yield messages.CHANGED_DEFAULT(
                key=f"{place} {key}", since=SINCE, new=format_value(new), old=format_value(old)
            )
    inherited = default_breaking_force(job)
    bars = is_bar_among_cables(job, net) & np.isinf(net.breaking_load) & (inherited is not None)
    for name, ids in net.ids_by_group(bars):  # these took the breaking force of [cable] before
        place, named_bars = f"[group.{name}]" if name else "elements.csv:", counted("bar", ids)
        yield messages.NO_INHERITED_BREAKING_LOAD(place=place, bars=named_bars, since=SINCE, force=inherited)
