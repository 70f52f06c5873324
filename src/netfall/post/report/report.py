"""Command `netfall report`: documents for the engineer, from only a result file.

The report contains summary.md, tables with a header, and pictures: the form, equilibria, and the roof by
utilisation and, after member removals, by dynamic factors. report.html is the page with its pictures in one
file. Ids are those of the tables. Numbers are in SI units, in the shop list in mm.
"""

import html
import re
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from markdown_it import MarkdownIt

from netfall.core.errors import InputError
from netfall.core.progress import one_line
from netfall.job.csv_table import write_table
from netfall.post import messages
from netfall.post.checks import cables
from netfall.post.checks.bending import (
    euler_alone_warnings,
    is_bending,
    is_concrete,
    moment_table,
    unchecked_bending,
)
from netfall.post.checks.cases import case_columns, displacement_columns, force_columns, group_columns
from netfall.post.checks.codes import check_groups, read_codes
from netfall.post.checks.ends import end_weights
from netfall.post.checks.nodes import reaction_columns, slip_point_columns, undivided_bending
from netfall.post.checks.shop import Deduction, read_deductions, shop_columns
from netfall.post.plots.canvas import remove_earlier, save
from netfall.post.plots.run import draw_pictures
from netfall.post.plots.utilisation import dynamic_factors, moments, utilisation
from netfall.post.report.page import summary
from netfall.results.file import open_checked, read_cases, result_title
from netfall.results.locks import whole
from netfall.results.states import Envelope, compute_envelope

CELL = re.compile(r"<t[dh]\b.*?</t[dh]>")  # table cell; long names in it may break after a _
PICTURE_WIDTH = 660  # pixels; width of pictures in word processors, while browsers fit them to the window
OPTIONAL_TABLES = {  # tables that not every report has, and how their text begins
    "moments.csv": b"element,group,node",
    "slides.csv": b"node,cable,stage",
}
OPTIONAL_PICTURES = {"form.png", "stages.png", "states.png", "moments.png", "dynamic_factors.png"}
PAGE = Path(__file__).with_name("page.html")


def one_page(text: str, title: str, folder: Path, pictures: list[str]) -> str:
    """Convert a Markdown text to HTML; only the named pictures of the folder are embedded, no other file."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(text)
    for token in tokens:
        if token.type == "table_open":  # word processors ignore the style sheet
            token.attrs |= {"border": 1, "cellspacing": 0, "cellpadding": 3, "width": "100%"}
        for image in (child for child in token.children or () if child.type == "image"):
            if image.attrs["src"] not in pictures:
                image.type = "text"
                continue
            data = b64encode((folder / image.attrs["src"]).read_bytes()).decode()
            image.attrs |= {"src": f"data:image/png;base64,{data}", "width": PICTURE_WIDTH}
    body = reader.renderer.render(tokens, reader.options, {})
    body = CELL.sub(lambda cell: cell[0].replace("_", "_\u200b"), body)
    parts = {"title": html.escape(one_line(title)), "body": body}
    return re.sub(r"\[\[(\w+)\]\]", lambda name: parts[name[1]], PAGE.read_text(encoding="utf-8"))


DEFAULT_CUTTING = cables.Cutting()
DIGITS = 12  # significant digits of the numbers in tables


def write_report(
    result: Path,
    folder: Path,
    say: Callable[[str], Any] = lambda line: None,
    codes: Path | None = None,
    cutting: cables.Cutting = DEFAULT_CUTTING,
    deductions: Path | None = None,
) -> list[Path]:
    """Write the report of a result file, and return the paths of its files.

    say : receives each warning and note of the report, without those of the run
    codes : a file of checks instead of the shipped one; deductions : a table of rigid ends of cables

    Raises InputError for a wrong file.
    """
    checks = read_codes(codes)
    with open_checked(result) as f:
        check_groups(codes, checks, f["net/group_names"].asstr()[:].tolist())
        envelope = compute_envelope(f, end_weights(f))
        checked = cables.check_elements(f, cables.applicable_checks(f, checks), envelope)
        groups, types = (
            sorted(set(of(f).tolist()) - {""}) for of in (cables.element_groups, cables.element_types)
        )
        rigid_ends, notes = read_deductions(deductions, groups, types)
        tables = _tables(f, envelope, checked, cutting, rigid_ends)
        warnings = cables.excessive_load_warnings(f, cutting)
        warnings += cables.missing_strength_warnings(f, envelope, checked)
        warnings += cables.unchecked_compression_warnings(f, envelope, checked)
        warnings += euler_alone_warnings(f, envelope)
        warnings += unchecked_bending(f, envelope, checked[0].unchecked)
        warnings += undivided_bending(f)
        text = summary(f, result, tables, envelope, checked, cutting, warnings)
        for name, columns in tables.items():  # tables of the user, such as a catalogue, are not overwritten
            path, header = folder / name, ",".join(list(columns)[:3])
            if path.exists() and not path.read_text(errors="replace").startswith(header):
                raise InputError(messages.FOREIGN_TABLE(path=path))
        for name, columns in tables.items():
            with whole(folder / name) as temporary:
                write_table(temporary, columns, digits=DIGITS)
        pictures = _pictures(f, envelope, checked, tables, folder)
        title = result_title(f) or result.stem
        pages = {"summary.md": text, "report.html": one_page(text, title, folder, pictures)}
    for name in OPTIONAL_TABLES.keys() - tables.keys():
        if (folder / name).exists() and (folder / name).read_bytes().startswith(OPTIONAL_TABLES[name]):
            (folder / name).unlink()
    remove_earlier(folder / name for name in OPTIONAL_PICTURES - {*pictures})
    for name, page in pages.items():
        with whole(folder / name) as temporary:
            temporary.write_text(page, encoding="utf-8", errors="surrogateescape")
    for line in warnings + notes:
        say(line)
    return [folder / name for name in (*pages, *tables, *pictures)]


def _tables(
    f: h5py.File,
    envelope: Envelope,
    checked: list[cables.ElementCheck],
    cutting: cables.Cutting,
    deductions: list[Deduction],
) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of each table by its name."""
    cases, elements = read_cases(f), cables.element_columns(f, envelope, checked)
    return {
        "cases.csv": case_columns(f, cases),
        "checks.csv": group_columns(f, envelope, checked),
        "cables.csv": cables.cable_columns(f, envelope, checked, elements),
        "elements.csv": elements,
        "forces.csv": force_columns(f, cases),
        "displacements.csv": displacement_columns(f, cases),
        "reactions.csv": reaction_columns(f),
        **({"moments.csv": moment_table(f)} if (is_bending(f) | is_concrete(f)).any() else {}),
        **({"slides.csv": slip_point_columns(f)} if "slide" in f else {}),
        "cutting_list.csv": cables.cutting_columns(f, cutting),
        "shop_list.csv": shop_columns(f, cutting, deductions),
    }


def _pictures(
    f: h5py.File,
    envelope: Envelope,
    checked: list[cables.ElementCheck],
    tables: dict[str, dict[str, np.ndarray]],
    folder: Path,
) -> list[str]:
    """Draw the pictures of the page, and return their names."""
    drawn = [save(utilisation(f, envelope, checked), folder / "utilisation.png")]
    drawn += draw_pictures(f, folder, "", "form", "stages", "states")
    elements = tables["elements.csv"]
    if "bending_moment_max" in elements:
        drawn.append(save(moments(f, elements["bending_moment_max"]), folder / "moments.png"))
    if "removal" in f and np.isfinite(elements["dynamic_factor"]).any():
        drawn.append(save(dynamic_factors(f, elements["dynamic_factor"]), folder / "dynamic_factors.png"))
    return [path.name for path in drawn]
