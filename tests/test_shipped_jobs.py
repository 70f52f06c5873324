"""A key is there because a shipped job or study shows what it is for."""

import tomllib

import pytest
from conftest import ROOT

from netfall.job.schema import LISTS, OVERRIDES, SECTIONS

FILES = sorted((ROOT / "jobs").rglob("*.toml"))
KEYS = [f"{name}.{key.name}" for name, keys in (SECTIONS | LISTS).items() for key in keys if name]
GIVES_UP = "where a run gives up; one that comes to its end never gets there"
NOT_SHOWN = {
    "form_finding.max_iterations": GIVES_UP,
    "load.max_iterations": GIVES_UP,
    "dynamics.precision": "each value against the others: jobs/trade",
}


def of_job(job: dict) -> set[str]:
    """Keys of a job, SECTION.KEY; those of a group or a zone count as those of the section."""
    used = set()
    for section, content in job.items():
        tables = content if isinstance(content, list) else [content]
        for table in (table for table in tables if isinstance(table, dict)):
            used |= {f"{section}.{key}" for key in table}
            inner = table.get("zone", {}) if OVERRIDES.get(section, ("",))[0] else table
            if section in OVERRIDES:
                used |= {
                    f"{section}.{key}" for part in inner.values() if isinstance(part, dict) for key in part
                }
    return used


def of_study(study: dict) -> set[str]:
    """Keys of a job that a study varies or draws."""
    return {key for part in ("vary", "sample") for key in study.get(part, {}) if "." in key}


@pytest.fixture(scope="module")
def used():
    """Keys that shipped jobs and studies give."""
    read = [tomllib.loads(path.read_text()) for path in FILES]
    return set().union(
        *(of_study(file) if isinstance(file.get("job"), str) else of_job(file) for file in read)
    )


@pytest.mark.parametrize("key", [key for key in KEYS if key not in NOT_SHOWN])
def test_each_key_is_in_a_shipped_job(key, used):
    """Else it goes, or gets the job or study that shows why it is there."""
    assert key in used


def test_exceptions_are_keys():
    """Of the schema as it is."""
    assert set(NOT_SHOWN) <= set(KEYS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_file_says_what_it_is_and_how_it_is_run(path):
    """In its head, by its own name."""
    head = path.read_text().split("\n\n")[0]
    assert head.startswith("# ") and path.stem in head
