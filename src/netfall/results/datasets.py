"""The datasets of a result file, as the page README.md beside has them: unit and meaning of each.

A file is labelled from that page as it is closed, and the help of Python is made from it.
"""

import re
from fnmatch import fnmatchcase
from importlib.resources import files
from typing import NamedTuple

ORDER = "order"  # attribute of a group that holds an equilibrium: its place among them
NONE = "1"  # the unit of what has no dimension
# A section of the page: its name, its sentence, what a job must ask for to have it, its table.
SECTION = re.compile(
    r"^### /(\S+)\n\n(.+?)\n\n(?:Written for a job with: (.+?)\n\n)?\| dataset.*\n.*\n((?:\|.*\n)+)", re.M
)
ROW = re.compile(r"^\| `(.+?)`(?: \((.+?)\))? \| (.*?) \| (.*) \|$", re.M)


class Dataset(NamedTuple):
    """One dataset: its name in the group, what its axes count, its unit, its meaning."""

    name: str
    shape: str
    unit: str
    meaning: str


class Group(NamedTuple):
    """A group of the file: what it holds, what a job must ask for to have it, and its datasets."""

    name: str
    meaning: str
    lacking: str
    datasets: tuple[Dataset, ...]


def _groups() -> tuple[Group, ...]:
    page = files(__package__).joinpath("README.md").read_text(encoding="utf-8")
    table = page.partition("<!-- datasets:")[2].partition("<!-- end -->")[0]
    return tuple(
        Group(name.replace("NAME", "*"), meaning, lacking, tuple(map(Dataset._make, ROW.findall(rows))))
        for name, meaning, lacking, rows in SECTION.findall(table)
    )


GROUPS = _groups()


def group_of(name: str) -> Group:
    """The section of a group of the file, "cases/snow" for one. Raises KeyError where there is none."""
    for group in GROUPS:
        if fnmatchcase(name, group.name) or name == group.name.partition("/")[0]:
            return group
    raise KeyError(f"no group /{name} in the table of datasets")


def unit_of(path: str) -> str:
    """The unit of a dataset of numbers by its path in the file. Raises KeyError where the page has no row.

    Numbers by which VTK finds its way through /VTKHDF need no row.
    """
    group, _, name = path.rpartition("/")
    if path.startswith("VTKHDF/"):
        group, name = "VTKHDF", path.removeprefix("VTKHDF/")
    units = {each.name: each.unit for each in group_of(group).datasets}
    if name not in units and group != "VTKHDF":
        raise KeyError(f"/{path} has no row in the table of datasets")
    return units.get(name) or NONE
