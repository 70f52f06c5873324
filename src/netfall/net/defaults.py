"""Defaults that changed in this version, and the warnings to jobs that relied on them.

A default that changes is a row of CHANGED. Everything that begins a run or describes a job says the warnings.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from netfall.job.asks import has_gusts, load_steps
from netfall.job.entries import LISTS
from netfall.job.job import Job, tables_of
from netfall.job.schema import REMOVED, SINCE
from netfall.job.values import counted, shown
from netfall.net.net import Net
from netfall.net.sections import are_other_bars, strength_of_cable


class ChangedDefault(NamedTuple):
    """A key of a section, or of the entries of a list, whose default changed from `old` to `new`.

    affects : whether the results of a job that does not set the key depend on its default
    """

    section: str
    key: str
    new: object
    old: object
    affects: Callable[[Job, Net], bool]


def _breaks_in_wind(job: Job, net: Net) -> bool:
    return bool(job.wind and job.dynamics and (np.isfinite(net.fracture_strain).any() or job.removes))


CHANGED: tuple[ChangedDefault, ...] = (
    ChangedDefault("load", "self_weight", True, False, lambda job, net: job.load is not None),
    ChangedDefault("load", "steps", 1, 0, lambda job, net: load_steps(job) == 1),
    ChangedDefault("zone", "cut", True, False, lambda job, net: any(map(_cuts_by_default, job.zones))),
    ChangedDefault("wind", "gusts", "means", "points", lambda job, net: has_gusts(job)),
    ChangedDefault("wind", "after_fracture", "detached", "particle", _breaks_in_wind),
)


def default_warnings(job: Job, net: Net) -> list[str]:
    """Return a warning for each key that a job does not set, whose default changed, and that affects it."""
    return (
        [
            f"warning: {_place(row.section)} {row.key} is not set: {shown(row.new)} since version {SINCE} "
            f"({shown(row.old)} before)"
            for row in CHANGED
            if _is_left_out(job, row.section, row.key) and row.affects(job, net)
        ]
        + _strengths_not_inherited(job, net)
        + _removed_keys(job)
    )


def _removed_keys(job: Job) -> list[str]:
    """Return a warning for each removed key that a job still sets to the value that is accepted."""
    return [
        f"warning: [{section}] {key}: removed in version {SINCE}, {why}. Remove the key."
        for section, keys in REMOVED.items()
        for key, (_, why) in keys.items()
        if f"{section}.{key}" in job.given()
    ]


def _strengths_not_inherited(job: Job, net: Net) -> list[str]:
    """Return a warning for each group of bars that took the breaking load of [cable] before."""
    inherited = strength_of_cable(job)
    bars = are_other_bars(job, net) & np.isinf(net.breaking_load)
    if inherited is None or not bars.any():
        return []
    return [
        f"warning: {f'[cable.{name}]' if name else 'elements.csv:'} breaking_load of "
        f"{counted('bar', net.element_id[bars & (net.group == g)])} is not set: none since version {SINCE} "
        f"({inherited:g} N of [cable] before)"
        for g, name in enumerate(net.group_names)
        if (bars & (net.group == g)).any()
    ]


def _cuts_by_default(zone: SimpleNamespace) -> bool:
    return zone.polygon is not None and zone.cut is None


def _place(section: str) -> str:
    return f"[[{section}]]" if section in LISTS else f"[{section}]"


def _is_left_out(job: Job, section: str, key: str) -> bool:
    """Whether the job file and its overrides leave a key to its default, in any entry of a list."""
    tables = tables_of(job.text, job.overrides).get(section, {})
    return any(key not in table for table in (tables if section in LISTS else [tables]))
