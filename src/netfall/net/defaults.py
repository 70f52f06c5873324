"""Defaults that changed in this version, and the warnings to jobs that relied on them.

A default that changes is a row of CHANGED. Everything that begins a run or describes a job says the warnings.
"""

from collections.abc import Callable
from typing import NamedTuple

from netfall.job.entries import LISTS
from netfall.job.job import Job, tables_of
from netfall.job.values import shown
from netfall.net.net import Net

SINCE = "0.5"  # version from which the new defaults hold


class ChangedDefault(NamedTuple):
    """A key of a section, or of the entries of a list, whose default changed from `old` to `new`.

    affects : whether the results of a job that does not set the key depend on its default
    """

    section: str
    key: str
    new: object
    old: object
    affects: Callable[[Job, Net], bool]


CHANGED: tuple[ChangedDefault, ...] = ()


def default_warnings(job: Job, net: Net) -> list[str]:
    """Return a warning for each key that a job does not set, whose default changed, and that affects it."""
    return [
        f"warning: {_place(row.section)} {row.key} is not set: {shown(row.new)} since version {SINCE} "
        f"({shown(row.old)} before)"
        for row in CHANGED
        if _is_left_out(job, row.section, row.key) and row.affects(job, net)
    ]


def _place(section: str) -> str:
    return f"[[{section}]]" if section in LISTS else f"[{section}]"


def _is_left_out(job: Job, section: str, key: str) -> bool:
    """Whether the job file and its overrides leave a key to its default, in any entry of a list."""
    tables = tables_of(job.text, job.overrides).get(section, {})
    return any(key not in table for table in (tables if section in LISTS else [tables]))
