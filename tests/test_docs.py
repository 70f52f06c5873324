"""`netfall docs`: every entry of the reference is found by its name, from the shipped pages alone."""

import functools
import re
import subprocess
import sys

import pytest
from conftest import ENVIRONMENT, ROOT, refused, run_on_standing_ranks
from reference_pages import command_parsers

from netfall.core.errors import InputError
from netfall.docs import topics
from netfall.docs.topics import find, pages, tables_of
from netfall.geometry.tables import ELEMENT_COLUMNS, NODE_COLUMNS
from netfall.job.keys.schema import LIST_KEYS, TABLES
from netfall.results.datasets import GROUPS

KEYS = [(name, key) for name, keys in (TABLES | LIST_KEYS).items() if name for key in keys]
FORBIDDEN = ("numpy", "numba", "mpi4py", "pydantic", "h5py")  # their import is slower than the answer


@pytest.fixture(autouse=True, scope="module")
def pages_read_once():
    """Read the topics of the pages once for all look-ups, each of which is a process of its own for users."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(topics, "topics_of", functools.cache(topics.topics_of))
        yield


def test_every_key_is_found_by_its_full_name():
    """The entry of each key contains name, unit, range and meaning."""
    for section, key in KEYS:
        text = " ".join(find(f"{section}.{key.name}").split())
        assert " ".join(key.meaning.replace("`", "").split()) in text, key.name
        assert f"[{key.unit}]" in text + "[]" and f"{key.low:g}" in text if key.low else True


def test_columns_datasets_and_commands_are_found():
    """Columns by their names, datasets by their paths, commands with and without "netfall"."""
    for table, columns in (("nodes", NODE_COLUMNS), ("elements", ELEMENT_COLUMNS)):
        assert all("reference/tables" in find(f"{table}.{column}") for column in columns)
    for group in GROUPS:
        for dataset in group.datasets:
            path = f"/{group.name.replace('*', 'NAME')}/{dataset.name}"
            assert dataset.meaning.replace("`", "")[:40] in find(path), path
    for command in command_parsers():
        assert f"netfall {command}" in find(command) and f"netfall {command}" in find(f"netfall {command}")


@pytest.mark.parametrize(
    "topic, text",
    [
        ("group.hoop.area", "cable.area (reference/job/cable)"),
        ("[wind] speed", "wind.speed (reference/job/wind)"),
        ("load.zone.edge.snow", "load.snow"),
        ("[[slide]]", "# [[slide]]"),
        ("exit-codes", "# Exit codes"),
        ("reference/job/net", "# [net]"),
        ("tension", "statics.tension"),
        ("WIND.SPEED", "wind.speed"),
        ("reference/job/net.md", "# [net]"),
        ("summary.md", "worst member of each group and check"),
        ("springs", "layer that marks elastic supports"),
        ("limits.group.edge", "# [limits]"),
        ("[wind.zone]", "# [[zone]]"),
        ("E922", 'expected {each = "element", ...} or {each = "cable", ...}'),
    ],
)
def test_other_spellings(topic, text):
    """Sections in brackets, groups, zones, pages with their path, files, options, capitals, codes."""
    assert text in find(topic)


def test_an_unknown_topic_is_answered_with_near_names():
    """One line on standard error, exit code 2."""
    assert "no such topic; did you mean" in refused("docs", "wind.sped")
    assert re.search("pages with this text: .*explanation/wind", refused("docs", "Davenport"))
    with pytest.raises(InputError, match="lists the pages"):
        find("xyzzyxyzzy")


def test_without_a_topic_the_pages_are_listed():
    """Each page, with its title."""
    lines = run_on_standing_ranks("docs").stdout.splitlines()
    assert [line.split()[0] for line in lines[: len(pages())]] == list(pages())


def test_the_command_loads_no_large_package():
    """The command must start quickly."""
    script = (
        f"import sys; from netfall.__main__ import main; main(); print(*{{*{FORBIDDEN}}} & {{*sys.modules}})"
    )
    command = [sys.executable, "-c", script, "docs", "wind.speed"]
    done = subprocess.run(command, env=ENVIRONMENT, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""


def test_bars_in_cells_are_not_ends_of_cells():
    """A bar behind a backslash belongs to its cell."""
    assert tables_of("| a | b |\n|---|---|\n| `x` | 1 \\| 2 |\n") == [[["a", "b"], ["`x`", "1 \\| 2"]]]
