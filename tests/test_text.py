"""Text of jobs and tables is never executed: in terminals, Markdown, HTML and spreadsheets."""

import csv
import io
import json
import re
import tracemalloc
from html.parser import HTMLParser

import numpy as np
import pytest
from conftest import run_on_standing_ranks
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from netfall.core.progress import one_line, plain
from netfall.exchange.export import export
from netfall.geometry.build import build_net
from netfall.job.csv_table import Table, write_table
from netfall.job.read import read_job
from netfall.post.page.page import write_page
from netfall.post.plots.run import plot_all
from netfall.post.report.markdown import as_table, bold, code, heading, item, markup, page
from netfall.post.report.report import one_page, write_report

CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
FORMULA = re.compile(r"[=+\-@\t\r#]")  # start of a formula, or of a comment
REFUSED = re.compile("[\x00\r\n]")  # what no cell of a table may hold
SECRET = "to be seen by nobody"
TITLE = (
    "![x](secret.txt) </title><script>alert(1)</script> \x1b[31m\x07\n# <img src=x> `a` $\\frac{x$ _b_ \u202e"
)
UPPER, LOWER = '=HYPERLINK("http://a.b/c";"x")', "@low_er|*x* \x1b]0;y\x07 </script>"
CASE = "+1, ![c](secret.txt) **c** $y$ \x9b2J"
NODES = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z,zone\n1,-3,0,4,1,0,,,,\n2,3,0,4,1,0,,,,\n"
NODES += "3,0,0,-4,1,0,,,,\n5,0,0,0,0,10,0,0,1,-z<b>\n"
JOB = """
title = {title}
[net]
nodes = "nodes.csv"
elements = "elements.csv"
[cable]
modulus = 1.95e11
area = 683.08e-6
density = 7850.0
[group.{upper}]
breaking_load = 240e3
[load]
self_weight = false
steps = 1
[load.zone.{zone}]
dead = 100.0
[[case]]
name = {case}
set = {{"load.snow" = 2000.0}}
"""
ORDINARY = st.text(max_size=12)
SPECIAL = st.text(st.sampled_from(list("ab 1.)(!#*_-+=<>[]`~|\\&;:/\"'$@\n\t\r\x1b\u202e")), max_size=14)
TEXTS = ORDINARY | SPECIAL
RENDERER = MarkdownIt("commonmark", {"html": False}).enable("table")


class Words(HTMLParser):
    """Text and tags of a page."""

    def __init__(self, page: str):
        super().__init__()
        self.shown, self.tags, self.sources = "", [], []
        self.feed(page)

    def handle_data(self, data):
        self.shown += data

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.sources += [value for name, value in attributes if name in ("src", "href")]


def rendered(lines: list[str]) -> Words:
    """Return the page of some lines, as in a browser."""
    return Words(RENDERER.render(page(lines)))


@settings(max_examples=300, deadline=None)
@given(TEXTS, TEXTS)
def test_a_page_shows_any_text_literally(a, b):
    words, other = one_line(a), one_line(b)
    for lines, tags, shown in (
        ([a], {"p"}, [words]),
        (["first", a, b], {"p"}, ["first", words, other]),
        ([item(a)], {"ul", "li", "p"}, [words]),
        ([heading(2, a)], {"h2"}, [words]),
        ([bold(f"x{a}x")], {"p", "strong"}, [one_line(f"x{a}x")]),
        ([markup("With {}.", code(f"x{a}x"))], {"p", "code"}, [f"With {one_line(f'x{a}x')}."]),
        (
            as_table(["head", a], [[a, b]]),
            {"table", "thead", "tbody", "tr", "th", "td"},
            ["head", words, words, other],
        ),
    ):
        if len(lines) == 3 and not (words and other):
            continue  # an empty line ends a paragraph
        page = rendered(lines)
        assert set(page.tags) <= tags
        assert [line.strip() for line in page.shown.split("\n") if line.strip()] == [
            text for text in shown if text
        ]


def test_a_page_embeds_only_its_own_pictures(tmp_path):
    for name in ("form.png", "secret.txt"):
        (tmp_path / name).write_text(SECRET)
    text = "![form](form.png)\n\n![secret](secret.txt)\n\n![gone](gone.png)\n"
    page = Words(one_page(text, "a", tmp_path, ["form.png"]))
    assert page.tags.count("img") == 1 and "secret" in page.shown and "gone" in page.shown


@settings(max_examples=200, deadline=None)
@given(TEXTS)
def test_control_characters_are_escaped(text):
    """For terminals; other letters, tabs and new lines stay."""
    assert not CONTROL.search(plain(text))
    assert plain(text) == text or CONTROL.search(text)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("text")


@settings(max_examples=200, deadline=None)
@given(st.lists(TEXTS.map(str.strip).filter(lambda text: text and not REFUSED.search(text)), min_size=1))
def test_no_cell_of_a_table_is_a_formula(folder, texts):
    """Names that look like formulas or comments have a ' before them, which reading removes."""
    path = folder / "a.csv"
    values = [-1.5 * k for k in range(len(texts))]
    write_table(path, {"text": texts, "number": values})
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert [float(row[1]) for row in rows[1:]] == values
    for cell, _ in rows[1:]:
        assert not FORMULA.match(cell) or np.isfinite(float(cell))
    table = Table(path, ("number", "text"), ())
    assert table.words("text") == texts
    assert table.numbers("number").tolist() == values


def test_a_long_table_is_written_without_a_copy_of_all_cells(folder):
    """The cells as Python objects would need four times the memory of the columns, here 8 MB."""
    path, rows = folder / "long.csv", np.arange(30_000)
    tracemalloc.start()
    write_table(path, dict.fromkeys("abcdefgh", rows))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4e6 and Table(path, ("a", "h"), ()).integers("h").tolist() == rows.tolist()


@pytest.mark.parametrize("more", [{}, {"name": ["a,b", None, 'say "c"']}])
def test_tables_have_the_format_of_csv(folder, more):
    """Byte by byte, with line feeds at the ends of lines. A single empty cell in a row has quotes."""
    columns = {"number": [1.5, np.nan, -0.0]} | more
    write_table(folder / "b.csv", columns)
    expected = io.StringIO()
    rows = zip(["1.5", "", "-0.0"], *more.values())
    csv.writer(expected, lineterminator="\n").writerows([list(columns), *rows])
    assert (folder / "b.csv").read_bytes().decode() == expected.getvalue()


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """Return a result with malicious names, and the output of commands on it."""
    place = tmp_path_factory.mktemp("hostile")
    names = dict(title=TITLE, upper=UPPER, zone="-z<b>", case=CASE)
    (place / "job.toml").write_text(JOB.format(**{name: json.dumps(text) for name, text in names.items()}))
    (place / "nodes.csv").write_text(NODES)
    columns = {"id": [11, 12, 13], "start": [1, 2, 5], "end": [5, 5, 3], "group": [UPPER, UPPER, LOWER]}
    write_table(place / "elements.csv", columns | {"prestress": [50e3, 50e3, 80e3]})
    (place / "secret.txt").write_text(SECRET)
    processes = [
        run_on_standing_ranks(*words, cwd=place) for words in (("check", "job.toml"), ("run", "job.toml"))
    ]
    processes += [run_on_standing_ranks("info", "job.vtkhdf", cwd=place)]
    return place, "".join(done.stdout + done.stderr for done in processes)


def test_commands_print_no_control_characters(hostile):
    _, output = hostile
    assert not CONTROL.search(output) and "\\x1b[31m" in output


def test_a_report_contains_names_as_text(hostile):
    place, _ = hostile
    written = write_report(place / "job.vtkhdf", place / "report")
    text = (place / "report" / "report.html").read_text()
    page = Words(text)
    assert SECRET not in text and not {"script", "a"} & set(page.tags)
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in page.sources)
    assert page.tags.count("img") == sum(path.suffix == ".png" for path in written)
    assert one_line(TITLE) in page.shown and one_line(CASE) in page.shown.replace("\u200b", "")
    assert not CONTROL.search(text) and not CONTROL.search((place / "report" / "summary.md").read_text())
    for path in (path for path in written if path.suffix == ".csv"):
        with open(path, newline="") as file:
            cells = [cell for row in csv.reader(file) for cell in row]
        assert [cell for cell in cells if FORMULA.match(cell) and not is_number(cell)] == []


def is_number(cell: str) -> bool:
    try:
        return np.isfinite(float(cell))
    except ValueError:
        return False


def test_exported_tables_keep_names(hostile):
    place, _ = hostile
    export(place / "job.vtkhdf", place / "again.csv", lambda line: None)
    job = read_job(next(place.glob("again*/job.toml")))
    net = build_net(job)
    assert {net.group_names[k] for k in net.group} == {UPPER, LOWER} and job.title == TITLE


def test_pages_and_pictures_take_any_name(hostile):
    place, _ = hostile
    write_page(place / "job.vtkhdf", place / "page.html")
    text = (place / "page.html").read_text()
    assert "<script>alert" not in text and text.count("</title>") == 1
    assert plot_all(place / "job.vtkhdf", place / "plots")
