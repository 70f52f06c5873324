"""Defaults that changed: a job that relies on one and is affected gets one warning with both values."""

import pytest
from test_right_answers import BRITTLE

from netfall.job.read import read_job
from netfall.net import defaults
from netfall.net.build import build_net
from netfall.net.defaults import CHANGED, ChangedDefault, default_warnings
from netfall.program.check import check_job

JOB = BRITTLE.replace("195.0", "1.95e11") + "[[zone]]\nname = 'a'\ngroups = ['x']\n"


@pytest.fixture
def two_rows(monkeypatch):
    """A flag of [dynamics] and one of the entries of a list."""
    rows = (
        ChangedDefault("dynamics", "fragments", True, False, lambda job, net: net.m > 0),
        ChangedDefault("zone", "cut", True, False, lambda job, net: bool(job.zones)),
    )
    monkeypatch.setattr(defaults, "CHANGED", rows)
    return (
        "warning: [dynamics] fragments is not set: true since version 0.5 (false before)",
        "warning: [[zone]] cut is not set: true since version 0.5 (false before)",
    )


def test_a_key_left_out_is_warned_of_once(workshop, two_rows):
    """One warning a key, whether it stands in a section or in the entries of a list."""
    job = read_job(workshop.job(JOB))
    assert tuple(default_warnings(job, build_net(job))) == two_rows


def test_a_key_that_is_set_needs_no_warning(workshop, two_rows):
    """In the file or by an override, with either value; a list needs it in all entries."""
    job = read_job(workshop.job(JOB + "cut = false\n"), ["dynamics.fragments=true"])
    assert default_warnings(job, build_net(job)) == []
    job = read_job(workshop.job(JOB + "cut = false\n[[zone]]\nname = 'b'\ngroups = ['x']\n"))
    assert tuple(default_warnings(job, build_net(job))) == two_rows


def test_an_unaffected_job_needs_no_warning(workshop, two_rows):
    """Without zones nothing is said of their key."""
    job = read_job(workshop.job(JOB.partition("[[zone]]")[0]))
    assert tuple(default_warnings(job, build_net(job))) == two_rows[:1]


def test_check_says_the_warnings(workshop, two_rows):
    """`check` says them with the notes on the job; `run` and the result take them from the same list."""
    lines = []
    check_job(read_job(workshop.job(JOB.partition("[[zone]]")[0])), lines.append)
    assert [line for line in lines if line.startswith("warning:")] == [two_rows[0]]


def test_rows_name_keys_that_have_the_new_default():
    """The table agrees with the table of keys."""
    from netfall.job.entries import LISTS
    from netfall.job.schema import SECTIONS

    for row in CHANGED:
        (key,) = [key for key in (SECTIONS | LISTS)[row.section] if key.name == row.key]
        assert key.default in (row.new, None), row
