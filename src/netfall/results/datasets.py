"""Groups and datasets of a result file, read from the tables of `dataset_tables`.

netfall labels each file with these units as it closes the file. The Python help and the page of the result
file are made from them too.
"""

from fnmatch import fnmatchcase
from typing import NamedTuple

from netfall.core.text import table_rows
from netfall.results.dataset_tables import DATASETS

ORDER_ATTRIBUTE = "order"  # attribute of a group with an equilibrium: its number in the order of computation
NONE = "1"  # unit of dimensionless quantities


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
    groups: list[Group] = []
    for name, *cells in table_rows(DATASETS):
        if name.startswith("/"):
            groups.append(Group(name[1:].replace("NAME", "*"), cells[0], cells[1], ()))
        else:
            rows = (*groups[-1].datasets, Dataset(name, *cells))
            groups[-1] = groups[-1]._replace(datasets=rows)
    return tuple(groups)


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
