"""The pages: links lead somewhere, the commands are those of the program, the examples run as told."""

import re
import tomllib

import numpy as np
import pages
import pytest
from conftest import BIN, ROOT, run_on_standing_ranks, run_process

import netfall
from netfall.cli.parser import parser
from netfall.geometry.sections import TYPE_COLUMNS
from netfall.geometry.tables import ELEMENT_COLUMNS, NODE_COLUMNS
from netfall.job.schema import LIST_KEYS, TABLES
from netfall.post.checks.reactions import sum_end_forces

PAGES = sorted(
    page
    for pattern in ("*.md", "jobs/**/*.md", "partitions/*.md", "src/**/*.md", "tests/**/*.md")
    for page in ROOT.glob(pattern)
)
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
MOST_LINES, WIDEST = 150, pages.WIDEST


def prose(page):
    """Text of a page without its blocks of code."""
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.S)


def anchors(page):
    """The anchors that GitHub makes of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def blocks(page, kind):
    """The blocks of code of one kind, in order."""
    return re.findall(rf"```{kind}\n(.*?)```", page.read_text(), re.S)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page):
    """Every link of a page to another names a file, and a heading, that exist."""
    links = re.findall(r"\]\((?!https://)([^)\s]+)\)", prose(page))
    for link in links:
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_lines_are_readable(page):
    """No line but a table's is wider than a page; the first page is short."""
    lines = page.read_text().splitlines()
    assert [line for line in lines if len(line) > WIDEST and not line.startswith("|")] == []
    assert page != ROOT / "README.md" or len(lines) <= MOST_LINES


@pytest.mark.parametrize("page", pages.PAGES, ids=lambda page: page.name)
def test_pages_are_those_of_the_code(page):
    """What is made from the code is what the code says now."""
    assert page.read_text() == pages.PAGES[page](), "tests/pages.py writes it anew"


def test_the_map_has_every_package():
    """No folder of the package is left out of the map."""
    packages = {path.parent.relative_to(pages.PACKAGE).as_posix() for path in pages.PACKAGE.rglob("*.py")}
    assert packages - {"."} == set(pages.PACKAGES)


def test_every_page_is_linked_from_the_first():
    """From README.md, along links, one comes to every page."""
    reached, to_read = set(), [ROOT / "README.md"]
    while to_read:
        page = to_read.pop()
        if page not in reached:
            reached.add(page)
            links = re.findall(r"\]\(([^)\s#]+\.md)", prose(page))
            to_read += [(page.parent / link).resolve() for link in links if ":" not in link]
    assert set(PAGES) - reached == set()


def test_a_part_without_a_place_is_an_error(tmp_path):
    """A section of the schema without its marks in the page is not left out without a word."""
    page = tmp_path / "page.md"
    page.write_text("<!-- one: made -->\nold\n<!-- end -->\n")
    assert pages.with_parts(page, {"one": "new"}) == "<!-- one: made -->\n\nnew\n\n<!-- end -->\n"
    with pytest.raises(ValueError, match="two"):
        pages.with_parts(page, {"one": "new", "two": "new"})


def test_every_key_stands_in_the_page_of_keys():
    """jobs/KEYS.md has each key of each section, with its unit, range and meaning."""
    text = pages.KEYS.read_text()
    for name, keys in (TABLES | LIST_KEYS).items():
        part = text.split(f"<!-- keys of {name or 'the job'}:")[1].split("<!-- end -->")[0]
        rows = {row.split("`")[1]: row for row in part.splitlines() if row.startswith("| `")}
        for key in keys:
            assert key.meaning in rows[key.name] and f"[{key.unit}]" in rows[key.name] + "[]", key.name
            for bound in (key.low, key.high):
                assert bound is None or f"{bound:g}" in rows[key.name], key.name


def columns(page, heading):
    """The names of columns in the first column of the tables below a heading of a page."""
    part = page.read_text().split(f"\n{heading}\n")[1].split("\n## ")[0]
    cells = [row.split("|")[1] for row in part.splitlines() if row.startswith("| `")]
    return {name for cell in cells for name in re.findall(r"`(\w+)`", re.sub(r"\[.*?\]", "", cell))}


def test_columns_of_tables_are_those_that_are_read():
    """jobs/TABLES.md has the columns of nodes, elements and catalogue that are read, and no other."""
    page = ROOT / "jobs" / "TABLES.md"
    assert columns(page, "## Nodes") == set(NODE_COLUMNS)
    assert columns(page, "## Elements") == set(ELEMENT_COLUMNS)
    assert columns(page, "## Catalogue") == {"name", *TYPE_COLUMNS}


def test_versions_agree():
    """CITATION.cff cites the newest release of CHANGELOG.md; what is unreleased has a development version."""
    log = (ROOT / "CHANGELOG.md").read_text()
    releases = re.findall(r"^## \[(\d.+?)\]", log, re.M)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.M)[1]
    assert cited == releases[0] and netfall.__version__ == project["version"]
    assert (".dev" in project["version"]) == ("## [Unreleased]" in log)
    assert ".dev" in project["version"] or project["version"] == releases[0]


def test_words_of_engineers_are_found():
    """The pages on the model and its limits mention the subjects that engineers search for."""
    folder = ROOT / "src/netfall/docs/pages/explanation"
    text = (folder / "model.md").read_text().lower() + (folder / "limits.md").read_text().lower()
    words = ("buckling", "pressure coefficient", "load combination", "partial factor", "erection")
    words += ("natural frequenc", "ponding", "added mass", "aerodynamic damping", "creep", "fatigue", "slip")
    assert [word for word in words if word not in text] == []


def test_commands_are_those_of_the_program():
    """The table of commands in README.md has a row for each command, and no other."""
    verbs = next(action for action in parser()._actions if action.dest == "command").choices
    told = re.findall(r"^\| `netfall (\w+)", (ROOT / "README.md").read_text(), re.M)
    assert told == list(verbs)


def test_first_job_prints_what_the_readme_shows(workshop):
    """The job of README.md prints what is shown, on two ranks, up to the first fracture; then chaos."""
    job = workshop.folder / "first.toml"
    job.write_text(blocks(ROOT / "README.md", "toml")[0])
    done = run_on_standing_ranks("run", job, ranks=2, cwd=workshop.folder)
    shown = (ROOT / "README.md").read_text().split("The run prints")[1].split("```")[1].strip().splitlines()
    settled = [line for line in shown if line.startswith(("net", "statics", "dynamics"))]
    assert len(settled) == 3 and set(settled) <= set(done.stdout.splitlines()), done.stdout
    onset = re.compile(r"the first at t = \d+\.\d\d\d")  # a step is 0.7 ms
    assert onset.search(done.stdout)[0] == onset.search("\n".join(shown))[0], done.stdout


def test_tutorial_gives_what_it_tells(workshop):
    """The net of jobs/README.md has the form, tensions, swing and break told beside the hand calculation."""
    page = ROOT / "jobs" / "README.md"
    nodes, elements = blocks(page, "csv")
    job = blocks(page, "toml")[0]
    for name, text in (("nodes.csv", nodes), ("elements.csv", elements), ("cross.toml", job)):
        (workshop.folder / name).write_text(text)
    path = workshop.folder / "cross.toml"
    with workshop.run(path) as rest:
        assert rest["form_finding/position"][4, 2] == pytest.approx(1.0, abs=2e-6)  # tolerance 1e-6 of 100 kN
        assert rest["form_finding/unstressed_length"][0] == pytest.approx(10.0373, abs=5e-5)  # digits told
        assert rest["statics/displacement"][-1, 4, 2] == pytest.approx(-0.02815, abs=5e-6)
        assert rest["statics/tension"][-1] == pytest.approx([122.64e3] * 2 + [77.98e3] * 2, abs=5.0)
    sudden = ("--set", "load.steps=0")
    with workshop.run(path, *sudden) as swing:
        z = swing["history/probe_displacement"][:, 0, 2]
        assert z.min() == pytest.approx(-0.05629, abs=5e-6)
        assert swing["history/time"][z[:30].argmin()] == pytest.approx(0.17, abs=1e-9)
    for safety, time in ((0.8, 0.1211), (0.02, 0.1205)):
        options = ("--set", "cable.fracture_strain=0.0017", "--set", f"dynamics.safety={safety}")
        with workshop.run(path, *sudden, *options) as broken:
            assert broken["events/time"][:2] == pytest.approx([time] * 2, abs=5e-5)
            assert broken["events/element"][:2].tolist() == [0, 1]


def test_python_of_the_readme_files_runs(workshop):
    """The blocks of Python in the pages run, on the results that they name."""
    cross = workshop.folder / "results" / "cross"
    cross.mkdir(parents=True)
    page = ROOT / "jobs" / "README.md"
    for name, text in zip(("nodes.csv", "elements.csv"), blocks(page, "csv")):
        (cross / name).write_text(text)
    (cross / "cross.toml").write_text(blocks(page, "toml")[0])
    for name, options in (("cross", ()), ("sudden", ("--set", "load.steps=0"))):
        run_on_standing_ranks("run", cross / "cross.toml", "-o", cross / f"{name}.vtkhdf", *options)
    for text in blocks(page, "python"):
        assert run_process(BIN / "python", "-c", text, cwd=workshop.folder).stdout


def test_the_dome_of_the_page_collapses_as_it_tells(tmp_path):
    """Its commands, from the drawing to the page; the lines that it shows begin so."""
    page = ROOT / "jobs" / "DOME.md"
    run_on_standing_ranks(
        "run", ROOT / "jobs" / "dome_rings.toml", "-o", tmp_path / "rings.vtkhdf", cwd=tmp_path
    )
    for words in ("export rings.vtkhdf -o dome.dxf", "import dome.dxf -o dome --supports supports"):
        done = run_on_standing_ranks(*words.split(), cwd=tmp_path)
    jobs, shown, (catalogue,) = blocks(page, "toml"), blocks(page, "text"), blocks(page, "csv")
    (tmp_path / "dome" / "catalogue.csv").write_text(catalogue)
    for name, job, lines in zip(("dome", "office"), jobs, shown, strict=True):
        (tmp_path / "dome" / f"{name}.toml").write_text(job)
        done = run_on_standing_ranks("run", f"dome/{name}.toml", "-o", f"{name}.vtkhdf", cwd=tmp_path)
        for line in lines.strip().splitlines():
            pattern = ".*".join(re.escape(part) for part in line.split("..."))
            assert re.search(f"^{pattern}", done.stdout, re.M), (line, done.stdout)
    done = run_on_standing_ranks("report", "office.vtkhdf", "-o", "report", cwd=tmp_path)
    check_the_office_of_the_dome(tmp_path / "office.vtkhdf", tmp_path / "report")


def check_the_office_of_the_dome(result, report):
    """Worst member, checks, hoop and foundation as the page tells them, with its digits."""
    rows = [line.split(",") for line in (report / "checks.csv").read_text().splitlines()]
    worst = dict(zip(*rows[:2]))
    assert (worst["group"], worst["case"], f"{float(worst['utilisation']):.2f}") == (
        "hoop3",
        "combination ULS 2",
        "0.74",
    )
    assert "FAILS" not in (report / "summary.md").read_text()
    with netfall.open(result) as result:
        f, group = result.file, result.elements["group"]
        ends, case = f["net/elements"][:], f["cases/ULS 2"]
        N, x = case["tension"][:], f["form_finding/position"][:] + case["displacement"][:]
        inwards = 2.0 * N[group == "hoop3"].max() * np.sin(np.pi / 24)
        assert inwards == pytest.approx(1548e3, rel=5e-4)
        p = ends[group == "hoop3"][0, 0]
        pull = sum_end_forces(x, ends[group == "diagonal4"], N[group == "diagonal4"])[p]
        assert pull[:2] @ x[p, :2] / np.hypot(*x[p, :2]) == pytest.approx(1534e3, rel=5e-4)
        for name, kN in (("cold", 1665.0), ("ULS 2", 7793.0)):
            assert f[f"cases/{name}/reaction"][:, 2].sum() == pytest.approx(-1e3 * kN, rel=5e-4)
        snow = 1.5 * 600.0 * f["net/plan_area"][:].sum()
        by_hand = 1.35 * f["cases/cold/reaction"][:].sum(0) - [0.0, 0.0, snow]
        assert case["reaction"][:].sum(0) == pytest.approx(by_hand, abs=1e-7 * snow)  # found to 3e-7
