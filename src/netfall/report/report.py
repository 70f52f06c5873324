"""`netfall report`: what an engineer hands on, from a result file alone.

summary.md, and tables with a header: cables.csv, elements.csv, cutting_list.csv, reactions.csv; and pictures
of the roof by utilisation and, where members are lost, by dynamic factors. Ids are those of the tables,
numbers are in SI units.
"""

from pathlib import Path

from netfall.checks.cables import (
    Cutting,
    cable_columns,
    check_elements,
    cutting_columns,
    element_columns,
    resistances_of,
)
from netfall.checks.codes import check_groups, read_codes
from netfall.checks.reactions import reaction_columns
from netfall.ground.errors import InputError
from netfall.job.table import write_table
from netfall.plots.utilisation import dynamic_factors, utilisation
from netfall.report.page import summary
from netfall.results.file import reading
from netfall.results.states import envelope_of
from netfall.write.locks import whole

DIGITS = 12  # of the numbers in tables


def write_report(result: Path, folder: Path, codes: Path | None, cutting: Cutting) -> list[Path]:
    """Write the report of a result file; the paths of what was written.

    codes : a file of checks instead of the shipped one. Raises InputError for a wrong file.
    """
    checks = read_codes(codes)
    with reading(result) as f:
        check_groups(codes, checks, f["net/group_names"].asstr()[:].tolist())
        resistance = resistances_of(f, checks)
        envelope = envelope_of(f, resistance[checks[0].name])
        checked = check_elements(f, checks, resistance, envelope)
        tables = {
            "cables.csv": cable_columns(f, envelope, checked),
            "elements.csv": element_columns(f, envelope, checked),
            "cutting_list.csv": cutting_columns(f, cutting),
            "reactions.csv": reaction_columns(f),
        }
        text = summary(f, result, tables, envelope, checked, cutting)
        folder.mkdir(parents=True, exist_ok=True)
        for name, columns in tables.items():
            _check_ours(folder / name, columns)
        with whole(folder / "summary.md") as place:
            place.write_text(text, encoding="utf-8")
        for name, columns in tables.items():
            with whole(folder / name) as place:
                write_table(place, columns, digits=DIGITS)
        utilisation(f, envelope, checked, folder / "utilisation.png")
        pictures = ["utilisation.png"]
        if "removal" in f:
            factors = tables["elements.csv"]["dynamic_factor"]
            dynamic_factors(f, factors, folder / "dynamic_factors.png")
            pictures.append("dynamic_factors.png")
    return [folder / name for name in ("summary.md", *tables, *pictures)]


def _check_ours(path: Path, columns: dict) -> None:
    """Refuse to write over a table of the user's, a catalogue perhaps. Raises InputError."""
    begin = ",".join(list(columns)[:3])
    if path.exists() and not path.read_text(errors="replace").startswith(begin):
        raise InputError(
            f"{path}: exists and is no table of a report; move it away, or give another folder with -o"
        )
