"""Defaults that changed: a job that relies on one and is affected gets one warning with both values."""

import pytest
from test_right_answers import BRITTLE

from netfall.driver.check import check_job
from netfall.driver.reporting.run import stages
from netfall.geometry import defaults
from netfall.geometry.build import build_net
from netfall.geometry.defaults import CHANGED, ChangedDefault, default_warnings
from netfall.job.derived import load_steps
from netfall.job.read import read_job

WHOLE = BRITTLE.replace("195.0", "1.95e11")
JOB = WHOLE + "[[zone]]\nname = 'a'\ngroups = ['x']\n"


def warnings_of(workshop, text, overrides=()):
    """Return the warnings of a job of tables."""
    job = read_job(workshop.job(text), overrides)
    return [line.removeprefix("warning: ") for line in default_warnings(job, build_net(job))]


@pytest.fixture
def two_rows(monkeypatch):
    """A flag of [dynamics] and one of the entries of a list."""
    rows = (
        ChangedDefault("dynamics", "fragments", True, False, lambda job, net: net.m > 0),
        ChangedDefault("zone", "cut", True, False, lambda job, net: bool(job.zones)),
    )
    monkeypatch.setattr(defaults, "CHANGED", rows)
    return [
        "[dynamics] fragments is not set: true since version 0.5 (false before). Set it. [W253]",
        "[[zone]] cut is not set: true since version 0.5 (false before). Set it. [W253]",
    ]


def test_a_key_left_out_is_warned_of_once(workshop, two_rows):
    """In a section or the entries of a list, unless the file or an override sets it in all of them."""
    assert warnings_of(workshop, JOB) == two_rows
    assert warnings_of(workshop, JOB + "cut = false\n", ["dynamics.fragments=true"]) == []
    another = "cut = false\n[[zone]]\nname = 'b'\ngroups = ['x']\n"
    assert warnings_of(workshop, JOB + another) == two_rows
    assert warnings_of(workshop, WHOLE) == two_rows[:1]


def test_check_says_the_warnings(workshop, two_rows):
    """`check` says them with the notes on the job; `run` and the result take them from the same list."""
    lines = []
    check_job(read_job(workshop.job(WHOLE)), lines.append)
    assert [line for line in lines if line.startswith("warning:")] == [f"warning: {two_rows[0]}"]


def test_rows_name_keys_that_have_the_new_default():
    """The table agrees with the table of keys."""
    from netfall.job.keys.schema import LIST_KEYS, SECTIONS

    for row in CHANGED:
        (key,) = [key for key in (SECTIONS | LIST_KEYS)[row.section] if key.name == row.key]
        assert key.default in (row.new, None), row


def test_self_weight_and_a_load_step_are_defaults(workshop):
    """A job of loads alone weighs and has one load step, as `check` says; a dynamic stage has none."""
    statics = WHOLE.partition("[dynamics]")[0] + "[load]\n"
    moves = statics + "[dynamics]\nduration = 0.1\n"
    weight = "[load] self_weight is not set: true since version 0.5 (false before). Set it. [W253]"
    step = "[load] steps is not set: 1 since version 0.5 (0 before). Set it. [W253]"
    assert warnings_of(workshop, statics) == [weight, step] and warnings_of(workshop, moves) == [weight]
    assert warnings_of(workshop, statics + "self_weight = false\nsteps = 0\n") == []
    job = read_job(workshop.job(statics))
    assert job.load.self_weight and load_steps(job) == 1
    assert stages(job)[1:] == ["statics (1 load step)"]
    assert load_steps(read_job(workshop.job(moves))) == 0


def test_a_polygon_cuts_by_default(workshop):
    """Zones of groups have nothing to cut."""
    zone = "[[zone]]\nname = 'a'\n"
    text = WHOLE.partition("[dynamics]")[0] + zone
    cut = "[[zone]] cut is not set: true since version 0.5 (false before). Set it. [W253]"
    assert warnings_of(workshop, text + "polygon = [[0, 0], [1, 0], [1, 1]]\n") == [cut]
    assert warnings_of(workshop, text + "groups = ['x']\n") == []


@pytest.mark.parametrize(
    "keys, affected",
    [
        ("speed = 20.0\nturbulence_intensity = 0.2\n", True),
        ("speed = 20.0\nturbulence_intensity = 0.2\ngust_field = 'point'\n", False),
        ("speed = 20.0\nturbulence_intensity = 0.0\n", False),
        ("file = 'speeds.csv'\n", False),
    ],
)
def test_gusts_of_no_kind_are_warned_of(workshop, keys, affected):
    """A wind with gusts that does not say of which kind they are; not a steady or a measured one."""
    text = JOB + "[wind]\npressure_coefficient = -1.0\nbase_height = 0.0\n" + keys
    line = '[wind] gust_field is not set: "area_mean" since version 0.5 ("point" before). Set it. [W253]'
    assert (line in warnings_of(workshop, text)) == affected
