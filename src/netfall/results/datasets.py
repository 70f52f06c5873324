"""Table of datasets of a result file: unit and meaning of each, parsed from README.md of this package.

netfall labels each file from this table as it closes the file. The Python help is made from it too.
"""

import re
from fnmatch import fnmatchcase
from importlib.resources import files
from typing import NamedTuple

ORDER_ATTRIBUTE = "order"  # attribute of a group with an equilibrium: its number in the order of computation
NONE = "1"  # unit of dimensionless quantities
# A section of the page: name of the group, meaning, part of a job that requests it, table of datasets.
SECTION = re.compile(
    r"^### /(\S+)\n\n(.+?)\n\n(?:Written for a job with: (.+?)\n\n)?\| dataset.*\n.*\n((?:\|.*\n)+)", re.M
)
ROW = re.compile(r"^\| `(.+?)`(?: \((.+?)\))? \| (.*?) \| (.*) \|$", re.M)


class Dataset(NamedTuple):
    """One dataset: name within its group, shape, unit and meaning."""

    name: str
    shape: str
    unit: str
    meaning: str


class Group(NamedTuple):
    """A group of the file: its meaning, the part of a job that requests it, and its datasets."""

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


def find_group(name: str) -> Group:
    """Return the description of a group of the file, for example of "cases/snow".

    Raises KeyError if the table does not list the group.
    """
    for group in GROUPS:
        if fnmatchcase(name, group.name) or name == group.name.partition("/")[0]:
            return group
    raise KeyError(f"no group /{name} in the table of datasets")


def dataset_unit(path: str) -> str:
    """Return the unit of a numerical dataset from its path in the file.

    Raises KeyError if the table does not list it. Index datasets of /VTKHDF, which only VTK reads, need no
    row.
    """
    group, _, name = path.rpartition("/")
    if path.startswith("VTKHDF/"):
        group, name = "VTKHDF", path.removeprefix("VTKHDF/")
    units = {dataset.name: dataset.unit for dataset in find_group(group).datasets}
    if name not in units and group != "VTKHDF":
        raise KeyError(f"/{path} has no row in the table of datasets")
    return units.get(name) or NONE
